//! Halftone by masks: a pixel is lit where its luminance is above the mask's threshold there.

use super::void_and_cluster::void_and_cluster;
use super::{Halftone, hash, plane_stride};
use std::sync::OnceLock;

/// A mask in one slice of one turn: a threshold for every pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mask {
    /// The two-dimensional blue-noise mask, its ranks moved by `shift` and wrapped.
    Blue {
        /// Below 4096.
        shift: usize,
    },
    /// One layer of the three-dimensional mask.
    Volume {
        /// Below [`VOLUME_SLICES`].
        layer: usize,
    },
    /// The ordered dither.
    Bayer,
    /// White noise.
    White {
        /// The slice.
        slice: u32,
    },
}

impl Mask {
    /// The mask of `method` in slice `slice` of turn `turn`; `None` for methods that are none.
    pub fn new(method: Halftone, slice: u32, turn: u32) -> Option<Self> {
        let half = |number: u32| f64::from(number % 2) / 2.0;
        let blue = |shift: f64| Self::Blue { shift: (shift.fract() * BLUE_CELLS as f64) as usize };
        Some(match method {
            Halftone::WhiteNoise => Self::White { slice },
            Halftone::Bayer => Self::Bayer,
            Halftone::BlueNoiseFixed => blue(0.0),
            Halftone::BlueNoiseHalf => blue(half(slice)),
            Halftone::BlueNoise => blue(golden_shift(slice)),
            Halftone::AlternatingBlueNoise => blue(golden_shift(slice) + half(turn)),
            Halftone::BlueNoise3d => Self::Volume { layer: slice as usize % VOLUME_SLICES },
            _ => return None,
        })
    }

    /// A square mask of one layer as the ranks of its thresholds, row by row, and by how much they are moved, modulo their number.
    pub fn ranks(self) -> Option<(&'static [u16], u16)> {
        static BAYER: OnceLock<Vec<u16>> = OnceLock::new();
        match self {
            Self::Blue { shift } => Some((blue_noise_ranks(), shift as u16)),
            Self::Bayer => {
                let rank = |cell: u32| (bayer_threshold(cell % 8, cell / 8) * 64.0) as u16;
                Some((BAYER.get_or_init(|| (0..64).map(rank).collect()), 0))
            }
            Self::Volume { .. } | Self::White { .. } => None,
        }
    }

    /// After how many columns, and rows, it repeats; `None` for never.
    pub fn side(self) -> Option<usize> {
        match self {
            Self::Blue { .. } => Some(BLUE_SIDE),
            Self::Volume { .. } => Some(VOLUME_SIDE),
            Self::Bayer => Some(8),
            Self::White { .. } => None,
        }
    }

    /// The threshold at column `x` and row `y`, strictly between 0 and 1: a pixel is lit where its luminance is above it. But for white
    /// noise, an odd number of parts of 2¹⁵ or of larger ones.
    pub fn threshold(self, x: u32, y: u32) -> f32 {
        let cell = |side: usize| (y as usize % side) * side + x as usize % side;
        match self {
            Self::Blue { shift } => {
                let rank = (usize::from(blue_noise_ranks()[cell(BLUE_SIDE)]) + shift) % BLUE_CELLS;
                (rank as f32 + 0.5) / BLUE_CELLS as f32
            }
            Self::Volume { layer } => {
                let rank = blue_noise_volume()[layer * VOLUME_CELLS + cell(VOLUME_SIDE)];
                (f32::from(rank) + 0.5) / (VOLUME_CELLS * VOLUME_SLICES) as f32
            }
            Self::Bayer => bayer_threshold(x, y),
            Self::White { slice } => white_threshold(x, y, slice),
        }
    }
}

/// Lights the pixels whose luminance is above their threshold.
pub(super) fn by_mask(mask: Mask, width: u32, luminance: &[f32], plane: &mut [u8]) {
    let rows = luminance.chunks_exact(width as usize).zip(plane.chunks_exact_mut(plane_stride(width)));
    for (y, (row, bytes)) in (0..).zip(rows) {
        for (left, (block, byte)) in (0..).step_by(8).zip(row.chunks(8).zip(bytes)) {
            *byte = 0;
            for (bit, luminance) in (0..).zip(block).filter(|(_, luminance)| **luminance > 0.0) {
                *byte |= u8::from(*luminance > mask.threshold(left + bit, y)) << bit;
            }
        }
    }
}

/// The threshold of white noise at (x, y) in slice `slice`.
fn white_threshold(x: u32, y: u32, slice: u32) -> f32 {
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

/// The shift of slice `slice` of which any few consecutive ones are far apart.
fn golden_shift(slice: u32) -> f64 {
    f64::from(slice) * GOLDEN
}

/// Columns and rows of the three-dimensional mask.
pub const VOLUME_SIDE: usize = 32;
/// Its slices, after which it repeats: a divisor of the usual 288.
pub const VOLUME_SLICES: usize = 16;
const VOLUME_CELLS: usize = VOLUME_SIDE * VOLUME_SIDE;

/// A 32 × 32 × 16 blue-noise mask over columns, rows and slices: every rank 0 … 16383 once, slice after slice.
///
/// The hats of an eye's lobe that neighbouring slices have in common fall to 0.4 from one to the next and to nothing
/// two slices on: a Gaussian of 0.75 slices.
pub fn blue_noise_volume() -> &'static [u16] {
    static RANKS: OnceLock<Vec<u16>> = OnceLock::new();
    RANKS.get_or_init(|| void_and_cluster([VOLUME_SIDE, VOLUME_SIDE, VOLUME_SLICES], 1.5, 0.75))
}
