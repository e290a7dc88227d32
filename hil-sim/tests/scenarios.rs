//! Every scenario that comes with the simulator, for many seeds and both directions: what it must come to, and what never may be.

use firmware::plane_store::TurnHandle;
use hil_sim::motor::Motor;
use hil_sim::scenario::Scenario;
use hil_sim::statistics::LockStatistics;
use hil_sim::world::World;
use protocol::timing::{Direction, Rotation};
use protocol::units::{Nanos, Turns};
use rayon::prelude::*;

const SEEDS: u64 = 100;

/// Two turns take each other's place, as `praxi sim` does it. Odd seeds turn clockwise.
fn run(scenario: &Scenario, seed: u64, seconds: f64) -> LockStatistics {
    let direction = if seed.is_multiple_of(2) { Direction::CounterClockwise } else { Direction::Clockwise };
    let rotation = Rotation::new(288, 24, 240_000_000, Turns::fraction(1, 9), direction).unwrap();
    let mut world = World::new(&rotation, Nanos(0), &Motor::reference(), scenario, seed).unwrap();
    world.turn_ready(TurnHandle(0));
    world.turn_ready(TurnHandle(1));
    while world.now().seconds() < seconds {
        world.advance(0.1);
        for turn in world.take_released() {
            world.turn_ready(turn);
        }
    }
    world.statistics()
}

#[test]
fn every_scenario_comes_to_what_it_must() {
    let mut broken = Vec::new();
    for name in Scenario::BUILT_IN {
        let scenario = Scenario::built_in(name).unwrap();
        let expect = scenario.expect.clone().unwrap_or_else(|| panic!("{name} expects nothing"));
        let runs: Vec<_> =
            (0..SEEDS).into_par_iter().map(|seed| (seed, run(&scenario, seed, expect.seconds))).collect();
        let (worst, far) = runs
            .iter()
            .map(|(seed, run)| (*seed, run.verdict.farthest_slices))
            .fold((0, 0.0), |worst, other| if other.1 > worst.1 { other } else { worst });
        let lost: Vec<String> = runs
            .iter()
            .filter_map(|(seed, run)| Some(format!("{name}, seed {seed}: {}", expect.broken_by(run)?)))
            .collect();
        println!("{name}: farthest {far:.4} slices (seed {worst}), {} of {SEEDS} broken", lost.len());
        broken.extend(lost.into_iter().take(3));
    }
    assert!(broken.is_empty(), "{broken:#?}");
}
