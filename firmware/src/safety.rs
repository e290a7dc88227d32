//! States and interlocks: when torque may be given, when light, and why not.

use crate::angle::nanos_to_f32;
use crate::config::Limits;
use crate::fault_log::{Cause, FaultLog};
use crate::pacing::Pacing;
use crate::single::at_least;
use core::f32::consts::TAU;
use protocol::message::{Command, Fault, Quantity, State};
use protocol::units::Nanos;

/// What safety judges, once a control tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct Conditions {
    /// The mirror's speed by the filter and by bare counts, rad/s.
    pub speeds_rad_s: [f32; 2],
    /// Torque commanded, as a share of the limit.
    pub torque_share: f32,
    /// The mirror turns.
    pub moving: bool,
    /// The encoder is silent although the mirror turns.
    pub encoder_silent: bool,
    /// Turns since the last index.
    pub turns_since_index: f32,
    /// The projector's clock is known.
    pub clock_known: bool,
    /// Frames since the last pulse.
    pub frames_missing: u32,
    /// Counts have contradicted the estimate since the last index.
    pub contradicted: bool,
    /// What the estimator has learnt of the motor is true of no motor.
    pub model_impossible: bool,
    /// The loop is at the end of its planned way.
    pub tracking: bool,
    /// Estimated phase error, slices.
    pub error_slices: f32,
    /// Its rate, slices a second.
    pub rate_slices_s: f32,
    /// Standard deviation of the phase error by sensors and clock, slices.
    pub sigma_slices: f32,
    /// How far off the last index pulses were, root mean square, slices.
    pub scatter_slices: f32,
    /// Who leads. In [`Pacing::FixedSpeed`] all of this is by what the drive was told.
    pub pacing: Pacing,
}

impl Conditions {
    /// Whether planes lit by this estimate are where they belong, as far as filter and index can tell.
    fn is_sharp(&self) -> bool {
        [self.sigma_slices, self.scatter_slices].iter().all(|off| 3.0 * off < DARK_SLICES) && !self.contradicted
    }

    /// Whether the mirror is in step, and known to be, as closely as good sensors allow.
    fn is_fine(&self) -> bool {
        self.error_slices.abs() < FINE_SLICES && self.sigma_slices < FINE_SIGMA_SLICES
    }

    /// How many turns the mirror makes in `time` at its present speed.
    fn turns(&self, time: Nanos) -> f32 {
        nanos_to_f32(time.0 as i64) * 1e-9 * self.speeds_rad_s[0] / TAU
    }
}

/// Levels of the safety inputs: true is active.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Levels {
    /// The emergency stop is pressed.
    pub emergency_stop: bool,
    /// The guard is open.
    pub guard_open: bool,
}

/// The state machine.
#[derive(Clone, Debug)]
pub struct Safety {
    limits: Limits,
    state: State,
    log: FaultLog,
    levels: Levels,
    entered: Nanos,
    driven_since: Nanos,
    service_until: Nanos,
    steady_since: Option<Nanos>,
    fine_since: Option<Nanos>,
    still_since: Option<Nanos>,
    fast_ticks: u32,
    sharp_since: Option<Nanos>,
    trusted_at: Nanos,
    trusted: bool,
}

/// In step: this close, beyond what the estimate may err by itself, and moving off by no more than that in 7 ms.
const LOCK_SLICES: f32 = 0.01;
const LOCK_RATE_PER_SLICE: f32 = 150.0;
/// Light waits for so many turns of that, so that the index has confirmed it, and for so long; or for a single turn in which the mirror was
/// this close and the estimate this sure. What a landing leaves behind dies out in the meantime: with two turns of the first alone, one start
/// in fifteen peaked above 0.015 slices after its lock, the worst of 1,000 at 0.035; now it is 0.0141, 0.14 s later in the median.
const LOCK_TURNS: f32 = 2.0;
const LOCK_TIME: Nanos = Nanos(300_000_000);
const FINE_SLICES: f32 = 0.006;
const FINE_SIGMA_SLICES: f32 = 0.0035;
const FINE_TURNS: f32 = 1.0;
/// Out of step from here on: half of what a plane may be off.
const UNLOCK_SLICES: f32 = 0.25;
/// Light goes out where three sigmas of the estimate reach this.
const DARK_SLICES: f32 = 0.4;
/// What once-a-turn doubt leaves of the estimate changes within a turn: near the index it is always good. So it must have been good for a
/// whole turn before light comes back; else light came and went twice a turn, and turns were torn.
const TRUST_TURNS: f32 = 1.0;
/// A mirror in step that is in doubt for longer goes back to learning.
const DARK_MAX: Nanos = Nanos(3_000_000_000);
const FRAMES_TO_HOLDOVER: u32 = 3;
/// Where nothing measures the mirror there is no model to hold over by.
const FRAMES_TO_DARK: u32 = 2;
const TURNS_TO_HOLDOVER: f32 = 2.5;
const STALL: Nanos = Nanos(1_000_000_000);
const SERVICE_MAX_MS: u32 = 60_000;

impl Safety {
    /// Idle, or in the fault that `log` holds.
    pub fn new(limits: Limits, log: FaultLog) -> Self {
        Self {
            limits,
            state: if log.latched().is_some() { State::Fault } else { State::Idle },
            log,
            levels: Levels::default(),
            entered: Nanos::ZERO,
            driven_since: Nanos::ZERO,
            service_until: Nanos::ZERO,
            steady_since: None,
            fine_since: None,
            still_since: None,
            fast_ticks: 0,
            sharp_since: None,
            trusted_at: Nanos::ZERO,
            trusted: false,
        }
    }

    /// The state.
    pub fn state(&self) -> State {
        self.state
    }

    /// Why it is [`State::Fault`], if it is.
    pub fn fault(&self) -> Option<Fault> {
        self.log.latched()
    }

    /// Faults so far, also of before a reset.
    pub fn log(&self) -> &FaultLog {
        &self.log
    }

    /// Whether the mirror may be driven.
    pub fn may_drive(&self) -> bool {
        self.state.may_drive()
    }

    /// Whether planes may be lit: the state allows it and the estimate is good enough.
    pub fn may_light(&self) -> bool {
        self.state.may_light() && (self.state == State::Service || self.trusted)
    }

    /// What the estimate was worth is not known any more: dark, until it has been good for a whole turn again.
    pub fn distrust(&mut self) {
        self.sharp_since = None;
        self.trusted = false;
    }

    /// Stops for `fault`; the first one stays until it is cleared.
    pub fn stop_for(&mut self, now: Nanos, fault: Fault, cause: Cause) {
        self.log.latch(fault, cause, now);
        self.enter(now, State::Fault);
    }

    /// Takes the levels of the safety inputs.
    pub fn levels(&mut self, now: Nanos, levels: Levels) {
        self.levels = levels;
        if levels.emergency_stop {
            self.stop_for(now, Fault::EmergencyStop, Cause::LEVEL);
        } else if levels.guard_open {
            self.stop_for(now, Fault::GuardOpen, Cause::LEVEL);
        }
    }

    /// Obeys `command` where the state allows it; else nothing happens. `parked`: the mirror stands.
    pub fn command(&mut self, now: Nanos, command: Command, parked: bool) {
        match (command, self.state) {
            (Command::Start, State::Idle | State::Service) => {
                self.driven_since = now;
                self.enter(now, State::SpinUp);
            }
            (Command::Stop, State::Fault) => {}
            (Command::Stop, _) => self.enter(now, State::Idle),
            (Command::Service { duration_ms, .. }, State::Idle | State::Service) if parked => {
                self.service_until = now + Nanos(u64::from(duration_ms.min(SERVICE_MAX_MS)) * 1_000_000);
                self.enter(now, State::Service);
            }
            (Command::ClearFault, State::Fault) if self.levels == Levels::default() => {
                self.log.clear();
                self.enter(now, State::Idle);
            }
            _ => {}
        }
    }

    /// Judges one control tick.
    pub fn tick(&mut self, now: Nanos, conditions: &Conditions) {
        let sharp = conditions.is_sharp() && conditions.error_slices.abs() < UNLOCK_SLICES;
        self.sharp_since = sharp.then(|| self.sharp_since.unwrap_or(now));
        self.trusted = self.sharp_since.is_some_and(|since| conditions.turns(now - since) >= TRUST_TURNS);
        if self.trusted {
            self.trusted_at = now;
        }
        if self.state == State::Service && (now >= self.service_until || conditions.moving) {
            self.enter(now, State::Idle);
        }
        if !self.may_drive() {
            return;
        }
        if let Some((fault, cause)) = self.find_fault(now, conditions) {
            self.stop_for(now, fault, cause);
            return;
        }
        self.follow_lock(now, conditions);
    }

    /// Whether a mirror that seems in step has not been trusted for so long that it had better learn anew.
    fn is_long_dark(&self, now: Nanos) -> bool {
        !self.trusted && now - self.trusted_at.max(self.entered) > DARK_MAX
    }

    fn enter(&mut self, now: Nanos, state: State) {
        if self.state != state {
            self.state = state;
            self.entered = now;
            self.steady_since = None;
            self.fine_since = None;
            self.still_since = None;
        }
    }

    fn find_fault(&mut self, now: Nanos, conditions: &Conditions) -> Option<(Fault, Cause)> {
        let fast = conditions.speeds_rad_s.iter().any(|speed| speed.abs() > self.limits.speed_max_rad_s);
        // A window of wrong counts lasts 32 ticks; a mirror that is too fast stays so for longer.
        self.fast_ticks = if fast { self.fast_ticks + 1 } else { 0 };
        if self.fast_ticks > 40 {
            let value = conditions.speeds_rad_s.iter().fold(0.0, |most, speed| at_least(speed.abs(), most));
            let cause = Cause { quantity: Quantity::Speed, value, limit: self.limits.speed_max_rad_s };
            return Some((Fault::Overspeed, cause));
        }
        let still = conditions.torque_share.abs() > 0.3 && !conditions.moving;
        self.still_since = still.then(|| self.still_since.unwrap_or(now));
        if let Some(since) = self.still_since.filter(|since| now - *since > STALL) {
            return Some((Fault::Stall, Cause::time(now - since, STALL)));
        }
        let index_silent = conditions.turns_since_index > TURNS_TO_HOLDOVER;
        if conditions.encoder_silent && index_silent {
            let value = conditions.turns_since_index;
            return Some((Fault::SensorLost, Cause { quantity: Quantity::Turns, value, limit: TURNS_TO_HOLDOVER }));
        }
        let waiting = self.state == State::SpinUp || self.state == State::Acquire;
        let (held, driven) = (now - self.entered, now - self.driven_since);
        if held > self.limits.holdover && self.state == State::Holdover {
            let projector = conditions.frames_missing >= FRAMES_TO_HOLDOVER || !conditions.clock_known;
            let fault = if projector { Fault::ProjectorLost } else { Fault::SensorLost };
            return Some((fault, Cause::time(held, self.limits.holdover)));
        }
        if waiting && driven > self.limits.lock {
            let silent = conditions.encoder_silent || index_silent;
            let fault = match conditions.clock_known {
                false => Fault::ProjectorLost,
                true if silent => Fault::SensorLost,
                true => Fault::LockTimeout,
            };
            return Some((fault, Cause::time(driven, self.limits.lock)));
        }
        None
    }

    fn follow_lock(&mut self, now: Nanos, conditions: &Conditions) {
        let missing = conditions.frames_missing >= FRAMES_TO_HOLDOVER
            || conditions.encoder_silent
            || conditions.turns_since_index > TURNS_TO_HOLDOVER;
        // Where the display follows the mirror the next frame is in its place again.
        let out = conditions.error_slices.abs() > UNLOCK_SLICES && conditions.pacing != Pacing::SensorLocked;
        let lost = !conditions.clock_known || !conditions.tracking || out;
        match self.state {
            State::Locked | State::Holdover | State::OpenLoop if lost => {
                self.driven_since = now;
                let near = conditions.clock_known && conditions.error_slices.abs() < 12.0;
                self.enter(now, if near { State::Acquire } else { State::SpinUp });
            }
            State::Locked | State::OpenLoop if self.is_long_dark(now) => {
                self.driven_since = now;
                self.enter(now, State::Acquire);
            }
            State::OpenLoop if conditions.frames_missing >= FRAMES_TO_DARK => {
                self.driven_since = now;
                self.enter(now, State::Acquire);
            }
            State::Locked if missing => self.enter(now, State::Holdover),
            State::Holdover if !missing => self.enter(now, State::Locked),
            State::SpinUp if conditions.tracking => self.enter(now, State::Acquire),
            State::Acquire if !conditions.tracking && conditions.rate_slices_s.abs() > 200.0 => {
                self.enter(now, State::SpinUp);
            }
            State::Acquire => {
                let close = LOCK_SLICES + 3.0 * conditions.sigma_slices;
                let steady = conditions.tracking
                    && conditions.error_slices.abs() < close
                    && conditions.rate_slices_s.abs() < LOCK_RATE_PER_SLICE * close
                    && conditions.is_sharp()
                    && !conditions.model_impossible
                    && !missing;
                self.steady_since = steady.then(|| self.steady_since.unwrap_or(now));
                let fine = steady && conditions.is_fine();
                self.fine_since = fine.then(|| self.fine_since.unwrap_or(now));
                let lasts = |since: Option<Nanos>, turns, time| {
                    since.is_some_and(|since| conditions.turns(now - since) >= turns && now - since >= time)
                };
                if lasts(self.fine_since, FINE_TURNS, Nanos::ZERO) || lasts(self.steady_since, LOCK_TURNS, LOCK_TIME) {
                    let measured = conditions.pacing != Pacing::FixedSpeed;
                    self.enter(now, if measured { State::Locked } else { State::OpenLoop });
                }
            }
            _ => {}
        }
    }
}

#[cfg(test)]
#[path = "safety_tests.rs"]
mod tests;
