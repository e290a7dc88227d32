//! The controller's end of the wire as bytes: packets in, one packet in answer to each, and reports.

use crate::conversation::{ANSWER_BYTES_MAX, Conversation, Report, Request};
use crate::plane_store::PlaneStore;
use heapless::Vec;
use protocol::message::{Faults, Message, Reason};
use protocol::packet::{Counts, Decoder, PACKET_BYTES_MAX, encode};

/// The first packet's number: it wraps after a thousand packets, so that every run shows that nothing hangs on it.
const FIRST_SEQUENCE: u32 = 0u32.wrapping_sub(1_000);

/// A packet to the host.
pub type Packet = Vec<u8, ANSWER_BYTES_MAX>;

/// Whatever carries bytes asks it for answers; see [`Conversation`] for what it holds.
#[derive(Debug)]
pub struct WireEnd<S> {
    decoder: Decoder<PACKET_BYTES_MAX>,
    /// What the packets say; the store.
    pub conversation: Conversation<S>,
    sequence: u32,
}

impl<S: PlaneStore + Default> Default for WireEnd<S> {
    fn default() -> Self {
        Self::new(S::default())
    }
}

impl<S: PlaneStore> WireEnd<S> {
    /// Waits for a hello; planes go to `store`.
    pub const fn new(store: S) -> Self {
        Self { decoder: Decoder::new(), conversation: Conversation::new(store), sequence: FIRST_SEQUENCE }
    }

    /// Reads `bytes` up to the end of the next undamaged packet and leaves the rest in it: the answer, and what the packet asks of the
    /// controller. `None`: there is no such packet in it.
    pub fn hear(&mut self, bytes: &mut &[u8]) -> Option<(Packet, Option<Request>)> {
        loop {
            let Ok(packet) = self.decoder.next(bytes)? else { continue };
            let (answer, request) = match packet.message() {
                Ok(message) => self.conversation.answer(packet.sequence, &message),
                Err(_) => (self.conversation.refuse(packet.sequence, Reason::NotUnderstood), None),
            };
            return Some((self.packet(&answer), request));
        }
    }

    /// A status for a host that has said hello.
    pub fn status(&mut self, report: &Report) -> Option<Packet> {
        let status = self.conversation.status(report, self.decoder.counts());
        self.conversation.is_connected().then(|| self.packet(&status.into()))
    }

    /// `faults` for a host that has said hello and does not know them yet.
    pub fn faults(&mut self, faults: Faults) -> Option<Packet> {
        let news = self.conversation.is_connected().then(|| self.conversation.tell(faults)).flatten()?;
        Some(self.packet(&news.into()))
    }

    /// The link was lost, and with it what was cut off.
    pub fn disconnect(&mut self) {
        self.decoder.cut();
        self.conversation.disconnect();
    }

    /// Packets that came so far.
    pub fn packets(&self) -> Counts {
        self.decoder.counts()
    }

    /// Empty where the message does not fit, which the table of messages rules out.
    fn packet(&mut self, message: &Message<'_>) -> Packet {
        let mut frame = [0; ANSWER_BYTES_MAX];
        let length = encode(self.sequence, message, &mut frame).unwrap_or(0);
        self.sequence = self.sequence.wrapping_add(1);
        frame.get(..length).and_then(|bytes| Packet::from_slice(bytes).ok()).unwrap_or_default()
    }
}
