//! The covariance of an estimate, and the few operations on it that a sequential Kalman filter needs.

use crate::single::at_least;

/// A symmetric `N` x `N` matrix, both halves stored.
#[derive(Clone, Debug, PartialEq)]
pub struct Covariance<const N: usize>([[f32; N]; N]);

impl<const N: usize> Covariance<N> {
    /// Nothing correlated; `variance[i]` on the diagonal.
    pub fn diagonal(variance: [f32; N]) -> Self {
        let mut rows = [[0.0; N]; N];
        for (i, (row, value)) in rows.iter_mut().zip(variance).enumerate() {
            row[i] = value;
        }
        Self(rows)
    }

    /// The variance of state `i`.
    pub fn variance(&self, i: usize) -> f32 {
        self.0[i][i]
    }

    /// Whether every variance is a number.
    pub fn is_finite(&self) -> bool {
        (0..N).all(|i| self.0[i][i].is_finite())
    }

    /// Adds to the variance of state `i`.
    pub fn widen(&mut self, i: usize, variance: f32) {
        self.0[i][i] += variance;
    }

    /// Multiplies all of it: as much less certain of everything.
    pub fn scale(&mut self, factor: f32) {
        self.0.as_flattened_mut().iter_mut().for_each(|value| *value *= factor);
    }

    /// Makes state `i` independent of the others, with `variance`.
    pub fn isolate(&mut self, i: usize, variance: f32) {
        for j in 0..N {
            self.0[i][j] = 0.0;
            self.0[j][i] = 0.0;
        }
        self.0[i][i] = variance;
    }

    /// The step `state[to] += sum of weight * state[from]`. No `from` may be `to`.
    pub fn shear<const M: usize>(&mut self, to: usize, terms: [(usize, f32); M]) {
        let mut added = [0.0; N];
        for (from, weight) in terms {
            for (sum, value) in added.iter_mut().zip(&self.0[from]) {
                *sum += weight * value;
            }
        }
        // The variance of `to` grows by twice the covariance with the sum, and by the variance of the sum itself.
        let own: f32 = terms.iter().map(|&(from, weight)| weight * added[from]).sum();
        let variance = self.0[to][to] + 2.0 * added[to] + own;
        for (j, sum) in added.iter().enumerate() {
            let value = self.0[to][j] + sum;
            self.0[to][j] = value;
            self.0[j][to] = value;
        }
        self.0[to][to] = variance;
    }

    /// The covariance of every state with the measured sum of `weight * state[from]`, and that sum's variance.
    // Inlined, the places are constants, and no index needs a check.
    #[inline(always)]
    pub fn seen_through<const M: usize>(&self, terms: [(usize, f32); M]) -> ([f32; N], f32) {
        let mut gain = [0.0; N];
        for (from, weight) in terms {
            for (sum, value) in gain.iter_mut().zip(&self.0[from]) {
                *sum += weight * value;
            }
        }
        let variance = terms.iter().map(|&(from, weight)| weight * gain[from]).sum();
        (gain, variance)
    }

    /// Takes `share * gain gainᵀ` away, as a measurement with that `gain` does; `share` is 1 / (variance + noise).
    /// Variances stay above `floor`: rounding must not make the filter certain.
    #[expect(clippy::needless_range_loop, reason = "iterators take 1,330 instructions more on a Cortex-M4")]
    pub fn reduce(&mut self, gain: &[f32; N], share: f32, floor: &[f32; N]) {
        for i in 0..N {
            let scaled = gain[i] * share;
            for j in i..N {
                let value = self.0[i][j] - scaled * gain[j];
                self.0[i][j] = value;
                self.0[j][i] = value;
            }
            self.0[i][i] = at_least(self.0[i][i], floor[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_equal_measurements_halve_the_variance() {
        let mut covariance = Covariance::diagonal([1e6, 1.0]);
        for _ in 0..2 {
            let (gain, variance) = covariance.seen_through([(0, 1.0)]);
            covariance.reduce(&gain, 1.0 / (variance + 4.0), &[0.0; 2]);
        }
        assert!((covariance.variance(0) - 2.0).abs() < 1e-3);
        assert_eq!(covariance.variance(1), 1.0);
        covariance.scale(3.0);
        assert_eq!(covariance.variance(1), 3.0);
    }

    #[test]
    fn a_shear_is_the_matrix_product() {
        // state 0 += 0.5 * state 1 - 2 * state 2, with a correlation between 1 and 2 made by an earlier shear.
        let mut covariance = Covariance::diagonal([1.0, 2.0, 3.0]);
        covariance.shear(2, [(1, 1.0)]);
        covariance.shear(0, [(1, 0.5), (2, -2.0)]);
        // Var(x1) = 2, Var(x2) = 5, Cov(x1, x2) = 2: 1 + 0.25 * 2 + 4 * 5 - 2 * 0.5 * 2 * 2.
        assert!((covariance.variance(0) - 17.5).abs() < 1e-5);
        let (gain, _) = covariance.seen_through([(0, 1.0)]);
        assert!((gain[1] - (0.5 * 2.0 - 2.0 * 2.0)).abs() < 1e-6);
        assert!((gain[2] - (0.5 * 2.0 - 2.0 * 5.0)).abs() < 1e-6);
    }
}
