//! Turns to a device: handshake, acknowledgement, retries, back-pressure.

use crate::link::Link;
use conversation::{Answer, Conversation};
pub use error::StreamError;
use protocol::codec::{ByteStatistics, Compressor, Hint, ImageSize, Mask, plane_check};
use protocol::message::{
    Command, Configure, Control, Faults, Hello, Knowledge, LEARN_PART_BYTES, Learn, Message, Reason, SCHEMA, Status,
    VERSION,
};
use protocol::timing::Rotation;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

pub(crate) mod conversation;
mod error;
pub mod live;
pub mod mailbox;
mod round_trip;
mod sending;

/// A turn as a stream takes it.
pub trait TurnPlanes: Sync {
    /// Slices of the turn.
    fn slices(&self) -> u32;

    /// Slice `slice`, below [`slices`](Self::slices), in the layout of [`protocol::codec`]: one bit a pixel, rows from the top,
    /// each packed least significant bit first and padded to whole bytes.
    fn plane_bytes(&self, slice: u32) -> &[u8];

    /// How slice `slice` was halftoned, as far as that helps to compress it.
    fn hint(&self, _slice: u32) -> Hint {
        Hint::None
    }

    /// The ranks of the mask that [`hint`](Self::hint) speaks of, row by row.
    fn mask_ranks(&self) -> &[u16] {
        &[]
    }
}

/// A turn that the device has whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ticket {
    /// The turn's number, as in [`Status::turn_on_screen`].
    pub turn: u32,
}

/// What went over the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Turns that the device has acknowledged.
    pub turns: u64,
    /// Bytes of planes of those turns, expanded.
    pub bytes_raw: u64,
    /// Bytes sent, with framing and retries.
    pub bytes_on_wire: u64,
    /// Packets sent, with retries.
    pub packets: u64,
    /// Packets and planes that were sent again.
    pub retries: u64,
    /// Packets that the device refused, other than because it was busy.
    pub refused: u64,
    /// Planes that the device acknowledged, also those that it kept and those of turns that never became whole.
    pub planes: u64,
    /// Planes that the device kept from the turn before.
    pub planes_kept: u64,
    /// Planes that were on the device already when a turn went on after a lost link.
    pub planes_resumed: u64,
    /// From the beginning to the end of the acknowledged turns, without the waiting for room before: what a turn takes the link.
    pub sending: Duration,
}

/// The latest statistics and status of a stream. Clones are the same.
#[derive(Clone, Debug, Default)]
pub(crate) struct News(Arc<Mutex<(Statistics, Option<Status>)>>);

impl News {
    pub(crate) fn latest(&self) -> (Statistics, Option<Status>) {
        // Whole whatever became of whoever wrote it: it is written at once.
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn put(&self, statistics: Statistics, status: Option<Status>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = (statistics, status);
    }
}

/// A connection to a device that shows turns of one rotation and image size.
#[derive(Debug)]
pub struct Stream<L> {
    conversation: Conversation<L>,
    rotation: Rotation,
    size: ImageSize,
    turn: u32,
    compressor: Compressor,
    known: Known,
    /// The last turn that the device got whole.
    last: Option<Sent>,
    /// The turn that the device has some of.
    unfinished: Option<Sent>,
}

/// What the device was told, or has no room for.
#[derive(Debug, Default)]
struct Known {
    ranks: Vec<u16>,
    codes: bool,
}

/// How long a device whose mirror is at rest may take to give up turns of another cut.
const GIVEN_UP_WITHIN: Duration = Duration::from_millis(200);

/// Codes are learnt from every so many slices of the first turn that needs some.
const LEARN_EVERY: usize = 9;

/// A turn that was sent: its number, and [`plane_check`] of each slice.
#[derive(Clone, Debug)]
struct Sent {
    number: u32,
    checks: Vec<u64>,
}

impl<L: Link> Stream<L> {
    /// Greets the device and configures it. A device of another version or schema is refused, both named.
    pub fn new(link: L, rotation: &Rotation, size: ImageSize) -> Result<Self, StreamError> {
        // Not 0: a device that shows an earlier host's turn must not take it for one of this host's.
        let turn = link.now().as_micros() as u32;
        let mut stream = Self {
            conversation: Conversation::new(link),
            rotation: *rotation,
            size,
            turn,
            compressor: Compressor::new(size),
            known: Known::default(),
            last: None,
            unfinished: None,
        };
        stream.greet()?;
        Ok(stream)
    }

    /// Goes on over another `link` to the same device, or to one that was switched off and on meanwhile. A turn that was under way goes
    /// on where it is [submitted](Self::submit) again: only what did not arrive is sent.
    pub fn reconnect(&mut self, link: L) -> Result<(), StreamError> {
        self.conversation.replace(link);
        self.known = Known::default();
        self.compressor = Compressor::new(self.size);
        self.greet()
    }

    fn greet(&mut self) -> Result<(), StreamError> {
        hello(&mut self.conversation)?;
        configure(&mut self.conversation, &self.rotation, self.size)
    }

    /// Sends `turn` and returns when the device has it whole; it comes on screen at the next index. Waits while both slots of
    /// the device are full, at most four turns and a second. Planes that are those of the turn before are not sent.
    ///
    /// After an error the device keeps showing what it shows; the next turn starts afresh, or goes on where it is the same.
    pub fn submit(&mut self, turn: &impl TurnPlanes) -> Result<Ticket, StreamError> {
        self.submit_unless(turn, |_| false)
    }

    /// The same, but leaves the turn where `is_late`, which is told the link's time every now and then, says so.
    pub fn submit_unless(
        &mut self,
        turn: &impl TurnPlanes,
        is_late: impl FnMut(Duration) -> bool,
    ) -> Result<Ticket, StreamError> {
        let checks = self.check(turn)?;
        self.unfinished.take_if(|unfinished| unfinished.checks != checks);
        if self.unfinished.is_none() {
            self.turn = self.turn.wrapping_add(1);
        }
        self.teach(turn)?;
        let number = self.send_turn(turn, checks, is_late)?;
        let statistics = &mut self.conversation.statistics;
        statistics.turns += 1;
        statistics.bytes_raw += u64::from(turn.slices()) * self.size.plane_bytes() as u64;
        Ok(Ticket { turn: number })
    }

    /// What is known while a turn is sent, for whoever says [when one is late](Self::submit_unless).
    pub(crate) fn news(&self) -> News {
        self.conversation.news.clone()
    }

    /// Gives the controller an order and returns when the device has it.
    pub fn command(&mut self, command: Command) -> Result<(), StreamError> {
        self.conversation.ask(&Control { command }.into())
    }

    /// Waits up to `wait` for news and returns the latest status, if there ever was one.
    pub fn poll(&mut self, wait: Duration) -> Result<Option<Status>, StreamError> {
        self.conversation.listen(wait)?;
        self.conversation.answers.clear();
        Ok(self.conversation.status)
    }

    /// The latest status that came.
    pub fn status(&self) -> Option<&Status> {
        self.conversation.status.as_ref()
    }

    /// What the device remembers of its faults, if it has told.
    pub fn faults(&self) -> Option<&Faults> {
        self.conversation.faults.as_ref()
    }

    /// What went over the wire so far.
    pub fn statistics(&self) -> Statistics {
        self.conversation.statistics
    }

    /// The link.
    pub fn link(&self) -> &L {
        &self.conversation.link
    }

    /// The link, for a simulation's far end. Bytes that are taken from it here are lost to the stream.
    pub fn link_mut(&mut self) -> &mut L {
        &mut self.conversation.link
    }

    /// Ends the stream; the device keeps what it has.
    pub fn into_link(self) -> L {
        self.conversation.link
    }

    /// [`plane_check`] of each slice of a turn that fits the configuration.
    fn check(&self, turn: &impl TurnPlanes) -> Result<Vec<u64>, StreamError> {
        let (slices, expected) = (turn.slices(), self.rotation.slices());
        if slices != expected {
            return Err(StreamError::Slices { slices, expected });
        }
        let check = |slice| {
            let plane = turn.plane_bytes(slice);
            let (bytes, expected) = (plane.len(), self.size.plane_bytes());
            if bytes == expected {
                Ok(plane_check(plane))
            } else {
                Err(StreamError::PlaneBytes { slice, bytes, expected })
            }
        };
        (0..slices).map(check).collect()
    }

    /// Tells the device what the planes of `turn` are compressed by, where it does not know it. A device that cannot keep it gets runs.
    fn teach(&mut self, turn: &impl TurnPlanes) -> Result<(), StreamError> {
        let ranks = turn.mask_ranks();
        let mut mask = Mask::NONE;
        if !ranks.is_empty() && ranks != self.known.ranks {
            let bytes: Vec<u8> = ranks.iter().flat_map(|rank| rank.to_le_bytes()).collect();
            let is_mask = mask.set(ranks.iter().copied()).is_ok();
            if is_mask && self.learn(Knowledge::Mask, &bytes)? {
                self.compressor.set_mask(mask);
            }
            self.known.ranks = ranks.to_vec();
        }
        let needs_codes = (0..turn.slices()).any(|slice| turn.hint(slice) == Hint::Diffusion);
        if needs_codes && !self.known.codes {
            let mut statistics = ByteStatistics::default();
            (0..turn.slices())
                .step_by(LEARN_EVERY)
                .for_each(|slice| statistics.add(turn.plane_bytes(slice), self.size.row_bytes()));
            let lengths = statistics.lengths();
            if self.learn(Knowledge::Codes, &lengths)? {
                // Complete, as they were made to be.
                let _ = self.compressor.set_codes(&lengths);
            }
            self.known.codes = true;
        }
        Ok(())
    }

    /// Whether the device keeps it.
    fn learn(&mut self, kind: Knowledge, bytes: &[u8]) -> Result<bool, StreamError> {
        // At most 8 KiB of both kinds.
        let total = bytes.len() as u16;
        for (offset, bytes) in (0..).step_by(LEARN_PART_BYTES).zip(bytes.chunks(LEARN_PART_BYTES)) {
            let message = Message::from(Learn { kind, offset, total, bytes });
            match self.conversation.request(&message)? {
                Answer::Nack(Reason::NotLearnt) => return Ok(false),
                answer => self.conversation.accepted(&message, answer)?,
            }
        }
        Ok(true)
    }
}

/// Greets a device; one of another version or schema is refused, both named.
fn hello<L: Link>(conversation: &mut Conversation<L>) -> Result<(), StreamError> {
    conversation.greet()?;
    match conversation.request(&Hello { version: VERSION, schema: SCHEMA }.into())? {
        Answer::Hello { version, schema } if schema != SCHEMA => {
            Err(StreamError::Schema { device_version: version, device_schema: schema })
        }
        _ => Ok(()),
    }
}

/// Has the device take turns of this cut. Where its mirror is at rest, it gives up turns of another one when asked, and is asked again.
fn configure<L: Link>(
    conversation: &mut Conversation<L>,
    rotation: &Rotation,
    size: ImageSize,
) -> Result<(), StreamError> {
    let message = Configure::new(rotation, size).into();
    let until = conversation.link.now() + GIVEN_UP_WITHIN;
    loop {
        match conversation.request(&message)? {
            Answer::Nack(Reason::Busy) if conversation.link.now() >= until => return Err(StreamError::OtherTurns),
            Answer::Nack(Reason::Busy) => conversation.listen(GIVEN_UP_WITHIN / 20)?,
            answer => return conversation.accepted(&message, answer),
        }
    }
}

/// Gives the controller an order, whatever it shows, and returns what it does then, if it says so within `wait`.
pub fn order<L: Link>(link: L, command: Command, wait: Duration) -> Result<Option<Status>, StreamError> {
    let mut conversation = Conversation::new(link);
    hello(&mut conversation)?;
    conversation.ask(&Control { command }.into())?;
    let until = conversation.link.now() + wait;
    while conversation.link.now() < until {
        conversation.listen(until.saturating_sub(conversation.link.now()))?;
    }
    Ok(conversation.status)
}

#[cfg(test)]
mod tests;
