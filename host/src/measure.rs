//! How good a picture is: PSNR and SSIM of linear luminance, over the pixels that both pictures know.

use crate::picture::Picture;
use serde::Serialize;
use thiserror::Error;

/// Two pictures compared.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Likeness {
    /// Peak signal to noise ratio with peak 1, after a Gaussian of σ = 1 pixel on both, in dB. Capped at 150 for equal pictures,
    /// for which it is infinite.
    pub psnr_db: f64,
    /// Mean structural similarity (Wang et al. 2004: Gaussian window of σ = 1.5 pixels, K₁ = 0.01, K₂ = 0.03, L = 1) of the same.
    pub ssim: f64,
    /// Share of pixels that both pictures know.
    pub share: f64,
}

/// Why two pictures cannot be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum MeasureError {
    /// See the message.
    #[error("pictures of {0} × {1} and {2} × {3} pixels: they must be of one size")]
    Sizes(u32, u32, u32, u32),
    /// See the message.
    #[error("no pixel is known in both pictures")]
    NothingInCommon,
}

/// How strongly two turns that alternate flicker: the root mean square of the difference of what is seen of them, in linear
/// luminance with white 1, after the Gaussian of [`Likeness::psnr_db`]. The light swings by half of it around the mean.
pub fn flicker(first: &Picture, second: &Picture) -> Result<f64, MeasureError> {
    Ok(10f64.powf(-compare(first, second)?.psnr_db / 20.0))
}

/// Compares two pictures of one size.
pub fn compare(a: &Picture, b: &Picture) -> Result<Likeness, MeasureError> {
    if (a.width, a.height) != (b.width, b.height) {
        return Err(MeasureError::Sizes(a.width, a.height, b.width, b.height));
    }
    let known: Vec<f64> = a.known.iter().zip(&b.known).map(|(a, b)| f64::from(u8::from(a & b))).collect();
    let count: f64 = known.iter().sum();
    if count == 0.0 {
        return Err(MeasureError::NothingInCommon);
    }
    let blur = Blur { width: a.width as usize, known: &known };
    let [a, b] =
        [a, b].map(|picture| blur.apply(&picture.luminance().into_iter().map(f64::from).collect::<Vec<_>>(), 1.0));
    let over_known = |value: &dyn Fn(usize) -> f64| {
        (0..known.len()).filter(|cell| known[*cell] > 0.0).map(value).sum::<f64>() / count
    };
    let error = over_known(&|cell| (a[cell] - b[cell]).powi(2));
    let similarity = similarity(&blur, &a, &b);
    Ok(Likeness {
        psnr_db: (-10.0 * error.max(1e-15).log10()).min(150.0),
        ssim: over_known(&|cell| similarity[cell]),
        share: count / known.len() as f64,
    })
}

fn similarity(blur: &Blur<'_>, a: &[f64], b: &[f64]) -> Vec<f64> {
    const C1: f64 = 0.01 * 0.01;
    const C2: f64 = 0.03 * 0.03;
    let mean = |value: &dyn Fn(usize) -> f64| blur.apply(&(0..a.len()).map(value).collect::<Vec<_>>(), 1.5);
    let (ma, mb) = (mean(&|cell| a[cell]), mean(&|cell| b[cell]));
    let (aa, bb) = (mean(&|cell| a[cell] * a[cell]), mean(&|cell| b[cell] * b[cell]));
    let ab = mean(&|cell| a[cell] * b[cell]);
    let at = |cell: usize| {
        let (ma, mb) = (ma[cell], mb[cell]);
        let (va, vb, covariance) = (aa[cell] - ma * ma, bb[cell] - mb * mb, ab[cell] - ma * mb);
        ((2.0 * ma * mb + C1) * (2.0 * covariance + C2)) / ((ma * ma + mb * mb + C1) * (va + vb + C2))
    };
    (0..a.len()).map(at).collect()
}

/// A Gaussian that takes nothing from unknown pixels.
struct Blur<'a> {
    width: usize,
    /// 1 for known pixels, 0 for the others.
    known: &'a [f64],
}

impl Blur<'_> {
    fn apply(&self, values: &[f64], sigma: f64) -> Vec<f64> {
        let masked: Vec<f64> = values.iter().zip(self.known).map(|(value, known)| value * known).collect();
        let (sums, weights) = (self.both_ways(&masked, sigma), self.both_ways(self.known, sigma));
        sums.iter().zip(&weights).map(|(sum, weight)| if *weight > 0.0 { sum / weight } else { 0.0 }).collect()
    }

    fn both_ways(&self, values: &[f64], sigma: f64) -> Vec<f64> {
        let height = values.len() / self.width;
        let across = one_way(values, sigma, self.width, 1, height, self.width);
        one_way(&across, sigma, height, self.width, self.width, 1)
    }
}

/// Convolves `lines` lines of `length` values `step` apart that begin `line_step` apart; cut off at 4 σ, nothing beyond the ends.
fn one_way(values: &[f64], sigma: f64, length: usize, step: usize, lines: usize, line_step: usize) -> Vec<f64> {
    let reach = (4.0 * sigma).ceil() as usize;
    let kernel: Vec<f64> = (0..=reach).map(|at| (-((at * at) as f64) / (2.0 * sigma * sigma)).exp()).collect();
    let mut result = vec![0.0; values.len()];
    for line in 0..lines {
        let start = line * line_step;
        for at in 0..length {
            let near = at.saturating_sub(reach)..(at + reach + 1).min(length);
            result[start + at * step] = near.map(|from| values[start + from * step] * kernel[from.abs_diff(at)]).sum();
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(value: impl Fn(u32, u32) -> f32) -> Picture {
        Picture::grey(32, 24, (0..32 * 24).map(|cell| value(cell % 32, cell / 32)).collect())
    }

    #[test]
    fn a_constant_offset_has_its_closed_form() {
        // Blurring a constant changes nothing: −20 log₁₀ 0.1 = 20 dB.
        let likeness = compare(&picture(|_, _| 0.5), &picture(|_, _| 0.6)).unwrap();
        assert!((likeness.psnr_db - 20.0).abs() < 1e-5, "{likeness:?}");
        let expected = (2.0 * 0.3 + 1e-4) / (0.61 + 1e-4);
        assert!((likeness.ssim - expected).abs() < 1e-5, "{likeness:?}");
    }

    #[test]
    fn a_checkerboard_is_blurred_away() {
        // The Gaussian of 1 pixel leaves exp(−π²/2)² of the highest frequency in both directions: 5e-5.
        let board = compare(&picture(|x, y| ((x + y) % 2) as f32), &picture(|_, _| 0.5)).unwrap();
        assert!(board.psnr_db > 45.0, "{board:?}");
    }

    #[test]
    fn equal_pictures_are_alike_and_unknown_pixels_do_not_count() {
        let a = picture(|x, y| (x * y % 7) as f32 / 7.0);
        let mut b = a.clone();
        assert_eq!(compare(&a, &b).unwrap(), Likeness { psnr_db: 150.0, ssim: 1.0, share: 1.0 });
        for cell in 0..100 {
            b.colours[cell] = [9.0; 3];
            b.known[cell] = false;
        }
        let likeness = compare(&a, &b).unwrap();
        assert!(likeness.psnr_db == 150.0 && likeness.share < 0.9, "{likeness:?}");
        b.known.fill(false);
        assert_eq!(compare(&a, &b), Err(MeasureError::NothingInCommon));
        assert_eq!(compare(&a, &Picture::grey(1, 1, vec![0.0])), Err(MeasureError::Sizes(32, 24, 1, 1)));
    }
}
