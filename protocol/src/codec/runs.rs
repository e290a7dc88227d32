//! A plane as a sequence of runs of bytes.
//!
//! A run's first byte holds its kind (upper two bits) and its length (lower six): 0 to 60 mean 1 to 61 bytes, 61 to 63 mean 62 bytes and
//! the little-endian number in the next 1 to 3 bytes.
//!
//! | kind | run | follows |
//! |---|---|---|
//! | 0 | bytes as they are | the bytes |
//! | 1 | zeros | nothing |
//! | 2 | one byte again and again | the byte |
//! | 3 | the bytes one row above | nothing |

use super::{ExpandError, ImageSize};

#[cfg(feature = "std")]
pub(super) mod compress;

const KIND_LITERAL: u8 = 0;
const KIND_ZERO: u8 = 1;
const KIND_REPEAT: u8 = 2;
#[cfg(feature = "std")]
const KIND_ABOVE: u8 = 3;
/// The first length that does not fit in a run's first byte.
const LENGTH_LONG: usize = 62;

/// What the next compressed byte is.
#[derive(Clone, Copy, Debug)]
enum Next {
    Head,
    Length { kind: u8, missing: u8, bits: u8, value: usize },
    Literal { left: usize },
    Repeated { length: usize },
}

/// Expands one plane: see [`super::Expander`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Runs {
    size: ImageSize,
    at: usize,
    next: Next,
}

impl Runs {
    pub(super) const fn new(size: ImageSize) -> Self {
        Self { size, at: 0, next: Next::Head }
    }

    pub(super) fn push(&mut self, mut input: &[u8], plane: &mut [u8]) -> Result<(), ExpandError> {
        while let [first, rest @ ..] = input {
            input = match self.next {
                Next::Literal { left } => self.literal(left, input, plane),
                Next::Head => self.head(*first, plane).map(|()| rest)?,
                Next::Length { .. } => self.length(*first, plane).map(|()| rest)?,
                Next::Repeated { length } => {
                    self.fill(length, *first, plane);
                    rest
                }
            };
        }
        Ok(())
    }

    /// Whether the plane is complete.
    pub(super) fn finish(&self, plane: &[u8]) -> Result<(), ExpandError> {
        if self.at != plane.len() || !matches!(self.next, Next::Head) {
            return Err(ExpandError::Truncated { at: self.at, needed: plane.len() });
        }
        Ok(())
    }

    fn head(&mut self, byte: u8, plane: &mut [u8]) -> Result<(), ExpandError> {
        let (kind, code) = (byte >> 6, usize::from(byte & 63));
        if code + 1 < LENGTH_LONG {
            return self.run(kind, code + 1, plane);
        }
        self.next = Next::Length { kind, missing: (code + 2 - LENGTH_LONG) as u8, bits: 0, value: 0 };
        Ok(())
    }

    fn length(&mut self, byte: u8, plane: &mut [u8]) -> Result<(), ExpandError> {
        let Next::Length { kind, missing, bits, value } = self.next else { return Ok(()) };
        let value = value | usize::from(byte) << bits;
        if missing == 1 {
            return self.run(kind, value + LENGTH_LONG, plane);
        }
        self.next = Next::Length { kind, missing: missing - 1, bits: bits + 8, value };
        Ok(())
    }

    /// Begins a run. What is written later is checked here: `at + length` never leaves the plane. Those who write ask for their part of the
    /// plane all the same, for a compiler that does not know this: nothing here can panic.
    fn run(&mut self, kind: u8, length: usize, plane: &mut [u8]) -> Result<(), ExpandError> {
        let at = self.at;
        if length > plane.len() - at {
            return Err(ExpandError::TooLong { at, length });
        }
        match kind {
            KIND_LITERAL => self.next = Next::Literal { left: length },
            KIND_ZERO => self.fill(length, 0, plane),
            KIND_REPEAT => self.next = Next::Repeated { length },
            _ => self.copy_above(length, plane)?,
        }
        Ok(())
    }

    fn literal<'a>(&mut self, left: usize, input: &'a [u8], plane: &mut [u8]) -> &'a [u8] {
        let (bytes, rest) = input.split_at(left.min(input.len()));
        if let Some(place) = plane.get_mut(self.at..).and_then(|rest| rest.get_mut(..bytes.len())) {
            place.copy_from_slice(bytes);
        }
        self.at += bytes.len();
        self.next = if left == bytes.len() { Next::Head } else { Next::Literal { left: left - bytes.len() } };
        rest
    }

    fn fill(&mut self, length: usize, byte: u8, plane: &mut [u8]) {
        plane.get_mut(self.at..).and_then(|rest| rest.get_mut(..length)).unwrap_or_default().fill(byte);
        self.at += length;
        self.next = Next::Head;
    }

    fn copy_above(&mut self, length: usize, plane: &mut [u8]) -> Result<(), ExpandError> {
        let row = self.size.row_bytes();
        let mut from = self.at.checked_sub(row).ok_or(ExpandError::NothingAbove { at: self.at })?;
        // A run longer than a row copies what it has just written: at most a row at a time, so that source and target are apart.
        let end = self.at + length;
        while self.at < end {
            let piece = row.min(end - self.at);
            let Some((above, below)) = plane.split_at_mut_checked(self.at) else { break };
            if let (Some(above), Some(below)) =
                (above.get(from..).and_then(|row| row.get(..piece)), below.get_mut(..piece))
            {
                below.copy_from_slice(above);
            }
            (from, self.at) = (from + piece, self.at + piece);
        }
        self.next = Next::Head;
        Ok(())
    }
}
