//! The lock's chart in words.

use super::LockChart;
use hil_sim::lock_sweep::{Curve, Point};
use std::fmt::Write;

/// The point of a curve nearest to a bandwidth, by ratio.
fn nearest(curve: &Curve, bandwidth_hz: f64) -> Option<&Point> {
    let away = |point: &Point| (point.bandwidth_hz / bandwidth_hz).ln().abs();
    curve.points.iter().min_by(|a, b| away(a).total_cmp(&away(b)))
}

/// The point with the least RMS.
fn best(curve: &Curve) -> Option<&Point> {
    let rms = |point: &&Point| point.rms_slices.unwrap_or(f64::INFINITY);
    curve.points.iter().filter(|point| point.rms_slices.is_some()).min_by(|a, b| rms(a).total_cmp(&rms(b)))
}

fn figure(value: Option<f64>, digits: usize) -> String {
    value.map_or("not in step".to_string(), |value| format!("{value:.digits$}"))
}

/// summary.md.
pub(super) fn summary(chart: &LockChart) -> String {
    let LockChart { rig, motor, seeds, seconds, chosen_hz, .. } = chart;
    let mut text = format!(
        "# The lock by its bandwidth\n\nRig {rig}, motor {motor}; {seeds} seeds of {seconds} s a point: RMS and peak of the worst seed, time to lock of the \
         median one. The bandwidth chosen is {chosen_hz:.1} Hz.\n\n\
         | motor | RMS, slices | peak, slices | time to lock, x the torque's | least RMS | at Hz | phase margin | gain up, down |\n\
         |---|---|---|---|---|---|---|---|\n"
    );
    for curve in &chart.curves {
        let margins = curve.model.margins();
        let (Some(point), least) = (nearest(curve, *chosen_hz), best(curve)) else { continue };
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {:.0}° | {:.0}, {:.0} dB |",
            curve.name,
            figure(point.rms_slices, 4),
            figure(point.peak_slices, 4),
            figure(point.lock_ratio, 3),
            figure(least.and_then(|least| least.rms_slices), 4),
            figure(least.map(|least| least.bandwidth_hz), 0),
            margins.phase_deg,
            margins.gain_up_db,
            margins.gain_down_db,
        );
    }
    text += "\nThe first figures are those of the simulated bandwidth nearest to the chosen one. Margins are those of the linear model at the \
             drive's input, with the estimator as it was measured.\n\n## Where it breaks\n\n\
             | command delay, ms | linear model, Hz | simulated, Hz |\n|---|---|---|\n";
    for boundary in &chart.boundaries {
        let _ = writeln!(
            text,
            "| {:.2} | {:.1} | {:.1} |",
            boundary.delay_s * 1e3,
            boundary.linear_hz,
            boundary.simulated_hz
        );
    }
    text += "\nThe estimator knows the plant and its own commands, so that it does not move the boundary: delay, lag and hold alone do. \
             Repeat a point with praxi sim --motor FILE --seed N and bandwidth_hz in the file's [controller].\n";
    text
}
