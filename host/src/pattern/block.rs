//! A block of cells that a camera reads: the slice's number, and the same inverted, so that damage shows and the light is the same in
//! every plane.

use super::Sheet;
use glam::{DMat3, DVec2, DVec3};

/// Cells on a side: a frame of lit cells at the top and on the left, dark ones around, and 5 × 5 inside.
pub const CELLS: u32 = 8;
const INSIDE: u32 = 5;
/// Bits of a number.
const BITS: u32 = 12;

/// The inside, row by row from the top.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block([[bool; INSIDE as usize]; INSIDE as usize]);

impl Block {
    /// Of slice `slice`, modulo 4096.
    pub fn of(slice: u32) -> Self {
        let bit = |place: u32| match place {
            0..BITS => slice >> (BITS - 1 - place) & 1 == 1,
            // The middle one is lit.
            BITS => true,
            _ => slice >> (2 * BITS - place) & 1 == 0,
        };
        Self(std::array::from_fn(|row| std::array::from_fn(|column| bit(row as u32 * INSIDE + column as u32))))
    }

    /// The slice, if number and inverse agree.
    pub fn slice(&self) -> Option<u32> {
        let bits = self.0.as_flattened();
        let slice = bits[..BITS as usize].iter().fold(0, |number, bit| number << 1 | u32::from(*bit));
        (Self::of(slice) == *self).then_some(slice)
    }

    /// Draws it into the upper left part of a slice, a third as wide.
    pub(super) fn draw(&self, sheet: &mut Sheet<'_>) {
        let cell = (sheet.width() / 3 / CELLS).max(1);
        let mut light = |column: u32, row: u32| sheet.fill([column * cell, row * cell], [cell, cell]);
        (1..CELLS - 1).for_each(|place| {
            light(place, 1);
            light(1, place);
        });
        for (row, bits) in (2..).zip(self.0) {
            (2..).zip(bits).filter(|(_, bit)| *bit).for_each(|(column, _)| light(column, row));
        }
    }

    /// Reads it from a picture: `light` gives the luminance at a pixel, and `corners` are the pixels at which the block with its dark border
    /// stands, upper left, upper right, lower right, lower left. Nothing where there is none.
    pub fn read(light: impl Fn(DVec2) -> f64, corners: [DVec2; 4]) -> Option<Self> {
        let place = square_to(corners)?;
        let at = |column: u32, row: u32| {
            let inside = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5) / f64::from(CELLS);
            let point = place * inside.extend(1.0);
            light(point.truncate() / point.z)
        };
        let frame: f64 = (1..CELLS - 1).map(|cell| at(cell, 1) + at(1, cell)).sum::<f64>() / f64::from(2 * (CELLS - 2));
        let around = (0..CELLS).map(|cell| at(cell, 0) + at(0, cell) + at(cell, CELLS - 1) + at(CELLS - 1, cell));
        let border = around.sum::<f64>() / f64::from(4 * CELLS);
        let middle = (frame + border) / 2.0;
        // A frame that hardly stands out is none.
        let is_there = frame > 1.3 * border && frame - border > 1e-3;
        let inside = |row: u32| std::array::from_fn(|column| at(column as u32 + 2, row + 2) > middle);
        is_there.then(|| Self(std::array::from_fn(|row| inside(row as u32))))
    }
}

/// The projective map from the unit square to four corners; nothing where three lie on a line. Heckbert, Fundamentals of Texture Mapping and
/// Image Warping, 2.2.3.
fn square_to([a, b, c, d]: [DVec2; 4]) -> Option<DMat3> {
    let (first, second, sum) = (b - c, d - c, a - b + c - d);
    let denominator = first.perp_dot(second);
    let turns = [(a, b, c), (b, c, d), (c, d, a), (d, a, b)].map(|(p, q, r)| (q - p).perp_dot(r - q));
    let is_convex = turns.iter().all(|turn| *turn > 1e-9) || turns.iter().all(|turn| *turn < -1e-9);
    let (g, h) = (sum.perp_dot(second) / denominator, first.perp_dot(sum) / denominator);
    let right = (b - a + g * b).extend(g);
    let down = (d - a + h * d).extend(h);
    is_convex.then(|| DMat3::from_cols(right, down, DVec3::new(a.x, a.y, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::{Pattern, draw};
    use crate::rigs;

    #[test]
    fn each_slice_is_read_back_and_damage_is_seen() {
        for slice in 0..4096 {
            let block = Block::of(slice);
            assert_eq!(block.slice(), Some(slice));
            for cell in 0..25 {
                let mut damaged = block;
                damaged.0.as_flattened_mut()[cell] ^= true;
                assert_eq!(damaged.slice(), None, "{slice} {cell}");
            }
        }
    }

    #[test]
    fn a_camera_that_looks_from_aside_reads_it() {
        let rig = rigs::find("reference").unwrap();
        let turn = draw(&rig, Pattern::Markers).unwrap();
        // Where the projector's pixels are in the camera's picture.
        let corners = [[40.0, 30.0], [150.0, 50.0], [140.0, 170.0], [30.0, 120.0]].map(DVec2::from);
        let image = square_to(corners).unwrap();
        let back = image.inverse();
        let block = f64::from(768 / 3 / CELLS * CELLS) / 768.0;
        let seen = [[0.0, 0.0], [block, 0.0], [block, block], [0.0, block]].map(|[x, y]| {
            let point = image * DVec3::new(x, y, 1.0);
            point.truncate() / point.z
        });
        for slice in [0, 1, 100, 287] {
            let light = |at: DVec2| {
                let point = back * at.extend(1.0);
                let pixel = (point.truncate() / point.z * 768.0).as_uvec2().min(glam::UVec2::splat(767));
                let byte = turn.slice(slice)[pixel.y as usize * 96 + pixel.x as usize / 8];
                0.1 + 0.5 * f64::from(byte >> (pixel.x % 8) & 1)
            };
            assert_eq!(Block::read(light, seen).and_then(|block| block.slice()), Some(slice));
        }
        assert_eq!(Block::read(|_| 0.5, seen), None);
        assert_eq!(Block::read(|at| at.x, [seen[0]; 4]), None);
    }
}
