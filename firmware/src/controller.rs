//! The whole controller as one pure step: an input and its time go in, what to do comes out.

use crate::actuator::Actuator;
use crate::config::{Config, ConfigError};
use crate::fault_log::{Cause, FaultLog};
use crate::follower::Trigger;
use crate::frames::Frames;
use crate::pacing::Pacing;
use crate::plane_store::TurnHandle;
use crate::projector_sync::ProjectorSync;
use crate::rotation::{Index, RotationEstimator};
use crate::safety::{Conditions, Levels, Safety};
use crate::sequencer::{Frame, Sequencer};
use crate::single::root;
use crate::velocity_lock::{Reference, VelocityLock};
use core::f32::consts::TAU;
use modes::Pace;
use protocol::message::{Command, Fault, State};
use protocol::timing::Direction;
use protocol::units::{Nanos, Turns};
use serde::{Deserialize, Serialize};

mod modes;
mod video;

/// What may happen to a controller.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Input {
    /// The control timer fired.
    Tick {
        /// The encoder's counter as latched at that moment; wraps, and grows counter-clockwise.
        encoder_count: u32,
    },
    /// The projector began a frame; its first plane follows after the frame latency.
    FramePulse {
        /// When, by the capture timer.
        at: Nanos,
    },
    /// The projector began a plane.
    PlanePulse {
        /// When, by the capture timer.
        at: Nanos,
    },
    /// The mark in the picture of the frame whose pulse comes next has been read, where frames come as video; within 0.4 frames after the pulse
    /// before that.
    FrameMark {
        /// When.
        at: Nanos,
        /// The frame's number; none where there is no whole mark.
        number: Option<u32>,
    },
    /// The mirror passed its index.
    IndexPulse {
        /// When, by the capture timer.
        at: Nanos,
    },
    /// The host commands.
    Command(Command),
    /// The turn in this slot is whole.
    TurnReady(TurnHandle),
    /// A safety input changed.
    Levels(Levels),
    /// All turns are to be given back. One that is driven, or lit in service, keeps them.
    Vacate,
}

/// What to do from now on, until the next output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Output {
    /// The torque to command, N m, counter-clockwise positive.
    pub torque_nm: f32,
    /// The speed to command a drive that keeps it, rad/s, counter-clockwise positive; 0: the drive lets go. What counts is its integral from
    /// tick to tick: where a drive takes no such fine steps, what was rounded off must be made up for.
    pub speed_rad_s: f32,
    /// Whether the projector's light may be on, at once.
    pub light: bool,
    /// What the projector shows in the frame that it begins next. It is good for one frame: a projector that begins a frame for which
    /// nothing was armed shows nothing.
    pub armed: Option<Frame>,
    /// When the projector is to begin it, if it begins frames when told.
    pub trigger: Option<Trigger>,
    /// Slots that may be filled again.
    pub released: [Option<TurnHandle>; 2],
    /// What the controller is doing.
    pub state: State,
    /// Why it stopped, in [`State::Fault`].
    pub fault: Option<Fault>,
}

/// Estimates for telemetry; nothing depends on them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Estimates {
    /// The mirror's angle.
    pub angle: Turns,
    /// Its speed, rad/s, counter-clockwise positive.
    pub speed_rad_s: f32,
    /// Whether anything measures the mirror. If not, angle and speed are what its drive was told.
    pub measured: bool,
    /// Phase error, slices; 0 where nothing measures it; meaningful in [`State::Acquire`] and later.
    pub phase_error_slices: f32,
    /// The projector's frame rate, Hz.
    pub frame_rate_hz: f32,
    /// The mirror's moment of inertia, kg m².
    pub inertia_kg_m2: f32,
}

/// The controller.
#[derive(Clone, Debug)]
pub struct Controller {
    config: Config,
    sign: f32,
    frames: Frames,
    projector: ProjectorSync,
    rotation: RotationEstimator,
    actuator: Actuator,
    lock: VelocityLock,
    sequencer: Sequencer,
    safety: Safety,
    pace: Pace,
    service_slice: u16,
    last_tick: Option<Nanos>,
    /// A control tick is late when the last one is longer ago.
    tick_patience: Nanos,
    armed_after: Option<u32>,
    doubtful_frames: u32,
    /// A first frame of a turn in which the clock was in doubt.
    missed_start: Option<u32>,
    torque: f32,
}

/// A frame is armed once this share of the one before it has passed: its own start is then safely behind, and the next one ahead,
/// whatever the jitter.
const ARM_AFTER: f32 = 0.25;
/// Control periods after which a missing tick makes it dark, long before the watchdog: what estimates are worth is judged in ticks.
const TICKS_TO_DARK: f32 = 2.0;

impl Controller {
    /// Idle and dark, for the rig that `config` describes; as one that never had a fault.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        Self::after_reset(config, FaultLog::default())
    }

    /// The same after a reset, with the faults of before it: one that held still holds, until a command clears it.
    pub fn after_reset(config: Config, log: FaultLog) -> Result<Self, ConfigError> {
        let config = config.checked()?;
        Ok(Self {
            config,
            sign: match config.rotation.direction() {
                Direction::CounterClockwise => 1.0,
                Direction::Clockwise => -1.0,
            },
            frames: Frames::of(&config.rotation),
            projector: ProjectorSync::new(&config),
            rotation: RotationEstimator::new(&config),
            actuator: Actuator::new(&config),
            lock: VelocityLock::new(&config),
            sequencer: match config.pacing {
                Pacing::VideoLocked => Sequencer::of_video(),
                _ => Sequencer::default(),
            },
            safety: Safety::new(config.limits, log),
            pace: Pace::new(&config),
            service_slice: 0,
            last_tick: None,
            tick_patience: Nanos((TICKS_TO_DARK * 1e9 / config.control_rate_hz) as u64),
            armed_after: None,
            doubtful_frames: 0,
            missed_start: None,
            torque: 0.0,
        })
    }

    /// Takes one input at `now`, which never runs backwards.
    pub fn step(&mut self, now: Nanos, input: Input) -> Output {
        let mut output = Output::default();
        self.check_ticks(now);
        match input {
            Input::Tick { encoder_count } => self.tick(now, encoder_count, &mut output),
            Input::FramePulse { at } => match &mut self.pace {
                Pace::Sensor(follower) => follower.frame_pulse(at),
                _ => {
                    self.projector.pulse(at);
                }
            },
            Input::PlanePulse { at } => match &mut self.pace {
                Pace::Sensor(follower) => follower.plane_pulse(at),
                _ => self.projector.plane_pulse(at),
            },
            Input::FrameMark { at, number } => self.mark(at, number),
            Input::IndexPulse { at } => {
                // What surprises a mirror that was in step came from outside; before, the model may be wrong as well.
                if self.rotation.index(at) == Index::Accepted && self.is_learning() {
                    self.rotation.doubt_model();
                }
            }
            Input::Command(command) => self.command(now, command),
            Input::TurnReady(turn) => output.released[1] = self.sequencer.ready(turn),
            Input::Levels(levels) => self.safety.levels(now, levels),
            Input::Vacate if self.safety.state().is_at_rest() => {
                (output.armed, output.released) = (Some(Frame::Dark), self.sequencer.vacate());
            }
            Input::Vacate => {}
        }
        self.settle(now, &mut output);
        output
    }

    /// What the controller believes.
    pub fn estimates(&self) -> Estimates {
        let (angle, speed) = self.believed();
        Estimates {
            angle: self.config.rotation.angle(angle),
            speed_rad_s: speed * self.sign,
            measured: self.is_measured(),
            phase_error_slices: self.error_slices(),
            frame_rate_hz: self.frame_rate_hz(),
            inertia_kg_m2: 1.0 / self.rotation.acceleration_per_torque(),
        }
    }

    /// The estimator, for telemetry and tests.
    pub fn rotation(&self) -> &RotationEstimator {
        &self.rotation
    }

    /// Faults so far, also of before a reset. To be kept, whenever it changes, before the step's output is acted on.
    pub fn faults(&self) -> &FaultLog {
        self.safety.log()
    }

    /// What it was built with.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Whether nothing is lit and the mirror is driven.
    fn is_learning(&self) -> bool {
        matches!(self.safety.state(), State::SpinUp | State::Acquire)
    }

    fn ticks_are_late(&self, now: Nanos) -> bool {
        self.last_tick.is_some_and(|tick| now.signed_since(tick) > self.tick_patience.0 as i64)
    }

    fn check_ticks(&mut self, now: Nanos) {
        let Some(tick) = self.last_tick else { return };
        if self.ticks_are_late(now) {
            self.safety.distrust();
        }
        let watchdog = self.config.limits.watchdog;
        if now.signed_since(tick) > watchdog.0 as i64 && self.safety.may_drive() {
            self.safety.stop_for(now, Fault::Watchdog, Cause::time(now - tick, watchdog));
        }
    }

    fn command(&mut self, now: Nanos, command: Command) {
        if let Command::Service { slice, .. } = command {
            if u32::from(slice) >= self.config.rotation.slices() {
                return;
            }
            self.service_slice = slice;
        }
        if let Command::ShiftPhase { shift } = command {
            self.shift_phase(shift);
        }
        self.safety.command(now, command, self.is_parked());
    }

    fn tick(&mut self, now: Nanos, encoder_count: u32, output: &mut Output) {
        self.last_tick = Some(now);
        match &mut self.pace {
            Pace::Sensor(follower) => follower.coast(now),
            _ => self.projector.coast(now),
        }
        if self.is_measured() {
            let acted = self.actuator.advance();
            self.rotation.tick(now, encoder_count, acted);
        }
        let conditions = match self.pace {
            Pace::Frame => self.conditions(),
            _ => self.conditions_of_mode(now),
        };
        self.safety.tick(now, &conditions);
        self.torque = if self.safety.may_drive() { self.drive(now) } else { 0.0 };
        self.actuator.command(self.torque);
        match self.pace {
            Pace::Sensor(_) => self.ask(now, output),
            _ => self.arm(now, output),
        }
    }

    /// The torque for the coming tick; a drive that keeps its own speed is told that, and needs none.
    fn drive(&mut self, now: Nanos) -> f32 {
        let reference = match &mut self.pace {
            Pace::Sensor(follower) => Some(follower.reference()),
            _ => self.reference(now),
        };
        if let Pace::Fixed(drive) = &mut self.pace {
            drive.tick(now, reference);
            return 0.0;
        }
        self.lock.torque(&self.rotation, reference, self.actuator.lead_s(), self.is_learning())
    }

    /// What holds after every input: no torque and no light but where safety allows them.
    fn settle(&mut self, now: Nanos, output: &mut Output) {
        if !self.safety.may_drive() {
            self.lock.release();
            self.pace.release();
            self.torque = 0.0;
        }
        let state = self.safety.state();
        // Also where the estimate is in doubt: what is dark in the middle of a turn may only be lit again from the next index on.
        if state == State::Service || !self.safety.may_light() {
            self.sequencer.close();
        }
        let doubtful = self.is_doubtful();
        let start_missed = self.watch_start(now, doubtful);
        output.state = state;
        output.torque_nm = self.torque * self.sign;
        if let Pace::Fixed(drive) = &self.pace {
            output.speed_rad_s = drive.speed() * self.sign;
        }
        output.light = self.safety.may_light()
            && !self.ticks_are_late(now)
            && (state == State::Service || !doubtful && !start_missed);
        output.fault = self.safety.fault();
    }

    /// Whether the frame on screen is the first of a turn and has been in doubt, or may still be that. A turn whose start was dark stays
    /// dark: light that came back at its 24th slice began a turn in the middle, for one lost plane pulse in six.
    fn watch_start(&mut self, now: Nanos, doubtful: bool) -> bool {
        if !doubtful && self.missed_start.is_none() {
            return false;
        }
        let Some(reading) = self.reading(now) else {
            return false;
        };
        if doubtful && self.frames.after(reading.frame, self.slot()) == 0 {
            self.sequencer.close();
            self.missed_start = Some(reading.serial);
        }
        // The pulse of the frame after it may come before its last plane ends, and nothing is armed for that frame.
        self.missed_start = self.missed_start.filter(|serial| reading.serial.wrapping_sub(*serial) <= 1);
        self.missed_start.is_some()
    }

    fn reference(&self, now: Nanos) -> Option<Reference> {
        let reading = self.projector.reading(now)?;
        let speed = TAU * 1e9 / (self.projector.period_ns() * self.frames.count() as f32);
        if speed > 0.98 * self.config.limits.speed_max_rad_s {
            return None;
        }
        // Where frames have numbers, they and not the mirror say which is which.
        let frame = match &self.pace {
            Pace::Video(video) => self.frames.after(reading.frame, video.offset()),
            _ => reading.frame,
        };
        Some(Reference { angle: self.frames.start(frame) + self.frames.part(reading.fraction), speed })
    }

    /// Inlined: for its second caller, in another mode, every tick would pay 10 instructions.
    #[inline(always)]
    fn conditions(&self) -> Conditions {
        let mirror = self.rotation.sigma_rad() / self.config.slice_rad();
        let clock = self.projector.sigma_frames() * self.config.rotation.planes_per_frame() as f32;
        Conditions {
            speeds_rad_s: [self.rotation.speed(), self.rotation.counted_speed()],
            torque_share: self.torque / self.config.motor.torque_max_nm,
            moving: self.rotation.is_moving(),
            encoder_silent: self.rotation.encoder_is_silent(),
            turns_since_index: self.rotation.turns_since_index(),
            clock_known: self.projector.is_tracking(),
            frames_missing: self.projector.frames_missing(),
            contradicted: self.rotation.is_contradicted(),
            model_impossible: self.rotation.model_is_impossible(),
            tracking: self.lock.is_tracking(),
            error_slices: self.lock.error_slices(),
            rate_slices_s: self.lock.rate_slices_s(),
            scatter_slices: self.rotation.index_scatter_rad() / self.config.slice_rad(),
            sigma_slices: root(mirror * mirror + clock * clock),
            pacing: self.config.pacing,
        }
    }

    fn arm(&mut self, now: Nanos, output: &mut Output) {
        if self.safety.state() == State::Service {
            let (frame, released) = self.sequencer.still(self.service_slice);
            (output.armed, output.released[0]) = (Some(frame), released);
            return;
        }
        let Some(reading) = self.projector.reading(now) else {
            return;
        };
        if reading.fraction < ARM_AFTER || self.armed_after == Some(reading.serial) {
            return;
        }
        self.armed_after = Some(reading.serial);
        let may = self.may_show(&reading);
        let next = self.frames.after(reading.frame, 1 + self.slot());
        self.show(next, may, output);
        self.blank_doubtful(output);
    }

    /// Arms frame `next` of the turn, dark unless it `may` be lit.
    fn show(&mut self, next: u32, may: bool, output: &mut Output) {
        self.doubtful_frames = if self.is_doubtful() { self.doubtful_frames.saturating_add(1) } else { 0 };
        // A doubt of a frame leaves a gap in the turn; one of half a turn ends it.
        let doubted = self.doubtful_frames > self.frames.count().max(2) / 2;
        let lit = may && self.safety.state() != State::Service && self.safety.may_light() && !doubted;
        let (frame, released) = self.sequencer.arm(next, lit);
        (output.armed, output.released[0]) = (Some(frame), released);
    }
}

#[cfg(test)]
#[path = "controller_tests.rs"]
mod tests;
