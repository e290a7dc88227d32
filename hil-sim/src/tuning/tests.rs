use super::*;
use crate::scenario::Action;
use protocol::timing::Direction;
use protocol::units::Turns;

fn rotation() -> Rotation {
    Rotation::new(288, 24, 240_000_000, Turns::ZERO, Direction::Clockwise).unwrap()
}

fn still() -> Scenario {
    Scenario { events: Vec::new(), ..Scenario::default() }
}

#[test]
fn motors_are_told_apart() {
    for (seed, (inertia, friction, ripple)) in (0..).zip([
        (1.0, 1.0, 1.0),
        (0.3, 1.0, 1.0),
        (3.0, 0.5, 1.0),
        (5.0, 1.0, 2.0),
        (1.0, 2.0, 0.0),
        (0.5, 1.5, 3.0),
    ]) {
        let mut truth = Motor::reference();
        truth.plant.inertia_kg_m2 *= inertia;
        truth.plant.coulomb_friction_nm *= friction;
        truth.plant.viscous_friction_nm_s *= friction;
        truth.plant.air_drag_nm_s2 *= friction;
        truth.plant.torque_ripple.share *= ripple;
        truth.plant.cogging.iter_mut().for_each(|cogging| cogging.torque_nm *= ripple);
        let recording = record(&rotation(), &truth, &still(), seed);
        let found = identify(&told(&truth), &recording).unwrap();
        println!("{inertia} {friction} {ripple}: {found:#?}");
    }
}
