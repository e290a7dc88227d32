//! A report as a picture: time against triangles, and against slices.

use super::parts;
use super::who::Who;
use super::{Report, Row};
use crate::render::plan::Projection;
use crate::sheet::axis::{Axis, axes};
use crate::sheet::{self, Drawing, INK, ink};
use plotters::coord::Shift;
use plotters::prelude::*;

const WIDTH: u32 = 1200;
const KEY_PX: u32 = 330;
const MAIN_PX: u32 = 560;
const SWEEP_PX: u32 = 460;
const ROW_PX: i32 = 20;

/// A renderer by one model.
struct Line {
    label: String,
    colour: RGBColor,
    /// Hollow marks: a cone.
    is_hollow: bool,
    /// Where along x, and the lower, middle and upper quartile of the times in milliseconds.
    points: Vec<(f64, [f64; 3])>,
}

/// Lines of times over triangles or slices.
struct Plot {
    title: String,
    across: &'static str,
    lines: Vec<Line>,
    /// Whether a time in proportion to x is drawn beside each line, from its first point.
    naive: bool,
    /// How long the rig takes for a turn.
    limit_ms: f64,
}

/// The report as SVG.
pub fn svg(report: &Report) -> String {
    sheet::draw_svg(WIDTH, height(report), |area| paint(area, report))
}

/// The report as PNG.
pub fn png(report: &Report) -> Vec<u8> {
    sheet::draw(WIDTH, height(report), |area| paint(area, report))
}

fn swept(report: &Report) -> Vec<&str> {
    let scenes = report.scenes().into_iter();
    scenes.filter(|scene| report.rows.iter().any(|row| row.is_of_sweep && row.scene == *scene)).collect()
}

fn height(report: &Report) -> u32 {
    MAIN_PX + SWEEP_PX * swept(report).len() as u32
}

fn paint<B: DrawingBackend>(area: &DrawingArea<B, Shift>, report: &Report) -> Drawing
where
    B::ErrorType: 'static,
{
    let (top, below) = area.split_vertically(MAIN_PX);
    let (plot, key) = top.split_horizontally(WIDTH - KEY_PX);
    let by_triangles = by_triangles(report);
    by_triangles.paint(&plot)?;
    by_triangles.paint_key(&key, report)?;
    let scenes = swept(report);
    if scenes.is_empty() {
        return Ok(());
    }
    let cells = below.split_evenly((scenes.len(), 1));
    scenes.iter().zip(cells).try_for_each(|(scene, cell)| {
        let (left, right) = cell.split_horizontally(WIDTH / 2);
        by_slices(report, scene).paint(&left)?;
        // Of the fastest that tells them.
        let parts = |who: &Who| report.sweep(scene, *who).iter().any(|row| !row.stages.is_empty());
        match [Who::CpuAvx512, Who::CpuAvx2, Who::CpuPortable].iter().find(|who| parts(who)) {
            Some(who) => parts::paint(&right, &report.sweep(scene, *who)),
            None => Ok(()),
        }
    })
}

fn colour(who: Who) -> RGBColor {
    match who {
        Who::Clear => RGBColor(160, 160, 170),
        Who::CpuPortable => RGBColor(130, 220, 130),
        Who::CpuAvx2 => RGBColor(110, 190, 255),
        Who::CpuAvx512 => RGBColor(120, 130, 255),
        Who::GpuSlice => RGBColor(240, 110, 110),
        Who::GpuAtlas => RGBColor(240, 160, 80),
        Who::GpuCompute => RGBColor(235, 215, 90),
    }
}

fn quartiles(row: &Row) -> [f64; 3] {
    [row.turn_ms.lower, row.turn_ms.median, row.turn_ms.upper]
}

/// Every renderer and model by the first halftone, at the rig's own slices.
fn by_triangles(report: &Report) -> Plot {
    let halftone = report.rows.first().map(|row| row.plan.halftone);
    let main: Vec<&Row> =
        report.rows.iter().filter(|row| !row.is_of_sweep && Some(row.plan.halftone) == halftone).collect();
    let mut lines: Vec<(Who, Projection, Line)> = Vec::new();
    for row in &main {
        let projection = row.plan.projection;
        let place = lines.iter().position(|(who, other, _)| (*who, *other) == (row.who, projection));
        let place = place.unwrap_or_else(|| {
            let model = if projection == Projection::Planar { "planar" } else { "cone" };
            let line = Line {
                label: format!("{}, {model}", row.who),
                colour: colour(row.who),
                is_hollow: projection != Projection::Planar,
                points: Vec::new(),
            };
            lines.push((row.who, projection, line));
            lines.len() - 1
        });
        lines[place].2.points.push((row.triangles as f64, quartiles(row)));
    }
    let mut lines: Vec<Line> = lines.into_iter().map(|(.., line)| line).collect();
    lines.iter_mut().for_each(|line| line.points.sort_by(|a, b| a.0.total_cmp(&b.0)));
    let slices = main.first().map_or(0, |row| row.slices);
    let halftone = halftone.map(|halftone| halftone.to_string()).unwrap_or_default();
    Plot {
        title: format!("Time for a turn of {slices} slices, {halftone}"),
        across: "triangles",
        lines,
        naive: false,
        limit_ms: 1e3 / report.rig_turns_per_second,
    }
}

fn by_slices(report: &Report, scene: &str) -> Plot {
    let lines = Who::ALL.into_iter().filter_map(|who| {
        let rows = report.sweep(scene, who);
        let points: Vec<_> = rows.iter().map(|row| (f64::from(row.slices), quartiles(row))).collect();
        let is_hollow = rows.first()?.plan.projection != Projection::Planar;
        Some(Line { label: String::new(), colour: colour(who), is_hollow, points })
    });
    Plot {
        title: format!("{scene} by slices; dashed: in proportion"),
        across: "slices a turn",
        lines: lines.collect(),
        naive: true,
        limit_ms: 1e3 / report.rig_turns_per_second,
    }
}

impl Plot {
    fn xs(&self) -> impl Iterator<Item = f64> + Clone {
        self.lines.iter().flat_map(|line| line.points.iter().map(|point| point.0))
    }

    fn paint<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawing
    where
        B::ErrorType: 'static,
    {
        let (from, to) = self.xs().fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), x| (low.min(x), high.max(x)));
        let first = self.lines.iter().filter(|_| self.naive).filter_map(|line| line.points.first());
        let naive = first.map(|(x, [_, middle, _])| middle * to / x);
        let measured = self.lines.iter().flat_map(|line| line.points.iter().flat_map(|point| point.1));
        let times = measured.chain(naive).chain([self.limit_ms]);
        let (x, y) = (Axis::around(self.xs(), true), Axis::around(times, true));
        let mut chart = axes(area, &self.title, (self.across, x), ("ms a turn", y))?;
        let limit = self.limit_ms;
        chart.draw_series(DashedLineSeries::new([(from, limit), (to, limit)], 2, 4, INK.into()))?;
        chart.draw_series([Text::new("as fast as the rig turns", (from, limit * 0.92), ink(12))])?;
        for Line { colour, is_hollow, points, .. } in &self.lines {
            chart.draw_series(LineSeries::new(points.iter().map(|(x, [_, middle, _])| (*x, *middle)), *colour))?;
            for (x, [lower, middle, upper]) in points {
                chart.draw_series(LineSeries::new([(*x, *lower), (*x, *upper)], colour.stroke_width(3)))?;
                let style = if *is_hollow { colour.stroke_width(1) } else { colour.filled() };
                chart.draw_series([Circle::new((*x, *middle), 4, style)])?;
            }
            if let (true, Some((x, [_, middle, _]))) = (self.naive, points.first()) {
                let line = [(*x, *middle), (to, middle * to / x)];
                chart.draw_series(DashedLineSeries::new(line, 5, 5, colour.mix(0.6).into()))?;
            }
        }
        Ok(())
    }

    fn paint_key<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, report: &Report) -> Drawing
    where
        B::ErrorType: 'static,
    {
        let mut y = 40;
        for line in &self.lines {
            let style = if line.is_hollow { line.colour.stroke_width(1) } else { line.colour.filled() };
            area.draw(&Circle::new((14, y + 7), 4, style))?;
            area.draw(&Text::new(line.label.clone(), (26, y), ink(13)))?;
            y += ROW_PX;
        }
        y += ROW_PX;
        let machine = &report.machine;
        let mut about =
            vec![machine.processor.clone(), format!("{} cores, {} threads", machine.cores, machine.threads)];
        about.extend(report.adapters.iter().cloned());
        about.push(format!("{}, edges within {} px", report.rig, report.budget_px));
        about.push(format!("medians and quartiles, {} rounds", report.rounds));
        if let Some(row) = report.rows.iter().find(|row| row.slices_rendered < row.slices) {
            about.push(format!("{}: {} of {} slices, scaled up", row.who, row.slices_rendered, row.slices));
        }
        for text in about {
            let text: String = text.chars().take(38).collect();
            area.draw(&Text::new(text, (14, y), ink(12)))?;
            y += ROW_PX;
        }
        Ok(())
    }
}
