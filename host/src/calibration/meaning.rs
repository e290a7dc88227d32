//! What uncertain parameters mean for the picture.

use super::Calibration;
use super::fit::Fit;
use core::f64::consts::TAU;
use glam::DVec3;
use protocol::rig::Rig;
use shaders::project::{Model as Diffuser, SliceOptics, Visibility};

/// Standard deviations over the points of a ball, for clicks with one of one pixel along u and along v.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meaning {
    /// Of a point's place in the projector's image: RMS, pixels.
    pub picture_px: f64,
    /// Of the azimuth of whom it is shown to: RMS, slices.
    pub viewer_slices: f64,
}

/// Slices at which points are asked for, evenly over a turn.
const SLICES: u32 = 12;

/// For points of a ball of `radius_m` metres about the origin: the middle of it, and six of its shell.
pub fn meaning(calibration: &Calibration, radius_m: f64) -> Option<Meaning> {
    let (rig, fit) = (&calibration.rig, &calibration.fit);
    let shell = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis * radius_m, axis * -radius_m]);
    let points: Vec<_> = core::iter::once(DVec3::ZERO).chain(shell).collect();
    let angles = (0..SLICES).map(|step| rig.slice_angle(step * rig.rotation.slices / SLICES));
    let each = angles.flat_map(|angle| {
        let points = &points;
        (0..rig.mirror.face.len()).flat_map(move |face| points.iter().map(move |point| (face, angle, *point)))
    });
    let spreads: Vec<_> = each.filter_map(|(face, angle, point)| spread(rig, fit, face, angle, point)).collect();
    let mean = |of: fn(&[f64; 2]) -> f64| (spreads.iter().map(of).sum::<f64>() / spreads.len() as f64).sqrt();
    let slices = f64::from(rig.rotation.slices) / TAU;
    (!spreads.is_empty()).then(|| Meaning {
        picture_px: mean(|[pixel, _]| *pixel),
        viewer_slices: slices * mean(|[_, azimuth]| *azimuth),
    })
}

/// Variances of a point's pixel and of its viewer's azimuth, radians; `None` where it is not seen.
fn spread(rig: &Rig, fit: &Fit, face: usize, angle: f64, point: DVec3) -> Option<[f64; 2]> {
    let seen = |rig: &Rig| SliceOptics::new(rig, face, angle, Diffuser::Cone).project(point);
    let start = seen(rig);
    if start.visibility != Visibility::Visible {
        return None;
    }
    let azimuth = start.viewer?.vector();
    let [u, v, turn] = fit.slopes_of(|model| {
        let projected = seen(&model.rig(rig).ok()?);
        let pixel = projected.pixel?;
        let viewer = projected.viewer?.vector();
        let turn = (viewer.x * azimuth.z - viewer.z * azimuth.x).atan2(viewer.x * azimuth.x + viewer.z * azimuth.z);
        Some([pixel.x, pixel.y, turn])
    })?;
    Some([fit.variance_of(&u) + fit.variance_of(&v), fit.variance_of(&turn)])
}
