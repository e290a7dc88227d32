//! A drive that keeps the speed that it is told, such as a stepping motor's: the mirror hangs on a turning field as on a spring.
//!
//! The field turns exactly as told. The torque between field and mirror has the sine of their angle, as often a turn as there are pole
//! pairs, and damping: with all torque taken up the mirror slips by whole pole pairs, and the drive does not know.

use crate::motor::{PlantFigures, SpeedDriveFigures};

/// Field and command. Angles in radians counter-clockwise, unwrapped.
#[derive(Clone, Debug)]
pub struct SpeedDrive {
    torque_max: f64,
    pole_pairs: f64,
    damping_s: f64,
    speed: f64,
    field: f64,
}

impl SpeedDrive {
    /// Switched off.
    pub fn new(plant: &PlantFigures, figures: &SpeedDriveFigures) -> Self {
        let pole_pairs = f64::from(figures.pole_pairs);
        // About no load: inertia, and a stiffness of torque times pole pairs.
        let natural_rad_s = (plant.max_torque_nm * pole_pairs / plant.inertia_kg_m2).sqrt();
        Self {
            torque_max: plant.max_torque_nm,
            pole_pairs,
            damping_s: 2.0 * figures.damping / natural_rad_s,
            speed: 0.0,
            field: 0.0,
        }
    }

    /// Turns the field by `speed`, rad/s, from now on; 0 switches it off. The field begins where the mirror is, at `mirror`.
    pub fn command(&mut self, speed: f64, mirror: f64) {
        if self.speed == 0.0 {
            self.field = mirror;
        }
        self.speed = speed;
    }

    /// The torque on a mirror at `angle` with `speed`, N m, in the `seconds` to come, over which the field turns on.
    pub fn torque(&mut self, seconds: f64, angle: f64, speed: f64) -> f64 {
        if self.speed == 0.0 {
            return 0.0;
        }
        let ahead = self.field - angle;
        self.field += self.speed * seconds;
        let damped = self.pole_pairs * self.damping_s * (self.speed - speed);
        self.torque_max * ((self.pole_pairs * ahead).sin() + damped).clamp(-1.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motor::Motor;
    use crate::plant::Plant;

    /// After a ramp to 100 rad/s, with `load_nm` on it for a second: by how much the mirror is behind the field, in pole pairs.
    fn behind(load_nm: f64) -> f64 {
        let motor = Motor::reference();
        let mut plant = Plant::new(&motor.plant, 3);
        let mut drive = SpeedDrive::new(&motor.plant, &motor.speed_drive);
        for tick in 0..40_000 {
            drive.command((f64::from(tick + 1) * 0.005).min(100.0), plant.angle());
            plant.set_load(if (24_000..28_000).contains(&tick) { load_nm } else { 0.0 });
            let torque = drive.torque(2.5e-4, plant.angle(), plant.speed());
            plant.set_command(torque);
            plant.advance(2.5e-4);
        }
        (drive.field - plant.angle()) * drive.pole_pairs / std::f64::consts::TAU
    }

    #[test]
    fn a_light_hand_is_held_against_and_a_heavy_one_costs_whole_steps() {
        assert!(behind(-0.1).abs() < 0.1, "{}", behind(-0.1));
        let lost = behind(-0.6);
        assert!(lost > 1.0 && (lost - lost.round()).abs() < 0.1, "{lost}");
    }
}
