//! What the controller is told about its rig. Rough motor figures do: inertia and friction are identified during spin-up.

use crate::pacing::Pacing;
use protocol::timing::Rotation;
use protocol::units::Nanos;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Rough figures of motor and drive. Inertia may be wrong by a factor of two, friction by half.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MotorFigures {
    /// Moment of inertia of everything that turns, kg m².
    pub inertia_kg_m2: f32,
    /// The largest torque that may be commanded, N m.
    pub torque_max_nm: f32,
    /// Friction at low speed, N m.
    pub coulomb_friction_nm: f32,
    /// Friction per speed, N m s.
    pub viscous_friction_nm_s: f32,
    /// Drag per speed squared, N m s².
    pub air_drag_nm_s2: f32,
    /// From a torque command to the start of its effect.
    pub command_delay: Nanos,
    /// First-order bandwidth of the torque loop, Hz.
    pub torque_bandwidth_hz: f32,
}

/// How the loop answers a phase error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gains {
    /// Natural frequency of the feedback on phase and speed, rad/s.
    pub bandwidth_rad_s: f32,
    /// Its damping ratio.
    pub damping: f32,
}

impl Default for Gains {
    /// Six hertz: slow against the millisecond of delay, and fast against what the model leaves out.
    ///
    /// In step undisturbed, more is a little better: over 200 seeds of 6 s the reference motor keeps 0.0030 slices RMS and 0.0116 peak
    /// with 15 Hz, and 0.0035 and 0.0120 with 6; the phase margin at the drive grows from 11° to 16° (`praxi lock-chart`). But with 15 Hz a
    /// load of a tenth of the torque is not made good in 1.5 s with one seed in 200 (146, `cargo test -p hil-sim --test lock slips`), and
    /// `a_tuned_motor_locks_and_its_gains_have_margins` finds no lock on the light motor with twice the delay.
    fn default() -> Self {
        Self { bandwidth_rad_s: 38.0, damping: 0.9 }
    }
}

/// Figures of the mirror's sensors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorFigures {
    /// Encoder counts a turn, after quadrature decoding.
    pub encoder_counts_per_turn: u32,
    /// Standard deviation of an encoder edge, radians.
    pub encoder_edge_noise_rad: f32,
    /// Standard deviation of the index pulse, seconds.
    pub index_jitter_s: f32,
}

/// Figures of the projector's clock as its frame pulses show it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClockFigures {
    /// From a frame pulse to the first plane of its frame.
    pub frame_latency: Nanos,
    /// Standard deviation of a frame pulse, nanoseconds.
    pub frame_jitter_ns: f32,
    /// Random walk of the rate: standard deviation after one second, parts per million.
    pub wander_ppm_per_sqrt_s: f32,
}

/// A drive that keeps the speed that it is told, of a mirror that nothing measures: for [`Pacing::FixedSpeed`] alone.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpeedDriveFigures {
    /// Its speed is changed by no more than this, rad/s². It must follow it with all that it turns, or steps are lost and nobody knows.
    pub acceleration_rad_s2: f32,
    /// So long after its speed has been reached the mirror has stopped swinging about it.
    pub settle: Nanos,
}

/// Where safety steps in.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// The mirror must never turn faster, rad/s.
    pub speed_max_rad_s: f32,
    /// How long missing pulses are bridged before the fault.
    pub holdover: Nanos,
    /// How long reaching or regaining the lock may take.
    pub lock: Nanos,
    /// The longest time between two control ticks.
    pub watchdog: Nanos,
}

/// All of it. Check with [`Config::checked`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Config {
    /// Slices, frames and direction.
    pub rotation: Rotation,
    /// Who leads.
    pub pacing: Pacing,
    /// Control ticks a second.
    pub control_rate_hz: f32,
    /// The motor.
    pub motor: MotorFigures,
    /// The loop.
    pub gains: Gains,
    /// Its sensors.
    pub sensors: SensorFigures,
    /// The projector's clock.
    pub clock: ClockFigures,
    /// The drive that keeps its own speed, if there is one.
    pub speed_drive: SpeedDriveFigures,
    /// Safety.
    pub limits: Limits,
}

/// Why a configuration is refused.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum ConfigError {
    /// See the message.
    #[error("{key} = {value}: must be from {least} to {most}")]
    OutOfRange {
        /// The field.
        key: &'static str,
        /// What it held.
        value: f32,
        /// The smallest value allowed.
        least: f32,
        /// The largest value allowed.
        most: f32,
    },
    /// See the message.
    #[error(
        "control_rate_hz = {control_rate_hz}: must be at least 2.5 x the frame rate of {frame_rate_hz} Hz to arm each frame in time"
    )]
    ControlTooSlow {
        /// Control ticks a second.
        control_rate_hz: f32,
        /// The rig's frames a second.
        frame_rate_hz: f32,
    },
    /// See the message.
    #[error("speed_max_rad_s = {speed_max_rad_s}: the rig turns at {speed_rad_s} rad/s")]
    SpeedLimitBelowRig {
        /// The limit.
        speed_max_rad_s: f32,
        /// What slices and refresh ask for.
        speed_rad_s: f32,
    },
    /// See the message.
    #[error(
        "frame_latency = {latency_ns} ns: a projector that follows the mirror or shows video must begin a frame within half of its {frame_ns} ns"
    )]
    LatencyTooLong {
        /// From a trigger or a frame pulse to the first plane.
        latency_ns: u64,
        /// A frame at the rig's rate.
        frame_ns: u64,
    },
}

impl Config {
    /// The speed that the nominal frame rate asks for, rad/s.
    pub fn nominal_speed_rad_s(&self) -> f32 {
        core::f32::consts::TAU * self.nominal_frame_rate_hz() / self.rotation.frames() as f32
    }

    /// The nominal frame rate, Hz.
    pub fn nominal_frame_rate_hz(&self) -> f32 {
        self.rotation.refresh_microhertz() as f32 * 1e-6
    }

    /// The width of a slice, radians.
    pub fn slice_rad(&self) -> f32 {
        core::f32::consts::TAU / self.rotation.slices() as f32
    }

    /// The width of a frame, radians.
    pub fn frame_rad(&self) -> f32 {
        core::f32::consts::TAU / self.rotation.frames() as f32
    }

    /// `self`, if every figure is finite and possible.
    pub fn checked(self) -> Result<Self, ConfigError> {
        let (motor, sensors, clock) = (&self.motor, &self.sensors, &self.clock);
        for (key, value, least, most) in [
            ("control_rate_hz", self.control_rate_hz, 500.0, 100_000.0),
            ("inertia_kg_m2", motor.inertia_kg_m2, 1e-7, 100.0),
            ("torque_max_nm", motor.torque_max_nm, 1e-5, 1e4),
            ("coulomb_friction_nm", motor.coulomb_friction_nm, 0.0, motor.torque_max_nm),
            ("viscous_friction_nm_s", motor.viscous_friction_nm_s, 0.0, 10.0),
            ("air_drag_nm_s2", motor.air_drag_nm_s2, 0.0, 1.0),
            ("command_delay (ns)", motor.command_delay.0 as f32, 0.0, 10.0 * 1e9 / self.control_rate_hz),
            ("torque_bandwidth_hz", motor.torque_bandwidth_hz, 10.0, 1e6),
            ("bandwidth_rad_s", self.gains.bandwidth_rad_s, 0.1, 1e4),
            ("damping", self.gains.damping, 0.1, 10.0),
            ("encoder_counts_per_turn", sensors.encoder_counts_per_turn as f32, 16.0, 10_000_000.0),
            ("encoder_edge_noise_rad", sensors.encoder_edge_noise_rad, 0.0, 0.1),
            ("index_jitter_s", sensors.index_jitter_s, 0.0, 1e-3),
            ("frame_latency (ns)", clock.frame_latency.0 as f32, 0.0, 1e9),
            ("frame_jitter_ns", clock.frame_jitter_ns, 0.0, 1e6),
            ("wander_ppm_per_sqrt_s", clock.wander_ppm_per_sqrt_s, 0.0, 1e4),
            ("watchdog (ns)", self.limits.watchdog.0 as f32, 1.5e9 / self.control_rate_hz, 1e9),
            ("speed_max_rad_s", self.limits.speed_max_rad_s, 0.1, 1e4),
            ("acceleration_rad_s2", self.speed_drive.acceleration_rad_s2, 1e-3, 1e5),
            ("settle (ns)", self.speed_drive.settle.0 as f32, 0.0, 60e9),
        ] {
            if !(least..=most).contains(&value) {
                return Err(ConfigError::OutOfRange { key, value, least, most });
            }
        }
        let (control_rate_hz, frame_rate_hz) = (self.control_rate_hz, self.nominal_frame_rate_hz());
        if control_rate_hz < 2.5 * frame_rate_hz {
            return Err(ConfigError::ControlTooSlow { control_rate_hz, frame_rate_hz });
        }
        let (speed_max_rad_s, speed_rad_s) = (self.limits.speed_max_rad_s, self.nominal_speed_rad_s());
        if speed_max_rad_s <= speed_rad_s {
            return Err(ConfigError::SpeedLimitBelowRig { speed_max_rad_s, speed_rad_s });
        }
        let (latency_ns, frame_ns) = (clock.frame_latency.0, self.rotation.frame_nanos());
        if matches!(self.pacing, Pacing::SensorLocked | Pacing::VideoLocked) && latency_ns > frame_ns / 2 {
            return Err(ConfigError::LatencyTooLong { latency_ns, frame_ns });
        }
        Ok(self)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use protocol::timing::Direction;
    use protocol::units::Turns;
    use std::string::ToString;

    /// A desk-sized rig with a motor of 0.45 N m.
    pub(crate) fn example(slices: u32, refresh_hz: u32, direction: Direction) -> Config {
        let rotation =
            Rotation::new(slices, 24, u64::from(refresh_hz) * 1_000_000, Turns(123_456_789), direction).unwrap();
        Config {
            rotation,
            pacing: Pacing::FrameLocked,
            control_rate_hz: 4_000.0,
            motor: MotorFigures {
                inertia_kg_m2: 0.0045,
                torque_max_nm: 0.45,
                coulomb_friction_nm: 0.03,
                viscous_friction_nm_s: 2e-4,
                air_drag_nm_s2: 2e-6,
                command_delay: Nanos(500_000),
                torque_bandwidth_hz: 300.0,
            },
            gains: Gains::default(),
            sensors: SensorFigures {
                encoder_counts_per_turn: 2_000,
                encoder_edge_noise_rad: 1.7e-4,
                index_jitter_s: 5e-7,
            },
            clock: ClockFigures { frame_latency: Nanos(0), frame_jitter_ns: 2_000.0, wander_ppm_per_sqrt_s: 1.0 },
            speed_drive: SpeedDriveFigures { acceleration_rad_s2: 30.0, settle: Nanos(500_000_000) },
            limits: Limits {
                speed_max_rad_s: 8_000.0,
                holdover: Nanos(10_000_000_000),
                lock: Nanos(15_000_000_000),
                watchdog: Nanos(5_000_000),
            },
        }
    }

    #[test]
    fn impossible_figures_are_refused_by_name() {
        let good = example(288, 240, Direction::Clockwise);
        assert_eq!(good.checked(), Ok(good));
        let mut bad = good;
        bad.motor.inertia_kg_m2 = f32::NAN;
        assert!(bad.checked().unwrap_err().to_string().starts_with("inertia_kg_m2 = NaN"));
        let mut slow = good;
        slow.control_rate_hz = 599.0;
        assert!(matches!(slow.checked(), Err(ConfigError::ControlTooSlow { .. })));
        let mut late = good;
        late.clock.frame_latency = Nanos(2_100_000);
        assert_eq!(late.checked(), Ok(late));
        for pacing in [Pacing::SensorLocked, Pacing::VideoLocked] {
            late.pacing = pacing;
            assert!(matches!(late.checked(), Err(ConfigError::LatencyTooLong { .. })));
        }
        let mut limited = good;
        limited.limits.speed_max_rad_s = 100.0;
        assert!(matches!(limited.checked(), Err(ConfigError::SpeedLimitBelowRig { .. })));
    }
}
