//! The other direction: on the host, where memory is no matter.

use super::super::bits::{BitWriter, UNARY_MAX};
use super::super::mask::{BLOCK, CELLS, Lighting, Mask, Order};
use super::super::walk::{lit::LitRuns, to_zigzag};
use super::{CLASSES, Guess, Neighbours};

/// Sorts the pixels of blocks in the order in which a mask lights them: 1 MiB for a mask of 64 × 64.
#[derive(Clone, Debug)]
struct Sorter {
    /// By class, row of the block, and that row's byte: where its pixels go.
    sorted: Vec<[[u64; 256]; BLOCK]>,
}

impl Sorter {
    fn new(mask: &Mask) -> Self {
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
        Self { sorted: sorted.collect() }
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

/// Compresses planes that were halftoned by one mask. Keeps its memory from plane to plane.
#[derive(Clone, Debug)]
pub(in super::super) struct SortedCompressor {
    mask: Mask,
    sorter: Sorter,
    lit: LitRuns,
    codes: Vec<Code>,
    /// How many of them each row of blocks has.
    counts: Vec<usize>,
}

/// Bits that each parameter would cost, for ones and zones by class.
type Costs = [[[u32; 8]; CLASSES]; 2];

impl SortedCompressor {
    /// For planes halftoned by `mask`, which is set.
    pub(in super::super) fn new(mask: Mask) -> Self {
        Self { sorter: Sorter::new(&mask), mask, lit: LitRuns::default(), codes: Vec::new(), counts: Vec::new() }
    }

    /// Appends the stream of `plane`, rows of `row_bytes`, to `out`. `shift`: by how much the mask's ranks were moved.
    pub(in super::super) fn compress(&mut self, plane: &[u8], row_bytes: usize, shift: u16, out: &mut Vec<u8>) {
        self.lit.find(plane, row_bytes);
        let low = self.sort(plane, row_bytes, &self.mask.shifted(shift)).map(|classes| classes.map(cheapest));
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

    /// Fills `codes` and `counts`, and adds up what each parameter would cost.
    fn sort(&mut self, plane: &[u8], row_bytes: usize, order: &Order) -> Costs {
        let mut costs = Costs::default();
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
                    let lighting = self.mask.block(order, column, row);
                    let sorted = self.sorter.sort(word, self.mask.class(column, row), &lighting);
                    let guess = neighbours.guess(column);
                    let code = Code::new(sorted, guess);
                    add_costs(code.ones.into(), &mut costs[0][guess.ones_class]);
                    add_costs(u32::from(code.zone).saturating_sub(1), &mut costs[1][guess.zone_class]);
                    self.codes.push(code);
                    neighbours.see(column, word.count_ones(), code.zone.into());
                }
            }
            neighbours.darken(before, row_bytes);
            self.counts.push(self.codes.len() - begun);
        }
        costs
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

fn add_costs(value: u32, costs: &mut [u32; 8]) {
    for (low, cost) in (0..).zip(costs) {
        let unary = value >> low;
        *cost += if unary < UNARY_MAX { unary + 1 + low } else { UNARY_MAX + 7 };
    }
}

fn cheapest(costs: [u32; 8]) -> u32 {
    (0..).zip(costs).min_by_key(|(_, cost)| *cost).map_or(0, |(low, _)| low)
}
