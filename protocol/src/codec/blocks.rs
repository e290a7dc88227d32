//! Planes that were halftoned by a mask which both ends know: blocks of 8 × 8 pixels, their bits sorted in the order in which the mask
//! lights them.
//!
//! Where luminance is even a sorted block is ones and then zeros. So a block is told by how many ones it begins with, and by its *zone*:
//! from the first zero to the last one, whose inner bits follow as they are. Numbers are coded by Rice's codes as differences from what
//! the blocks to the left and above suggest, with a parameter per class of neighbourhood that the plane's head names.
//!
//! A row of blocks begins with where its lit runs begin and end. All of it is one stream of bits, the lowest of each byte first:
//!
//! | what | bits |
//! |---|---|
//! | shift of the mask's ranks | 16 |
//! | parameters of [`CLASSES`] classes for ones, then for zones | 3 each |
//! | then for each row of blocks: | |
//! | its bounds are those of the row above | `1` |
//! | or as many as above; each by its difference | `01`, Golomb of the zigzag difference each |
//! | or others | `00`, Golomb of half their number, Golomb (first class 4) of each step |
//! | then for each lit block: | |
//! | ones before the first zero, less the prediction | Rice of the zigzag difference |
//! | length of the zone, less 1 where there is one | Rice |
//! | the zone's inner bits | as they are |

use super::bits::{BitReader, CODE_BYTES};
use super::mask::{BLOCK, CELLS, Mask, Order};
use super::{ExpandError, ImageSize};

#[cfg(feature = "std")]
pub(super) mod compress;

/// Blocks of a row, at most.
pub(super) const COLUMNS_MAX: usize = ImageSize::PIXELS_MAX as usize / BLOCK;
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
            ..=2 => 1,
            ..=7 => 2,
            ..=13 => 3,
            ..=21 => 4,
            ..=40 => 5,
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

/// Where in each row of blocks lit runs begin and end, in turns.
#[derive(Clone, Debug)]
pub(super) struct Bounds {
    pub(super) at: [u16; COLUMNS_MAX + 2],
    pub(super) count: usize,
}

impl Bounds {
    pub(super) const NONE: Self = Self { at: [0; COLUMNS_MAX + 2], count: 0 };
}

/// How the bounds of a row are told.
#[derive(Clone, Copy, Debug)]
enum Told {
    Differences,
    Steps,
}

/// What comes next in the stream.
#[derive(Clone, Copy, Debug)]
enum Next {
    Head,
    Row,
    Bound { told: Told, index: usize },
    Block { run: usize, column: usize },
    End,
}

/// Expands one plane: see [`super::Expander`].
#[derive(Clone, Debug)]
pub(super) struct Blocks {
    size: ImageSize,
    next: Next,
    row: usize,
    bounds: Bounds,
    neighbours: Neighbours,
    order: Order,
    /// Parameters for ones and zones by class.
    low: [[u8; CLASSES]; 2],
    /// What came and was not used, and from which bit on it is good.
    kept: [u8; KEPT],
    kept_bytes: usize,
    bit: usize,
}

/// Twice what has to be there for the next code.
const KEPT: usize = 2 * (CODE_BYTES + 8);

impl Blocks {
    pub(super) const fn new(size: ImageSize) -> Self {
        Self {
            size,
            next: Next::Head,
            row: 0,
            bounds: Bounds::NONE,
            neighbours: Neighbours::NONE,
            order: Order::NONE,
            low: [[0; CLASSES]; 2],
            kept: [0; KEPT],
            kept_bytes: 0,
            bit: 0,
        }
    }

    pub(super) fn push(&mut self, mask: &Mask, mut input: &[u8], plane: &mut [u8]) -> Result<(), ExpandError> {
        while self.kept_bytes > 0 && !input.is_empty() {
            let before = self.kept_bytes;
            let added = input.len().min(KEPT - before);
            self.keep(&input[..added]);
            let kept = self.kept;
            let used = self.run(mask, &kept[..self.kept_bytes], plane)?;
            if used / 8 >= before {
                // What was kept is used up: go on in the input.
                self.bit = used % 8;
                self.kept_bytes = 0;
                input = &input[used / 8 - before..];
            } else {
                self.kept.copy_within(used / 8..self.kept_bytes, 0);
                self.kept_bytes -= used / 8;
                self.bit = used % 8;
                input = &input[added..];
            }
        }
        if self.kept_bytes == 0 {
            let used = self.run(mask, input, plane)?;
            self.bit = used % 8;
            let rest = &input[(used / 8).min(input.len())..];
            self.keep(rest);
        }
        Ok(())
    }

    /// Expands what is left; the stream has ended.
    pub(super) fn finish(&mut self, mask: &Mask, plane: &mut [u8]) -> Result<(), ExpandError> {
        let truncated = ExpandError::Truncated { at: self.row * BLOCK * self.size.row_bytes(), needed: plane.len() };
        let mut padded = [0; KEPT + CODE_BYTES + 8];
        padded[..self.kept_bytes].copy_from_slice(&self.kept[..self.kept_bytes]);
        let used = self.run(mask, &padded, plane)?;
        if !matches!(self.next, Next::End) || used > 8 * self.kept_bytes {
            return Err(truncated);
        }
        // The last byte is filled up with zeros.
        let rest = padded[used / 8] >> (used % 8);
        if used.div_ceil(8) != self.kept_bytes || (used % 8 != 0 && rest != 0) {
            return Err(ExpandError::Trailing { bytes: self.kept_bytes - used / 8 });
        }
        Ok(())
    }

    fn keep(&mut self, bytes: &[u8]) {
        for (place, byte) in self.kept.iter_mut().skip(self.kept_bytes).zip(bytes) {
            *place = *byte;
        }
        self.kept_bytes = (self.kept_bytes + bytes.len()).min(KEPT);
    }

    /// Reads codes as long as a whole one is there; returns the bits used.
    fn run(&mut self, mask: &Mask, bytes: &[u8], plane: &mut [u8]) -> Result<usize, ExpandError> {
        let mut bits = BitReader::new(bytes, self.bit);
        while bits.has_code() {
            match self.next {
                Next::Head => self.head(mask, &mut bits),
                Next::Row => self.begin_row(&mut bits),
                Next::Bound { told, index } => self.bound(told, index, &mut bits)?,
                Next::Block { run, column } => self.blocks(mask, run, column, &mut bits, plane)?,
                Next::End => break,
            }
        }
        Ok(bits.at())
    }

    fn head(&mut self, mask: &Mask, bits: &mut BitReader<'_>) {
        self.order = mask.shifted(bits.take(16) as u16);
        self.low.iter_mut().flatten().for_each(|low| *low = bits.take(3) as u8);
        self.next = Next::Row;
    }

    /// Blocks of a row.
    fn columns(&self) -> usize {
        self.size.row_bytes()
    }

    fn begin_row(&mut self, bits: &mut BitReader<'_>) {
        let told = if bits.take(1) == 1 {
            None
        } else if bits.take(1) == 1 {
            Some(Told::Differences)
        } else {
            self.bounds.count = (2 * bits.golomb(0) as usize).min(COLUMNS_MAX);
            Some(Told::Steps)
        };
        match told {
            Some(told) if self.bounds.count > 0 => self.next = Next::Bound { told, index: 0 },
            _ => self.begin_run(0, 0),
        }
    }

    fn bound(&mut self, told: Told, index: usize, bits: &mut BitReader<'_>) -> Result<(), ExpandError> {
        let before = index.checked_sub(1).and_then(|last| self.bounds.at.get(last)).map_or(-1, |at| i32::from(*at));
        let wrong = ExpandError::Block { row: self.row, column: before.max(0) as usize };
        let columns = self.columns() as i32;
        let place = self.bounds.at.get_mut(index).ok_or(wrong)?;
        let bound = match told {
            Told::Differences => i32::from(*place) + from_zigzag(bits.golomb(0)),
            Told::Steps => before + 1 + bits.golomb(2) as i32,
        };
        if bound <= before || bound > columns {
            return Err(wrong);
        }
        *place = bound as u16;
        self.next = Next::Bound { told, index: index + 1 };
        if index + 1 == self.bounds.count {
            self.begin_run(0, 0);
        }
        Ok(())
    }

    /// Goes to run `run` of the row, or to the next row; the run before it ended at `end`.
    fn begin_run(&mut self, run: usize, end: usize) {
        let start = self.bounds.at.get(2 * run).filter(|_| 2 * run < self.bounds.count);
        if let Some(start) = start {
            let column = usize::from(*start);
            self.neighbours.begin_run(end, column);
            self.next = Next::Block { run, column };
            return;
        }
        self.neighbours.darken(end, self.columns());
        self.row += 1;
        let rows = (self.size.height() as usize).div_ceil(BLOCK);
        self.next = if self.row < rows { Next::Row } else { Next::End };
    }

    /// The blocks of run `run` from `column` on.
    fn blocks(
        &mut self,
        mask: &Mask,
        run: usize,
        mut column: usize,
        bits: &mut BitReader<'_>,
        plane: &mut [u8],
    ) -> Result<(), ExpandError> {
        let end = self.bounds.at.get(2 * run + 1).copied().unwrap_or(0).into();
        let stride = self.size.row_bytes();
        let row = plane.get_mut(self.row * BLOCK * stride..).unwrap_or_default();
        while column < end && bits.has_code() {
            let guess = self.neighbours.guess(column);
            let [ones_low, zone_low] = self.low.map(|low| u32::from(low[guess.zone_class]));
            let ones_low =
                if guess.ones_class == guess.zone_class { ones_low } else { self.low[0][guess.ones_class].into() };
            let ones = guess.ones + from_zigzag(bits.rice(ones_low));
            let zone = bits.rice(zone_low);
            let zone = if zone == 0 { 0 } else { zone + 1 };
            if ones < 0 || ones as u32 + zone > CELLS as u32 {
                return Err(ExpandError::Block { row: self.row, column });
            }
            let lighting = mask.block(&self.order, column, self.row);
            let mut word = lighting.first(ones as usize);
            let mut lit = ones as u32;
            if zone > 0 {
                let mut inner = read_inner(bits, zone - 2);
                lit += inner.count_ones() + 1;
                word |= lighting.pixel(ones as usize + zone as usize - 1);
                while inner != 0 {
                    word |= lighting.pixel(ones as usize + 1 + inner.trailing_zeros() as usize);
                    inner &= inner - 1;
                }
            }
            self.neighbours.see(column, lit, zone);
            for (bytes, byte) in row.chunks_mut(stride).zip(word.to_le_bytes()) {
                if let Some(place) = bytes.get_mut(column) {
                    *place = byte;
                }
            }
            column += 1;
        }
        if column < end {
            self.next = Next::Block { run, column };
        } else {
            self.begin_run(run + 1, end);
        }
        Ok(())
    }
}

/// `count` bits, at most 62.
#[inline(always)]
fn read_inner(bits: &mut BitReader<'_>, count: u32) -> u64 {
    if count <= 32 { bits.take(count) } else { bits.take(32) | bits.take(count - 32) << 32 }
}

/// 0, -1, 1, -2, 2 … for 0, 1, 2, 3, 4 …
#[inline(always)]
pub(super) fn from_zigzag(value: u32) -> i32 {
    (value >> 1) as i32 ^ -((value & 1) as i32)
}

/// The way back.
#[cfg(feature = "std")]
#[inline(always)]
pub(super) fn to_zigzag(value: i32) -> u32 {
    ((value << 1) ^ (value >> 31)) as u32
}
