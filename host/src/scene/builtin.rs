//! The scenes that need no file.

use std::f32::consts::TAU;

use glam::{Affine3A, EulerRot, Quat, Vec2, Vec3};

use super::Scene;
use super::solids::{Sculptor, ball, cog, extrude, lathe, tube, unit_box};

/// The ball that holds the scenes, metres: the reference rig's display volume is 60 to 70 mm.
const BALL_M: f32 = 0.06;
/// Half of the frame's outer side, metres. Its corners are 58.9 mm from the origin.
const FRAME_M: f32 = 0.034;
/// Thickness of the frame's bars, metres.
const BAR_M: f32 = 0.003;
/// Top of the floor, metres.
const FLOOR_M: f32 = -0.0305;

/// A knot on a drum in an open frame, among small solids that are different on each side.
pub(super) fn praxinoscope() -> Scene {
    let mut sculptor = Sculptor::default();
    sculptor.frame();
    sculptor.floor_and_drum();
    sculptor.knot();
    sculptor.corners();
    sculptor.mast();
    sculptor.finish("builtin")
}

/// Boxes with edges of up to 100 mm, two triangles a face, in scattered poses: nothing but long edges in all directions.
pub(super) fn boxes() -> Scene {
    let mut sculptor = Sculptor::default();
    for index in 0..8u8 {
        let scatter = |step: f32| (f32::from(index) * step + 0.3).fract();
        let size = Vec3::new(
            0.1 - 0.005 * f32::from(index),
            0.01 + 0.03 * scatter(0.754_878),
            0.006 + 0.02 * scatter(0.569_84),
        );
        let pose = Quat::from_euler(
            EulerRot::YXZ,
            TAU * scatter(0.618_034),
            TAU * scatter(0.819_173),
            TAU * scatter(0.671_044),
        );
        let (sin, cos) = (TAU * scatter(0.549_7)).sin_cos();
        let room = BALL_M - size.length() / 2.0;
        let middle = room * Vec3::new(sin, 2.0 * scatter(0.32) - 1.0, cos).normalize();
        let grey = sculptor.lit(&format!("box {index}"), [0.3 + 0.1 * f32::from(index); 3]);
        let place = Affine3A::from_rotation_translation(pose, middle) * Affine3A::from_scale(size);
        sculptor.add(grey, unit_box(), place);
    }
    sculptor.finish("boxes")
}

/// A trefoil knot of two triangles for each part `along` and `around` it.
pub(super) fn knot(name: &str, [along, around]: [u32; 2]) -> Scene {
    let mut sculptor = Sculptor::default();
    let gold = sculptor.lit("gold", [1.0, 0.85, 0.5]);
    let turned = Quat::from_rotation_y(0.35) * Quat::from_rotation_x(-0.25);
    sculptor.add(gold, tube(trefoil(0.0165), 0.01, along, around), Affine3A::from_quat(turned));
    sculptor.finish(name)
}

/// A trefoil about z over 0 to 1; its loops reach three times `size_m` out.
fn trefoil(size_m: f32) -> impl Fn(f32) -> Vec3 {
    move |t| {
        let (s, c) = (TAU * t).sin_cos();
        let (s2, c2) = (2.0 * TAU * t).sin_cos();
        let s3 = (3.0 * TAU * t).sin();
        size_m * Vec3::new(s + 2.0 * s2, c - 2.0 * c2, -1.1 * s3)
    }
}

impl Sculptor {
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
        let turned = Quat::from_rotation_y(0.35) * Quat::from_rotation_x(-0.25) * Quat::from_rotation_z(TAU / 2.0);
        let place = Affine3A::from_rotation_translation(turned, Vec3::new(0.0, 0.0085, 0.0));
        self.add(gold, tube(trefoil(0.0068), 0.0042, 192, 20), place);
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
