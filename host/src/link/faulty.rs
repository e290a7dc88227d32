//! A link that damages what it carries, for tests.

use super::{Link, LinkError};
use std::time::Duration;

/// How often a [`FaultyLink`] does what, as probabilities.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FaultRates {
    /// One bit of a byte is flipped.
    pub flip: f64,
    /// A byte is left out.
    pub drop: f64,
    /// A byte comes twice.
    pub repeat: f64,
    /// A whole transfer comes twice.
    pub repeat_transfer: f64,
}

/// Damages the bytes of another link in both directions: the same damage for the same seed and the same traffic.
#[derive(Debug)]
pub struct FaultyLink<L> {
    link: L,
    rates: FaultRates,
    state: u64,
}

impl<L: Link> FaultyLink<L> {
    /// Around `link`.
    pub fn new(link: L, rates: FaultRates, seed: u64) -> Self {
        Self { link, rates, state: seed }
    }

    /// The link inside.
    pub fn inner(&self) -> &L {
        &self.link
    }

    /// SplitMix64 (Steele, Lea and Flood 2014): enough for where a fault falls.
    fn random(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.state ^ self.state >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ mixed >> 31
    }

    fn happens(&mut self, probability: f64) -> bool {
        ((self.random() >> 11) as f64) < probability * (1u64 << 53) as f64
    }

    fn damage(&mut self, bytes: &[u8]) -> Vec<u8> {
        let rates = self.rates;
        let mut damaged = Vec::with_capacity(bytes.len() + 8);
        for &byte in bytes {
            let byte = if self.happens(rates.flip) { byte ^ 1 << (self.random() % 8) } else { byte };
            if !self.happens(rates.drop) {
                damaged.push(byte);
            }
            if self.happens(rates.repeat) {
                damaged.push(byte);
            }
        }
        if self.happens(rates.repeat_transfer) {
            damaged.extend_from_within(..);
        }
        damaged
    }
}

impl<L: Link> Link for FaultyLink<L> {
    fn send(&mut self, bytes: &[u8]) -> Result<usize, LinkError> {
        let damaged = self.damage(bytes);
        let mut rest = &damaged[..];
        while !rest.is_empty() {
            match self.link.send(rest)? {
                // A full link loses the rest: one fault more.
                0 => break,
                sent => rest = &rest[sent..],
            }
        }
        Ok(bytes.len())
    }

    fn receive(&mut self, into: &mut Vec<u8>, wait: Duration) -> Result<usize, LinkError> {
        let mut bytes = Vec::new();
        self.link.receive(&mut bytes, wait)?;
        let damaged = self.damage(&bytes);
        into.extend_from_slice(&damaged);
        Ok(damaged.len())
    }

    fn now(&self) -> Duration {
        self.link.now()
    }
}
