//! Auto-tuning: a short run on a device, what it tells of the motor, and the gains that follow.
//!
//! Nothing in here is told the plant: the run sees counts and index pulses and gives torques.

pub mod experiment;
pub mod identify;
mod regression;

use crate::lock_sweep::{Case, SweepError, model};
use crate::loop_model::{LoopModel, Margins};
use crate::motor::{Cogging, Motor, PlantFigures, Ripple};
use crate::scenario::Scenario;
use crate::statistics::LockStatistics;
use crate::world::World;
use experiment::{Experiment, RUN_S, Recording, Told};
use firmware::config::ConfigError;
use firmware::controller::Controller;
use firmware::plane_store::TurnHandle;
use identify::{Identified, identify};
use protocol::timing::Rotation;
use protocol::units::Nanos;
use serde::Serialize;
use std::sync::PoisonError;
use thiserror::Error;

/// Why a motor cannot be identified: what was seen, and what to check.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Unidentifiable {
    /// Neither counts nor index pulses.
    #[error(
        "the mirror did not move under {torque_nm} N m: check the drive's supply and that nothing holds the mirror"
    )]
    Stalled {
        /// Full torque.
        torque_nm: f64,
    },
    /// Index pulses and no counts.
    #[error("the index came {indices} times and the encoder counted nothing: check the encoder's supply and wires")]
    EncoderDead {
        /// How often.
        indices: u32,
    },
    /// Counts against the torque.
    #[error("the encoder counted backwards ({counts}) under a forward torque: swap its A and B, or the motor's phases")]
    EncoderReversed {
        /// How many.
        counts: i32,
    },
    /// Counts and no index pulse.
    #[error("the encoder counted {turns:.0} turns and the index never came: check the index sensor")]
    NoIndex {
        /// How many.
        turns: f64,
    },
    /// Too little motion.
    #[error("the mirror hardly turned: check friction, max_torque_nm, and that the encoder counts whole turns")]
    NotTurning,
    /// A figure came out too vague to be used.
    #[error("the {what} could not be told to 10 %: check counts_per_turn, and that nothing else drives the mirror")]
    Vague {
        /// Which.
        what: &'static str,
    },
}

/// A motor as it was found, and the loop for it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tuned {
    /// With standard deviations.
    pub identified: Identified,
    /// A motor file: what was found, what was told, and the bandwidth.
    pub motor: Motor,
    /// The loop's linear model.
    pub model: LoopModel,
    /// At the drive's input, the estimator included.
    pub margins: Margins,
    /// The bandwidth at which it becomes unstable, Hz.
    pub boundary_hz: f64,
}

/// Why there is no tuned motor.
#[derive(Debug, Error)]
pub enum TuneError {
    /// The run tells nothing.
    #[error("{0}")]
    Unidentifiable(#[from] Unidentifiable),
    /// The motor found has no lock.
    #[error("as identified, {0}")]
    Loop(#[from] SweepError),
}

/// The bandwidth is this part of the one at which the loop becomes unstable: `praxi lock-chart` shows the phase error at its least from a
/// tenth to a third of it, and the margins at the drive growing up to it.
const BOUNDARY_PART: f64 = 0.25;
/// How long a proof is simulated, seconds.
const PROOF_S: f64 = 20.0;

/// Runs the experiment on a device whose plant is that of `truth`, under the disturbances of `scenario`.
pub fn record(rotation: &Rotation, truth: &Motor, scenario: &Scenario, seed: u64) -> Recording {
    let (experiment, recording) = Experiment::new(told(truth), rotation);
    let mut world = World::with_core(rotation, Nanos::ZERO, truth, scenario, seed, Box::new(experiment));
    world.advance(RUN_S + 1.0);
    std::mem::take(&mut *recording.lock().unwrap_or_else(PoisonError::into_inner))
}

/// The lock that `tuned` gives on the plant of `truth`.
pub fn prove(
    rotation: &Rotation,
    frame_latency: Nanos,
    truth: &Motor,
    tuned: &Tuned,
    seed: u64,
) -> Result<LockStatistics, ConfigError> {
    let controller = Controller::new(tuned.motor.firmware_config(rotation, frame_latency))?;
    let scenario = Scenario::default();
    let mut world = World::with_core(rotation, frame_latency, truth, &scenario, seed, Box::new(controller));
    world.turn_ready(TurnHandle(0));
    world.advance(PROOF_S);
    Ok(world.statistics())
}

/// What data sheets tell of a motor.
pub fn told(motor: &Motor) -> Told {
    Told {
        torque_max_nm: motor.plant.max_torque_nm,
        torque_bandwidth_hz: motor.plant.torque_loop_bandwidth_hz,
        counts_per_turn: motor.sensors.encoder_counts_per_turn,
        rate_hz: motor.controller.rate_hz,
    }
}

/// Refuses a recording that no motor in order gives.
pub fn check(told: &Told, recording: &Recording) -> Result<(), Unidentifiable> {
    let counts = recording.counts.last().copied().unwrap_or(0);
    let turns = f64::from(counts) / f64::from(told.counts_per_turn);
    let full = recording.torques_nm.iter().fold(0.0, |most: f64, torque| most.max(*torque));
    if turns < -0.01 {
        return Err(Unidentifiable::EncoderReversed { counts });
    }
    match recording.indices {
        0 if turns < 0.01 => Err(Unidentifiable::Stalled { torque_nm: full }),
        indices if turns < 0.01 => Err(Unidentifiable::EncoderDead { indices }),
        0 if turns > 2.0 => Err(Unidentifiable::NoIndex { turns }),
        _ => Ok(()),
    }
}

/// From a recording to a motor and its gains. `sheet` gives what is not identified: sensors' noise, the projector's clock, and what was told.
pub fn tune(rotation: &Rotation, sheet: &Motor, recording: &Recording) -> Result<Tuned, TuneError> {
    let told = told(sheet);
    check(&told, recording)?;
    let identified = identify(&told, recording)?;
    let mut motor = found(sheet, &identified);
    let loop_model = model(rotation, &Case { name: "as identified", motor: motor.clone() })?;
    let boundary_hz = loop_model.boundary_hz();
    motor.controller.bandwidth_hz = BOUNDARY_PART * boundary_hz;
    let model = loop_model.at(motor.controller.bandwidth_hz);
    Ok(Tuned { identified, motor, model, margins: model.margins(), boundary_hz })
}

fn found(sheet: &Motor, identified: &Identified) -> Motor {
    let mut sensors = sheet.sensors.clone();
    sensors.encoder_eccentricity_deg = identified.eccentricity_rad.value.to_degrees();
    let share = identified.harmonics.iter().find(|harmonic| harmonic.of_torque);
    let cogging = identified.harmonics.iter().filter(|harmonic| !harmonic.of_torque);
    Motor {
        name: format!("{} as identified", sheet.name),
        plant: PlantFigures {
            inertia_kg_m2: identified.inertia_kg_m2.value,
            viscous_friction_nm_s: identified.viscous_friction_nm_s.value.max(0.0),
            coulomb_friction_nm: identified.coulomb_friction_nm.value.max(0.0),
            air_drag_nm_s2: identified.air_drag_nm_s2.value.max(0.0),
            command_delay_us: identified.command_delay_s.value * 1e6,
            torque_ripple: share
                .map_or(Ripple::default(), |found| Ripple { share: found.size.value, per_turn: found.per_turn }),
            cogging: cogging.map(|found| Cogging { torque_nm: found.size.value, per_turn: found.per_turn }).collect(),
            once_per_turn_nm: identified.once_per_turn_nm.value,
            ..sheet.plant.clone()
        },
        sensors,
        projector_clock: sheet.projector_clock.clone(),
        speed_drive: sheet.speed_drive.clone(),
        controller: sheet.controller.clone(),
    }
}

#[cfg(test)]
mod tests;
