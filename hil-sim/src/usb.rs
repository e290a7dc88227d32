//! A USB device, without the bus and without time of its own: transfers in, completions out.
//!
//! It has a control endpoint and one bulk endpoint each way. A bulk transfer stays pending until the device takes its bytes, or has
//! some: that is what a host sees of NAK.

pub mod board;
pub mod descriptors;

use descriptors::{BOS, CONFIGURATION, DEVICE, Descriptors, IN, OUT, PACKET_BYTES, QUALIFIER, STRING};
use std::collections::VecDeque;

/// The eight bytes that begin a control transfer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Setup {
    /// bmRequestType.
    pub kind: u8,
    /// bRequest.
    pub request: u8,
    /// wValue.
    pub value: u16,
    /// wIndex.
    pub index: u16,
    /// wLength.
    pub length: u16,
}

impl Setup {
    /// From the wire.
    pub fn from_bytes([kind, request, v0, v1, i0, i1, l0, l1]: [u8; 8]) -> Self {
        let word = |low, high| u16::from_le_bytes([low, high]);
        Self { kind, request, value: word(v0, v1), index: word(i0, i1), length: word(l0, l1) }
    }

    /// Whether data go to the host.
    pub fn is_in(&self) -> bool {
        self.kind & 0x80 != 0
    }
}

/// Where a transfer goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pipe {
    /// To endpoint 0.
    Control(Setup),
    /// To or from the endpoint of this address.
    Bulk(u8),
}

/// What the host wants done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Transfer {
    /// The host's name for it.
    pub id: u32,
    /// Where it goes.
    pub pipe: Pipe,
    /// What goes to the device.
    pub bytes: Vec<u8>,
    /// How many bytes may come from it.
    pub room: usize,
}

/// How a transfer ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// All went, or as much as the device had.
    Done,
    /// The device refuses; a bulk endpoint stays halted until the host clears that.
    Stalled,
    /// The device's packet was longer than the room that the host gave it.
    Overflow,
}

/// A transfer that has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Completion {
    /// The host's name for it.
    pub id: u32,
    /// How it ended.
    pub outcome: Outcome,
    /// Bytes that went, in either direction.
    pub count: usize,
    /// Those that came from the device.
    pub bytes: Vec<u8>,
}

/// What a device does beyond what every device does.
pub trait Function {
    /// What it tells of itself now.
    fn descriptors(&self) -> &Descriptors;

    /// A request of a class or a vendor's own: what it answers; nothing where it stalls.
    fn request(&mut self, setup: Setup, bytes: &[u8]) -> Option<Vec<u8>>;

    /// The host chose an alternate setting that there is.
    fn set_interface(&mut self, interface: u8, setting: u8);

    /// Takes as many of `bytes`, from the first on, as it has room for, and returns how many.
    fn take(&mut self, bytes: &[u8]) -> usize;

    /// The next packet, of at most [`PACKET_BYTES`].
    fn give(&mut self) -> Option<Vec<u8>>;

    /// Lets time pass.
    fn advance(&mut self, seconds: f64);

    /// The host resets the bus.
    fn reset(&mut self);

    /// It is plugged in, or out.
    fn plug(&mut self, is_in: bool);

    /// Whether it is on the bus, as far as it goes: not while it starts anew.
    fn is_there(&self) -> bool;
}

/// A direction of bulk transfers.
#[derive(Debug, Default)]
struct Queue {
    pending: VecDeque<Pending>,
    is_halted: bool,
}

#[derive(Debug)]
struct Pending {
    transfer: Transfer,
    /// Of the bytes that go to the device.
    taken: usize,
    /// Those that came from it.
    given: Vec<u8>,
}

/// A device on its port, with what may be wrong with both.
#[derive(Debug)]
pub struct Port<F> {
    function: F,
    to_device: Queue,
    to_host: Queue,
    done: VecDeque<Completion>,
    configuration: u8,
    /// The alternate setting of each interface.
    settings: Vec<u8>,
    is_plugged: bool,
    naks: bool,
    bytes_per_second: Option<f64>,
    /// Bytes that may go now.
    credit: f64,
}

/// A throttled port may catch up so much at once, seconds.
const BURST_S: f64 = 0.002;

impl<F: Function> Port<F> {
    /// With nothing in the way, and not plugged in.
    pub fn new(function: F) -> Self {
        Self {
            function,
            to_device: Queue::default(),
            to_host: Queue::default(),
            done: VecDeque::new(),
            configuration: 0,
            settings: Vec::new(),
            is_plugged: false,
            naks: false,
            bytes_per_second: None,
            credit: 0.0,
        }
    }

    /// What is plugged in.
    pub fn function(&self) -> &F {
        &self.function
    }

    /// What is plugged in.
    pub fn function_mut(&mut self) -> &mut F {
        &mut self.function
    }

    /// Plugs it in. What is wrong with the port stays wrong.
    pub fn plug(&mut self) {
        self.forget();
        self.is_plugged = true;
        self.function.plug(true);
    }

    /// Pulls it out: nothing that is pending ends.
    pub fn unplug(&mut self) {
        self.forget();
        self.is_plugged = false;
        self.function.plug(false);
    }

    /// Whether a host sees it.
    pub fn is_there(&self) -> bool {
        self.is_plugged && self.function.is_there()
    }

    /// From now on the device takes and gives nothing in bulk, or does so again.
    pub fn set_nak(&mut self, naks: bool) {
        self.naks = naks;
        self.pump();
    }

    /// From now on no more than so many bytes a second go in bulk, in both directions together.
    pub fn set_bytes_per_second(&mut self, limit: Option<f64>) {
        (self.bytes_per_second, self.credit) = (limit, 0.0);
        self.pump();
    }

    /// Halts the bulk endpoint of this address, as a device does that has lost its way.
    pub fn halt(&mut self, address: u8) {
        let Some(queue) = self.queue(address) else { return };
        queue.is_halted = true;
        let pending = std::mem::take(&mut queue.pending);
        self.done.extend(pending.into_iter().map(|pending| pending.end(Outcome::Stalled)));
    }

    /// How many transfers are pending, and their bytes.
    pub fn pending(&self) -> (usize, usize) {
        let queues = [&self.to_device.pending, &self.to_host.pending];
        let bytes = |pending: &Pending| pending.transfer.bytes.len() + pending.given.len();
        (queues.iter().map(|queue| queue.len()).sum(), queues.iter().copied().flatten().map(bytes).sum())
    }

    /// Begins a transfer. It ends at once, or once the device is ready: [`completed`](Self::completed).
    pub fn submit(&mut self, transfer: Transfer) {
        let id = transfer.id;
        match transfer.pipe {
            Pipe::Control(setup) => {
                let answer = self.control(setup, &transfer.bytes);
                // A device that starts anew answers no more.
                if self.is_there() {
                    self.done.push_back(answered(id, setup, transfer.bytes.len(), answer));
                }
            }
            Pipe::Bulk(address) => {
                let pending = Pending { transfer, taken: 0, given: Vec::new() };
                match self.queue(address) {
                    Some(queue) if !queue.is_halted => queue.pending.push_back(pending),
                    _ => self.done.push_back(pending.end(Outcome::Stalled)),
                }
            }
        }
        self.pump();
    }

    /// Takes a transfer back; whether it was still pending. What went of it is lost to the host.
    pub fn unlink(&mut self, id: u32) -> bool {
        [&mut self.to_device.pending, &mut self.to_host.pending].into_iter().any(|pending| {
            let at = pending.iter().position(|pending| pending.transfer.id == id);
            at.and_then(|at| pending.remove(at)).is_some()
        })
    }

    /// The next transfer that has ended.
    pub fn completed(&mut self) -> Option<Completion> {
        self.done.pop_front()
    }

    /// Lets time pass, in a piece of at most a millisecond or so.
    pub fn advance(&mut self, seconds: f64) {
        self.function.advance(seconds);
        if let Some(limit) = self.bytes_per_second {
            let most = (limit * BURST_S).max(PACKET_BYTES as f64);
            self.credit = (self.credit + limit * seconds).min(most);
        }
        self.pump();
    }

    fn forget(&mut self) {
        (self.to_device, self.to_host) = Default::default();
        self.done.clear();
        (self.configuration, self.credit) = (0, 0.0);
        self.settings.clear();
    }

    fn queue(&mut self, address: u8) -> Option<&mut Queue> {
        match address {
            OUT => Some(&mut self.to_device),
            IN => Some(&mut self.to_host),
            _ => None,
        }
    }

    /// Moves what can be moved.
    fn pump(&mut self) {
        while !self.naks && self.is_there() && (self.give() | self.take()) {}
    }

    fn allowance(&self) -> usize {
        self.bytes_per_second.map_or(usize::MAX, |_| self.credit as usize)
    }

    /// Bytes of the oldest transfer to the device; whether any went.
    fn take(&mut self) -> bool {
        let allowance = self.allowance();
        let Some(Pending { transfer, taken, .. }) = self.to_device.pending.front_mut() else { return false };
        let rest = &transfer.bytes[*taken..];
        let count = self.function.take(&rest[..rest.len().min(allowance)]);
        *taken += count;
        self.credit -= count as f64;
        let is_whole = *taken == transfer.bytes.len();
        if is_whole {
            let whole = self.to_device.pending.pop_front();
            self.done.extend(whole.map(|pending| pending.end(Outcome::Done)));
        }
        count > 0 || is_whole
    }

    /// A packet for the oldest transfer to the host; whether there was one. A short one ends the transfer.
    fn give(&mut self) -> bool {
        if self.to_host.pending.is_empty() || self.allowance() < PACKET_BYTES {
            return false;
        }
        let Some(packet) = self.function.give() else { return false };
        self.credit -= packet.len() as f64;
        let Some(pending) = self.to_host.pending.front_mut() else { return false };
        let room = pending.transfer.room - pending.given.len();
        pending.given.extend(&packet[..packet.len().min(room)]);
        let outcome = if packet.len() > room { Outcome::Overflow } else { Outcome::Done };
        if packet.len() < PACKET_BYTES || packet.len() >= room {
            let ended = self.to_host.pending.pop_front();
            self.done.extend(ended.map(|pending| pending.end(outcome)));
        }
        true
    }

    /// A control request: what is answered; nothing where the endpoint stalls.
    fn control(&mut self, setup: Setup, bytes: &[u8]) -> Option<Vec<u8>> {
        const TYPES: u8 = 0x60;
        const STANDARD: u8 = 0;
        match setup.kind & TYPES {
            STANDARD => self.standard(setup),
            _ => self.function.request(setup, bytes),
        }
    }

    /// USB 2.0, chapter 9.4.
    fn standard(&mut self, setup: Setup) -> Option<Vec<u8>> {
        const GET_STATUS: u8 = 0;
        const CLEAR_FEATURE: u8 = 1;
        const SET_FEATURE: u8 = 3;
        const SET_ADDRESS: u8 = 5;
        const GET_DESCRIPTOR: u8 = 6;
        const GET_CONFIGURATION: u8 = 8;
        const SET_CONFIGURATION: u8 = 9;
        const GET_INTERFACE: u8 = 10;
        const SET_INTERFACE: u8 = 11;
        const SELF_POWERED: u8 = 1;
        let [value, _] = setup.value.to_le_bytes();
        let [index, _] = setup.index.to_le_bytes();
        match (setup.kind, setup.request) {
            (0x80, GET_STATUS) => Some(vec![SELF_POWERED, 0]),
            (0x81, GET_STATUS) => Some(vec![0, 0]),
            (0x82, GET_STATUS) => Some(vec![u8::from(self.queue(index).is_some_and(|queue| queue.is_halted)), 0]),
            (0x02, CLEAR_FEATURE) if value == 0 => self.queue(index).map(|queue| queue.is_halted = false).map(none),
            (0x02, SET_FEATURE) if value == 0 => {
                self.halt(index);
                self.queue(index).map(none)
            }
            (0x00, SET_ADDRESS) => Some(Vec::new()),
            (0x80, GET_DESCRIPTOR) => self.descriptor(setup),
            (0x80, GET_CONFIGURATION) => Some(vec![self.configuration]),
            (0x00, SET_CONFIGURATION) if value <= 1 => {
                self.configuration = value;
                self.restart_pipes();
                Some(Vec::new())
            }
            (0x81, GET_INTERFACE) => Some(vec![self.settings.get(usize::from(index)).copied().unwrap_or(0)]),
            (0x01, SET_INTERFACE) => self.set_interface(index, value),
            _ => None,
        }
    }

    /// Halts are over, and settings are the first ones.
    fn restart_pipes(&mut self) {
        (self.to_device, self.to_host) = Default::default();
        self.settings = vec![0; self.function.descriptors().interface_count().into()];
    }

    fn set_interface(&mut self, interface: u8, setting: u8) -> Option<Vec<u8>> {
        let all = &self.function.descriptors().interfaces;
        all.iter().find(|one| (one.number, one.setting) == (interface, setting))?;
        *self.settings.get_mut(usize::from(interface))? = setting;
        self.function.set_interface(interface, setting);
        Some(Vec::new())
    }

    fn descriptor(&mut self, setup: Setup) -> Option<Vec<u8>> {
        // What a Linux host asks first after each reset of the port, and at no other time (hub_port_init in drivers/usb/core/hub.c):
        // USB/IP does not tell of resets.
        const AFTER_RESET: u16 = 64;
        let [index, kind] = setup.value.to_le_bytes();
        if kind == DEVICE && setup.length == AFTER_RESET && self.configuration != 0 {
            self.configuration = 0;
            self.restart_pipes();
            self.function.reset();
        }
        let descriptors = self.function.descriptors();
        match kind {
            DEVICE => Some(descriptors.device()),
            CONFIGURATION if index == 0 => Some(descriptors.configuration()),
            STRING => descriptors.string(index),
            QUALIFIER => Some(descriptors.qualifier()),
            BOS => Some(descriptors.bos()),
            _ => None,
        }
    }
}

fn none(_: impl Sized) -> Vec<u8> {
    Vec::new()
}

/// A control transfer that has ended; the host gets no more than it asked for.
fn answered(id: u32, setup: Setup, sent: usize, answer: Option<Vec<u8>>) -> Completion {
    let outcome = if answer.is_some() { Outcome::Done } else { Outcome::Stalled };
    let mut bytes = answer.filter(|_| setup.is_in()).unwrap_or_default();
    bytes.truncate(setup.length.into());
    let count = match (outcome, setup.is_in()) {
        (Outcome::Done, false) => sent,
        _ => bytes.len(),
    };
    Completion { id, outcome, count, bytes }
}

impl Pending {
    fn end(self, outcome: Outcome) -> Completion {
        let count = if self.transfer.pipe == Pipe::Bulk(IN) { self.given.len() } else { self.taken };
        Completion { id: self.transfer.id, outcome, count, bytes: self.given }
    }
}

#[cfg(test)]
mod tests;
