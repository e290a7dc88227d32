//! Textures as luminances, for triangles that show them in one tint.

use super::figure::WHITE;
use crate::render::mesh::Triangle;
use crate::scene::{Texture, Wrap, luminance};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::Arc;

/// All pictures of a scene together may take this many bytes; triangles that would need more are shaded by the texture itself.
const BYTES_MAX: usize = 128 << 20;
/// Tints of a texture that differ by less are one: a quarter of a level of 8 bits.
const ALIKE: f32 = 1e-3;
/// More tints of a texture are as many as a mesh with coloured vertices has.
const TINTS_MAX: usize = 4;
/// The luminance of a white texel.
const FULL: f32 = 65_535.0;

/// The luminances of a texture's texels in one tint: linear, in 16 bits, with a border of one texel as the texture wraps.
pub struct Picture {
    tint: Vec3,
    sides: [f32; 2],
    /// One over the length after which it repeats, along both axes: twice its side where it is mirrored.
    per_period: [f32; 2],
    wrap: [Wrap; 2],
    stride: usize,
    cells: Vec<u16>,
}

/// How a triangle shows a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Skin {
    /// An index of [`Pictures::all`].
    pub picture: u32,
    /// Places in the picture at the corners, in texels, not below 0 where it is repeated.
    pub places: [[f32; 3]; 2],
    /// What luminances at the corners are multiplied by, to be in parts of [`WHITE`].
    pub gains: [f32; 3],
}

impl Picture {
    fn new(texture: &Texture, tint: Vec3) -> Self {
        let (width, height) = texture.size();
        let wrap = texture.wrap();
        let [columns, rows] = [(width, wrap[0]), (height, wrap[1])].map(|(side, wrap)| bordered(side, wrap));
        let mut cells = vec![0; columns.len() * rows.len()];
        cells.par_chunks_exact_mut(columns.len()).zip(&rows).for_each(|(cells, y)| {
            for (cell, x) in cells.iter_mut().zip(&columns) {
                *cell = (luminance(tint * texture.texel(*x, *y)) * FULL + 0.5) as u16;
            }
        });
        let sides = [width as f32, height as f32];
        let period = |axis: usize| if wrap[axis] == Wrap::Mirror { 2.0 * sides[axis] } else { sides[axis] };
        Self { tint, sides, per_period: [1.0 / period(0), 1.0 / period(1)], wrap, stride: columns.len(), cells }
    }

    /// Between texels at `place`, in parts of [`FULL`].
    #[inline(always)]
    pub fn sample(&self, place: [f32; 2]) -> f32 {
        let (x, fx) = self.cell(0, place[0]);
        let (y, fy) = self.cell(1, place[1]);
        let upper = &self.cells[y * self.stride + x..][..self.stride + 2];
        let [a, b] = [upper[0], upper[1]].map(f32::from);
        let [c, d] = [upper[self.stride], upper[self.stride + 1]].map(f32::from);
        let (upper, lower) = (a + (b - a) * fx, c + (d - c) * fx);
        upper + (lower - upper) * fy
    }

    /// The first of the two cells that a place lies between along an axis, and how far it lies toward the second.
    #[inline(always)]
    fn cell(&self, axis: usize, place: f32) -> (usize, f32) {
        let side = self.sides[axis];
        // Places are positive where this counts, so that the cast rounds down, which without SSE4.1 is a call.
        let periods = (place * self.per_period[axis]) as u32 as f32;
        let place = match self.wrap[axis] {
            Wrap::Clamp => place,
            Wrap::Repeat => place - side * periods,
            Wrap::Mirror => {
                let place = place - 2.0 * side * periods;
                place.min(2.0 * side - place)
            }
        };
        // Half a texel from its border to its centre, and one of the border; far away digits are lost, but no more.
        let place = place.clamp(0.0, side) + 0.5;
        let first = place as u32;
        (first as usize, place - first as f32)
    }
}

/// The texels of a row or column with its border.
fn bordered(side: u32, wrap: Wrap) -> Vec<u32> {
    // The mirror image begins with the border itself.
    let [before, after] = if wrap == Wrap::Repeat { [side - 1, 0] } else { [0, side - 1] };
    [before].into_iter().chain(0..side).chain([after]).collect()
}

/// The pictures of a scene.
pub struct Pictures {
    /// In the order in which triangles asked for them.
    pub all: Vec<Picture>,
    /// Of each texture.
    of_texture: Vec<Vec<u32>>,
    bytes: usize,
}

impl Pictures {
    /// None yet, of so many textures.
    pub fn new(textures: usize) -> Self {
        Self { all: Vec::new(), of_texture: vec![Vec::new(); textures], bytes: 0 }
    }

    /// How `triangle` shows its texture; `None` where it has none, or more than one tint, or where there are too many pictures.
    pub fn skin(&mut self, triangle: &Triangle, textures: &[Arc<Texture>]) -> Option<Skin> {
        let index = triangle.texture? as usize;
        let texture = &textures[index];
        let strengths = triangle.radiance.map(Vec3::max_element);
        if triangle.radiance.iter().any(|radiance| radiance.min_element() < 0.0 || !radiance.is_finite()) {
            return None;
        }
        let strongest = (0..3).max_by(|a, b| strengths[*a].total_cmp(&strengths[*b]))?;
        let tint = triangle.radiance[strongest] / strengths[strongest];
        let is_alike = |tint: Vec3| {
            let differs = |corner: usize| (triangle.radiance[corner] - tint * strengths[corner]).abs().max_element();
            (0..3).all(|corner| differs(corner) <= ALIKE * strengths[strongest])
        };
        if !is_alike(tint) {
            return None;
        }
        let known = self.of_texture[index].iter().copied().find(|picture| is_alike(self.all[*picture as usize].tint));
        let picture = match known {
            Some(picture) => picture,
            None => self.add(index, texture, tint)?,
        };
        let (width, height) = texture.size();
        let along = |axis: usize, side: u32| {
            let places = triangle.uv.map(|uv| uv[axis]);
            // Whole periods less change nothing, even of what is mirrored. Pixels may lie a little beyond the corners.
            let lowest = places.into_iter().fold(f32::INFINITY, f32::min) - 2.0;
            let skipped = if texture.wrap()[axis] == Wrap::Clamp { 0.0 } else { 2.0 * (lowest / 2.0).floor() };
            places.map(|place| (place - skipped) * side as f32)
        };
        let gains = strengths.map(|strength| strength * (WHITE / FULL));
        Some(Skin { picture, places: [along(0, width), along(1, height)], gains })
    }

    fn add(&mut self, index: usize, texture: &Texture, tint: Vec3) -> Option<u32> {
        let (width, height) = texture.size();
        let bytes = size_of::<u16>() * (width as usize + 2) * (height as usize + 2);
        if self.of_texture[index].len() >= TINTS_MAX || self.bytes + bytes > BYTES_MAX {
            return None;
        }
        let picture = self.all.len() as u32;
        self.all.push(Picture::new(texture, tint));
        self.of_texture[index].push(picture);
        self.bytes += bytes;
        Some(picture)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;
    use proptest::prelude::*;

    const WRAPS: [Wrap; 3] = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];

    proptest! {
        #[test]
        fn pictures_are_their_textures(
            (sides, texels) in (1usize..9, 1usize..9).prop_flat_map(|(width, height)| {
                (Just([width, height]), prop::collection::vec(any::<[u8; 4]>(), width * height))
            }),
            wrap in [prop::sample::select(&WRAPS[..]), prop::sample::select(&WRAPS[..])],
            uv in [[-9.0f32..9.0, -9.0f32..9.0], [-9.0f32..9.0, -9.0f32..9.0], [-9.0f32..9.0, -9.0f32..9.0]],
            tint in [0.1f32..1.0, 0.1f32..1.0, 0.1f32..1.0],
        ) {
            let textures = [Arc::new(Texture::new(sides[0] as u32, sides[1] as u32, texels, wrap))];
            let radiance = [0.3, 1.0, 0.6].map(|strength| strength * Vec3::from(tint));
            let triangle = Triangle { corners: [0; 3], radiance, uv: uv.map(Vec2::from), texture: Some(0) };
            let mut pictures = Pictures::new(1);
            let skin = pictures.skin(&triangle, &textures).expect("one tint");
            for corner in 0..3 {
                let place = skin.places.map(|places| places[corner]);
                let luminance_here = pictures.all[0].sample(place) * skin.gains[corner] / WHITE;
                let right = luminance(radiance[corner] * textures[0].sample(triangle.uv[corner]));
                prop_assert!((luminance_here - right).abs() < 1.0 / 1024.0, "{luminance_here} {right}");
            }
        }
    }

    #[test]
    fn only_what_has_one_tint_has_a_picture() {
        let textures = [Arc::new(Texture::new(1, 1, vec![[255; 4]], [Wrap::Repeat; 2]))];
        let triangle = |radiance| Triangle { corners: [0; 3], radiance, uv: [Vec2::ZERO; 3], texture: Some(0) };
        let mut pictures = Pictures::new(1);
        let mut has = |radiance| pictures.skin(&triangle(radiance), &textures).is_some();
        assert!(has([Vec3::ONE, 0.5 * Vec3::ONE, Vec3::ZERO]));
        assert!(!has([Vec3::ONE, Vec3::X, Vec3::ONE]), "two tints");
        assert!(!has([-Vec3::ONE; 3]) && !has([Vec3::ZERO; 3]), "nothing to divide by");
        assert!(has([Vec3::X; 3]) && has([Vec3::Y; 3]) && has([Vec3::Z; 3]));
        assert!(!has([Vec3::new(1.0, 0.5, 0.0); 3]), "the fifth");
        assert!(has([0.1 * Vec3::Y; 3]), "one of the four");
        assert_eq!(pictures.all.len(), TINTS_MAX);
    }
}
