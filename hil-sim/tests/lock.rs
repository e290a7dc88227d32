//! The lock's figures on the reference motor, with all noise: 20 seeds, a minute each, at both ends of the range.

use firmware::plane_store::TurnHandle;
use hil_sim::motor::Motor;
use hil_sim::scenario::{PlantScale, Scenario};
use hil_sim::statistics::LockStatistics;
use hil_sim::world::World;
use protocol::timing::{Direction, Rotation};
use protocol::units::{Nanos, Turns};
use rayon::prelude::*;

const SEEDS: u64 = 20;

fn run(refresh_hz: u64, scenario: &Scenario, seed: u64, seconds: f64) -> LockStatistics {
    let rotation = Rotation::new(288, 24, refresh_hz * 1_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap();
    let mut world = World::new(&rotation, Nanos(0), &Motor::reference(), scenario, seed).unwrap();
    world.turn_ready(TurnHandle(0));
    world.advance(seconds);
    world.statistics()
}

fn check(refresh_hz: u64, scenario: &Scenario, seconds: f64, rms: f64, peak: f64, spin_up: f64) {
    let failures: Vec<String> = (0..SEEDS)
        .into_par_iter()
        .filter_map(|seed| {
            let statistics = run(refresh_hz, scenario, seed, seconds);
            let ratio = statistics.recoveries[0].ratio().unwrap_or(f64::INFINITY);
            let good = statistics.rms_slices <= rms
                && statistics.peak_slices <= peak
                && ratio <= spin_up
                && statistics.verdict.is_clean()
                && statistics.faults.is_empty()
                && statistics.locked_seconds > seconds - 4.0;
            (!good).then(|| {
                format!(
                    "rms {:.4} peak {:.4} ratio {ratio:.3} {:?}; repeat: praxi sim --rig reference --motor reference \
                     --scenario plain --seconds {seconds} --seed {seed}  ({refresh_hz} Hz)",
                    statistics.rms_slices, statistics.peak_slices, statistics.verdict
                )
            })
        })
        .collect();
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn a_minute_at_180_hz() {
    check(180, &Scenario::default(), 62.0, 0.03, 0.1, 1.15);
}

#[test]
fn a_minute_at_240_hz() {
    check(240, &Scenario::default(), 62.0, 0.03, 0.1, 1.15);
}

/// Half the inertia and half as much friction again, or half of it: the same figures without retuning.
#[test]
fn a_second_motor() {
    for friction in [0.5, 1.5] {
        let scenario = Scenario { plant: PlantScale { inertia: 0.5, friction }, ..Scenario::default() };
        check(240, &scenario, 12.0, 0.03, 0.1, 1.15);
    }
}
