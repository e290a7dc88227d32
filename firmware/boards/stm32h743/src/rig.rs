//! The machine that this board drives: the figures of its data sheets. They are to be made those of the real machine before the first
//! spin; inertia and friction may be rough, they are identified in every spin-up.

use firmware::config::{ClockFigures, Config, Gains, Limits, MotorFigures, SensorFigures, SpeedDriveFigures};
use firmware::pacing::Pacing;
use protocol::timing::{Direction, Rotation, RotationError};
use protocol::units::{Nanos, Turns};

/// Until a host configures another: 288 slices at 240 Hz.
pub fn rotation() -> Result<Rotation, RotationError> {
    Rotation::new(288, 24, 240_000_000, Turns::ZERO, Direction::CounterClockwise)
}

/// Of the reference motor, as in `hil-sim/motors/reference.toml`, to which `hil-sim/tests/board.rs` holds it.
pub fn config(rotation: Rotation) -> Config {
    let mut config = Config {
        rotation,
        // This board has neither a trigger line nor one for speed.
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
        sensors: SensorFigures {
            encoder_counts_per_turn: 2_000,
            encoder_edge_noise_rad: 1.745_329_2e-4,
            index_jitter_s: 5e-7,
        },
        gains: Gains::default(),
        clock: ClockFigures { frame_latency: Nanos(0), frame_jitter_ns: 2_000.0, wander_ppm_per_sqrt_s: 1.0 },
        speed_drive: SpeedDriveFigures { acceleration_rad_s2: 30.0, settle: Nanos(500_000_000) },
        limits: Limits {
            speed_max_rad_s: 0.0,
            holdover: Nanos(10_000_000_000),
            lock: Nanos(15_000_000_000),
            watchdog: Nanos(5_000_000),
        },
    };
    config.limits.speed_max_rad_s = 1.5 * config.nominal_speed_rad_s();
    config
}
