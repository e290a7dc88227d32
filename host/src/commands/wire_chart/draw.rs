//! The wire's chart as a picture: SVG for print, PNG for the screen, the same in both.

use super::{NEEDED, WireChart, cases};
use crate::sheet::axis::{Axis, axes};
use crate::sheet::{self, Drawing, ink};
use crate::wire_chart::{Coding, Point};
use plotters::coord::Shift;
use plotters::prelude::*;

const WIDTH: u32 = 1500;
const BARS_PX: u32 = 560;
const SPEED_PX: u32 = 420;
const KEY_PX: u32 = 40;
/// In the order of [`Coding::ALL`].
const COLOURS: [RGBColor; 5] = [
    RGBColor(255, 160, 60),
    RGBColor(160, 130, 90),
    RGBColor(110, 190, 255),
    RGBColor(130, 220, 130),
    RGBColor(210, 140, 240),
];
const LIMIT: RGBColor = RGBColor(240, 110, 110);

/// The chart as SVG.
pub(super) fn svg(chart: &WireChart) -> String {
    sheet::draw_svg(WIDTH, BARS_PX + SPEED_PX + KEY_PX, |area| paint(area, chart))
}

/// The chart as PNG.
pub(super) fn png(chart: &WireChart) -> Vec<u8> {
    sheet::draw(WIDTH, BARS_PX + SPEED_PX + KEY_PX, |area| paint(area, chart))
}

fn paint<B: DrawingBackend>(area: &DrawingArea<B, Shift>, chart: &WireChart) -> Drawing
where
    B::ErrorType: 'static,
{
    let (top, rest) = area.split_vertically(BARS_PX);
    let (speeds, key) = rest.split_vertically(SPEED_PX);
    bars(&top, chart)?;
    let (left, right) = speeds.split_horizontally(WIDTH / 2);
    speed(&left, chart, "Compressing", |point| point.compress_mb_s)?;
    speed(&right, chart, "Expanding, with its check", |point| point.expand_mb_s)?;
    paint_key(&key)
}

/// Ratios: a group of bars a scene, halftone and motion.
fn bars<B: DrawingBackend>(area: &DrawingArea<B, Shift>, chart: &WireChart) -> Drawing
where
    B::ErrorType: 'static,
{
    let (plot, names) = area.split_vertically(BARS_PX - 110);
    let groups = cases(&chart.points).count();
    let most = chart.points.iter().map(|point| point.ratio).fold(NEEDED, f64::max);
    let heights = Axis::around([1.0, most].into_iter(), true);
    let title = "Bytes of planes over bytes on the wire, by scene, halftone and degrees from turn to turn";
    let mut drawing = axes(&plot, title, ("", Axis::of_bars(groups)), ("ratio", heights))?;
    for (place, case) in cases(&chart.points).enumerate() {
        for (bar, (point, colour)) in case.iter().zip(COLOURS).enumerate() {
            let left = place as f64 - 0.42 + 0.168 * bar as f64;
            drawing.draw_series([Rectangle::new([(left, 1.0), (left + 0.15, point.ratio)], colour.filled())])?;
        }
    }
    let across = [(-0.5, NEEDED), (groups as f64 - 0.5, NEEDED)];
    drawing.draw_series(LineSeries::new(across, LIMIT.stroke_width(2)))?;
    let ends = [0, groups.saturating_sub(1)].map(|place| drawing.backend_coord(&(place as f64, 1.0)).0);
    let step = f64::from(ends[1] - ends[0]) / (groups.max(2) - 1) as f64;
    let left = area.get_base_pixel().0;
    for (place, case) in cases(&chart.points).enumerate() {
        let Some(first) = case.first() else { continue };
        let middle = ends[0] - left + (step * place as f64) as i32;
        let name = [first.scene.clone(), first.halftone.to_string(), format!("{}°", first.degrees)];
        for (line, word) in (0..).zip(&name) {
            // Every second group a little lower, so that long names pass each other.
            let y = 2 + 15 * line + if place % 2 == 1 { 50 } else { 0 };
            names.draw(&Text::new(word.clone(), (middle - 4 * word.chars().count() as i32, y), ink(13)))?;
        }
    }
    Ok(())
}

/// Ratio by speed, a point a case.
fn speed<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    chart: &WireChart,
    title: &str,
    of: fn(&Point) -> f64,
) -> Drawing
where
    B::ErrorType: 'static,
{
    let across = ("MB of planes a second of one core", Axis::around(chart.points.iter().map(of), true));
    let up = ("ratio", Axis::around(chart.points.iter().map(|point| point.ratio), true));
    let mut drawing = axes(area, title, across, up)?;
    for (coding, colour) in Coding::ALL.into_iter().zip(COLOURS) {
        let points = chart.points.iter().filter(|point| point.coding == coding);
        drawing.draw_series(points.map(|point| Circle::new((of(point), point.ratio), 4, colour.filled())))?;
    }
    Ok(())
}

fn paint_key<B: DrawingBackend>(area: &DrawingArea<B, Shift>) -> Drawing
where
    B::ErrorType: 'static,
{
    let codings = Coding::ALL.map(|coding| coding.name().to_owned()).into_iter().zip(COLOURS);
    let limit = (format!("{NEEDED}: 20 turns a second over USB high speed"), LIMIT);
    for (place, (name, colour)) in (0..).zip(codings.chain([limit])) {
        let (x, y) = (40 + 180 * place, 14);
        area.draw(&Rectangle::new([(x, y), (x + 18, y + 12)], colour.filled()))?;
        area.draw(&Text::new(name, (x + 26, y - 1), ink(14)))?;
    }
    Ok(())
}
