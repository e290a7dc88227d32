use super::*;
use crate::link::sim::{Clock, Endpoint, Shared, SimConnect, SimLink};
use crate::link::{Connect, LinkError};
use hil_sim::device::{Device, Input, Report, TurnHandle};
use hil_sim::faulty::{FaultRates, Faulty};
use proptest::prelude::*;
use protocol::message::State;
use protocol::packet::{Decoder, FRAME_BYTES_MAX, PACKET_BYTES_MAX, encode};
use protocol::timing::Direction;
use protocol::units::Turns;
use std::collections::VecDeque;

mod live;

const SLICES: u32 = 24;
/// Twelve frames at 240 Hz.
const TURN_SECONDS: f64 = 0.05;

/// A turn that follows from its seed.
struct Pictures {
    seed: u32,
    slices: u32,
    planes: Vec<u8>,
    plane_bytes: usize,
}

impl Pictures {
    fn new(seed: u32, slices: u32, size: ImageSize) -> Self {
        let plane_bytes = size.plane_bytes();
        let mut state = seed.wrapping_mul(2_654_435_761) | 1;
        let mut planes = vec![0; plane_bytes * slices as usize];
        // Dark, with patches of noise: runs and literals.
        for (at, byte) in planes.iter_mut().enumerate() {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            *byte = if (at / 40 + seed as usize).is_multiple_of(3) { state as u8 } else { 0 };
        }
        Self { seed, slices, planes, plane_bytes }
    }
}

impl TurnPlanes for Pictures {
    fn slices(&self) -> u32 {
        self.slices
    }

    fn plane_bytes(&self, slice: u32) -> &[u8] {
        &self.planes[slice as usize * self.plane_bytes..][..self.plane_bytes]
    }

    fn hint(&self, slice: u32) -> Hint {
        match self.seed % 3 {
            0 => Hint::None,
            1 => Hint::Mask { shift: (slice % 64) as u16 },
            _ => Hint::Diffusion,
        }
    }

    fn mask_ranks(&self) -> &[u16] {
        if self.seed % 3 == 1 { &RANKS } else { &[] }
    }
}

/// Of the least mask that there is.
const RANKS: [u16; 64] = {
    let mut ranks = [0; 64];
    let mut cell = 0;
    while cell < 64 {
        ranks[cell as usize] = cell * 37 % 64;
        cell += 1;
    }
    ranks
};

fn rotation(slices: u32) -> Rotation {
    Rotation::new(slices, 24, 240_000_000, Turns(7), Direction::Clockwise).unwrap()
}

fn small() -> ImageSize {
    ImageSize::new(52, 17).unwrap()
}

/// A device and the least of a world: the next turn comes on screen at the index, the one before it is released.
#[derive(Debug)]
struct Player {
    device: Device,
    size: ImageSize,
    turning: bool,
    since_index: f64,
    showing: Option<TurnHandle>,
    waiting: VecDeque<TurnHandle>,
    /// Every turn that came on screen: its number and its planes.
    shown: Vec<(u32, Vec<u8>)>,
    commands: Vec<Command>,
}

impl Player {
    fn new(turning: bool, size: ImageSize) -> Self {
        let (device, waiting) = (Device::new(), VecDeque::new());
        Self { device, size, turning, since_index: 0.0, showing: None, waiting, shown: vec![], commands: vec![] }
    }

    fn planes(&self, turn: TurnHandle) -> Vec<u8> {
        let slices = (0..).map_while(|slice| self.device.store().plane(turn, slice));
        slices.flat_map(|plane| plane.bytes().to_vec()).collect()
    }

    /// A mirror at rest gives its turns back.
    fn vacate(&mut self) {
        if !self.turning {
            self.showing.take().into_iter().chain(self.waiting.drain(..)).for_each(|turn| self.device.release(turn));
        }
    }

    fn index(&mut self) {
        let Some(next) = self.waiting.pop_front() else { return };
        if let Some(last) = self.showing.replace(next) {
            self.device.release(last);
        }
        self.shown.push((self.device.turn_number(next).unwrap(), self.planes(next)));
        self.device.report(Report { state: State::Locked, on_screen: Some(next), ..Report::default() });
    }
}

impl Endpoint for Player {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        let before = self.showing.map(|turn| self.planes(turn));
        self.device.receive(bytes);
        if self.size.plane_bytes() < 1000 {
            assert_eq!(self.showing.map(|turn| self.planes(turn)), before, "the turn on screen was written");
        }
        while let Some(input) = self.device.next_input() {
            match input {
                Input::TurnReady(turn) => self.waiting.push_back(turn),
                Input::Command(command) => self.commands.push(command),
                Input::Configured(_, size) => assert_eq!(size, self.size),
                Input::Vacate => self.vacate(),
            }
        }
        bytes.len()
    }

    fn transmit(&mut self) -> Vec<u8> {
        self.device.transmit()
    }

    fn lose_link(&mut self) {
        self.device.lose_link();
    }

    fn advance(&mut self, seconds: f64) {
        self.since_index += seconds;
        if self.turning && self.since_index >= TURN_SECONDS {
            self.since_index -= TURN_SECONDS;
            self.index();
        }
    }
}

fn open<L: Link>(link: L) -> Stream<L> {
    Stream::new(link, &rotation(SLICES), small()).unwrap()
}

#[test]
fn turns_arrive_bit_exact_and_in_order() {
    let mut stream = open(SimLink::new(Player::new(true, small())));
    for seed in 1..=6 {
        let ticket = stream.submit(&Pictures::new(seed, SLICES, small())).unwrap();
        assert_eq!(ticket, Ticket { turn: seed });
    }
    // Two are on the device; at the index after the last the sixth is shown.
    let status = stream.poll(Duration::from_millis(1)).unwrap().unwrap();
    assert_eq!((status.turn_on_screen, status.turns_received), (Some(5), 5));
    stream.poll(Duration::from_millis(100)).unwrap();
    assert_eq!(stream.status().unwrap().turn_on_screen, Some(6));
    let expected: Vec<_> = (1..=6).map(|seed| (seed, Pictures::new(seed, SLICES, small()).planes)).collect();
    assert_eq!(stream.link().endpoint().shown, expected);
    let statistics = stream.statistics();
    assert_eq!((statistics.turns, statistics.retries, statistics.refused), (6, 0, 0));
    assert_eq!(statistics.bytes_raw, 6 * 24 * 7 * 17);
    // Four turns had to wait for an index each.
    assert!(stream.link().now() >= Duration::from_millis(200), "{:?}", stream.link().now());
}

#[test]
fn a_mirror_at_rest_holds_the_host_back() {
    let mut stream = open(SimLink::new(Player::new(false, small())));
    let turn = Pictures::new(1, SLICES, small());
    stream.submit(&turn).unwrap();
    stream.submit(&turn).unwrap();
    let refused = stream.submit(&turn).unwrap_err();
    assert!(
        matches!(refused, StreamError::Busy { waited, state: None } if waited > Duration::from_secs(1)),
        "{refused}"
    );
    stream.link_mut().endpoint_mut().turning = true;
    stream.submit(&turn).unwrap();
}

#[test]
fn turns_of_another_cut_are_given_up_by_a_mirror_at_rest_and_by_no_other() {
    for turning in [false, true] {
        let mut stream = open(SimLink::new(Player::new(turning, small())));
        stream.submit(&Pictures::new(1, SLICES, small())).unwrap();
        stream.poll(Duration::from_millis(100)).unwrap();
        let mut link = stream.into_link();
        let large = ImageSize::new(104, 17).unwrap();
        link.endpoint_mut().size = large;
        match Stream::new(link, &rotation(SLICES), large) {
            Ok(mut stream) => {
                let turn = Pictures::new(2, SLICES, large);
                stream.submit(&turn).unwrap();
                let player = stream.link().endpoint();
                assert!(!turning && player.planes(player.waiting[0]) == turn.planes);
            }
            Err(error) => assert!(turning && matches!(error, StreamError::OtherTurns), "{error}"),
        }
    }
}

#[test]
fn planes_of_many_parts_arrive() {
    let size = ImageSize::new(4096, 1024).unwrap();
    let mut stream = Stream::new(SimLink::new(Player::new(true, size)), &rotation(SLICES), size).unwrap();
    let turn = Pictures::new(3, SLICES, size);
    stream.submit(&turn).unwrap();
    stream.poll(Duration::from_millis(100)).unwrap();
    assert!(stream.link().endpoint().shown == [(1, turn.planes)]);
    assert!(stream.statistics().packets > 10 * u64::from(SLICES), "{:?}", stream.statistics());
}

#[test]
fn a_turn_of_another_size_is_refused_before_it_is_sent() {
    let mut stream = open(SimLink::new(Player::new(true, small())));
    let packets = stream.statistics().packets;
    let refused = stream.submit(&Pictures::new(1, 48, small())).unwrap_err();
    assert_eq!(refused.to_string(), "a turn of 48 slices for a display of 24");
    let refused = stream.submit(&Pictures::new(1, SLICES, ImageSize::new(8, 17).unwrap())).unwrap_err();
    assert_eq!(refused.to_string(), "slice 0 has 17 bytes: 119 are needed");
    assert_eq!(stream.statistics().packets, packets);
}

/// A device of another release.
#[derive(Debug)]
struct Foreign {
    decoder: Decoder<PACKET_BYTES_MAX>,
    outgoing: Vec<u8>,
}

impl Endpoint for Foreign {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        let mut rest = bytes;
        while let Some(packet) = self.decoder.next(&mut rest) {
            let answers = packet.unwrap().sequence;
            let reply = protocol::message::HelloReply { answers, version: 7, schema: 0xabc };
            let mut frame = [0; FRAME_BYTES_MAX];
            let length = encode(0, &reply.into(), &mut frame).unwrap();
            self.outgoing.extend_from_slice(&frame[..length]);
        }
        bytes.len()
    }

    fn transmit(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.outgoing)
    }

    fn advance(&mut self, _seconds: f64) {}
}

#[test]
fn another_schema_is_refused_with_both_named() {
    let link = SimLink::new(Foreign { decoder: Decoder::new(), outgoing: vec![] });
    let refused = Stream::new(link, &rotation(SLICES), small()).unwrap_err().to_string();
    assert!(refused.contains("version 7, schema 0x0000000000000abc"), "{refused}");
    assert!(refused.contains(&format!("version {VERSION}, schema {SCHEMA:#018x}")), "{refused}");
}

#[test]
fn a_silent_device_is_reported() {
    let rates = FaultRates { drop: 1.0, ..FaultRates::default() };
    let silent = Faulty::new(Player::new(true, small()), rates, 1);
    let refused = Stream::new(SimLink::new(silent), &rotation(SLICES), small()).unwrap_err();
    assert_eq!(refused.to_string(), "the device did not answer Hello, sent 10 time(s): praxi doctor may say why");
}

#[test]
fn a_device_that_was_reset_refuses_until_it_is_greeted_again() {
    let mut stream = open(SimLink::new(Player::new(true, small())));
    stream.submit(&Pictures::new(1, SLICES, small())).unwrap();
    stream.link_mut().endpoint_mut().device.lose_link();
    let refused = stream.submit(&Pictures::new(2, SLICES, small())).unwrap_err();
    assert!(matches!(refused, StreamError::Refused { reason: Reason::NotConnected, .. }), "{refused}");
}

/// Streams `turns` turns and as many orders through faults; returns how many turns failed and what was damaged.
fn through_faults(rates: FaultRates, seed: u64, turns: u32) -> (u32, u32) {
    let link = SimLink::new(Faulty::new(Player::new(true, small()), rates, seed));
    let mut stream = match Stream::new(link, &rotation(SLICES), small()) {
        Ok(stream) => stream,
        Err(StreamError::NoAnswer { .. }) => return (turns, 1),
        Err(error) => panic!("seed {seed}: {error}"),
    };
    let (mut sure, mut orders) = (Vec::new(), Vec::new());
    for number in 1..=turns {
        match stream.submit(&Pictures::new(number, SLICES, small())) {
            Ok(ticket) => sure.push(ticket.turn),
            Err(StreamError::NoAnswer { .. } | StreamError::PlanesLost { .. } | StreamError::Refused { .. }) => {}
            Err(error) => panic!("seed {seed}, turn {number}: {error}"),
        }
        let order = if number % 2 == 0 { Command::Start } else { Command::Stop };
        if stream.command(order).is_ok() {
            orders.push(order);
        }
    }
    stream.poll(Duration::from_millis(300)).unwrap();
    stream.poll(Duration::from_millis(300)).unwrap();
    let player = stream.link().endpoint().endpoint();
    for (number, planes) in &player.shown {
        assert!(*planes == Pictures::new(*number, SLICES, small()).planes, "seed {seed}: turn {number} is wrong");
    }
    let shown: Vec<u32> = player.shown.iter().map(|(number, _)| *number).collect();
    assert!(shown.is_sorted_by(|a, b| a < b), "seed {seed}: {shown:?}");
    assert!(sure.iter().all(|turn| shown.contains(turn)), "seed {seed}: {sure:?} acknowledged, {shown:?} shown");
    if orders.len() == turns as usize {
        assert_eq!(player.commands, orders, "seed {seed}: each order once, in order");
    }
    assert!(player.device.counters().turns_received as usize >= sure.len());
    (turns - sure.len() as u32, player.device.packets().damaged() + stream.statistics().retries as u32)
}

#[test]
fn light_faults_are_repaired() {
    let rates = FaultRates { flip: 3e-4, drop: 2e-4, repeat: 2e-4, repeat_transfer: 0.05, ..FaultRates::default() };
    let mut damaged = 0;
    for seed in 0..20 {
        let (failed, damage) = through_faults(rates, seed, 5);
        assert_eq!(failed, 0, "seed {seed}");
        damaged += damage;
    }
    assert!(damaged > 100, "the faults did not happen: {damaged}");
}

#[test]
fn without_faults_nothing_is_damaged() {
    assert_eq!(through_faults(FaultRates::default(), 1, 5), (0, 0));
}

#[test]
fn a_device_is_told_once_what_planes_are_compressed_by() {
    let size = ImageSize::new(200, 160).unwrap();
    let mut stream = Stream::new(SimLink::new(Player::new(true, size)), &rotation(SLICES), size).unwrap();
    // Seeds that differ by three have the same hints: nothing, a mask, diffusion.
    let packets: Vec<u64> = (3..12)
        .map(|seed| {
            let before = stream.statistics().packets;
            stream.submit(&Pictures::new(seed, SLICES, size)).unwrap();
            let sent = stream.statistics().packets - before;
            // It comes on screen, and there is room for the next.
            stream.poll(Duration::from_millis(200)).unwrap();
            sent
        })
        .collect();
    let a_turn = u64::from(SLICES) + 2;
    // A mask of 8 × 8 in one part, codes in thirteen.
    assert_eq!(packets, [0, 1, 13, 0, 0, 0, 0, 0, 0].map(|more| a_turn + more));
    let shown = &stream.link().endpoint().shown;
    assert_eq!(shown.last().unwrap().1, Pictures::new(11, SLICES, size).planes);
}

#[test]
fn planes_that_stay_are_not_sent_again() {
    let mut stream = open(SimLink::new(Player::new(true, small())));
    let mut turn = Pictures::new(3, SLICES, small());
    let plane_bytes = turn.plane_bytes;
    stream.submit(&turn).unwrap();
    let sent = |stream: &Stream<SimLink<Player>>| (stream.statistics().packets, stream.statistics().planes_kept);
    let before = sent(&stream);
    // Slices 5 to 7 change: two runs stay.
    turn.planes[5 * plane_bytes..8 * plane_bytes].reverse();
    stream.submit(&turn).unwrap();
    assert_eq!(sent(&stream), (before.0 + 2 + 3 + 2, 21));
    stream.submit(&turn).unwrap();
    assert_eq!(sent(&stream).1, 21 + 24, "the whole turn");
    stream.poll(Duration::from_millis(200)).unwrap();
    stream.poll(Duration::from_millis(200)).unwrap();
    let shown = &stream.link().endpoint().shown;
    assert_eq!(shown.len(), 3);
    assert!(shown[1..].iter().all(|(_, planes)| *planes == turn.planes) && shown[0].1 != turn.planes);
    // The controller gave all turns back: the planes are sent again.
    let player = stream.link_mut().endpoint_mut();
    player.showing.take().into_iter().for_each(|turn| player.device.release(turn));
    stream.submit(&turn).unwrap();
    stream.poll(Duration::from_millis(200)).unwrap();
    let shown = &stream.link().endpoint().shown;
    assert!(shown.len() == 4 && shown[3].1 == turn.planes);
    assert_eq!((stream.statistics().refused, stream.statistics().planes_kept), (1, 45));
}

#[test]
fn a_turn_goes_on_where_the_link_was_lost() {
    let plug = Shared::new(Faulty::new(Player::new(true, small()), FaultRates::default(), 1));
    let mut device = SimConnect::new(plug.clone(), Clock::Simulated, None);
    let mut stream = Stream::new(device.connect().unwrap(), &rotation(SLICES), small()).unwrap();
    let turn = Pictures::new(2, SLICES, small());
    let mut looks = 0;
    let lost = stream.submit_unless(&turn, |_| {
        looks += 1;
        if looks == 12 {
            plug.with(|line| line.unplug(0.1));
        }
        false
    });
    assert!(matches!(lost, Err(StreamError::Link(LinkError::Gone))), "{lost:?}");
    assert!(matches!(device.connect(), Err(LinkError::Absent { .. })));
    device.wait(Duration::from_millis(150));
    stream.reconnect(device.connect().unwrap()).unwrap();
    let ticket = stream.submit(&turn).unwrap();
    assert!(stream.statistics().planes_resumed >= 8, "{:?}", stream.statistics());
    plug.with(|line| assert_eq!(line.endpoint().device.counters().turns_abandoned, 0));
    stream.poll(Duration::from_millis(200)).unwrap();
    plug.with(|line| assert!(line.endpoint().shown == [(ticket.turn, turn.planes.clone())]));
    // One that is left for another is abandoned.
    let left = stream.submit_unless(&Pictures::new(4, SLICES, small()), |_| true);
    assert!(matches!(left, Err(StreamError::Left { .. })));
    stream.submit(&turn).unwrap();
    plug.with(|line| assert_eq!(line.endpoint().device.counters().turns_received, 2));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn no_fault_shows_a_wrong_turn(
        flip in 0.0..2e-2, drop in 0.0..1e-2, repeat in 0.0..1e-2, repeat_transfer in 0.0..0.3, swap in 0.0..0.3,
        seed: u64,
    ) {
        let rates = FaultRates { flip, drop, repeat, repeat_transfer, swap, ..FaultRates::default() };
        through_faults(rates, seed, 4);
    }
}
