//! `praxi tune`: identifies a motor from a short run and sets the loop's gains.

use super::args::{progress, seed};
use super::sim::{REFERENCE_MOTOR, find_motor};
use super::{Failure, say, say_json};
use crate::output::File;
use crate::rigs;
use hil_sim::scenario::Scenario;
use hil_sim::statistics::LockStatistics;
use hil_sim::tuning::identify::{Estimate, Identified};
use hil_sim::tuning::{Tuned, prove, record, tune};
use protocol::units::Nanos;
use serde_json::json;
use std::path::PathBuf;

/// Identify a motor's inertia, friction, ripple and delay from a run of 20 s, and set the loop's gains
#[derive(clap::Args)]
#[command(after_help = "Example: praxi tune --motor motor.toml --out tuned.toml && praxi sim --motor tuned.toml\n\n\
    The run is simulated. Of the motor's file the tuner sees what a data sheet tells (max_torque_nm, \
    torque_loop_bandwidth_hz, [sensors], [projector_clock], rate_hz) and what the sensors count; the rest is the truth that it \
    is to find, and none of it goes into the file that it writes. Margins are those of a linear model of the loop, broken at the \
    drive's input, with the estimator as it was measured.")]
pub(super) struct Args {
    /// A rig file, or reference, reference-180hz, high-viewer, tent
    #[arg(long, default_value = "reference")]
    rig: String,
    /// A motor file, or reference: the device that is simulated
    #[arg(long, default_value = REFERENCE_MOTOR)]
    motor: String,
    /// All noise follows from it
    #[arg(long, value_parser = seed, allow_negative_numbers = true, default_value_t = 1)]
    seed: u64,
    /// Write a motor file with what was found; one that is there is kept, and is an error
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rig = rigs::find(&args.rig)?;
    let (rotation, truth) = (rig.rotation(), find_motor(&args.motor)?);
    let refused = |error: &dyn std::fmt::Display| Failure(format!("motor {}: {error}", args.motor));
    let bar = progress("tuning", 3);
    let quiet = Scenario { events: Vec::new(), ..Scenario::default() };
    let recording = record(&rotation, &truth, &quiet, args.seed);
    bar.inc(1);
    let tuned = tune(&rotation, &truth, &recording).map_err(|error| refused(&error))?;
    bar.inc(1);
    let latency = Nanos::from_seconds(rig.projector.frame_latency_us * 1e-6);
    let proof = prove(&rotation, latency, &truth, &tuned, args.seed).map_err(|error| refused(&error))?;
    bar.finish_and_clear();
    let holds = proof.locked_seconds > 0.0;
    if let (true, Some(place)) = (holds, &args.out) {
        if place.exists() {
            return Err(Failure(format!("{} is there: name a new file", place.display())));
        }
        let head = "# Found by praxi tune; its --help tells what was told and not found.\n";
        File::begin_over(place)?.finish(format!("{head}{}", tuned.motor.to_toml()).as_bytes())?;
    }
    if args.json {
        say_json(&json!({ "tuned": tuned, "proof": super::sim::as_json(&proof) }));
    } else {
        say(as_text(&tuned, &proof));
    }
    if !holds {
        let why = "what was found does not bring the mirror into step, and is not written: check encoder_counts_per_turn and max_torque_nm";
        return Err(refused(&why));
    }
    Ok(())
}

fn as_text(tuned: &Tuned, proof: &LockStatistics) -> String {
    let mut lines = vec![format!("{:<26} {:>12}   {:>10}", "identified", "estimate", "+-")];
    lines.extend(
        figures(&tuned.identified)
            .into_iter()
            .map(|(name, unit, Estimate { value, sigma })| format!("{name:<26} {value:>12.5}   {sigma:>10.5} {unit}")),
    );
    let (model, margins) = (&tuned.model, &tuned.margins);
    lines.extend([
        String::new(),
        format!("bandwidth     {:.1} Hz, damping {:.2}", model.feedback.bandwidth_hz, model.feedback.damping),
        format!("unstable      from {:.1} Hz on", tuned.boundary_hz),
        format!(
            "margins       {:.0} degrees, {:.1} dB up, {:.1} dB down; crossover {:.1} Hz; at the drive",
            margins.phase_deg, margins.gain_up_db, margins.gain_down_db, margins.crossover_hz
        ),
        match proof.recoveries.first().and_then(|start| start.settled_s) {
            Some(settled_s) if proof.locked_seconds > 0.0 => format!(
                "tried         {:.0} s: in step after {settled_s:.3} s, RMS {:.4}, peak {:.4} slices",
                proof.seconds, proof.rms_slices, proof.peak_slices
            ),
            _ => format!("tried         {:.0} s: NOT in step", proof.seconds),
        },
    ]);
    lines.join("\n")
}

/// Name, unit and figure, in units of which a figure has some digits before its point.
fn figures(identified: &Identified) -> Vec<(String, &'static str, Estimate)> {
    let scaled = |Estimate { value, sigma }: Estimate, by: f64| Estimate { value: value * by, sigma: sigma * by };
    let mut all = vec![
        ("inertia".into(), "g m2", scaled(identified.inertia_kg_m2, 1e3)),
        ("Coulomb friction".into(), "mN m", scaled(identified.coulomb_friction_nm, 1e3)),
        ("viscous friction".into(), "mN m s", scaled(identified.viscous_friction_nm_s, 1e3)),
        ("air drag".into(), "uN m s2", scaled(identified.air_drag_nm_s2, 1e6)),
        ("command delay".into(), "us", scaled(identified.command_delay_s, 1e6)),
        ("encoder eccentricity".into(), "mrad", scaled(identified.eccentricity_rad, 1e3)),
        ("imbalance".into(), "mN m", scaled(identified.once_per_turn_nm, 1e3)),
    ];
    for harmonic in &identified.harmonics {
        all.push(match harmonic.of_torque {
            true => (format!("torque ripple, {} a turn", harmonic.per_turn), "%", scaled(harmonic.size, 1e2)),
            false => (format!("cogging, {} a turn", harmonic.per_turn), "mN m", scaled(harmonic.size, 1e3)),
        });
    }
    all
}
