//! What both ends know before a plane comes.

use super::byte_codes::{ByteCodes, ByteCodesError};
use super::mask::{Mask, MaskError};
use crate::message::Knowledge;
use thiserror::Error;

/// What was sent is no mask, or no codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum LearnError {
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
}

impl Codebook {
    /// Empty.
    pub const EMPTY: Self = Self { mask: Mask::NONE, codes: ByteCodes::NONE };

    /// Takes `bytes`, as [`Knowledge`] has them. After an error there is nothing of the kind.
    pub fn learn(&mut self, kind: Knowledge, bytes: &[u8]) -> Result<(), LearnError> {
        match kind {
            Knowledge::Mask => self.mask.set(bytes.as_chunks().0.iter().map(|rank| u16::from_le_bytes(*rank)))?,
            Knowledge::Codes => self.codes.set(bytes)?,
        }
        Ok(())
    }

    /// Knows nothing any more.
    pub fn forget(&mut self) {
        self.mask.forget();
        self.codes.forget();
    }
}
