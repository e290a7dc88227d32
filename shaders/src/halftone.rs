//! Luminance to one bit, one slice at a time. A slice does not depend on another, nor on the order in which they are made.

use std::sync::OnceLock;

pub mod search;

/// How a slice's luminance becomes bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Halftone {
    /// Ordered dither, 8 × 8, the same in every slice.
    Bayer,
    /// A 64 × 64 void-and-cluster mask whose thresholds move by the golden ratio from slice to slice, so that the two or
    /// three slices that an eye sums on a sight line fill each other's gaps.
    BlueNoise,
    /// Error diffusion in serpentine order with slight threshold noise.
    FloydSteinberg,
    /// The shifted mask, improved by local search toward an error that an eye's blur removes: see [`search`].
    Search,
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

/// Halftones the slice of `slot`. `luminance`: `width` columns, row major, linear, 0 … 1 (beyond it saturates); `plane`: as many rows
/// of [`plane_stride`] bytes. A pixel of luminance 0 stays dark, one of 1 is lit.
pub fn halftone(method: Halftone, slot: Slot, width: u32, luminance: &[f32], plane: &mut [u8]) {
    match method {
        Halftone::Bayer => by_mask(width, luminance, plane, bayer_threshold),
        Halftone::BlueNoise => {
            let mask = shifted_blue_noise(slot.slice);
            by_mask(width, luminance, plane, |x, y| {
                mask[(y as usize % BLUE_SIDE) * BLUE_SIDE + x as usize % BLUE_SIDE]
            });
        }
        Halftone::FloydSteinberg => floyd_steinberg(slot.slice, width, luminance, plane),
        Halftone::Search => {
            halftone(Halftone::BlueNoise, slot, width, luminance, plane);
            search::improve(slot.blur, width, luminance, plane);
        }
    }
}

fn by_mask(width: u32, luminance: &[f32], plane: &mut [u8], threshold: impl Fn(u32, u32) -> f32) {
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

/// The threshold of the 8 × 8 ordered dither at (x, y): (rank + ½) / 64.
pub fn bayer_threshold(x: u32, y: u32) -> f32 {
    let spread = |bit: u32| {
        let (x, y) = (x >> bit & 1, y >> bit & 1);
        ((x ^ y) << 1 | y) << (4 - 2 * bit)
    };
    ((spread(0) + spread(1) + spread(2)) as f32 + 0.5) / 64.0
}

/// Columns and rows of the blue-noise mask.
pub const BLUE_SIDE: usize = 64;
const BLUE_CELLS: usize = BLUE_SIDE * BLUE_SIDE;
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// The mask of slice `slice`: (rank + ½) / 4096, moved by the golden ratio a slice and wrapped.
fn shifted_blue_noise(slice: u32) -> [f32; BLUE_CELLS] {
    let shift = ((f64::from(slice) * GOLDEN).fract() * BLUE_CELLS as f64) as u32;
    core::array::from_fn(|cell| ((u32::from(blue_noise_ranks()[cell]) + shift) % BLUE_CELLS as u32) as f32)
        .map(|rank: f32| (rank + 0.5) / BLUE_CELLS as f32)
}

/// A 64 × 64 blue-noise mask: every rank 0 … 4095 once, row major. Void and cluster (Ulichney 1993) with σ = 1.5 pixels.
pub fn blue_noise_ranks() -> &'static [u16; BLUE_CELLS] {
    static RANKS: OnceLock<Box<[u16; BLUE_CELLS]>> = OnceLock::new();
    RANKS.get_or_init(|| Box::new(void_and_cluster()))
}

/// A pattern of minority pixels on a torus, with the Gaussian energy that they cause everywhere.
#[derive(Clone)]
struct Pattern {
    set: Vec<bool>,
    energy: Vec<f32>,
}

impl Pattern {
    fn toggle(&mut self, cell: usize, kernel: &[f32]) {
        self.set[cell] = !self.set[cell];
        let sign = if self.set[cell] { 1.0 } else { -1.0 };
        for (row, line) in self.energy.chunks_exact_mut(BLUE_SIDE).enumerate() {
            let dy = (row + BLUE_SIDE - cell / BLUE_SIDE) % BLUE_SIDE;
            for (column, energy) in line.iter_mut().enumerate() {
                *energy += sign * kernel[dy * BLUE_SIDE + (column + BLUE_SIDE - cell % BLUE_SIDE) % BLUE_SIDE];
            }
        }
    }

    /// The set cell with the most energy.
    fn tightest_cluster(&self) -> usize {
        self.extreme(true, |a, b| a > b)
    }

    /// The unset cell with the least energy.
    fn largest_void(&self) -> usize {
        self.extreme(false, |a, b| a < b)
    }

    fn extreme(&self, set: bool, better: impl Fn(f32, f32) -> bool) -> usize {
        let candidates = (0..BLUE_CELLS).filter(|cell| self.set[*cell] == set);
        candidates
            .reduce(|best, cell| if better(self.energy[cell], self.energy[best]) { cell } else { best })
            .unwrap_or(0)
    }
}

fn void_and_cluster() -> [u16; BLUE_CELLS] {
    let kernel: Vec<f32> = (0..BLUE_CELLS)
        .map(|cell| {
            let fold = |distance: usize| distance.min(BLUE_SIDE - distance) as f32;
            let (dx, dy) = (fold(cell % BLUE_SIDE), fold(cell / BLUE_SIDE));
            (-(dx * dx + dy * dy) / (2.0 * 1.5 * 1.5)).exp()
        })
        .collect();
    let mut start = Pattern { set: vec![false; BLUE_CELLS], energy: vec![0.0; BLUE_CELLS] };
    for index in 0..BLUE_CELLS as u32 / 10 {
        let cell = hash(index, 1, 2) as usize % BLUE_CELLS;
        if !start.set[cell] {
            start.toggle(cell, &kernel);
        }
    }
    loop {
        let cluster = start.tightest_cluster();
        start.toggle(cluster, &kernel);
        let void = start.largest_void();
        start.toggle(void, &kernel);
        if void == cluster {
            break;
        }
    }
    let minority = start.set.iter().filter(|set| **set).count();
    let mut ranks = [0; BLUE_CELLS];
    let mut thinned = start.clone();
    for rank in (0..minority).rev() {
        let cluster = thinned.tightest_cluster();
        thinned.toggle(cluster, &kernel);
        ranks[cluster] = rank as u16;
    }
    for rank in minority..BLUE_CELLS {
        let void = start.largest_void();
        start.toggle(void, &kernel);
        ranks[void] = rank as u16;
    }
    ranks
}

/// How far the threshold of the error diffusion wanders from ½, to break up worms.
const THRESHOLD_NOISE: f32 = 0.1;

fn floyd_steinberg(slice: u32, width: u32, luminance: &[f32], plane: &mut [u8]) {
    let width_px = width as usize;
    // One cell of margin on both sides: errors that leave the row fall off.
    let mut here = vec![0.0f32; width_px + 2];
    let mut below = vec![0.0f32; width_px + 2];
    let rows = luminance.chunks_exact(width_px).zip(plane.chunks_exact_mut(plane_stride(width)));
    for (y, (row, plane_row)) in (0u32..).zip(rows) {
        plane_row.fill(0);
        below.fill(0.0);
        let rightward = y % 2 == 0;
        for step in 0..width_px {
            let x = if rightward { step } else { width_px - 1 - step };
            // Where nothing is, nothing is lit: the silhouette stays sharp, and an error carried over the gap is dropped.
            if row[x] <= 0.0 {
                continue;
            }
            let wanted = row[x].min(1.0) + here[x + 1];
            let noise = (hash(x as u32, y, slice) >> 8) as f32 / (1 << 24) as f32 - 0.5;
            let lit = row[x] >= 1.0 || wanted > 0.5 + THRESHOLD_NOISE * noise;
            plane_row[x / 8] |= u8::from(lit) << (x % 8);
            let error = (wanted - f32::from(u8::from(lit))).clamp(-1.0, 1.0) / 16.0;
            let (ahead, behind) = if rightward { (x + 2, x) } else { (x, x + 2) };
            here[ahead] += 7.0 * error;
            below[behind] += 3.0 * error;
            below[x + 1] += 5.0 * error;
            below[ahead] += error;
        }
        core::mem::swap(&mut here, &mut below);
    }
}

/// A 32-bit mix of three numbers (the finaliser of MurmurHash3 over their sum with odd multipliers).
fn hash(a: u32, b: u32, c: u32) -> u32 {
    let mut mixed =
        a.wrapping_mul(0x9E37_79B1) ^ b.wrapping_mul(0x85EB_CA77).rotate_left(11) ^ c.wrapping_mul(0xC2B2_AE3D);
    mixed = (mixed ^ mixed >> 16).wrapping_mul(0x85EB_CA6B);
    mixed = (mixed ^ mixed >> 13).wrapping_mul(0xC2B2_AE35);
    mixed ^ mixed >> 16
}

#[cfg(test)]
mod tests {
    use super::*;

    const METHODS: [Halftone; 4] = [Halftone::Bayer, Halftone::BlueNoise, Halftone::FloydSteinberg, Halftone::Search];

    fn plane(method: Halftone, slice: u32, width: u32, luminance: &[f32]) -> Vec<u8> {
        let mut plane = vec![0xAA; plane_stride(width) * (luminance.len() / width as usize)];
        halftone(method, Slot { slice, turn: 0, blur: Blur::ROUND }, width, luminance, &mut plane);
        plane
    }

    fn lit(plane: &[u8]) -> u32 {
        plane.iter().map(|byte| byte.count_ones()).sum()
    }

    #[test]
    fn black_is_dark_and_white_is_lit() {
        for method in METHODS {
            for slice in [0, 1, 287] {
                assert_eq!(lit(&plane(method, slice, 100, &[0.0; 10_000])), 0, "{method:?}");
                assert_eq!(lit(&plane(method, slice, 100, &[1.0; 10_000])), 10_000, "{method:?}");
                assert_eq!(lit(&plane(method, slice, 100, &[7.0; 10_000])), 10_000, "{method:?}");
            }
        }
    }

    #[test]
    fn a_flat_grey_keeps_its_mean() {
        for method in METHODS {
            for level in [0.1f32, 0.37, 0.5, 0.9] {
                let mean = lit(&plane(method, 5, 128, &[level; 128 * 128])) as f32 / (128.0 * 128.0);
                assert!((mean - level).abs() < 0.01, "{method:?} {level}: {mean}");
            }
        }
    }

    #[test]
    fn every_rank_stands_once() {
        let mut ranks = blue_noise_ranks().to_vec();
        ranks.sort_unstable();
        assert!(ranks.iter().enumerate().all(|(index, rank)| index == usize::from(*rank)));
        let mut bayer: Vec<_> = (0..64).map(|cell| (bayer_threshold(cell % 8, cell / 8) * 64.0) as u32).collect();
        bayer.sort_unstable();
        assert_eq!(bayer, (0..64).collect::<Vec<_>>());
    }

    #[test]
    fn blue_noise_has_no_low_frequencies() {
        // Of 8 × 8 boxes, white noise at one half would scatter by √(64 · ¼) = 4 pixels.
        let plane = plane(Halftone::BlueNoise, 0, 64, &[0.5; BLUE_CELLS]);
        let boxes =
            (0..64).map(|tile| (0..8).map(|row| plane[(tile / 8 * 8 + row) * 8 + tile % 8].count_ones()).sum::<u32>());
        let scatter = boxes.map(|count| (f64::from(count) - 32.0).powi(2)).sum::<f64>() / 64.0;
        assert!(scatter.sqrt() < 1.5, "{}", scatter.sqrt());
    }

    #[test]
    fn error_diffusion_stays_inside_the_silhouette() {
        let luminance: Vec<f32> = (0..64 * 64).map(|cell| if cell % 64 < 32 { 0.9 } else { 0.0 }).collect();
        let plane = plane(Halftone::FloydSteinberg, 0, 64, &luminance);
        assert!(plane.chunks_exact(8).all(|row| row[4..].iter().all(|byte| *byte == 0)));
    }
}
