//! Which way round a front runs in the image.

use glam::DVec3;
use protocol::rig::Rig;
use shaders::project::methods::SliceProjector;
use shaders::project::{Model, SliceOptics, Viewer};

/// The sign of the area, with y downward, that a small triangle has in the image whose corners run counter-clockwise for those who see
/// it; 0 if it is not the same all over the panel.
pub fn front(rig: &Rig, face: usize, theta: f64, projector: &SliceProjector<f32>) -> i32 {
    let keys = &rig.mirror.face[face];
    let frame = keys.frame(theta);
    let optics = SliceOptics::new(rig, face, theta, Model::Planar);
    let size_m = keys.width_m.min(keys.slope_span_m[1] - keys.slope_span_m[0]);
    let sign = |[across, up]: [f64; 2]| {
        let slope = keys.slope_span_m[0] + up * (keys.slope_span_m[1] - keys.slope_span_m[0]);
        let place = keys.offset_m * frame.normal + across * keys.width_m * frame.across + slope * frame.slope;
        let toward = match optics.sight_of(place)?.viewer {
            Viewer::At(viewer) => (viewer - place).normalize(),
            Viewer::Toward(direction) => direction,
        };
        let right = toward.any_orthonormal_vector();
        let arm_m = 0.02 * size_m;
        let corner =
            |aside: DVec3| Some(projector.vertex((place + arm_m * aside).as_vec3().to_array())?.pixel.map(f64::from));
        let ([ax, ay], [bx, by], [cx, cy]) = (corner(DVec3::ZERO)?, corner(right)?, corner(toward.cross(right))?);
        Some(((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)).signum() as i32)
    };
    let middle = sign([0.0, 0.5]).unwrap_or(0);
    let corners = [[-0.45, 0.05], [0.45, 0.05], [-0.45, 0.95], [0.45, 0.95]];
    if corners.into_iter().all(|corner| sign(corner) == Some(middle)) { middle } else { 0 }
}
