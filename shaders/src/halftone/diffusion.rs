//! Halftone by error diffusion in serpentine order: what a pixel's bit leaves unsaid, its neighbours to come are told.

use super::{hash, plane_stride};

/// To whom an error goes, and how the threshold wanders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kernel {
    /// Shares of the next two pixels of the row.
    ahead: [f32; 2],
    /// Shares in the next two rows, from two pixels behind to two ahead.
    below: [[f32; TAPS]; ROWS],
    /// The threshold is higher by half of this on one colour of a checkerboard than on the other; the colours change
    /// from slice to slice.
    checkerboard: f32,
    /// How far the threshold wanders from pixel to pixel, to break up worms.
    noise: f32,
}

const TAPS: usize = 5;
const ROWS: usize = 2;
/// How far a row's errors reach sideways, in pixels.
const REACH: usize = TAPS / 2;

impl Kernel {
    /// Floyd and Steinberg's of 1976.
    pub const FLOYD_STEINBERG: Self = Self {
        ahead: [7.0 / 16.0, 0.0],
        below: [[0.0, 3.0 / 16.0, 5.0 / 16.0, 1.0 / 16.0, 0.0], [0.0; TAPS]],
        checkerboard: 0.0,
        noise: 0.1,
    };

    /// The kernel that leaves the least error after a Gaussian of σ = 1.5 pixels, if errors are white (Kolpatzik and
    /// Bouman 1992).
    ///
    /// It is the best prediction of the blurred error from pixels already set: the shares h, of sum 1, least in
    /// |g ∗ (δ − h)|² + 0.02 |h|². The second term keeps the errors small enough for one bit.
    pub const OPTIMISED: Self = Self {
        ahead: [0.819, -0.102],
        below: [[0.078, 0.401, 0.333, -0.102, -0.213], [-0.103, -0.106, -0.077, -0.076, 0.148]],
        checkerboard: 0.6,
        noise: 0.1,
    };
}

/// Diffuses the errors of a slice. `seed` tells slices apart. `correction` is added to the luminance of a pixel before
/// it is decided, without a say in whether the pixel is part of the picture; see [`super::halftone`] for the rest.
pub fn diffuse(
    kernel: &Kernel,
    seed: u32,
    width: u32,
    luminance: &[f32],
    plane: &mut [u8],
    correction: impl Fn(usize) -> f32,
) {
    let columns = width as usize;
    // Errors of the rows above, the nearest first, each with the way that it went; a margin holds what leaves the row.
    let mut above = [0, 1].map(|_| (vec![0.0f32; columns + 2 * REACH], true));
    let mut wanted = vec![0.0f32; columns];
    let rows = luminance.chunks_exact(columns).zip(plane.chunks_exact_mut(plane_stride(width)));
    for (y, (row, plane_row)) in (0u32..).zip(rows) {
        plane_row.fill(0);
        let rightward = y % 2 == 0;
        let lit = |luminance: &f32| *luminance > 0.0;
        let span = row.iter().position(lit).unwrap_or(0)..row.iter().rposition(lit).map_or(0, |last| last + 1);
        wanted[span.clone()].fill(0.0);
        for ((errors, rightward), shares) in above.iter().zip(&kernel.below) {
            gather(&errors[span.start..span.end + 2 * REACH], *rightward, shares, &mut wanted[span.clone()]);
        }
        above.swap(0, ROWS - 1);
        let (errors, way) = &mut above[0];
        errors.fill(0.0);
        *way = rightward;
        let (mut last, mut last_but_one) = (0.0, 0.0);
        for step in 0..span.len() {
            let x = if rightward { span.start + step } else { span.end - 1 - step };
            let value = row[x];
            let mut error = 0.0;
            // Where nothing is, nothing is lit: the silhouette stays sharp, and an error carried over the gap is
            // dropped.
            if value > 0.0 {
                let carried = wanted[x] + kernel.ahead[0] * last + kernel.ahead[1] * last_but_one;
                let wanted = value.min(1.0) + carried + correction(y as usize * columns + x);
                let set = value >= 1.0 || wanted > kernel.threshold(x as u32, y, seed);
                plane_row[x / 8] |= u8::from(set) << (x % 8);
                error = (wanted - f32::from(u8::from(set))).clamp(-2.0, 2.0);
                errors[x + REACH] = error;
            }
            (last, last_but_one) = (error, last);
        }
    }
}

/// Adds to each pixel what the errors of a row above leave it.
fn gather(errors: &[f32], rightward: bool, shares: &[f32; TAPS], wanted: &mut [f32]) {
    let mut shares = *shares;
    if rightward {
        shares.reverse();
    }
    for (wanted, errors) in wanted.iter_mut().zip(errors.windows(TAPS)) {
        *wanted += errors.iter().zip(&shares).map(|(error, share)| error * share).sum::<f32>();
    }
}

impl Kernel {
    fn threshold(&self, x: u32, y: u32, seed: u32) -> f32 {
        let colour = if (x ^ y ^ seed) & 1 == 0 { -0.5 } else { 0.5 };
        let noise = (hash(x, y, seed) >> 8) as f32 / (1 << 24) as f32 - 0.5;
        0.5 + self.checkerboard * colour + self.noise * noise
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The shares of a kernel with the offsets that they go to, rightward.
    fn shares(kernel: &Kernel) -> Vec<([f64; 2], f64)> {
        let ahead = (0..).zip(kernel.ahead).map(|(step, share)| ([f64::from(step) + 1.0, 0.0], f64::from(share)));
        let below = (1..).zip(kernel.below).flat_map(|(row, shares)| {
            (-2..).zip(shares).map(move |(column, share)| ([f64::from(column), f64::from(row)], f64::from(share)))
        });
        ahead.chain(below).collect()
    }

    #[test]
    fn no_error_is_lost() {
        for kernel in [Kernel::FLOYD_STEINBERG, Kernel::OPTIMISED] {
            let sum: f64 = shares(&kernel).iter().map(|(_, share)| share).sum();
            assert!((sum - 1.0).abs() < 1e-6, "{sum}");
        }
    }

    /// Where shares of a given sum are best, the derivative of |g ∗ (δ − h)|² + 0.02 |h|² is the same for all of them.
    #[test]
    fn the_optimised_shares_are_the_best() {
        // g ⋆ g of a Gaussian of σ has √2 σ; in units of its peak.
        let blurred = |[ax, ay]: [f64; 2], [bx, by]: [f64; 2]| (-((ax - bx).powi(2) + (ay - by).powi(2)) / 9.0).exp();
        let spread = |kernel: &Kernel| {
            let shares = shares(kernel);
            let slopes = shares.iter().map(|(place, share)| {
                let others: f64 = shares.iter().map(|(other, share)| share * blurred(*place, *other)).sum();
                others - blurred(*place, [0.0, 0.0]) + 0.02 * share
            });
            let (low, high) = slopes.fold((f64::MAX, f64::MIN), |(low, high), slope| (low.min(slope), high.max(slope)));
            high - low
        };
        assert!(spread(&Kernel::OPTIMISED) < 0.003, "{}", spread(&Kernel::OPTIMISED));
        assert!(spread(&Kernel::FLOYD_STEINBERG) > 0.03, "{}", spread(&Kernel::FLOYD_STEINBERG));
    }

    /// The same written the other way round: each pixel hands out its error.
    fn scattered(kernel: &Kernel, seed: u32, width: usize, luminance: &[f32]) -> Vec<u8> {
        let mut plane = vec![0; luminance.len() / width * plane_stride(width as u32)];
        let mut handed = vec![0.0; luminance.len()];
        for (y, row) in luminance.chunks_exact(width).enumerate() {
            let way = if y % 2 == 0 { 1 } else { -1 };
            for step in 0..width {
                let x = if way > 0 { step } else { width - 1 - step };
                if row[x] <= 0.0 {
                    continue;
                }
                let wanted = f64::from(row[x]) + handed[y * width + x];
                let lit = wanted > f64::from(kernel.threshold(x as u32, y as u32, seed));
                plane[y * plane_stride(width as u32) + x / 8] |= u8::from(lit) << (x % 8);
                for ([dx, dy], share) in shares(kernel) {
                    let (to, below) = (x as i32 + way * dx as i32, y + dy as usize);
                    if (0..width as i32).contains(&to) && below < luminance.len() / width {
                        handed[below * width + to as usize] += share * (wanted - f64::from(u8::from(lit)));
                    }
                }
            }
        }
        plane
    }

    #[test]
    fn errors_go_where_the_kernel_says() {
        let luminance: Vec<f32> =
            (0..40 * 20).map(|cell| 0.3 + 0.4 * (hash(cell, 5, 6) % 100) as f32 / 100.0).collect();
        for kernel in [Kernel::FLOYD_STEINBERG, Kernel::OPTIMISED] {
            let mut plane = vec![0; 20 * 5];
            diffuse(&kernel, 7, 40, &luminance, &mut plane, |_| 0.0);
            assert_eq!(plane, scattered(&kernel, 7, 40, &luminance));
        }
    }
}
