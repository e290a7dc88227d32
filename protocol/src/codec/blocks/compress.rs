//! The other direction: on the host, where memory is no matter.

use super::super::bits::{BitWriter, UNARY_MAX};
use super::super::mask::{BLOCK, CELLS, Lighting, Mask, Order};
use super::{CLASSES, Neighbours, to_zigzag};

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
pub(in super::super) struct BlockCompressor {
    mask: Mask,
    sorter: Sorter,
    codes: Vec<Code>,
    /// The bounds of the lit runs of each row of blocks, and how many blocks are in them.
    rows: Vec<(Vec<u16>, usize)>,
}

impl BlockCompressor {
    /// For planes halftoned by `mask`, which is set.
    pub(in super::super) fn new(mask: Mask) -> Self {
        Self { sorter: Sorter::new(&mask), mask, codes: Vec::new(), rows: Vec::new() }
    }

    /// The mask.
    pub(in super::super) fn mask(&self) -> &Mask {
        &self.mask
    }

    /// Appends the stream of `plane`, rows of `row_bytes`, to `out`. `shift`: by how much the mask's ranks were moved; another one than the
    /// plane was halftoned by costs bytes and nothing else.
    pub(in super::super) fn compress(&mut self, plane: &[u8], row_bytes: usize, shift: u16, out: &mut Vec<u8>) {
        let order = self.mask.shifted(shift);
        let mut costs = [[[0; 8]; CLASSES]; 2];
        self.sort(plane, row_bytes, &order, &mut costs);
        let low = costs.map(|classes| classes.map(cheapest));
        let mut bits = BitWriter::new(out);
        bits.put(shift.into(), 16);
        low.as_flattened().iter().for_each(|low| bits.put((*low).into(), 3));
        let mut codes = self.codes.iter();
        let mut above: &[u16] = &[];
        for (bounds, count) in &self.rows {
            put_bounds(above, bounds, &mut bits);
            above = bounds;
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

    /// Fills `codes` and `rows`, and adds up what each parameter would cost.
    fn sort(&mut self, plane: &[u8], row_bytes: usize, order: &Order, costs: &mut [[[u32; 8]; CLASSES]; 2]) {
        let mut neighbours = Neighbours::NONE;
        self.codes.clear();
        let rows = (plane.len() / row_bytes).div_ceil(BLOCK);
        self.rows.resize_with(rows, Default::default);
        for (row, (bytes, (bounds, count))) in plane.chunks(BLOCK * row_bytes).zip(&mut self.rows).enumerate() {
            bounds.clear();
            let begun = self.codes.len();
            let (mut end, mut is_run) = (0, false);
            for column in 0..row_bytes {
                let word = block(bytes, row_bytes, column);
                if (word != 0) != is_run {
                    is_run = word != 0;
                    bounds.push(column as u16);
                    if is_run {
                        neighbours.begin_run(end, column);
                    } else {
                        end = column;
                    }
                }
                if word != 0 {
                    let guess = neighbours.guess(column);
                    let lighting = self.mask.block(order, column, row);
                    let sorted = self.sorter.sort(word, self.mask.class(column, row), &lighting);
                    let (ones, length) = ((!sorted).trailing_zeros(), 64 - sorted.leading_zeros());
                    let zone = length.saturating_sub(ones);
                    let code = Code {
                        ones: to_zigzag(ones as i32 - guess.ones) as u8,
                        zone: zone as u8,
                        ones_class: guess.ones_class as u8,
                        zone_class: guess.zone_class as u8,
                        inner: if zone > 2 { (sorted >> (ones + 1)) & (u64::MAX >> (66 - zone)) } else { 0 },
                    };
                    add_costs(code.ones.into(), &mut costs[0][guess.ones_class]);
                    add_costs(zone.saturating_sub(1), &mut costs[1][guess.zone_class]);
                    self.codes.push(code);
                    neighbours.see(column, word.count_ones(), zone);
                }
            }
            if is_run {
                bounds.push(row_bytes as u16);
                end = row_bytes;
            }
            neighbours.darken(end, row_bytes);
            *count = self.codes.len() - begun;
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

fn put_bounds(above: &[u16], bounds: &[u16], bits: &mut BitWriter<'_>) {
    if above == bounds {
        bits.put(1, 1);
    } else if above.len() == bounds.len() {
        bits.put(0b10, 2);
        for (bound, above) in bounds.iter().zip(above) {
            bits.put_golomb(to_zigzag(i32::from(*bound) - i32::from(*above)), 0);
        }
    } else {
        bits.put(0, 2);
        bits.put_golomb(bounds.len() as u32 / 2, 0);
        let mut before = -1;
        for bound in bounds {
            bits.put_golomb((i32::from(*bound) - before - 1) as u32, 2);
            before = i32::from(*bound);
        }
    }
}
