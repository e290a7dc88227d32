//! The frames of a turn, as places on a ring.

use core::num::NonZeroU16;
use protocol::timing::Rotation;
use protocol::units::Turns;

/// How many there are; never none, so that nothing here divides by 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frames {
    count: NonZeroU16,
    /// 2⁶⁴ over the count: the whole turn is 2³² and the rest are digits.
    scale: u64,
}

impl Frames {
    /// A turn that is one frame.
    pub const ONE: Self = Self { count: NonZeroU16::MIN, scale: u64::MAX };

    /// Those of `rotation`.
    pub fn of(rotation: &Rotation) -> Self {
        let count = NonZeroU16::new(rotation.frames() as u16).unwrap_or(NonZeroU16::MIN);
        Self { count, scale: u64::MAX / u64::from(count.get()) }
    }

    /// How many.
    pub fn count(self) -> u32 {
        self.count.get().into()
    }

    /// The frame that is `by` after `frame`.
    pub fn after(self, frame: u32, by: u32) -> u32 {
        frame.wrapping_add(by % self.count()) % self.count()
    }

    /// The frame that is `by` after `frame`, or before it where negative.
    pub fn moved(self, frame: u32, by: i32) -> u32 {
        (frame as i32).wrapping_add(by).rem_euclid(self.count() as i32) as u32
    }

    /// Where `frame` begins, as progress since the index.
    pub fn start(self, frame: u32) -> Turns {
        Turns(((u64::from(frame) * self.scale) >> 32) as u32)
    }

    /// The frame that `progress` lies in.
    pub fn at(self, progress: Turns) -> u32 {
        ((u64::from(progress.0) * u64::from(self.count.get())) >> 32) as u32
    }

    /// The width of `fraction` of a frame.
    pub fn part(self, fraction: f32) -> Turns {
        Turns((fraction * (self.scale >> 32) as f32) as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::timing::Direction;

    #[test]
    fn frames_go_round() {
        let rotation = Rotation::new(288, 24, 240_000_000, Turns::ZERO, Direction::Clockwise).unwrap();
        let frames = Frames::of(&rotation);
        assert_eq!(frames.count(), 12);
        assert_eq!((frames.after(11, 3), frames.moved(2, -5), frames.moved(0, 25)), (2, 9, 1));
        assert_eq!(frames.after(11, u32::MAX), (11 + u32::MAX % 12) % 12);
        for frame in 0..12 {
            let exact = Turns::fraction(u64::from(frame), 12);
            assert!(exact.signed_from(frames.start(frame)).abs() <= 1);
            assert_eq!(frames.at(exact + Turns(2)), frame);
            let half = Turns::fraction(u64::from(frame) * 2 + 1, 24);
            assert!(half.signed_from(frames.start(frame) + frames.part(0.5)).abs() <= 32);
        }
    }
}
