//! Triangles with shared vertices.

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

    /// The largest distance of a triangle's corner from the origin in metres; 0 without triangles.
    pub fn radius_m(&self) -> f64 {
        let corners = self.triangles.iter().flat_map(|triangle| self.corners(triangle));
        corners.map(|position| position.length_squared()).fold(0.0, f64::max).sqrt()
    }

    /// The corners of `triangle` in world metres.
    pub fn corners(&self, triangle: &Triangle) -> [DVec3; 3] {
        triangle.corners.map(|corner| self.positions[corner as usize])
    }
}
