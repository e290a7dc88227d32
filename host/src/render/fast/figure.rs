//! A mesh laid out for many vertices and triangles at once.

use super::super::mesh::{Mesh, Triangle};
use super::picture::{Picture, Pictures, Skin};
use super::solids::solids;
use crate::scene::{Texture, luminance};
use std::sync::Arc;

/// Triangles that are worked on together.
pub const LANES: usize = 16;
/// Vertices that are: a processor finds other lanes' work while some wait for roots and quotients. With AVX-512 16 took a third longer
/// on the cone.
pub const VERTEX_LANES: usize = 32;
/// Luminance 1 in the fixed point of luminances and thresholds.
pub const WHITE: f32 = 32_768.0;
/// Above a threshold that is never below any other, and far enough below the end that a rounded gradient does not wrap.
const SMOOTH_MAX: f32 = 32_760.0;

/// What leaves a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ink {
    /// The same everywhere, in parts of [`WHITE`].
    Flat(i16),
    /// By its corners, in parts of [`WHITE`].
    Smooth([f32; 3]),
    /// By one of [`Figure::skins`].
    Textured(u32),
    /// By a texture in many tints, or beyond black and white: computed for every pixel as the clear renderer does.
    Shaded,
}

impl Ink {
    fn new(triangle: &Triangle, skins: &mut Skins<'_>) -> Self {
        if let Some(skin) = skins.pictures.skin(triangle, skins.textures) {
            skins.all.push(skin);
            return Self::Textured(skins.all.len() as u32 - 1);
        }
        let corners = triangle.radiance.map(luminance);
        if triangle.texture.is_some() || corners.iter().any(|value| !(0.0..=1.0).contains(value)) {
            return Self::Shaded;
        }
        if corners == [corners[0]; 3] {
            return Self::Flat(level(corners[0]));
        }
        Self::Smooth(corners.map(|value| (value * WHITE).min(SMOOTH_MAX)))
    }
}

/// A luminance as a number that is above the same thresholds: these are whole, so that it may be rounded up.
pub fn level(luminance: f32) -> i16 {
    (luminance * WHITE).ceil().clamp(0.0, WHITE - 1.0) as i16
}

/// What is found of textures on the way through a mesh.
struct Skins<'a> {
    textures: &'a [Arc<Texture>],
    pictures: Pictures,
    all: Vec<Skin>,
}

/// A mesh in lanes.
pub struct Figure {
    /// As it came.
    pub mesh: Mesh,
    /// x, y and z of the vertices in world metres, padded to whole [`VERTEX_LANES`] with the origin.
    pub positions: [Vec<[f32; VERTEX_LANES]>; 3],
    /// First, second and third corners of the triangles, padded with triangles that are points. All below [`Figure::vertices`].
    corners: [Vec<[u32; LANES]>; 3],
    /// What leaves each triangle.
    pub inks: Vec<Ink>,
    /// How triangles with a texture show it.
    pub skins: Vec<Skin>,
    /// What they show.
    pub pictures: Vec<Picture>,
    /// Bit by bit, which triangles of each group of [`LANES`] belong to solids, of which only the front is seen.
    solid: Vec<u32>,
    /// The same, which triangles have a flat ink.
    flat: Vec<u32>,
    /// Luminances of flat inks.
    pub luminances: Vec<i16>,
    /// The distance of the farthest corner of a triangle from the origin in metres: no depth that is drawn is beyond it.
    pub radius_m: f32,
}

impl Figure {
    /// `mesh` in lanes, with the scene's textures.
    pub fn new(mesh: Mesh, textures: &[Arc<Texture>]) -> Self {
        let axis = |axis: usize| {
            let values = mesh.positions.iter().map(|position| position[axis] as f32);
            lanes(values)
        };
        let corner = |corner: usize| lanes(mesh.triangles.iter().map(|triangle| triangle.corners[corner]));
        let vertices = mesh.positions.len() as u32;
        assert!(mesh.triangles.iter().all(|triangle| triangle.corners.iter().all(|corner| *corner < vertices)));
        let solid = solids(&mesh);
        let mut skins = Skins { textures, pictures: Pictures::new(textures.len()), all: Vec::new() };
        let inks: Vec<_> = mesh.triangles.iter().map(|triangle| Ink::new(triangle, &mut skins)).collect();
        let flat: Vec<_> = inks.iter().map(|ink| matches!(ink, Ink::Flat(_))).collect();
        let luminance = |ink: &Ink| if let Ink::Flat(luminance) = ink { *luminance } else { 0 };
        let bits = |group: &[bool]| (0..).zip(group).map(|(lane, solid)| u32::from(*solid) << lane).sum();
        let radius_m = mesh.radius_m() as f32;
        Self {
            positions: [0, 1, 2].map(axis),
            corners: [0, 1, 2].map(corner),
            solid: solid.chunks(LANES).map(bits).collect(),
            flat: flat.chunks(LANES).map(bits).collect(),
            luminances: inks.iter().map(luminance).collect(),
            inks,
            skins: skins.all,
            pictures: skins.pictures.all,
            // Where there is nothing, or nothing but the origin, any scale of depths will do.
            radius_m: if radius_m > 0.0 { radius_m } else { 1.0 },
            mesh,
        }
    }

    /// How many vertices there are.
    pub fn vertices(&self) -> usize {
        self.mesh.positions.len()
    }

    /// How many groups of `N` triangles there are. `N` divides [`LANES`].
    pub fn groups<const N: usize>(&self) -> usize {
        self.solid.len() * (LANES / N)
    }

    /// Bit by bit, which triangles of a group of `N` belong to solids, of which only the front is seen. Bits beyond mean nothing.
    #[inline(always)]
    pub fn solids<const N: usize>(&self, group: usize) -> u32 {
        self.solid[group / (LANES / N)] >> (group % (LANES / N) * N)
    }

    /// The same, which have a flat ink.
    #[inline(always)]
    pub fn flats<const N: usize>(&self, group: usize) -> u32 {
        self.flat[group / (LANES / N)] >> (group % (LANES / N) * N)
    }

    /// The first, second or third corners of a group of `N` triangles; all below [`Figure::vertices`].
    #[inline(always)]
    pub fn corners<const N: usize>(&self, corner: usize, group: usize) -> &[u32; N] {
        &self.corners[corner].as_flattened().as_chunks().0[group]
    }
}

fn lanes<T: Copy + Default, const N: usize>(values: impl Iterator<Item = T>) -> Vec<[T; N]> {
    let mut groups = Vec::new();
    for (index, value) in values.enumerate() {
        if index % N == 0 {
            groups.push([T::default(); N]);
        }
        groups[index / N][index % N] = value;
    }
    groups
}
