//! The direct linear transform: places in space and their pixels to a 3 × 4 matrix.

use glam::{DMat3, DVec2, DVec3};
use nalgebra::{DMatrix, Matrix3, SymmetricEigen};

/// Pairs that give the eleven ratios of the matrix.
pub const PAIRS_MIN: usize = 6;
/// Places nearer to one plane than this share of their spread do not show the projector's distance.
const FLAT: f64 = 0.01;

/// Why there is no matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DltError {
    /// All places are so near one plane, RMS, metres.
    Coplanar(f64),
    /// The image is mirrored.
    Mirrored,
    /// Places are on both sides of the projector, or the matrix is singular.
    None,
}

/// A pinhole: pixels of homogeneous (u w, v w, w) = `matrix` (X − `position`), w the depth in metres.
#[derive(Clone, Copy, Debug)]
pub struct Pinhole {
    pub matrix: DMat3,
    pub position: DVec3,
}

/// The matrix whose algebraic error over `pairs`, at least [`PAIRS_MIN`], is least, in coordinates with mean 0 and mean distance √3 and √2
/// (Hartley, "In defense of the eight-point algorithm", 1997).
pub fn dlt(pairs: &[(DVec3, DVec2)]) -> Result<Pinhole, DltError> {
    let count = pairs.len() as f64;
    let middle = pairs.iter().map(|(place, _)| *place).sum::<DVec3>() / count;
    let size = pairs.iter().map(|(place, _)| place.distance(middle)).sum::<f64>() / count / 3f64.sqrt();
    let centre = pairs.iter().map(|(_, pixel)| *pixel).sum::<DVec2>() / count;
    let extent = pairs.iter().map(|(_, pixel)| pixel.distance(centre)).sum::<f64>() / count / 2f64.sqrt();
    let aside = off_plane_m(pairs, middle);
    if aside <= FLAT * size {
        return Err(DltError::Coplanar(aside));
    }
    // At least as many rows as columns, so that the null vector is among the right singular ones.
    let mut rows = DMatrix::zeros((2 * pairs.len()).max(12), 12);
    for (index, (place, pixel)) in pairs.iter().enumerate() {
        let [x, y, z] = ((*place - middle) / size).to_array();
        for (row, along) in (2 * index..).zip(((*pixel - centre) / extent).to_array()) {
            let first = 4 * (row % 2);
            for (column, value) in [x, y, z, 1.0].into_iter().enumerate() {
                rows[(row, first + column)] = value;
                rows[(row, 8 + column)] = -along * value;
            }
        }
    }
    let right = rows.svd(false, true).v_t.expect("asked for");
    let null = right.row(11);
    let column = |index: usize| DVec3::new(null[index], null[4 + index], null[8 + index]);
    let pixels = DMat3::from_cols(DVec3::X * extent, DVec3::Y * extent, centre.extend(1.0));
    let matrix = pixels * DMat3::from_cols(column(0), column(1), column(2)) * (1.0 / size);
    let shift = pixels * column(3) - matrix * middle;
    let scale = matrix.row(2).length();
    let matrix = matrix * (1.0 / scale);
    let position = -(matrix.inverse() * (shift / scale));
    let depth = |(place, _): &(DVec3, DVec2)| matrix.row(2).dot(*place - position);
    let behind = pairs.iter().filter(|pair| depth(pair) < 0.0).count();
    if !position.is_finite() || (behind != 0 && behind != pairs.len()) {
        return Err(DltError::None);
    }
    let matrix = if behind == 0 { matrix } else { matrix * -1.0 };
    if matrix.determinant() < 0.0 { Err(DltError::Mirrored) } else { Ok(Pinhole { matrix, position }) }
}

/// The RMS distance of the places from the plane that is nearest to them.
fn off_plane_m(pairs: &[(DVec3, DVec2)], middle: DVec3) -> f64 {
    let spread = pairs.iter().fold(Matrix3::zeros(), |sum, (place, _)| {
        let arm = nalgebra::Vector3::from((*place - middle).to_array());
        sum + arm * arm.transpose()
    });
    let least = SymmetricEigen::new(spread / pairs.len() as f64).eigenvalues.min();
    least.max(0.0).sqrt()
}
