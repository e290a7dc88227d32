//! Eigenvalues and eigenvectors of small symmetric matrices, the largest first.

use nalgebra::{DMatrix, SymmetricEigen};

/// The eigenvalues of the symmetric matrix `matrix` in falling order, and a unit eigenvector for each.
pub fn eigen<const N: usize>(matrix: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let found = SymmetricEigen::new(DMatrix::from_fn(N, N, |row, column| matrix[row][column]));
    let mut order: [usize; N] = std::array::from_fn(|index| index);
    order.sort_by(|a, b| found.eigenvalues[*b].total_cmp(&found.eigenvalues[*a]));
    let vector = |index: usize| std::array::from_fn(|row| found.eigenvectors[(row, index)]);
    (order.map(|index| found.eigenvalues[index]), order.map(vector))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_matrix_by_hand() {
        let (values, vectors) = eigen([[2.0, 1.0], [1.0, 2.0]]);
        assert!((values[0] - 3.0).abs() < 1e-15 && (values[1] - 1.0).abs() < 1e-15);
        assert!((vectors[0][0] - vectors[0][1]).abs() < 1e-15 && (vectors[1][0] + vectors[1][1]).abs() < 1e-15);
        assert_eq!(eigen([[0.0; 3]; 3]).0, [0.0; 3]);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn vectors_are_stretched_by_their_values(half in prop::array::uniform4(prop::array::uniform4(-10.0..10.0f64))) {
            let matrix: [[f64; 4]; 4] = std::array::from_fn(|row| std::array::from_fn(|column| half[row][column] + half[column][row]));
            let (values, vectors) = eigen(matrix);
            prop_assert!(values.windows(2).all(|pair| pair[0] >= pair[1]));
            for (value, vector) in values.iter().zip(vectors) {
                let dot = |other: [f64; 4]| (0..4).map(|index| vector[index] * other[index]).sum::<f64>();
                for index in 0..4 {
                    prop_assert!((dot(matrix[index]) - value * vector[index]).abs() < 1e-12 * 40.0);
                }
                prop_assert!((dot(vector) - 1.0).abs() < 1e-12);
            }
        }
    }
}
