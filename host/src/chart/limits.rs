//! Where methods fail: one property of a rig at a time driven to its limits and past them.

use glam::{DVec2, DVec3};
use protocol::rig::Rig;
use rayon::prelude::*;
use serde::Serialize;
use shaders::project::methods::{FaceOptics, Method, Real};
use shaders::project::{Model, SliceOptics, Visibility};

/// The largest errors at one value of one property, over visible points of the display volume, in projector pixels.
#[derive(Clone, Debug, Serialize)]
pub struct Limit {
    /// The property.
    pub property: &'static str,
    /// Its value, in words.
    pub value: String,
    /// Planar fan against the cone's root.
    pub planar_px: f64,
    /// Newton's steps against the cone's root, in single precision.
    pub newton_px: f64,
    /// The table against the cone's root, in single precision.
    pub table_px: f64,
    /// Single against double precision, the worst of all methods.
    pub single_px: f64,
    /// Share of the points that some pixel shows.
    pub visible: f64,
}

/// Points a slice, and slices.
const POINTS: usize = 160;
const SLICES: usize = 12;

/// Drives the viewers' distance and height, the mirror's tilt and the projector's place from those of `rig` to their limits; points lie
/// within `radius_m` of the origin. Values with which the rig is impossible are left out.
pub fn limits(rig: &Rig, radius_m: f64) -> Vec<Limit> {
    let mut rigs: Vec<(&'static str, String, Rig)> = Vec::new();
    let mut add = |property, value: String, change: &dyn Fn(&mut Rig)| {
        let mut changed = rig.clone();
        change(&mut changed);
        rigs.extend(changed.checked().ok().map(|changed| (property, value, changed)));
    };
    let (distance, height) = (rig.viewing.distance_m.unwrap_or(1.0), rig.viewing.height_m.unwrap_or(0.35));
    for value in [0.15, 0.3, 0.9, 3.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6] {
        add("viewers' distance, at one elevation", format!("{value} m"), &|rig| {
            rig.viewing.distance_m = Some(value);
            rig.viewing.height_m = Some(height * value / distance);
            rig.viewing.elevation_deg = None;
        });
    }
    add("viewers' distance, at one elevation", "infinite".into(), &|rig| {
        rig.viewing.distance_m = None;
        rig.viewing.height_m = None;
        rig.viewing.elevation_deg = Some(height.atan2(distance).to_degrees());
    });
    for value in [-0.2, 0.0, 0.1, 0.2, 0.35, 0.5, 0.75, 0.9, 1.5, 3.0] {
        add("viewers' height", format!("{value} m"), &|rig| {
            rig.viewing.distance_m = Some(distance);
            rig.viewing.height_m = Some(value);
            rig.viewing.elevation_deg = None;
        });
    }
    for value in [20.0, 30.0, 40.0, 45.0, 50.0, 60.0, 70.0] {
        add("mirror's tilt", format!("{value} deg"), &|rig| {
            rig.mirror.face.iter_mut().for_each(|face| face.tilt_deg = value);
        });
    }
    if let Some(position) = rig.projector.position_m {
        for value in [0.0, 0.01, 0.03, 0.1, 0.2] {
            add("projector off the axis", format!("{value} m"), &|rig| {
                rig.projector.position_m = Some([position[0] + value, position[1], position[2]]);
            });
        }
    }
    rigs.par_iter().map(|(property, value, rig)| measure(property, value.clone(), rig, radius_m)).collect()
}

fn measure(property: &'static str, value: String, rig: &Rig, radius_m: f64) -> Limit {
    let mut limit =
        Limit { property, value, planar_px: 0.0, newton_px: 0.0, table_px: 0.0, single_px: 0.0, visible: 0.0 };
    let slices: Vec<f64> =
        (0..SLICES).map(|index| rig.slice_angle((index as u32 * rig.rotation.slices) / SLICES as u32)).collect();
    let mut shown = 0;
    for face in 0..rig.mirror.face.len() {
        let single = [Method::Planar, Method::ConeNewton, Method::ConeTable, Method::ConeRoot]
            .map(|method| (FaceOptics::<f32>::new(rig, face, method), FaceOptics::<f64>::new(rig, face, method)));
        for (step, theta) in slices.iter().enumerate() {
            let cone = SliceOptics::new(rig, face, *theta, Model::Cone);
            let methods = single.each_ref().map(|(single, double)| (single.slice(*theta), double.slice(*theta)));
            for index in 0..POINTS {
                // Points that single precision holds exactly: the precision of the arithmetic is asked for, not the scene's.
                let point = point(step * POINTS + index, radius_m).as_vec3();
                let truly = cone.project(point.into());
                let (Some(pixel), Visibility::Visible) = (truly.pixel, truly.visibility) else { continue };
                shown += 1;
                let off = |drawn: Option<DVec2>| drawn.map_or(f64::INFINITY, |drawn| drawn.distance(pixel));
                let drawn = methods.each_ref().map(|(single, double)| {
                    let single = single.vertex(point.to_array()).map(|vertex| pixel_of(vertex.pixel));
                    let double = double.vertex(point.as_dvec3().to_array()).map(|vertex| pixel_of(vertex.pixel));
                    (single, double)
                });
                limit.planar_px = limit.planar_px.max(off(drawn[0].0));
                limit.newton_px = limit.newton_px.max(off(drawn[1].0));
                limit.table_px = limit.table_px.max(off(drawn[2].0));
                for pair in drawn {
                    if let (Some(single), Some(double)) = pair {
                        limit.single_px = limit.single_px.max(single.distance(double));
                    }
                }
            }
        }
    }
    limit.visible = f64::from(shown) / (POINTS * SLICES * rig.mirror.face.len()) as f64;
    limit
}

fn pixel_of<F: Real>(pixel: [F; 2]) -> DVec2 {
    DVec2::from_array(pixel.map(F::wide))
}

/// Point `index` of a scatter that fills the ball of `radius_m` evenly.
fn point(index: usize, radius_m: f64) -> DVec3 {
    let scatter = |step: f64| ((index as f64 + 0.5) * step).fract();
    let height = 2.0 * scatter(0.819_172_513) - 1.0;
    let (sin, cos) = (core::f64::consts::TAU * scatter(0.671_043_607)).sin_cos();
    let level = (1.0 - height * height).sqrt();
    DVec3::new(level * sin, height, level * cos) * radius_m * scatter(0.549_700_478).cbrt()
}
