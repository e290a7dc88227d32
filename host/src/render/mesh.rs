//! Triangles with shared vertices, and the cutting of them along their edges.

use crate::scene::{ShadedScene, ShadedTriangle};
use glam::{DVec3, Vec2, Vec3};
use std::collections::HashMap;

/// Triangles with shared vertices, so that each vertex is projected once a slice.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// World metres.
    pub positions: Vec<DVec3>,
    /// The triangles.
    pub triangles: Vec<Triangle>,
}

/// A triangle of a [`Mesh`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// Indices of positions.
    pub corners: [u32; 3],
    /// Linear RGB at each corner, without the texture.
    pub radiance: [Vec3; 3],
    /// Texture coordinates at each corner.
    pub uv: [Vec2; 3],
    /// Index into the scene's textures.
    pub texture: Option<u32>,
}

impl Mesh {
    /// The scene's triangles as they are.
    pub fn new(scene: &ShadedScene) -> Self {
        let mut mesh = Self { positions: Vec::new(), triangles: Vec::with_capacity(scene.triangles.len()) };
        let mut index = HashMap::new();
        for ShadedTriangle { positions, radiance, uv, texture } in &scene.triangles {
            let corners = positions.map(|position| {
                let key = position.to_array().map(|value| (value + 0.0).to_bits());
                *index.entry(key).or_insert_with(|| mesh.add(position.into()))
            });
            mesh.triangles.push(Triangle { corners, radiance: *radiance, uv: *uv, texture: *texture });
        }
        mesh
    }

    /// A new position's index.
    pub fn add(&mut self, position: DVec3) -> u32 {
        self.positions.push(position);
        self.positions.len() as u32 - 1
    }

    /// The corners of `triangle` in world metres.
    pub fn corners(&self, triangle: &Triangle) -> [DVec3; 3] {
        triangle.corners.map(|corner| self.positions[corner as usize])
    }
}

impl Triangle {
    /// The ends of edge `edge`, which runs from that corner to the next.
    pub fn edge(&self, edge: usize) -> [u32; 2] {
        [self.corners[edge], self.corners[(edge + 1) % 3]]
    }

    /// Its two parts where edge `edge` is cut at vertex `place`, a fraction `along` of the way.
    pub fn cut_edge(&self, edge: usize, place: u32, along: f32) -> [Self; 2] {
        let mut weights = [0.0; 3];
        (weights[edge], weights[(edge + 1) % 3]) = (1.0 - along, along);
        [(edge + 1) % 3, edge].map(|replaced| self.with_corner(replaced, place, weights))
    }

    /// Its three parts about vertex `place`, its centroid.
    pub fn cut_at_centroid(&self, place: u32) -> [Self; 3] {
        [0, 1, 2].map(|replaced| self.with_corner(replaced, place, [1.0 / 3.0; 3]))
    }

    /// Corner `replaced` moved to `place`, which has these weights of the corners.
    fn with_corner(&self, replaced: usize, place: u32, weights: [f32; 3]) -> Self {
        let mut part = *self;
        part.corners[replaced] = place;
        part.radiance[replaced] = (0..3).map(|corner| weights[corner] * self.radiance[corner]).sum();
        part.uv[replaced] = (0..3).map(|corner| weights[corner] * self.uv[corner]).sum();
        part
    }
}
