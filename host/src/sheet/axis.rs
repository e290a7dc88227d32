//! Axes of plots.

use core::ops::Range;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;

/// An axis that is linear, or logarithmic with ticks at powers of ten and, where those are few, between them.
pub(crate) struct Axis {
    range: Range<f64>,
    logarithmic: bool,
}

impl Axis {
    /// Around all of `values`, with a margin; on a logarithmic axis they are above 0.
    pub(crate) fn around(values: impl Iterator<Item = f64> + Clone, logarithmic: bool) -> Self {
        let axis = Self { range: 0.0..1.0, logarithmic };
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
        // Of 1e-6 … 1e6 what is needed.
        let text = format!("{value:.6}");
        text.trim_end_matches('0').trim_end_matches('.').to_string()
    }
}
