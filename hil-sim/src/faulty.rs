//! A line that damages what it carries, stalls and comes off, between a host and a device.

use crate::device::Endpoint;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::VecDeque;

/// How often what goes wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FaultRates {
    /// A bit of a byte is flipped; for each byte.
    pub flip: f64,
    /// A byte is left out; for each byte.
    pub drop: f64,
    /// A byte comes twice; for each byte.
    pub repeat: f64,
    /// A whole transfer comes twice; for each transfer.
    pub repeat_transfer: f64,
    /// A transfer comes after the one that was sent after it; for each transfer.
    pub swap: f64,
    /// Nothing is carried for up to [`STALL_S`]; so often a second.
    pub stall: f64,
    /// The plug is pulled for up to [`UNPLUGGED_S`]; so often a second.
    pub unplug: f64,
}

/// The longest stall, seconds.
pub const STALL_S: f64 = 0.3;
/// The longest time without a plug, seconds.
pub const UNPLUGGED_S: f64 = 0.5;

/// How often something went wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultCounts {
    /// Bytes that were changed, left out or repeated.
    pub bytes: u64,
    /// Transfers that were repeated or came late.
    pub transfers: u64,
    /// Stalls.
    pub stalls: u64,
    /// Plugs that were pulled.
    pub unplugs: u64,
}

/// `endpoint` at the end of such a line: the same faults for the same seed and the same traffic.
#[derive(Debug)]
pub struct Faulty<E> {
    endpoint: E,
    rates: FaultRates,
    random: ChaCha8Rng,
    /// On its way to the device.
    waiting: VecDeque<u8>,
    /// A transfer that another one overtakes, each way.
    held: [Option<Vec<u8>>; 2],
    now_s: f64,
    stalled_until_s: f64,
    plugged_at_s: f64,
    plugs: u32,
    counts: FaultCounts,
}

impl<E: Endpoint> Faulty<E> {
    /// A line to `endpoint`, plugged in.
    pub fn new(endpoint: E, rates: FaultRates, seed: u64) -> Self {
        Self {
            endpoint,
            rates,
            random: ChaCha8Rng::seed_from_u64(seed),
            waiting: VecDeque::new(),
            held: [None, None],
            now_s: 0.0,
            stalled_until_s: 0.0,
            plugged_at_s: 0.0,
            plugs: 0,
            counts: FaultCounts::default(),
        }
    }

    /// The device.
    pub fn endpoint(&self) -> &E {
        &self.endpoint
    }

    /// The device.
    pub fn endpoint_mut(&mut self) -> &mut E {
        &mut self.endpoint
    }

    /// What went wrong so far.
    pub fn counts(&self) -> FaultCounts {
        self.counts
    }

    /// Goes on with other rates.
    pub fn set_rates(&mut self, rates: FaultRates) {
        self.rates = rates;
    }

    /// Pulls the plug for `seconds`: what is on the line is lost.
    pub fn unplug(&mut self, seconds: f64) {
        self.waiting.clear();
        self.held = [None, None];
        self.endpoint.lose_link();
        self.plugged_at_s = self.now_s + seconds;
        self.plugs += 1;
        self.counts.unplugs += 1;
    }

    fn happens(&mut self, probability: f64) -> bool {
        probability > 0.0 && self.random.random_bool(probability.min(1.0))
    }

    /// What comes out where `bytes` go in, in direction `way`.
    fn carry(&mut self, bytes: &[u8], way: usize) -> Vec<u8> {
        let rates = self.rates;
        let mut carried = Vec::with_capacity(bytes.len() + 8);
        for &byte in bytes {
            let [flip, drop, repeat] = [rates.flip, rates.drop, rates.repeat].map(|rate| self.happens(rate));
            self.counts.bytes += u64::from(flip || drop || repeat);
            let byte = if flip { byte ^ 1 << self.random.random_range(0..8) } else { byte };
            carried.extend(std::iter::repeat_n(byte, usize::from(!drop) + usize::from(repeat)));
        }
        if self.happens(rates.repeat_transfer) {
            carried.extend_from_within(..);
            self.counts.transfers += 1;
        }
        if self.held[way].is_none() && self.happens(rates.swap) {
            self.held[way] = Some(carried);
            self.counts.transfers += 1;
            return Vec::new();
        }
        carried.extend(self.held[way].take().unwrap_or_default());
        carried
    }

    fn is_stalled(&self) -> bool {
        self.now_s < self.stalled_until_s || self.plug().is_none()
    }

    /// What waits goes on, as far as the device takes it.
    fn deliver(&mut self) {
        let taken = self.endpoint.receive(self.waiting.make_contiguous());
        self.waiting.drain(..taken);
    }
}

impl<E: Endpoint> Endpoint for Faulty<E> {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        if bytes.is_empty() || self.is_stalled() || !self.waiting.is_empty() {
            return 0;
        }
        let carried = self.carry(bytes, 0);
        self.waiting.extend(carried);
        self.deliver();
        bytes.len()
    }

    fn transmit(&mut self) -> Vec<u8> {
        if self.is_stalled() {
            return Vec::new();
        }
        let bytes = self.endpoint.transmit();
        if bytes.is_empty() { bytes } else { self.carry(&bytes, 1) }
    }

    fn advance(&mut self, seconds: f64) {
        self.endpoint.advance(seconds);
        self.now_s += seconds;
        if self.plug().is_none() {
            // What it says goes nowhere.
            self.endpoint.transmit();
            return;
        }
        if self.happens(self.rates.stall * seconds) {
            self.stalled_until_s = self.now_s + self.random.random_range(0.0..STALL_S);
            self.counts.stalls += 1;
        }
        if self.happens(self.rates.unplug * seconds) {
            let seconds = self.random.random_range(0.0..UNPLUGGED_S);
            return self.unplug(seconds);
        }
        if !self.is_stalled() {
            let late = self.held[0].take().unwrap_or_default();
            self.waiting.extend(late);
            self.deliver();
        }
    }

    fn lose_link(&mut self) {
        self.endpoint.lose_link();
    }

    fn plug(&self) -> Option<u32> {
        (self.now_s >= self.plugged_at_s).then_some(self.plugs)
    }

    fn is_at_rest(&self) -> bool {
        self.endpoint.is_at_rest()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Says what it hears, and counts.
    #[derive(Debug, Default)]
    struct Echo {
        said: Vec<u8>,
        heard: Vec<u8>,
        lost: u32,
    }

    impl Endpoint for Echo {
        fn receive(&mut self, bytes: &[u8]) -> usize {
            let taken = bytes.len().min(100);
            self.heard.extend_from_slice(&bytes[..taken]);
            self.said.extend_from_slice(&bytes[..taken]);
            taken
        }

        fn transmit(&mut self) -> Vec<u8> {
            std::mem::take(&mut self.said)
        }

        fn advance(&mut self, _seconds: f64) {}

        fn lose_link(&mut self) {
            self.lost += 1;
        }
    }

    fn line(rates: FaultRates) -> Faulty<Echo> {
        Faulty::new(Echo::default(), rates, 5)
    }

    #[test]
    fn a_line_without_faults_carries_all_at_the_pace_of_the_device() {
        let mut line = line(FaultRates::default());
        assert_eq!((line.receive(&[7; 250]), line.receive(&[8; 9])), (250, 0));
        assert_eq!(line.endpoint().heard.len(), 100);
        line.advance(0.1);
        line.advance(0.1);
        assert_eq!(line.transmit(), [7; 250]);
        assert_eq!((line.receive(&[8; 9]), line.plug(), line.counts()), (9, Some(0), FaultCounts::default()));
    }

    #[test]
    fn faults_come_as_often_as_they_are_asked_for() {
        let mut line = line(FaultRates { flip: 0.1, drop: 0.2, repeat: 0.05, ..FaultRates::default() });
        for _ in 0..1_000 {
            line.receive(&[0; 100]);
        }
        let heard = &line.endpoint().heard;
        let flipped = heard.iter().filter(|byte| **byte != 0).count() as f64 / heard.len() as f64;
        // A byte that is dropped and repeated comes once.
        assert!((heard.len() as f64 / 1e5 - 0.85).abs() < 0.01, "{}", heard.len());
        assert!((flipped - 0.1).abs() < 0.01, "{flipped}");
    }

    #[test]
    fn a_transfer_may_overtake_another() {
        let mut line = line(FaultRates { swap: 0.5, ..FaultRates::default() });
        for number in 0..100 {
            line.receive(&[number]);
        }
        line.advance(0.001);
        let mut heard = line.endpoint().heard.clone();
        assert!(!heard.is_sorted() && line.counts().transfers > 10);
        heard.sort_unstable();
        assert_eq!(heard, (0..100).collect::<Vec<_>>());
    }

    #[test]
    fn without_a_plug_nothing_goes_through() {
        let mut line = line(FaultRates::default());
        line.receive(&[1; 150]);
        line.unplug(0.2);
        assert_eq!((line.plug(), line.receive(&[2]), line.transmit(), line.endpoint().lost), (None, 0, vec![], 1));
        line.advance(0.15);
        assert_eq!(line.plug(), None);
        line.advance(0.1);
        assert_eq!((line.plug(), line.receive(&[2])), (Some(1), 1));
        assert_eq!(line.transmit(), [2]);
    }
}
