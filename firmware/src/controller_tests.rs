use super::*;
use crate::config::tests::example;
use crate::pacing::Pacing;
use proptest::prelude::*;
use protocol::units::Turns;
use std::vec;

#[test]
fn an_impossible_configuration_makes_no_controller() {
    let mut config = example(288, 240, Direction::Clockwise);
    config.motor.torque_max_nm = -1.0;
    assert!(Controller::new(config).is_err());
}

#[test]
fn a_stop_takes_torque_and_light_at_once() {
    let mut controller = Controller::new(example(288, 240, Direction::CounterClockwise)).unwrap();
    let mut now = 0;
    for frame in 0..20_u64 {
        controller.step(Nanos(frame * 4_166_667), Input::FramePulse { at: Nanos(frame * 4_166_667) });
        now = frame * 4_166_667;
    }
    controller.step(Nanos(now), Input::Command(Command::Start));
    controller.step(Nanos(now + 1_000), Input::Tick { encoder_count: 0 });
    let output = controller.step(Nanos(now + 251_000), Input::Tick { encoder_count: 0 });
    assert_eq!(output.state, State::SpinUp);
    assert!(output.torque_nm > 0.4);
    let pressed = Levels { emergency_stop: true, guard_open: false };
    let output = controller.step(Nanos(now + 252_000), Input::Levels(pressed));
    assert_eq!((output.torque_nm, output.light, output.state), (0.0, false, State::Fault));
    assert_eq!(output.fault, Some(Fault::EmergencyStop));
}

#[test]
fn ticks_that_stop_are_noticed_by_whatever_comes_next() {
    let mut controller = Controller::new(example(288, 240, Direction::CounterClockwise)).unwrap();
    controller.step(Nanos(0), Input::Tick { encoder_count: 0 });
    controller.step(Nanos(1), Input::Command(Command::Start));
    let output = controller.step(Nanos(20_000_000), Input::FramePulse { at: Nanos(20_000_000) });
    assert_eq!(output.fault, Some(Fault::Watchdog));
}

/// The watchdog would take 5 ms, and has nothing to say of a parked mirror.
#[test]
fn light_goes_out_when_two_ticks_are_missing_and_comes_back_with_them() {
    let mut controller = Controller::new(example(288, 240, Direction::CounterClockwise)).unwrap();
    controller.step(Nanos(0), Input::Tick { encoder_count: 0 });
    let service = Command::Service { slice: 0, duration_ms: 1_000 };
    assert!(controller.step(Nanos(1), Input::Command(service)).light);
    for (at, light) in [(500_000, true), (500_001, false)] {
        assert_eq!(controller.step(Nanos(at), Input::PlanePulse { at: Nanos(at) }).light, light);
    }
    assert!(controller.step(Nanos(600_000), Input::Tick { encoder_count: 0 }).light);
}

#[test]
fn a_fault_survives_a_reset_and_falls_to_a_command_alone() {
    let config = example(288, 240, Direction::CounterClockwise);
    let mut controller = Controller::new(config).unwrap();
    controller.step(Nanos(0), Input::Levels(Levels { emergency_stop: true, guard_open: false }));
    for at in 1..5 {
        let log = FaultLog::from_bytes(&controller.faults().to_bytes());
        controller = Controller::after_reset(config, log).unwrap();
        let output = controller.step(Nanos(at), Input::Command(Command::Start));
        assert_eq!((output.state, output.fault), (State::Fault, Some(Fault::EmergencyStop)));
    }
    let output = controller.step(Nanos(9), Input::Command(Command::ClearFault));
    assert_eq!((output.state, output.fault), (State::Idle, None));
    assert_eq!(controller.faults().faults().count(Fault::EmergencyStop), 1);
}

fn pacing() -> impl Strategy<Value = Pacing> {
    prop::sample::select(&[Pacing::FrameLocked, Pacing::SensorLocked, Pacing::FixedSpeed][..])
}

/// Any input, most of them plausible enough to reach deep states.
fn input() -> impl Strategy<Value = (u64, Input)> {
    let wait = prop_oneof![6 => Just(250_000u64), 2 => 0u64..300_000, 1 => 0u64..10_000_000_000];
    let input = prop_oneof![
        12 => (-30i32..60).prop_map(|counts| Input::Tick { encoder_count: counts as u32 }),
        1 => any::<u32>().prop_map(|encoder_count| Input::Tick { encoder_count }),
        4 => any::<u64>().prop_map(|at| Input::FramePulse { at: Nanos(at) }),
        4 => any::<u64>().prop_map(|at| Input::IndexPulse { at: Nanos(at) }),
        4 => any::<u64>().prop_map(|at| Input::PlanePulse { at: Nanos(at) }),
        2 => Just(Input::Command(Command::Start)),
        1 => Just(Input::Command(Command::ClearFault)),
        1 => any::<i32>().prop_map(|shift| Input::Command(Command::ShiftPhase { shift })),
        1 => (any::<u16>(), any::<u32>())
            .prop_map(|(slice, duration_ms)| Input::Command(Command::Service { slice, duration_ms })),
        2 => (0u8..4).prop_map(|turn| Input::TurnReady(TurnHandle(turn))),
        1 => prop::bool::weighted(0.2)
            .prop_map(|emergency_stop| Input::Levels(Levels { emergency_stop, guard_open: false })),
    ];
    (wait, input)
}

fn holds(controller: &Controller, output: &Output) -> Result<(), TestCaseError> {
    let limit = controller.config().motor.torque_max_nm;
    prop_assert!(output.torque_nm.is_finite() && output.torque_nm.abs() <= limit);
    prop_assert!(!output.light || output.state.may_light());
    prop_assert!(output.torque_nm == 0.0 || !matches!(output.state, State::Idle | State::Fault | State::Service));
    let config = controller.config();
    let speed_max = if config.pacing == Pacing::FixedSpeed { config.limits.speed_max_rad_s } else { 0.0 };
    prop_assert!(output.speed_rad_s.abs() <= speed_max && (output.speed_rad_s == 0.0 || output.state.may_drive()));
    prop_assert!(output.trigger.is_none() || config.pacing == Pacing::SensorLocked);
    if let Some(Trigger { plane_ns, .. }) = output.trigger {
        prop_assert!(plane_ns > 0.0 && plane_ns.is_finite() && output.armed.is_some());
    }
    if !output.state.may_light() {
        prop_assert!(matches!(output.armed, None | Some(Frame::Dark)));
    }
    let estimates = controller.estimates();
    prop_assert!(estimates.speed_rad_s.is_finite() && estimates.phase_error_slices.is_finite());
    Ok(())
}

proptest! {
    /// Whatever happens, and whenever the controller is reset: a fault that held is there until a command has cleared it.
    #[test]
    fn resets_at_any_moment_keep_the_latch(inputs in prop::collection::vec((input(), any::<bool>()), 1..200)) {
        let config = example(288, 240, Direction::CounterClockwise);
        let mut controller = Controller::new(config).unwrap();
        let (mut now, mut held) = (0u64, None);
        for ((wait, input), reset) in inputs {
            if reset {
                let log = FaultLog::from_bytes(&controller.faults().to_bytes());
                controller = Controller::after_reset(config, log).unwrap();
            }
            now += wait;
            let output = controller.step(Nanos(now), input);
            prop_assert_eq!(output.fault.is_some(), output.state == State::Fault);
            if held.is_some() && output.fault != held {
                prop_assert_eq!(input, Input::Command(Command::ClearFault));
                prop_assert_eq!(output.state, State::Idle);
            }
            held = output.fault;
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn anything_may_come_in_any_order(
        frames in 1u32..=170, clockwise: bool, pacing in pacing(), inputs in prop::collection::vec(input(), 1..400),
    ) {
        let direction = if clockwise { Direction::Clockwise } else { Direction::CounterClockwise };
        let config = Config { pacing, ..example(24 * frames, 240, direction) };
        let mut controller = Controller::new(config).unwrap();
        let (mut now, mut count) = (0u64, 0u32);
        for (wait, input) in inputs {
            now += wait;
            // Stamps near now, and now and then anywhere.
            let near = |at: u64| if at.is_multiple_of(16) { at } else { now.saturating_sub(at % 5_000) };
            let input = match input {
                Input::Tick { encoder_count } => {
                    count = count.wrapping_add(encoder_count);
                    Input::Tick { encoder_count: count }
                }
                Input::FramePulse { at } => Input::FramePulse { at: Nanos(near(at.0)) },
                Input::IndexPulse { at } => Input::IndexPulse { at: Nanos(near(at.0)) },
                Input::PlanePulse { at } => Input::PlanePulse { at: Nanos(near(at.0)) },
                other => other,
            };
            let output = controller.step(Nanos(now), input);
            holds(&controller, &output)?;
        }
    }

    /// A rig that turns as it should, with pulses lost and added at random: deep in the locked states.
    #[test]
    fn a_turning_mirror_with_wild_pulses(seed: u64, wild in 0u32..40, phase: u32, pacing in pacing()) {
        let config = Config { pacing, ..example(288, 240, Direction::CounterClockwise) };
        let mut controller = Controller::new(config).unwrap();
        let mut random = seed;
        let mut lit = 0;
        let mut roll = |sides: u32| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((random >> 33) as u32) % sides
        };
        controller.step(Nanos(0), Input::TurnReady(TurnHandle(0)));
        for tick in 0..12_000u64 {
            let now = tick * 250_000;
            if tick == 400 {
                controller.step(Nanos(now), Input::Command(Command::Start));
            }
            // Twenty turns a second: an index every 200 ticks, a frame every 16 2/3.
            if tick % 200 == 3 && roll(1_000) >= wild {
                controller.step(Nanos(now), Input::IndexPulse { at: Nanos(now) });
            }
            if (tick * 3) % 50 < 3 && roll(1_000) >= wild {
                let at = tick * 3 / 50 * 50 * 250_000 / 3;
                controller.step(Nanos(now), Input::FramePulse { at: Nanos(at.min(now)) });
            }
            if roll(10_000) < wild {
                controller.step(Nanos(now), Input::FramePulse { at: Nanos(now) });
                controller.step(Nanos(now), Input::IndexPulse { at: Nanos(now) });
            }
            let encoder_count = ((Turns(phase).turns() * 2_000.0) as u64 + tick * 10) as u32;
            let output = controller.step(Nanos(now), Input::Tick { encoder_count });
            holds(&controller, &output)?;
            lit += u32::from(output.light);
        }
        prop_assert!(wild > 0 || lit < 12_000);
    }
}
