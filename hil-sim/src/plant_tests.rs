use super::*;
use crate::motor::Motor;

fn bare() -> PlantFigures {
    let mut figures = Motor::reference().plant;
    figures.coulomb_friction_nm = 0.0;
    figures.air_drag_nm_s2 = 0.0;
    figures.torque_ripple.share = 0.0;
    figures.cogging.clear();
    figures.once_per_turn_nm = 0.0;
    figures
}

fn run(plant: &mut Plant, seconds: f64) {
    for _ in 0..(seconds / 250e-6).round() as usize {
        plant.advance(250e-6);
    }
}

#[test]
fn viscous_run_out_is_an_exponential() {
    let figures = bare();
    let mut plant = Plant::new(&figures, 1);
    plant.speed = 100.0;
    let start = plant.angle();
    run(&mut plant, 5.0);
    let time_constant = figures.inertia_kg_m2 / figures.viscous_friction_nm_s;
    let decay = (-5.0 / time_constant).exp();
    assert!((plant.speed() - 100.0 * decay).abs() < 1e-9);
    assert!((plant.angle() - start - 100.0 * time_constant * (1.0 - decay)).abs() < 1e-8);
}

#[test]
fn coulomb_friction_stops_the_mirror_and_holds_it() {
    let mut figures = bare();
    figures.viscous_friction_nm_s = 0.0;
    figures.coulomb_friction_nm = 0.03;
    let mut plant = Plant::new(&figures, 1);
    plant.speed = 10.0;
    let start = plant.angle();
    run(&mut plant, 2.0);
    assert_eq!(plant.speed(), 0.0);
    // speed² / 2a; the step in which it stops is as coarse as the step.
    assert!((plant.angle() - start - 100.0 / (2.0 * 0.03 / 0.0045)).abs() < 1e-5);
    plant.set_command(0.029);
    run(&mut plant, 1.0);
    assert_eq!(plant.speed(), 0.0);
    plant.set_command(0.031);
    run(&mut plant, 1.0);
    assert!(plant.speed() > 0.2);
}

#[test]
fn the_torque_loop_is_of_first_order_and_limited() {
    let mut plant = Plant::new(&bare(), 1);
    plant.set_command(9.0);
    run(&mut plant, 0.001);
    let expected = 0.45 * (1.0 - (-0.001 * TAU * 300.0f64).exp());
    assert!((plant.torque - expected).abs() < 1e-12);
}

#[test]
fn a_finer_step_changes_nothing_that_matters() {
    let figures = Motor::reference().plant;
    let (mut coarse, mut fine) = (Plant::new(&figures, 3), Plant::new(&figures, 3));
    for plant in [&mut coarse, &mut fine] {
        plant.speed = 125.66;
        plant.set_command(0.09);
    }
    for _ in 0..4_000 {
        coarse.advance(250e-6);
        for _ in 0..10 {
            fine.advance(25e-6);
        }
    }
    // A hundred-thousandth of a slice is 2e-7 rad.
    assert!((coarse.angle() - fine.angle()).abs() < 2e-7, "{}", coarse.angle() - fine.angle());
}

#[test]
fn the_motion_within_a_step_is_known() {
    let mut plant = Plant::new(&Motor::reference().plant, 5);
    plant.speed = 90.0;
    let mut fine = plant.clone();
    let stretch = plant.advance(250e-6);
    fine.advance(100e-6);
    assert!((stretch.angle(100e-6) - fine.angle()).abs() < 1e-9);
    assert!((stretch.time_of(fine.angle()) - 100e-6).abs() < 1e-10);
}

#[test]
fn full_torque_without_friction_takes_inertia_times_speed_over_torque() {
    let mut figures = bare();
    figures.viscous_friction_nm_s = 0.0;
    let plant = Plant::new(&figures, 1);
    assert!((plant.torque_limited_seconds(100.0) - 0.0045 * 100.0 / 0.45).abs() < 1e-9);
    let reference = Plant::new(&Motor::reference().plant, 1);
    assert_eq!(reference.torque_limited_seconds(1e4), f64::INFINITY);
}

#[test]
fn a_supply_that_sagged_comes_back_whole() {
    let mut plant = Plant::new(&Motor::reference().plant, 1);
    let limited = plant.torque_limited_seconds(100.0);
    plant.limit_torque(0.5);
    assert!(plant.torque_limited_seconds(100.0) > 1.9 * limited);
    plant.limit_torque(1.0);
    assert_eq!(plant.torque_limited_seconds(100.0), limited);
}
