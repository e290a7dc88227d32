//! Where the time of a slice goes, over slice counts: what neighbouring slices shared would fall.

use super::Row;
use crate::sheet::axis::{Axis, axes};
use crate::sheet::{Drawing, ink};
use plotters::coord::Shift;
use plotters::prelude::*;

/// From the bottom up.
const COLOURS: [RGBColor; 4] =
    [RGBColor(120, 130, 255), RGBColor(110, 190, 255), RGBColor(130, 220, 130), RGBColor(240, 160, 80)];

/// Bars of the parts of a slice, for each of `rows`, a sweep by one renderer.
pub fn paint<B: DrawingBackend>(area: &DrawingArea<B, Shift>, rows: &[&Row]) -> Drawing
where
    B::ErrorType: 'static,
{
    let of_slice = |row: &Row| -> Vec<(&str, f64)> {
        row.stages.iter().map(|(name, ms)| (*name, 1e3 * ms / f64::from(row.slices))).collect()
    };
    let highest = rows.iter().map(|row| of_slice(row).iter().map(|(_, us)| us).sum()).fold(0.0, f64::max);
    let Some(renderer) = rows.first().map(|row| &row.renderer) else { return Ok(()) };
    let (x, y) = (Axis::of_bars(rows.len()), Axis::over(0.0..1.25 * highest));
    let title = format!("{renderer}: where a slice's time goes");
    let mut chart = axes(area, &title, ("slices a turn", x), ("µs of a core a slice", y))?;
    for (place, row) in rows.iter().enumerate() {
        let mut below = 0.0;
        for ((_, us), colour) in of_slice(row).into_iter().zip(COLOURS) {
            let x = place as f64;
            chart.draw_series([Rectangle::new([(x + 0.15, below), (x + 0.85, below + us)], colour.filled())])?;
            below += us;
        }
        let text = format!("{}: {below:.0}", row.slices);
        chart.draw_series([Text::new(text, (place as f64 + 0.15, below + 0.06 * highest), ink(12))])?;
    }
    let left = 90;
    let right = area.dim_in_pixel().0 as i32;
    let names = rows.iter().map(|row| of_slice(row)).max_by_key(Vec::len).unwrap_or_default();
    for (place, ((name, _), colour)) in names.into_iter().zip(COLOURS).enumerate() {
        let x = left + (right - left) * place as i32 / 4;
        area.draw(&Rectangle::new([(x + 8, 44), (x + 18, 54)], colour.filled()))?;
        area.draw(&Text::new(name.to_string(), (x + 24, 42), ink(12)))?;
    }
    Ok(())
}
