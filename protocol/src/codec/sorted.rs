//! Planes that were halftoned by a mask which both ends know: the bits of a block sorted in the order in which the mask lights them.
//!
//! Where luminance is even a sorted block is ones and then zeros. So a block is told by how many ones it begins with, and by its *zone*:
//! from the first zero to the last one, whose inner bits follow as they are. Numbers are coded by Rice's codes as differences from what
//! the blocks to the left and above suggest, with a parameter per class of neighbourhood that the plane's head names.
//!
//! | in the head | bits |
//! |---|---|
//! | shift of the mask's ranks | 16 |
//! | parameters of [`CLASSES`] classes for ones, then for zones | 3 each |
//!
//! | for each block | bits |
//! |---|---|
//! | ones before the first zero, less the prediction | Rice of the zigzag difference |
//! | length of the zone, less 1 where there is one | Rice |
//! | the zone's inner bits, the last one first | as they are |

use super::ExpandError;
use super::bits::BitReader;
use super::codebook::Codebook;
use super::mask::{CELLS, Order};
use super::walk::{COLUMNS_MAX, Coding, Run, from_zigzag, put_block};

#[cfg(feature = "std")]
pub(super) mod compress;

/// Classes of neighbourhood.
pub(super) const CLASSES: usize = 8;

/// What is known of a block once it is coded.
#[derive(Clone, Copy, Debug)]
struct Seen {
    /// Lit pixels; negative: none, nor coded.
    lit: i8,
    /// Length of its zone.
    zone: i8,
}

impl Seen {
    const DARK: Self = Self { lit: -1, zone: 0 };
}

/// What the blocks around say of the next one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Guess {
    /// Ones before the first zero: 1 … 63.
    pub(super) ones: i32,
    /// Class for the ones.
    pub(super) ones_class: usize,
    /// Class for the zone.
    pub(super) zone_class: usize,
}

/// The blocks that are known, to the left of and above the next one.
#[derive(Clone, Debug)]
pub(super) struct Neighbours {
    /// The row above, from the next column on; the present row before it.
    row: [Seen; COLUMNS_MAX + 1],
    corner: Seen,
    left: Seen,
}

impl Neighbours {
    pub(super) const NONE: Self = Self { row: [Seen::DARK; COLUMNS_MAX + 1], corner: Seen::DARK, left: Seen::DARK };

    /// A run of lit blocks begins at `column`; `end` is where the one before it ended.
    pub(super) fn begin_run(&mut self, end: usize, column: usize) {
        self.corner = column.checked_sub(1).and_then(|left| self.row.get(left)).copied().unwrap_or(Seen::DARK);
        self.left = Seen::DARK;
        self.darken(end, column);
    }

    /// Blocks from `from` up to `to` are dark.
    pub(super) fn darken(&mut self, from: usize, to: usize) {
        self.row.iter_mut().take(to).skip(from).for_each(|seen| *seen = Seen::DARK);
    }

    /// Of the block in column `column`.
    #[inline(always)]
    pub(super) fn guess(&self, column: usize) -> Guess {
        let at = |column: usize| self.row.get(column).copied().unwrap_or(Seen::DARK);
        let (left, above, corner, right) = (self.left, at(column), self.corner, at(column + 1));
        let [l, u, c, r] = [left, above, corner, right].map(|seen| i32::from(seen.lit));
        let (ones, alone) = match (l >= 0, u >= 0) {
            (true, true) if c >= 0 => ((3 * (l + u) - 2 * c + 2) / 4, false),
            (true, true) => ((l + u + 1) / 2, false),
            (true, false) => (if r >= 0 { (l + r) / 2 } else { l }, false),
            (false, true) => (if r >= 0 { (u + r) / 2 } else { u }, false),
            (false, false) => (
                if r >= 0 {
                    r
                } else if c >= 0 {
                    c
                } else {
                    32
                },
                true,
            ),
        };
        let zones = i32::from(left.zone) + i32::from(above.zone);
        let zones = if (l >= 0) == (u >= 0) { zones } else { 2 * zones };
        let zone_class = match zones {
            _ if alone => 0,
            0..=2 => 1,
            3..=7 => 2,
            8..=13 => 3,
            14..=21 => 4,
            22..=40 => 5,
            _ => 6,
        };
        Guess { ones: ones.clamp(1, CELLS as i32 - 1), ones_class: if alone { 7 } else { zone_class }, zone_class }
    }

    /// The block in column `column` has `lit` pixels and a zone of `zone`.
    #[inline(always)]
    pub(super) fn see(&mut self, column: usize, lit: u32, zone: u32) {
        let seen = Seen { lit: lit as i8, zone: zone as i8 };
        if let Some(place) = self.row.get_mut(column) {
            self.corner = core::mem::replace(place, seen);
        }
        self.left = seen;
    }
}

/// Expands sorted blocks.
#[derive(Clone, Debug)]
pub(super) struct Sorted {
    neighbours: Neighbours,
    order: Order,
    /// Parameters for ones and zones by class.
    low: [[u8; CLASSES]; 2],
}

impl Coding for Sorted {
    const NEW: Self = Self { neighbours: Neighbours::NONE, order: Order::NONE, low: [[0; CLASSES]; 2] };
    const STEPS: usize = 1;

    fn head(&mut self, book: &Codebook, bits: &mut BitReader<'_>) {
        self.order = book.mask.shifted(bits.take(16) as u16);
        self.low.as_flattened_mut().iter_mut().for_each(|low| *low = bits.take(3) as u8);
    }

    fn begin_run(&mut self, end: usize, column: usize) {
        self.neighbours.begin_run(end, column);
    }

    fn end_row(&mut self, end: usize, columns: usize) {
        self.neighbours.darken(end, columns);
    }

    #[inline(always)]
    fn steps(
        &mut self,
        book: &Codebook,
        run: Run,
        mut step: usize,
        bits: &mut BitReader<'_>,
        plane: &mut [u8],
    ) -> Result<usize, ExpandError> {
        while step < run.end - run.start && bits.has_code() {
            let column = run.start + step;
            let guess = self.neighbours.guess(column);
            let ones = guess.ones + from_zigzag(bits.rice(self.low[0][guess.ones_class].into()));
            let zone = bits.rice(self.low[1][guess.zone_class].into());
            let zone = if zone == 0 { 0 } else { zone + 1 };
            if ones < 0 || ones as u32 + zone > CELLS as u32 {
                return Err(ExpandError::Block { row: run.row, column });
            }
            let lighting = book.mask.block(&self.order, column, run.row);
            let mut word = lighting.first(ones as usize);
            let mut lit = ones as u32;
            if zone > 0 {
                let mut inner = read_inner(bits, zone - 2);
                lit += 1;
                word |= lighting.pixel(ones as usize + zone as usize - 1);
                while inner != 0 {
                    word |= lighting.pixel(ones as usize + 1 + inner.trailing_zeros() as usize);
                    inner &= inner - 1;
                    lit += 1;
                }
            }
            self.neighbours.see(column, lit, zone);
            put_block(word, run, column, plane);
            step += 1;
        }
        Ok(step)
    }
}

/// `count` bits, at most 62.
#[inline(always)]
fn read_inner(bits: &mut BitReader<'_>, count: u32) -> u64 {
    if count <= 32 { bits.take(count) } else { bits.take(count - 32) << 32 | bits.take(32) }
}
