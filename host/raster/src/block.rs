//! Blocks of 8 × 4 pixels: 32 numbers of 16 bits, in one, two or more registers.

#[cfg(target_arch = "x86_64")]
pub mod x86;

/// Columns of a block.
pub const COLUMNS: usize = 8;
/// Rows of a block.
pub const ROWS: usize = 4;
/// Pixels of a block, row by row.
pub const PIXELS: usize = COLUMNS * ROWS;
/// The column and row within a block that its starting values are for: the middle, which halves what gradients are rounded by.
pub const CENTRE: [i32; 2] = [4, 2];

/// A number for every pixel of a block.
///
/// Masks are blocks too: -1 where they hold, 0 elsewhere.
pub trait Block: Copy {
    /// The same number everywhere.
    fn splat(value: i16) -> Self;
    /// Row by row.
    fn from_array(values: &[i16; PIXELS]) -> Self;
    /// Row by row.
    fn to_array(self) -> [i16; PIXELS];
    /// Four rows of `cells`, the first from `at` on, `stride` apart.
    ///
    /// # Panics
    /// Where they are not all in `cells`.
    fn load(cells: &[i16], at: usize, stride: u32) -> Self;
    /// The reverse of [`Block::load`].
    ///
    /// # Panics
    /// Where the rows are not all in `cells`.
    fn store(self, cells: &mut [i16], at: usize, stride: u32);
    /// -1 for the pixels whose bits are set, the first one's the lowest.
    fn from_bits(bits: u32) -> Self;
    /// Sets the bits of the pixels with negative numbers.
    fn negative(self) -> u32;
    /// The sum, wrapped.
    fn add(self, other: Self) -> Self;
    /// The sum, or the nearest number to it.
    fn add_saturating(self, other: Self) -> Self;
    /// The low half of the product.
    fn mul(self, other: Self) -> Self;
    /// Bit by bit.
    fn and(self, other: Self) -> Self;
    /// Bit by bit.
    fn or(self, other: Self) -> Self;
    /// This where `mask` does not hold, 0 elsewhere.
    fn and_not(self, mask: Self) -> Self;
    /// The smaller.
    fn min(self, other: Self) -> Self;
    /// The larger.
    fn max(self, other: Self) -> Self;
    /// -1 where this is larger.
    fn above(self, other: Self) -> Self;

    /// Sets the bits of the lanes with negative numbers.
    fn negative_lanes<const N: usize>(lanes: &[i32; N]) -> u32;
    /// The numbers of `table` at `indices`.
    ///
    /// # Safety
    /// All of them must be below the table's length.
    #[allow(unsafe_code)]
    unsafe fn gather<const N: usize>(table: &[u64], indices: &[u32; N]) -> [u64; N];

    /// Columns from the centre.
    #[inline(always)]
    fn columns() -> Self {
        Self::from_array(&const { offsets(true) })
    }

    /// Rows from the centre.
    #[inline(always)]
    fn rows() -> Self {
        Self::from_array(&const { offsets(false) })
    }

    /// `one` where this mask holds, `other` elsewhere.
    #[inline(always)]
    fn select(self, one: Self, other: Self) -> Self {
        self.and(one).or(other.and_not(self))
    }
}

const fn offsets(columns: bool) -> [i16; PIXELS] {
    let mut values = [0; PIXELS];
    let mut pixel = 0;
    while pixel < PIXELS {
        values[pixel] = match columns {
            true => (pixel % COLUMNS) as i16 - CENTRE[0] as i16,
            false => (pixel / COLUMNS) as i16 - CENTRE[1] as i16,
        };
        pixel += 1;
    }
    values
}

/// What every machine can do: registers of 8 numbers, as SSE2 and NEON have them.
#[derive(Clone, Copy)]
pub struct Portable([[i16; COLUMNS]; ROWS]);

impl Portable {
    #[inline(always)]
    fn zip(self, other: Self, operation: impl Fn(i16, i16) -> i16 + Copy) -> Self {
        let ([a, b, c, d], [e, f, g, h]) = (self.0, other.0);
        Self([zip_row(a, e, operation), zip_row(b, f, operation), zip_row(c, g, operation), zip_row(d, h, operation)])
    }
}

/// One register's part.
#[inline(always)]
fn zip_row(one: [i16; COLUMNS], other: [i16; COLUMNS], operation: impl Fn(i16, i16) -> i16) -> [i16; COLUMNS] {
    let mut result = [0; COLUMNS];
    for column in 0..COLUMNS {
        result[column] = operation(one[column], other[column]);
    }
    result
}

impl Block for Portable {
    #[inline(always)]
    fn splat(value: i16) -> Self {
        Self([[value; COLUMNS]; ROWS])
    }

    #[inline(always)]
    fn from_array(values: &[i16; PIXELS]) -> Self {
        Self::load(values, 0, COLUMNS as u32)
    }

    #[inline(always)]
    fn to_array(self) -> [i16; PIXELS] {
        let mut values = [0; PIXELS];
        self.store(&mut values, 0, COLUMNS as u32);
        values
    }

    #[inline(always)]
    fn load(cells: &[i16], at: usize, stride: u32) -> Self {
        let mut block = Self([[0; COLUMNS]; ROWS]);
        for (row, values) in block.0.iter_mut().enumerate() {
            values.copy_from_slice(&cells[at + row * stride as usize..][..COLUMNS]);
        }
        block
    }

    #[inline(always)]
    fn store(self, cells: &mut [i16], at: usize, stride: u32) {
        for (row, values) in self.0.iter().enumerate() {
            cells[at + row * stride as usize..][..COLUMNS].copy_from_slice(values);
        }
    }

    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        let mut block = Self([[0; COLUMNS]; ROWS]);
        for (row, values) in block.0.iter_mut().enumerate() {
            let bits = bits >> (row * COLUMNS);
            for (column, value) in values.iter_mut().enumerate() {
                *value = -((bits >> column & 1) as i16);
            }
        }
        block
    }

    #[inline(always)]
    fn negative(self) -> u32 {
        let mut bits = 0;
        for (row, values) in self.0.iter().enumerate() {
            // Bit by bit from above, the sums of disjoint bits: a tree of additions in registers.
            let mut parts = [0u16; COLUMNS];
            for (column, (part, value)) in parts.iter_mut().zip(values).enumerate() {
                *part = (*value as u16 >> 15) << column;
            }
            bits |= u32::from(parts.iter().sum::<u16>()) << (row * COLUMNS);
        }
        bits
    }

    #[inline(always)]
    fn negative_lanes<const N: usize>(lanes: &[i32; N]) -> u32 {
        let mut parts = [0; N];
        for (lane, part) in parts.iter_mut().enumerate() {
            *part = (lanes[lane] as u32 >> 31) << lane;
        }
        parts.iter().sum()
    }

    #[inline(always)]
    #[allow(unsafe_code)]
    unsafe fn gather<const N: usize>(table: &[u64], indices: &[u32; N]) -> [u64; N] {
        let mut values = [0; N];
        for (value, index) in values.iter_mut().zip(indices) {
            // SAFETY: the caller's.
            *value = unsafe { *table.get_unchecked(*index as usize) };
        }
        values
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, i16::wrapping_add)
    }

    #[inline(always)]
    fn add_saturating(self, other: Self) -> Self {
        self.zip(other, i16::saturating_add)
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, i16::wrapping_mul)
    }

    #[inline(always)]
    fn and(self, other: Self) -> Self {
        self.zip(other, |a, b| a & b)
    }

    #[inline(always)]
    fn or(self, other: Self) -> Self {
        self.zip(other, |a, b| a | b)
    }

    #[inline(always)]
    fn and_not(self, mask: Self) -> Self {
        self.zip(mask, |a, b| a & !b)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn above(self, other: Self) -> Self {
        self.zip(other, |a, b| -i16::from(a > b))
    }
}
