//! Axes of plots.

use super::{FAINT, INK, PAPER, ink};
use core::ops::Range;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use std::error::Error;

/// A plot on its axes.
pub(crate) type Chart<'a, B> = ChartContext<'a, B, Cartesian2d<Axis, Axis>>;

/// An axis that is linear, or logarithmic with ticks at powers of ten and, where those are few, between them.
pub(crate) struct Axis {
    /// On a logarithmic axis, of powers of ten.
    range: Range<f64>,
    logarithmic: bool,
    has_ticks: bool,
}

/// Draws a title and two axes, each with what stands along it, and gives the plot that they hold.
pub(crate) fn axes<'a, B: DrawingBackend>(
    area: &'a DrawingArea<B, Shift>,
    title: &str,
    (across, x): (&str, Axis),
    (up, y): (&str, Axis),
) -> Result<Chart<'a, B>, Box<dyn Error>>
where
    B::ErrorType: 'static,
{
    let mut chart = ChartBuilder::on(area)
        .caption(title, ink(16))
        .margin(10)
        .x_label_area_size(40)
        .y_label_area_size(78)
        .build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .x_desc(across)
        .y_desc(up)
        .label_style(ink(12))
        .axis_desc_style(ink(13))
        .axis_style(INK)
        .bold_line_style(FAINT)
        .light_line_style(PAPER)
        .draw()?;
    Ok(chart)
}

impl Axis {
    /// Linear, over `range`.
    pub(crate) fn over(range: Range<f64>) -> Self {
        Self { range, logarithmic: false, has_ticks: true }
    }

    /// For `bars` bars, each of width 1, that say themselves what they are.
    pub(crate) fn of_bars(bars: usize) -> Self {
        Self { has_ticks: false, ..Self::over(0.0..bars as f64) }
    }

    /// Around all of `values`, with a margin; on a logarithmic axis they are above 0.
    pub(crate) fn around(values: impl Iterator<Item = f64> + Clone, logarithmic: bool) -> Self {
        let axis = Self { logarithmic, ..Self::over(0.0..1.0) };
        let scaled = values.map(|value| axis.scaled(value));
        let low = scaled.clone().fold(f64::INFINITY, f64::min);
        let high = scaled.fold(f64::NEG_INFINITY, f64::max);
        let margin = 0.08 * (high - low).max(0.4);
        Self { range: low - margin..high + margin, ..axis }
    }

    fn scaled(&self, value: f64) -> f64 {
        if self.logarithmic { value.max(1e-6).log10() } else { value }
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let part = (self.scaled(*value) - self.range.start) / (self.range.end - self.range.start);
        limit.0 + (part * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let Range { start, end } = self.range;
        if !self.has_ticks {
            return Vec::new();
        }
        if !self.logarithmic {
            return RangedCoordf64::from(start..end).key_points(hint);
        }
        let steps: &[f64] = match end - start {
            many if many > 2.5 => &[1.0],
            some if some > 0.9 => &[1.0, 2.0, 5.0],
            _ => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
        };
        let decades = start.floor() as i32..=end.ceil() as i32;
        let ticks = decades.flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
        ticks.filter(|tick| self.range.contains(&tick.log10())).collect()
    }

    fn range(&self) -> Range<f64> {
        match self.logarithmic {
            true => 10f64.powf(self.range.start)..10f64.powf(self.range.end),
            false => self.range.clone(),
        }
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, value: &f64) -> String {
        // Of 1e-6 … 1e6 what is needed; adding 0 makes a negative zero plain.
        let text = format!("{:.6}", (value * 1e6).round() / 1e6 + 0.0);
        text.trim_end_matches('0').trim_end_matches('.').to_string()
    }
}
