//! The controller's end of the wire, without any transport: a message comes in, its answer and what it asks of the controller go out.
//!
//! A turn comes on screen only if all its planes and the turn as a whole have their checks; whatever else happens, what is on screen
//! stays.

use crate::controller::Estimates;
use crate::hosted::Screen;
use crate::plane_store::{PlaneStore, TurnHandle};
use core::f32::consts::TAU;
use heapless::Vec;
use protocol::codec::ImageSize;
use protocol::message::{
    Ack, AskMissing, BeginTurn, Command, Configure, EndTurn, Fault, Faults, Hello, HelloReply, KEEP_PLANES_MAX,
    KeepPlanes, Message, Missing, Nack, PlaneData, Reason, SCHEMA, State, Status, VERSION, VIDEO_TURN,
};
use protocol::packet::Counts;
use protocol::timing::Rotation;

/// No message to the host is longer on the wire, in bytes: Status and Faults, the longest, have 64 bytes of payload.
pub const ANSWER_BYTES_MAX: usize = 96;

/// Finished turns that are kept: more than any store holds.
const TURNS_MAX: usize = 8;

/// What the wire has for the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Another rotation and image size: earlier turns are gone.
    Configured(Rotation, ImageSize),
    /// A host has turns that are cut otherwise: those that there are are to be given back, where nothing is lit.
    Vacate,
    /// An order of the host.
    Command(Command),
    /// A turn that may be shown. It stays in the store until [`Conversation::release`].
    TurnReady(TurnHandle),
}

/// How the controller does; the conversation adds what it knows and makes a [`Status`] of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// What it is doing.
    pub state: State,
    /// Why it stopped.
    pub fault: Option<Fault>,
    /// Whether anything measures the mirror.
    pub measured: bool,
    /// The mirror's angle ahead of the projector's picture, in 2⁻³² turn.
    pub phase_error: i32,
    /// The mirror's speed, turns in 10⁶ seconds.
    pub speed_microhertz: u32,
    /// Turns that came on screen.
    pub turns_shown: u32,
    /// The turn on screen.
    pub on_screen: Option<TurnHandle>,
}

impl Report {
    /// Of a controller whose turns have `slices` slices.
    pub fn new(state: State, fault: Option<Fault>, estimates: &Estimates, slices: u32, screen: Screen) -> Self {
        Self {
            state,
            fault,
            measured: estimates.measured,
            phase_error: (estimates.phase_error_slices / slices as f32 * 4_294_967_296.0) as i32,
            speed_microhertz: (estimates.speed_rad_s.abs() / TAU * 1e6) as u32,
            turns_shown: screen.turns_shown,
            on_screen: screen.turn,
        }
    }
}

/// What came over the wire, without the packets: their decoder counts them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Packets that arrived undamaged and were refused.
    pub refused: u32,
    /// Turns that arrived whole.
    pub turns_received: u32,
    /// Turns that were begun and never became whole.
    pub turns_abandoned: u32,
}

/// A turn in the store and the host's number of it.
#[derive(Clone, Copy, Debug)]
struct Turn {
    number: u32,
    handle: TurnHandle,
}

/// Slices of a turn: a rotation has at most 4096.
#[derive(Clone, Debug)]
struct SliceSet([u32; 128]);

impl SliceSet {
    const EMPTY: Self = Self([0; 128]);

    fn has(&self, slice: u16) -> bool {
        self.0.get(usize::from(slice / 32)).is_some_and(|word| word >> (slice % 32) & 1 != 0)
    }

    fn set(&mut self, slice: u16, is_in: bool) {
        if let Some(word) = self.0.get_mut(usize::from(slice / 32)) {
            *word = *word & !(1 << (slice % 32)) | u32::from(is_in) << (slice % 32);
        }
    }
}

impl Default for SliceSet {
    fn default() -> Self {
        Self::EMPTY
    }
}

/// The state of the conversation.
#[derive(Debug, Default)]
pub struct Conversation<S> {
    store: S,
    connected: bool,
    configured: Option<Configure>,
    filling: Option<Turn>,
    /// Of the turn that is filled.
    arrived: SliceSet,
    finished: Vec<Turn, TURNS_MAX>,
    /// The last turn that became whole: its begin and end may be repeated.
    last: Option<u32>,
    /// The last order's sequence number: an order is carried out once, however often its packet comes.
    last_order: Option<u32>,
    /// What the host of this connection was told last.
    told: Option<Faults>,
    counters: Counters,
}

impl<S: PlaneStore> Conversation<S> {
    /// Waits for a hello; planes go to `store`.
    pub const fn new(store: S) -> Self {
        Self {
            store,
            connected: false,
            configured: None,
            filling: None,
            arrived: SliceSet::EMPTY,
            finished: Vec::new(),
            last: None,
            last_order: None,
            told: None,
            counters: Counters { refused: 0, turns_received: 0, turns_abandoned: 0 },
        }
    }

    /// The planes.
    pub fn store(&self) -> &S {
        &self.store
    }

    /// Whether a host of the same schema said hello.
    pub fn is_connected(&self) -> bool {
        self.connected
    }

    /// What came so far.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// The host's number of a finished turn.
    pub fn turn_number(&self, turn: TurnHandle) -> Option<u32> {
        if turn == TurnHandle::VIDEO {
            return Some(VIDEO_TURN);
        }
        self.finished.iter().find(|finished| finished.handle == turn).map(|finished| finished.number)
    }

    /// The controller shows the turn no more. A turn that the controller was not given stays.
    pub fn release(&mut self, turn: TurnHandle) {
        let before = self.finished.len();
        self.finished.retain(|finished| finished.handle != turn);
        if self.finished.len() < before {
            self.store.release(turn);
        }
    }

    /// The link was lost: a hello must come first. What is on screen stays, and what came of an unfinished turn, which may go on.
    pub fn disconnect(&mut self) {
        self.connected = false;
        (self.last, self.last_order, self.told) = (None, None, None);
    }

    /// Answers the packet `sequence`. What it asks of the controller, if anything, comes with the answer.
    pub fn answer(&mut self, sequence: u32, message: &Message<'_>) -> (Message<'static>, Option<Request>) {
        let done = match message {
            Message::Hello(hello) => return (self.hello(sequence, hello), None),
            _ if !self.connected => Err(Reason::NotConnected),
            Message::Configure(configure) if self.is_in_the_way_of(configure) => {
                return (self.refuse(sequence, Reason::Busy), Some(Request::Vacate));
            }
            Message::Configure(configure) => self.configure(configure),
            Message::BeginTurn(begin) => self.begin(begin).map(|()| None),
            Message::Learn(learn) => self.store.learn(learn).map(|()| None).map_err(Into::into),
            Message::PlaneData(part) => self.plane(part).map(|()| None),
            Message::KeepPlanes(keep) => self.keep(keep).map(|()| None),
            Message::AskMissing(ask) => match self.missing(ask) {
                Ok([from, to]) => return (Missing { answers: sequence, from, to }.into(), None),
                Err(reason) => Err(reason),
            },
            Message::EndTurn(end) => self.end(end),
            Message::Control(control) => Ok(self.order(sequence, control.command)),
            _ => Err(Reason::NotUnderstood),
        };
        match done {
            Ok(request) => (Ack { answers: sequence }.into(), request),
            Err(reason) => (self.refuse(sequence, reason), None),
        }
    }

    /// The answer to a packet that arrived undamaged and is refused.
    pub fn refuse(&mut self, answers: u32, reason: Reason) -> Message<'static> {
        self.counters.refused = self.counters.refused.saturating_add(1);
        Nack { answers, reason }.into()
    }

    /// What the host is told of `report`, after `packets`.
    pub fn status(&self, report: &Report, packets: Counts) -> Status {
        Status {
            state: report.state,
            fault: report.fault,
            measured: report.measured,
            phase_error: report.phase_error,
            speed_microhertz: report.speed_microhertz,
            turns_shown: report.turns_shown,
            turn_on_screen: report.on_screen.and_then(|turn| self.turn_number(turn)),
            turns_received: self.counters.turns_received,
            turns_abandoned: self.counters.turns_abandoned,
            packets: packets.packets,
            packets_damaged: packets.damaged(),
        }
    }

    /// What the host is to be told of the controller's `faults`: all of it, where it does not know that yet.
    pub fn tell(&mut self, faults: Faults) -> Option<Faults> {
        let news = Some(faults).filter(|faults| self.told != Some(*faults));
        self.told = Some(faults);
        news
    }

    fn abandon(&mut self) {
        if let Some(turn) = self.filling.take() {
            self.store.release(turn.handle);
            self.counters.turns_abandoned = self.counters.turns_abandoned.saturating_add(1);
        }
    }

    fn hello(&mut self, answers: u32, hello: &Hello) -> Message<'static> {
        self.disconnect();
        self.connected = hello.schema == SCHEMA;
        HelloReply { answers, version: VERSION, schema: SCHEMA }.into()
    }

    /// Whether turns that are cut otherwise are shown or wait. Only the controller knows what is lit, so that it decides what becomes of them.
    fn is_in_the_way_of(&self, configure: &Configure) -> bool {
        !self.finished.is_empty() && self.configured != Some(*configure) && configure.parts().is_ok()
    }

    fn configure(&mut self, configure: &Configure) -> Result<Option<Request>, Reason> {
        if self.configured == Some(*configure) {
            return Ok(None);
        }
        let (rotation, size) = configure.parts().map_err(|_| Reason::Configuration)?;
        self.abandon();
        self.store.configure(configure.slices, size).map_err(Into::into)?;
        self.configured = Some(*configure);
        Ok(Some(Request::Configured(rotation, size)))
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
        let handle = self.store.begin().map_err(Into::into)?;
        self.filling = Some(Turn { number: begin.turn, handle });
        self.arrived = SliceSet::EMPTY;
        Ok(())
    }

    fn filling(&self, number: u32) -> Result<Turn, Reason> {
        self.filling.filter(|turn| turn.number == number).ok_or(Reason::WrongTurn)
    }

    fn finished(&self, number: u32) -> Option<Turn> {
        self.finished.iter().find(|turn| turn.number == number).copied()
    }

    fn plane(&mut self, part: &PlaneData<'_>) -> Result<(), Reason> {
        let turn = self.filling(part.turn)?;
        let written = self.store.write(turn.handle, part);
        let end = u64::from(part.offset) + part.bytes.len() as u64;
        self.arrived.set(part.slice, written.is_ok() && end == u64::from(part.total));
        written.map_err(Into::into)
    }

    fn keep(&mut self, keep: &KeepPlanes) -> Result<(), Reason> {
        let slices = self.configured.ok_or(Reason::NotConfigured)?.slices;
        let &KeepPlanes { turn, of, from, to } = keep;
        let turn = self.filling(turn)?;
        let of = self.finished(of).ok_or(Reason::WrongTurn)?;
        if to > slices || to.checked_sub(from).is_none_or(|planes| planes > KEEP_PLANES_MAX) {
            return Err(Reason::SliceOutOfRange);
        }
        self.store.keep(turn.handle, of.handle, from, to).map_err(Into::into)?;
        (from..to).for_each(|slice| self.arrived.set(slice, true));
        Ok(())
    }

    fn missing(&self, ask: &AskMissing) -> Result<[u16; 2], Reason> {
        let slices = self.configured.ok_or(Reason::NotConfigured)?.slices;
        if self.filling(ask.turn).is_err() {
            return self.finished(ask.turn).map(|_| [slices; 2]).ok_or(Reason::WrongTurn);
        }
        let from = (ask.from..slices).find(|&slice| !self.arrived.has(slice)).unwrap_or(slices);
        let to = (from..slices).find(|&slice| self.arrived.has(slice)).unwrap_or(slices);
        Ok([from, to])
    }

    fn end(&mut self, end: &EndTurn) -> Result<Option<Request>, Reason> {
        let filling = self.filling(end.turn);
        if filling.is_err() && (self.last == Some(end.turn) || self.finished(end.turn).is_some()) {
            return Ok(None);
        }
        let turn = filling?;
        if self.finished.is_full() {
            return Err(Reason::Busy);
        }
        self.store.finish(turn.handle, end).map_err(Into::into)?;
        self.filling = None;
        self.last = Some(end.turn);
        // There is room, by the check above.
        let _ = self.finished.push(turn);
        self.counters.turns_received = self.counters.turns_received.saturating_add(1);
        Ok(Some(Request::TurnReady(turn.handle)))
    }

    /// The host sends one order at a time, so that an older number is a repeated packet.
    fn order(&mut self, sequence: u32, command: Command) -> Option<Request> {
        let new = self.last_order.is_none_or(|last| sequence.wrapping_sub(last) as i32 > 0);
        new.then(|| {
            self.last_order = Some(sequence);
            Request::Command(command)
        })
    }
}
