//! Least squares with errors that hang together: what is close in time errs together.

/// Columns of equal length, and what they are to add up to.
#[derive(Clone, Debug, Default)]
pub(super) struct Regression {
    pub(super) columns: Vec<Vec<f64>>,
    pub(super) target: Vec<f64>,
    /// Rows of the same number err together.
    pub(super) cluster: Vec<usize>,
}

/// A solution with the covariance of its coefficients.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    pub(super) coefficients: Vec<f64>,
    pub(super) covariance: Vec<Vec<f64>>,
    pub(super) residuals: Vec<f64>,
}

impl Fit {
    pub(super) fn squares(&self) -> f64 {
        self.residuals.iter().map(|residual| residual * residual).sum()
    }

    /// Coefficient `of` over coefficient `by`, and its standard deviation by the first derivatives.
    pub(super) fn ratio(&self, of: usize, by: usize) -> (f64, f64) {
        let ratio = self.coefficients[of] / self.coefficients[by];
        let (over, covariance) = (1.0 / self.coefficients[by], &self.covariance);
        let variance = covariance[of][of] - 2.0 * ratio * covariance[of][by] + ratio * ratio * covariance[by][by];
        (ratio, over.abs() * variance.max(0.0).sqrt())
    }

    /// The size of the coefficients `at` and `at + 1` taken as cosine and sine, and its standard deviation.
    pub(super) fn size(&self, at: usize) -> (f64, f64) {
        let [cosine, sine] = [self.coefficients[at], self.coefficients[at + 1]];
        let size = cosine.hypot(sine);
        let c = |i: usize, j: usize| self.covariance[at + i][at + j];
        let variance = cosine * cosine * c(0, 0) + 2.0 * cosine * sine * c(0, 1) + sine * sine * c(1, 1);
        (size, variance.max(0.0).sqrt() / size.max(1e-30))
    }
}

impl Regression {
    /// The least squares, and the covariance (XᵀX)⁻¹ (Σ Xᵀe eᵀX over clusters) (XᵀX)⁻¹. `None` where columns say the same.
    pub(super) fn fit(&self) -> Option<Fit> {
        let n = self.columns.len();
        let scales: Vec<f64> = self.columns.iter().map(|column| dot(column, column).sqrt()).collect();
        if scales.iter().any(|scale| !scale.is_finite() || *scale <= 0.0) {
            return None;
        }
        let product = |i: usize, j: usize| dot(&self.columns[i], &self.columns[j]) / (scales[i] * scales[j]);
        let normal: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|j| product(i, j)).collect()).collect();
        let inverse = invert(normal)?;
        let right: Vec<f64> = (0..n).map(|i| dot(&self.columns[i], &self.target) / scales[i]).collect();
        let coefficients: Vec<f64> = (0..n).map(|i| dot(&inverse[i], &right) / scales[i]).collect();
        let fitted = |row: usize| (0..n).map(|i| coefficients[i] * self.columns[i][row]).sum::<f64>();
        let residuals: Vec<f64> = (0..self.target.len()).map(|row| self.target[row] - fitted(row)).collect();
        let covariance = self.covariance(&inverse, &scales, &residuals);
        Some(Fit { coefficients, covariance, residuals })
    }

    fn covariance(&self, inverse: &[Vec<f64>], scales: &[f64], residuals: &[f64]) -> Vec<Vec<f64>> {
        let n = scales.len();
        let clusters = self.cluster.iter().max().map_or(0, |last| last + 1);
        let mut scores = vec![vec![0.0; n]; clusters];
        for (row, cluster) in self.cluster.iter().enumerate() {
            for (i, score) in scores[*cluster].iter_mut().enumerate() {
                *score += self.columns[i][row] * residuals[row] / scales[i];
            }
        }
        let influence: Vec<Vec<f64>> =
            scores.iter().map(|score| (0..n).map(|i| dot(&inverse[i], score) / scales[i]).collect()).collect();
        let used = scores.iter().filter(|score| score.iter().any(|value| *value != 0.0)).count() as f64;
        let small = used / (used - n as f64).max(1.0);
        let entry = |i: usize, j: usize| small * influence.iter().map(|row| row[i] * row[j]).sum::<f64>();
        (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// By Gauss and Jordan, with pivots from the whole column.
fn invert(mut matrix: Vec<Vec<f64>>) -> Option<Vec<Vec<f64>>> {
    let n = matrix.len();
    for (i, row) in matrix.iter_mut().enumerate() {
        row.extend((0..n).map(|j| f64::from(u8::from(i == j))));
    }
    for column in 0..n {
        let pivot = (column..n).max_by(|&a, &b| matrix[a][column].abs().total_cmp(&matrix[b][column].abs()))?;
        if matrix[pivot][column].abs() < 1e-10 {
            return None;
        }
        matrix.swap(column, pivot);
        let scale = 1.0 / matrix[column][column];
        matrix[column].iter_mut().for_each(|value| *value *= scale);
        let pivot_row = matrix[column].clone();
        for (_, row) in matrix.iter_mut().enumerate().filter(|(i, _)| *i != column) {
            let factor = row[column];
            row.iter_mut().zip(&pivot_row).for_each(|(value, pivot)| *value -= factor * pivot);
        }
    }
    Some(matrix.into_iter().map(|row| row[n..].to_vec()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_comes_back_and_its_errors_are_as_large_as_they_are() {
        let mut seed = 1u64;
        let mut noise = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) as f64 / f64::from(1u32 << 31) - 0.5
        };
        let (mut inside, runs) = (0, 200);
        for _ in 0..runs {
            let xs: Vec<f64> = (0..400).map(|i| f64::from(i) * 0.01).collect();
            // Ten rows share an error.
            let errors: Vec<f64> = (0..40).flat_map(|_| [noise(); 10]).collect();
            let target = xs.iter().zip(errors).map(|(x, error)| 3.0 + 2.0 * x + error).collect();
            let cluster = (0..400).map(|i| i / 10).collect();
            let fit = Regression { columns: vec![vec![1.0; 400], xs], target, cluster }.fit().unwrap();
            inside += u32::from((fit.coefficients[1] - 2.0).abs() < fit.covariance[1][1].sqrt());
        }
        // 68 % of them, within three standard deviations of 200 draws.
        assert!((116..158).contains(&inside), "{inside}");
    }

    #[test]
    fn columns_that_say_the_same_are_refused() {
        let column = vec![1.0, 2.0, 3.0];
        let regression =
            Regression { columns: vec![column.clone(), column.clone()], target: column, cluster: vec![0; 3] };
        assert!(regression.fit().is_none());
    }
}
