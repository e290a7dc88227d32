//! What a board's control task does with what its interrupts queued: time without wraps, safety inputs first, one step after the other.

use crate::controller::{Input, Output};
use crate::conversation::Request;
use crate::fault_log::FaultLog;
use crate::hosted::Hosted;
use crate::safety::Levels;
use crate::time_base::TimeBase;
use core::num::NonZeroU32;

/// Something that happened. A capture is the time base's count at the edge itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The control timer fired, with the encoder at this count.
    Tick(u32),
    /// The index, captured.
    Index(u32),
    /// A frame pulse, captured.
    Frame(u32),
    /// A plane pulse, captured.
    Plane(u32),
    /// The host wants something.
    Request(Request),
}

/// The controller between a board's queue and its lines.
#[derive(Clone, Debug)]
pub struct Station {
    time: TimeBase,
    levels: Levels,
    hosted: Hosted,
}

impl Station {
    /// Around `hosted`. The time base counts up `hz` times a second.
    pub fn new(hosted: Hosted, hz: NonZeroU32) -> Self {
        Self { time: TimeBase::new(hz), levels: Levels::default(), hosted }
    }

    /// Takes `event`, which was queued when the time base showed `count`, or the news that a safety input changed. `levels` are looked
    /// at with every event: a change that woke nobody is seen at the next tick. Each output, two at most, is to
    /// be obeyed in order, after the log that comes with it has been kept.
    pub fn take(&mut self, count: u32, event: Option<Event>, levels: Levels, mut obey: impl FnMut(&Output, &FaultLog)) {
        let now = self.time.advance(count);
        if levels != core::mem::replace(&mut self.levels, levels) {
            let output = self.hosted.step(now, Input::Levels(levels));
            obey(&output, self.hosted.faults());
        }
        let input = match event {
            None => return,
            Some(Event::Tick(encoder_count)) => Input::Tick { encoder_count },
            Some(Event::Index(count)) => Input::IndexPulse { at: self.time.stamp(count) },
            Some(Event::Frame(count)) => Input::FramePulse { at: self.time.stamp(count) },
            Some(Event::Plane(count)) => Input::PlanePulse { at: self.time.stamp(count) },
            Some(Event::Request(request)) => {
                if let Some(output) = self.hosted.request(now, request) {
                    obey(&output, self.hosted.faults());
                }
                return;
            }
        };
        let output = self.hosted.step(now, input);
        obey(&output, self.hosted.faults());
    }

    /// The controller.
    pub fn hosted(&self) -> &Hosted {
        &self.hosted
    }
}

#[cfg(test)]
#[path = "station_tests.rs"]
mod tests;
