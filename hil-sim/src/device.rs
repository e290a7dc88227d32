//! The simulated controller's end of the wire, without any transport: bytes in, bytes out.
//!
//! Every packet of the host is answered by one packet. A turn comes on screen only if all its planes and the turn as a whole
//! have their checks; whatever else happens, what is on screen stays.

use crate::frame_store::MemoryStore;
use answers::Answers;
pub use firmware::plane_store::{Plane, TurnHandle};
use protocol::codec::ImageSize;
use protocol::message::{Command, Fault, Faults, Reason, State, Status};
use protocol::packet::{Counts, Decoder, PACKET_BYTES_MAX};
use protocol::timing::Rotation;

mod answers;

/// Something at the far end of a link, in simulated time.
pub trait Endpoint {
    /// Takes what the host sent.
    fn receive(&mut self, bytes: &[u8]);

    /// Gives what the host is to receive; empty where there is nothing.
    fn transmit(&mut self) -> Vec<u8>;

    /// Lets time pass.
    fn advance(&mut self, seconds: f64);
}

/// What the wire has for the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// Another rotation and image size: earlier turns are gone.
    Configured(Rotation, ImageSize),
    /// An order of the host.
    Command(Command),
    /// A turn that may be shown. It stays in the store until [`Device::release`].
    TurnReady(TurnHandle),
}

/// How the controller does; the device adds what it knows and makes a [`Status`] of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// What it is doing.
    pub state: State,
    /// Why it stopped.
    pub fault: Option<Fault>,
    /// The mirror's angle ahead of the projector's picture, in 2⁻³² turn.
    pub phase_error: i32,
    /// The mirror's speed, turns in 10⁶ seconds.
    pub speed_microhertz: u32,
    /// Turns that came on screen.
    pub turns_shown: u32,
    /// The turn on screen.
    pub on_screen: Option<TurnHandle>,
}

/// What came over the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Packets, by how they arrived.
    pub packets: Counts,
    /// Packets that arrived undamaged and were refused.
    pub refused: u32,
    /// Turns that arrived whole.
    pub turns_received: u32,
    /// Turns that were begun and never became whole.
    pub turns_abandoned: u32,
}

/// The device. The world feeds it ([`receive`](Endpoint::receive)), empties it ([`transmit`](Endpoint::transmit)), hands
/// [inputs](Self::next_input) to the controller and the controller's releases and reports back.
#[derive(Debug, Default)]
pub struct Device {
    decoder: Decoder<PACKET_BYTES_MAX>,
    /// Of decoders before a reset.
    packets_before: Counts,
    answers: Answers,
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
        self.answers.inputs.pop_front()
    }

    /// The controller shows the turn no more. A turn that the controller was not given stays.
    pub fn release(&mut self, turn: TurnHandle) {
        self.answers.release(turn);
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
        self.packets_before = self.counters().packets;
        self.decoder = Decoder::new();
        self.answers.outgoing.clear();
        self.answers.disconnect();
    }

    /// The planes.
    pub fn store(&self) -> &MemoryStore {
        &self.answers.store
    }

    /// The host's number of a finished turn.
    pub fn turn_number(&self, turn: TurnHandle) -> Option<u32> {
        self.answers.finished.iter().find(|finished| finished.handle == turn).map(|finished| finished.number)
    }

    /// What came so far.
    pub fn counters(&self) -> Counters {
        Counters { packets: add(self.packets_before, self.decoder.counts()), ..self.answers.counters }
    }

    fn status(&self, report: &Report) -> Status {
        let counters = self.counters();
        Status {
            state: report.state,
            fault: report.fault,
            phase_error: report.phase_error,
            speed_microhertz: report.speed_microhertz,
            turns_shown: report.turns_shown,
            turn_on_screen: report.on_screen.and_then(|turn| self.turn_number(turn)),
            turns_received: counters.turns_received,
            turns_abandoned: counters.turns_abandoned,
            packets: counters.packets.packets,
            packets_damaged: counters.packets.damaged(),
        }
    }
}

impl Endpoint for Device {
    fn receive(&mut self, mut bytes: &[u8]) {
        while let Some(packet) = self.decoder.next(&mut bytes) {
            let Ok(packet) = packet else { continue };
            match packet.message() {
                Ok(message) => self.answers.answer(packet.sequence, &message),
                Err(_) => self.answers.refuse(packet.sequence, Reason::NotUnderstood),
            }
        }
    }

    fn transmit(&mut self) -> Vec<u8> {
        if let Some(report) = self.report.take().filter(|_| self.answers.connected) {
            let status = self.status(&report);
            self.answers.send(&status.into());
            self.answers.tell_faults(self.faults);
        }
        std::mem::take(&mut self.answers.outgoing)
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
