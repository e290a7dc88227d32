use super::*;
use crate::project::Visibility;
use glam::{DVec2, DVec3};

const REFERENCE: &str = include_str!("../../../../host/rigs/reference.toml");
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
fn rigs() -> Vec<Rig> {
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
    rigs.push(changed(&[("width_px", "radial = [0.4, -0.5]\nwidth_px"), ("offset_m = 0.0 ", "offset_m = 0.004 ")]));
    rigs
}

/// A fixed scatter of points of the ball that the panel sweeps, with slices.
fn scatter(rig: &Rig, count: u32) -> impl Iterator<Item = (DVec3, f64)> {
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
