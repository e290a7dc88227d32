//! What a turn costs: a sum over what a renderer does, each with a price.

use super::{DepthTest, Edges, Plan, Precision, Projection};
use crate::render::mesh::Mesh;
use glam::DVec2;
use protocol::rig::Rig;
use rayon::prelude::*;
use serde::Serialize;
use shaders::project::methods::{FaceOptics, Method};

/// What there is to do for one turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Work {
    /// Vertices projected.
    pub vertices: f64,
    /// Triangles set up.
    pub triangles: f64,
    /// Triangles of the mesh.
    pub triangles_a_slice: usize,
    /// Pixels in the boxes around triangles, each tested against three edges.
    pub tested_px: f64,
    /// Pixels of triangles, also those that others hide.
    pub filled_px: f64,
    /// Pixels of the panels.
    pub panel_px: f64,
    /// Pixels of the images.
    pub image_px: f64,
}

impl Work {
    /// What `mesh` on `rig` needs, from a sample of slices.
    pub fn of(mesh: &Mesh, rig: &Rig) -> Self {
        const SAMPLE: u32 = 6;
        let slices = rig.rotation.slices;
        let faces: Vec<FaceOptics<f32>> =
            (0..rig.mirror.face.len()).map(|face| FaceOptics::new(rig, face, Method::Planar)).collect();
        let sampled: Vec<(f64, f64)> = (0..SAMPLE)
            .into_par_iter()
            .flat_map_iter(|index| {
                let theta = rig.slice_angle(index * slices / SAMPLE);
                faces.iter().map(move |face| sampled(mesh, rig, face, theta))
            })
            .collect();
        let a_slice = f64::from(slices) / f64::from(SAMPLE);
        let passes = f64::from(slices) * faces.len() as f64;
        let image = f64::from(rig.projector.width_px) * f64::from(rig.projector.height_px);
        Self {
            vertices: passes * mesh.positions.len() as f64,
            triangles: passes * mesh.triangles.len() as f64,
            triangles_a_slice: mesh.triangles.len(),
            tested_px: a_slice * sampled.iter().map(|(tested, _)| tested).sum::<f64>(),
            filled_px: a_slice * sampled.iter().map(|(_, filled)| filled).sum::<f64>(),
            panel_px: f64::from(slices) * panel_px(rig).min(image),
            image_px: f64::from(slices) * image,
        }
    }
}

/// Pixels in the boxes around the triangles of one slice, and in the triangles.
fn sampled(mesh: &Mesh, rig: &Rig, face: &FaceOptics<f32>, theta: f64) -> (f64, f64) {
    let projector = face.slice(theta);
    let size = DVec2::new(rig.projector.width_px.into(), rig.projector.height_px.into());
    let vertices: Vec<_> =
        mesh.positions.iter().map(|position| projector.vertex(position.as_vec3().to_array())).collect();
    let mut sum = (0.0, 0.0);
    for triangle in &mesh.triangles {
        let [Some(a), Some(b), Some(c)] = triangle.corners.map(|corner| vertices[corner as usize]) else { continue };
        if a.sides & b.sides & c.sides != 0 {
            continue;
        }
        let [a, b, c] = [a, b, c].map(|vertex| DVec2::new(vertex.pixel[0].into(), vertex.pixel[1].into()));
        let low = a.min(b).min(c).clamp(DVec2::ZERO, size);
        let high = a.max(b).max(c).clamp(DVec2::ZERO, size);
        let tested = (high.x - low.x) * (high.y - low.y);
        sum.0 += tested + (high.x - low.x) + (high.y - low.y);
        sum.1 += ((b - a).perp_dot(c - a).abs() / 2.0).min(tested);
    }
    sum
}

/// Pixels of all panels in one slice, where the projector meets them squarely: an estimate.
fn panel_px(rig: &Rig) -> f64 {
    let camera = rig.camera();
    let area = |face: usize| {
        let keys = &rig.mirror.face[face];
        let frame = keys.frame(rig.slice_angle(0));
        let corner = |across: f64, slope: f64| {
            camera.project(keys.offset_m * frame.normal + across * keys.width_m * frame.across + slope * frame.slope)
        };
        let [low, high] = keys.slope_span_m;
        let corners = [corner(-0.5, low), corner(0.5, low), corner(0.5, high), corner(-0.5, high)];
        let [Some(a), Some(b), Some(c), Some(d)] = corners else { return 0.0 };
        (c - a).perp_dot(d - b).abs() / 2.0
    };
    (0..rig.mirror.face.len()).map(area).sum()
}

/// Nanoseconds of one core for a turn by `plan` on the CPU, by a mask or without a halftone.
///
/// The prices are least-squares fits on one machine: of what fixed point draws, to six scenes by two models (`praxi bench --json` has
/// `work` and `cores_ms`; within 0.8 to 1.2 of them), of the rest to the times of 480 turns. A chart's `predicted_ratio` beside its
/// `ratio` shows how well they hold. Other machines differ by a factor that [`crate::render::plan::speed`] measures where milliseconds
/// are asked for.
pub fn turn_ns(plan: &Plan, work: &Work) -> f64 {
    let prices = Prices::of(plan);
    prices.vertex * work.vertices
        + prices.triangle * work.triangles
        + prices.tested * work.tested_px
        + prices.filled * work.filled_px
        + prices.panel * work.panel_px
        + prices.image * work.image_px
}

/// Nanoseconds for a vertex.
pub fn vertex_ns(plan: &Plan) -> f64 {
    Prices::of(&Plan { edges: Edges::Straight, ..*plan }).vertex
}

/// Nanoseconds each.
struct Prices {
    vertex: f64,
    triangle: f64,
    tested: f64,
    filled: f64,
    panel: f64,
    image: f64,
}

impl Prices {
    fn of(plan: &Plan) -> Self {
        if plan.is_for_fixed_point() {
            // By the table vertices in lanes go Newton's way, and promise no more than the table does.
            let vertex = match plan.projection {
                Projection::Planar => 2.0,
                Projection::ConeNewton => 6.3,
                Projection::ConeTable => 6.4,
                Projection::ConeRoot => 7.3,
            };
            return Self { vertex, triangle: 8.0, tested: 0.041, filled: 0.0, panel: 0.0, image: 0.13 };
        }
        let vertex = match (plan.projection, plan.precision) {
            (Projection::Planar, Precision::Single) => 30.0,
            (Projection::Planar, Precision::Double) => 31.0,
            (Projection::ConeTable, Precision::Single) => 48.0,
            (Projection::ConeTable, Precision::Double) => 49.0,
            (Projection::ConeNewton, Precision::Single) => 72.0,
            (Projection::ConeNewton, Precision::Double) => 76.0,
            (Projection::ConeRoot, Precision::Single) => 88.0,
            (Projection::ConeRoot, Precision::Double) => 113.0,
        };
        let base = Self { vertex, triangle: 175.0, tested: 1.4, filled: 5.6, panel: 0.0, image: 3.1 };
        match (plan.edges, plan.depth) {
            (Edges::Straight | Edges::Uniform | Edges::Adaptive, DepthTest::Linear) => base,
            (Edges::Straight | Edges::Uniform | Edges::Adaptive, DepthTest::Exact) => Self { filled: 46.0, ..base },
            (Edges::Discard, _) => Self { triangle: 310.0, tested: 8.9, filled: 52.0, image: 32.0, ..base },
            (Edges::Rays, _) => {
                Self { vertex: 0.0, triangle: 0.0, tested: 0.0, filled: 0.0, panel: 100.0, image: 130.0 }
            }
        }
    }
}
