//! The host's USB link.

use crate::bare::{self, MEGABYTE, PATIENCE, open, patiently};
use crate::cable::Cable;
use crate::controller::{Sink, board};
use host::link::usb::UsbLink;
use host::link::{Link, LinkError};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// What the link must move of what a bare loop moves.
const SHARE: f64 = 0.8;
/// Bytes of a measurement.
const TOTAL: usize = 32 << 20;
/// An odd number: the median is one of them.
const ROUNDS: usize = 9;
/// What a stream hands over at once.
const PACKET: usize = 16 << 10;

/// A link to that device, as soon as it is there.
pub fn link(name: &str) -> UsbLink {
    let name = name.parse().expect("a device's name");
    patiently(|| UsbLink::open(&name))
}

/// Megabytes a second until the device has them all, handed over in pieces of so many bytes.
fn speed(counted: &AtomicUsize, piece: usize) -> f64 {
    let (mut link, before) = (link("usb"), counted.load(Ordering::Relaxed));
    let bytes = vec![0x5A; piece];
    let start = Instant::now();
    let (mut sent, mut heard) = (0, Vec::new());
    while sent < TOTAL {
        let count = link.send(&bytes[..piece.min(TOTAL - sent)]).unwrap();
        sent += count;
        if count == 0 {
            link.receive(&mut heard, PATIENCE).unwrap();
        }
    }
    while counted.load(Ordering::Relaxed) - before < TOTAL {
        link.receive(&mut heard, Duration::from_millis(1)).unwrap();
        assert!(start.elapsed() < PATIENCE, "{} bytes of {TOTAL}", counted.load(Ordering::Relaxed) - before);
    }
    TOTAL as f64 / MEGABYTE / start.elapsed().as_secs_f64()
}

/// Turn about with the fastest bare loop, handed the same pieces: what else the machine does meanwhile comes to both, and the median of
/// their ratios is not that of one lucky round. What a stream's packets move is said beside it: they leave before a transfer is full
/// where little is in flight.
pub fn is_as_fast_as_a_bare_loop() {
    let counted = Arc::new(AtomicUsize::new(0));
    let theirs = Arc::clone(&counted);
    let _cable = Cable::plug(0, || board(Sink(theirs), "1"));
    let (size, _) = bare::fastest();
    // One has the device at a time.
    let round = |_| {
        let bare = bare::speed(&open(), size, TOTAL);
        let [link, packets] = [size, PACKET].map(|piece| speed(&counted, piece));
        [bare, link, packets, link / bare, packets / bare]
    };
    let rounds: Vec<_> = (0..ROUNDS).map(round).collect();
    let [bare, link, packets, share, packets_share] = std::array::from_fn(|of| median(&rounds, of));
    println!("bare loop, writes of {size} bytes: {bare:.1} MB/s");
    println!("UsbLink, the same pieces: {link:.1} MB/s, {share:.2} of it; at least {SHARE} is wanted");
    println!("UsbLink, pieces of {PACKET} bytes: {packets:.1} MB/s, {packets_share:.2} of it");
    assert!(share >= SHARE);
}

fn median(rounds: &[[f64; 5]], of: usize) -> f64 {
    let mut values: Vec<_> = rounds.iter().map(|round| round[of]).collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Two controllers are told apart by their serial numbers.
pub fn finds_one_of_two() {
    let _first = Cable::plug(0, || board(Sink::default(), "1"));
    let counted = Arc::new(AtomicUsize::new(0));
    let theirs = Arc::clone(&counted);
    let _second = Cable::plug(1, || board(Sink(theirs), "2"));
    drop((link("usb:1209:0001:1"), link("usb:1209:0001:2")));
    match UsbLink::open(&"usb".parse().unwrap()) {
        Err(LinkError::Several { found, .. }) => assert_eq!(found, ["usb:1209:0001:1", "usb:1209:0001:2"]),
        other => panic!("{other:?}"),
    }
    let mut link = link("usb:1209:0001:2");
    assert_eq!(link.send(&[1; 100]).unwrap(), 100);
    // A second program.
    let other = UsbLink::open(&"usb:1209:0001:2".parse().unwrap());
    assert!(matches!(other, Err(LinkError::InUse { .. })), "{other:?}");
    link.receive(&mut Vec::new(), Duration::from_millis(50)).unwrap();
    assert_eq!(counted.load(Ordering::Relaxed), 100);
    let absent = UsbLink::open(&"usb:1209:0001:3".parse().unwrap());
    assert!(matches!(absent, Err(LinkError::Absent { .. })), "{absent:?}");
}
