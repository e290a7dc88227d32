//! Whether what is lit is what the host sent, plane by plane, and as soon as it may be.

use super::sender::Sender;
use crate::checkers::Flash;
use firmware::plane_store::{Plane, TurnHandle};
use protocol::timing::Rotation;
use protocol::units::Nanos;

/// More complaints than this are of no interest.
const COMPLAINTS_MAX: usize = 5;

/// Sees every flash, in order.
#[derive(Clone, Debug)]
pub struct Witness {
    frame: Nanos,
    /// The number of the turn that is shown.
    pub shown: Option<u32>,
    /// What was lit and should not have been.
    pub wrong: Vec<String>,
}

impl Witness {
    /// Nothing has been lit.
    pub fn new(rotation: &Rotation) -> Self {
        Self { frame: Nanos(rotation.frame_nanos()), shown: None, wrong: Vec::new() }
    }

    /// Judges one flash. `check_of` tells what lies in the store.
    ///
    /// A turn is armed within the frame before its first: what was whole before that frame must be shown, what is not whole at the first
    /// plane cannot be.
    pub fn see(&mut self, flash: &Flash, sender: &Sender, check_of: impl FnOnce(TurnHandle, u16) -> Option<u64>) {
        let Plane::Slice { turn, slice } = flash.plane else { return };
        let found = check_of(turn, slice);
        let is_of = |number: u32| found.is_some() && sender.check(number, slice) == found;
        if slice == 0 {
            let armed = flash.start - self.frame;
            let newest = sender.whole().filter(|whole| whole.at < flash.start).last();
            let due = sender.whole().filter(|whole| whole.at < armed).last();
            let candidates = [newest, due].into_iter().flatten().map(|whole| whole.number);
            self.shown = candidates.into_iter().find(|&number| is_of(number));
        }
        if !self.shown.is_some_and(is_of) && self.wrong.len() < COMPLAINTS_MAX {
            let at = flash.start.seconds();
            self.wrong.push(format!("{at:.6} s: slice {slice} of slot {} is not turn {:?}'s", turn.0, self.shown));
        }
    }
}
