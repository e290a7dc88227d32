//! The chart as a picture: SVG for print, PNG for the screen, the same in both.

use super::{Chart, over_jobs, pareto_front};
use crate::render::plan::{Halftone, Plan, Projection};
use crate::sheet::axis::{Axis, axes};
use crate::sheet::{self, Drawing, ink};
use plotters::coord::Shift;
use plotters::prelude::*;

const WIDTH: u32 = 1500;
const KEY_PX: u32 = 560;
const MAIN_PX: u32 = 600;
const SMALL_PX: u32 = 330;
const ROW_PX: i32 = 20;

/// A point of a scatter plot.
struct Mark {
    /// In the key.
    number: usize,
    /// What it is, with its figures.
    label: String,
    /// On a logarithmic axis, better when small.
    x: f64,
    y: f64,
    colour: RGBColor,
    /// Whether it takes part in the front: patterns that flicker stand apart.
    competes: bool,
}

/// A scatter plot with its Pareto front.
struct Scatter<'a> {
    title: String,
    across: &'a str,
    up: &'a str,
    /// Whether y is an error, on a logarithmic axis, better when small; else it is better when large.
    error: bool,
    marks: Vec<Mark>,
}

/// The chart as SVG.
pub fn svg(chart: &Chart) -> String {
    sheet::draw_svg(WIDTH, height(chart), |area| paint(area, chart))
}

/// The chart as PNG.
pub fn png(chart: &Chart) -> Vec<u8> {
    sheet::draw(WIDTH, height(chart), |area| paint(area, chart))
}

/// Scenes and rigs in the order in which they were measured.
fn jobs(chart: &Chart) -> Vec<(&str, &str)> {
    let mut jobs: Vec<_> = chart.optics.iter().map(|point| (point.scene.as_str(), point.rig.as_str())).collect();
    jobs.dedup();
    jobs
}

fn height(chart: &Chart) -> u32 {
    2 * MAIN_PX + SMALL_PX * (jobs(chart).len() as u32).div_ceil(3)
}

fn paint<B: DrawingBackend>(area: &DrawingArea<B, Shift>, chart: &Chart) -> Drawing
where
    B::ErrorType: 'static,
{
    let (top, rest) = area.split_vertically(MAIN_PX);
    let (middle, small) = rest.split_vertically(MAIN_PX);

    let (plot, key) = top.split_horizontally(WIDTH - KEY_PX);
    let optics = Scatter {
        title: format!("Geometry, mean of {} scenes and rigs", jobs(chart).len()),
        across: "time for a turn, ratio to 1",
        up: "worst error, px at the projector",
        error: true,
        marks: optics(chart),
    };
    optics.paint(&plot)?;
    optics.paint_key(&key)?;

    let (plots, key) = middle.split_horizontally(WIDTH - KEY_PX);
    let (left, right) = plots.split_horizontally((WIDTH - KEY_PX) / 2);
    let seen =
        |title: &str, across, marks| Scatter { title: title.into(), across, up: "PSNR seen, dB", error: false, marks };
    let by_time = seen("Halftones by time", "time for a turn, ratio to Bayer", halftones(chart, |point| point.ratio));
    by_time.paint(&left)?;
    seen("and by size", "MB a turn on the wire", halftones(chart, |point| point.wire_bytes / 1e6)).paint(&right)?;
    by_time.paint_key(&key)?;

    let rows = jobs(chart).len().div_ceil(3);
    for ((scene, rig), area) in jobs(chart).into_iter().zip(small.split_evenly((rows, 3))) {
        let of_job = chart.optics.iter().filter(|point| point.scene == scene && point.rig == rig);
        let marks = of_job.enumerate().map(|(index, point)| mark(index, &point.plan, point.ratio, point.error_px));
        Scatter {
            title: format!("{scene} on {rig}"),
            across: "time, ratio to 1",
            up: "worst error, px",
            error: true,
            marks: marks.filter(|mark| mark.y.is_finite()).collect(),
        }
        .paint(&area)?;
    }
    Ok(())
}

fn mark(index: usize, plan: &Plan, x: f64, y: f64) -> Mark {
    let colour = match plan.projection {
        Projection::Planar => RGBColor(240, 160, 80),
        Projection::ConeNewton => RGBColor(110, 190, 255),
        Projection::ConeTable => RGBColor(130, 220, 130),
        Projection::ConeRoot => RGBColor(210, 140, 240),
    };
    let label = format!("{plan}: {x:.2} x, {} px", significant(y));
    Mark { number: index + 1, label, x, y, colour, competes: true }
}

/// Every method's geometric means over all scenes and rigs that it does not lose parts of.
fn optics(chart: &Chart) -> Vec<Mark> {
    let all = over_jobs(&chart.optics, |point| point.plan, |point| (point.ratio, point.error_px));
    all.into_iter().enumerate().map(|(index, (plan, (x, y)))| mark(index, &plan, x, y)).collect()
}

fn halftones(chart: &Chart, across: impl Fn(&super::halftones::Point) -> f64) -> Vec<Mark> {
    let binary: Vec<_> = chart.halftones.iter().filter(|point| point.halftone != Halftone::Grey).cloned().collect();
    let across = over_jobs(&binary, |point| point.halftone, |point| (across(point), 10f64.powf(point.psnr_db / 10.0)));
    let marks = across.into_iter().enumerate().map(|(index, (halftone, (x, power)))| {
        let y = 10.0 * power.log10();
        let turns = binary.iter().find(|point| point.halftone == halftone).map_or(1, |point| point.turns);
        let flickers = if turns > 1 { ", flickers" } else { "" };
        let colour = if turns > 1 { RGBColor(240, 110, 110) } else { RGBColor(110, 190, 255) };
        let label = format!("{halftone}: {} x, {y:.1} dB{flickers}", significant(x));
        Mark { number: index + 1, label, x, y, colour, competes: turns == 1 }
    });
    marks.collect()
}

/// Three digits that mean something.
fn significant(value: f64) -> String {
    if value < 1e-5 {
        return format!("{value:.0e}");
    }
    let digits = (2.0 - value.abs().max(1e-9).log10().floor()).clamp(0.0, 6.0) as usize;
    format!("{value:.digits$}")
}

impl Scatter<'_> {
    fn paint<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawing
    where
        B::ErrorType: 'static,
    {
        let x = Axis::around(self.marks.iter().map(|mark| mark.x), true);
        let y = Axis::around(self.marks.iter().map(|mark| mark.y), self.error);
        let mut chart = axes(area, &self.title, (self.across, x), (self.up, y))?;
        let sense = if self.error { 1.0 } else { -1.0 };
        let competing: Vec<&Mark> = self.marks.iter().filter(|mark| mark.competes).collect();
        let front = pareto_front(&competing.iter().map(|mark| (mark.x, sense * mark.y)).collect::<Vec<_>>());
        let on_front = competing.iter().zip(&front).filter(|(_, on)| **on);
        let mut line: Vec<(f64, f64)> = on_front.map(|(mark, _)| (mark.x, mark.y)).collect();
        line.sort_by(|a, b| a.0.total_cmp(&b.0));
        chart.draw_series(LineSeries::new(line, RGBColor(150, 150, 160)))?;
        let plot = chart.plotting_area();
        let mut taken: Vec<(i32, i32)> = self.marks.iter().map(|mark| plot.map_coordinate(&(mark.x, mark.y))).collect();
        let origin = area.get_base_pixel();
        for mark in &self.marks {
            plot.draw(&Circle::new((mark.x, mark.y), 4, mark.colour.filled()))?;
            let place = free_place(plot.map_coordinate(&(mark.x, mark.y)), &taken);
            taken.push(place);
            let corner = (place.0 - 7 - origin.0, place.1 - 7 - origin.1);
            area.draw(&Text::new(mark.number.to_string(), corner, ink(13)))?;
        }
        Ok(())
    }

    fn paint_key<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawing
    where
        B::ErrorType: 'static,
    {
        for (row, mark) in (0..).zip(&self.marks) {
            let y = 40 + row * ROW_PX;
            area.draw(&Circle::new((14, y + 7), 4, mark.colour.filled()))?;
            area.draw(&Text::new(format!("{:>2} {}", mark.number, mark.label), (26, y), ink(13)))?;
        }
        Ok(())
    }
}

/// Where a number may stand near `point` without covering a point or another number.
fn free_place(point: (i32, i32), taken: &[(i32, i32)]) -> (i32, i32) {
    let places = (1..12).flat_map(|ring| {
        (0..12).map(move |step| {
            let (sin, cos) = (f64::from(step) * core::f64::consts::TAU / 12.0 + 0.6).sin_cos();
            let reach = 8.0 + 6.0 * f64::from(ring);
            (point.0 + (reach * cos) as i32, point.1 - (reach * sin) as i32)
        })
    });
    let is_free =
        |place: &(i32, i32)| taken.iter().all(|other| (place.0 - other.0).abs() > 14 || (place.1 - other.1).abs() > 12);
    places.into_iter().find(is_free).unwrap_or((point.0 + 12, point.1 - 8))
}
