use super::*;
use crate::scenario::Action;
use crate::world::Core;
use firmware::controller::{Estimates, Input, Output};
use protocol::timing::Direction;
use protocol::units::Turns;

fn rotation() -> Rotation {
    Rotation::new(288, 24, 240_000_000, Turns::ZERO, Direction::Clockwise).unwrap()
}

fn still() -> Scenario {
    Scenario { events: Vec::new(), ..Scenario::default() }
}

fn motor(inertia: f64, friction: f64, ripple: f64) -> Motor {
    let mut motor = Motor::reference();
    motor.plant.inertia_kg_m2 *= inertia;
    motor.plant.coulomb_friction_nm *= friction;
    motor.plant.viscous_friction_nm_s *= friction;
    motor.plant.air_drag_nm_s2 *= friction;
    motor.plant.torque_ripple.share *= ripple;
    motor.plant.cogging.iter_mut().for_each(|cogging| cogging.torque_nm *= ripple);
    motor
}

/// By how many standard deviations `found` is off, or `share` of the truth where that is more.
fn is_off(found: identify::Estimate, truth: f64, share: f64) -> f64 {
    (found.value - truth).abs() / found.sigma.max(share * truth)
}

#[test]
fn motors_are_told_apart() {
    let motors = [(1.0, 1.0, 1.0), (0.3, 1.0, 1.0), (3.0, 0.5, 1.0), (5.0, 1.0, 2.0), (1.0, 2.0, 0.0), (0.5, 1.5, 3.0)];
    for (seed, (inertia, friction, ripple)) in (0..).zip(motors) {
        let truth = motor(inertia, friction, ripple);
        let recording = record(&rotation(), &truth, &still(), seed);
        let found = identify(&told(&truth), &recording).unwrap();
        let plant = &truth.plant;
        for (name, off) in [
            ("inertia", is_off(found.inertia_kg_m2, plant.inertia_kg_m2, 1e-3)),
            ("coulomb", is_off(found.coulomb_friction_nm, plant.coulomb_friction_nm, 3e-3)),
            ("viscous", is_off(found.viscous_friction_nm_s, plant.viscous_friction_nm_s, 0.02)),
            ("drag", is_off(found.air_drag_nm_s2, plant.air_drag_nm_s2, 0.02)),
            ("delay", is_off(found.command_delay_s, 5e-4, 0.05)),
            ("imbalance", is_off(found.once_per_turn_nm, 0.01, 0.02)),
            ("eccentricity", is_off(found.eccentricity_rad, 0.05f64.to_radians(), 0.02)),
        ] {
            assert!(off < 4.0, "{inertia} {friction} {ripple}: {name} off by {off}: {found:?}");
        }
        assert!(found.inertia_kg_m2.sigma < 0.01 * plant.inertia_kg_m2);
        let mut harmonics: Vec<(u32, bool)> =
            found.harmonics.iter().map(|harmonic| (harmonic.per_turn, harmonic.of_torque)).collect();
        harmonics.sort();
        let there: &[(u32, bool)] = if ripple > 0.0 { &[(6, true), (12, false), (24, false)] } else { &[] };
        assert_eq!(harmonics, there, "{inertia} {friction} {ripple}");
    }
}

#[test]
fn a_tuned_motor_locks_and_its_gains_have_margins() {
    for (seed, (inertia, friction)) in (3..).zip([(0.3, 1.5), (1.0, 1.0), (5.0, 0.5)]) {
        let truth = motor(inertia, friction, 1.0);
        // The sheet is wrong in all that is identified, and the delay is twice that of the sheet.
        let sheet = Motor::reference();
        let mut slow = truth.clone();
        slow.plant.command_delay_us = 1_000.0;
        let recording = record(&rotation(), &slow, &still(), seed);
        let tuned = tune(&rotation(), &sheet, &recording).unwrap();
        assert!((tuned.motor.plant.command_delay_us - 1_000.0).abs() < 250.0, "{:?}", tuned.identified);
        assert!(tuned.margins.phase_deg > 15.0 && tuned.margins.gain_up_db > 6.0, "{:?}", tuned.margins);
        let statistics = prove(&rotation(), Nanos::ZERO, &slow, &tuned, seed).unwrap();
        assert!(statistics.rms_slices < 0.006 && statistics.peak_slices < 0.03, "{inertia}: {statistics:?}");
        assert!(statistics.recoveries[0].ratio().unwrap() < 1.15, "{inertia}: {statistics:?}");
    }
}

/// An experiment whose encoder counts the other way.
struct Reversed(Experiment);

impl Core for Reversed {
    fn step(&mut self, now: Nanos, input: Input) -> Output {
        self.0.step(
            now,
            match input {
                Input::Tick { encoder_count } => Input::Tick { encoder_count: encoder_count.wrapping_neg() },
                other => other,
            },
        )
    }

    fn estimates(&self) -> Estimates {
        self.0.estimates()
    }
}

#[test]
fn motors_that_cannot_be_identified_are_refused_with_what_to_check() {
    let refused = |truth: &Motor, scenario: &Scenario| {
        let recording = record(&rotation(), truth, scenario, 1);
        tune(&rotation(), truth, &recording).unwrap_err().to_string()
    };
    let truth = Motor::reference();
    let blocked = refused(&motor(1.0, 20.0, 1.0), &still());
    assert!(blocked.contains("did not move under 0.45 N m: check the drive"), "{blocked}");
    let dead = refused(&truth, &still().with(0.0, Action::EncoderFrozen { seconds: 100.0 }));
    assert!(dead.contains("encoder counted nothing: check"), "{dead}");
    let blind = refused(&truth, &still().with(0.0, Action::NoIndexPulses { seconds: 100.0 }));
    assert!(blind.contains("the index never came: check"), "{blind}");

    let (experiment, recording) = Experiment::new(told(&truth), &rotation());
    let core = Box::new(Reversed(experiment));
    World::with_core(&rotation(), Nanos::ZERO, &truth, &still(), 1, core).advance(5.0);
    let recording = recording.lock().unwrap().clone();
    let reversed = tune(&rotation(), &truth, &recording).unwrap_err().to_string();
    assert!(reversed.contains("swap its A and B"), "{reversed}");
    assert!(recording.torques_nm.iter().fold(0.0f64, |most, torque| most.max(*torque)) < 0.3, "it went on pushing");
}
