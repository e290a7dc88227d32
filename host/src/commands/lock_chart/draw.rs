//! The lock's chart as a picture: SVG for print, PNG for the screen, the same in both.

use super::LockChart;
use crate::sheet::axis::{Axis, axes};
use crate::sheet::{self, Drawing, ink};
use hil_sim::lock_sweep::Point;
use plotters::coord::Shift;
use plotters::prelude::*;

const WIDTH: u32 = 1500;
const PANELS_PX: u32 = 900;
const KEY_PX: u32 = 84;
const COLOURS: [RGBColor; 7] = [
    RGBColor(255, 255, 255),
    RGBColor(110, 190, 255),
    RGBColor(60, 120, 220),
    RGBColor(130, 220, 130),
    RGBColor(210, 140, 240),
    RGBColor(240, 220, 110),
    RGBColor(160, 130, 90),
];
const CHOSEN: RGBColor = RGBColor(255, 160, 60);
const LINEAR: RGBColor = RGBColor(240, 110, 110);
const SIMULATED: RGBColor = RGBColor(255, 200, 200);

/// A line or points in one colour.
struct Trace {
    colour: RGBColor,
    points: Vec<(f64, f64)>,
    line: bool,
}

/// One plot; x is logarithmic where nothing is at 0, as a drive without delay is.
struct Plot {
    title: &'static str,
    across: &'static str,
    up: &'static str,
    /// Whether y is logarithmic.
    logarithmic: bool,
    traces: Vec<Trace>,
    /// Lines from bottom to top.
    down: Vec<(f64, RGBColor)>,
}

/// The chart as SVG.
pub(super) fn svg(chart: &LockChart) -> String {
    sheet::draw_svg(WIDTH, PANELS_PX + KEY_PX, |area| paint(area, chart))
}

/// The chart as PNG.
pub(super) fn png(chart: &LockChart) -> Vec<u8> {
    sheet::draw(WIDTH, PANELS_PX + KEY_PX, |area| paint(area, chart))
}

fn paint<B: DrawingBackend>(area: &DrawingArea<B, Shift>, chart: &LockChart) -> Drawing
where
    B::ErrorType: 'static,
{
    let (panels, key) = area.split_vertically(PANELS_PX);
    plots(chart).iter().zip(panels.split_evenly((2, 3))).try_for_each(|(plot, area)| plot.paint(&area))?;
    paint_key(&key, chart)
}

fn plots(chart: &LockChart) -> Vec<Plot> {
    let curves = |x: fn(&Point) -> Option<f64>, y: fn(&Point) -> Option<f64>| -> Vec<Trace> {
        let of_curve = |points: &[Point]| points.iter().filter_map(|point| Some((x(point)?, y(point)?))).collect();
        let traces = chart.curves.iter().zip(COLOURS);
        traces.map(|(curve, colour)| Trace { colour, points: of_curve(&curve.points), line: true }).collect()
    };
    let own_delay = chart.curves.first().map_or(0.0, |curve| curve.model.drive.delay_s);
    let linear_hz = chart.curves.first().map_or(0.0, |curve| curve.model.boundary_hz());
    let away = |delay_s: f64| (delay_s - own_delay).abs();
    let own = chart.boundaries.iter().min_by(|a, b| away(a.delay_s).total_cmp(&away(b.delay_s)));
    let mut down = vec![(chart.chosen_hz, CHOSEN), (linear_hz, LINEAR)];
    down.extend(own.filter(|own| away(own.delay_s) < 1e-6).map(|own| (own.simulated_hz, SIMULATED)));
    let by_bandwidth = |title, up, logarithmic, y| Plot {
        title,
        across: "bandwidth, Hz",
        up,
        logarithmic,
        traces: curves(|point| Some(point.bandwidth_hz), y),
        down: down.clone(),
    };
    vec![
        by_bandwidth("Phase error, worst seed", "RMS, slices", true, |point| point.rms_slices),
        by_bandwidth("Its peak", "peak, slices", true, |point| point.peak_slices),
        by_bandwidth("Time to lock where it is stable, median", "x the torque-limited time", false, |point| {
            point.lock_ratio.filter(|_| point.margins.phase_deg > 0.0)
        }),
        Plot {
            title: "Phase error by time to lock, a point a bandwidth",
            across: "time to lock, s",
            up: "RMS, slices",
            logarithmic: true,
            traces: curves(|point| point.lock_s.filter(|_| point.margins.phase_deg > 0.0), |point| point.rms_slices)
                .into_iter()
                .map(|trace| Trace { line: false, ..trace })
                .collect(),
            down: vec![],
        },
        stability(chart, own_delay),
        by_bandwidth("Phase margin at the drive, linear model", "degrees", false, |point| {
            Some(point.margins.phase_deg).filter(|phase| *phase > 0.0)
        }),
    ]
}

fn stability(chart: &LockChart, own_delay: f64) -> Plot {
    let boundary = |colour, line, y: &dyn Fn(&hil_sim::lock_sweep::Boundary) -> f64| Trace {
        colour,
        points: chart.boundaries.iter().map(|boundary| (boundary.delay_s * 1e3, y(boundary))).collect(),
        line,
    };
    Plot {
        title: "Stable below: as it is, by command delay",
        across: "command delay, ms",
        up: "bandwidth, Hz",
        logarithmic: true,
        traces: vec![
            boundary(LINEAR, true, &|boundary| boundary.linear_hz),
            boundary(SIMULATED, false, &|boundary| boundary.simulated_hz),
            Trace { colour: CHOSEN, points: vec![(own_delay * 1e3, chart.chosen_hz)], line: false },
        ],
        down: vec![],
    }
}

impl Plot {
    fn paint<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawing
    where
        B::ErrorType: 'static,
    {
        let points = || self.traces.iter().flat_map(|trace| trace.points.iter().copied());
        let xs = || points().map(|(x, _)| x).chain(self.down.iter().map(|(x, _)| *x));
        let ys = || points().map(|(_, y)| y);
        let (low, high) = ys().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)));
        let (x, y) = (Axis::around(xs(), xs().all(|x| x > 0.0)), Axis::around(ys(), self.logarithmic));
        let mut chart = axes(area, self.title, (self.across, x), (self.up, y))?;
        for (x, colour) in &self.down {
            chart.draw_series(LineSeries::new([(*x, low), (*x, high)], colour.stroke_width(2)))?;
        }
        for Trace { colour, points, line } in &self.traces {
            if *line {
                chart.draw_series(LineSeries::new(points.iter().copied(), colour))?;
            }
            chart.draw_series(
                points.iter().map(|point| Circle::new(*point, if *line { 2 } else { 4 }, colour.filled())),
            )?;
        }
        Ok(())
    }
}

fn paint_key<B: DrawingBackend>(area: &DrawingArea<B, Shift>, chart: &LockChart) -> Drawing
where
    B::ErrorType: 'static,
{
    let motors = chart.curves.iter().zip(COLOURS).map(|(curve, colour)| (curve.name.to_string(), colour));
    let chosen = format!("chosen, {:.1} Hz", chart.chosen_hz);
    let lines =
        [(chosen, CHOSEN), ("boundary, linear model".into(), LINEAR), ("boundary, simulated".into(), SIMULATED)];
    for (place, (name, colour)) in (0..).zip(motors.chain(lines)) {
        let (x, y) = (20 + 290 * (place % 5), 14 + 30 * (place / 5));
        area.draw(&Rectangle::new([(x, y), (x + 18, y + 12)], colour.filled()))?;
        area.draw(&Text::new(name, (x + 26, y - 1), ink(14)))?;
    }
    Ok(())
}
