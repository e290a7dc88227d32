//! What both ends know before a plane comes.

use super::byte_codes::ByteCodes;
use super::mask::Mask;

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
}
