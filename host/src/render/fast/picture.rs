//! Textures as luminances, for triangles that show them in one tint.

use crate::render::mesh::Triangle;
use crate::scene::{Texture, Wrap, linear_from_srgb, luminance};
use glam::Vec3;
use raster::{FULL, Picture, Skin, WHITE};
use std::sync::Arc;

/// All pictures of a scene together may take this many bytes; triangles that would need more are shaded by the texture itself.
const BYTES_MAX: usize = 128 << 20;
/// Tints of a texture that differ by less are one: a quarter of a level of 8 bits.
const ALIKE: f32 = 1e-3;
/// More tints of a texture are as many as a mesh with coloured vertices has.
const TINTS_MAX: usize = 4;
/// `texture` in one tint.
fn picture(texture: &Texture, tint: Vec3) -> Picture {
    let (width, height) = texture.size();
    let mut texels = vec![0; width as usize * height as usize];
    // What each value of each channel adds.
    let light = Vec3::AXES.map(|axis| {
        let white = luminance(tint * axis) * FULL;
        core::array::from_fn::<_, 256, _>(|value| white * linear_from_srgb(value as f32 / 255.0))
    });
    for (texel, [r, g, b, _]) in texels.iter_mut().zip(texture.texels_srgb8()) {
        *texel = (light[0][usize::from(*r)] + light[1][usize::from(*g)] + light[2][usize::from(*b)] + 0.5) as u16;
    }
    Picture::new(width, texture.wrap(), &texels)
}

/// The pictures of a scene.
pub struct Pictures {
    /// In the order in which triangles asked for them.
    pub all: Vec<Picture>,
    /// Of each texture, with their tints.
    of_texture: Vec<Vec<(u32, Vec3)>>,
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
        let known = self.of_texture[index].iter().find(|(_, tint)| is_alike(*tint)).map(|(picture, _)| *picture);
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
        self.all.push(self::picture(texture, tint));
        self.of_texture[index].push((picture, tint));
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
            let texture = Texture::new(sides[0] as u32, sides[1] as u32, texels, wrap);
            for [luminance_here, right] in luminances(texture, uv.map(Vec2::from), tint.into()) {
                prop_assert!((luminance_here - right).abs() < 1.0 / 1024.0, "{luminance_here} {right}");
            }
        }
    }

    /// At each corner of a triangle: by a picture, and by its texture.
    fn luminances(texture: Texture, uv: [Vec2; 3], tint: Vec3) -> [[f32; 2]; 3] {
        let textures = [Arc::new(texture)];
        let radiance = [0.3, 1.0, 0.6].map(|strength| strength * tint);
        let triangle = Triangle { corners: [0; 3], radiance, uv, texture: Some(0) };
        let mut pictures = Pictures::new(1);
        let skin = pictures.skin(&triangle, &textures).expect("one tint");
        core::array::from_fn(|corner| {
            let place = skin.places.map(|places| [places[corner]]);
            let [sample] = pictures.all[0].samples(place.each_ref(), 0..1);
            let right = luminance(radiance[corner] * textures[0].sample(uv[corner]));
            [sample * skin.gains[corner] / WHITE, right]
        })
    }

    #[test]
    fn where_a_picture_repeats_it_is_its_texture_too() {
        let texels: Vec<_> = (0..12u8).map(|at| [21 * at, 255 - 9 * at, 40 * (at % 5), 0]).collect();
        for (wrap, u, v) in
            WRAPS.iter().flat_map(|wrap| (-6..=6).flat_map(move |u| (-6..=6).map(move |v| (*wrap, u, v))))
        {
            let uv = Vec2::new(u as f32, v as f32) / 2.0;
            for [here, right] in luminances(Texture::new(4, 3, texels.clone(), [wrap; 2]), [uv; 3], Vec3::ONE) {
                assert!((here - right).abs() < 1.0 / 1024.0, "{wrap:?} {uv}: {here} {right}");
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
