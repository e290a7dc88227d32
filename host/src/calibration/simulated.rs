//! Clicks as somebody with a steady or an unsteady hand would make them on a rig that is known.

use super::model::in_world;
use super::{Click, OnFace, Place};
use glam::DVec2;
use protocol::rig::Rig;
use rand::Rng;
use rand_distr::{Distribution, Normal};

/// The patent's sheet on face `face` of `rig`: four corners and the middle, with the face looking toward 0° and 180°.
pub fn sheet(rig: &Rig, face: usize) -> Vec<Place> {
    at_stops(rig, face, &[[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [0.0, 0.0]])
}

/// Its corners alone: in space the corners of a box, of a cube where the face leans by 45°.
pub fn eight(rig: &Rig, face: usize) -> Vec<Place> {
    at_stops(rig, face, &[[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
}

/// As large as leaves a tenth of the panel around it, is a square seen from above, and is lit wherever it lies.
fn at_stops(rig: &Rig, index: usize, corners: &[[f64; 2]]) -> Vec<Place> {
    let face = &rig.mirror.face[index];
    let [low, high] = face.slope_span_m;
    let middle = if low < 0.0 && high > 0.0 { 0.0 } else { (low + high) / 2.0 };
    let plan = face.tilt_deg.to_radians().cos();
    let largest = 0.9 * (middle - low).min(high - middle).min(face.width_m / 2.0 / plan);
    let sheet = |half_m: f64| -> Vec<Place> {
        let at = |stop_deg: f64, [a, b]: [f64; 2]| {
            // Tenths of a millimetre, as on a ruler.
            let at_m = (DVec2::new(a * half_m * plan, middle + b * half_m) * 1e4).round() / 1e4;
            Place::Face(OnFace { face: index, at_m, stop_deg, encoder_deg: None })
        };
        [0.0, 180.0].into_iter().flat_map(|stop| corners.iter().map(move |corner| at(stop, *corner))).collect()
    };
    let sizes = (0..20).map(|step| sheet(largest * 0.9f64.powi(step)));
    sizes.into_iter().find(|places| clicked(rig, places).len() == places.len()).unwrap_or_else(|| sheet(largest))
}

/// `places` clicked on `rig` without an error; those that its projector does not see are left out.
pub fn clicked(rig: &Rig, places: &[Place]) -> Vec<Click> {
    let camera = rig.camera();
    let size = DVec2::new(rig.projector.width_px.into(), rig.projector.height_px.into());
    let click = |(index, place): (usize, &Place)| {
        let pixel = camera.project(in_world(&rig.mirror.face, *place))?;
        let is_seen = pixel.cmpge(DVec2::ZERO).all() && pixel.cmple(size).all();
        is_seen.then(|| Click { label: format!("point {}", index + 1), place: *place, pixel })
    };
    places.iter().enumerate().filter_map(click).collect()
}

/// `clicks` by a hand with a standard deviation of `sigma_px` along u and along v.
pub fn shaken(clicks: &[Click], sigma_px: f64, rng: &mut impl Rng) -> Vec<Click> {
    let normal = Normal::new(0.0, sigma_px).expect("a standard deviation is finite and not below 0");
    let mut moved = clicks.to_vec();
    for click in &mut moved {
        click.pixel += DVec2::new(normal.sample(rng), normal.sample(rng));
    }
    moved
}
