//! Turn, frame, slice, plane: which picture belongs to which angle, in integers.

use crate::units::Turns;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The way in which the mirror turns, seen from above.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Direction {
    /// The mirror's angle grows with time.
    #[default]
    CounterClockwise,
    /// The mirror's angle falls with time.
    Clockwise,
}

/// How a turn is cut into slices and frames. Checked on construction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rotation {
    slices: u16,
    planes_per_frame: u16,
    refresh_microhertz: u64,
    phase_offset: Turns,
    direction: Direction,
}

/// Why a rotation is impossible.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum RotationError {
    /// See the message.
    #[error("slices = {0}: must be from 1 to 4096")]
    Slices(u32),
    /// See the message.
    #[error("planes_per_frame = {0}: must be 24, the bits of an RGB8 pixel")]
    PlanesPerFrame(u32),
    /// See the message.
    #[error("slices = {slices}: must be a multiple of planes_per_frame = {planes_per_frame}")]
    NotWholeFrames {
        /// Slices a turn.
        slices: u32,
        /// Planes a frame.
        planes_per_frame: u32,
    },
    /// See the message.
    #[error("refresh_hz: must be from 1 to 10000")]
    Refresh,
}

impl Rotation {
    /// The most slices in a turn: 170 frames of 24, far beyond any projector, and small enough for fixed buffers.
    pub const SLICES_MAX: u32 = 4096;
    /// Bits of an RGB8 pixel.
    pub const PLANES_PER_FRAME: u32 = 24;

    /// `refresh_microhertz`: frames in 10⁶ seconds. `phase_offset`: the mirror angle at the index pulse.
    pub const fn new(
        slices: u32,
        planes_per_frame: u32,
        refresh_microhertz: u64,
        phase_offset: Turns,
        direction: Direction,
    ) -> Result<Self, RotationError> {
        if slices == 0 || slices > Self::SLICES_MAX {
            return Err(RotationError::Slices(slices));
        }
        if planes_per_frame != Self::PLANES_PER_FRAME {
            return Err(RotationError::PlanesPerFrame(planes_per_frame));
        }
        if !slices.is_multiple_of(planes_per_frame) {
            return Err(RotationError::NotWholeFrames { slices, planes_per_frame });
        }
        if refresh_microhertz < 1_000_000 || refresh_microhertz > 10_000_000_000 {
            return Err(RotationError::Refresh);
        }
        Ok(Self {
            slices: slices as u16,
            planes_per_frame: planes_per_frame as u16,
            refresh_microhertz,
            phase_offset,
            direction,
        })
    }

    /// Slices a turn.
    pub const fn slices(&self) -> u32 {
        self.slices as u32
    }

    /// Planes a frame: 24.
    pub const fn planes_per_frame(&self) -> u32 {
        self.planes_per_frame as u32
    }

    /// Frames a turn.
    pub const fn frames(&self) -> u32 {
        // Never divided by 0, which the compiler cannot know: no image shall have a panic for it.
        match self.slices().checked_div(self.planes_per_frame()) {
            Some(frames) => frames,
            None => 0,
        }
    }

    /// The projector's nominal frame rate, in 10⁻⁶ Hz.
    pub const fn refresh_microhertz(&self) -> u64 {
        self.refresh_microhertz
    }

    /// The mirror angle at the index pulse.
    pub const fn phase_offset(&self) -> Turns {
        self.phase_offset
    }

    /// The way in which the mirror turns.
    pub const fn direction(&self) -> Direction {
        self.direction
    }

    /// The nominal duration of a frame, rounded down.
    pub const fn frame_nanos(&self) -> u64 {
        // As in `frames`.
        match 1_000_000_000_000_000u64.checked_div(self.refresh_microhertz) {
            Some(nanos) => nanos,
            None => 0,
        }
    }

    /// The nominal duration of plane 0 … `planes` of a frame together, rounded down.
    pub const fn planes_nanos(&self, planes: u32) -> u64 {
        (planes as u128 * 1_000_000_000_000_000 / (self.refresh_microhertz as u128 * self.planes_per_frame as u128))
            as u64
    }

    /// The frame that slice `slice` is in, and its plane there.
    pub const fn frame_and_plane(&self, slice: u32) -> (u32, u32) {
        (slice / self.planes_per_frame(), slice % self.planes_per_frame())
    }

    /// How far the mirror has turned since the index, in its own direction, at mirror angle `angle`.
    pub fn progress(&self, angle: Turns) -> Turns {
        match self.direction {
            Direction::CounterClockwise => angle - self.phase_offset,
            Direction::Clockwise => self.phase_offset - angle,
        }
    }

    /// The inverse of [`Rotation::progress`].
    pub fn angle(&self, progress: Turns) -> Turns {
        match self.direction {
            Direction::CounterClockwise => self.phase_offset + progress,
            Direction::Clockwise => self.phase_offset - progress,
        }
    }

    /// The slice that belongs to mirror angle `angle`.
    pub fn slice_at(&self, angle: Turns) -> u32 {
        ((u64::from(self.progress(angle).0) * u64::from(self.slices)) >> 32) as u32
    }

    /// Where slice `slice` begins, as progress since the index.
    pub const fn slice_start(&self, slice: u32) -> Turns {
        // Rounded up, so that slice_at(angle(slice_start(k))) is k also where 2³² / slices is not whole.
        Turns((((slice % self.slices()) as u64) << 32).div_ceil(self.slices() as u64) as u32)
    }

    /// The mirror angle for which slice `slice` is rendered: the middle of its exposure, `2π (k + ½) / slices` past the index.
    pub fn slice_middle(&self, slice: u32) -> Turns {
        self.angle(Turns::fraction(u64::from(slice) * 2 + 1, u64::from(self.slices) * 2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn rotation(slices: u32, offset: u32, direction: Direction) -> Rotation {
        Rotation::new(slices, 24, 240_000_000, Turns(offset), direction).unwrap()
    }

    #[test]
    fn twenty_turns_a_second() {
        let rotation = rotation(288, 0, Direction::CounterClockwise);
        assert_eq!(rotation.frames(), 12);
        assert_eq!(rotation.frame_nanos(), 4_166_666);
        assert_eq!(rotation.planes_nanos(1), 173_611);
        assert_eq!(rotation.planes_nanos(288), 50_000_000);
        assert_eq!(rotation.frame_and_plane(25), (1, 1));
    }

    #[test]
    fn impossible_rotations_are_refused() {
        let new = |slices, planes, refresh| Rotation::new(slices, planes, refresh, Turns::ZERO, Direction::Clockwise);
        assert_eq!(new(0, 24, 240_000_000), Err(RotationError::Slices(0)));
        assert_eq!(new(100, 24, 240_000_000), Err(RotationError::NotWholeFrames { slices: 100, planes_per_frame: 24 }));
        assert_eq!(new(288, 16, 240_000_000), Err(RotationError::PlanesPerFrame(16)));
        assert_eq!(new(288, 24, 0), Err(RotationError::Refresh));
    }

    proptest! {
        #[test]
        fn every_angle_has_the_slice_that_starts_before_it(
            frames in 1u32..=170, offset: u32, clockwise: bool, slice: prop::sample::Index, within in 0.0f64..1.0,
        ) {
            let direction = if clockwise { Direction::Clockwise } else { Direction::CounterClockwise };
            let rotation = rotation(frames * 24, offset, direction);
            let slice = slice.index(rotation.slices() as usize) as u32;
            let start = rotation.slice_start(slice);
            prop_assert_eq!(rotation.slice_at(rotation.angle(start)), slice);
            let inside = start + Turns((within * 4_294_967_296.0 / f64::from(rotation.slices()) - 2.0).max(0.0) as u32);
            prop_assert_eq!(rotation.slice_at(rotation.angle(inside)), slice);
            prop_assert_eq!(rotation.slice_at(rotation.slice_middle(slice)), slice);
            prop_assert_eq!(rotation.angle(rotation.progress(Turns(offset))), Turns(offset));
        }
    }
}
