use super::*;
use crate::config::tests::example;
use protocol::timing::Direction;

const TICK_NS: u64 = 250_000;

/// A drive that does as told, and a clock without noise.
struct Bench {
    command: SpeedCommand,
    now: Nanos,
    /// Frames since the start, of the clock and of the told mirror, in turns.
    clock: f64,
    mirror: f64,
    hz: f64,
}

impl Bench {
    fn new() -> Self {
        let command = SpeedCommand::new(&example(288, 240, Direction::Clockwise));
        Self { command, now: Nanos::ZERO, clock: 0.123, mirror: 0.0, hz: 20.0 }
    }

    fn reference(&self) -> Reference {
        Reference { angle: Turns::from_turns(self.clock), speed: (self.hz * core::f64::consts::TAU) as f32 }
    }

    fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * 4e3) as usize {
            let before = self.command.speed();
            let speed = self.command.tick(self.now, Some(self.reference()));
            assert!((speed - before).abs() <= 30.0 * 2.5e-4 + 2e-5);
            self.mirror += f64::from(speed) * 2.5e-4 / core::f64::consts::TAU;
            self.clock += self.hz * 2.5e-4;
            self.now = self.now + Nanos(TICK_NS);
        }
    }

    /// Where the picture is on the mirror, in turns from an arbitrary place, 0 ≤ result < 1.
    fn picture(&self) -> f64 {
        (self.mirror - self.clock - f64::from(self.command.slot()) / 12.0).rem_euclid(1.0)
    }
}

fn apart(a: f64, b: f64) -> f64 {
    (a - b - (a - b).round()).abs()
}

#[test]
fn it_ramps_settles_and_does_not_drift() {
    let mut bench = Bench::new();
    bench.run(4.0);
    assert!(!bench.command.is_at_speed());
    bench.run(2.0);
    assert!(bench.command.is_at_speed() && bench.command.is_settled(bench.now));
    let start = bench.picture();
    bench.run(600.0);
    // A thousandth of a slice after ten minutes; the speed in single precision alone would be off by a slice.
    assert!(apart(bench.picture(), start) < 1e-3 / 288.0, "{}", apart(bench.picture(), start));
    let last_tick = bench.mirror - 20.0 * 2.5e-4;
    assert!(apart(bench.command.angle().turns(), last_tick) < 1e-6);
}

#[test]
fn the_picture_stays_where_it_is_when_the_rate_steps() {
    let mut bench = Bench::new();
    bench.run(6.0);
    let start = bench.picture();
    for hz in [15.0, 20.0, 20.003, 23.7] {
        bench.hz = hz;
        bench.run(1e-3);
        assert_eq!(bench.command.is_settled(bench.now), hz == 20.003);
        bench.run(6.0);
        assert!(bench.command.is_settled(bench.now));
        assert!(apart(bench.picture(), start) < 0.01 / 288.0, "{hz}: {}", apart(bench.picture(), start) * 288.0);
    }
}

#[test]
fn a_picture_is_turned_at_the_start_of_a_turn_and_by_as_much() {
    for shift in [0.3, -0.01, 0.5, 1.0 / 12.0] {
        let mut bench = Bench::new();
        bench.run(6.0);
        let start = bench.picture();
        bench.command.shift(Turns::from_turns(shift));
        let dark: [bool; 4] = [11, 0, 1, 2].map(|next| bench.command.turns_picture(next));
        assert_eq!(dark, [false, true, false, false]);
        assert!(!bench.command.is_settled(bench.now));
        bench.run(3.0);
        assert!(bench.command.is_settled(bench.now));
        assert!(apart(bench.picture(), start + shift) < 0.01 / 288.0, "{shift}");
    }
}

#[test]
fn without_a_clock_the_speed_stays_and_without_a_state_there_is_none() {
    let mut bench = Bench::new();
    bench.run(6.0);
    let speed = bench.command.speed();
    assert_eq!(bench.command.tick(bench.now, None), speed);
    assert!(!bench.command.is_settled(bench.now));
    bench.command.release();
    assert_eq!((bench.command.speed(), bench.command.is_at_speed()), (0.0, false));
    assert!(bench.command.has_driven());
}
