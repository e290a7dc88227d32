//! The device as a host's controller sees it: transfers in, completions out.

use super::board::{Board, ID, Mode};
use super::*;
use crate::device::Endpoint;
use crate::dfu::{Controller, Owner};
use protocol::image::Board as Name;

/// Answers everything by the same, and takes at most `room` bytes until it is emptied.
#[derive(Default)]
struct Echo {
    bytes: Vec<u8>,
    room: Option<usize>,
    /// How often the way to the host was lost.
    lost: usize,
    turns: bool,
}

impl Endpoint for Echo {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        let count = self.room.map_or(bytes.len(), |room| bytes.len().min(room - self.bytes.len()));
        self.bytes.extend(&bytes[..count]);
        count
    }

    fn transmit(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }

    fn advance(&mut self, _: f64) {}

    fn lose_link(&mut self) {
        self.lost += 1;
    }

    fn is_at_rest(&self) -> bool {
        !self.turns
    }
}

fn port_of(echo: Echo) -> Port<Board<Echo>> {
    let owner = Owner { board: Name::new("bench").unwrap(), key: [7; 32] };
    let mut port = Port::new(Board::new(echo, Controller::new(owner), "17").unwrap());
    port.plug();
    port
}

fn port() -> Port<Board<Echo>> {
    port_of(Echo::default())
}

/// What a control request is answered; nothing where it stalls.
fn control(port: &mut Port<Board<Echo>>, setup: [u8; 8], bytes: &[u8]) -> Option<Vec<u8>> {
    let pipe = Pipe::Control(Setup::from_bytes(setup));
    port.submit(Transfer { id: 0, pipe, bytes: bytes.into(), room: 255 });
    let completion = port.completed().expect("requests end at once");
    (completion.outcome == Outcome::Done).then_some(completion.bytes)
}

fn send(port: &mut Port<Board<Echo>>, id: u32, bytes: &[u8]) {
    port.submit(Transfer { id, pipe: Pipe::Bulk(OUT), bytes: bytes.into(), room: 0 });
}

fn fetch(port: &mut Port<Board<Echo>>, id: u32, room: usize) {
    port.submit(Transfer { id, pipe: Pipe::Bulk(IN), bytes: Vec::new(), room });
}

fn completed(port: &mut Port<Board<Echo>>) -> Vec<(u32, Outcome, usize)> {
    std::iter::from_fn(|| port.completed()).map(|done| (done.id, done.outcome, done.count)).collect()
}

const SET_CONFIGURATION: [u8; 8] = [0x00, 9, 1, 0, 0, 0, 0, 0];
const DEVICE_AFTER_RESET: [u8; 8] = [0x80, 6, 0, 1, 0, 0, 64, 0];
const WHOLE_CONFIGURATION: [u8; 8] = [0x80, 6, 0, 2, 0, 0, 255, 0];
const DETACH: [u8; 8] = [0x21, 0, 0xE8, 3, 1, 0, 0, 0];

/// The descriptors of a configuration, one by one.
fn parts(configuration: &[u8]) -> Vec<&[u8]> {
    let mut rest = configuration;
    let mut parts = Vec::new();
    while let Some(&length) = rest.first() {
        let (part, more) = rest.split_at(length.into());
        parts.push(part);
        rest = more;
    }
    parts
}

#[test]
fn the_application_describes_itself_as_the_board_does() {
    let mut port = port();
    let device = control(&mut port, DEVICE_AFTER_RESET, &[]).unwrap();
    assert_eq!((device[0], device.len()), (18, 18));
    assert_eq!((u16::from_le_bytes([device[8], device[9]]), u16::from_le_bytes([device[10], device[11]])), ID);
    let whole = control(&mut port, WHOLE_CONFIGURATION, &[]).unwrap();
    assert_eq!(usize::from(u16::from_le_bytes([whole[2], whole[3]])), whole.len());
    let parts = parts(&whole);
    let interfaces: Vec<_> = parts.iter().filter(|part| part[1] == 4).map(|part| (part[2], &part[4..8])).collect();
    assert_eq!(interfaces, [(0, &[2, 0xFF, 0, 0][..]), (1, &[0, 0xFE, 1, 1])]);
    let endpoints: Vec<_> = parts.iter().filter(|part| part[1] == 5).map(|part| &part[2..6]).collect();
    assert_eq!(endpoints, [&[0x01, 2, 0, 2], &[0x81, 2, 0, 2]]);
    // CAN_DOWNLOAD and WILL_DETACH, DFU 1.1.
    let functional = parts.iter().find(|part| part[1] == 0x21).unwrap();
    assert_eq!((functional[2], &functional[7..]), (9, &[0x10, 1][..]));
    let serial = control(&mut port, [0x80, 6, 3, 3, 9, 4, 255, 0], &[]).unwrap();
    assert_eq!(serial, [6, 3, b'1', 0, b'7', 0]);
    // No more than was asked for.
    assert_eq!(control(&mut port, [0x80, 6, 0, 2, 0, 0, 9, 0], &[]).unwrap(), &whole[..9]);
    assert_eq!(control(&mut port, [0x80, 6, 9, 3, 9, 4, 255, 0], &[]), None);
}

#[test]
fn bytes_go_both_ways_and_short_packets_end_a_transfer() {
    let mut port = port();
    fetch(&mut port, 1, 2048);
    assert_eq!(completed(&mut port), []);
    send(&mut port, 2, &[1; 700]);
    assert_eq!(completed(&mut port), [(2, Outcome::Done, 700), (1, Outcome::Done, 700)]);
    // Whole packets alone leave the transfer pending.
    fetch(&mut port, 3, 2048);
    send(&mut port, 4, &[2; 512]);
    assert_eq!(completed(&mut port), [(4, Outcome::Done, 512)]);
    send(&mut port, 5, &[3; 2]);
    assert_eq!(completed(&mut port), [(5, Outcome::Done, 2), (3, Outcome::Done, 514)]);
    // A full one ends without.
    fetch(&mut port, 6, 512);
    send(&mut port, 7, &[4; 512]);
    assert_eq!(completed(&mut port), [(7, Outcome::Done, 512), (6, Outcome::Done, 512)]);
    // A packet that is longer than its room.
    fetch(&mut port, 8, 100);
    send(&mut port, 9, &[5; 512]);
    assert_eq!(completed(&mut port), [(9, Outcome::Done, 512), (8, Outcome::Overflow, 100)]);
}

#[test]
fn a_transfer_waits_for_room() {
    let mut port = port_of(Echo { room: Some(100), ..Echo::default() });
    send(&mut port, 1, &[1; 250]);
    assert_eq!(completed(&mut port), []);
    (2..5).for_each(|id| fetch(&mut port, id, 512));
    let done = completed(&mut port);
    assert!(done.contains(&(1, Outcome::Done, 250)), "{done:?}");
    let fetched: usize = done.iter().filter(|(id, ..)| *id > 1).map(|(.., count)| count).sum();
    assert_eq!(fetched, 250);
}

#[test]
fn a_device_that_naks_neither_takes_nor_gives() {
    let mut port = port();
    port.set_nak(true);
    send(&mut port, 1, &[1; 10]);
    fetch(&mut port, 2, 512);
    port.advance(1.0);
    assert_eq!(completed(&mut port), []);
    port.set_nak(false);
    assert_eq!(completed(&mut port), [(1, Outcome::Done, 10), (2, Outcome::Done, 10)]);
}

#[test]
fn a_halt_holds_until_it_is_cleared() {
    let mut port = port();
    fetch(&mut port, 1, 512);
    [OUT, IN].iter().for_each(|address| port.halt(*address));
    send(&mut port, 2, &[1; 10]);
    assert_eq!(completed(&mut port), [(1, Outcome::Stalled, 0), (2, Outcome::Stalled, 0)]);
    for address in [OUT, IN] {
        assert_eq!(control(&mut port, [0x82, 0, 0, 0, address, 0, 2, 0], &[]), Some(vec![1, 0]));
        assert_eq!(control(&mut port, [0x02, 1, 0, 0, address, 0, 0, 0], &[]), Some(vec![]));
        assert_eq!(control(&mut port, [0x82, 0, 0, 0, address, 0, 2, 0], &[]), Some(vec![0, 0]));
    }
    send(&mut port, 3, &[1; 10]);
    fetch(&mut port, 4, 512);
    assert_eq!(completed(&mut port), [(3, Outcome::Done, 10), (4, Outcome::Done, 10)]);
    // An endpoint that there is not.
    port.submit(Transfer { id: 5, pipe: Pipe::Bulk(0x02), bytes: vec![], room: 0 });
    assert_eq!(completed(&mut port), [(5, Outcome::Stalled, 0)]);
}

#[test]
fn what_is_taken_back_does_not_end() {
    let mut port = port();
    fetch(&mut port, 1, 512);
    fetch(&mut port, 2, 512);
    assert!(port.unlink(1) && !port.unlink(1) && !port.unlink(9));
    send(&mut port, 3, &[1; 10]);
    assert_eq!(completed(&mut port), [(3, Outcome::Done, 10), (2, Outcome::Done, 10)]);
}

#[test]
fn a_throttled_port_moves_its_rate() {
    // Half a megabyte a second, half of it to the device, for two seconds: 500,000 bytes each way, and a burst more at most.
    const RATE: f64 = 500_000.0;
    let mut port = port();
    port.set_bytes_per_second(Some(RATE));
    let (mut sent, mut fetched, mut id) = (0, 0, 0);
    let mut feed = |port: &mut Port<Board<Echo>>, is_out: bool| {
        id += 1;
        if is_out { send(port, id * 2, &[0; 1000]) } else { fetch(port, id * 2 + 1, 512) }
    };
    (0..4).for_each(|_| feed(&mut port, true));
    (0..4).for_each(|_| feed(&mut port, false));
    for _ in 0..2000 {
        port.advance(0.001);
        while let Some(done) = port.completed() {
            let is_out = done.id % 2 == 0;
            *(if is_out { &mut sent } else { &mut fetched }) += done.count;
            feed(&mut port, is_out);
        }
    }
    for count in [sent, fetched] {
        assert!((count as f64 - RATE).abs() < 0.01 * RATE, "{sent} to the device, {fetched} to the host");
    }
}

#[test]
fn nothing_of_an_unplugged_device_ends_and_it_comes_back_whole() {
    let mut port = port();
    control(&mut port, SET_CONFIGURATION, &[]).unwrap();
    port.set_nak(true);
    send(&mut port, 1, &[1; 10]);
    let before = port.function().endpoint().lost;
    port.unplug();
    port.set_nak(false);
    assert!(!port.is_there() && port.function().endpoint().lost > before);
    assert_eq!((completed(&mut port), port.pending()), (vec![], (0, 0)));
    port.plug();
    assert_eq!(control(&mut port, [0x80, 8, 0, 0, 0, 0, 1, 0], &[]), Some(vec![0]));
    send(&mut port, 2, &[1; 10]);
    assert_eq!(completed(&mut port), [(2, Outcome::Done, 10)]);
}

#[test]
fn what_a_host_does_not_fetch_goes_away() {
    let mut port = port();
    send(&mut port, 1, &[1; 10]);
    for _ in 0..99 {
        port.advance(0.001);
    }
    fetch(&mut port, 2, 512);
    assert_eq!(completed(&mut port), [(1, Outcome::Done, 10), (2, Outcome::Done, 10)]);
    send(&mut port, 3, &[1; 10]);
    for _ in 0..102 {
        port.advance(0.001);
    }
    fetch(&mut port, 4, 512);
    assert_eq!(completed(&mut port), [(3, Outcome::Done, 10)]);
}

#[test]
fn a_bus_reset_ends_the_conversation() {
    let mut port = port();
    control(&mut port, DEVICE_AFTER_RESET, &[]).unwrap();
    control(&mut port, SET_CONFIGURATION, &[]).unwrap();
    let before = port.function().endpoint().lost;
    control(&mut port, DEVICE_AFTER_RESET, &[]).unwrap();
    control(&mut port, DEVICE_AFTER_RESET, &[]).unwrap();
    assert_eq!(port.function().endpoint().lost, before + 1);
}

#[test]
fn a_detached_application_comes_back_as_loader() {
    let mut port = port();
    assert_eq!(port.function().mode(), Mode::Application);
    port.submit(Transfer { id: 1, pipe: Pipe::Control(Setup::from_bytes(DETACH)), bytes: vec![], room: 0 });
    assert!(!port.is_there() && port.completed().is_none());
    port.plug();
    assert_eq!(port.function().mode(), Mode::Loader);
    let whole = control(&mut port, WHOLE_CONFIGURATION, &[]).unwrap();
    let parts = parts(&whole);
    let interfaces: Vec<_> = parts.iter().filter(|part| part[1] == 4).map(|part| (part[3], &part[4..8])).collect();
    assert_eq!(interfaces, [(0, &[0, 0xFE, 1, 2][..]), (1, &[0, 0xFE, 1, 2])]);
    control(&mut port, SET_CONFIGURATION, &[]).unwrap();
    assert_eq!(control(&mut port, [0x01, 11, 1, 0, 0, 0, 0, 0], &[]), Some(vec![]));
    assert_eq!(control(&mut port, [0x01, 11, 2, 0, 0, 0, 0, 0], &[]), None);
    assert_eq!(control(&mut port, [0x81, 10, 0, 0, 0, 0, 1, 0], &[]), Some(vec![1]));
    // GETSTATUS: all is well, dfuIDLE.
    assert_eq!(control(&mut port, [0xA1, 3, 0, 0, 0, 0, 6, 0], &[]).unwrap()[4], 2);
    // It is no controller.
    send(&mut port, 2, &[1; 10]);
    port.advance(1.0);
    assert_eq!(completed(&mut port), []);
}

#[test]
fn a_machine_that_turns_stays() {
    let mut port = port_of(Echo { turns: true, ..Echo::default() });
    assert_eq!(control(&mut port, DETACH, &[]), Some(vec![]));
    assert_eq!((port.function().mode(), port.is_there()), (Mode::Application, true));
}

#[test]
fn a_blank_board_waits_for_an_image() {
    let owner = Owner { board: Name::new("bench").unwrap(), key: [7; 32] };
    let board = Board::blank(Echo::default(), Controller::new(owner), "17").unwrap();
    assert_eq!(board.mode(), Mode::Loader);
}
