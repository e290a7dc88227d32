//! What the other modes do in place of the lock: the projector follows the mirror, or a drive that keeps its own speed follows the projector.

use super::video::Video;
use super::{Controller, Output};
use crate::angle::radians_between;
use crate::config::Config;
use crate::follower::Follower;
use crate::pacing::Pacing;
use crate::projector_sync::ClockReading;
use crate::safety::Conditions;
use crate::sequencer::Frame;
use crate::speed_command::SpeedCommand;
use crate::video_index::Known;
use protocol::message::State;
use protocol::units::{Nanos, Turns};

/// The mode, with what only it needs.
#[derive(Clone, Debug)]
pub(super) enum Pace {
    Frame,
    Video(Video),
    Sensor(Follower),
    Fixed(SpeedCommand),
}

impl Pace {
    pub(super) fn new(config: &Config) -> Self {
        match config.pacing {
            Pacing::FrameLocked => Self::Frame,
            Pacing::VideoLocked => Self::Video(Video::new(config)),
            Pacing::SensorLocked => Self::Sensor(Follower::new(config)),
            Pacing::FixedSpeed => Self::Fixed(SpeedCommand::new(config)),
        }
    }

    /// The mirror is let go.
    pub(super) fn release(&mut self) {
        match self {
            Self::Frame | Self::Video(_) | Self::Sensor(_) => {}
            Self::Fixed(drive) => drive.release(),
        }
    }
}

impl Controller {
    /// Where in which frame the projector is. Inlined: a pulse that is in doubt would pay 40 instructions.
    #[inline(always)]
    pub(super) fn reading(&self, now: Nanos) -> Option<ClockReading> {
        match &self.pace {
            Pace::Sensor(follower) => follower.reading(now),
            _ => self.projector.reading(now),
        }
    }

    pub(super) fn is_doubtful(&self) -> bool {
        match &self.pace {
            Pace::Sensor(follower) => follower.is_doubtful(),
            _ => self.projector.is_doubtful(),
        }
    }

    /// By how many frames of a turn the mirror's place is ahead of the count of frames.
    pub(super) fn slot(&self) -> u32 {
        match &self.pace {
            Pace::Frame => self.lock.slot(),
            Pace::Video(video) => video.offset(),
            Pace::Sensor(_) => 0,
            Pace::Fixed(drive) => drive.slot(),
        }
    }

    /// Asks the projector for the frame that is due.
    #[cold]
    pub(super) fn ask(&mut self, now: Nanos, output: &mut Output) {
        let Pace::Sensor(follower) = &mut self.pace else { return };
        if self.safety.state() == State::Locked {
            follower.prove();
        }
        if self.safety.may_drive() {
            if let Some(asked) = follower.ask(now, &self.rotation) {
                output.trigger = Some(asked.trigger);
                if !asked.in_order {
                    self.sequencer.close();
                }
                self.show(asked.frame, true, output);
            }
        } else if self.safety.state() == State::Service {
            output.trigger = follower.ask_parked(now);
            if output.trigger.is_some() {
                let (frame, released) = self.sequencer.still(self.service_slice);
                (output.armed, output.released[0]) = (Some(frame), released);
            }
        } else {
            follower.release();
        }
    }

    /// What safety judges, where the mirror does not follow the projector's clock by torque.
    #[cold]
    pub(super) fn conditions_of_mode(&self, now: Nanos) -> Conditions {
        match &self.pace {
            Pace::Frame => Conditions::default(),
            Pace::Video(_) => self.conditions(),
            Pace::Sensor(follower) => self.conditions_of_follower(now, follower),
            Pace::Fixed(drive) => self.conditions_of_drive(now, drive),
        }
    }

    /// What safety judges where the display follows the mirror, from what it would where the mirror follows a clock: the controller's own.
    ///
    /// A display that follows an estimate always agrees with it. So the first light waits until the mirror has been in step with the clock, as
    /// it would for a projector's: with half the torque that was named, 8 of 100 starts lit planes up to 0.66 slices off.
    fn conditions_of_follower(&self, now: Nanos, follower: &Follower) -> Conditions {
        let (mut conditions, slice_rad) = (self.conditions(), self.config.slice_rad());
        conditions.clock_known = follower.is_known();
        conditions.frames_missing = follower.frames_missing();
        conditions.sigma_slices = self.rotation.sigma_rad() / slice_rad;
        if follower.is_proven() {
            conditions.tracking = follower.is_on(now);
            // What drives the mirror need not be the motor.
            conditions.model_impossible = false;
            conditions.error_slices = self.error_to(follower.reading(now));
            conditions.rate_slices_s = (self.rotation.speed() - follower.speed()) / slice_rad;
        }
        conditions
    }

    /// What safety judges where nothing measures the mirror.
    fn conditions_of_drive(&self, now: Nanos, drive: &SpeedCommand) -> Conditions {
        let ramping = self.safety.state() == State::SpinUp;
        Conditions {
            speeds_rad_s: [drive.speed(); 2],
            clock_known: self.projector.is_tracking(),
            frames_missing: self.projector.frames_missing(),
            tracking: if ramping { drive.is_at_speed() } else { drive.is_settled(now) },
            error_slices: drive.error_slices(),
            rate_slices_s: drive.rate_slices_s(),
            sigma_slices: self.projector.sigma_frames() * self.config.rotation.planes_per_frame() as f32,
            pacing: self.config.pacing,
            ..Conditions::default()
        }
    }

    /// The picture is turned from the next turn on: in this mode alone, where there is nobody but a person's eye to find the angle.
    pub(super) fn shift_phase(&mut self, shift: i32) {
        if let Pace::Fixed(drive) = &mut self.pace {
            drive.shift(Turns(shift as u32));
        }
    }

    /// Frames that come as video say which they are.
    #[cold]
    pub(super) fn mark(&mut self, at: Nanos, number: Option<u32>) {
        if let (Pace::Video(video), Some(frame)) = (&mut self.pace, self.projector.after_pulse(at)) {
            video.mark(frame, number);
        }
    }

    /// Whether the frame after the one on screen may be lit: not where the picture is turned in it, nor where nobody knows which it is. Call once
    /// a frame.
    pub(super) fn may_show(&mut self, on_screen: &ClockReading) -> bool {
        match &mut self.pace {
            Pace::Fixed(drive) => !drive.turns_picture(self.frames.after(on_screen.frame, 1 + drive.slot())),
            Pace::Video(video) => {
                let next = (on_screen.serial.wrapping_add(1), self.frames.after(on_screen.frame, 1));
                // One in doubt leaves a gap in the turn, unless the turn began with it.
                !matches!(video.known(next), Known::Nothing | Known::Doubtful(0))
            }
            _ => true,
        }
    }

    /// A frame whose mark does not say that it is the one that is due stays dark, within a turn that goes on.
    pub(super) fn blank_doubtful(&self, output: &mut Output) {
        if let Pace::Video(video) = &self.pace
            && video.is_doubtful()
        {
            output.armed = Some(Frame::Dark);
        }
    }

    pub(super) fn is_measured(&self) -> bool {
        !matches!(self.pace, Pace::Fixed(_))
    }

    /// Whether the mirror is known to stand.
    pub(super) fn is_parked(&self) -> bool {
        match &self.pace {
            Pace::Fixed(drive) => !drive.has_driven(),
            _ => !self.rotation.is_moving(),
        }
    }

    /// Where the mirror is, as progress, and how fast it turns in its direction.
    pub(super) fn believed(&self) -> (Turns, f32) {
        match &self.pace {
            Pace::Fixed(drive) => (drive.angle(), drive.speed()),
            _ => (self.rotation.angle(), self.rotation.speed()),
        }
    }

    /// The mirror's phase ahead of what is on screen.
    pub(super) fn error_slices(&self) -> f32 {
        match &self.pace {
            Pace::Frame | Pace::Video(_) => self.lock.error_slices(),
            Pace::Sensor(follower) => self.error_to(self.last_tick.and_then(|now| follower.reading(now))),
            Pace::Fixed(_) => 0.0,
        }
    }

    /// The same, of a mirror that leads; 0 where nothing is on screen.
    fn error_to(&self, reading: Option<ClockReading>) -> f32 {
        reading.map_or(0.0, |reading| {
            let place = self.frames.start(reading.frame) + self.frames.part(reading.fraction);
            radians_between(place, self.rotation.angle()) / self.config.slice_rad()
        })
    }

    pub(super) fn frame_rate_hz(&self) -> f32 {
        match &self.pace {
            Pace::Sensor(follower) => follower.speed() / self.config.frame_rad(),
            _ => 1e9 / self.projector.period_ns(),
        }
    }
}
