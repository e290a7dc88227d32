//! `praxi sim`: motor, lock and sequencing alone.

use super::args::{progress, seed};
use super::{Failure, say, say_json};
use crate::input;
use crate::link::serial::BAUD;
use crate::rigs;
use hil_sim::device::TurnHandle;
use hil_sim::motor::Motor;
use hil_sim::scenario::{Pacing, Scenario};
use hil_sim::simulator::Simulator;
use hil_sim::statistics::LockStatistics;
use hil_sim::world::{World, repeat_command};
use protocol::message::{Fault, Faults, State};
use protocol::units::Nanos;
use serde_json::{Value, json};
use std::fmt::Display;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

mod serve_usb;

#[cfg(unix)]
mod serve_serial;

/// The name of the motor that comes with the simulator.
pub(super) const REFERENCE_MOTOR: &str = "reference";

/// The scenario in which nothing goes wrong.
const PLAIN: &str = "plain";

/// Simulate motor, lock and sequencing, without pixels, and say how well the mirror keeps step
#[derive(clap::Args)]
#[command(after_help = "Example: praxi sim --scenario dropouts --seconds 60 --seed 7\n\n\
    A scenario is a TOML file: name = \"…\", and [[event]] tables of at_s (seconds) and do, as in\n    \
    do = \"start\" or do = { lose-frame-pulses = { count = 1 } }; hil-sim/scenarios holds examples.")]
pub(super) struct Args {
    /// A rig file, or reference, reference-180hz, high-viewer, tent
    #[arg(long, default_value = "reference")]
    rig: String,
    /// A motor file, or reference
    #[arg(long, default_value = REFERENCE_MOTOR)]
    motor: String,
    #[arg(long, default_value = PLAIN, help = format!("A file of commands and faults over time, or {}", Scenario::BUILT_IN.join(", ")))]
    scenario: String,
    /// Who leads, in place of what the scenario says: the projector's clock, the same by video whose frames have numbers, the mirror's sensors,
    /// or a drive that keeps its own speed while nothing measures the mirror
    #[arg(long, value_enum)]
    pacing: Option<Leader>,
    /// Simulated seconds
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true, default_value = "60")]
    seconds: f64,
    /// All noise follows from it
    #[arg(long, value_parser = seed, allow_negative_numbers = true, default_value_t = 1)]
    seed: u64,
    /// Be a controller that other programs talk to, in real time, until Ctrl-C or SIGTERM: the mirror spins up when it is told to, and events of a
    /// scenario happen
    #[arg(long, value_enum, conflicts_with = "seconds")]
    serve: Option<Serve>,
    #[arg(long, value_name = "N", requires = "serve", value_parser = clap::value_parser!(u32).range(300..=50_000_000))]
    #[arg(help = format!("Bits a second of a served serial line, {BAUD} by itself; ten are a byte"))]
    baud: Option<u32>,
    /// Where a served USB device is offered, 127.0.0.1:3240 by itself
    #[arg(long, value_name = "ADDRESS:PORT", requires = "serve")]
    listen: Option<SocketAddr>,
    /// The public key whose owner's firmware a served USB device takes; without one it takes none
    #[arg(long, value_name = "FILE", requires = "serve")]
    key: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// What a served controller looks like.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Serve {
    /// A USB device, by USB/IP
    Usb,
    /// A serial port: a pseudo-terminal
    Serial,
}

/// The ways to keep mirror and projector in step.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Leader {
    Frame,
    Video,
    Sensor,
    Fixed,
}

impl Leader {
    fn pacing(self) -> Pacing {
        match self {
            Self::Frame => Pacing::FrameLocked,
            Self::Video => Pacing::VideoLocked,
            Self::Sensor => Pacing::SensorLocked,
            Self::Fixed => Pacing::FixedSpeed,
        }
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "must be a number of seconds".to_string())?;
    if (0.001..=1e5).contains(&value) { Ok(value) } else { Err("must be from 0.001 to 100000 seconds".into()) }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rig = rigs::find(&args.rig)?;
    let motor = find_motor(&args.motor)?;
    let mut scenario = match Scenario::built_in(&args.scenario) {
        Some(scenario) => scenario,
        None => load(&args.scenario, &Scenario::BUILT_IN.join(", "), Scenario::from_toml)?,
    };
    scenario.pacing = args.pacing.map_or(scenario.pacing, Leader::pacing);
    let refused = |error: &dyn Display| Failure(format!("{} with motor {}: {error}", args.rig, args.motor));
    if let Some(serve) = args.serve {
        refuse_others(serve, args)?;
        // The plain scenario is a start.
        scenario.events.retain(|_| args.scenario != PLAIN);
        let simulator = Simulator::new(&rig, motor, scenario, args.seed).map_err(|error| refused(&error))?;
        return match serve {
            Serve::Usb => serve_usb::run(simulator, args),
            Serve::Serial => serve_serial(simulator, args),
        };
    }
    let latency = Nanos::from_seconds(rig.projector.frame_latency_us * 1e-6);
    let mut world =
        World::new(&rig.rotation(), latency, &motor, &scenario, args.seed).map_err(|error| refused(&error))?;
    keep_step(&mut world, args.seconds);
    let statistics = world.statistics();
    if args.json {
        let mut value = as_json(&statistics);
        value["fault_log"] = faults_as_json(&world.faults());
        say_json(&value);
    } else {
        say(as_text(&statistics, &world.faults()));
    }
    let verdict = &statistics.verdict;
    if verdict.is_clean() {
        return Ok(());
    }
    let first = verdict.first.as_deref().unwrap_or("a checker failed");
    let repeat = repeat_command(&args.rig, &args.motor, &args.scenario, args.seconds, args.seed);
    let pacing = args.pacing.and_then(|leader| clap::ValueEnum::to_possible_value(&leader));
    let pacing = pacing.map(|leader| format!(" --pacing {}", leader.get_name())).unwrap_or_default();
    Err(Failure(format!("{first}; repeat with: {repeat}{pacing}")))
}

/// What belongs to the other thing that can be served is not passed over in silence.
fn refuse_others(serve: Serve, args: &Args) -> Result<(), Failure> {
    let given = match serve {
        Serve::Serial => [("--listen", args.listen.is_some()), ("--key", args.key.is_some())],
        Serve::Usb => [("--baud", args.baud.is_some()), ("", false)],
    };
    let [this, other] = if matches!(serve, Serve::Usb) { ["usb", "serial"] } else { ["serial", "usb"] };
    match given.into_iter().find(|(_, is_given)| *is_given) {
        Some((name, _)) => {
            Err(Failure(format!("{name} has no meaning for --serve {this}: leave it out, or --serve {other}")))
        }
        None => Ok(()),
    }
}

#[cfg(unix)]
fn serve_serial(simulator: Simulator, args: &Args) -> Result<(), Failure> {
    serve_serial::serve(simulator, args.baud.unwrap_or(BAUD), args.json)
}

#[cfg(not(unix))]
fn serve_serial(_: Simulator, _: &Args) -> Result<(), Failure> {
    Err(Failure("--serve serial: this system has no pseudo-terminals: allowed is a UNIX".into()))
}

/// The motor of this name, or of this file.
pub(super) fn find_motor(name: &str) -> Result<Motor, Failure> {
    match name {
        REFERENCE_MOTOR => Ok(Motor::reference()),
        file => load(file, REFERENCE_MOTOR, Motor::from_toml),
    }
}

fn load<T, E: Display>(file: &str, names: &str, parse: impl Fn(&str) -> Result<T, E>) -> Result<T, Failure> {
    let text =
        input::read_text(Path::new(file)).map_err(|error| Failure(format!("{file}: {error}; built in: {names}")))?;
    parse(&text).map_err(|error| Failure(format!("{file}: {error}")))
}

/// Runs for `seconds` with two turns that take each other's place: a slot that comes back is at once full again.
fn keep_step(world: &mut World, seconds: f64) {
    const STEP_S: f64 = 0.1;
    let bar = progress("simulating (0.1 s)", (seconds / STEP_S).ceil() as u64);
    world.turn_ready(TurnHandle(0));
    world.turn_ready(TurnHandle(1));
    let mut left = seconds;
    while left > 1e-9 {
        world.advance_until(STEP_S.min(left), |_| false);
        left -= STEP_S;
        for turn in world.take_released() {
            world.turn_ready(turn);
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
}

/// Whether there were planes in step, whose place was known. The percentile is of bins and never 0 where it counts any.
fn is_judged(statistics: &LockStatistics) -> bool {
    statistics.locked_seconds > 0.0 && statistics.p99_slices > 0.0
}

/// The statistics with the time to lock, which is the first recovery's, and the planes on top.
pub(super) fn as_json(statistics: &LockStatistics) -> Value {
    let start = statistics.recoveries.first();
    let mut value = serde_json::to_value(statistics).expect("numbers and names");
    let more = json!({
        "time_to_lock_s": start.and_then(|start| start.settled_s),
        "time_to_lock_ratio": start.and_then(|start| start.ratio()),
        "planes_shown": statistics.verdict.lit,
        "planes_misplaced": statistics.verdict.misplaced,
        "planes_dark": statistics.dark,
    });
    if let (Some(value), Value::Object(more)) = (value.as_object_mut(), more) {
        if !is_judged(statistics) {
            // Without a plane in step there is no figure, and 0 would be a lie.
            for name in ["rms", "p99", "peak"].iter().flat_map(|name| [format!("{name}_slices"), format!("{name}_us")])
            {
                value.insert(name, Value::Null);
            }
        }
        value.extend(more);
    }
    value
}

/// What the controller would remember after a reset.
fn faults_as_json(faults: &Faults) -> Value {
    let counted = Fault::ALL.iter().filter(|fault| faults.count(**fault) > 0);
    json!({
        "latched": faults.latched,
        "counts": counted.map(|fault| (format!("{fault:?}"), json!(faults.count(*fault)))).collect::<serde_json::Map<_, _>>(),
        "last": { "at_s": faults.at_us as f64 * 1e-6, "cause": faults.cause().to_string() },
    })
}

fn faults_as_text(faults: &Faults) -> Vec<String> {
    let holds = |fault: &Fault| if faults.latched == Some(*fault) { ", and holds" } else { "" };
    let counted = Fault::ALL.iter().filter(|fault| faults.count(**fault) > 0);
    let mut lines: Vec<String> = counted
        .map(|fault| format!("fault {:<7} {} x {fault}{}", fault.code(), faults.count(*fault), holds(fault)))
        .collect();
    let cause = faults.cause().to_string();
    if !lines.is_empty() && !cause.is_empty() {
        lines.push(format!("last cause    {cause}, at {:.3} s", faults.at_us as f64 * 1e-6));
    }
    lines
}

fn as_text(statistics: &LockStatistics, faults: &Faults) -> String {
    let LockStatistics { rms_slices, p99_slices, peak_slices, rms_us, p99_us, peak_us, verdict, .. } = statistics;
    let locked = is_judged(statistics);
    let mut lines = vec![
        format!("simulated     {:.1} s, {:.1} s of it locked", statistics.seconds, statistics.locked_seconds),
        match locked {
            true => format!("phase error   RMS {rms_slices:.4}, p99 {p99_slices:.4}, peak {peak_slices:.4} slices"),
            false => "phase error   none: no plane in step".to_string(),
        },
        match locked {
            true => format!("              RMS {rms_us:.2}, p99 {p99_us:.2}, peak {peak_us:.2} us"),
            false => format!("              {} fault(s)", statistics.faults.len()),
        },
        format!("planes        {} shown, {} misplaced, {} dark", verdict.lit, verdict.misplaced, statistics.dark),
        format!(
            "checkers      {}: {} misplaced, {} forbidden, {} torn, {} disordered",
            if verdict.is_clean() { "passed" } else { "FAILED" },
            verdict.misplaced,
            verdict.forbidden,
            verdict.torn,
            verdict.disordered,
        ),
        format!("farthest      {:.3} slices from its place", verdict.farthest_slices),
    ];
    if statistics.states.iter().any(|(_, state)| *state == State::OpenLoop) {
        lines.push("not measured  errors are about a constant angle that nobody knows".to_string());
    }
    for recovery in &statistics.recoveries {
        let settled = recovery.settled_s.map_or("not in step".to_string(), |settled| {
            let ratio = recovery.ratio().filter(|_| recovery.torque_limited_s > 0.05);
            let ratio = ratio.map(|ratio| format!(", {ratio:.2} x the torque-limited time")).unwrap_or_default();
            format!("in step after {settled:.3} s{ratio}")
        });
        lines.push(format!("at {:>7.3} s  {}: {settled}", recovery.at_s, recovery.cause));
    }
    for (at, fault) in &statistics.faults {
        lines.push(format!("at {at:>7.3} s  fault: {fault}"));
    }
    lines.extend(faults_as_text(faults));
    lines.join("\n")
}
