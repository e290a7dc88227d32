//! What a drive that keeps its own speed is told, so that its mirror keeps step with the projector's clock.
//!
//! Nothing measures the mirror: it is taken to be where the drive was told to turn it to, but for an angle that nobody knows. What was told
//! is exact, so that no rounding adds up, and follows the clock's phase, not its rate alone, so that nothing drifts.

use crate::angle::{RADIANS_PER_STEP, radians_between};
use crate::config::Config;
use crate::frames::Frames;
use crate::velocity_lock::Reference;
use core::f32::consts::TAU;
use protocol::units::{Nanos, Turns};

/// The ramp and what follows it. Not inlined, as [`Follower`](crate::follower::Follower).
#[derive(Clone, Debug)]
pub struct SpeedCommand {
    frames: Frames,
    slice_rad: f32,
    acceleration: f32,
    settle: Nanos,
    speed: f32,
    last: Option<Nanos>,
    /// Where the drive has been told to turn to since the reset, in 2⁻⁶⁴ turn.
    told: u64,
    /// Where in that a turn begins.
    origin: Turns,
    slot: u32,
    at_speed: bool,
    error: f32,
    gap: f32,
    steady_since: Option<Nanos>,
    shift: Turns,
    shift_due: bool,
    driven: bool,
}

/// By this share of the speed the told phase is trimmed at most, and so fast where less is needed, 1/s.
const TRIM_SHARE: f32 = 0.01;
const TRIM_RATE: f32 = 10.0;
/// A clock that is off by more is another rate.
const LOST_SHARE: f32 = 0.02;
/// In place: the told phase is this close to the clock's, slices.
const STEADY_SLICES: f32 = 0.05;

impl SpeedCommand {
    /// Stands.
    pub fn new(config: &Config) -> Self {
        Self {
            frames: Frames::of(&config.rotation),
            slice_rad: config.slice_rad(),
            acceleration: config.speed_drive.acceleration_rad_s2,
            settle: config.speed_drive.settle,
            speed: 0.0,
            last: None,
            told: 0,
            origin: Turns::ZERO,
            slot: 0,
            at_speed: false,
            error: 0.0,
            gap: 0.0,
            steady_since: None,
            shift: Turns::ZERO,
            shift_due: false,
            driven: false,
        }
    }

    /// Lets go of the mirror: where it is from now on is not known.
    pub fn release(&mut self) {
        (self.speed, self.last, self.at_speed, self.steady_since) = (0.0, None, false, None);
    }

    /// The speed until the next tick, rad/s in the mirror's direction. Without a reference it stays what it is.
    #[inline(never)]
    pub fn tick(&mut self, now: Nanos, reference: Option<Reference>) -> f32 {
        self.driven = true;
        let seconds = self.last.replace(now).map_or(0.0, |last| (now - last).0 as f64 * 1e-9);
        let turns = f64::from(self.speed) * seconds / core::f64::consts::TAU;
        self.told = self.told.wrapping_add((turns * 18_446_744_073_709_551_616.0) as u64);
        let Some(reference) = reference else {
            self.steady_since = None;
            return self.speed;
        };
        self.gap = self.speed - reference.speed;
        let step = self.acceleration * seconds as f32;
        if !self.at_speed && self.gap.abs() <= step {
            self.at_speed = true;
            self.error = self.error(reference);
            self.land();
        }
        self.at_speed &= self.gap.abs() <= LOST_SHARE * reference.speed;
        self.error = self.error(reference);
        let trim = if self.at_speed { within(TRIM_RATE * self.error, TRIM_SHARE * reference.speed) } else { 0.0 };
        self.speed += within(reference.speed - trim - self.speed, step);
        let steady = self.at_speed && self.error_slices().abs() < STEADY_SLICES;
        self.steady_since = steady.then(|| self.steady_since.unwrap_or(now));
        self.speed
    }

    /// Turns the picture by `shift`, in the mirror's direction, from the next start of a turn on.
    pub fn shift(&mut self, shift: Turns) {
        self.shift += shift;
    }

    /// Whether the picture is turned in frame `next` of the turn, which must then be dark. Call once a frame, during the one before: what
    /// was due in the frame on screen is done. The nearest frame is another one then, and the drive is told to make up for the rest.
    #[inline(never)]
    pub fn turns_picture(&mut self, next: u32) -> bool {
        if self.shift_due {
            let shift = core::mem::take(&mut self.shift);
            self.origin += shift;
            self.error -= shift.signed_from(Turns::ZERO) as f32 * RADIANS_PER_STEP;
            self.steady_since = None;
            self.land();
        }
        self.shift_due = next == 0 && self.shift != Turns::ZERO;
        self.shift_due
    }

    /// By how many frames of a turn the told phase is ahead of the projector's count of frames.
    pub fn slot(&self) -> u32 {
        self.slot
    }

    /// What the drive is told, rad/s in the mirror's direction.
    pub fn speed(&self) -> f32 {
        self.speed
    }

    /// Whether the ramp is over.
    pub fn is_at_speed(&self) -> bool {
        self.at_speed
    }

    /// Whether the drive has been told the right phase for as long as it takes to settle.
    pub fn is_settled(&self, now: Nanos) -> bool {
        self.steady_since.is_some_and(|since| now - since >= self.settle)
    }

    /// Whether the drive has been told to turn since the reset: then nobody knows whether the mirror stands.
    pub fn has_driven(&self) -> bool {
        self.driven
    }

    /// By how much the told phase is ahead of the clock's, slices.
    pub fn error_slices(&self) -> f32 {
        self.error / self.slice_rad
    }

    /// By how much the told speed is ahead of the clock's, slices a second.
    pub fn rate_slices_s(&self) -> f32 {
        self.gap / self.slice_rad
    }

    /// Where the mirror is said to be, as progress since the start of a turn.
    pub fn angle(&self) -> Turns {
        Turns((self.told >> 32) as u32) - self.origin
    }

    fn error(&self, reference: Reference) -> f32 {
        radians_between(reference.angle + self.frames.start(self.slot), self.angle())
    }

    /// The nearest frame of all is the one that belongs here: the picture stays where it is when the rate steps.
    fn land(&mut self) {
        let spacing = TAU / self.frames.count() as f32;
        self.slot = self.frames.moved(self.slot, libm::roundf(self.error / spacing) as i32);
    }
}

/// `value`, or the nearest that is no more than `most` from 0. Not `clamp`, which may panic.
fn within(value: f32, most: f32) -> f32 {
    value.max(-most).min(most)
}

#[cfg(test)]
#[path = "speed_command_tests.rs"]
mod tests;
