//! Which plane of which turn is on screen. Two turns at most: one shown, one that waits for the index.

use crate::plane_store::{Plane, TurnHandle};
use protocol::timing::Rotation;

/// What the projector shows for the length of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Frame {
    /// Nothing.
    #[default]
    Dark,
    /// The slices of frame `frame` of the turn in `turn`, in order.
    Slices {
        /// The slot.
        turn: TurnHandle,
        /// The frame within the turn.
        frame: u16,
    },
    /// One slice in every plane, for service on the parked mirror.
    Still {
        /// The slot.
        turn: TurnHandle,
        /// The slice.
        slice: u16,
    },
}

impl Frame {
    /// What is on screen in plane `plane` of this frame.
    pub fn plane(self, rotation: &Rotation, plane: u32) -> Plane {
        match self {
            Self::Dark => Plane::Dark,
            Self::Slices { turn, frame } => {
                Plane::Slice { turn, slice: (u32::from(frame) * rotation.planes_per_frame() + plane) as u16 }
            }
            Self::Still { turn, slice } => Plane::Slice { turn, slice },
        }
    }
}

/// Holds the handles of the turn on screen and of the next one.
#[derive(Clone, Debug, Default)]
pub struct Sequencer {
    shown: Option<TurnHandle>,
    waiting: Option<TurnHandle>,
    leaving: Option<TurnHandle>,
    open: bool,
}

impl Sequencer {
    /// Of a turn that comes as video, for ever: no other is taken.
    pub fn of_video() -> Self {
        Self { shown: Some(TurnHandle::VIDEO), ..Self::default() }
    }

    fn is_of_video(&self) -> bool {
        self.shown == Some(TurnHandle::VIDEO)
    }

    /// A whole turn is in slot `turn`. Returns the handle of a turn that waited and is now passed over. A handle that is already held
    /// is not taken twice.
    pub fn ready(&mut self, turn: TurnHandle) -> Option<TurnHandle> {
        if [self.shown, self.waiting, self.leaving].contains(&Some(turn)) {
            return None;
        }
        if self.is_of_video() {
            return Some(turn);
        }
        self.waiting.replace(turn)
    }

    /// Decides what frame `frame` of the coming turn shows; call once a frame, while the frame before it is on screen. `lit`: whether
    /// the state allows light. Also returns the handle of a turn whose last frame is over.
    pub fn arm(&mut self, frame: u32, lit: bool) -> (Frame, Option<TurnHandle>) {
        let released = self.leaving.take();
        if !lit {
            self.open = false;
            return (Frame::Dark, released);
        }
        if frame == 0 {
            if let Some(next) = self.waiting.take() {
                self.leaving = self.shown.replace(next);
            }
            self.open = true;
        }
        match self.shown {
            Some(turn) if self.open => (Frame::Slices { turn, frame: frame as u16 }, released),
            _ => (Frame::Dark, released),
        }
    }

    /// Shows slice `slice` of the current turn on the parked mirror: of the one shown last, else of the one that waits.
    pub fn still(&mut self, slice: u16) -> (Frame, Option<TurnHandle>) {
        let released = self.leaving.take();
        self.open = false;
        if self.shown.is_none() {
            self.shown = self.waiting.take();
        }
        (self.shown.map_or(Frame::Dark, |turn| Frame::Still { turn, slice }), released)
    }

    /// Gives back the turns that it holds; of three, the third with the next call.
    pub fn vacate(&mut self) -> [Option<TurnHandle>; 2] {
        self.open = false;
        if self.is_of_video() {
            return [None; 2];
        }
        let mut held = [&mut self.leaving, &mut self.waiting, &mut self.shown].into_iter().filter_map(Option::take);
        [held.next(), held.next()]
    }

    /// Light is not allowed: the turn may only begin again at the index.
    pub fn close(&mut self) {
        self.open = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    #[test]
    fn a_turn_is_shown_from_the_index_and_released_after_its_last_frame() {
        let mut sequencer = Sequencer::default();
        let (a, b) = (TurnHandle(0), TurnHandle(1));
        assert_eq!(sequencer.ready(a), None);
        assert_eq!(sequencer.arm(2, true), (Frame::Dark, None));
        assert_eq!(sequencer.arm(0, true), (Frame::Slices { turn: a, frame: 0 }, None));
        assert_eq!(sequencer.ready(b), None);
        assert_eq!(sequencer.arm(1, true), (Frame::Slices { turn: a, frame: 1 }, None));
        assert_eq!(sequencer.arm(2, true), (Frame::Slices { turn: a, frame: 2 }, None));
        assert_eq!(sequencer.arm(0, true), (Frame::Slices { turn: b, frame: 0 }, None));
        assert_eq!(sequencer.arm(1, true), (Frame::Slices { turn: b, frame: 1 }, Some(a)));
    }

    #[test]
    fn a_newer_turn_passes_one_that_waits() {
        let mut sequencer = Sequencer::default();
        assert_eq!(sequencer.ready(TurnHandle(0)), None);
        assert_eq!(sequencer.ready(TurnHandle(0)), None);
        assert_eq!(sequencer.ready(TurnHandle(1)), Some(TurnHandle(0)));
        assert_eq!(sequencer.still(7), (Frame::Still { turn: TurnHandle(1), slice: 7 }, None));
    }

    #[test]
    fn video_stays_and_takes_no_turn() {
        let (mut sequencer, turn) = (Sequencer::of_video(), TurnHandle::VIDEO);
        assert_eq!(sequencer.ready(TurnHandle(1)), Some(TurnHandle(1)));
        assert_eq!(sequencer.arm(2, true), (Frame::Dark, None));
        assert_eq!(sequencer.arm(0, true), (Frame::Slices { turn, frame: 0 }, None));
        assert_eq!((sequencer.vacate(), sequencer.arm(1, true)), ([None; 2], (Frame::Dark, None)));
        assert_eq!(sequencer.still(3), (Frame::Still { turn, slice: 3 }, None));
    }

    #[derive(Clone, Debug)]
    enum Action {
        Ready(u8),
        Arm(u32, bool),
        Jump(u32),
        Still(u16),
        Vacate,
        Close,
    }

    fn action() -> impl Strategy<Value = Action> {
        prop_oneof![
            2 => (0u8..4).prop_map(Action::Ready),
            6 => (1u32..2, prop::bool::weighted(0.9)).prop_map(|(step, lit)| Action::Arm(step, lit)),
            1 => (0u32..6).prop_map(Action::Jump),
            1 => (0u16..144).prop_map(Action::Still),
            1 => Just(Action::Vacate),
            1 => Just(Action::Close),
        ]
    }

    proptest! {
        #[test]
        fn it_never_tears_and_gives_back_each_turn_once(actions in prop::collection::vec(action(), 1..200)) {
            let mut sequencer = Sequencer::default();
            let mut held: Vec<TurnHandle> = Vec::new();
            let mut frame = 0;
            let mut last: Option<(TurnHandle, u32)> = None;
            for action in actions {
                let (shown, released) = match action {
                    Action::Ready(turn) => {
                        let known = held.contains(&TurnHandle(turn));
                        let released = sequencer.ready(TurnHandle(turn));
                        if !known {
                            held.push(TurnHandle(turn));
                        }
                        (None, released)
                    }
                    Action::Arm(step, lit) => {
                        frame = (frame + step) % 6;
                        let (shown, released) = sequencer.arm(frame, lit);
                        prop_assert!(lit || shown == Frame::Dark);
                        (Some(shown), released)
                    }
                    Action::Jump(to) => {
                        frame = to;
                        last = None;
                        sequencer.close();
                        (None, None)
                    }
                    Action::Still(slice) => {
                        last = None;
                        let (shown, released) = sequencer.still(slice);
                        let still = matches!(shown, Frame::Dark | Frame::Still { .. });
                        prop_assert!(still);
                        (None, released)
                    }
                    Action::Vacate => {
                        last = None;
                        let first = sequencer.vacate();
                        let given: Vec<_> = first.into_iter().chain(sequencer.vacate()).flatten().collect();
                        prop_assert_eq!(given.len(), held.len(), "all of them, once");
                        prop_assert!(given.iter().all(|turn| held.contains(turn)));
                        held.clear();
                        (None, None)
                    }
                    Action::Close => {
                        last = None;
                        sequencer.close();
                        (None, None)
                    }
                };
                if let Some(turn) = released {
                    prop_assert!(held.contains(&turn), "released what was not held");
                    held.retain(|&kept| kept != turn);
                }
                prop_assert!(held.len() <= 3);
                match shown {
                    Some(Frame::Slices { turn, frame: shown }) => {
                        prop_assert_eq!(u32::from(shown), frame);
                        prop_assert!(held.contains(&turn), "shows what was given back");
                        match last {
                            // Within a rotation the turn stays; a rotation begins at frame 0.
                            Some((before, _)) if shown != 0 => prop_assert_eq!(before, turn),
                            _ => prop_assert_eq!(shown, 0),
                        }
                        last = Some((turn, frame));
                    }
                    Some(_) => last = None,
                    None => {}
                }
            }
        }
    }
}
