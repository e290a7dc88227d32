use super::*;
use crate::config::tests::example;
use proptest::prelude::*;
use protocol::timing::Direction;

const TICK: Nanos = Nanos(250_000);

/// Everything as it should be, in step.
fn well() -> Conditions {
    Conditions {
        speeds_rad_s: [125.0; 2],
        torque_share: 0.2,
        moving: true,
        encoder_silent: false,
        turns_since_index: 0.5,
        clock_known: true,
        frames_missing: 0,
        contradicted: false,
        model_impossible: false,
        tracking: true,
        error_slices: 0.0,
        rate_slices_s: 0.0,
        sigma_slices: 0.003,
        scatter_slices: 0.004,
        pacing: Pacing::FrameLocked,
    }
}

struct Bench {
    safety: Safety,
    now: Nanos,
}

impl Bench {
    fn new() -> Self {
        let mut limits = example(288, 240, Direction::Clockwise).limits;
        limits.speed_max_rad_s = 180.0;
        Self { safety: Safety::new(limits, FaultLog::default()), now: Nanos::ZERO }
    }

    fn locked() -> Self {
        let mut bench = Self::new();
        bench.safety.command(bench.now, Command::Start, true);
        bench.run(0.12, well());
        assert_eq!(bench.safety.state(), State::Locked);
        bench
    }

    fn run(&mut self, seconds: f64, conditions: Conditions) {
        let until = self.now + Nanos::from_seconds(seconds);
        while self.now < until {
            self.now = self.now + TICK;
            self.safety.tick(self.now, &conditions);
        }
    }
}

#[test]
fn the_way_to_the_lock() {
    let mut bench = Bench::new();
    bench.run(0.1, well());
    assert_eq!(bench.safety.state(), State::Idle);
    bench.safety.command(bench.now, Command::Start, true);
    assert_eq!(bench.safety.state(), State::SpinUp);
    bench.run(1.0, Conditions { tracking: false, error_slices: 5.0, ..well() });
    assert_eq!(bench.safety.state(), State::SpinUp);
    bench.run(1.0, Conditions { error_slices: 0.1, ..well() });
    assert_eq!(bench.safety.state(), State::Acquire);
    assert!(!bench.safety.may_light());
    bench.run(0.12, well());
    assert_eq!(bench.safety.state(), State::Locked);
    assert!(bench.safety.may_light());
}

/// Nothing measures the mirror: the state says so, and there is no model to hold over by.
#[test]
fn an_open_loop_is_lit_while_frames_come() {
    let open = Conditions { pacing: Pacing::FixedSpeed, ..well() };
    let mut bench = Bench::new();
    bench.safety.command(bench.now, Command::Start, true);
    bench.run(0.12, open);
    assert_eq!((bench.safety.state(), bench.safety.may_light()), (State::OpenLoop, true));
    bench.run(0.1, Conditions { frames_missing: 1, ..open });
    assert_eq!(bench.safety.state(), State::OpenLoop);
    bench.run(0.0005, Conditions { frames_missing: 2, ..open });
    assert_eq!((bench.safety.state(), bench.safety.may_light()), (State::Acquire, false));
    bench.run(0.12, open);
    assert_eq!(bench.safety.state(), State::OpenLoop);
    bench.run(0.0005, Conditions { tracking: false, ..open });
    assert_eq!((bench.safety.state(), bench.safety.may_light()), (State::Acquire, false));
}

/// A mirror that was pushed is dark, and where the display follows it not out of step.
#[test]
fn a_mirror_that_is_followed_is_not_out_of_step_when_it_is_pushed() {
    for (pacing, state) in [(Pacing::FrameLocked, State::Acquire), (Pacing::SensorLocked, State::Locked)] {
        let mut bench = Bench::locked();
        bench.run(0.0005, Conditions { pacing, error_slices: 0.3, ..well() });
        assert_eq!((bench.safety.state(), bench.safety.may_light()), (state, false));
    }
}

#[test]
fn missing_pulses_are_held_over_and_then_a_fault() {
    let silent = |conditions: Conditions, fault| {
        let mut bench = Bench::locked();
        bench.run(9.0, conditions);
        assert_eq!((bench.safety.state(), bench.safety.may_light()), (State::Holdover, true));
        bench.run(2.0, conditions);
        assert_eq!((bench.safety.state(), bench.safety.fault()), (State::Fault, Some(fault)));
    };
    silent(Conditions { frames_missing: 3, ..well() }, Fault::ProjectorLost);
    silent(Conditions { encoder_silent: true, ..well() }, Fault::SensorLost);
    silent(Conditions { turns_since_index: 3.0, ..well() }, Fault::SensorLost);
    let mut bench = Bench::locked();
    bench.run(1.0, Conditions { frames_missing: 9, ..well() });
    bench.run(0.1, well());
    assert_eq!(bench.safety.state(), State::Locked);
}

#[test]
fn an_estimate_that_is_too_vague_is_dark() {
    let mut bench = Bench::locked();
    bench.run(0.1, Conditions { frames_missing: 900, sigma_slices: 0.14, ..well() });
    assert_eq!((bench.safety.state(), bench.safety.may_light()), (State::Holdover, false));
}

#[test]
fn a_doubt_within_a_turn_is_dark_for_a_turn() {
    let mut bench = Bench::locked();
    let vague = Conditions { sigma_slices: 0.14, ..well() };
    // Good near the index and vague elsewhere, turn after turn of 50 ms.
    for _ in 0..10 {
        bench.run(0.03, vague);
        bench.run(0.02, well());
        assert!(!bench.safety.may_light());
    }
    bench.run(0.04, well());
    assert_eq!((bench.safety.state(), bench.safety.may_light()), (State::Locked, true));
    bench.run(2.9, vague);
    assert_eq!((bench.safety.state(), bench.safety.may_light()), (State::Locked, false));
    bench.run(0.2, vague);
    assert_eq!(bench.safety.state(), State::Acquire);
}

#[test]
fn a_count_that_contradicts_is_dark_at_once_and_for_a_turn() {
    let mut bench = Bench::locked();
    bench.run(1.0, well());
    assert!(bench.safety.may_light());
    bench.run(250e-6, Conditions { contradicted: true, ..well() });
    assert_eq!((bench.safety.state(), bench.safety.may_light()), (State::Locked, false));
    bench.run(0.045, well());
    assert!(!bench.safety.may_light());
    bench.run(0.01, well());
    assert!(bench.safety.may_light());
}

#[test]
fn who_is_sure_locks_after_a_turn_and_who_is_less_so_later() {
    let locks_after = |conditions: Conditions| {
        let mut bench = Bench::new();
        bench.safety.command(bench.now, Command::Start, true);
        (0..1_000).find(|_| {
            bench.run(1e-3, conditions);
            bench.safety.state() == State::Locked
        })
    };
    let ms = |sigma_slices, error_slices| locks_after(Conditions { sigma_slices, error_slices, ..well() }).unwrap();
    // A turn takes 50 ms.
    assert!((50..54).contains(&ms(0.003, 0.005)));
    assert!((300..304).contains(&ms(0.004, 0.0)));
    assert!((300..304).contains(&ms(0.003, 0.008)));
    assert_eq!(locks_after(Conditions { error_slices: 0.03, ..well() }), None);
}

#[test]
fn a_model_of_no_motor_never_locks() {
    let mut bench = Bench::new();
    bench.safety.command(bench.now, Command::Start, true);
    bench.run(1.0, Conditions { model_impossible: true, ..well() });
    assert_eq!(bench.safety.state(), State::Acquire);
}

#[test]
fn faults_have_their_causes() {
    let fault_of = |seconds, conditions| {
        let mut bench = Bench::locked();
        bench.run(seconds, conditions);
        bench.safety.fault()
    };
    assert_eq!(fault_of(0.1, Conditions { speeds_rad_s: [125.0, 190.0], ..well() }), Some(Fault::Overspeed));
    assert_eq!(fault_of(0.1, Conditions { speeds_rad_s: [-190.0, 0.0], ..well() }), Some(Fault::Overspeed));
    assert_eq!(fault_of(1.1, Conditions { moving: false, torque_share: 0.9, ..well() }), Some(Fault::Stall));
    let blind = Conditions { encoder_silent: true, turns_since_index: 3.0, ..well() };
    assert_eq!(fault_of(0.001, blind), Some(Fault::SensorLost));
    let lost = Conditions { tracking: false, error_slices: 30.0, ..well() };
    assert_eq!(fault_of(14.0, lost), None);
    assert_eq!(fault_of(16.0, lost), Some(Fault::LockTimeout));
}

#[test]
fn a_fault_is_latched_with_its_first_cause() {
    let mut bench = Bench::locked();
    bench.safety.levels(bench.now, Levels { emergency_stop: true, guard_open: false });
    bench.safety.levels(bench.now, Levels { emergency_stop: false, guard_open: true });
    assert_eq!(bench.safety.fault(), Some(Fault::EmergencyStop));
    for command in [Command::Start, Command::Stop, Command::ClearFault] {
        bench.safety.command(bench.now, command, true);
        assert_eq!(bench.safety.state(), State::Fault);
    }
    bench.safety.levels(bench.now, Levels::default());
    bench.run(1.0, well());
    assert_eq!(bench.safety.state(), State::Fault);
    bench.safety.command(bench.now, Command::ClearFault, true);
    assert_eq!((bench.safety.state(), bench.safety.fault()), (State::Idle, None));
}

#[test]
fn a_fault_tells_what_was_measured_and_what_is_allowed() {
    let cause_of = |seconds, conditions| {
        let mut bench = Bench::locked();
        bench.run(seconds, conditions);
        let faults = bench.safety.log().faults();
        assert_eq!(faults.latched.map(|fault| faults.count(fault)), Some(1));
        (faults.quantity, faults.value_micro, faults.limit_micro)
    };
    let fast = Conditions { speeds_rad_s: [125.0, -190.0], ..well() };
    assert_eq!(cause_of(0.1, fast), (Quantity::Speed, 190_000_000, 180_000_000));
    let stalled = Conditions { moving: false, torque_share: 0.9, ..well() };
    assert_eq!(cause_of(1.1, stalled), (Quantity::Time, 1_000_250, 1_000_000));
    let blind = Conditions { encoder_silent: true, turns_since_index: 3.0, ..well() };
    assert_eq!(cause_of(0.001, blind), (Quantity::Turns, 3_000_000, 2_500_000));
    let (quantity, value, limit) = cause_of(11.0, Conditions { frames_missing: 3, ..well() });
    assert!(quantity == Quantity::Time && value > limit && limit == 10_000_000);
}

#[test]
fn service_needs_a_parked_mirror_and_ends() {
    let service = Command::Service { slice: 3, duration_ms: 4_000_000_000 };
    let parked = Conditions { moving: false, ..Conditions::default() };
    let mut bench = Bench::new();
    bench.safety.command(bench.now, service, false);
    assert_eq!(bench.safety.state(), State::Idle);
    bench.safety.command(bench.now, service, true);
    bench.run(59.9, parked);
    assert_eq!((bench.safety.state(), bench.safety.may_light()), (State::Service, true));
    bench.run(0.2, parked);
    assert_eq!(bench.safety.state(), State::Idle);
    bench.safety.command(bench.now, service, true);
    bench.run(0.001, Conditions { moving: true, ..parked });
    assert_eq!(bench.safety.state(), State::Idle);
}

fn conditions() -> impl Strategy<Value = Conditions> {
    let flags = (any::<bool>(), any::<bool>(), any::<bool>(), any::<bool>());
    let figures = (-300.0f32..300.0, -1.0f32..1.0, 0.0f32..5.0, 0u32..5, -0.5f32..0.5, 0.0f32..0.2);
    (flags, figures).prop_map(|((moving, encoder_silent, clock_known, tracking), figures)| Conditions {
        speeds_rad_s: [figures.0; 2],
        torque_share: figures.1,
        moving,
        encoder_silent,
        turns_since_index: figures.2,
        clock_known,
        frames_missing: figures.3,
        contradicted: false,
        model_impossible: false,
        tracking,
        error_slices: figures.4,
        rate_slices_s: figures.4 * 10.0,
        sigma_slices: figures.5,
        scatter_slices: figures.5,
        pacing: Pacing::FrameLocked,
    })
}

proptest! {
    #[test]
    fn light_and_torque_only_where_they_are_allowed(
        steps in prop::collection::vec((conditions(), 0u8..8, 1u32..400), 1..60),
    ) {
        let mut bench = Bench::new();
        for (conditions, event, ticks) in steps {
            match event {
                0 => bench.safety.command(bench.now, Command::Start, !conditions.moving),
                1 => bench.safety.command(bench.now, Command::Stop, !conditions.moving),
                2 => bench.safety.command(bench.now, Command::ClearFault, !conditions.moving),
                3 => bench.safety.command(bench.now, Command::Service { slice: 0, duration_ms: 50 }, !conditions.moving),
                4 => bench.safety.levels(bench.now, Levels { emergency_stop: true, guard_open: false }),
                5 => bench.safety.levels(bench.now, Levels::default()),
                _ => bench.run(f64::from(ticks) * 250e-6, conditions),
            }
            let state = bench.safety.state();
            prop_assert!(!bench.safety.may_light() || state.may_light());
            prop_assert_eq!(bench.safety.fault().is_some(), state == State::Fault);
            prop_assert!(!bench.safety.may_drive() || !matches!(state, State::Idle | State::Fault | State::Service));
        }
    }
}
