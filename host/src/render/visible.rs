//! Whether a rig can show anything of a scene.

use super::mesh::Mesh;
use super::plan::{Edges, Plan, Precision, Projection};
use super::tessellate::tessellate;
use crate::scene::ShadedScene;
use protocol::rig::{Rig, Viewers};
use shaders::project::methods::{FaceOptics, Method, Real, SliceProjector, Vertex};

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
            Viewers::Curve(curve) => {
                curve.spots().any(|spot| spot.distance_m * sin + spot.height_m * cos > face.offset_m)
            }
            Viewers::Infinity { elevation } => elevation.cos() * sin + elevation.sin() * cos > 0.0,
        }
    })
}

fn may_show(scene: &ShadedScene, rig: &Rig, projection: Projection) -> bool {
    let plan =
        Plan { projection, precision: Precision::Double, edges: Edges::Adaptive, bow_px: 0.5, ..Plan::default() };
    let Ok(mesh) = tessellate(scene, rig, &plan) else { return true };
    (0..rig.mirror.face.len()).any(|face| {
        let optics = FaceOptics::<f64>::new(rig, face, Method::from(projection));
        (0..rig.rotation.slices).any(|slice| may_slice_show(&mesh, rig, &optics.slice(rig.slice_angle(slice))))
    })
}

/// Whether some triangle of `mesh`, drawn with straight edges, may reach the panel and the image in one face's slice.
pub(super) fn may_slice_show<F: Real>(mesh: &Mesh, rig: &Rig, projector: &SliceProjector<F>) -> bool {
    let size = [rig.projector.width_px, rig.projector.height_px].map(f64::from);
    let in_image = |corners: &[Vertex<F>; 3]| {
        (0..2).all(|axis| {
            corners.iter().any(|corner| corner.pixel[axis].wide() > -MARGIN_PX)
                && corners.iter().any(|corner| corner.pixel[axis].wide() < size[axis] + MARGIN_PX)
        })
    };
    let vertices: Vec<_> =
        mesh.positions.iter().map(|position| projector.vertex(position.to_array().map(F::of))).collect();
    mesh.triangles.iter().any(|triangle| {
        let [Some(a), Some(b), Some(c)] = triangle.corners.map(|corner| vertices[corner as usize]) else {
            return false;
        };
        a.sides & b.sides & c.sides == 0 && in_image(&[a, b, c])
    })
}
