//! A plane, compressed so that a small device can expand it: forward only, without allocation, from pieces of any length.
//!
//! An expanded plane is one bit a pixel, row by row from the top; a row is packed least significant bit first (pixel x is bit
//! `x % 8` of byte `x / 8`) and padded to whole bytes.
//!
//! A compressed plane is a sequence of runs. A run's first byte holds its kind (upper two bits) and its length (lower six):
//! 0 to 60 mean 1 to 61 bytes, 61 to 63 mean 62 bytes and the little-endian number in the next 1 to 3 bytes.
//!
//! | kind | run | follows |
//! |---|---|---|
//! | 0 | bytes as they are | the bytes |
//! | 1 | zeros | nothing |
//! | 2 | one byte again and again | the byte |
//! | 3 | the bytes one row above | nothing |

use crc::{CRC_64_XZ, Crc, Table};
use thiserror::Error;

#[cfg(feature = "std")]
mod compress;
#[cfg(feature = "std")]
pub use compress::compress;

// 16 lanes are eight times as fast and take 32 KiB, which a controller may not have.
#[cfg(feature = "std")]
type Lanes = Table<16>;
#[cfg(not(feature = "std"))]
type Lanes = Table<1>;
static CRC_64: Crc<u64, Lanes> = Crc::<u64, Lanes>::new(&CRC_64_XZ);

const KIND_LITERAL: u8 = 0;
const KIND_ZERO: u8 = 1;
const KIND_REPEAT: u8 = 2;
#[cfg(feature = "std")]
const KIND_ABOVE: u8 = 3;
/// The first length that does not fit in a run's first byte.
const LENGTH_LONG: usize = 62;

/// The size of a picture in pixels. Checked on construction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageSize {
    width: u16,
    height: u16,
}

/// An image size that no rig has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("image of {width} x {height} pixels: each must be from 1 to 4096")]
pub struct ImageSizeError {
    /// Pixels of a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl ImageSize {
    /// The largest width and height.
    pub const PIXELS_MAX: u32 = 4096;

    /// `width` x `height` pixels, each from 1 to 4096.
    pub const fn new(width: u32, height: u32) -> Result<Self, ImageSizeError> {
        if width == 0 || width > Self::PIXELS_MAX || height == 0 || height > Self::PIXELS_MAX {
            return Err(ImageSizeError { width, height });
        }
        Ok(Self { width: width as u16, height: height as u16 })
    }

    /// Pixels of a row.
    pub const fn width(self) -> u32 {
        self.width as u32
    }

    /// Rows.
    pub const fn height(self) -> u32 {
        self.height as u32
    }

    /// Bytes of a row of a plane.
    pub const fn row_bytes(self) -> usize {
        (self.width as usize).div_ceil(8)
    }

    /// Bytes of an expanded plane: at most 2 MiB.
    pub const fn plane_bytes(self) -> usize {
        self.row_bytes() * self.height as usize
    }
}

/// The check that travels with a plane: CRC-64/XZ of its expanded bytes.
pub fn plane_check(plane: &[u8]) -> u64 {
    CRC_64.checksum(plane)
}

/// The check of a whole turn: CRC-64/XZ of the turn's number and its planes' checks, slice 0 first, little-endian.
///
/// Over checks and not over planes, so that a device that expands planes as they come need not read them again.
pub fn turn_check(turn: u32, plane_checks: impl IntoIterator<Item = u64>) -> u64 {
    let mut digest = CRC_64.digest();
    digest.update(&turn.to_le_bytes());
    plane_checks.into_iter().for_each(|check| digest.update(&check.to_le_bytes()));
    digest.finalize()
}

/// Why a plane was not expanded. Its memory may hold anything then.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ExpandError {
    /// See the message.
    #[error("memory of {given} bytes for a plane of {needed}")]
    Memory {
        /// Bytes of memory.
        given: usize,
        /// Bytes of a plane.
        needed: usize,
    },
    /// See the message.
    #[error("a run of {length} bytes at byte {at} leaves the plane")]
    TooLong {
        /// Where the run begins.
        at: usize,
        /// Its length.
        length: usize,
    },
    /// See the message.
    #[error("a run at byte {at} copies from above the first row")]
    NothingAbove {
        /// Where the run begins.
        at: usize,
    },
    /// See the message.
    #[error("the compressed plane ends at byte {at} of {needed}")]
    Truncated {
        /// Bytes that were expanded.
        at: usize,
        /// Bytes of a plane.
        needed: usize,
    },
    /// See the message.
    #[error("the expanded plane has check {found:#018x}: {expected:#018x} was sent with it")]
    Check {
        /// What was sent.
        expected: u64,
        /// What was expanded.
        found: u64,
    },
}

/// What the next compressed byte is.
#[derive(Clone, Copy, Debug)]
enum Next {
    Head,
    Length { kind: u8, missing: u8, bits: u8, value: usize },
    Literal { left: usize },
    Repeated { length: usize },
}

/// Expands one plane.
///
/// [`push`](Self::push) pieces of the compressed plane in order, then [`finish`](Self::finish). The plane is right only where
/// both succeed.
#[derive(Clone, Copy, Debug)]
pub struct Expander {
    size: ImageSize,
    at: usize,
    next: Next,
}

impl Expander {
    /// For a plane of `size`.
    pub const fn new(size: ImageSize) -> Self {
        Self { size, at: 0, next: Next::Head }
    }

    /// Expands `input` into `plane`, which must be the same memory for every piece: [`ImageSize::plane_bytes`] of it.
    pub fn push(&mut self, mut input: &[u8], plane: &mut [u8]) -> Result<(), ExpandError> {
        self.check_memory(plane)?;
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

    /// Whether the plane is complete and is what `check`, its [`plane_check`], says.
    pub fn finish(self, plane: &[u8], check: u64) -> Result<(), ExpandError> {
        self.check_memory(plane)?;
        if self.at != plane.len() || !matches!(self.next, Next::Head) {
            return Err(ExpandError::Truncated { at: self.at, needed: plane.len() });
        }
        let found = plane_check(plane);
        if found != check {
            return Err(ExpandError::Check { expected: check, found });
        }
        Ok(())
    }

    fn check_memory(&self, plane: &[u8]) -> Result<(), ExpandError> {
        let needed = self.size.plane_bytes();
        if plane.len() != needed {
            return Err(ExpandError::Memory { given: plane.len(), needed });
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

#[cfg(test)]
mod tests;
