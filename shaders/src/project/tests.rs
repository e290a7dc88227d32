use super::*;
use core::f64::consts::TAU;
use proptest::prelude::*;

const REFERENCE: &str = include_str!("../../../host/rigs/reference.toml");
const HIGH: &str = include_str!("../../../host/rigs/high-viewer.toml");
const TENT: &str = include_str!("../../../host/rigs/tent.toml");

fn optics(text: &str, slice: u32, model: Model) -> SliceOptics {
    let rig = Rig::parse(text).unwrap();
    SliceOptics::new(&rig, 0, rig.slice_angle(slice), model)
}

#[test]
fn a_point_on_the_axis_stays_put_from_every_side() {
    // With the projector on the axis the whole of it is the plane of symmetry of every slice: V' is straight ahead.
    for model in [Model::Planar, Model::Cone] {
        for slice in 0..288 {
            let projected = optics(REFERENCE, slice, model).project(DVec3::ZERO);
            assert_eq!(projected.visibility, Visibility::Visible);
            assert!((projected.pixel.unwrap() - DVec2::splat(384.0)).length() < 1e-9);
            let ahead = Rig::parse(REFERENCE).unwrap().slice_angle(slice);
            let expected = DVec3::new(0.9 * ahead.sin(), 0.35, 0.9 * ahead.cos());
            assert!((projected.viewer.unwrap().vector() - expected).length() < 1e-9);
        }
    }
}

#[test]
fn far_away_is_the_limit_of_a_distance() {
    let rig = |viewing: &str| REFERENCE.replace("distance_m = 0.9", "").replace("height_m = 0.35", viewing);
    let infinite = rig("elevation_deg = 20.0");
    let (distance, height) = (1e8, 1e8 * 20f64.to_radians().tan());
    let far = rig(&format!("distance_m = {distance:?}\nheight_m = {height:?}"));
    let point = DVec3::new(0.02, -0.03, 0.04);
    for model in [Model::Planar, Model::Cone] {
        let near = optics(&far, 7, model).project(point).pixel.unwrap();
        let limit = optics(&infinite, 7, model).project(point).pixel.unwrap();
        assert!((near - limit).length() < 1e-4, "{near} {limit}");
    }
}

/// How far, in radians, the cone's viewer of the origin, which lies on the mirror, is from the nearer of its equation's two roots,
/// which are known there; `None` where there is none.
///
/// M is the origin for every viewer. With i from the projector, a the face's azimuth and φ the viewer's, `o·e = i·e` is
/// `sin(φ − a) = i·e √(d² + h²) / d`.
fn error_at_origin(position: DVec3, theta: f64) -> Option<f64> {
    let mut rig = Rig::parse(REFERENCE).unwrap();
    rig.projector.position_m = Some(position.to_array());
    rig.projector.image_down = Some([0.0, -1.0, 0.0]);
    let [planar, cone] =
        [Model::Planar, Model::Cone].map(|model| SliceOptics::new(&rig, 0, theta, model).viewer_of(DVec3::ZERO));
    let azimuth = |viewer: Viewer| viewer.vector().x.atan2(viewer.vector().z);
    let across = -position.normalize().dot(rig.mirror.face[0].frame(theta).across);
    let sine = across * 0.9f64.hypot(0.35) / 0.9;
    // Nearer to a double root than this, its rounding decides.
    if sine.abs() > 1.0 - 1e-9 {
        return None;
    }
    let turned = |to: f64, from: f64| (to - from + PI).rem_euclid(TAU) - PI;
    let roots = [theta + sine.asin(), theta + PI - sine.asin()];
    let [first, second] = roots.map(|root| turned(root, azimuth(planar.unwrap())).abs());
    // Equally near, either will do.
    let nearer = if (first - second).abs() < 1e-6 { None } else { Some(roots[usize::from(second < first)]) };
    nearer.map(|root| cone.map_or(PI, |cone| turned(azimuth(cone), root).abs()))
}

#[test]
fn of_two_roots_the_nearer_is_taken() {
    // Found by the fuzzer: the planar azimuth is between the roots, 5.3 degrees from the one that the secant ran to, 5.0 from the other.
    let theta = (126.5 * 1.25 - 179.967_040_512_703_14f64).to_radians();
    let error = error_at_origin(DVec3::new(-7.720_000_060_351_033, 0.017_202_806_251_778_97, 0.0), theta);
    assert!(error.unwrap() < 1e-9, "{error:?}");
}

#[test]
fn what_cannot_be_seen_says_why() {
    let optics = optics(REFERENCE, 0, Model::Cone);
    let why = |x, y, z| optics.project(DVec3::new(x, y, z)).visibility;
    assert_eq!(why(5.0, 0.0, 0.0), Visibility::NoViewer);
    assert_eq!(why(0.0, 0.3, 0.0), Visibility::OffPanel);
    assert_eq!(why(f64::NAN, 0.0, 0.0), Visibility::NoViewer);
}

#[test]
fn the_planar_fan_is_off_by_what_the_prototype_measured() {
    // rig.md's table: largest over random points of a 60 mm ball, 1.3 px at h = 0.35 m and 3.9 px at 0.75 m.
    for (text, expected) in [(REFERENCE, 1.3), (HIGH, 3.9)] {
        let mut worst: f64 = 0.0;
        for index in 0..1500u32 {
            let point = ball_point(index) * 0.06;
            let slice = index * 97 % 288;
            let [planar, cone] = [Model::Planar, Model::Cone].map(|model| optics(text, slice, model).project(point));
            if planar.visibility == Visibility::Visible && cone.visibility == Visibility::Visible {
                worst = worst.max((planar.pixel.unwrap() - cone.pixel.unwrap()).length());
            }
        }
        assert!((worst - expected).abs() < 0.25, "{worst} px, expected about {expected}");
    }
}

/// A fixed scatter of points in the unit ball.
fn ball_point(index: u32) -> DVec3 {
    let fraction = |step: f64| (f64::from(index) * step).fract();
    let (azimuth, height, radius) =
        (fraction(0.618_034) * TAU, fraction(0.754_878) * 2.0 - 1.0, fraction(0.569_840).cbrt());
    let level = (1.0 - height * height).sqrt();
    radius * DVec3::new(level * azimuth.sin(), height, level * azimuth.cos())
}

proptest! {
    #[test]
    fn the_cone_at_the_origin_is_the_closed_form(
        azimuth in -PI..PI, elevation in 0.0f64..1.5, distance in 0.3f64..10.0, theta in -PI..PI,
    ) {
        let level = distance * elevation.cos();
        let position = DVec3::new(level * azimuth.sin(), distance * elevation.sin(), level * azimuth.cos());
        let error = error_at_origin(position, theta);
        prop_assert!(error.is_none_or(|error| error < 1e-7), "{error:?}");
    }

    #[test]
    fn a_pixel_sees_the_points_that_project_to_it(
        x in -0.05f64..0.05, y in -0.05f64..0.05, z in -0.05f64..0.05, slice in 0u32..288, rig in 0usize..3, cone: bool,
    ) {
        let point = DVec3::new(x, y, z);
        let model = if cone { Model::Cone } else { Model::Planar };
        let optics = optics([REFERENCE, HIGH, TENT][rig], slice, model);
        let projected = optics.project(point);
        prop_assume!(projected.visibility == Visibility::Visible);
        let sight = optics.sight(projected.pixel.unwrap()).unwrap();
        prop_assert!((sight.viewer.vector() - projected.viewer.unwrap().vector()).length() < 1e-7);
        let line = (sight.mirror - sight.viewer.vector()).normalize();
        prop_assert!((point - sight.mirror).reject_from_normalized(line).length() < 1e-8);
    }

    #[test]
    fn any_point_has_an_answer(
        x: f64, y: f64, z: f64, slice in 0u32..288, cone: bool,
    ) {
        let model = if cone { Model::Cone } else { Model::Planar };
        let projected = optics(REFERENCE, slice, model).project(DVec3::new(x, y, z));
        if projected.visibility == Visibility::Visible {
            let pixel = projected.pixel.unwrap();
            prop_assert!(pixel.is_finite() && pixel.min_element() >= 0.0 && pixel.max_element() < 768.0);
        }
    }

    #[test]
    fn any_possible_rig_agrees_with_its_inverse(
        tilt in 1.0f64..89.0, offset in -0.05f64..0.05, azimuth in -180.0f64..180.0, phase in -360.0f64..360.0,
        position in prop::array::uniform3(-0.5f64..0.5), height in 0.2f64..2.0, focal in 100.0f64..8000.0,
        radial in prop::array::uniform2(-0.5f64..0.5), distance in 0.2f64..1e4, viewer_height in -2.0f64..5.0,
        clockwise: bool, infinite: bool, cone: bool, slice in 0u32..288,
        point in prop::array::uniform3(-0.1f64..0.1),
    ) {
        let viewing = if infinite {
            format!("elevation_deg = {:?}", viewer_height * 10.0)
        } else {
            format!("distance_m = {distance:?}\nheight_m = {viewer_height:?}")
        };
        let text = REFERENCE
            .replace("distance_m = 0.9", "")
            .replace("height_m = 0.35", &viewing)
            .replace("tilt_deg = 45.0", &format!("tilt_deg = {tilt:?}"))
            .replace("offset_m = 0.0 ", &format!("offset_m = {offset:?} "))
            .replace("azimuth_deg = 0.0", &format!("azimuth_deg = {azimuth:?}"))
            .replace("phase_offset_deg = 0.0", &format!("phase_offset_deg = {phase:?}"))
            .replace("[0.0, 0.6, 0.0]", &format!("[{:?}, {height:?}, {:?}]", position[0], position[2]))
            .replace("focal_px = 3072.0", &format!("focal_px = {focal:?}\nradial = {radial:?}"))
            .replace("\"counter-clockwise\"", if clockwise { "\"clockwise\"" } else { "\"counter-clockwise\"" });
        // A rig may be impossible; then it is refused, which is an answer too.
        let Ok(rig) = Rig::parse(&text) else { return Ok(()) };
        let model = if cone { Model::Cone } else { Model::Planar };
        let optics = SliceOptics::new(&rig, 0, rig.slice_angle(slice), model);
        let point = DVec3::from_array(point);
        let projected = optics.project(point);
        if projected.visibility != Visibility::Visible {
            return Ok(());
        }
        let pixel = projected.pixel.unwrap();
        prop_assert!(pixel.is_finite() && projected.depth_m.unwrap().is_finite());
        let mirror = projected.mirror.unwrap();
        let back = optics.mirror_of(pixel).unwrap();
        prop_assert!(back.distance(mirror) < 1e-7 * (1.0 + mirror.length()), "{back} {mirror}");
        if cone {
            let viewer = projected.viewer.unwrap();
            let outward = viewer.direction_from(mirror).normalize();
            let inward = (mirror - rig.camera().position).normalize();
            let across = rig.mirror.face[0].frame(rig.slice_angle(slice)).across;
            prop_assert!((outward - inward).dot(across).abs() < 1e-8, "{}", (outward - inward).dot(across));
        }
    }
}
