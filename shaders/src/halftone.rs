//! Luminance to one bit, one slice at a time. A slice does not depend on another, nor on the order in which they are
//! made.

pub mod diffusion;
pub mod mask;
pub mod search;
mod tile;
pub mod void_and_cluster;

use diffusion::{Kernel, diffuse};
use mask::Mask;

/// How a slice's luminance becomes bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Halftone {
    /// A random threshold for every pixel of every slice.
    WhiteNoise,
    /// Ordered dither, 8 × 8, the same in every slice.
    Bayer,
    /// A 64 × 64 void-and-cluster mask, the same in every slice.
    BlueNoiseFixed,
    /// The same, its thresholds moved by half their range in every other slice.
    BlueNoiseHalf,
    /// The same, its thresholds moved by the golden ratio from slice to slice, so that the two or three slices that an
    /// eye sums on a sight line fill each other's gaps.
    BlueNoise,
    /// [`Halftone::BlueNoise`], its thresholds moved by half their range in every other turn.
    AlternatingBlueNoise,
    /// A 32 × 32 × 16 void-and-cluster mask, blue in space and from slice to slice.
    BlueNoise3d,
    /// Floyd and Steinberg's error diffusion in serpentine order with slight threshold noise.
    FloydSteinberg,
    /// The shifted mask, improved by local search toward an error that an eye's blur removes: see [`search`].
    Search,
    /// Error diffusion by the kernel that leaves the least error to a blurred eye: [`Kernel::OPTIMISED`].
    OptimisedDiffusion,
    /// The same; every other turn makes good what the turn before it did wrong.
    AlternatingDiffusion,
}

impl Halftone {
    /// The kernel by which this is an error diffusion and nothing else in turn `turn`: slices can then be made many at once by
    /// [`diffusion::diffuse_lanes`], with the same bits.
    pub fn diffusion(self, turn: u32) -> Option<&'static Kernel> {
        match self {
            Self::FloydSteinberg => Some(&Kernel::FLOYD_STEINBERG),
            Self::OptimisedDiffusion => Some(&Kernel::OPTIMISED),
            Self::AlternatingDiffusion if turn.is_multiple_of(2) => Some(&Kernel::OPTIMISED),
            _ => None,
        }
    }
}

/// The slot in time and space that a slice fills, for the methods that mind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slot {
    /// The slice within its turn.
    pub slice: u32,
    /// The turn: patterns that alternate do so by its parity.
    pub turn: u32,
    /// How far an eye blurs this slice.
    pub blur: Blur,
}

/// The covariance in px² of the Gaussian with which an eye blurs a slice: uu, uv, vv, on the projector's image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blur(pub [f32; 3]);

impl Blur {
    /// σ = 1.5 px in every direction.
    pub const ROUND: Self = Self([2.25, 0.0, 2.25]);
}

/// Bytes in a row of a plane `width` pixels wide: pixel x is bit x mod 8 of byte x div 8.
pub const fn plane_stride(width: u32) -> usize {
    width.div_ceil(8) as usize
}

/// Halftones the slice of `slot`. `luminance`: `width` columns, row major, linear, 0 … 1 (beyond it saturates);
/// `plane`: as many rows of [`plane_stride`] bytes. A pixel of luminance 0 stays dark, one of 1 is lit.
pub fn halftone(method: Halftone, slot: Slot, width: u32, luminance: &[f32], plane: &mut [u8]) {
    let Slot { slice, turn, .. } = slot;
    match method {
        Halftone::Search => {
            diffuse(&Kernel::OPTIMISED, slice, width, luminance, plane, |_| 0.0);
            search::improve(slot.blur, width, luminance, plane);
        }
        Halftone::FloydSteinberg => diffuse(&Kernel::FLOYD_STEINBERG, slice, width, luminance, plane, |_| 0.0),
        Halftone::OptimisedDiffusion => diffuse(&Kernel::OPTIMISED, slice, width, luminance, plane, |_| 0.0),
        Halftone::AlternatingDiffusion => {
            diffuse(&Kernel::OPTIMISED, slice, width, luminance, plane, |_| 0.0);
            if turn % 2 == 1 {
                let missing = missing(width, luminance, plane);
                diffuse(&Kernel::OPTIMISED, slice ^ 1, width, luminance, plane, |cell| missing[cell]);
            }
        }
        _ => {
            if let Some(mask) = Mask::new(method, slice, turn) {
                mask::by_mask(mask, width, luminance, plane);
            }
        }
    }
}

/// How much less light `plane` shows than `luminance` asks for, pixel by pixel.
pub fn missing(width: u32, luminance: &[f32], plane: &[u8]) -> Vec<f32> {
    let rows = luminance.chunks_exact(width as usize).zip(plane.chunks_exact(plane_stride(width)));
    let shown = |bytes: &[u8], x: usize| f32::from(bytes[x / 8] >> (x % 8) & 1);
    rows.flat_map(|(row, bytes)| row.iter().enumerate().map(move |(x, value)| value.min(1.0) - shown(bytes, x)))
        .collect()
}

/// A 32-bit mix of three numbers (the finaliser of MurmurHash3 over their sum with odd multipliers).
#[inline(always)]
fn hash(a: u32, b: u32, c: u32) -> u32 {
    let mut mixed =
        a.wrapping_mul(0x9E37_79B1) ^ b.wrapping_mul(0x85EB_CA77).rotate_left(11) ^ c.wrapping_mul(0xC2B2_AE3D);
    mixed = (mixed ^ mixed >> 16).wrapping_mul(0x85EB_CA6B);
    mixed = (mixed ^ mixed >> 13).wrapping_mul(0xC2B2_AE35);
    mixed ^ mixed >> 16
}

#[cfg(test)]
mod tests;
