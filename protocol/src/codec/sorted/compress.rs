//! The other direction: on the host, where memory is no matter.

use super::super::bits::{BitWriter, UNARY_MAX};
use super::super::mask::{BLOCK, CELLS, Lighting, Mask, Order};
use super::super::walk::{lit::LitRuns, to_zigzag};
use super::{CLASSES, Guess, Neighbours};
use std::sync::Arc;

/// Sorts the pixels of blocks in the order in which a mask lights them: 1 MiB for a mask of 64 × 64.
#[derive(Debug)]
struct Sorter {
    mask: Mask,
    /// By class, row of the block, and that row's byte: where its pixels go.
    sorted: Vec<[[u64; 256]; BLOCK]>,
}

impl Sorter {
    fn new(mask: Mask) -> Self {
        let sorted = mask.lightings().map(|lighting| {
            let mut table = [[0; 256]; BLOCK];
            for place in 0..CELLS {
                let pixel = lighting.pixel(place).trailing_zeros() as usize;
                for (byte, sorted) in table[pixel / BLOCK].iter_mut().enumerate() {
                    *sorted |= ((byte >> (pixel % BLOCK) & 1) as u64) << place;
                }
            }
            table
        });
        Self { sorted: sorted.collect(), mask }
    }
}

/// A lit block, as it will be written.
#[derive(Clone, Copy, Debug)]
struct Code {
    ones: u8,
    zone: u8,
    ones_class: u8,
    zone_class: u8,
    inner: u64,
}

/// Compresses planes that were halftoned by one mask. Keeps its memory from plane to plane; clones share their tables.
#[derive(Clone, Debug)]
pub(in super::super) struct SortedCompressor {
    sorter: Arc<Sorter>,
    lit: LitRuns,
    codes: Vec<Code>,
    /// How many of them each row of blocks has.
    counts: Vec<usize>,
}

/// Numbers that are coded are below this.
const NUMBERS: usize = 2 * CELLS;

/// How often each number comes, for ones and zones by class.
type Counts = [[[u32; NUMBERS]; CLASSES]; 2];

impl SortedCompressor {
    /// For planes halftoned by `mask`, which is set.
    pub(in super::super) fn new(mask: Mask) -> Self {
        let sorter = Arc::new(Sorter::new(mask));
        Self { sorter, lit: LitRuns::default(), codes: Vec::new(), counts: Vec::new() }
    }

    /// Appends the stream of `plane`, rows of `row_bytes`, to `out`. `shift`: by how much the mask's ranks were moved.
    pub(in super::super) fn compress(&mut self, plane: &[u8], row_bytes: usize, shift: u16, out: &mut Vec<u8>) {
        self.lit.find(plane, row_bytes);
        let order = self.sorter.mask.shifted(shift);
        let low = self.sort(plane, row_bytes, &order).each_ref().map(|classes| classes.each_ref().map(cheapest));
        let mut bits = BitWriter::new(out);
        bits.put(shift.into(), 16);
        low.as_flattened().iter().for_each(|low| bits.put((*low).into(), 3));
        let mut codes = self.codes.iter();
        for (row, count) in self.counts.iter().enumerate() {
            self.lit.put(row, &mut bits);
            for code in codes.by_ref().take(*count) {
                bits.put_rice(code.ones.into(), low[0][usize::from(code.ones_class)]);
                bits.put_rice(u32::from(code.zone).saturating_sub(1), low[1][usize::from(code.zone_class)]);
                if code.zone > 2 {
                    bits.put(code.inner, u32::from(code.zone) - 2);
                }
            }
        }
        bits.finish();
    }

    /// Fills `codes` and `counts`, and counts the numbers that are coded.
    fn sort(&mut self, plane: &[u8], row_bytes: usize, order: &Order) -> Counts {
        let mut numbers = [[[0; NUMBERS]; CLASSES]; 2];
        let sorter = &*self.sorter;
        let mut neighbours = Neighbours::NONE;
        self.codes.clear();
        self.counts.clear();
        for (row, (bytes, runs)) in plane.chunks(BLOCK * row_bytes).zip(self.lit.rows()).enumerate() {
            let (begun, mut before) = (self.codes.len(), 0);
            for [start, end] in runs.iter().map(|bounds| bounds.map(usize::from)) {
                neighbours.begin_run(before, start);
                before = end;
                for column in start..end {
                    let word = block(bytes, row_bytes, column);
                    let lighting = sorter.mask.block(order, column, row);
                    let sorted = sorter.sort(word, sorter.mask.class(column, row), &lighting);
                    let guess = neighbours.guess(column);
                    let code = Code::new(sorted, guess);
                    numbers[0][guess.ones_class][usize::from(code.ones) % NUMBERS] += 1;
                    numbers[1][guess.zone_class][usize::from(code.zone).saturating_sub(1) % NUMBERS] += 1;
                    self.codes.push(code);
                    neighbours.see(column, word.count_ones(), code.zone.into());
                }
            }
            neighbours.darken(before, row_bytes);
            self.counts.push(self.codes.len() - begun);
        }
        numbers
    }
}

impl Code {
    fn new(sorted: u64, guess: Guess) -> Self {
        let (ones, length) = ((!sorted).trailing_zeros(), 64 - sorted.leading_zeros());
        let zone = length.saturating_sub(ones);
        Self {
            ones: to_zigzag(ones as i32 - guess.ones) as u8,
            zone: zone as u8,
            ones_class: guess.ones_class as u8,
            zone_class: guess.zone_class as u8,
            inner: if zone > 2 { (sorted >> (ones + 1)) & (u64::MAX >> (66 - zone)) } else { 0 },
        }
    }
}

impl Sorter {
    #[inline(always)]
    fn sort(&self, word: u64, class: usize, lighting: &Lighting<'_>) -> u64 {
        let table = &self.sorted[class];
        let mut sorted = 0;
        for (row, byte) in table.iter().zip(word.to_le_bytes()) {
            sorted |= row[usize::from(byte)];
        }
        sorted.rotate_right(lighting.start())
    }
}

/// The block in column `column` of a row of blocks: pixel y * 8 + x is that bit.
#[inline(always)]
fn block(bytes: &[u8], row_bytes: usize, column: usize) -> u64 {
    let mut word = [0; BLOCK];
    for (byte, row) in word.iter_mut().zip(bytes.chunks_exact(row_bytes)) {
        *byte = row[column];
    }
    u64::from_le_bytes(word)
}

/// The parameter by which numbers that come so often take the fewest bits.
fn cheapest(counts: &[u32; NUMBERS]) -> u32 {
    let mut costs = [0; 8];
    for (number, count) in (0..).zip(counts).filter(|(_, count)| **count > 0) {
        for (low, cost) in (0..).zip(&mut costs) {
            let unary: u32 = number >> low;
            *cost += count * if unary < UNARY_MAX { unary + 1 + low } else { UNARY_MAX + 7 };
        }
    }
    (0..).zip(costs).min_by_key(|(_, cost)| *cost).map_or(0, |(low, _)| low)
}
