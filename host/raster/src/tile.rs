//! A mask's thresholds, laid out for blocks.

use super::block::{Block, COLUMNS, ROWS};
use super::figure::WHITE;
use shaders::halftone::mask::Mask;

/// Thresholds in parts of [`WHITE`], with as many columns and rows repeated at the end as a block reaches over it.
#[derive(Default)]
pub struct Tile {
    shown: Option<Mask>,
    /// The bits of columns and rows that count: it repeats after a power of two of them, or not at all.
    bits: usize,
    stride: u32,
    thresholds: Vec<i16>,
}

impl Tile {
    /// Takes the thresholds of `mask`, for an image of `size` pixels.
    pub fn set(&mut self, mask: Mask, size: [i32; 2]) {
        if self.shown == Some(mask) {
            return;
        }
        self.shown = Some(mask);
        self.bits = mask.side().map_or(usize::MAX, |side| side - 1);
        let sides = size.map(|side| mask.side().unwrap_or(side as usize));
        let [columns, rows] = [sides[0] + COLUMNS, sides[1] + ROWS];
        self.stride = columns as u32;
        self.thresholds.resize(columns * rows, 0);
        for (y, row) in self.thresholds.chunks_exact_mut(columns).enumerate() {
            for (x, threshold) in row.iter_mut().enumerate() {
                let [x, y] = [x & self.bits, y & self.bits];
                // Whole numbers but for white noise, which may be rounded; what is white lies above all.
                *threshold = (mask.threshold(x as u32, y as u32) * WHITE).min(WHITE - 2.0) as i16;
            }
        }
    }

    /// The thresholds of the block whose first pixel is in column `x` and row `y`.
    #[inline(always)]
    pub fn block<B: Block>(&self, [x, y]: [i32; 2]) -> B {
        let (x, y) = (x as usize & self.bits, y as usize & self.bits);
        B::load(&self.thresholds, y * self.stride as usize + x, self.stride)
    }
}
