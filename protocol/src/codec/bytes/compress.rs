//! The other direction: on the host, where memory is no matter.

use super::super::bits::BitWriter;
use super::super::byte_codes::{CONTEXTS, LENGTHS_BYTES};
use super::super::mask::BLOCK;
use super::super::walk::lit::LitRuns;
use super::context;
use std::sync::Arc;

/// The longest code, bits.
const LENGTH_MAX: u8 = 15;

/// How often each byte stood in each neighbourhood.
#[derive(Clone, Debug)]
pub struct ByteStatistics {
    counts: Vec<[u64; 256]>,
    lit: LitRuns,
}

impl Default for ByteStatistics {
    fn default() -> Self {
        Self { counts: vec![[0; 256]; CONTEXTS], lit: LitRuns::default() }
    }
}

impl ByteStatistics {
    /// Takes a plane, rows of `row_bytes`, into account.
    pub fn add(&mut self, plane: &[u8], row_bytes: usize) {
        let counts = &mut self.counts;
        self.lit.find(plane, row_bytes);
        for (row, runs) in self.lit.rows().enumerate() {
            for run in runs {
                for_each_byte(plane, row_bytes, row, *run, |context, byte| counts[context][usize::from(byte)] += 1);
            }
        }
    }

    /// The lengths of the codes that are best for what was added: see [`LENGTHS_BYTES`].
    pub fn lengths(&self) -> Vec<u8> {
        let lengths = self.counts.iter().flat_map(|counts| {
            // What never stood may stand in the next plane.
            let lengths = code_lengths(counts.map(|count| 16 * count + 1));
            lengths.as_chunks().0.iter().map(|[low, high]| low | high << 4).collect::<Vec<_>>()
        });
        let lengths: Vec<u8> = lengths.collect();
        debug_assert_eq!(lengths.len(), LENGTHS_BYTES);
        lengths
    }
}

/// Huffman's code lengths, none above [`LENGTH_MAX`]: where one is, the rare become less rare.
fn code_lengths(mut weights: [u64; 256]) -> [u8; 256] {
    loop {
        // A tree of leaves and of knots, each of which knows the one above it. Leaves ascend; so do knots as they are made.
        let mut leaves: Vec<usize> = (0..256).collect();
        leaves.sort_by_key(|leaf| weights[*leaf]);
        let (mut weight, mut above) = (weights.to_vec(), vec![0; 511]);
        let (mut leaf, mut knot) = (0, 256);
        for made in 256..511 {
            let mut sum = 0;
            for _ in 0..2 {
                let take_leaf = leaf < 256 && (knot >= made || weight[leaves[leaf]] <= weight[knot]);
                let least = if take_leaf { leaves[leaf] } else { knot };
                (leaf, knot) = if take_leaf { (leaf + 1, knot) } else { (leaf, knot + 1) };
                sum += weight[least];
                above[least] = made;
            }
            weight.push(sum);
        }
        let mut depths = vec![0u8; 511];
        for place in (0..510).rev() {
            depths[place] = depths[above[place]] + 1;
        }
        if depths[..256].iter().all(|depth| *depth <= LENGTH_MAX) {
            return core::array::from_fn(|byte| depths[byte]);
        }
        weights = weights.map(|weight| weight / 2 + 1);
    }
}

/// Compresses planes by codes. Keeps its memory from plane to plane; clones share their tables.
#[derive(Clone, Debug)]
pub(in super::super) struct BytesCompressor {
    lit: LitRuns,
    /// By context and byte: a code and its length.
    codes: Arc<[[(u16, u8); 256]]>,
}

impl BytesCompressor {
    /// By the codes that have `lengths`, which are complete.
    pub(in super::super) fn new(lengths: &[u8]) -> Self {
        let codes = lengths.as_chunks().0.iter().map(codes).collect();
        Self { lit: LitRuns::default(), codes }
    }

    /// Appends the stream of `plane`, rows of `row_bytes`, to `out`.
    pub(in super::super) fn compress(&mut self, plane: &[u8], row_bytes: usize, out: &mut Vec<u8>) {
        self.lit.find(plane, row_bytes);
        let mut bits = BitWriter::new(out);
        for (row, runs) in self.lit.rows().enumerate() {
            self.lit.put(row, &mut bits);
            for run in runs {
                for_each_byte(plane, row_bytes, row, *run, |context, byte| {
                    let (code, length) = self.codes[context][usize::from(byte)];
                    bits.put(code.into(), length.into());
                });
            }
        }
        bits.finish();
    }
}

/// Canonical codes: shorter ones first, then by their bytes.
fn codes(lengths: &[u8; 128]) -> [(u16, u8); 256] {
    let length_of = |byte: usize| lengths[byte / 2] >> (byte % 2 * 4) & 15;
    let mut codes = [(0, 0); 256];
    let mut code = 0u32;
    for length in 1..=LENGTH_MAX {
        code <<= 1;
        for byte in (0..256).filter(|byte| length_of(*byte) == length) {
            codes[byte] = (code as u16, length);
            code += 1;
        }
    }
    codes
}

/// The bytes of a run, in the order of the stream, with their contexts.
fn for_each_byte(plane: &[u8], stride: usize, row: usize, bounds: [u16; 2], mut each: impl FnMut(usize, u8)) {
    for y in row * BLOCK..(row + 1) * BLOCK {
        for column in usize::from(bounds[0])..usize::from(bounds[1]) {
            let byte = plane.get(y * stride + column).copied().unwrap_or(0);
            each(context(plane, stride, y, column), byte);
        }
    }
}
