//! A mesh laid out for many vertices and triangles at once.

use super::picture::{Picture, Skin};
use glam::DVec3;

/// Triangles that are worked on together.
pub const LANES: usize = 16;
/// Vertices that are: a processor finds other lanes' work while some wait for roots and quotients. With AVX-512 16 took a third longer
/// on the cone.
pub const VERTEX_LANES: usize = 32;
/// Luminance 1 in the fixed point of luminances and thresholds.
pub const WHITE: f32 = 32_768.0;
/// Above a threshold that is never below any other, and far enough below the end that a rounded gradient does not wrap.
pub const SMOOTH_MAX: f32 = 32_760.0;

/// What leaves a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ink {
    /// The same everywhere, in parts of [`WHITE`].
    Flat(i16),
    /// By its corners, in parts of [`WHITE`].
    Smooth([f32; 3]),
    /// By one of the figure's skins.
    Textured(u32),
    /// By a texture in many tints, or beyond black and white: asked of [`crate::Scene::shade`] for every pixel.
    Shaded,
}

/// A luminance as a number that is above the same thresholds: these are whole, so that it may be rounded up.
pub fn level(luminance: f32) -> i16 {
    (luminance * WHITE).ceil().clamp(0.0, WHITE - 1.0) as i16
}

/// What leaves the triangles of a figure.
#[derive(Default)]
pub struct Inks {
    /// Of each triangle.
    pub each: Vec<Ink>,
    /// How triangles with a texture show it.
    pub skins: Vec<Skin>,
    /// What they show.
    pub pictures: Vec<Picture>,
}

/// A mesh in lanes.
pub struct Figure {
    /// How many vertices there are.
    vertices: usize,
    /// x, y and z of the vertices in world metres, padded to whole [`VERTEX_LANES`] with the origin.
    pub(crate) positions: [Vec<[f32; VERTEX_LANES]>; 3],
    /// First, second and third corners of the triangles, padded with triangles that are points. All below [`Figure::vertices`].
    corners: [Vec<[u32; LANES]>; 3],
    /// What leaves each triangle.
    pub(crate) inks: Vec<Ink>,
    /// How triangles with a texture show it.
    pub(crate) skins: Vec<Skin>,
    /// What they show.
    pub(crate) pictures: Vec<Picture>,
    /// Bit by bit, which triangles of each group of [`LANES`] belong to solids, of which only the front is seen.
    solid: Vec<u32>,
    /// The same, which triangles have a flat ink.
    flat: Vec<u32>,
    /// Luminances of flat inks.
    pub(crate) luminances: Vec<i16>,
    /// The distance of the farthest corner of a triangle from the origin in metres: no depth that is drawn is beyond it.
    pub radius_m: f32,
}

impl Figure {
    /// Vertices at `positions`, in world metres, and the triangles between them: `corners` are indices of positions, and triangles that
    /// belong to solids, of which only the front is seen, are `solid`.
    ///
    /// # Panics
    /// Where a corner is no position, or not every triangle has its ink.
    pub fn new(
        positions: &[DVec3],
        corners: impl Iterator<Item = [u32; 3]> + Clone,
        solid: &[bool],
        Inks { each: inks, skins, pictures }: Inks,
    ) -> Self {
        let axis = |axis: usize| lanes(positions.iter().map(|position| position[axis] as f32));
        let corner = |corner: usize| lanes(corners.clone().map(|corners| corners[corner]));
        let vertices = positions.len();
        assert!(vertices <= i32::MAX as usize && corners.clone().flatten().all(|corner| (corner as usize) < vertices));
        assert!(inks.len() == solid.len() && inks.len() == corners.clone().count());
        let flat: Vec<_> = inks.iter().map(|ink| matches!(ink, Ink::Flat(_))).collect();
        let luminance = |ink: &Ink| if let Ink::Flat(luminance) = ink { *luminance } else { 0 };
        let bits = |group: &[bool]| (0..).zip(group).map(|(lane, solid)| u32::from(*solid) << lane).sum();
        let places = corners.clone().flatten().map(|corner| positions[corner as usize]);
        let radius_m = places.map(|place| place.length_squared()).fold(0.0, f64::max).sqrt() as f32;
        Self {
            vertices,
            positions: [0, 1, 2].map(axis),
            corners: [0, 1, 2].map(corner),
            solid: solid.chunks(LANES).map(bits).collect(),
            flat: flat.chunks(LANES).map(bits).collect(),
            luminances: inks.iter().map(luminance).collect(),
            inks,
            skins,
            pictures,
            // Where there is nothing, or nothing but the origin, any scale of depths will do.
            radius_m: if radius_m > 0.0 { radius_m } else { 1.0 },
        }
    }

    /// How many vertices there are.
    pub fn vertices(&self) -> usize {
        self.vertices
    }

    /// The corners of triangle `index`.
    pub(crate) fn triangle(&self, index: usize) -> [u32; 3] {
        [0, 1, 2].map(|corner| self.corners[corner][index / LANES][index % LANES])
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
