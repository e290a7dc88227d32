//! A halftone mask as both ends know it: the order in which it lights the pixels of each block of 8 × 8.

use thiserror::Error;

/// Columns and rows of a block.
pub const BLOCK: usize = 8;
/// Pixels of a block.
pub const CELLS: usize = BLOCK * BLOCK;
/// The largest side of a mask in pixels.
pub const SIDE_MAX: usize = 64;
const CLASSES_MAX: usize = (SIDE_MAX / BLOCK) * (SIDE_MAX / BLOCK);

/// Not a mask that blocks can be ordered by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum MaskError {
    /// See the message.
    #[error("a mask of {ranks} ranks: 64, 256, 1024 or 4096 are allowed")]
    Size {
        /// What was given.
        ranks: usize,
    },
    /// See the message.
    #[error("the mask's ranks are not each of 0 to {largest} once: {rank} stands where it may not")]
    Ranks {
        /// The first that is too large or stands twice.
        rank: u16,
        /// The largest rank.
        largest: u16,
    },
}

/// What a mask makes of the blocks that lie at one place of it.
#[derive(Clone, Copy, Debug)]
struct Class {
    /// Ranks, ascending.
    ranks: [u16; CELLS],
    /// Which pixel has them: y * 8 + x.
    pixels: [u8; CELLS],
    /// The first so many of those pixels, a bit each.
    first: [u64; CELLS + 1],
}

impl Class {
    const NONE: Self = Self { ranks: [0; CELLS], pixels: [0; CELLS], first: [0; CELLS + 1] };

    /// From ranks in the order of pixels. By counting: each rank stands once, and a library's sort may panic where an order contradicts itself.
    fn sort(&mut self) {
        let ranks = self.ranks;
        for (pixel, rank) in (0..).zip(ranks) {
            let place = ranks.iter().filter(|other| **other < rank).count() % CELLS;
            (self.ranks[place], self.pixels[place]) = (rank, pixel);
        }
        let mut lit = 0;
        for (first, pixel) in self.first[1..].iter_mut().zip(self.pixels) {
            lit |= 1 << (pixel % 64);
            *first = lit;
        }
    }
}

/// A square mask that repeats over the image, in memory of its own: 46 KiB.
///
/// In slice after slice its ranks may be moved by a shift, modulo their number: shifted thresholds light the same pixels in an order that
/// begins elsewhere.
#[derive(Clone, Debug)]
pub struct Mask {
    /// Blocks of a side, less 1: blocks of a side are a power of two.
    wrap: usize,
    cells: u16,
    classes: [Class; CLASSES_MAX],
}

impl Default for Mask {
    fn default() -> Self {
        Self::NONE
    }
}

impl Mask {
    /// No mask yet.
    pub const NONE: Self = Self { wrap: 0, cells: 0, classes: [Class::NONE; CLASSES_MAX] };

    /// No mask any more.
    pub fn forget(&mut self) {
        self.cells = 0;
    }

    /// Whether there is one.
    pub const fn is_set(&self) -> bool {
        self.cells != 0
    }

    /// How many ranks it has; a shift is less.
    pub const fn cells(&self) -> u16 {
        self.cells
    }

    /// Takes the mask whose threshold at column x and row y rises with `ranks[(y % side) * side + x % side]`, each of 0 … side² - 1 once;
    /// side is 8, 16, 32 or 64. After an error there is none.
    pub fn set(&mut self, ranks: impl ExactSizeIterator<Item = u16> + Clone) -> Result<(), MaskError> {
        self.cells = 0;
        let given = ranks.len();
        let side =
            [8, 16, 32, 64].into_iter().find(|side| side * side == given).ok_or(MaskError::Size { ranks: given })?;
        let mut seen = [0u64; SIDE_MAX * SIDE_MAX / 64];
        for rank in ranks.clone() {
            let word = seen.get_mut(usize::from(rank) / 64).filter(|_| usize::from(rank) < given);
            match word {
                Some(word) if *word >> (rank % 64) & 1 == 0 => *word |= 1 << (rank % 64),
                _ => return Err(MaskError::Ranks { rank, largest: (given - 1) as u16 }),
            }
        }
        self.wrap = side / BLOCK - 1;
        for (cell, rank) in ranks.enumerate() {
            let [x, y] = [cell % side.max(1), cell / side.max(1)];
            let (class, pixel) = (self.class(x / BLOCK, y / BLOCK), (y % BLOCK) * BLOCK + x % BLOCK);
            if let Some(place) = self.classes[class].ranks.get_mut(pixel) {
                *place = rank;
            }
        }
        self.classes.iter_mut().take(given / CELLS).for_each(Class::sort);
        self.cells = given as u16;
        Ok(())
    }

    /// The order of lighting with the ranks moved by `shift`, modulo their number.
    pub fn shifted(&self, shift: u16) -> Order {
        // The ranks from here on become the lowest.
        let wraps = self.cells - shift.checked_rem(self.cells).unwrap_or(0);
        let start = |class: &Class| (class.ranks.partition_point(|rank| *rank < wraps) % CELLS) as u8;
        let mut starts = [0; CLASSES_MAX];
        starts.iter_mut().zip(&self.classes).for_each(|(place, class)| *place = start(class));
        Order { starts }
    }

    /// How the block in column `column` and row `row` of blocks is lit.
    #[inline(always)]
    pub(super) fn block(&self, order: &Order, column: usize, row: usize) -> Lighting<'_> {
        let class = self.class(column, row);
        Lighting { class: &self.classes[class], start: order.starts[class].into() }
    }

    /// How the blocks of each class are lit with unmoved ranks.
    #[cfg(feature = "std")]
    pub(super) fn lightings(&self) -> impl Iterator<Item = Lighting<'_>> {
        self.classes[..usize::from(self.cells) / CELLS].iter().map(|class| Lighting { class, start: 0 })
    }

    /// Which class the block in column `column` and row `row` of blocks has.
    #[inline(always)]
    pub(super) fn class(&self, column: usize, row: usize) -> usize {
        ((row & self.wrap) * (self.wrap + 1) + (column & self.wrap)) % CLASSES_MAX
    }
}

/// Where each class begins to light its pixels.
#[derive(Clone, Copy, Debug)]
pub struct Order {
    starts: [u8; CLASSES_MAX],
}

impl Order {
    pub(super) const NONE: Self = Self { starts: [0; CLASSES_MAX] };
}

/// The order in which a block's pixels light up. Pixel y * 8 + x is that bit of a word.
#[derive(Clone, Copy)]
pub(super) struct Lighting<'a> {
    class: &'a Class,
    start: usize,
}

impl Lighting<'_> {
    /// The first `count` pixels, at most 64.
    #[inline(always)]
    pub(super) fn first(&self, count: usize) -> u64 {
        let end = self.start + count;
        // From the start to the end; or all but what lies between the end, beyond the wrap, and the start.
        let (end, wrapped) = if end > CELLS { (end - CELLS, !0) } else { (end, 0) };
        let first = |count: usize| self.class.first[count.min(CELLS)];
        first(end) ^ first(self.start) ^ wrapped
    }

    /// Pixel number `place` in the order.
    #[inline(always)]
    pub(super) fn pixel(&self, place: usize) -> u64 {
        1 << (self.class.pixels[(self.start + place) % CELLS] % 64)
    }

    /// By how many places the order is moved against that of unmoved ranks.
    #[cfg(feature = "std")]
    pub(super) fn start(&self) -> u32 {
        self.start as u32
    }
}
