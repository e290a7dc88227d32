//! What the device answers to each message.

use super::{Counters, Input};
use crate::frame_store::{MemoryStore, StoreError};
use firmware::plane_store::{PlaneStore, TurnHandle};
use protocol::message::{
    Ack, BeginTurn, Command, Configure, EndTurn, Faults, Hello, HelloReply, Message, Nack, PlaneData, Reason, SCHEMA,
    VERSION,
};
use protocol::packet::encode;
use std::collections::VecDeque;

/// No message to the host is longer on the wire: Status and Faults, the longest, have 64 bytes of payload.
const ANSWER_BYTES_MAX: usize = 96;

/// A turn in the store and the host's number of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn {
    pub(super) number: u32,
    pub(super) handle: TurnHandle,
}

/// The state of the conversation.
#[derive(Debug, Default)]
pub(super) struct Answers {
    pub(super) store: MemoryStore,
    pub(super) connected: bool,
    configured: Option<Configure>,
    filling: Option<Turn>,
    pub(super) finished: Vec<Turn>,
    /// The last turn that became whole: its begin and end may be repeated.
    last: Option<u32>,
    /// The last order's sequence number: an order is carried out once, however often its packet comes.
    last_order: Option<u32>,
    /// What the host of this connection was told last.
    told: Option<Faults>,
    pub(super) inputs: VecDeque<Input>,
    pub(super) outgoing: Vec<u8>,
    sequence: u32,
    /// Without the packets: the decoder counts them.
    pub(super) counters: Counters,
}

impl Answers {
    pub(super) fn release(&mut self, turn: TurnHandle) {
        let before = self.finished.len();
        self.finished.retain(|finished| finished.handle != turn);
        if self.finished.len() < before {
            self.store.release(turn);
        }
    }

    pub(super) fn disconnect(&mut self) {
        self.connected = false;
        self.abandon();
        (self.last, self.last_order, self.told) = (None, None, None);
    }

    fn abandon(&mut self) {
        if let Some(turn) = self.filling.take() {
            self.store.release(turn.handle);
            self.counters.turns_abandoned = self.counters.turns_abandoned.saturating_add(1);
        }
    }

    pub(super) fn answer(&mut self, sequence: u32, message: &Message<'_>) {
        if let Message::Hello(hello) = message {
            return self.hello(sequence, hello);
        }
        let done = match message {
            _ if !self.connected => Err(Reason::NotConnected),
            Message::Configure(configure) => self.configure(configure),
            Message::BeginTurn(begin) => self.begin(begin),
            Message::PlaneData(part) => self.plane(part),
            Message::EndTurn(end) => self.end(end),
            Message::Control(control) => {
                self.order(sequence, control.command);
                Ok(())
            }
            _ => Err(Reason::NotUnderstood),
        };
        match done {
            Ok(()) => self.send(&Ack { answers: sequence }.into()),
            Err(reason) => self.refuse(sequence, reason),
        }
    }

    pub(super) fn refuse(&mut self, answers: u32, reason: Reason) {
        self.counters.refused = self.counters.refused.saturating_add(1);
        self.send(&Nack { answers, reason }.into());
    }

    fn hello(&mut self, answers: u32, hello: &Hello) {
        self.disconnect();
        self.connected = hello.schema == SCHEMA;
        self.send(&HelloReply { answers, version: VERSION, schema: SCHEMA }.into());
    }

    fn configure(&mut self, configure: &Configure) -> Result<(), Reason> {
        if self.configured == Some(*configure) {
            return Ok(());
        }
        let (rotation, size) = configure.parts().map_err(|_| Reason::Configuration)?;
        if !self.finished.is_empty() {
            return Err(Reason::Busy);
        }
        self.abandon();
        self.store.configure(configure.slices, size).map_err(|error| reason(&error))?;
        self.configured = Some(*configure);
        self.inputs.push_back(Input::Configured(rotation, size));
        Ok(())
    }

    fn begin(&mut self, begin: &BeginTurn) -> Result<(), Reason> {
        let configured = self.configured.ok_or(Reason::NotConfigured)?;
        if begin.slices != configured.slices {
            return Err(Reason::SliceOutOfRange);
        }
        if self.filling.is_some_and(|turn| turn.number == begin.turn) || self.last == Some(begin.turn) {
            return Ok(());
        }
        self.abandon();
        let handle = self.store.begin().map_err(|error| reason(&error))?;
        self.filling = Some(Turn { number: begin.turn, handle });
        Ok(())
    }

    fn plane(&mut self, part: &PlaneData<'_>) -> Result<(), Reason> {
        let turn = self.filling.filter(|turn| turn.number == part.turn).ok_or(Reason::WrongTurn)?;
        self.store.write(turn.handle, part).map_err(|error| reason(&error))
    }

    fn end(&mut self, end: &EndTurn) -> Result<(), Reason> {
        if self.last == Some(end.turn) {
            return Ok(());
        }
        let turn = self.filling.filter(|turn| turn.number == end.turn).ok_or(Reason::WrongTurn)?;
        self.store.finish(turn.handle, end).map_err(|error| reason(&error))?;
        self.filling = None;
        self.last = Some(end.turn);
        self.finished.push(turn);
        self.counters.turns_received = self.counters.turns_received.saturating_add(1);
        self.inputs.push_back(Input::TurnReady(turn.handle));
        Ok(())
    }

    fn order(&mut self, sequence: u32, command: Command) {
        // The host sends one order at a time, so that an older number is a repeated packet.
        if self.last_order.is_none_or(|last| sequence.wrapping_sub(last) as i32 > 0) {
            self.last_order = Some(sequence);
            self.inputs.push_back(Input::Command(command));
        }
    }

    pub(super) fn tell_faults(&mut self, faults: Option<Faults>) {
        if let Some(faults) = faults.filter(|_| self.told != faults) {
            self.told = Some(faults);
            self.send(&faults.into());
        }
    }

    pub(super) fn send(&mut self, message: &Message<'_>) {
        let mut frame = [0; ANSWER_BYTES_MAX];
        if let Ok(length) = encode(self.sequence, message, &mut frame) {
            self.sequence = self.sequence.wrapping_add(1);
            self.outgoing.extend_from_slice(&frame[..length]);
        }
    }
}

fn reason(error: &StoreError) -> Reason {
    match error {
        StoreError::TooLarge { .. } => Reason::Configuration,
        StoreError::InUse | StoreError::Busy => Reason::Busy,
        StoreError::NotConfigured => Reason::NotConfigured,
        StoreError::NotFilling(_) => Reason::WrongTurn,
        StoreError::SliceOutOfRange { .. } => Reason::SliceOutOfRange,
        StoreError::PartMissing { .. } => Reason::PartMissing,
        StoreError::PartTooLong { .. } | StoreError::Damaged { .. } => Reason::PlaneDamaged,
        StoreError::SliceMissing { .. } => Reason::SliceMissing,
        StoreError::Check { .. } => Reason::TurnDamaged,
    }
}
