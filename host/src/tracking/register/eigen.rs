//! Eigenvalues and eigenvectors of small symmetric matrices.

/// Sweeps after which rotations have long been below rounding: convergence is quadratic.
const SWEEPS: usize = 30;

/// The eigenvalues of the symmetric matrix `matrix` in falling order, and a unit eigenvector for each: Jacobi's rotations (Golub and Van Loan,
/// Matrix Computations, 8.5).
pub fn eigen<const N: usize>(mut matrix: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut vectors: [[f64; N]; N] = std::array::from_fn(|row| std::array::from_fn(|column| f64::from(row == column)));
    for _ in 0..SWEEPS {
        for p in 0..N {
            for q in p + 1..N {
                rotate(&mut matrix, &mut vectors, p, q);
            }
        }
    }
    let mut order: [usize; N] = std::array::from_fn(|index| index);
    order.sort_by(|a, b| matrix[*b][*b].total_cmp(&matrix[*a][*a]));
    (order.map(|index| matrix[index][index]), order.map(|index| vectors[index]))
}

/// Turns in the plane of `p` and `q` so that the element between them vanishes. `vectors` holds an eigenvector a row.
fn rotate<const N: usize>(matrix: &mut [[f64; N]; N], vectors: &mut [[f64; N]; N], p: usize, q: usize) {
    let between = matrix[p][q];
    if between == 0.0 {
        return;
    }
    let half = (matrix[q][q] - matrix[p][p]) / (2.0 * between);
    let tangent = half.signum() / (half.abs() + half.hypot(1.0));
    let cosine = 1.0 / tangent.hypot(1.0);
    let sine = tangent * cosine;
    let turn = |a: f64, b: f64| (cosine * a - sine * b, sine * a + cosine * b);
    for row in matrix.iter_mut() {
        (row[p], row[q]) = turn(row[p], row[q]);
    }
    for column in 0..N {
        (matrix[p][column], matrix[q][column]) = turn(matrix[p][column], matrix[q][column]);
        (vectors[p][column], vectors[q][column]) = turn(vectors[p][column], vectors[q][column]);
    }
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
