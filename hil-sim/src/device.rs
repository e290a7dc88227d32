//! The simulated controller's end of the wire, without any transport: bytes in, bytes out.
//!
//! Every packet of the host is answered by one packet. A turn comes on screen only if all its planes and the turn as a whole
//! have their checks; whatever else happens, what is on screen stays.

use crate::frame_store::MemoryStore;
use firmware::conversation::{ANSWER_BYTES_MAX, Conversation};
pub use firmware::conversation::{Counters, Report, Request as Input};
pub use firmware::plane_store::{Plane, TurnHandle};
use protocol::message::{Faults, Message, Reason};
use protocol::packet::{Counts, Decoder, PACKET_BYTES_MAX, encode};
use std::collections::VecDeque;

/// Something at the far end of a link, in simulated time.
pub trait Endpoint {
    /// Takes what the host sent.
    fn receive(&mut self, bytes: &[u8]);

    /// Gives what the host is to receive; empty where there is nothing.
    fn transmit(&mut self) -> Vec<u8>;

    /// Lets time pass.
    fn advance(&mut self, seconds: f64);
}

/// The device. The world feeds it ([`receive`](Endpoint::receive)), empties it ([`transmit`](Endpoint::transmit)), hands
/// [inputs](Self::next_input) to the controller and the controller's releases and reports back.
#[derive(Debug, Default)]
pub struct Device {
    decoder: Decoder<PACKET_BYTES_MAX>,
    /// Of decoders before a reset.
    packets_before: Counts,
    conversation: Conversation<MemoryStore>,
    inputs: VecDeque<Input>,
    outgoing: Vec<u8>,
    sequence: u32,
    report: Option<Report>,
    faults: Option<Faults>,
}

impl Device {
    /// A device that waits for a hello.
    pub fn new() -> Self {
        Self::default()
    }

    /// The next of the controller's inputs, oldest first.
    pub fn next_input(&mut self) -> Option<Input> {
        self.inputs.pop_front()
    }

    /// The controller shows the turn no more. A turn that the controller was not given stays.
    pub fn release(&mut self, turn: TurnHandle) {
        self.conversation.release(turn);
    }

    /// Sends a status with the next [`transmit`](Endpoint::transmit). A report that was not sent yet is replaced.
    pub fn report(&mut self, report: Report) {
        self.report = Some(report);
    }

    /// What the controller remembers of its faults. Sent with the next status after a hello, and then where it has changed.
    pub fn faults(&mut self, faults: Faults) {
        self.faults = Some(faults);
    }

    /// The link was lost: an unfinished turn is abandoned, and a hello must come first. What is on screen stays.
    pub fn reset(&mut self) {
        self.packets_before = self.packets();
        self.decoder = Decoder::new();
        self.outgoing.clear();
        self.conversation.disconnect();
    }

    /// The planes.
    pub fn store(&self) -> &MemoryStore {
        self.conversation.store()
    }

    /// The host's number of a finished turn.
    pub fn turn_number(&self, turn: TurnHandle) -> Option<u32> {
        self.conversation.turn_number(turn)
    }

    /// What came so far.
    pub fn counters(&self) -> Counters {
        self.conversation.counters()
    }

    /// Packets that came so far, by how they arrived.
    pub fn packets(&self) -> Counts {
        add(self.packets_before, self.decoder.counts())
    }

    fn send(&mut self, message: &Message<'_>) {
        let mut frame = [0; ANSWER_BYTES_MAX];
        if let Ok(length) = encode(self.sequence, message, &mut frame) {
            self.sequence = self.sequence.wrapping_add(1);
            self.outgoing.extend_from_slice(&frame[..length]);
        }
    }
}

impl Endpoint for Device {
    fn receive(&mut self, mut bytes: &[u8]) {
        while let Some(packet) = self.decoder.next(&mut bytes) {
            let Ok(packet) = packet else { continue };
            let (answer, input) = match packet.message() {
                Ok(message) => self.conversation.answer(packet.sequence, &message),
                Err(_) => (self.conversation.refuse(packet.sequence, Reason::NotUnderstood), None),
            };
            self.inputs.extend(input);
            self.send(&answer);
        }
    }

    fn transmit(&mut self) -> Vec<u8> {
        if let Some(report) = self.report.take().filter(|_| self.conversation.is_connected()) {
            let status = self.conversation.status(&report, self.packets());
            self.send(&status.into());
            if let Some(faults) = self.faults.and_then(|faults| self.conversation.tell(faults)) {
                self.send(&faults.into());
            }
        }
        std::mem::take(&mut self.outgoing)
    }

    /// Nothing here takes time.
    fn advance(&mut self, _seconds: f64) {}
}

fn add(a: Counts, b: Counts) -> Counts {
    Counts {
        packets: a.packets.saturating_add(b.packets),
        framing: a.framing.saturating_add(b.framing),
        too_long: a.too_long.saturating_add(b.too_long),
        too_short: a.too_short.saturating_add(b.too_short),
        check: a.check.saturating_add(b.check),
    }
}

#[cfg(test)]
mod tests;
