//! A motor with its sensors and the projector's clock, as described by a file in `motors/`.

use crate::check::{Range, ValueError};
use firmware::config::{self, ClockFigures, Config, Gains, Limits, MotorFigures, SensorFigures};
use firmware::pacing::Pacing;
use protocol::rig::toml_problem;
use protocol::timing::Rotation;
use protocol::units::Nanos;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use thiserror::Error;

/// Everything about a motor that the simulator knows and the firmware mostly does not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// For people.
    pub name: String,
    /// What turns, and what turns it.
    pub plant: PlantFigures,
    /// What sees it turn.
    pub sensors: Sensors,
    /// The projector's clock.
    pub projector_clock: ProjectorClock,
    /// The control timer.
    pub controller: ControlTimer,
    /// The same motor behind a drive that keeps its own speed.
    #[serde(default)]
    pub speed_drive: SpeedDriveFigures,
}

/// Mechanics and drive. Torques in N m, speeds in rad/s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantFigures {
    /// Moment of inertia.
    pub inertia_kg_m2: f64,
    /// Torque per speed.
    pub viscous_friction_nm_s: f64,
    /// Torque against the motion, and what holds a standing mirror.
    pub coulomb_friction_nm: f64,
    /// Torque per speed squared.
    pub air_drag_nm_s2: f64,
    /// The drive gives no more.
    pub max_torque_nm: f64,
    /// First order, from command to torque.
    pub torque_loop_bandwidth_hz: f64,
    /// Before the torque loop.
    pub command_delay_us: f64,
    /// Of the commanded torque.
    #[serde(default)]
    pub torque_ripple: Ripple,
    /// Independent of the commanded torque.
    #[serde(default)]
    pub cogging: Vec<Cogging>,
    /// Imbalance with the axis off vertical.
    #[serde(default)]
    pub once_per_turn_nm: f64,
}

/// A share of the commanded torque that comes and goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ripple {
    /// Amplitude, as a share of the commanded torque.
    pub share: f64,
    /// Periods a turn.
    pub per_turn: u32,
}

/// One harmonic of the torque that magnets exert on iron.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cogging {
    /// Amplitude.
    pub torque_nm: f64,
    /// Periods a turn.
    pub per_turn: u32,
}

/// Encoder and index.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensors {
    /// Edges after quadrature decoding.
    pub encoder_counts_per_turn: u32,
    /// Systematic, once per turn, of unknown phase.
    pub encoder_eccentricity_deg: f64,
    /// Standard deviation, per edge.
    pub encoder_edge_noise_deg: f64,
    /// Standard deviation.
    pub index_jitter_us: f64,
}

/// The free clock that everything follows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProjectorClock {
    /// Constant, unknown to the firmware.
    pub error_ppm: f64,
    /// Random walk of the rate: standard deviation after one second.
    pub wander_ppm_per_sqrt_s: f64,
    /// Standard deviation of a frame pulse about the light that it announces.
    pub frame_jitter_us: f64,
}

/// The control timer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlTimer {
    /// Torque commands a second.
    pub rate_hz: f64,
    /// Natural frequency of the loop; without it the firmware's own.
    #[serde(default = "default_bandwidth_hz")]
    pub bandwidth_hz: f64,
    /// The loop's damping ratio; without it the firmware's own.
    #[serde(default = "default_damping")]
    pub damping: f64,
}

/// A drive that keeps the speed that it is told, with the plant's torque.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpeedDriveFigures {
    /// How often a turn its field pulls in the same way; a stepping motor of 200 steps has 50.
    pub pole_pairs: u32,
    /// Of the mirror's swinging about its field, as a damping ratio.
    pub damping: f64,
    /// By how much the controller changes its speed at most.
    pub acceleration_rad_s2: f64,
    /// When the mirror has stopped swinging.
    pub settle_s: f64,
}

impl Default for SpeedDriveFigures {
    /// A stepping motor's, whose drive damps it.
    fn default() -> Self {
        Self { pole_pairs: 50, damping: 0.3, acceleration_rad_s2: 30.0, settle_s: 0.5 }
    }
}

fn default_bandwidth_hz() -> f64 {
    f64::from(Gains::default().bandwidth_rad_s) / TAU
}

fn default_damping() -> f64 {
    f64::from(Gains::default().damping)
}

/// Why a motor file is refused.
#[derive(Debug, Error)]
pub enum MotorError {
    /// Not TOML, or keys missing, unknown or of the wrong kind: line, key, and the parser's words.
    #[error("{0}")]
    Syntax(String),
    /// An impossible value.
    #[error("{0}")]
    Value(#[from] ValueError),
}

impl Motor {
    /// The reference motor, `motors/reference.toml`.
    pub fn reference() -> Self {
        Self::from_toml(include_str!("../motors/reference.toml")).expect("a file of this crate, tested below")
    }

    /// Reads and checks a motor file.
    pub fn from_toml(text: &str) -> Result<Self, MotorError> {
        let motor: Self = toml::from_str(text).map_err(|error| MotorError::Syntax(toml_problem(text, &error)))?;
        motor.check()?;
        Ok(motor)
    }

    /// A file that [`Motor::from_toml`] reads.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("numbers and names in tables")
    }

    fn check(&self) -> Result<(), ValueError> {
        let (plant, sensors, clock) = (&self.plant, &self.sensors, &self.projector_clock);
        let positive = Range { least: 1e-9, most: 1e6 };
        let natural = Range { least: 0.0, most: 1e6 };
        for (key, value, range) in [
            ("plant.inertia_kg_m2", plant.inertia_kg_m2, positive),
            ("plant.viscous_friction_nm_s", plant.viscous_friction_nm_s, natural),
            ("plant.coulomb_friction_nm", plant.coulomb_friction_nm, natural),
            ("plant.air_drag_nm_s2", plant.air_drag_nm_s2, natural),
            ("plant.max_torque_nm", plant.max_torque_nm, positive),
            ("plant.torque_loop_bandwidth_hz", plant.torque_loop_bandwidth_hz, Range { least: 10.0, most: 1e5 }),
            ("plant.command_delay_us", plant.command_delay_us, Range { least: 0.0, most: 1e4 }),
            ("plant.torque_ripple.share", plant.torque_ripple.share, Range { least: 0.0, most: 1.0 }),
            ("plant.once_per_turn_nm", plant.once_per_turn_nm, natural),
            (
                "sensors.encoder_counts_per_turn",
                f64::from(sensors.encoder_counts_per_turn),
                Range { least: 16.0, most: 1e7 },
            ),
            ("sensors.encoder_eccentricity_deg", sensors.encoder_eccentricity_deg, Range { least: 0.0, most: 10.0 }),
            // Noisier edges would pass each other.
            (
                "sensors.encoder_edge_noise_deg",
                sensors.encoder_edge_noise_deg,
                Range { least: 0.0, most: 36.0 / f64::from(sensors.encoder_counts_per_turn) },
            ),
            ("sensors.index_jitter_us", sensors.index_jitter_us, Range { least: 0.0, most: 1e3 }),
            ("projector_clock.error_ppm", clock.error_ppm, Range { least: -1e4, most: 1e4 }),
            ("projector_clock.wander_ppm_per_sqrt_s", clock.wander_ppm_per_sqrt_s, Range { least: 0.0, most: 1e3 }),
            ("projector_clock.frame_jitter_us", clock.frame_jitter_us, Range { least: 0.0, most: 100.0 }),
            ("controller.rate_hz", self.controller.rate_hz, Range { least: 500.0, most: 1e5 }),
            ("controller.bandwidth_hz", self.controller.bandwidth_hz, Range { least: 0.1, most: 1e3 }),
            ("controller.damping", self.controller.damping, Range { least: 0.1, most: 10.0 }),
            ("speed_drive.pole_pairs", f64::from(self.speed_drive.pole_pairs), Range { least: 1.0, most: 1e3 }),
            ("speed_drive.damping", self.speed_drive.damping, Range { least: 0.0, most: 10.0 }),
            ("speed_drive.acceleration_rad_s2", self.speed_drive.acceleration_rad_s2, Range { least: 1e-3, most: 1e5 }),
            ("speed_drive.settle_s", self.speed_drive.settle_s, Range { least: 0.0, most: 60.0 }),
        ] {
            range.check(key, value)?;
        }
        for cogging in &plant.cogging {
            natural.check("plant.cogging.torque_nm", cogging.torque_nm)?;
            Range { least: 1.0, most: 1e3 }.check("plant.cogging.per_turn", f64::from(cogging.per_turn))?;
        }
        natural.check("plant.torque_ripple.per_turn", f64::from(plant.torque_ripple.per_turn))
    }

    /// What a controller for this motor is told: the figures of a data sheet, no phase, no clock error, no scale of a scenario.
    pub fn firmware_config(&self, rotation: &Rotation, frame_latency: Nanos) -> Config {
        let (plant, sensors) = (&self.plant, &self.sensors);
        let mut config = Config {
            rotation: *rotation,
            pacing: Pacing::default(),
            control_rate_hz: self.controller.rate_hz as f32,
            motor: MotorFigures {
                inertia_kg_m2: plant.inertia_kg_m2 as f32,
                torque_max_nm: plant.max_torque_nm as f32,
                coulomb_friction_nm: plant.coulomb_friction_nm as f32,
                viscous_friction_nm_s: plant.viscous_friction_nm_s as f32,
                air_drag_nm_s2: plant.air_drag_nm_s2 as f32,
                command_delay: Nanos((plant.command_delay_us * 1e3) as u64),
                torque_bandwidth_hz: plant.torque_loop_bandwidth_hz as f32,
            },
            gains: Gains {
                bandwidth_rad_s: (self.controller.bandwidth_hz * TAU) as f32,
                damping: self.controller.damping as f32,
            },
            sensors: SensorFigures {
                encoder_counts_per_turn: sensors.encoder_counts_per_turn,
                encoder_edge_noise_rad: sensors.encoder_edge_noise_deg.to_radians() as f32,
                index_jitter_s: (sensors.index_jitter_us * 1e-6) as f32,
            },
            clock: ClockFigures {
                frame_latency,
                frame_jitter_ns: (self.projector_clock.frame_jitter_us * 1e3) as f32,
                wander_ppm_per_sqrt_s: self.projector_clock.wander_ppm_per_sqrt_s as f32,
            },
            speed_drive: config::SpeedDriveFigures {
                acceleration_rad_s2: self.speed_drive.acceleration_rad_s2 as f32,
                settle: Nanos::from_seconds(self.speed_drive.settle_s),
            },
            limits: Limits {
                speed_max_rad_s: 0.0,
                holdover: Nanos(10_000_000_000),
                lock: Nanos(15_000_000_000),
                watchdog: Nanos(5_000_000),
            },
        };
        // A rig's mirror must bear a third more than its nominal speed: 180 Hz rigs are driven at 240 Hz.
        config.limits.speed_max_rad_s = 1.5 * config.nominal_speed_rad_s();
        config
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::timing::Direction;
    use protocol::units::Turns;

    const REFERENCE: &str = include_str!("../motors/reference.toml");

    #[test]
    fn the_reference_motor_loads() {
        let motor = Motor::reference();
        assert_eq!(motor.plant.cogging[1], Cogging { torque_nm: 0.004, per_turn: 24 });
        assert_eq!(motor.controller.rate_hz, 4_000.0);
        assert_eq!(Motor::from_toml(&motor.to_toml()).unwrap(), motor);
        let rotation = Rotation::new(288, 24, 240_000_000, Turns::ZERO, Direction::Clockwise).unwrap();
        assert_eq!(motor.firmware_config(&rotation, Nanos::ZERO).gains, Gains::default());
    }

    #[test]
    fn bad_files_are_refused_with_the_key() {
        for (from, to, told) in [
            ("inertia_kg_m2 = 0.0045", "inertia_kg_m2 = 0.0", "plant.inertia_kg_m2 = 0: must be from"),
            ("inertia_kg_m2 = 0.0045", "inertia_kg_m2 = nan", "plant.inertia_kg_m2 = NaN"),
            ("max_torque_nm = 0.45", "max_torque_nm = inf", "plant.max_torque_nm = inf"),
            ("index_jitter_us", "index_jitter_ms", "index_jitter_ms"),
            ("rate_hz = 4000.0", "rate_hz = -1.0", "controller.rate_hz = -1"),
            ("rate_hz = 4000.0", "", "rate_hz"),
        ] {
            assert!(REFERENCE.contains(from));
            let message = Motor::from_toml(&REFERENCE.replace(from, to)).unwrap_err().to_string();
            assert!(message.contains(told), "{message}");
        }
    }
}
