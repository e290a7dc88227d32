//! What both ends know before a plane comes.

use super::byte_codes::{ByteCodes, ByteCodesError};
use super::mask::{Mask, MaskError};
use crate::message::Knowledge;
use thiserror::Error;

/// What was sent is no mask, or no codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum LearnError {
    /// See the message.
    #[error(
        "bytes from {offset} to {end} of {total} came, bytes from {expected} on are next, of at most {KNOWLEDGE_BYTES_MAX}"
    )]
    Part {
        /// The first byte of the part.
        offset: usize,
        /// One past its last byte.
        end: usize,
        /// Bytes altogether.
        total: usize,
        /// The first byte that is missing.
        expected: usize,
    },
    /// See the message.
    #[error(transparent)]
    Mask(#[from] MaskError),
    /// See the message.
    #[error(transparent)]
    Codes(#[from] ByteCodesError),
}

/// The halftone's mask and the codes of bytes, as far as the host has sent them.
#[derive(Clone, Debug)]
pub struct Codebook {
    /// For planes of sorted blocks.
    pub mask: Mask,
    /// For planes of bytes.
    pub codes: ByteCodes,
    /// What comes in parts: what it is, and how much of it is here.
    coming: Knowledge,
    received: usize,
    parts: [u8; KNOWLEDGE_BYTES_MAX],
}

/// The most bytes of what both ends know: a mask of 64 × 64.
pub const KNOWLEDGE_BYTES_MAX: usize = 2 * 64 * 64;

impl Codebook {
    /// Empty.
    pub const EMPTY: Self = Self {
        mask: Mask::NONE,
        codes: ByteCodes::NONE,
        coming: Knowledge::Mask,
        received: 0,
        parts: [0; KNOWLEDGE_BYTES_MAX],
    };

    /// Takes `bytes` from `offset` of `total` on, as [`Knowledge`] has them. Parts follow each other, may repeat, and begin again at 0: then
    /// there is nothing of the kind until the last has come, nor after an error with it.
    pub fn learn(&mut self, kind: Knowledge, [offset, total]: [usize; 2], bytes: &[u8]) -> Result<(), LearnError> {
        if offset == 0 {
            (self.coming, self.received) = (kind, 0);
            match kind {
                Knowledge::Mask => self.mask.forget(),
                Knowledge::Codes => self.codes.forget(),
            }
        }
        let (end, expected) = (offset + bytes.len(), if kind == self.coming { self.received } else { 0 });
        let wrong = LearnError::Part { offset, end, total, expected };
        let place = self.parts.get_mut(offset..).and_then(|rest| rest.get_mut(..bytes.len()));
        let place =
            place.filter(|_| offset <= expected && end <= total && total <= KNOWLEDGE_BYTES_MAX).ok_or(wrong)?;
        place.copy_from_slice(bytes);
        self.received = expected.max(end);
        let whole = self.parts.get(..total).filter(|_| self.received == total);
        match (whole, kind) {
            (Some(whole), Knowledge::Mask) => {
                self.mask.set(whole.as_chunks().0.iter().map(|rank| u16::from_le_bytes(*rank)))?;
            }
            (Some(whole), Knowledge::Codes) => self.codes.set(whole)?,
            (None, _) => {}
        }
        Ok(())
    }

    /// Knows nothing any more.
    pub fn forget(&mut self) {
        self.mask.forget();
        self.codes.forget();
        self.received = 0;
    }
}
