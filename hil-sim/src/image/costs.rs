//! What steps cost, in machine instructions.

use firmware::controller::Input;
use protocol::units::Nanos;
use std::collections::VecDeque;

/// The dearest one seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dearest {
    /// How many there were.
    pub count: u64,
    /// Instructions of the dearest.
    pub instructions: u64,
    /// When, by the controller's time.
    pub at: Nanos,
}

impl Dearest {
    fn add(&mut self, at: Nanos, instructions: u64) {
        self.count += 1;
        if instructions > self.instructions {
            (self.instructions, self.at) = (instructions, at);
        }
    }
}

/// What is told apart.
pub const KINDS: [&str; 5] = ["control tick", "frame pulse", "plane pulse", "index pulse", "anything else"];

/// Worst cases since the image booted.
#[derive(Clone, Debug, Default)]
pub struct Costs {
    kinds: [Dearest; KINDS.len()],
    plane: Dearest,
    plane_nanos: u64,
    recent: VecDeque<(Nanos, u64)>,
}

impl Costs {
    /// A run whose planes last `plane_nanos` begins; what was found before stays.
    pub fn begin(&mut self, plane_nanos: u64) {
        self.plane_nanos = plane_nanos;
        self.recent.clear();
    }

    /// A step at `now` took `instructions`.
    pub fn add(&mut self, now: Nanos, input: &Input, instructions: u64) {
        self.kinds[kind(input)].add(now, instructions);
        self.recent.push_back((now, instructions));
        while self.recent.front().is_some_and(|(at, _)| (now - *at).0 >= self.plane_nanos) {
            self.recent.pop_front();
        }
        self.plane.add(now, self.recent.iter().map(|(_, instructions)| instructions).sum());
    }

    /// The dearest step of each of [`KINDS`].
    pub fn kinds(&self) -> &[Dearest; KINDS.len()] {
        &self.kinds
    }

    /// The dearest stretch as long as a plane, wherever it begins: all steps in it.
    pub fn plane(&self) -> &Dearest {
        &self.plane
    }
}

fn kind(input: &Input) -> usize {
    match input {
        Input::Tick { .. } => 0,
        Input::FramePulse { .. } => 1,
        Input::PlanePulse { .. } => 2,
        Input::IndexPulse { .. } => 3,
        Input::Command(_) | Input::TurnReady(_) | Input::Levels(_) | Input::Vacate | Input::FrameMark { .. } => 4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_holds_every_step_of_its_length() {
        let mut costs = Costs::default();
        costs.begin(100);
        for (at, instructions) in [(0, 5), (60, 7), (99, 1), (100, 2), (159, 3), (300, 12)] {
            costs.add(Nanos(at), &Input::PlanePulse { at: Nanos(at) }, instructions);
        }
        assert_eq!(*costs.plane(), Dearest { count: 6, instructions: 13, at: Nanos(99) });
        assert_eq!(costs.kinds()[2], Dearest { count: 6, instructions: 12, at: Nanos(300) });
        assert_eq!(costs.kinds()[0].count, 0);
    }
}
