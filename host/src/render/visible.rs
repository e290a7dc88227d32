//! Whether a rig can show anything of a scene.

use super::plan::{Edges, Plan, Precision, Projection};
use super::tessellate::tessellate;
use crate::scene::ShadedScene;
use protocol::rig::{Rig, Viewers};
use shaders::project::methods::{FaceOptics, Method, Vertex};

/// Pieces that lie farther than this outside the image are not in it: they bow by less.
const MARGIN_PX: f64 = 2.0;

/// Whether some slice may show something of `scene` by some plan. True in doubt; where it is false, every slice is dark.
pub fn anything_visible(scene: &ShadedScene, rig: &Rig) -> bool {
    is_any_viewer_lit(rig)
        && [Projection::Planar, Projection::ConeRoot].into_iter().any(|projection| may_show(scene, rig, projection))
}

/// Whether the normal of some face reaches out to some viewer.
fn is_any_viewer_lit(rig: &Rig) -> bool {
    rig.mirror.face.iter().any(|face| {
        let (sin, cos) = face.tilt_deg.to_radians().sin_cos();
        match rig.viewers() {
            Viewers::Circle { distance_m, height_m } => distance_m * sin + height_m * cos > face.offset_m,
            Viewers::Infinity { elevation } => elevation.cos() * sin + elevation.sin() * cos > 0.0,
        }
    })
}

fn may_show(scene: &ShadedScene, rig: &Rig, projection: Projection) -> bool {
    let plan =
        Plan { projection, precision: Precision::Double, edges: Edges::Adaptive, bow_px: 0.5, ..Plan::default() };
    let Ok(mesh) = tessellate(scene, rig, &plan) else { return true };
    let size = [rig.projector.width_px, rig.projector.height_px].map(f64::from);
    let in_image = |corners: &[Vertex<f64>; 3]| {
        (0..2).all(|axis| {
            corners.iter().any(|corner| corner.pixel[axis] > -MARGIN_PX)
                && corners.iter().any(|corner| corner.pixel[axis] < size[axis] + MARGIN_PX)
        })
    };
    (0..rig.mirror.face.len()).any(|face| {
        let optics = FaceOptics::<f64>::new(rig, face, Method::from(projection));
        (0..rig.rotation.slices).any(|slice| {
            let projector = optics.slice(rig.slice_angle(slice));
            let vertices: Vec<_> =
                mesh.positions.iter().map(|position| projector.vertex(position.to_array())).collect();
            mesh.triangles.iter().any(|triangle| {
                let [Some(a), Some(b), Some(c)] = triangle.corners.map(|corner| vertices[corner as usize]) else {
                    return false;
                };
                a.sides & b.sides & c.sides == 0 && in_image(&[a, b, c])
            })
        })
    })
}
