//! The simulated controller's end of the wire, without any transport: bytes in, bytes out.
//!
//! Every packet of the host is answered by one packet. A turn comes on screen only if all its planes and the turn as a whole
//! have their checks; whatever else happens, what is on screen stays.

use crate::frame_store::MemoryStore;
pub use firmware::conversation::{Counters, Report, Request as Input};
pub use firmware::plane_store::{Plane, TurnHandle};
use firmware::wire_end::WireEnd;
use protocol::message::Faults;
use protocol::packet::Counts;
use std::collections::VecDeque;

/// Something at the far end of a link, in simulated time.
pub trait Endpoint {
    /// Takes as many of `bytes`, which the host sent, as it has room for, from the first on, and returns how many.
    fn receive(&mut self, bytes: &[u8]) -> usize;

    /// Gives what the host is to receive; empty where there is nothing.
    fn transmit(&mut self) -> Vec<u8>;

    /// Lets time pass.
    fn advance(&mut self, seconds: f64);

    /// The way to the host is lost, and what was under way on it.
    fn lose_link(&mut self) {}

    /// Which way to the host this is, counted from 0; nothing while the plug is pulled.
    fn plug(&self) -> Option<u32> {
        Some(0)
    }

    /// Whether it may start anew: not where something turns.
    fn is_at_rest(&self) -> bool {
        true
    }
}

impl<E: Endpoint + ?Sized> Endpoint for Box<E> {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        (**self).receive(bytes)
    }

    fn transmit(&mut self) -> Vec<u8> {
        (**self).transmit()
    }

    fn advance(&mut self, seconds: f64) {
        (**self).advance(seconds);
    }

    fn lose_link(&mut self) {
        (**self).lose_link();
    }

    fn plug(&self) -> Option<u32> {
        (**self).plug()
    }

    fn is_at_rest(&self) -> bool {
        (**self).is_at_rest()
    }
}

/// The device. The world feeds it ([`receive`](Endpoint::receive)), empties it ([`transmit`](Endpoint::transmit)), hands
/// [inputs](Self::next_input) to the controller and the controller's releases and reports back.
#[derive(Debug, Default)]
pub struct Device {
    wire: WireEnd<MemoryStore>,
    inputs: VecDeque<Input>,
    outgoing: Vec<u8>,
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
        self.wire.conversation.release(turn);
    }

    /// Sends a status with the next [`transmit`](Endpoint::transmit). A report that was not sent yet is replaced.
    pub fn report(&mut self, report: Report) {
        self.report = Some(report);
    }

    /// What the controller remembers of its faults. Sent with the next status after a hello, and then where it has changed.
    pub fn faults(&mut self, faults: Faults) {
        self.faults = Some(faults);
    }

    /// The planes.
    pub fn store(&self) -> &MemoryStore {
        self.wire.conversation.store()
    }

    /// The host's number of a finished turn.
    pub fn turn_number(&self, turn: TurnHandle) -> Option<u32> {
        self.wire.conversation.turn_number(turn)
    }

    /// What came so far.
    pub fn counters(&self) -> Counters {
        self.wire.conversation.counters()
    }

    /// Packets that came so far, by how they arrived.
    pub fn packets(&self) -> Counts {
        self.wire.packets()
    }

    /// Reads `bytes` up to the end of the next undamaged packet and leaves the rest in it; whether there was one.
    pub fn take_packet(&mut self, bytes: &mut &[u8]) -> bool {
        let heard = self.wire.hear(bytes);
        let came = heard.is_some();
        if let Some((answer, input)) = heard {
            self.inputs.extend(input);
            self.outgoing.extend_from_slice(&answer);
        }
        came
    }
}

impl Endpoint for Device {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        let mut rest = bytes;
        while self.take_packet(&mut rest) {}
        bytes.len()
    }

    fn transmit(&mut self) -> Vec<u8> {
        if let Some(report) = self.report.take() {
            let faults = self.faults;
            let packets = [self.wire.status(&report), faults.and_then(|faults| self.wire.faults(faults))];
            packets.iter().flatten().for_each(|packet| self.outgoing.extend_from_slice(packet));
        }
        std::mem::take(&mut self.outgoing)
    }

    fn lose_link(&mut self) {
        self.outgoing.clear();
        self.wire.disconnect();
    }

    /// Nothing here takes time.
    fn advance(&mut self, _seconds: f64) {}
}

#[cfg(test)]
mod tests;
