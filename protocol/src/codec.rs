//! A plane, compressed so that a small device can expand it: forward only, without allocation, from pieces of any length.
//!
//! An expanded plane is one bit a pixel, row by row from the top; a row is packed least significant bit first (pixel x is bit
//! `x % 8` of byte `x / 8`) and padded to whole bytes.
//!
//! A compressed plane begins with a byte that says how it goes on. No plane needs another to be expanded: one that is lost costs itself.
//!
//! | byte | what follows | good for |
//! |---|---|---|
//! | 0 | [runs](runs) of bytes | test patterns, lines, anything |
//! | 1 | [blocks whose bits are sorted](sorted) | planes halftoned by a mask that both ends know |
//! | 2 | [bytes by their neighbourhood](bytes) | planes halftoned by error diffusion, with codes that both ends know |

use crc::{CRC_64_XZ, Crc, Table};
use thiserror::Error;

mod bits;
mod byte_codes;
mod bytes;
mod codebook;
mod mask;
mod runs;
mod sorted;
mod walk;

#[cfg(feature = "std")]
mod compress;
#[cfg(feature = "std")]
pub use bytes::compress::ByteStatistics;
#[cfg(feature = "std")]
pub use compress::{Compressor, Hint};

pub use byte_codes::{ByteCodes, ByteCodesError, LENGTHS_BYTES};
pub use codebook::{Codebook, KNOWLEDGE_BYTES_MAX, LearnError};
pub use mask::{Mask, MaskError};

// More lanes are faster and take more memory, which a controller may not have.
static CRC_64: Crc<u64, Table<1>> = Crc::<u64, Table<1>>::new(&CRC_64_XZ);

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
    #[cfg(feature = "std")]
    return crc_fast::checksum(crc_fast::CrcAlgorithm::Crc64Xz, plane);
    #[cfg(not(feature = "std"))]
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
    #[error("coding {coding} is not known: 0, 1 and 2 are")]
    Coding {
        /// The first byte.
        coding: u8,
    },
    /// See the message.
    #[error("the plane was compressed by a mask or codes that were not sent before")]
    NotKnown,
    /// See the message.
    #[error("the block in row {row} and column {column} of blocks is impossible")]
    Block {
        /// Its row.
        row: usize,
        /// Its column.
        column: usize,
    },
    /// See the message.
    #[error("{bytes} bytes follow the end of the plane")]
    Trailing {
        /// How many, the last of the plane with them where it is not filled up with zeros.
        bytes: usize,
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

/// How a compressed plane goes on.
const CODING_RUNS: u8 = 0;
const CODING_SORTED: u8 = 1;
const CODING_BYTES: u8 = 2;

#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "no allocation")]
enum Coding {
    Unknown,
    Runs(runs::Runs),
    Sorted(walk::Walk<sorted::Sorted>),
    Bytes(walk::Walk<bytes::Bytes>),
}

/// Expands one plane.
///
/// [`push`](Self::push) pieces of the compressed plane in order, then [`finish`](Self::finish). The plane is right only where
/// both succeed. It has 3 KiB.
#[derive(Clone, Debug)]
pub struct Expander {
    size: ImageSize,
    coding: Coding,
}

impl Expander {
    /// For a plane of `size`.
    pub const fn new(size: ImageSize) -> Self {
        Self { size, coding: Coding::Unknown }
    }

    /// Expands `input` into `plane`, which must be the same memory for every piece: [`ImageSize::plane_bytes`] of it. `book`: what both
    /// ends know; another one than the plane was compressed by gives an error, here or from [`finish`](Self::finish).
    pub fn push(&mut self, mut input: &[u8], book: &Codebook, plane: &mut [u8]) -> Result<(), ExpandError> {
        self.check_memory(plane)?;
        if let (Coding::Unknown, [coding, rest @ ..]) = (&self.coding, input) {
            self.coding = match *coding {
                CODING_RUNS => Coding::Runs(runs::Runs::new(self.size)),
                CODING_SORTED if book.mask.is_set() => Coding::Sorted(walk::Walk::new(self.size)),
                CODING_BYTES if book.codes.is_set() => Coding::Bytes(walk::Walk::new(self.size)),
                CODING_SORTED | CODING_BYTES => return Err(ExpandError::NotKnown),
                coding => return Err(ExpandError::Coding { coding }),
            };
            plane.fill(0);
            input = rest;
        }
        match &mut self.coding {
            Coding::Unknown => Ok(()),
            Coding::Runs(runs) => runs.push(input, plane),
            Coding::Sorted(sorted) => sorted.push(book, input, plane),
            Coding::Bytes(bytes) => bytes.push(book, input, plane),
        }
    }

    /// Expands what is left, and says whether the plane is complete and is what `check`, its [`plane_check`], says.
    pub fn finish(&mut self, book: &Codebook, plane: &mut [u8], check: u64) -> Result<(), ExpandError> {
        self.check_memory(plane)?;
        match &mut self.coding {
            Coding::Unknown => return Err(ExpandError::Truncated { at: 0, needed: plane.len() }),
            Coding::Runs(runs) => runs.finish(plane),
            Coding::Sorted(sorted) => sorted.finish(book, plane),
            Coding::Bytes(bytes) => bytes.finish(book, plane),
        }?;
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
}

#[cfg(test)]
mod tests;
