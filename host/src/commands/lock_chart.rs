//! `praxi lock-chart`: how far off and how soon the mirror is in step, by the loop's bandwidth; and where it breaks.

mod draw;
mod summary;

use super::args::progress;
use super::sim::{REFERENCE_MOTOR, find_motor};
use super::{Failure, say, say_json};
use crate::output::Folder;
use crate::rigs;
use hil_sim::lock_sweep::{Boundary, Curve, Effort, boundaries, cases, curve};
use serde::Serialize;
use std::path::PathBuf;

/// Speed against accuracy of the lock: phase error, time to lock and stability by bandwidth
#[derive(clap::Args)]
#[command(after_help = "Example: praxi lock-chart --quick --out lock-chart\n\n\
    Writes lock-chart.png, lock-chart.svg, lock-chart.json and summary.md. The motor is taken as it is, with more and \
    less inertia, friction, ripple and noise; the line across is the bandwidth of its file, or the firmware's own.")]
pub(super) struct Args {
    /// A rig file, or reference, reference-180hz, high-viewer, tent
    #[arg(long, default_value = "reference")]
    rig: String,
    /// A motor file, or reference
    #[arg(long, default_value = REFERENCE_MOTOR)]
    motor: String,
    /// Fewer bandwidths, delays and seeds: within half a minute
    #[arg(long)]
    quick: bool,
    /// The folder to write; an earlier result of praxi is replaced
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// All that was found.
#[derive(Serialize)]
struct LockChart {
    program: &'static str,
    version: &'static str,
    rig: String,
    motor: String,
    /// Runs of every point, seeds from 0 on.
    seeds: u64,
    /// Simulated seconds of every run.
    seconds: f64,
    /// The bandwidth of the motor's file, Hz.
    chosen_hz: f64,
    curves: Vec<Curve>,
    boundaries: Vec<Boundary>,
}

fn effort(quick: bool, own_delay_s: f64) -> Effort {
    let between = |low: f64, high: f64, count: u32| -> Vec<f64> {
        let part = |step: u32| f64::from(step) / f64::from(count - 1);
        (0..count).map(|step| low * (high / low).powf(part(step))).collect()
    };
    let (bandwidths, delays, seeds) = if quick { (10, 5, 3) } else { (20, 9, 20) };
    let mut delays_s = between(2.5e-4, 2.25e-3, delays);
    delays_s.push(own_delay_s);
    delays_s.sort_by(f64::total_cmp);
    Effort { bandwidths_hz: between(1.0, 140.0, bandwidths), delays_s, seeds, seconds: 12.0 }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rotation = rigs::find(&args.rig)?.rotation();
    let motor = find_motor(&args.motor)?;
    let folder = Folder::begin(&args.out)?;
    let (cases, effort) = (cases(&motor), effort(args.quick, motor.plant.command_delay_us * 1e-6));
    let bar = progress("locking (motors)", cases.len() as u64 + 1);
    let refused = |error| Failure(format!("{}: {error}", args.motor));
    let mut curves = Vec::new();
    for case in &cases {
        curves.push(curve(&rotation, case, &effort).map_err(refused)?);
        bar.inc(1);
    }
    let chart = LockChart {
        program: "praxi",
        version: env!("CARGO_PKG_VERSION"),
        rig: args.rig.clone(),
        motor: args.motor.clone(),
        seeds: effort.seeds,
        seconds: effort.seconds,
        chosen_hz: motor.controller.bandwidth_hz,
        boundaries: boundaries(&rotation, &cases[0], &effort).map_err(refused)?,
        curves,
    };
    bar.finish_and_clear();
    let value = serde_json::to_value(&chart).expect("figures");
    folder.write("lock-chart.json", format!("{value:#}\n").as_bytes())?;
    folder.write("lock-chart.svg", draw::svg(&chart).as_bytes())?;
    folder.write("lock-chart.png", &draw::png(&chart))?;
    let summary = summary::summary(&chart);
    folder.write("summary.md", summary.as_bytes())?;
    folder.finish()?;
    if args.json {
        say_json(&value);
    } else {
        say(summary);
    }
    Ok(())
}
