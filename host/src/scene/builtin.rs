//! The scene that needs no file: a knot on a drum in an open frame, among small solids that are different on each side.

use std::f32::consts::TAU;

use glam::{Affine3A, Mat3, Quat, Vec2, Vec3};

use super::assembly::{Assembly, Part};
use super::{Material, Scene};

/// Half of the frame's outer side, metres. Its corners are 58.9 mm from the origin.
const FRAME_M: f32 = 0.034;
/// Thickness of the frame's bars, metres.
const BAR_M: f32 = 0.003;
/// Top of the floor, metres.
const FLOOR_M: f32 = -0.0305;

pub(super) fn build() -> Scene {
    let mut sculptor = Sculptor::default();
    sculptor.frame();
    sculptor.floor_and_drum();
    sculptor.knot();
    sculptor.corners();
    sculptor.mast();
    let mut scene = sculptor.0.finish().expect("the built-in scene is sound, as its tests show");
    scene.name = super::BUILTIN.into();
    scene
}

/// Joins closed solids. Each has its vertices to itself, outward counter-clockwise triangles and one material.
#[derive(Default)]
struct Sculptor(Assembly);

impl Sculptor {
    fn lit(&mut self, name: &str, rgb: [f32; 3]) -> u32 {
        self.0.add_material(Material { name: name.into(), base_colour: rgb.into(), ..Material::default() })
    }

    fn unlit(&mut self, name: &str, rgb: [f32; 3]) -> u32 {
        self.0.add_material(Material { name: name.into(), base_colour: rgb.into(), unlit: true, ..Material::default() })
    }

    fn add(&mut self, material: u32, solid: Solid, world_from_solid: Affine3A) {
        let positions = solid.positions.iter().map(|&p| world_from_solid.transform_point3(p)).collect();
        let part = Part { positions, triangles: solid.triangles, materials: vec![material], ..Part::default() };
        self.0.add("builtin", part).expect("the built-in scene is sound, as its tests show");
    }

    fn add_box(&mut self, material: u32, low: Vec3, high: Vec3) {
        let scale = Affine3A::from_scale(high - low);
        self.add(material, unit_box(), Affine3A::from_translation((low + high) / 2.0) * scale);
    }

    /// Twelve bars; they glow a little, so that the frame can be read from the side away from the lamp.
    fn frame(&mut self) {
        let upright = self.unlit("upright", [0.85, 0.85, 0.8]);
        let across = self.unlit("across", [0.6, 0.62, 0.62]);
        let (outer, inner) = (FRAME_M, FRAME_M - BAR_M);
        for (a, b) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let (a0, a1) = if a < 0.0 { (-outer, -inner) } else { (inner, outer) };
            let (b0, b1) = if b < 0.0 { (-outer, -inner) } else { (inner, outer) };
            self.add_box(upright, Vec3::new(a0, -inner, b0), Vec3::new(a1, inner, b1));
            self.add_box(across, Vec3::new(-outer, a0, b0), Vec3::new(outer, a1, b1));
            self.add_box(across, Vec3::new(a0, b0, -inner), Vec3::new(a1, b1, inner));
        }
    }

    /// A plate, and a drum of twelve mirrors like a praxinoscope's, dark and bright in turn.
    fn floor_and_drum(&mut self) {
        let floor = self.lit("floor", [0.38, 0.42, 0.5]);
        let inner = FRAME_M - BAR_M;
        self.add_box(floor, Vec3::new(-inner, -FRAME_M + 0.001, -inner), Vec3::new(inner, FLOOR_M, inner));
        let rim = self.lit("rim", [0.95, 0.9, 0.8]);
        let bright = self.unlit("mirror", [0.8, 0.86, 0.9]);
        let dark = self.lit("pane", [0.3, 0.34, 0.4]);
        let upright = |y| Affine3A::from_translation(Vec3::new(0.0, y, 0.0));
        self.add(rim, lathe(&[(0.0, 0.0), (0.0135, 0.0), (0.0135, 0.002), (0.0, 0.002)], 12), upright(FLOOR_M));
        let wedge = |i: f32| {
            let at = |i: f32| 0.012 * Vec2::from_angle(i * TAU / 12.0);
            extrude(&[Vec2::ZERO, at(i), at(i + 1.0)], 0.012)
        };
        // Extruded along z; the drum stands.
        let standing = upright(FLOOR_M + 0.008) * Affine3A::from_quat(Quat::from_rotation_x(-TAU / 4.0));
        for i in 0..12 {
            self.add(if i % 2 == 0 { bright } else { dark }, wedge(i as f32), standing);
        }
        self.add(rim, lathe(&[(0.0, 0.0), (0.0135, 0.0), (0.005, 0.005), (0.0, 0.005)], 48), upright(FLOOR_M + 0.014));
    }

    /// A trefoil knot, turned so that it is open to the front and narrow from the sides.
    fn knot(&mut self) {
        let gold = self.lit("gold", [1.0, 0.85, 0.5]);
        let curve = |t: f32| {
            let (s, c) = (TAU * t).sin_cos();
            let (s2, c2) = (2.0 * TAU * t).sin_cos();
            let s3 = (3.0 * TAU * t).sin();
            0.0068 * Vec3::new(s + 2.0 * s2, c - 2.0 * c2, -1.1 * s3)
        };
        let turned = Quat::from_rotation_y(0.35) * Quat::from_rotation_x(-0.25) * Quat::from_rotation_z(TAU / 2.0);
        let place = Affine3A::from_rotation_translation(turned, Vec3::new(0.0, 0.0085, 0.0));
        self.add(gold, tube(curve, 0.0042, 192, 20), place);
    }

    /// Ball, cone, cube and cog: one on each corner of the floor.
    fn corners(&mut self) {
        let red = self.lit("ball", [1.0, 0.62, 0.55]);
        let green = self.lit("cone", [0.6, 0.95, 0.55]);
        let blue = self.lit("cube", [0.62, 0.78, 1.0]);
        let white = self.lit("cog", [0.95, 0.95, 0.95]);
        let at = |x: f32, y: f32, z: f32| Affine3A::from_translation(Vec3::new(x, FLOOR_M + y, z));
        self.add(red, ball(0.0085, 40, 20), at(0.0215, 0.0085, 0.0215));
        self.add(green, lathe(&[(0.0, 0.0), (0.0085, 0.0), (0.0, 0.024)], 48), at(-0.0215, 0.0, 0.0215));
        let cube = Affine3A::from_rotation_y(0.5) * Affine3A::from_scale(Vec3::splat(0.0135));
        self.add(blue, unit_box(), at(-0.02, 0.00675, -0.02) * cube);
        self.add(
            white,
            extrude(&cog(9, 0.0075, 0.0105), 0.005),
            at(0.02, 0.0105, -0.021) * Affine3A::from_rotation_y(-0.6),
        );
    }

    /// A thin mast with a pennant that points to +x, on the right side.
    fn mast(&mut self) {
        let pole = self.unlit("pole", [0.9, 0.9, 0.9]);
        let pennant = self.unlit("pennant", [1.0, 0.8, 0.3]);
        let height = FRAME_M - BAR_M - FLOOR_M;
        let place = Affine3A::from_translation(Vec3::new(0.008, FLOOR_M, 0.0265));
        self.add(pole, lathe(&[(0.0, 0.0), (0.0009, 0.0), (0.0009, height), (0.0, height)], 12), place);
        let flag = extrude(&[Vec2::new(0.0, -0.006), Vec2::new(0.017, 0.0), Vec2::new(0.0, 0.006)], 0.0016);
        self.add(pennant, flag, Affine3A::from_translation(Vec3::new(0.0088, 0.0225, 0.0265)));
    }
}

/// A closed surface in its own space, metres.
#[derive(Default)]
struct Solid {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Solid {
    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.triangles.extend([[a, b, c], [a, c, d]]);
    }
}

/// A cube of side 1 about the origin.
fn unit_box() -> Solid {
    let mut solid = extrude(&[(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(Vec2::from), 1.0);
    // Without a vertex in the middle of its faces: two triangles each.
    solid.positions.truncate(8);
    solid.triangles.retain(|corners| corners.iter().all(|&c| c < 8));
    solid.quad([4, 5, 6, 7]);
    solid.quad([3, 2, 1, 0]);
    solid
}

/// A star-shaped counter-clockwise outline in xy, seen from the mean of its corners, from -depth/2 to +depth/2 along z.
fn extrude(outline: &[Vec2], depth: f32) -> Solid {
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
fn lathe(profile: &[(f32, f32)], segments: u32) -> Solid {
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

fn ball(radius_m: f32, segments: u32, rings: u32) -> Solid {
    let profile: Vec<(f32, f32)> = (0..=rings)
        .map(|i| {
            let (s, c) = (TAU / 2.0 * i as f32 / rings as f32).sin_cos();
            (radius_m * s, -radius_m * c)
        })
        .collect();
    lathe(&profile, segments)
}

/// A tube about a closed curve over 0 to 1.
fn tube(curve: impl Fn(f32) -> Vec3, radius_m: f32, steps: u32, segments: u32) -> Solid {
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
fn cog(teeth: u32, inner_m: f32, outer_m: f32) -> Vec<Vec2> {
    let corners = [(0.0, inner_m), (0.3, inner_m), (0.4, outer_m), (0.9, outer_m)];
    (0..teeth)
        .flat_map(|i| corners.map(|(part, radius)| radius * Vec2::from_angle((i as f32 + part) * TAU / teeth as f32)))
        .collect()
}
