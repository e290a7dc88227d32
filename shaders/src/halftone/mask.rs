//! Halftone by masks: a pixel is lit where its luminance is above the mask's threshold there.

use super::void_and_cluster::void_and_cluster;
use super::{hash, plane_stride};
use std::sync::OnceLock;

/// Lights the pixels whose luminance is above `threshold` at their column and row, which lies strictly between 0 and 1.
pub(super) fn by_mask(width: u32, luminance: &[f32], plane: &mut [u8], threshold: impl Fn(u32, u32) -> f32) {
    let rows = luminance.chunks_exact(width as usize).zip(plane.chunks_exact_mut(plane_stride(width)));
    for (y, (row, bytes)) in (0..).zip(rows) {
        for (left, (block, byte)) in (0..).step_by(8).zip(row.chunks(8).zip(bytes)) {
            *byte = 0;
            for (bit, luminance) in (0..).zip(block).filter(|(_, luminance)| **luminance > 0.0) {
                *byte |= u8::from(*luminance > threshold(left + bit, y)) << bit;
            }
        }
    }
}

/// [`by_mask`] by a square mask of `side` columns, row major.
pub(super) fn by_square(width: u32, luminance: &[f32], plane: &mut [u8], side: usize, mask: &[f32]) {
    by_mask(width, luminance, plane, |x, y| mask[(y as usize % side) * side + x as usize % side]);
}

/// The threshold of white noise at (x, y) in slice `slice`.
pub(super) fn white_threshold(x: u32, y: u32, slice: u32) -> f32 {
    ((hash(x, y, slice) >> 8) as f32 + 0.5) / (1 << 24) as f32
}

/// The threshold of the 8 × 8 ordered dither at (x, y): (rank + ½) / 64.
pub fn bayer_threshold(x: u32, y: u32) -> f32 {
    let spread = |bit: u32| {
        let (x, y) = (x >> bit & 1, y >> bit & 1);
        ((x ^ y) << 1 | y) << (4 - 2 * bit)
    };
    ((spread(0) + spread(1) + spread(2)) as f32 + 0.5) / 64.0
}

/// Columns and rows of the two-dimensional blue-noise mask.
pub const BLUE_SIDE: usize = 64;
const BLUE_CELLS: usize = BLUE_SIDE * BLUE_SIDE;
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// A 64 × 64 blue-noise mask: every rank 0 … 4095 once, row major.
pub fn blue_noise_ranks() -> &'static [u16] {
    static RANKS: OnceLock<Vec<u16>> = OnceLock::new();
    RANKS.get_or_init(|| void_and_cluster([BLUE_SIDE, BLUE_SIDE, 1], 1.5, 1.0))
}

/// The thresholds (rank + ½) / 4096 of the blue-noise mask, moved by `shift` of their range and wrapped.
pub(super) fn shifted_blue_noise(shift: f64) -> Vec<f32> {
    let shift = (shift.fract() * BLUE_CELLS as f64) as usize;
    let moved = blue_noise_ranks().iter().map(|rank| (usize::from(*rank) + shift) % BLUE_CELLS);
    moved.map(|rank| (rank as f32 + 0.5) / BLUE_CELLS as f32).collect()
}

/// The shift of slice `slice` of which any few consecutive ones are far apart.
pub(super) fn golden_shift(slice: u32) -> f64 {
    f64::from(slice) * GOLDEN
}

/// Columns and rows of the three-dimensional mask.
pub const VOLUME_SIDE: usize = 32;
/// Its slices, after which it repeats: a divisor of the usual 288.
pub const VOLUME_SLICES: usize = 16;

/// A 32 × 32 × 16 blue-noise mask over columns, rows and slices: every rank 0 … 16383 once, slice after slice.
///
/// The hats of an eye's lobe that neighbouring slices have in common fall to 0.4 from one to the next and to nothing
/// two slices on: a Gaussian of 0.75 slices.
pub fn blue_noise_volume() -> &'static [u16] {
    static RANKS: OnceLock<Vec<u16>> = OnceLock::new();
    RANKS.get_or_init(|| void_and_cluster([VOLUME_SIDE, VOLUME_SIDE, VOLUME_SLICES], 1.5, 0.75))
}

/// The thresholds of the three-dimensional mask in slice `slice`.
pub(super) fn volume_slice(slice: u32) -> Vec<f32> {
    const CELLS: usize = VOLUME_SIDE * VOLUME_SIDE;
    let ranks = &blue_noise_volume()[slice as usize % VOLUME_SLICES * CELLS..][..CELLS];
    ranks.iter().map(|rank| (f32::from(*rank) + 0.5) / (CELLS * VOLUME_SLICES) as f32).collect()
}
