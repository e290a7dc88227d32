//! The other direction: on the host, where memory is no matter.

use super::bytes::compress::BytesCompressor;
use super::runs::compress::compress_runs;
use super::sorted::compress::SortedCompressor;
use super::{ByteCodes, ByteCodesError, CODING_BYTES, CODING_RUNS, CODING_SORTED, ImageSize, Mask};

/// How a plane was halftoned, as far as that helps to compress it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hint {
    /// By the mask that both ends know, its ranks moved by so many; a wrong shift costs bytes and nothing else.
    Mask {
        /// Of its ranks, modulo their number.
        shift: u16,
    },
    /// By error diffusion, or the like.
    Diffusion,
    /// Not at all.
    None,
}

/// Compresses planes of one size. Keeps its memory from plane to plane; clones share what they know.
#[derive(Clone, Debug)]
pub struct Compressor {
    size: ImageSize,
    sorted: Option<SortedCompressor>,
    bytes: Option<BytesCompressor>,
}

impl Compressor {
    /// For planes of `size`, by runs as long as nothing else is known at both ends.
    pub fn new(size: ImageSize) -> Self {
        Self { size, sorted: None, bytes: None }
    }

    /// From now on both ends know `mask`.
    pub fn set_mask(&mut self, mask: Mask) {
        self.sorted = mask.is_set().then(|| SortedCompressor::new(mask));
    }

    /// From now on both ends know the codes that have `lengths`: see [`ByteCodes::set`].
    pub fn set_codes(&mut self, lengths: &[u8]) -> Result<(), ByteCodesError> {
        ByteCodes::NONE.clone().set(lengths)?;
        self.bytes = Some(BytesCompressor::new(lengths));
        Ok(())
    }

    /// Appends the compressed form of `plane` to `out`.
    pub fn compress(&mut self, plane: &[u8], hint: Hint, out: &mut Vec<u8>) {
        let row_bytes = self.size.row_bytes();
        match (hint, &mut self.sorted, &mut self.bytes) {
            (Hint::Mask { shift }, Some(sorted), _) => {
                out.push(CODING_SORTED);
                sorted.compress(plane, row_bytes, shift, out);
            }
            (Hint::Diffusion, _, Some(bytes)) => {
                out.push(CODING_BYTES);
                bytes.compress(plane, row_bytes, out);
            }
            _ => {
                out.push(CODING_RUNS);
                compress_runs(plane, row_bytes, out);
            }
        }
    }
}
