//! The lock's figures on the reference motor and on motors that differ by half, with all noise: the worst of 200 seeds.

use firmware::plane_store::TurnHandle;
use hil_sim::motor::Motor;
use hil_sim::scenario::{Action, PlantScale, Scenario};
use hil_sim::statistics::LockStatistics;
use hil_sim::world::{World, repeat_command};
use protocol::message::State;
use protocol::timing::{Direction, Rotation};
use protocol::units::{Nanos, Turns};
use rayon::prelude::*;

const SEEDS: u64 = 200;
/// Inertia and friction as shares of what the controller was told.
const SHARES: [f64; 3] = [0.5, 1.0, 1.5];

/// A scenario on a rig, run for `seconds` by every seed.
struct Case {
    rig: &'static str,
    refresh_hz: u64,
    scenario: Scenario,
    motor: Motor,
    seconds: f64,
}

type Runs = Vec<(u64, LockStatistics)>;

impl Case {
    fn new(scenario: Scenario, seconds: f64) -> Self {
        Self { rig: "reference", refresh_hz: 240, scenario, motor: Motor::reference(), seconds }
    }

    fn at_180_hz(self) -> Self {
        Self { rig: "reference-180hz", refresh_hz: 180, ..self }
    }

    fn run(&self) -> Runs {
        let rotation =
            Rotation::new(288, 24, self.refresh_hz * 1_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap();
        let run = |seed: u64| {
            let mut world = World::new(&rotation, Nanos(0), &self.motor, &self.scenario, seed).unwrap();
            world.turn_ready(TurnHandle(0));
            world.advance(self.seconds);
            (seed, world.statistics())
        };
        let runs: Runs = (0..SEEDS).into_par_iter().map(run).collect();
        for (seed, run) in &runs {
            let clean = run.verdict.is_clean() && run.faults.is_empty();
            assert!(clean, "{run:?}; {}", self.repeat(*seed));
        }
        runs
    }

    fn repeat(&self, seed: u64) -> String {
        let PlantScale { inertia, friction } = self.scenario.plant;
        let command = repeat_command(self.rig, "reference", &self.scenario.name, self.seconds, seed);
        format!("inertia {inertia}, friction {friction}: {command}")
    }

    /// Prints the worst seed and holds it to `limit`.
    fn hold(&self, runs: &Runs, what: &str, limit: f64, figure: impl Fn(&LockStatistics) -> f64) {
        let (seed, worst) =
            runs.iter().map(|(seed, run)| (*seed, figure(run))).max_by(|a, b| a.1.total_cmp(&b.1)).expect("seeds");
        println!("{what}: {worst:.4} of {limit}; {}", self.repeat(seed));
        assert!(worst <= limit, "{what}: {worst} exceeds {limit}; {}", self.repeat(seed));
    }
}

fn ratio(run: &LockStatistics, recovery: usize) -> f64 {
    run.recoveries[recovery].ratio().unwrap_or(f64::INFINITY)
}

/// After the start at 0.05 s, `action` at 3 s; like a file of that name, which is how a run is repeated.
fn disturbed(name: &str, action: Action) -> Scenario {
    Scenario { name: name.to_owned(), ..Scenario::default() }.with(3.0, action)
}

fn plants() -> impl Iterator<Item = PlantScale> {
    SHARES.into_iter().flat_map(|inertia| SHARES.map(|friction| PlantScale { inertia, friction }))
}

fn a_minute(case: &Case) {
    let runs = case.run();
    case.hold(&runs, "RMS, slices", 0.005, |run| run.rms_slices);
    case.hold(&runs, "peak, slices", PEAK_SLICES, |run| run.peak_slices);
    case.hold(&runs, "start, x the torque-limited time", 1.15, |run| ratio(run, 0));
    case.hold(&runs, "seconds until locked", 2.5, |run| run.seconds - run.locked_seconds);
}

#[test]
fn a_minute_at_240_hz() {
    a_minute(&Case::new(Scenario::default(), 62.0));
}

#[test]
fn a_minute_at_180_hz() {
    a_minute(&Case::new(Scenario::default(), 62.0).at_180_hz());
}

/// No retuning.
#[test]
fn motors_that_differ_by_half() {
    for plant in plants() {
        let case = Case::new(Scenario { plant, ..Scenario::default() }, 6.0);
        let runs = case.run();
        case.hold(&runs, "RMS, slices", 0.005, |run| run.rms_slices);
        case.hold(&runs, "peak, slices", PEAK_SLICES, |run| run.peak_slices);
        case.hold(&runs, "start, x the torque-limited time", 1.15, |run| ratio(run, 0));
    }
}

#[test]
fn rate_steps_are_followed_in_time() {
    for plant in plants() {
        let limit = if plant == PlantScale::default() { 1.25 } else { 1.35 };
        // Full torque takes half the inertia from 240 to 200 Hz in 0.1 s, and places pass 0.025 s apart: 1.35 x is **not met** there.
        let short = if plant.inertia < 1.0 { 1.5 } else { 1.25 };
        let step = |hz| Scenario { plant, ..disturbed("rate-step", Action::ProjectorRate { hz }) };
        for (case, limit) in [
            (Case::new(step(180.0), 4.5), limit),
            (Case::new(step(240.0), 4.5).at_180_hz(), limit),
            (Case::new(step(200.0), 4.5), short),
        ] {
            let runs = case.run();
            case.hold(&runs, "rate step, x the torque-limited time", limit, |run| ratio(run, 1));
            // Clean means that each slice is lit at its own azimuth: the picture has not turned.
            assert!(runs.iter().all(|(_, run)| {
                run.states.last().is_some_and(|&(at_s, state)| state == State::Locked && at_s > 3.0)
            }));
        }
    }
}

#[test]
fn silence_is_bridged() {
    for (seconds, limit) in [(1.0, 0.05), (9.9, 0.4)] {
        for action in
            [Action::NoFramePulses { seconds }, Action::NoIndexPulses { seconds }, Action::EncoderFrozen { seconds }]
        {
            let case = Case::new(disturbed("dropouts", action), 4.0 + seconds);
            let runs = case.run();
            case.hold(&runs, &format!("{action:?}, lit, slices"), limit, |run| run.recoveries[1].peak_slices);
        }
    }
}

#[test]
fn single_pulses_are_hardly_felt() {
    for action in [
        Action::LoseFramePulses { count: 1 },
        Action::ExtraFramePulse,
        Action::LosePlanePulses { count: 1 },
        Action::ExtraPlanePulse,
        Action::LoseIndexPulses { count: 1 },
        Action::ExtraIndexPulse,
    ] {
        let case = Case::new(disturbed("pulses", action), 4.0);
        let runs = case.run();
        case.hold(&runs, &format!("{action:?}, lit, slices"), 0.02, |run| run.recoveries[1].peak_slices);
    }
}

/// Counts that slip and loads that come at once cannot be told apart at first, and are dark before they are half a slice.
#[test]
fn slips_and_loads_go_dark_in_time() {
    for (action, limit) in [
        (Action::EncoderSlip { counts: 1 }, 0.2),
        (Action::EncoderSlip { counts: -1 }, 0.2),
        (Action::EncoderSlip { counts: 7 }, 0.02),
        (Action::Load { torque_nm: -0.045 }, 0.5),
        (Action::Load { torque_nm: -0.09 }, 0.5),
        (Action::Load { torque_nm: -0.18 }, 0.5),
    ] {
        let case = Case::new(disturbed("hand", action), 4.5);
        let runs = case.run();
        case.hold(&runs, &format!("{action:?}, lit, slices"), limit, |run| run.recoveries[1].peak_slices);
        case.hold(&runs, "seconds until in step", 1.2, |run| run.recoveries[1].settled_s.unwrap_or(f64::INFINITY));
    }
}

/// Its covariance had lost its digits, and planes were lit 0.6 slices off.
#[test]
fn a_start_that_once_failed() {
    let rotation = Rotation::new(288, 24, 240_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap();
    let second = Scenario::built_in("second-motor").unwrap();
    let mut world = World::new(&rotation, Nanos(0), &Motor::reference(), &second, 763).unwrap();
    world.turn_ready(TurnHandle(0));
    world.advance(6.0);
    let run = world.statistics();
    assert!(run.peak_slices < 0.015 && run.verdict.is_clean(), "{run:?}");
}

/// A projector whose pulses scatter by 20 us, and whose controller knows.
#[test]
fn noisy_pulses_are_averaged() {
    let mut case = Case::new(Scenario::default(), 6.0);
    case.motor.projector_clock.frame_jitter_us = 20.0;
    let runs = case.run();
    case.hold(&runs, "RMS, slices", 0.03, |run| run.rms_slices);
    case.hold(&runs, "peak, slices", 0.1, |run| run.peak_slices);
}

const PEAK_SLICES: f64 = 0.015;
