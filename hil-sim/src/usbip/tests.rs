//! The protocol against scripted bytes: a whole exchange, every piece of it cut off, and nonsense.

use super::wire::*;
use super::*;
use crate::device::Endpoint;
use crate::dfu::{Controller, Owner};
use crate::usb::board::Board;
use crate::usb::descriptors::{IN, OUT};
use crate::usb::{Pipe, Setup, Transfer};
use proptest::prelude::*;
use protocol::image::Board as Name;
use std::io::Cursor;

/// Swallows everything.
struct Sink;

impl Endpoint for Sink {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        bytes.len()
    }

    fn transmit(&mut self) -> Vec<u8> {
        Vec::new()
    }

    fn advance(&mut self, _: f64) {}
}

fn port() -> Port<Board<Sink>> {
    let owner = Owner { board: Name::new("bench").unwrap(), key: [7; 32] };
    Port::new(Board::new(Sink, Controller::new(owner), "17").unwrap())
}

fn message(words: [u32; 10], tail: [u8; 8]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_be_bytes()).chain(tail).collect()
}

fn submit(id: u32, endpoint: u32, is_in: bool, length: u32, setup: [u8; 8], bytes: &[u8]) -> Vec<u8> {
    let mut all = message([1, id, 0x10002, is_in.into(), endpoint, 0, length, 0, 0, 0], setup);
    all.extend(bytes);
    all
}

fn unlink(id: u32, victim: u32) -> Vec<u8> {
    message([2, id, 0x10002, 0, 0, victim, 0, 0, 0, 0], [0; 8])
}

const DESCRIPTOR: [u8; 8] = [0x80, 6, 0, 1, 0, 0, 18, 0];
const UNKNOWN: [u8; 8] = [0xC0, 99, 0, 0, 0, 0, 0, 0];

/// Messages of a client that knows what it does.
fn script() -> Vec<Vec<u8>> {
    vec![
        submit(1, 0, true, 18, DESCRIPTOR, &[]),
        submit(2, 1, true, 4096, [0; 8], &[]),
        submit(3, 1, false, 700, [0; 8], &[5; 700]),
        submit(4, 0, true, 0, UNKNOWN, &[]),
        unlink(5, 2),
        unlink(6, 3),
    ]
}

fn play(bytes: Vec<u8>) -> (Result<Ending, UsbIpError>, Vec<u8>) {
    let mut said = Vec::new();
    let ending = serve(Cursor::new(bytes), &mut said, &mut port(), |_| {});
    (ending, said)
}

/// Code, number and status of each answer.
fn answers(mut said: &[u8]) -> Vec<(u32, u32, i32)> {
    let mut all = Vec::new();
    while said.len() >= 48 {
        let word = |at: usize| u32::from_be_bytes(said[at..at + 4].try_into().unwrap());
        let data = if word(0) == 3 && word(4) == 1 { word(24) as usize } else { 0 };
        all.push((word(0), word(4), word(20) as i32));
        said = &said[48 + data..];
    }
    assert!(said.is_empty());
    all
}

#[test]
fn a_whole_exchange_is_answered() {
    let (ending, said) = play(script().concat());
    assert_eq!(ending.unwrap(), Ending::HostLeft);
    assert_eq!(answers(&said), [(3, 1, 0), (3, 3, 0), (3, 4, -32), (4, 5, -104), (4, 6, 0)]);
    assert_eq!(&said[48..50], [18, 1]);
    assert_eq!(u32::from_be_bytes(said[24..28].try_into().unwrap()), 18);
}

#[test]
fn every_truncation_ends_in_order() {
    let script = script();
    let whole = script.concat();
    let (_, complete) = play(whole.clone());
    let mut ends = vec![0];
    ends.extend(script.iter().scan(0, |at, message| {
        *at += message.len();
        Some(*at)
    }));
    for length in 0..=whole.len() {
        let (ending, said) = play(whole[..length].to_vec());
        assert_eq!(ending.is_ok(), ends.contains(&length), "{length} bytes: {ending:?}");
        assert!(complete.starts_with(&said), "{length} bytes");
    }
}

#[test]
fn what_makes_no_sense_is_refused() {
    let refusal = |bytes: Vec<u8>| play(bytes).0.unwrap_err().to_string();
    assert!(refusal(submit(1, 1, false, u32::MAX, [0; 8], &[])).contains("4294967295 bytes"));
    assert!(refusal(message([9, 1, 0, 0, 0, 0, 0, 0, 0, 0], [0; 8])).contains("unknown message, 0x9"));
    assert!(refusal(message([1, 1, 0, 1, 1, 0, 0, 0, 7, 0], [0; 8])).contains("isochronous transfer of 7"));
    // Transfers that never end, without end.
    let flood: Vec<u8> = (0..2000).flat_map(|id| submit(id, 1, true, 512, [0; 8], &[])).collect();
    assert!(refusal(flood).contains("does not wait"));
}

#[test]
fn transfers_are_read_as_they_were_written() {
    let read = |bytes: Vec<u8>| read_command(&mut &bytes[..]).unwrap().unwrap();
    let to = Transfer { id: 3, pipe: Pipe::Bulk(OUT), bytes: vec![5; 700], room: 0 };
    assert_eq!(read(script()[2].clone()), Command::Submit(to));
    let from = Transfer { id: 2, pipe: Pipe::Bulk(IN), bytes: vec![], room: 4096 };
    assert_eq!(read(script()[1].clone()), Command::Submit(from));
    let pipe = Pipe::Control(Setup { kind: 0x80, request: 6, value: 0x100, index: 0, length: 18 });
    assert_eq!(read(script()[0].clone()), Command::Submit(Transfer { id: 1, pipe, bytes: vec![], room: 18 }));
    assert_eq!(read(unlink(5, 2)), Command::Unlink { id: 5, victim: 2 });
}

fn greeted(bytes: &[u8], is_free: bool) -> (Result<bool, UsbIpError>, Vec<u8>) {
    let mut said = Vec::new();
    let request = read_request(&mut Cursor::new(bytes));
    let given = request.and_then(|request| greet(&request, &mut said, port().function().descriptors(), is_free));
    (given, said)
}

fn import(name: &str) -> Vec<u8> {
    let mut bytes = vec![1, 0x11, 0x80, 3, 0, 0, 0, 0];
    bytes.extend(name.bytes());
    bytes.resize(40, 0);
    bytes
}

#[test]
fn one_client_has_the_device() {
    let (given, list) = greeted(&[1, 0x11, 0x80, 5, 0, 0, 0, 0], true);
    assert!(!given.unwrap());
    // Header, count, record, two interfaces of four bytes: usbip_protocol.rst.
    assert_eq!(list.len(), 8 + 4 + 312 + 2 * 4);
    assert_eq!((&list[2..4], list[11], &list[list.len() - 8..]), (&[0, 5][..], 1, &[0xFF, 0, 0, 0, 0xFE, 1, 1, 0][..]));
    let (given, answer) = greeted(&import("1-1"), true);
    assert!(given.unwrap());
    assert_eq!((answer.len(), &answer[2..8]), (320, &[0, 3, 0, 0, 0, 0][..]));
    assert!(answer[8..].starts_with(b"/sys/") && answer[8 + 256..].starts_with(b"1-1\0"));
    for (name, is_free, status) in [("1-1", false, 2), ("7-7", true, 4)] {
        let (given, answer) = greeted(&import(name), is_free);
        assert!(!given.unwrap());
        assert_eq!(answer, [1, 0x11, 0, 3, 0, 0, 0, status]);
    }
    for length in 0..import("1-1").len() {
        assert!(greeted(&import("1-1")[..length], true).0.is_err(), "{length} bytes");
    }
    assert!(greeted(&[1, 0x10, 0x80, 5, 0, 0, 0, 0], true).0.unwrap_err().to_string().contains("0x0110"));
    assert!(greeted(&[1, 0x11, 0x80, 9, 0, 0, 0, 0], true).0.unwrap_err().to_string().contains("0x8009"));
}

#[test]
fn a_device_that_leaves_ends_the_connection() {
    // A reader that waits for ever, as a socket does.
    let (reader, _kept) = std::io::pipe().unwrap();
    let ending = serve(reader, Vec::new(), &mut port(), |port| port.unplug());
    assert_eq!(ending.unwrap(), Ending::DeviceLeft);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nonsense_never_panics(script in prop::collection::vec(any::<u8>(), 0..400), code in 0u32..4, at in 0usize..700) {
        let mut bytes = self::script().concat();
        bytes.truncate(at);
        bytes.extend(code.to_be_bytes());
        bytes.extend(script);
        let _ = play(bytes.clone());
        let _ = greeted(&bytes, true);
    }
}
