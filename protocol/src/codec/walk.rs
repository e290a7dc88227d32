//! The lit runs of each row of blocks, and what they are filled with, from pieces of a stream of any length.
//!
//! A plane is cut into blocks of 8 × 8 pixels. All of it is one stream of bits: a head, as the coding has it, then for each row of blocks
//! where its lit runs begin and end, and the coding's steps for each run.
//!
//! | bounds of a row | bits |
//! |---|---|
//! | those of the row above | `1` |
//! | as many as above; each by its difference | `01`, Golomb of the zigzag difference each |
//! | others | `00`, Golomb of half their number, Golomb (first class 4) of each step |

use super::bits::{AHEAD_BYTES, BitReader};
use super::codebook::Codebook;
use super::mask::BLOCK;
use super::{ExpandError, ImageSize};

/// Blocks of a row, at most.
pub(super) const COLUMNS_MAX: usize = ImageSize::PIXELS_MAX as usize / BLOCK;

/// What fills lit runs.
pub(super) trait Coding: Sized {
    /// Before a plane.
    const NEW: Self;
    /// Steps in which a block comes.
    const STEPS: usize;

    /// Reads the head: at most 16 bytes.
    fn head(&mut self, book: &Codebook, bits: &mut BitReader<'_>);

    /// A run begins at `column`; the one before it in this row ended at `end`.
    fn begin_run(&mut self, end: usize, column: usize);

    /// No run after `end` in this row of `columns`.
    fn end_row(&mut self, end: usize, columns: usize);

    /// Reads steps of `run` from `step` on as long as there is a whole code, and returns the next one. A step needs at most 16 bytes.
    fn steps(
        &mut self,
        book: &Codebook,
        run: Run,
        step: usize,
        bits: &mut BitReader<'_>,
        plane: &mut [u8],
    ) -> Result<usize, ExpandError>;
}

/// Lit blocks that follow each other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    /// The row of blocks.
    pub(super) row: usize,
    /// The first column, in blocks.
    pub(super) start: usize,
    /// Beyond the last; above `start`.
    pub(super) end: usize,
    /// Bytes of a row of pixels.
    pub(super) stride: usize,
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
    Run { index: usize, run: Run, step: usize },
    End,
}

/// What must be there to read a code, twice.
const KEPT: usize = 2 * AHEAD_BYTES;

/// Expands one plane: see [`super::Expander`].
#[derive(Clone, Debug)]
pub(super) struct Walk<C> {
    size: ImageSize,
    coding: C,
    next: Next,
    row: usize,
    /// Where in each row of blocks lit runs begin and end, in turns.
    bounds: [u16; COLUMNS_MAX + 2],
    bounds_count: usize,
    /// What came and was not used, and from which bit on it is good.
    kept: [u8; KEPT],
    kept_bytes: usize,
    bit: usize,
}

impl<C: Coding> Walk<C> {
    pub(super) fn new(size: ImageSize) -> Self {
        Self {
            size,
            coding: C::NEW,
            next: Next::Head,
            row: 0,
            bounds: [0; COLUMNS_MAX + 2],
            bounds_count: 0,
            kept: [0; KEPT],
            kept_bytes: 0,
            bit: 0,
        }
    }

    pub(super) fn push(&mut self, book: &Codebook, mut input: &[u8], plane: &mut [u8]) -> Result<(), ExpandError> {
        while self.kept_bytes > 0 && !input.is_empty() {
            if matches!(self.next, Next::End) {
                return Err(ExpandError::Trailing { bytes: input.len() });
            }
            let before = self.kept_bytes;
            self.keep(input);
            let (kept, bytes) = (self.kept, self.kept_bytes);
            let used = self.read(book, kept.get(..bytes).unwrap_or_default(), plane)?;
            let rest = if used >= before {
                // What was kept is used up: go on in the input.
                self.kept_bytes = 0;
                used - before
            } else {
                self.kept = [0; KEPT];
                self.kept_bytes = 0;
                self.keep(kept.get(used..bytes).unwrap_or_default());
                bytes - before
            };
            input = input.get(rest..).unwrap_or_default();
        }
        if self.kept_bytes == 0 {
            let used = self.read(book, input, plane)?;
            self.keep(input.get(used..).unwrap_or_default());
        }
        Ok(())
    }

    /// Expands what is left; the stream has ended.
    pub(super) fn finish(&mut self, book: &Codebook, plane: &mut [u8]) -> Result<(), ExpandError> {
        let mut padded = [0; KEPT + AHEAD_BYTES];
        padded.iter_mut().zip(&self.kept).take(self.kept_bytes).for_each(|(place, byte)| *place = *byte);
        let used = self.read(book, &padded, plane)?;
        let used_bits = 8 * used + self.bit;
        if !matches!(self.next, Next::End) || used_bits > 8 * self.kept_bytes {
            return Err(ExpandError::Truncated { at: self.row * BLOCK * self.size.row_bytes(), needed: plane.len() });
        }
        // The last byte is filled up with zeros.
        let last = padded.get(used).copied().unwrap_or(0);
        let is_filled_up = self.bit == 0 || last << self.bit == 0;
        if used_bits.div_ceil(8) != self.kept_bytes || !is_filled_up {
            return Err(ExpandError::Trailing { bytes: self.kept_bytes - used });
        }
        Ok(())
    }

    /// Keeps as many of `bytes` as there is room for.
    fn keep(&mut self, bytes: &[u8]) {
        let places = self.kept.iter_mut().skip(self.kept_bytes);
        self.kept_bytes += places.len().min(bytes.len());
        places.zip(bytes).for_each(|(place, byte)| *place = *byte);
    }

    /// Reads codes as long as a whole one is there; returns the whole bytes used, and notes the bits of the next.
    fn read(&mut self, book: &Codebook, bytes: &[u8], plane: &mut [u8]) -> Result<usize, ExpandError> {
        let mut bits = BitReader::new(bytes, self.bit);
        while bits.has_code() {
            match self.next {
                Next::Head => {
                    self.coding.head(book, &mut bits);
                    self.next = Next::Row;
                }
                Next::Row => self.begin_row(&mut bits),
                Next::Bound { told, index } => self.bound(told, index, &mut bits)?,
                Next::Run { index, run, step } => {
                    let step = self.coding.steps(book, run, step, &mut bits, plane)?;
                    if step < C::STEPS * (run.end - run.start) {
                        self.next = Next::Run { index, run, step };
                    } else {
                        self.begin_run(index + 1, run.end);
                    }
                }
                Next::End => break,
            }
        }
        self.bit = bits.at() % 8;
        Ok(bits.at() / 8)
    }

    fn begin_row(&mut self, bits: &mut BitReader<'_>) {
        let told = if bits.take(1) == 1 {
            None
        } else if bits.take(1) == 1 {
            Some(Told::Differences)
        } else {
            self.bounds_count = (2 * bits.golomb(0) as usize).min(COLUMNS_MAX);
            Some(Told::Steps)
        };
        match told {
            Some(told) if self.bounds_count > 0 => self.next = Next::Bound { told, index: 0 },
            _ => self.begin_run(0, 0),
        }
    }

    fn bound(&mut self, told: Told, index: usize, bits: &mut BitReader<'_>) -> Result<(), ExpandError> {
        let before = index.checked_sub(1).and_then(|last| self.bounds.get(last)).map_or(-1, |at| i32::from(*at));
        let wrong = ExpandError::Block { row: self.row, column: before.max(0) as usize };
        let place = self.bounds.get_mut(index).ok_or(wrong)?;
        let bound = match told {
            Told::Differences => i32::from(*place) + from_zigzag(bits.golomb(0)),
            Told::Steps => before + 1 + bits.golomb(2) as i32,
        };
        if bound <= before || bound > self.size.row_bytes() as i32 {
            return Err(wrong);
        }
        *place = bound as u16;
        self.next = Next::Bound { told, index: index + 1 };
        if index + 1 == self.bounds_count {
            self.begin_run(0, 0);
        }
        Ok(())
    }

    /// Goes to run `index` of the row, or to the next row; the run before it ended at `end`.
    fn begin_run(&mut self, index: usize, end: usize) {
        let bound = |index: usize| self.bounds.get(index).filter(|_| index < self.bounds_count);
        if let (Some(start), Some(stop)) = (bound(2 * index), bound(2 * index + 1)) {
            let (start, stop) = (usize::from(*start), usize::from(*stop));
            let run = Run { row: self.row, start, end: stop, stride: self.size.row_bytes() };
            self.coding.begin_run(end, start);
            self.next = Next::Run { index, run, step: 0 };
            return;
        }
        self.coding.end_row(end, self.size.row_bytes());
        self.row += 1;
        let rows = (self.size.height() as usize).div_ceil(BLOCK);
        self.next = if self.row < rows { Next::Row } else { Next::End };
    }
}

/// Writes the block in column `column` of `run`'s row: pixel y * 8 + x is that bit of `word`. What lies below the plane is left out.
#[inline(always)]
pub(super) fn put_block(word: u64, run: Run, column: usize, plane: &mut [u8]) {
    let mut at = run.row * BLOCK * run.stride + column;
    for byte in word.to_le_bytes() {
        if let Some(place) = plane.get_mut(at) {
            *place = byte;
        }
        at += run.stride;
    }
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

/// The other direction.
#[cfg(feature = "std")]
pub(super) mod lit {
    use super::super::bits::BitWriter;
    use super::{BLOCK, to_zigzag};

    /// The lit runs of each row of blocks; keeps its memory.
    #[derive(Clone, Debug, Default)]
    pub(in super::super) struct LitRuns {
        rows: Vec<Vec<u16>>,
    }

    impl LitRuns {
        /// Finds those of `plane`.
        pub(in super::super) fn find(&mut self, plane: &[u8], row_bytes: usize) {
            self.rows.resize_with((plane.len() / row_bytes).div_ceil(BLOCK), Vec::new);
            let mut lit = vec![0; row_bytes];
            for (rows, bounds) in plane.chunks(BLOCK * row_bytes).zip(&mut self.rows) {
                lit.fill(0);
                for row in rows.chunks_exact(row_bytes) {
                    lit.iter_mut().zip(row).for_each(|(lit, byte)| *lit |= byte);
                }
                bounds.clear();
                let mut was_lit = false;
                for (column, lit) in lit.iter().map(|byte| *byte != 0).chain([false]).enumerate() {
                    if lit != was_lit {
                        bounds.push(column as u16);
                    }
                    was_lit = lit;
                }
            }
        }

        /// Row by row: the first columns of its runs and those beyond the last.
        pub(in super::super) fn rows(&self) -> impl Iterator<Item = &[[u16; 2]]> {
            self.rows.iter().map(|bounds| bounds.as_chunks().0)
        }

        /// Writes the bounds of row `row`.
        pub(in super::super) fn put(&self, row: usize, bits: &mut BitWriter<'_>) {
            let above = row.checked_sub(1).map_or(&[][..], |above| &self.rows[above]);
            let bounds = &self.rows[row];
            if above == bounds {
                bits.put(1, 1);
            } else if above.len() == bounds.len() {
                bits.put(0b01, 2);
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
    }
}
