use super::*;
use crate::project::Visibility;
use glam::{DVec2, DVec3};
use protocol::rig::TrackedViewer;

pub(super) const REFERENCE: &str = include_str!("../../../../host/rigs/reference.toml");
const RIGS: [&str; 4] = [
    REFERENCE,
    include_str!("../../../../host/rigs/reference-180hz.toml"),
    include_str!("../../../../host/rigs/high-viewer.toml"),
    include_str!("../../../../host/rigs/tent.toml"),
];

fn changed(changes: &[(&str, &str)]) -> Rig {
    let text = changes.iter().fold(REFERENCE.to_string(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    });
    Rig::parse(&text).unwrap()
}

/// The built-in rigs, and others that can be built.
pub(super) fn rigs() -> Vec<Rig> {
    let mut rigs: Vec<_> = RIGS.into_iter().map(|text| Rig::parse(text).unwrap()).collect();
    for height in ["0.0", "0.6", "1.0", "1.5"] {
        rigs.push(changed(&[("height_m = 0.35", &format!("height_m = {height}"))]));
    }
    for tilt in ["30.0", "38.0", "52.0", "60.0"] {
        rigs.push(changed(&[("tilt_deg = 45.0", &format!("tilt_deg = {tilt}"))]));
    }
    rigs.push(changed(&[("[0.0, 0.6, 0.0]", "[0.05, 0.5, 0.02]")]));
    rigs.push(changed(&[("[0.0, 0.6, 0.0]", "[-0.1, 0.7, 0.08]"), ("height_m = 0.35", "height_m = 0.7")]));
    rigs.push(changed(&[("distance_m = 0.9", "distance_m = 0.2"), ("height_m = 0.35", "height_m = 0.1")]));
    rigs.push(changed(&[("distance_m = 0.9", ""), ("height_m = 0.35", "elevation_deg = 30.0")]));
    rigs.push(changed(&[("distance_m = 0.9", "distance_m = 1e6"), ("height_m = 0.35", "height_m = 4e5")]));
    for viewers in TRACKED {
        rigs.push(with_viewers(Rig::parse(REFERENCE).unwrap(), viewers));
    }
    rigs.push(with_viewers(changed(&[("[0.0, 0.6, 0.0]", "[0.05, 0.5, 0.02]")]), TRACKED[1]));
    rigs.push(with_viewers(Rig::parse(RIGS[3]).unwrap(), TRACKED[0]));
    rigs.push(changed(&[("width_px", "radial = [0.4, -0.5]\nwidth_px"), ("offset_m = 0.0 ", "offset_m = 0.004 ")]));
    rigs
}

/// Viewers by azimuth in degrees, distance and height in metres: higher ones, nearer and farther ones, and a crowd all around.
const TRACKED: [&[[f64; 3]]; 3] = [
    &[[10.0, 0.9, 0.6], [30.0, 0.9, 0.1], [120.0, 0.9, 0.75]],
    &[[0.0, 1.3, 0.5], [25.0, 0.8, 0.3], [65.0, 1.8, 0.9], [200.0, 0.6, 0.35]],
    &[
        [0.0, 0.9, 0.5],
        [9.0, 0.9, 0.4],
        [18.0, 1.0, 0.5],
        [40.0, 1.1, 0.45],
        [62.0, 1.0, 0.3],
        [90.0, 1.2, 0.6],
        [150.0, 0.8, 0.5],
        [170.0, 1.0, 0.5],
        [230.0, 1.1, 0.7],
        [250.0, 0.9, 0.3],
    ],
];

pub(in crate::project) fn with_viewers(mut rig: Rig, viewers: &[[f64; 3]]) -> Rig {
    let viewer = |[azimuth_deg, distance_m, height_m]: &[f64; 3]| TrackedViewer {
        azimuth_deg: *azimuth_deg,
        distance_m: *distance_m,
        height_m: *height_m,
    };
    rig.viewing.tracked = viewers.iter().map(viewer).collect();
    rig.checked().unwrap()
}

/// A fixed scatter of points of the ball that the panel sweeps, with slices.
pub(super) fn scatter(rig: &Rig, count: u32) -> impl Iterator<Item = (DVec3, f64)> {
    (0..count).map(|index| {
        let fraction = |step: f64| (f64::from(index) * step).fract();
        let (azimuth, height) = (fraction(0.618_034) * core::f64::consts::TAU, fraction(0.754_878) * 2.0 - 1.0);
        let level = (1.0 - height * height).sqrt() * 0.1 * fraction(0.569_840).cbrt();
        let point = DVec3::new(level * azimuth.sin(), 0.1 * height, level * azimuth.cos());
        (point.as_vec3().as_dvec3(), rig.slice_angle(index * 97 % rig.rotation.slices))
    })
}

/// The largest distance in pixels, and in metres of depth, of a method from its model's reference over the visible points.
fn worst<F: Real>(rig: &Rig, method: Method, count: u32) -> (f64, f64) {
    let (mut pixels, mut depth, mut seen) = (0.0f64, 0.0f64, 0);
    for face in 0..rig.mirror.face.len() {
        let optics = FaceOptics::<F>::new(rig, face, method);
        for (point, theta) in scatter(rig, count) {
            let exact = SliceOptics::new(rig, face, theta, method.model());
            let expected = exact.project(point);
            let vertex = optics.slice(theta).vertex(point.to_array().map(F::of));
            if expected.visibility != Visibility::Visible {
                continue;
            }
            let vertex = vertex.expect("what is visible has a pixel");
            seen += 1;
            pixels = pixels.max((DVec2::from_array(vertex.pixel.map(F::wide)) - expected.pixel.unwrap()).length());
            depth = depth.max((vertex.depth_m.wide() - exact.depth_from_circle(point, expected.viewer.unwrap())).abs());
            assert!(vertex.lit && vertex.sides == 0);
        }
    }
    assert!(seen > count / 20, "{seen}");
    (pixels, depth)
}

#[test]
fn every_method_agrees_with_the_reference() {
    for rig in rigs() {
        for (method, single, double) in [
            (Method::Planar, 0.01, 1e-6),
            (Method::ConeRoot, 0.01, 1e-6),
            (Method::ConeNewton, 0.05, 0.05),
            (Method::ConeTable, 0.05, 0.05),
        ] {
            let (in_single, in_double) = (worst::<f32>(&rig, method, 3000), worst::<f64>(&rig, method, 3000));
            println!(
                "{} {method:?}: f32 {:.1e} px {:.1e} m, f64 {:.1e} px {:.1e} m",
                rig.name, in_single.0, in_single.1, in_double.0, in_double.1
            );
            assert!(in_single.0 < single && in_double.0 < double, "{method:?} {in_single:?} {in_double:?} {rig:?}");
            assert!(in_single.1 < 1e-4 && in_double.1 < 1e-4, "{method:?} {in_single:?} {in_double:?} {rig:?}");
        }
    }
}

#[test]
fn a_pixel_sees_along_the_line_that_the_reference_does() {
    for rig in rigs() {
        for (method, single, double) in [
            (Method::Planar, 0.01, 1e-6),
            (Method::ConeRoot, 0.01, 1e-6),
            (Method::ConeNewton, 0.05, 0.05),
            (Method::ConeTable, 0.05, 0.05),
        ] {
            let errors = [worst_sight::<f32>(&rig, method), worst_sight::<f64>(&rig, method)];
            assert!(errors[0] < single && errors[1] < double, "{method:?} {errors:?} {rig:?}");
        }
    }
}

/// The largest distance in pixels of where the reference puts the point 60 mm behind M on a pixel's sight line from that pixel.
fn worst_sight<F: Real>(rig: &Rig, method: Method) -> f64 {
    let (mut worst, mut seen) = (0.0f64, 0);
    let optics = FaceOptics::<F>::new(rig, 0, method);
    for index in 0..400u32 {
        let theta = rig.slice_angle(index * 97 % rig.rotation.slices);
        let pixel = DVec2::new(f64::from(index * 13 % 768) + 0.5, f64::from(index * 29 % 768) + 0.5);
        let exact = SliceOptics::new(rig, 0, theta, method.model());
        let sight = optics.slice(theta).sight(pixel.to_array().map(F::of));
        if let Some(expected) = exact.sight(pixel) {
            let sight = sight.expect("the reference has a sight line");
            let [mirror, toward] = [sight.mirror, sight.toward_viewer].map(|of| DVec3::from_array(of.map(F::wide)));
            let depth = exact.depth_from_circle(mirror, expected.viewer);
            assert!((sight.depth_m.wide() - depth).abs() < 1e-4 && (toward.length() - 1.0).abs() < 1e-6);
            let Some(back) = exact.project(mirror - 0.06 * toward).pixel else { continue };
            worst = worst.max(back.distance(pixel));
            seen += 1;
        }
    }
    assert!(seen > 20, "{seen}");
    worst
}

#[test]
fn built_in_rigs_need_no_double_precision() {
    for text in RIGS {
        assert!(single_is_enough(&Rig::parse(text).unwrap()));
    }
    // So fine an image that the digits of a point in single precision are a pixel.
    assert!(!single_is_enough(&changed(&[("focal_px = 3072.0", "focal_px = 3072e3")])));
    // Grazing: viewers nearly in the mirror's plane.
    assert!(!single_is_enough(&changed(&[("height_m = 0.35", "height_m = -0.85")])));
}
