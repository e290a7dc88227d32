//! Faults that are remembered: which one holds, why, and how often each came; across resets.
//!
//! The core only keeps the log. A board writes [`FaultLog::to_bytes`] into memory that survives a reset whenever it differs from what was
//! written last, before it acts on the step's output, and starts the next controller from what it reads there. Whatever it reads that
//! was not written whole is a fault of its own: a log is never empty by accident.

use protocol::codec::plane_check;
use protocol::message::{Fault, Faults, Quantity};
use protocol::units::Nanos;

/// Bytes of a log in memory.
pub const LOG_BYTES: usize = CHECK + 8;

/// What a log begins with; its last byte counts up where the layout changes.
const MAGIC: [u8; 4] = *b"pfl1";
const NO_FAULT: u8 = 0xff;
const LATCHED: usize = 4;
const QUANTITY: usize = 5;
const COUNTS: usize = 6;
const VALUE: usize = COUNTS + 2 * Fault::ALL.len();
const LIMIT: usize = VALUE + 8;
const AT: usize = LIMIT + 8;
const CHECK: usize = AT + 8;

/// What was measured when a fault was found, and what is allowed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cause {
    /// What was measured.
    pub quantity: Quantity,
    /// Its value, in the quantity's unit.
    pub value: f32,
    /// What is allowed, in the same unit.
    pub limit: f32,
}

impl Cause {
    /// An input that is active, or a record that is damaged.
    pub const LEVEL: Self = Self { quantity: Quantity::Level, value: 1.0, limit: 0.0 };

    /// A time of which more than `limit` has passed.
    pub fn time(passed: Nanos, limit: Nanos) -> Self {
        let seconds = |time: Nanos| time.0 as f32 * 1e-9;
        Self { quantity: Quantity::Time, value: seconds(passed), limit: seconds(limit) }
    }
}

/// The log. What a host is told of it is what it is: [`Faults`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultLog(Faults);

impl Default for FaultLog {
    /// No fault ever.
    fn default() -> Self {
        Self(Faults {
            latched: None,
            quantity: Quantity::Level,
            value_micro: 0,
            limit_micro: 0,
            at_us: 0,
            counts: [0; Fault::ALL.len()],
        })
    }
}

impl FaultLog {
    /// The fault that holds.
    pub fn latched(&self) -> Option<Fault> {
        self.0.latched
    }

    /// All of it, for a host.
    pub fn faults(&self) -> Faults {
        self.0
    }

    /// `fault` was found at `at`. The first one holds, with its cause; another one while it holds changes nothing.
    pub fn latch(&mut self, fault: Fault, cause: Cause, at: Nanos) {
        if self.0.latched.is_some() {
            return;
        }
        // A cast of a float stays within its integer, and makes 0 of what is no number.
        let micro = |value: f32| libm::round(libm::fabs(f64::from(value)) * 1e6) as u64;
        let mut counts = self.0.counts;
        let count = &mut counts[usize::from(fault.code())];
        *count = count.saturating_add(1);
        self.0 = Faults {
            latched: Some(fault),
            quantity: cause.quantity,
            value_micro: micro(cause.value),
            limit_micro: micro(cause.limit),
            at_us: at.0 / 1_000,
            counts,
        };
    }

    /// A person has looked: nothing holds any more. Counts and the last cause stay.
    pub fn clear(&mut self) {
        self.0.latched = None;
    }

    /// For memory that survives a reset. Little-endian: magic, code of the latched fault or 0xff, code of the quantity, counts, value,
    /// limit and time; last the check of all before it, a CRC-64 as planes have it.
    pub fn to_bytes(&self) -> [u8; LOG_BYTES] {
        let log = &self.0;
        let mut bytes = [0; LOG_BYTES];
        let mut put = |at: usize, field: &[u8]| bytes[at..at + field.len()].copy_from_slice(field);
        put(0, &MAGIC);
        put(LATCHED, &[log.latched.map_or(NO_FAULT, Fault::code), log.quantity.code()]);
        for (place, count) in log.counts.iter().enumerate() {
            put(COUNTS + 2 * place, &count.to_le_bytes());
        }
        put(VALUE, &log.value_micro.to_le_bytes());
        put(LIMIT, &log.limit_micro.to_le_bytes());
        put(AT, &log.at_us.to_le_bytes());
        let check = plane_check(&bytes[..CHECK]);
        bytes[CHECK..].copy_from_slice(&check.to_le_bytes());
        bytes
    }

    /// What [`FaultLog::to_bytes`] wrote. Anything else, torn, damaged or never written, is a log in which [`Fault::Unknown`] holds.
    pub fn from_bytes(bytes: &[u8; LOG_BYTES]) -> Self {
        Self::read(bytes).unwrap_or_else(|| {
            let mut log = Self::default();
            log.latch(Fault::Unknown, Cause::LEVEL, Nanos::ZERO);
            log
        })
    }

    fn read(bytes: &[u8; LOG_BYTES]) -> Option<Self> {
        let long = |at: usize| bytes[at..].first_chunk().map(|field| u64::from_le_bytes(*field));
        let mut counts = [0; Fault::ALL.len()];
        for (count, field) in counts.iter_mut().zip(bytes[COUNTS..VALUE].as_chunks().0) {
            *count = u16::from_le_bytes(*field);
        }
        let latched = match bytes[LATCHED] {
            NO_FAULT => None,
            code => Some(*Fault::ALL.get(usize::from(code))?),
        };
        let log = Self(Faults {
            latched,
            quantity: *Quantity::ALL.get(usize::from(bytes[QUANTITY]))?,
            value_micro: long(VALUE)?,
            limit_micro: long(LIMIT)?,
            at_us: long(AT)?,
            counts,
        });
        // What was written is what would be written again, byte by byte.
        (log.to_bytes() == *bytes).then_some(log)
    }
}

#[cfg(test)]
#[path = "fault_log_tests.rs"]
mod tests;
