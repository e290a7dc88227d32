//! The patent's own test: slices all black and all white in turn, and how many slices make up one view against its distance.

use core::f64::consts::TAU;
use glam::DVec3;
use host::picture::Picture;
use host::render::turn::{Depth, Turn};
use host::seen::{Brightness, View, reaching_slices, see};
use protocol::rig::Rig;
use tests::rig;

/// A window as wide as the mirror, seen level with it from `distance` metres.
fn level_view(distance: f64) -> View {
    View { from: DVec3::new(0.0, 0.0, distance), look_at: DVec3::ZERO, window_m: 0.14, pixels: 256, rays: 1 }
}

/// A turn of slices that are all white where `is_white` says so.
fn turn(rig: &Rig, is_white: impl Fn(u32) -> bool) -> Turn {
    let mut turn =
        Turn::dark(rig.rotation.slices, rig.projector.width_px, rig.projector.height_px, Depth::Grey).unwrap();
    let bytes = turn.slice_bytes();
    for (slice, pixels) in (0..).zip(turn.bytes_mut().chunks_mut(bytes)) {
        pixels.fill(if is_white(slice) { 255 } else { 0 });
    }
    turn
}

fn seen(rig: &Rig, turn: &Turn, view: &View) -> Picture {
    see(rig, turn, view, 4, Brightness::Divided, &|| ())
}

/// How many slices reach an eye level with the mirror, at `distance` metres.
///
/// The mirror turned by a shows a level eye the place x across it where the ray from P', `throw` metres behind, leaves toward the
/// eye: a = x / throw + x / distance for small angles. So a mirror `width` wide is filled by `width` (1 / throw + 1 / distance) in
/// angle, and the diffuser's lobe adds its half base on both sides.
fn expected_slices(rig: &Rig, distance: f64) -> f64 {
    let face = &rig.mirror.face[0];
    let (throw, step) = (0.6, TAU / f64::from(rig.rotation.slices));
    let lobe = face.diffuser_hat_radius_deg.unwrap().to_radians();
    (face.width_m * (1.0 / throw + 1.0 / distance) + 2.0 * lobe) / step
}

#[test]
fn the_nearer_the_eye_the_more_slices_make_up_its_view() {
    let rig = rig("reference");
    let mut last = usize::MAX;
    for distance in [0.3, 0.5, 0.9, 1.5, 3.0, 10.0, 100.0, 1e4] {
        let (reaching, expected) = (reaching_slices(&rig, &level_view(distance)), expected_slices(&rig, distance));
        println!("{distance:7} m: {reaching} slices reach the eye, {expected:.1} expected");
        assert!((reaching as f64 - expected).abs() < 1.6, "{reaching} {expected}");
        // The patent: falling to a minimum of about ten, never one.
        assert!(reaching <= last && reaching >= 10, "{reaching} after {last}");
        last = reaching;
    }
    assert!(last <= 14, "{last}");
}

#[test]
fn black_and_white_slices_in_turn_are_stripes() {
    let rig = rig("reference");
    let [black, white, both] = [turn(&rig, |_| false), turn(&rig, |_| true), turn(&rig, |slice| slice % 2 == 0)];
    for distance in [0.5, 0.9, 3.0, 100.0] {
        let view = level_view(distance);
        let [black, white, stripes] = [&black, &white, &both].map(|turn| seen(&rig, turn, &view));
        assert!(black.luminance().iter().zip(&black.known).all(|(value, known)| !known || *value == 0.0));
        assert!(white.luminance().iter().zip(&white.known).all(|(value, known)| !known || *value > 0.999));
        let row = 128 * 256..129 * 256;
        let values = stripes.luminance();
        let reached: Vec<f32> = values[row.clone()]
            .iter()
            .zip(&stripes.known[row])
            .filter(|(_, known)| **known)
            .map(|(value, _)| *value)
            .collect();
        let changes = reached.windows(2).filter(|pair| (pair[0] > 0.5) != (pair[1] > 0.5)).count();
        // Each slice whose lobe's middle lies on the mirror makes a stripe; lobes that overlap from beyond its edges make none.
        let lobes = 2.0;
        let expected = expected_slices(&rig, distance) - lobes;
        println!("{distance:5} m: {} stripes, {expected:.1} expected", changes + 1);
        assert!(((changes + 1) as f64 - expected).abs() < 1.6, "{changes} {expected}");
        let (low, high) =
            reached.iter().fold((1.0f32, 0.0f32), |(low, high), value| (low.min(*value), high.max(*value)));
        // The lobes of neighbours cross at half height: a stripe's middle is nearly its own slice's.
        assert!(low < 0.3 && high > 0.7, "{low} to {high}");
        // Stripes are upright: the same all the way down.
        let column = |x: usize| (64..192).map(|y| values[y * 256 + x]).collect::<Vec<_>>();
        for x in (16..240).step_by(16) {
            let column = column(x);
            let spread = column.iter().fold(0.0f32, |spread, value| spread.max((value - column[64]).abs()));
            assert!(spread < 0.35, "{spread} at {x}");
        }
    }
}
