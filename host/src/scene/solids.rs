//! Closed solids, and scenes made of them.

use std::f32::consts::TAU;

use glam::{Affine3A, Mat3, Vec2, Vec3};

use super::assembly::{Assembly, Part};
use super::{Material, Scene};

/// Joins closed solids. Each has its vertices to itself, outward counter-clockwise triangles and one material.
#[derive(Default)]
pub(super) struct Sculptor(Assembly);

impl Sculptor {
    pub(super) fn lit(&mut self, name: &str, rgb: [f32; 3]) -> u32 {
        self.0.add_material(Material { name: name.into(), base_colour: rgb.into(), ..Material::default() })
    }

    pub(super) fn unlit(&mut self, name: &str, rgb: [f32; 3]) -> u32 {
        self.0.add_material(Material { name: name.into(), base_colour: rgb.into(), unlit: true, ..Material::default() })
    }

    pub(super) fn finish(self, name: &str) -> Scene {
        let mut scene = self.0.finish().expect("the built-in scenes are sound, as their tests show");
        scene.name = name.into();
        scene
    }

    pub(super) fn add(&mut self, material: u32, solid: Solid, world_from_solid: Affine3A) {
        let positions = solid.positions.iter().map(|&p| world_from_solid.transform_point3(p)).collect();
        let part = Part { positions, triangles: solid.triangles, materials: vec![material], ..Part::default() };
        self.0.add("built-in", part).expect("the built-in scenes are sound, as their tests show");
    }

    pub(super) fn add_box(&mut self, material: u32, low: Vec3, high: Vec3) {
        let scale = Affine3A::from_scale(high - low);
        self.add(material, unit_box(), Affine3A::from_translation((low + high) / 2.0) * scale);
    }
}

/// A closed surface in its own space, metres.
#[derive(Default)]
pub(super) struct Solid {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Solid {
    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.triangles.extend([[a, b, c], [a, c, d]]);
    }
}

/// A cube of side 1 about the origin.
pub(super) fn unit_box() -> Solid {
    let mut solid = extrude(&[(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(Vec2::from), 1.0);
    // Without a vertex in the middle of its faces: two triangles each.
    solid.positions.truncate(8);
    solid.triangles.retain(|corners| corners.iter().all(|&c| c < 8));
    solid.quad([4, 5, 6, 7]);
    solid.quad([3, 2, 1, 0]);
    solid
}

/// A star-shaped counter-clockwise outline in xy, seen from the mean of its corners, from -depth/2 to +depth/2 along z.
pub(super) fn extrude(outline: &[Vec2], depth: f32) -> Solid {
    let n = outline.len() as u32;
    let middle = outline.iter().sum::<Vec2>() / n as f32;
    let mut solid = Solid::default();
    for z in [-depth / 2.0, depth / 2.0] {
        solid.positions.extend(outline.iter().map(|p| p.extend(z)));
    }
    solid.positions.extend([middle.extend(-depth / 2.0), middle.extend(depth / 2.0)]);
    for i in 0..n {
        let j = (i + 1) % n;
        solid.quad([i, j, n + j, n + i]);
        solid.triangles.extend([[2 * n, j, i], [2 * n + 1, n + i, n + j]]);
    }
    solid
}

/// A profile of (radius, height) turned about y, from the axis outward, up, and back to the axis: the first and the
/// last radius are zero.
pub(super) fn lathe(profile: &[(f32, f32)], segments: u32) -> Solid {
    let mut solid = Solid::default();
    let (first, last) = (profile[0].1, profile[profile.len() - 1].1);
    solid.positions.extend([Vec3::Y * first, Vec3::Y * last]);
    let rings = &profile[1..profile.len() - 1];
    for &(radius, height) in rings {
        solid.positions.extend((0..segments).map(|i| {
            let (s, c) = (TAU * i as f32 / segments as f32).sin_cos();
            Vec3::new(radius * s, height, radius * c)
        }));
    }
    let at = |ring: usize, i: u32| 2 + ring as u32 * segments + i % segments;
    for i in 0..segments {
        solid.triangles.push([0, at(0, i + 1), at(0, i)]);
        for ring in 1..rings.len() {
            solid.quad([at(ring - 1, i), at(ring - 1, i + 1), at(ring, i + 1), at(ring, i)]);
        }
        solid.triangles.push([1, at(rings.len() - 1, i), at(rings.len() - 1, i + 1)]);
    }
    solid
}

pub(super) fn ball(radius_m: f32, segments: u32, rings: u32) -> Solid {
    let profile: Vec<(f32, f32)> = (0..=rings)
        .map(|i| {
            let (s, c) = (TAU / 2.0 * i as f32 / rings as f32).sin_cos();
            (radius_m * s, -radius_m * c)
        })
        .collect();
    lathe(&profile, segments)
}

/// A tube about a closed curve over 0 to 1.
pub(super) fn tube(curve: impl Fn(f32) -> Vec3, radius_m: f32, steps: u32, segments: u32) -> Solid {
    let mut solid = Solid::default();
    for i in 0..steps {
        let t = i as f32 / steps as f32;
        let tangent = (curve(t + 1e-3) - curve(t - 1e-3)).normalize();
        // The curve winds about z, which is never along it: a frame without a seam.
        let across = tangent.cross(Vec3::Z).normalize();
        let ring = Mat3::from_cols(across, tangent.cross(across), tangent);
        solid.positions.extend((0..segments).map(|j| {
            let (s, c) = (TAU * j as f32 / segments as f32).sin_cos();
            curve(t) + ring * (radius_m * Vec3::new(c, s, 0.0))
        }));
    }
    let at = |i: u32, j: u32| (i % steps) * segments + j % segments;
    for i in 0..steps {
        for j in 0..segments {
            solid.quad([at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
        }
    }
    solid
}

/// The outline of a cogwheel, metres.
pub(super) fn cog(teeth: u32, inner_m: f32, outer_m: f32) -> Vec<Vec2> {
    let corners = [(0.0, inner_m), (0.3, inner_m), (0.4, outer_m), (0.9, outer_m)];
    (0..teeth)
        .flat_map(|i| corners.map(|(part, radius)| radius * Vec2::from_angle((i as f32 + part) * TAU / teeth as f32)))
        .collect()
}
