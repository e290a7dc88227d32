//! The run from which a motor is identified: a program of torques, and what the encoder counted meanwhile.

use crate::world::Core;
use firmware::controller::{Estimates, Input, Output};
use protocol::timing::{Direction, Rotation};
use protocol::units::Nanos;
use std::f64::consts::TAU;
use std::sync::{Arc, Mutex, PoisonError};

/// What is known before: the data sheets of drive and encoder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    /// The largest torque that may be commanded, N m.
    pub torque_max_nm: f64,
    /// First order, from torque command to torque, without the delay, Hz.
    pub torque_bandwidth_hz: f64,
    /// Encoder counts a turn.
    pub counts_per_turn: u32,
    /// Control ticks a second.
    pub rate_hz: f64,
}

/// What the run gave. Counts and torques are positive in the rig's direction.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// The encoder's count at each tick, from 0 on.
    pub counts: Vec<i32>,
    /// The torque commanded at each tick, N m.
    pub torques_nm: Vec<f64>,
    /// Index pulses.
    pub indices: u32,
    /// The run is over.
    pub over: bool,
}

/// A stage of the run, and the tick at which it began.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    /// No torque.
    Rest,
    /// More and more, until the mirror moves.
    Ramp,
    /// To and fro between two low speeds, where cogging shows.
    Slow {
        push_nm: f64,
        pushing: bool,
    },
    /// Up under a torque that changes, where inertia, delay and eccentricity show.
    Push,
    /// Down without torque, where friction shows.
    Coast,
    Over,
}

/// The run.
pub struct Experiment {
    told: Told,
    sign: i32,
    speed_target: f64,
    stage: Stage,
    began: usize,
    first: Option<u32>,
    recording: Arc<Mutex<Recording>>,
}

const REST_S: f64 = 0.2;
const RAMP_S: f64 = 1.0;
/// At full torque for this long without motion is standing still.
const STALL_S: f64 = 0.5;
const SLOW_S: f64 = 6.0;
const SLOW_RAD_S: [f64; 2] = [2.0, 5.0];
/// Between these shares of the limit.
const PUSH_SHARES: [f64; 2] = [0.35, 0.9];
const PUSH_TICKS_S: f64 = 0.03;
const PUSH_S: f64 = 8.0;
const COAST_S: f64 = 1.5;
/// All of it.
pub const RUN_S: f64 = 20.0;
const MOVED_RAD: f64 = 0.1;

impl Experiment {
    /// A run on a rig that turns as `rotation` says, up to 80 % of its speed; the recording fills as it goes.
    pub fn new(told: Told, rotation: &Rotation) -> (Self, Arc<Mutex<Recording>>) {
        let recording = Arc::new(Mutex::new(Recording::default()));
        let experiment = Self {
            told,
            sign: if rotation.direction() == Direction::CounterClockwise { 1 } else { -1 },
            speed_target: 0.8 * TAU * rotation.refresh_microhertz() as f64 * 1e-6 / f64::from(rotation.frames()),
            stage: Stage::Rest,
            began: 0,
            first: None,
            recording: Arc::clone(&recording),
        };
        (experiment, recording)
    }

    fn tick(&mut self, count: u32) -> f64 {
        let first = *self.first.get_or_insert(count);
        let recording = Arc::clone(&self.recording);
        let mut recording = recording.lock().unwrap_or_else(PoisonError::into_inner);
        if recording.over {
            return 0.0;
        }
        recording.counts.push((count.wrapping_sub(first) as i32).wrapping_mul(self.sign));
        let torque = self.torque(&recording);
        recording.torques_nm.push(torque);
        recording.over = self.stage == Stage::Over;
        torque
    }

    fn begin(&mut self, stage: Stage, tick: usize) {
        (self.stage, self.began) = (stage, tick);
    }

    fn torque(&mut self, recording: &Recording) -> f64 {
        let tick = recording.counts.len() - 1;
        let here = recording.counts[tick];
        let elapsed = (tick - self.began) as f64 / self.told.rate_hz;
        let count_rad = TAU / f64::from(self.told.counts_per_turn);
        let back = ((0.01 * self.told.rate_hz) as usize).min(tick).max(1);
        let speed =
            f64::from(here - recording.counts[tick.saturating_sub(back)]) * count_rad * self.told.rate_hz / back as f64;
        if tick as f64 > RUN_S * self.told.rate_hz {
            self.begin(Stage::Over, tick);
        }
        match self.stage {
            Stage::Rest if elapsed > REST_S => self.begin(Stage::Ramp, tick),
            Stage::Ramp => {
                let torque = self.told.torque_max_nm * (elapsed / RAMP_S).min(1.0);
                let moved = f64::from(here) * count_rad;
                if moved > MOVED_RAD {
                    self.begin(Stage::Slow { push_nm: 1.3 * torque, pushing: true }, tick);
                } else if moved < -MOVED_RAD || recording.indices > 1 || elapsed > RAMP_S + STALL_S {
                    // Backwards, or turning unseen, or not at all: the recording tells which.
                    self.begin(Stage::Over, tick);
                } else {
                    return torque;
                }
            }
            Stage::Slow { push_nm, pushing } => {
                let pushing = if pushing { speed < SLOW_RAD_S[1] } else { speed < SLOW_RAD_S[0] };
                if elapsed > SLOW_S {
                    self.begin(Stage::Push, tick);
                } else {
                    self.stage = Stage::Slow { push_nm, pushing };
                }
                return if pushing { push_nm.min(self.told.torque_max_nm) } else { 0.0 };
            }
            Stage::Push => {
                if speed > self.speed_target || elapsed > PUSH_S {
                    self.begin(Stage::Coast, tick);
                }
                // A torque that changes irregularly: bits of the golden ratio's multiples.
                let part = (elapsed / PUSH_TICKS_S) as u32;
                let high = part.wrapping_mul(0x9e37_79b9) >> 31 == 1;
                return PUSH_SHARES[usize::from(high)] * self.told.torque_max_nm;
            }
            Stage::Coast if elapsed > COAST_S || speed < 0.5 * self.speed_target => self.begin(Stage::Push, tick),
            _ => {}
        }
        0.0
    }
}

impl Core for Experiment {
    fn step(&mut self, _: Nanos, input: Input) -> Output {
        let torque = match input {
            Input::Tick { encoder_count } => self.tick(encoder_count),
            other => {
                let mut recording = self.recording.lock().unwrap_or_else(PoisonError::into_inner);
                recording.indices += u32::from(matches!(other, Input::IndexPulse { .. }));
                if recording.over { 0.0 } else { recording.torques_nm.last().copied().unwrap_or(0.0) }
            }
        };
        Output { torque_nm: torque as f32 * self.sign as f32, ..Output::default() }
    }

    fn estimates(&self) -> Estimates {
        Estimates::default()
    }
}
