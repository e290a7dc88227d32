//! How far an eye blurs a slice, for the halftones that shape their error to it.

use glam::{DMat2, DVec2, DVec3};
use protocol::rig::Rig;
use shaders::halftone::Blur;
use shaders::project::{Model, SliceOptics, Viewer};

/// The σ of an eye's blur, in radians: 1.4 arc minutes, between the 1 of good sight and the 2 of poor.
const ACUITY: f64 = 1.4 / 60.0 * core::f64::consts::PI / 180.0;
/// From how far, in metres, viewers at infinity are taken to look.
const ARM_LENGTH_M: f64 = 1.0;

/// The blur of slice `slice` for the viewer who sees the panel's middle; the mean over the faces that have one.
pub fn eye_blur(rig: &Rig, slice: u32) -> Blur {
    let theta = rig.slice_angle(slice);
    let blurs: Vec<DMat2> = (0..rig.mirror.face.len()).filter_map(|face| face_blur(rig, face, theta)).collect();
    if blurs.is_empty() {
        return Blur::ROUND;
    }
    let mean = blurs.iter().fold(DMat2::ZERO, |sum, blur| sum + *blur) / blurs.len() as f64;
    Blur([mean.x_axis.x, mean.x_axis.y, mean.y_axis.y].map(|covariance| covariance as f32))
}

/// The covariance in px² of an isotropic blur at right angles to the sight line, as the mirror lays it on the projector's image.
fn face_blur(rig: &Rig, face: usize, theta: f64) -> Option<DMat2> {
    let keys = &rig.mirror.face[face];
    let frame = keys.frame(theta);
    let middle = keys.offset_m * frame.normal + keys.slope_span_m.iter().sum::<f64>() / 2.0 * frame.slope;
    let viewer = SliceOptics::new(rig, face, theta, Model::Planar).sight_of(middle)?.viewer;
    let (toward, distance_m) = match viewer {
        Viewer::At(position) => (position - middle, position.distance(middle)),
        Viewer::Toward(direction) => (direction, ARM_LENGTH_M),
    };
    let camera = rig.camera();
    let pixel = camera.project(middle)?;
    let sigma_m = ACUITY * distance_m;
    let toward = toward.normalize();
    let shifted = |aside: DVec3| -> Option<DVec2> {
        let hit = middle + sigma_m * (aside - toward * (frame.normal.dot(aside) / frame.normal.dot(toward)));
        Some(camera.project(hit)? - pixel)
    };
    let right = toward.any_orthonormal_vector();
    let jacobian = DMat2::from_cols(shifted(right)?, shifted(toward.cross(right))?);
    Some(jacobian * jacobian.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rigs;

    #[test]
    fn the_blur_turns_with_the_mirror() {
        let rig = rigs::find("reference").unwrap();
        // Slice 0 faces the front within half a slice: across is u, the slope v, which is seen and projected at a slant.
        let [uu, uv, vv] = eye_blur(&rig, 0).0;
        let sigma_px = 1.4 / 3437.75 * 0.9657 * 3072.0 / 0.6;
        assert!((uu.sqrt() - sigma_px).abs() < 0.01 && uv.abs() < 0.02, "{uu} {uv} {vv}");
        assert!((vv.sqrt() / uu.sqrt() - 0.773).abs() < 0.01, "{uu} {vv}");
        let [uu_aside, _, vv_aside] = eye_blur(&rig, 72).0;
        assert!((uu_aside - vv).abs() < 0.01 && (vv_aside - uu).abs() < 0.01);
        assert!(eye_blur(&rig, 36).0[1].abs() > 0.1);
    }

    #[test]
    fn every_rig_has_one() {
        let tent = rigs::find("tent").unwrap();
        let mut far = rigs::find("reference").unwrap();
        far.viewing =
            protocol::rig::Viewing { distance_m: None, height_m: None, elevation_deg: Some(20.0), tracked: vec![] };
        for rig in [tent, far] {
            let [uu, uv, vv] = eye_blur(&rig, 20).0;
            assert!(uu > 0.5 && vv > 0.5 && uu * vv > uv * uv && uu + vv < 20.0, "{uu} {uv} {vv}");
        }
    }
}
