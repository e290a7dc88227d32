//! The other direction: on the host, where memory is no matter.

use super::blocks::compress::BlockCompressor;
use super::runs::compress::compress_runs;
use super::{CODING_BLOCKS, CODING_RUNS, ImageSize, Mask};

/// Compresses planes of one size. Keeps its memory from plane to plane.
#[derive(Clone, Debug)]
pub struct Compressor {
    size: ImageSize,
    blocks: Option<BlockCompressor>,
}

impl Compressor {
    /// For planes of `size`. `mask`: the one that both ends know; planes that were halftoned by it become smallest.
    pub fn new(size: ImageSize, mask: Option<Mask>) -> Self {
        Self { size, blocks: mask.filter(Mask::is_set).map(BlockCompressor::new) }
    }

    /// The mask.
    pub fn mask(&self) -> Option<&Mask> {
        self.blocks.as_ref().map(BlockCompressor::mask)
    }

    /// Appends the compressed form of `plane` to `out`. `shift`: by how much the mask's ranks were moved where `plane` was halftoned by
    /// the mask; a wrong one costs bytes and nothing else.
    pub fn compress(&mut self, plane: &[u8], shift: Option<u16>, out: &mut Vec<u8>) {
        let row_bytes = self.size.row_bytes();
        match (&mut self.blocks, shift) {
            (Some(blocks), Some(shift)) => {
                out.push(CODING_BLOCKS);
                blocks.compress(plane, row_bytes, shift, out);
            }
            _ => {
                out.push(CODING_RUNS);
                compress_runs(plane, row_bytes, out);
            }
        }
    }
}
