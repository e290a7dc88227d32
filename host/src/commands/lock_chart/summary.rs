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
    value.map_or("none".to_string(), |value| format!("{value:.digits$}"))
}

/// summary.md, which is as easily read on a terminal of 80 columns.
pub(super) fn summary(chart: &LockChart) -> String {
    let LockChart { rig, motor, seeds, seconds, chosen_hz, .. } = chart;
    let mut text = format!(
        "# The lock by its bandwidth\n\n\
         Rig {rig}, motor {motor}; {seeds} seeds of {seconds} s a point.\n\
         The bandwidth chosen is {chosen_hz:.1} Hz.\n\n\
         | motor         |    RMS |   peak |  lock |  least | at Hz | phase | gain, dB |\n\
         |---------------|-------:|-------:|------:|-------:|------:|------:|---------:|\n"
    );
    for curve in &chart.curves {
        let margins = curve.model.margins();
        let (Some(point), least) = (nearest(curve, *chosen_hz), best(curve)) else { continue };
        let _ = writeln!(
            text,
            "| {:<13} | {:>6} | {:>6} | {:>5} | {:>6} | {:>5} | {:>4.0}° | {:>8} |",
            curve.name,
            figure(point.rms_slices, 4),
            figure(point.peak_slices, 4),
            figure(point.lock_ratio, 3),
            figure(least.and_then(|least| least.rms_slices), 4),
            figure(least.map(|least| least.bandwidth_hz), 0),
            margins.phase_deg,
            format!("{:+.0}, {:+.0}", -margins.gain_down_db, margins.gain_up_db),
        );
    }
    text += "\n\
        RMS and peak: phase error in slices, of the worst seed; lock: the median time to\n\
        lock, times what full torque alone would take; both at the simulated bandwidth\n\
        nearest to the chosen one. Least: the least RMS, and the bandwidth that has it.\n\
        None: not in step. Phase and gain: margins of the linear model at the drive's\n\
        input, with the estimator as it was measured, at the chosen bandwidth.\n\n\
        ## Where it breaks\n\n\
        | command delay, ms | linear model, Hz | simulated, Hz |\n\
        |------------------:|-----------------:|--------------:|\n";
    for boundary in &chart.boundaries {
        let (delay_ms, linear, simulated) = (boundary.delay_s * 1e3, boundary.linear_hz, boundary.simulated_hz);
        let _ = writeln!(text, "| {delay_ms:>17.2} | {linear:>16.1} | {simulated:>13.1} |");
    }
    text += "\n\
        The estimator knows the plant and its own commands, so that it does not move\n\
        the boundary: delay, lag and hold alone do. Margins at the drive do not tell how\n\
        far it is: they may grow up to it. Repeat a point with praxi sim --motor FILE\n\
        --seed N and bandwidth_hz in the file's [controller].\n";
    text
}
