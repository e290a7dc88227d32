//! Which frame of the turn is on screen, where frames come as video and tell it by a mark
//! ([`frame_mark`](protocol::frame_mark)): the lock onto their numbers.
//!
//! A frame is known where its own mark names the number that those before it foretell; every other is to stay dark, so that no single
//! wrong mark lights a plane in a wrong place. A mark that is lost or wrong costs its own frame. Another count (a graphics card that
//! slipped, a host that began anew) is taken up when [`AGREEING`] marks in a row have kept it; a count that nobody has kept for a turn is
//! given up.

use crate::frames::Frames;
use protocol::timing::Rotation;

/// Frames whose marks must count on from one to the next before they are believed.
pub const AGREEING: u32 = 3;

/// What is known of the frame that begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Known {
    /// No count is known: dark.
    Nothing,
    /// It should be this one by the count, and its mark does not say so: dark.
    Doubtful(u32),
    /// It is this one.
    Frame(u32),
}

/// The count of frames, by their marks.
#[derive(Clone, Copy, Debug)]
pub struct VideoIndex {
    frames: Frames,
    /// The number of the next frame.
    next: Option<u32>,
    /// Frames in a row that did not keep it.
    astray: u32,
    /// A count that contradicts it: the number of its next frame, and how many have kept it.
    rival: (u32, u32),
}

impl VideoIndex {
    /// Knows nothing yet.
    pub fn new(rotation: &Rotation) -> Self {
        Self { frames: Frames::of(rotation), next: None, astray: 0, rival: (0, 0) }
    }

    /// A frame begins whose mark is `mark`, if it has one that can be read. Call once a frame, also where its pulse was lost.
    pub fn frame(&mut self, mark: Option<u32>) -> Known {
        let mark = mark.filter(|number| *number < self.frames.count());
        if let Some(number) = mark.filter(|number| self.next == Some(*number)) {
            self.follow(number);
            return Known::Frame(number);
        }
        let kept = match mark {
            Some(number) if self.rival.1 > 0 && self.rival.0 == number => self.rival.1 + 1,
            Some(_) => 1,
            None => 0,
        };
        self.rival = (self.frames.after(mark.unwrap_or(0), 1), kept);
        if let Some(number) = mark.filter(|_| kept >= AGREEING) {
            self.follow(number);
            return Known::Frame(number);
        }
        self.astray = self.astray.saturating_add(1);
        let expected = self.next.filter(|_| self.astray <= self.frames.count().max(AGREEING));
        self.next = expected.map(|number| self.frames.after(number, 1));
        expected.map_or(Known::Nothing, Known::Doubtful)
    }

    fn follow(&mut self, number: u32) {
        self.next = Some(self.frames.after(number, 1));
        (self.astray, self.rival) = (0, (0, 0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use protocol::timing::Direction;
    use protocol::units::Turns;
    use std::vec::Vec;

    fn index(frames: u32) -> VideoIndex {
        VideoIndex::new(&Rotation::new(24 * frames, 24, 240_000_000, Turns::ZERO, Direction::Clockwise).unwrap())
    }

    fn told(marks: &[Option<u32>]) -> Vec<Known> {
        let mut index = index(12);
        marks.iter().map(|mark| index.frame(*mark)).collect()
    }

    #[test]
    fn three_marks_that_count_on_are_believed() {
        use Known::{Frame, Nothing};
        let marks = [Some(10), Some(11), Some(0), Some(1)];
        assert_eq!(told(&marks), [Nothing, Nothing, Frame(0), Frame(1)]);
        assert_eq!(told(&[Some(4), Some(4), Some(5), None, Some(7), Some(8)]), [Nothing; 6]);
        assert_eq!(told(&[Some(12), Some(13), Some(14), Some(15)]), [Nothing; 4]);
    }

    #[test]
    fn one_wrong_or_lost_mark_costs_its_own_frame() {
        use Known::{Doubtful, Frame};
        for bad in [None, Some(0), Some(6), Some(4_095)] {
            let marks: Vec<_> = [3, 4, 5].map(Some).into_iter().chain([bad, Some(7), Some(8)]).collect();
            let expected = if bad == Some(6) { Frame(6) } else { Doubtful(6) };
            assert_eq!(told(&marks)[2..], [Frame(5), expected, Frame(7), Frame(8)]);
        }
    }

    #[test]
    fn another_count_is_taken_up_and_none_is_given_up() {
        use Known::{Doubtful, Frame, Nothing};
        // A frame was shown twice, and the count went on from there.
        let marks = [3, 4, 5, 5, 6, 7, 8].map(Some);
        assert_eq!(told(&marks)[2..], [Frame(5), Doubtful(6), Doubtful(7), Frame(7), Frame(8)]);
        let silent = told(&[&marks[..3], &[None; 14]].concat());
        assert_eq!(silent[14], Doubtful(5));
        assert_eq!(silent[15..], [Nothing; 2]);
        // Nor does it hide the true count that a wrong one came between.
        assert_eq!(told(&[Some(3), Some(4), Some(9), Some(6), Some(7), Some(8)]).last(), Some(&Frame(8)));
    }

    proptest! {
        /// Whatever is read, a frame is known only where its own mark says so and two marks before it, or the count, foretold it.
        #[test]
        fn nothing_is_known_that_its_mark_does_not_say(marks in prop::collection::vec(prop::option::of(0u32..5), 1..200)) {
            let mut index = index(4);
            let mut lit = 0;
            for (place, mark) in marks.iter().enumerate() {
                match index.frame(*mark) {
                    Known::Frame(number) => {
                        prop_assert_eq!(*mark, Some(number));
                        lit += 1;
                        let ran = place >= 2 && (0..3).all(|back| marks[place - back] == Some((number + 8 - back as u32) % 4));
                        prop_assert!(lit > 1 || ran);
                    }
                    Known::Doubtful(number) => prop_assert!(number < 4 && lit > 0),
                    Known::Nothing => {}
                }
            }
        }
    }
}
