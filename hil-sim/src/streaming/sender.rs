//! A host that streams turns, one packet at a time, and gets into trouble.

use super::{OVER_S, TROUBLE_S, Trouble, Turn, Whole};
use crate::device::Endpoint;
use protocol::codec::ImageSize;
use protocol::message::{AskMissing, BeginTurn, Command, Configure, Control, EndTurn, Hello, KeepPlanes, Message};
use protocol::message::{PlaneData, Reason, SCHEMA, Status, VERSION};
use protocol::packet::{Decoder, FRAME_BYTES_MAX, PACKET_BYTES_MAX, encode};
use protocol::timing::Rotation;
use protocol::units::Nanos;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::VecDeque;

/// Packets that a host sends between two looks at its clock.
const PACKETS_A_STEP: usize = 40;
/// A refused packet is sent again after this.
const AGAIN: Nanos = Nanos(2_000_000);
/// An answer that takes longer is lost, and the connection with it.
const PATIENCE: Nanos = Nanos(20_000_000);
/// A turn is begun at most so often: a little sooner than one is over.
const PACE: Nanos = Nanos(45_000_000);
/// Turns that a host remembers: more than a device holds.
const REMEMBERED: usize = 6;

/// What comes next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    Hello,
    Configure,
    Start,
    Begin,
    Plane(u16),
    End,
}

/// The host.
#[derive(Debug)]
pub struct Sender {
    rotation: Rotation,
    size: ImageSize,
    trouble: Trouble,
    /// From when to when.
    troubled: [Nanos; 2],
    /// Whether it says hello after a silence.
    reconnects: bool,
    random: ChaCha8Rng,
    sequence: u32,
    next: Next,
    started: bool,
    /// Of the last packet, and when it was sent.
    awaited: Option<(u32, Nanos)>,
    not_before: Nanos,
    begin_at: Nanos,
    turns: VecDeque<Turn>,
    whole: VecDeque<Whole>,
    /// The rest of a packet that was cut off.
    rest: Option<Vec<u8>>,
    decoder: Decoder<PACKET_BYTES_MAX>,
    /// The device's last word on itself.
    pub status: Option<Status>,
    /// All that the device said.
    pub heard: Vec<u8>,
}

impl Sender {
    /// A host that `seed` decides. Every fourth one's numbers of packets and turns are about to wrap.
    pub fn new(rotation: &Rotation, size: ImageSize, trouble: Trouble, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ (trouble as u64) << 32);
        let at = |seconds: f64| Nanos::from_seconds(seconds);
        let troubled = [at(TROUBLE_S + random.random_range(0.0..0.1)), at(random.random_range(OVER_S - 1.2..OVER_S))];
        // Some 90 turns are sent in all, of 290 packets each.
        let wraps = seed.is_multiple_of(4);
        let sequence = if wraps { u32::MAX - random.random_range(0..15_000) } else { random.random() };
        let number = if wraps { u32::MAX - random.random_range(0..50) } else { random.random() };
        Self {
            rotation: *rotation,
            size,
            trouble,
            troubled,
            reconnects: random.random(),
            random,
            sequence,
            next: Next::Hello,
            started: false,
            awaited: None,
            not_before: Nanos::ZERO,
            begin_at: Nanos::ZERO,
            turns: VecDeque::from([Turn::new(number, rotation.slices(), size)]),
            whole: VecDeque::new(),
            rest: None,
            decoder: Decoder::new(),
            status: None,
            heard: Vec::new(),
        }
    }

    /// The last turns that the device has whole, the oldest first.
    pub fn whole(&self) -> impl Iterator<Item = Whole> {
        self.whole.iter().copied()
    }

    /// When turn `number` became whole.
    pub fn whole_at(&self, number: u32) -> Option<Nanos> {
        self.whole.iter().find(|whole| whole.number == number).map(|whole| whole.at)
    }

    /// When the trouble is over.
    pub fn returned_at(&self) -> Nanos {
        self.troubled[1]
    }

    /// What slice `slice` of turn `number` must be.
    pub fn check(&self, number: u32, slice: u16) -> Option<u64> {
        self.turns.iter().find(|turn| turn.number == number)?.checks.get(usize::from(slice)).copied()
    }

    /// Does what it has to at `now`.
    pub fn act(&mut self, now: Nanos, device: &mut impl Endpoint) {
        let [from, until] = self.troubled;
        let in_trouble = now >= from && now < until;
        match self.trouble {
            Trouble::Silence if in_trouble => return self.fall_silent(device),
            Trouble::Garbage if in_trouble => return self.babble(device),
            _ => {}
        }
        if let Some(rest) = self.rest.take() {
            device.receive(if self.reconnects { &[0] } else { &rest });
            self.next = if self.reconnects { Next::Hello } else { self.next };
        }
        for _ in 0..PACKETS_A_STEP {
            self.listen(now, device);
            if self.awaited.take_if(|(_, sent)| now - *sent > PATIENCE).is_some() {
                device.receive(&[0]);
                self.next = Next::Hello;
            }
            if self.awaited.is_some() || now < self.not_before {
                return;
            }
            if self.next == Next::Begin && !self.may_begin(now, in_trouble) {
                return;
            }
            let packet = self.packet();
            self.awaited = Some((self.sequence, now));
            device.receive(&packet);
        }
    }

    /// Whether a turn may be begun now; a late one takes its time after that.
    fn may_begin(&mut self, now: Nanos, in_trouble: bool) -> bool {
        let may = now >= self.begin_at;
        if may {
            self.begin_at = now + PACE;
        }
        if may && in_trouble && self.trouble == Trouble::Lateness {
            self.not_before = now + Nanos(self.random.random_range(5_000_000..180_000_000));
        }
        may
    }

    /// Half a packet, and no word more.
    fn fall_silent(&mut self, device: &mut impl Endpoint) {
        if self.rest.is_none() {
            let mut packet = self.packet();
            let rest = packet.split_off(packet.len() / 2);
            device.receive(&packet);
            self.rest = Some(rest);
        }
    }

    fn listen(&mut self, now: Nanos, device: &mut impl Endpoint) {
        let bytes = device.transmit();
        self.heard.extend_from_slice(&bytes);
        let mut bytes = &bytes[..];
        while let Some(packet) = self.decoder.next(&mut bytes) {
            let message = packet.expect("a device that is simulated sends no damaged packet").message();
            let (answered, outcome) = match message.expect("nor one that it does not know itself") {
                Message::Ack(ack) => (ack.answers, Ok(())),
                Message::HelloReply(reply) => (reply.answers, Ok(())),
                Message::Nack(nack) => (nack.answers, Err(nack.reason)),
                Message::Status(status) => {
                    self.status = Some(status);
                    continue;
                }
                _ => continue,
            };
            if self.awaited.take_if(|(sequence, _)| *sequence == answered).is_some() {
                self.go_on(now, outcome);
            }
        }
    }

    fn go_on(&mut self, now: Nanos, outcome: Result<(), Reason>) {
        let last = Next::Plane(self.rotation.slices() as u16 - 1);
        self.next = match (outcome, self.next) {
            (Err(Reason::Busy), same) => {
                self.not_before = now + AGAIN;
                same
            }
            (Err(Reason::NotConnected | Reason::NotConfigured), _) => Next::Hello,
            (Err(_), _) => Next::Begin,
            (Ok(()), Next::Hello) => Next::Configure,
            (Ok(()), Next::Configure) if !self.started => Next::Start,
            (Ok(()), Next::Configure) => Next::Begin,
            (Ok(()), Next::Start) => {
                self.started = true;
                Next::Begin
            }
            (Ok(()), Next::Begin) => Next::Plane(0),
            (Ok(()), same) if same == last => Next::End,
            (Ok(()), Next::Plane(slice)) => Next::Plane(slice + 1),
            (Ok(()), Next::End) => {
                self.finished(now);
                Next::Begin
            }
        };
    }

    fn finished(&mut self, now: Nanos) {
        let Some(number) = self.turns.back().map(|turn| turn.number) else { return };
        self.whole.push_back(Whole { number, at: now });
        self.turns.push_back(Turn::new(number.wrapping_add(1), self.rotation.slices(), self.size));
        if self.turns.len() > REMEMBERED {
            self.turns.pop_front();
            self.whole.pop_front();
        }
    }

    /// The next packet.
    fn packet(&mut self) -> Vec<u8> {
        self.sequence = self.sequence.wrapping_add(1);
        let Some(turn) = self.turns.back() else { return Vec::new() };
        let number = turn.number;
        let message: Message<'_> = match self.next {
            Next::Hello => Hello { version: VERSION, schema: SCHEMA }.into(),
            Next::Configure => Configure::new(&self.rotation, self.size).into(),
            Next::Start => Control { command: Command::Start }.into(),
            Next::Begin => BeginTurn { turn: number, slices: self.rotation.slices() as u16 }.into(),
            Next::Plane(slice) => {
                let (bytes, check) = (&turn.planes[usize::from(slice)], turn.checks[usize::from(slice)]);
                PlaneData { turn: number, slice, offset: 0, total: bytes.len() as u32, check, bytes }.into()
            }
            Next::End => EndTurn { turn: number, check: turn.check() }.into(),
        };
        framed(self.sequence, &message)
    }

    /// What looks like a packet and is none, or is one and means nothing. Its answers are not listened to.
    fn babble(&mut self, device: &mut impl Endpoint) {
        self.awaited = None;
        let (kind, place) = (self.random.random_range(0..9), self.random.random_range(0..1_000_000));
        let mut packet = self.packet();
        let place = place % packet.len();
        match kind {
            0 => packet = (0..self.random.random_range(1..700)).map(|_| self.random.random()).collect(),
            // Longer than any packet, without an end.
            1 => packet = vec![self.random.random_range(1..=255); PACKET_BYTES_MAX / 4],
            2 => packet[place] ^= 1 << self.random.random_range(0..8),
            3 => packet.truncate(place),
            4 => packet.drain(..place).for_each(drop),
            5 => packet.extend_from_within(place..),
            _ => packet = self.nonsense(),
        }
        device.receive(&packet);
        self.heard.extend(device.transmit());
    }

    /// A packet that arrives undamaged.
    fn nonsense(&mut self) -> Vec<u8> {
        let (sequence, turn, slice) = (self.random.random(), self.random.random(), self.random.random_range(0..400));
        let mine = self.turns.back().map_or(0, |turn| turn.number);
        let turn = if self.random.random() { turn } else { mine };
        let noise: Vec<u8> = (0..self.random.random_range(0..300)).map(|_| self.random.random()).collect();
        let (check, total) = (self.random.random(), self.random.random_range(0..400));
        let message: Message<'_> = match self.random.random_range(0..7) {
            0 => BeginTurn { turn, slices: self.rotation.slices() as u16 }.into(),
            1 => EndTurn { turn, check }.into(),
            2 => PlaneData { turn, slice, offset: 0, total: noise.len() as u32, check, bytes: &noise }.into(),
            3 => PlaneData { turn, slice, offset: total / 2, total, check, bytes: &noise }.into(),
            4 => KeepPlanes { turn, of: mine.wrapping_sub(1), from: slice, to: slice + 1 }.into(),
            5 => AskMissing { turn, from: slice }.into(),
            // An order of this connection's that has been carried out.
            _ => return framed(self.sequence.wrapping_sub(100_000), &Control { command: Command::Stop }.into()),
        };
        framed(sequence, &message)
    }
}

fn framed(sequence: u32, message: &Message<'_>) -> Vec<u8> {
    let mut packet = vec![0; FRAME_BYTES_MAX];
    let length = encode(sequence, message, &mut packet).expect("room for any message");
    packet.truncate(length);
    packet
}
