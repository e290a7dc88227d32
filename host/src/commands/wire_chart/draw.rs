//! The wire's chart as a picture: SVG for print, PNG for the screen, the same in both.

use super::{NEEDED, WireChart, by_case};
use crate::sheet::axis::{Axis, axes};
use crate::sheet::{self, Drawing, ink};
use crate::wire_chart::{Coding, Point};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::FontTransform;

const WIDTH: u32 = 1500;
const BARS_PX: u32 = 660;
const SPEED_PX: u32 = 420;
const KEY_PX: u32 = 40;
/// Below the bars, for what they are of.
const NAMES_PX: i32 = 230;
/// In the order of [`Coding::ALL`].
const COLOURS: [RGBColor; 5] = [
    RGBColor(255, 160, 60),
    RGBColor(160, 130, 90),
    RGBColor(110, 190, 255),
    RGBColor(130, 220, 130),
    RGBColor(210, 140, 240),
];
/// Bars end here: the difference between two turns of what stands still is next to nothing.
const RATIO_MAX: f64 = 200.0;
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
    let (plot, names) = area.split_vertically(BARS_PX - NAMES_PX as u32);
    let groups = by_case(&chart.points).count();
    let most = chart.points.iter().map(|point| point.ratio).fold(NEEDED, f64::max).min(RATIO_MAX);
    let heights = Axis::around([1.0, most].into_iter(), true);
    let title = "Bytes of planes over bytes on the wire, by scene, halftone and motion from turn to turn (cut at 200)";
    let mut drawing = axes(&plot, title, ("", Axis::of_bars(groups)), ("ratio", heights))?;
    for (place, case) in by_case(&chart.points).enumerate() {
        for (bar, (point, colour)) in case.iter().zip(COLOURS).enumerate() {
            let left = place as f64 + 0.08 + 0.168 * bar as f64;
            drawing.draw_series([Rectangle::new(
                [(left, 1.0), (left + 0.15, point.ratio.min(RATIO_MAX))],
                colour.filled(),
            )])?;
        }
    }
    let across = [(0.0, NEEDED), (groups as f64, NEEDED)];
    drawing.draw_series(LineSeries::new(across, LIMIT.stroke_width(2)))?;
    let ends = [0.0, groups as f64].map(|place| drawing.backend_coord(&(place, 1.0)).0 - area.get_base_pixel().0);
    let step = f64::from(ends[1] - ends[0]) / groups.max(1) as f64;
    let middle = |place: f64| ends[0] + (step * (place + 0.5)) as i32;
    let upright = ink(13).transform(FontTransform::Rotate90);
    let firsts: Vec<&Point> = by_case(&chart.points).filter_map(|case| case.first()).collect();
    for (place, first) in firsts.iter().enumerate() {
        let name = format!("{}, {}", first.halftone, first.motion);
        names.draw(&Text::new(name, (middle(place as f64) + 7, 2), upright.clone()))?;
    }
    let mut start = 0;
    for same in firsts.chunk_by(|one, next| one.scene == next.scene) {
        let (centre, name) = (start as f64 + 0.5 * (same.len() - 1) as f64, same[0].scene.clone());
        names.draw(&Text::new(
            name.clone(),
            (middle(centre) - 4 * name.chars().count() as i32, NAMES_PX - 24),
            ink(14),
        ))?;
        start += same.len();
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
    let drawn = || chart.points.iter().filter(|point| point.ratio <= RATIO_MAX);
    let up = ("ratio", Axis::around(drawn().map(|point| point.ratio), true));
    let mut drawing = axes(area, title, across, up)?;
    for (coding, colour) in Coding::ALL.into_iter().zip(COLOURS) {
        let points = drawn().filter(|point| point.coding == coding);
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
