//! What a pinhole sees of the scene itself: the truth that a perceived picture is compared with. Ray cast, apart from the
//! renderer and from the eye model.

use crate::picture::Picture;
use crate::scene::{ShadedScene, luminance};
use glam::{DVec3, Vec3};
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use obvhs::{BvhBuildParams, aabb::Aabb};
use rayon::prelude::*;
use std::time::Duration;

/// A pinhole that looks at a square window: at `look_at`, at right angles to the line of sight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// World metres.
    pub from: DVec3,
    /// The middle of the window; must differ from `from`.
    pub look_at: DVec3,
    /// The window's side in metres.
    pub window_m: f64,
    /// The picture's side in pixels.
    pub pixels: u32,
    /// Each pixel is the mean of `rays` × `rays` rays.
    pub rays: u32,
}

/// A scene that rays can be cast into.
pub struct Caster<'a> {
    scene: &'a ShadedScene,
    bvh: Option<Bvh2>,
    /// The distance from the origin within which the scene lies, in metres.
    radius_m: f64,
}

impl<'a> Caster<'a> {
    /// Builds the hierarchy.
    pub fn new(scene: &'a ShadedScene) -> Self {
        let bounds: Vec<Aabb> = scene
            .triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.positions.map(Vec3::into);
                Triangle { v0: a, v1: b, v2: c }.aabb()
            })
            .collect();
        let mut time = Duration::ZERO;
        let bvh = (!bounds.is_empty()).then(|| build_bvh2(&bounds, BvhBuildParams::medium_build(), &mut time));
        let corners = scene.triangles.iter().flat_map(|triangle| triangle.positions);
        let radius_m = corners.map(|position| position.as_dvec3().length()).fold(0.0, f64::max);
        Self { scene, bvh, radius_m }
    }

    /// The luminance of the first surface that a viewer `distance_m` metres from `through` (infinite for one at infinity) sees in its
    /// direction and beyond it; `toward_viewer` is the unit direction from `through` to the viewer.
    pub fn cast_along(&self, through: DVec3, toward_viewer: DVec3, distance_m: f64) -> f32 {
        // From just outside the scene: single precision has the most digits there, however far the viewer is.
        let start = distance_m.min(1.01 * (through.length() + self.radius_m));
        self.cast((through + start * toward_viewer).as_vec3(), (-toward_viewer).as_vec3())
    }

    /// The luminance of the first surface on the ray; 0 where it meets none.
    pub fn cast(&self, from: Vec3, direction: Vec3) -> f32 {
        let Some(bvh) = &self.bvh else { return 0.0 };
        let mut first = RayHit::none();
        let ray = Ray::new_inf(from.into(), direction.into());
        let hit = bvh.ray_traverse(ray, &mut first, |_, place| {
            let triangle = bvh.primitive_indices[place] as usize;
            crossing(&self.scene.triangles[triangle].positions, from, direction)
                .map_or(f32::INFINITY, |(range, _)| range)
        });
        if !hit {
            return 0.0;
        }
        let triangle = &self.scene.triangles[bvh.primitive_indices[first.primitive_id as usize] as usize];
        let Some((_, weights)) = crossing(&triangle.positions, from, direction) else { return 0.0 };
        let radiance: Vec3 = (0..3).map(|corner| weights[corner] * triangle.radiance[corner]).sum();
        luminance(match triangle.texture {
            None => radiance,
            Some(texture) => {
                let uv = (0..3).map(|corner| weights[corner] * triangle.uv[corner]).sum();
                radiance * self.scene.textures[texture as usize].sample(uv)
            }
        })
    }

    /// What `pinhole` sees. `done` is called after each row.
    pub fn picture(&self, pinhole: &Pinhole, done: &(dyn Fn() + Sync)) -> Picture {
        let forward = (pinhole.look_at - pinhole.from).normalize();
        let right =
            forward.cross(DVec3::Y).try_normalize().filter(|_| forward.y.abs() < 1.0 - 1e-12).unwrap_or(DVec3::X);
        let down = forward.cross(right);
        let fine = pinhole.pixels * pinhole.rays;
        let metres = |ray: u32| ((f64::from(ray) + 0.5) / f64::from(fine) - 0.5) * pinhole.window_m;
        let pixel = |x: u32, y: u32| {
            let rays = (0..pinhole.rays * pinhole.rays).map(|ray| {
                let (column, row) = (x * pinhole.rays + ray % pinhole.rays, y * pinhole.rays + ray / pinhole.rays);
                let target = pinhole.look_at + right * metres(column) + down * metres(row);
                self.cast(pinhole.from.as_vec3(), (target - pinhole.from).normalize().as_vec3())
            });
            rays.sum::<f32>() / (pinhole.rays * pinhole.rays) as f32
        };
        let rows: Vec<_> = (0..pinhole.pixels)
            .into_par_iter()
            .map(|y| {
                let row: Vec<f32> = (0..pinhole.pixels).map(|x| pixel(x, y)).collect();
                done();
                row
            })
            .collect();
        Picture::grey(pinhole.pixels, pinhole.pixels, rows.concat())
    }
}

/// Where a ray meets a triangle, from either side (Möller and Trumbore 1997): the range in units of `direction`, and the
/// weights of the corners.
fn crossing(positions: &[Vec3; 3], from: Vec3, direction: Vec3) -> Option<(f32, [f32; 3])> {
    let [a, b, c] = *positions;
    let (ab, ac) = (b - a, c - a);
    let normal = direction.cross(ac);
    let determinant = ab.dot(normal);
    let to_ray = from - a;
    let v = to_ray.dot(normal) / determinant;
    let side = to_ray.cross(ab);
    let w = direction.dot(side) / determinant;
    let range = ac.dot(side) / determinant;
    (v >= 0.0 && w >= 0.0 && v + w <= 1.0 && range > 0.0).then_some((range, [1.0 - v - w, v, w]))
}
