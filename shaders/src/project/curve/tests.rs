use super::*;
use crate::project::methods::{FaceOptics, Method};
use crate::project::{Model, Viewer, Visibility};
use core::f64::consts::TAU;
use proptest::prelude::*;
use protocol::rig::TrackedViewer;

const REFERENCE: &str = include_str!("../../../../host/rigs/reference.toml");

fn rig(viewers: Vec<TrackedViewer>) -> Rig {
    let mut rig = Rig::parse(REFERENCE).unwrap();
    rig.viewing.tracked = viewers;
    rig.checked().unwrap()
}

fn viewer(azimuth_deg: f64, distance_m: f64, height_m: f64) -> TrackedViewer {
    TrackedViewer { azimuth_deg, distance_m, height_m }
}

/// The same for everybody.
fn circle(distance_m: f64, height_m: f64) -> Rig {
    let mut rig = Rig::parse(REFERENCE).unwrap();
    (rig.viewing.distance_m, rig.viewing.height_m) = (Some(distance_m), Some(height_m));
    rig
}

fn points() -> impl Iterator<Item = DVec3> {
    (0..60).map(|index| {
        let fraction = |step: f64| (f64::from(index) * step).fract();
        0.1 * DVec3::new(fraction(0.618_034) - 0.5, fraction(0.754_878) - 0.5, fraction(0.569_840) - 0.5)
    })
}

#[test]
fn viewers_all_around_are_a_circle_of_their_own() {
    let all = rig((0..18).map(|index| viewer(20.0 * f64::from(index), 1.1, 0.6)).collect());
    let own = circle(1.1, 0.6);
    for slice in (0..288).step_by(5) {
        let theta = all.slice_angle(slice);
        for model in [Model::Planar, Model::Cone] {
            let [a, b] = [&all, &own].map(|rig| SliceOptics::new(rig, 0, theta, model));
            for point in points() {
                let [a, b] = [&a, &b].map(|optics| optics.project(point));
                assert_eq!(a.visibility, b.visibility);
                assert!(a.pixel.unwrap().distance(b.pixel.unwrap()) < 1e-9, "{a:?} {b:?}");
            }
            let pixel = DVec2::new(300.3, 410.7);
            let [a, b] = [&a, &b].map(|optics| optics.sight(pixel).unwrap());
            assert!((a.viewer.vector() - b.viewer.vector()).length() < 1e-9);
        }
        for method in [Method::Planar, Method::ConeRoot, Method::ConeNewton, Method::ConeTable] {
            let pixels = [&all, &own].map(|rig| {
                let projector = FaceOptics::<f64>::new(rig, 0, method).slice(theta);
                points().map(|point| projector.vertex(point.to_array()).unwrap().pixel).collect::<Vec<_>>()
            });
            // Newton's steps begin where they begin; the table is another circle's.
            let allowed = if method == Method::ConeTable { 0.05 } else { 1e-9 };
            for (a, b) in pixels[0].iter().zip(&pixels[1]) {
                assert!(DVec2::from(*a).distance(DVec2::from(*b)) < allowed, "{method:?} {a:?} {b:?}");
            }
        }
    }
}

/// Who stands where the circle is changes no bit, and neither does anybody for the slices of the other side.
#[test]
fn slices_whose_fan_is_on_the_circle_are_the_circles() {
    let (nobody, rest, there) = (rig(vec![]), rig(vec![viewer(30.0, 0.9, 0.35)]), rig(vec![viewer(0.0, 1.2, 0.6)]));
    let vertices = |rig: &Rig, slice: u32, method| {
        let projector = FaceOptics::<f32>::new(rig, 0, method).slice(rig.slice_angle(slice));
        points().map(|point| projector.vertex(point.as_vec3().to_array())).collect::<Vec<_>>()
    };
    for method in [Method::Planar, Method::ConeRoot, Method::ConeNewton, Method::ConeTable] {
        let mut same = 0;
        for slice in 0..288 {
            let expected = vertices(&nobody, slice, method);
            assert_eq!(vertices(&rest, slice, method), expected);
            let is_same = vertices(&there, slice, method) == expected;
            same += u32::from(is_same);
            let is_alike = shows_alike(&nobody, &there, 0, nobody.slice_angle(slice), method.model());
            assert!(is_same || !is_alike, "{method:?} {slice}");
        }
        // 30° of bends and flat piece, and fans of 24°.
        assert!((235..250).contains(&same), "{method:?} {same}");
    }
}

#[test]
fn a_fan_holds_all_who_see_the_panel() {
    let rig = rig(vec![viewer(0.0, 1.2, 0.6), viewer(25.0, 0.8, 0.2)]);
    for slice in 0..288 {
        for model in [Model::Planar, Model::Cone] {
            let optics = SliceOptics::new(&rig, 0, rig.slice_angle(slice), model);
            let [from, to] = optics.fan().unwrap();
            assert!(to - from < 0.6);
            for pixel in
                (0..768 * 768).step_by(1517).map(|cell| DVec2::new(f64::from(cell % 768), f64::from(cell / 768)))
            {
                let Some(sight) = optics.sight(pixel) else { continue };
                let viewer = sight.viewer.vector();
                let aside = (viewer.x.atan2(viewer.z) - from).rem_euclid(TAU);
                assert!((0.5 * FAN_MARGIN..to - from - 0.5 * FAN_MARGIN).contains(&aside), "{aside} {from} {to}");
            }
        }
    }
}

fn viewers() -> impl Strategy<Value = Vec<TrackedViewer>> {
    let one = (-180.0f64..180.0, 0.4f64..2.5, -0.3f64..0.9);
    prop::collection::vec(one.prop_map(|(azimuth, distance, height)| viewer(azimuth, distance, height)), 0..10)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(1000) })]

    #[test]
    fn the_first_crossing_is_found(
        viewers in viewers(), x in -0.3f64..0.3, z in -0.3f64..0.3, toward in 0.0f64..TAU,
    ) {
        let curve = ViewingCurve::new(Spot { distance_m: 0.9, height_m: 0.35 }, &viewers);
        let (level, away) = (DVec2::new(x, z), DVec2::from_angle(toward));
        let found = crossing(&curve, level, away).unwrap();
        let azimuth = |place: DVec2| place.x.atan2(place.y);
        let seen = DVec2::new(found.x, found.z);
        let spot = curve.spot(azimuth(seen));
        prop_assert!((seen.length() - spot.distance_m).abs() < 1e-12 && found.y == spot.height_m);
        prop_assert!((seen - level).perp_dot(away).abs() < 1e-12 && (seen - level).dot(away) > 0.0);
        for part in 0..2000 {
            let before = level.lerp(seen, f64::from(part) / 2000.0);
            let beyond = before.length() - curve.spot(azimuth(before)).distance_m;
            prop_assert!(beyond < 1e-4, "{} m beyond the curve at {} of the way", beyond, f64::from(part) / 2000.0);
        }
    }

    #[test]
    fn a_pixel_sees_the_points_that_project_to_it(
        viewers in viewers(), cone: bool, slice in 0u32..288, point in prop::array::uniform3(-0.05f64..0.05),
    ) {
        let rig = rig(viewers);
        let model = if cone { Model::Cone } else { Model::Planar };
        let optics = SliceOptics::new(&rig, 0, rig.slice_angle(slice), model);
        let point = DVec3::from_array(point);
        let projected = optics.project(point);
        prop_assume!(projected.visibility == Visibility::Visible);
        let Viewer::At(viewer) = projected.viewer.unwrap() else { panic!("they are near") };
        let Viewers::Curve(ref curve) = optics.viewers else { return Ok(()) };
        let spot = curve.spot(viewer.x.atan2(viewer.z));
        prop_assert!((viewer.with_y(0.0).length() - spot.distance_m).abs() < 1e-9 && (viewer.y - spot.height_m).abs() < 1e-9);
        let sight = optics.sight(projected.pixel.unwrap()).unwrap();
        // M is on the panel, near the axis; the point's line may meet more of the curve than M's.
        if (sight.viewer.vector() - viewer).length() < 1e-3 {
            prop_assert!((sight.viewer.vector() - viewer).length() < 1e-6);
            let line = (sight.mirror - viewer).normalize();
            prop_assert!((point - sight.mirror).reject_from_normalized(line).length() < 1e-7);
        }
    }

    /// Each method is as near to the reference as on a circle.
    #[test]
    fn methods_keep_their_tolerances(
        viewers in viewers(), slice in 0u32..288, point in prop::array::uniform3(-0.06f64..0.06),
    ) {
        let rig = rig(viewers);
        let theta = rig.slice_angle(slice);
        let point = DVec3::from_array(point).as_vec3();
        for (method, single_px, double_px) in
            [(Method::Planar, 0.01, 1e-6), (Method::ConeRoot, 0.01, 1e-6), (Method::ConeNewton, 0.05, 0.05)]
        {
            let exact = SliceOptics::new(&rig, 0, theta, method.model()).project(point.as_dvec3());
            if exact.visibility != Visibility::Visible {
                continue;
            }
            let single = FaceOptics::<f32>::new(&rig, 0, method).slice(theta).vertex(point.to_array()).unwrap();
            let double = FaceOptics::<f64>::new(&rig, 0, method).slice(theta).vertex(point.as_dvec3().to_array()).unwrap();
            let off = |pixel: DVec2| pixel.distance(exact.pixel.unwrap());
            let (single, double) = (off(DVec2::from(single.pixel.map(f64::from))), off(DVec2::from(double.pixel)));
            prop_assert!(single < single_px && double < double_px, "{:?}: {} and {} px", method, single, double);
        }
    }
}
