use super::*;
use glam::DVec2;

const REFERENCE: &str = include_str!("../../../host/rigs/reference.toml");
const TENT: &str = include_str!("../../../host/rigs/tent.toml");

fn refusal(text: &str) -> String {
    Rig::parse(text).unwrap_err().to_string()
}

#[test]
fn the_reference_rig_is_the_patents() {
    let rig = Rig::parse(REFERENCE).unwrap();
    assert_eq!(rig.rotation().frames(), 12);
    assert!((rig.turns_per_second() - 20.0).abs() < 1e-12);
    let camera = rig.camera();
    assert_eq!(camera.project(DVec3::ZERO), Some(DVec2::new(384.0, 384.0)));
    // Rows grow toward +z, columns toward +x: 0.1 m at 0.6 m is 512 px.
    let corner = camera.project(DVec3::new(0.1, 0.0, 0.05)).unwrap();
    assert!((corner - DVec2::new(896.0, 640.0)).length() < 1e-9, "{corner}");
    assert_eq!(camera.project(DVec3::new(0.0, 0.7, 0.0)), None);
}

#[test]
fn a_face_looks_up_and_outward() {
    let rig = Rig::parse(REFERENCE).unwrap();
    let frame = rig.mirror.face[0].frame(TAU / 4.0);
    let half = 0.5f64.sqrt();
    assert!((frame.normal - DVec3::new(half, half, 0.0)).length() < 1e-12);
    assert!((frame.across - DVec3::new(0.0, 0.0, -1.0)).length() < 1e-12);
    assert!((frame.slope - DVec3::new(-half, half, 0.0)).length() < 1e-12, "{}", frame.slope);
}

#[test]
fn what_is_written_can_be_read() {
    for text in [REFERENCE, TENT] {
        let rig = Rig::parse(text).unwrap();
        assert_eq!(Rig::parse(&toml::to_string(&rig).unwrap()).unwrap(), rig);
    }
}

#[test]
fn clockwise_turns_the_other_way() {
    let rig = Rig::parse(&REFERENCE.replace("\"counter-clockwise\"", "\"clockwise\"")).unwrap();
    assert!((rig.slice_angle(0) + TAU / 576.0).abs() < 1e-15);
}

#[test]
fn impossible_rigs_are_refused_by_name() {
    let cases = [
        ("focal_px = 3072.0", "focal_px = 0.0", "projector.focal_px = 0: must be"),
        ("focal_px = 3072.0", "focal_px = nan", "projector.focal_px"),
        ("focal_px = 3072.0", "focal_mm = 30.0", "unknown field `focal_mm`, expected one of"),
        ("focal_px = 3072.0", "", "projector needs position_m"),
        ("[0.0, 0.6, 0.0]", "[0.0, -0.6, 0.0]", "projector.position_m is below the plane"),
        ("[0.0, 0.6, 0.0]", "[0.0, 0.0, 0.0]", "projector.look_at_m must differ"),
        ("[0.0, 0.0, 1.0]", "[0.0, 1.0, 0.0]", "image_down must not point along"),
        ("slices = 288 ", "slices = 280 ", "rotation.slices = 280: must be a multiple of planes_per_frame = 24"),
        ("slices = 288 ", "slices = -1 ", "slices"),
        ("slices = 288 ", "", "missing field `slices`"),
        ("refresh_hz = 240.0", "refresh_hz = \"fast\"", "line 9: refresh_hz: invalid type"),
        ("tilt_deg = 45.0", "tilt_deg = 90.0", "mirror.face[0].tilt_deg = 90: must be from 0.1 to 89.9"),
        ("width_m = 0.14", "width_m = -0.14", "mirror.face[0].width_m"),
        ("[-0.10, 0.10]", "[0.10, -0.10]", "mirror.face[0].slope_span_m"),
        ("filter = \"none\"", "filter = \"red\"", "mirror.face[0].filter = \"red\": must be one of none"),
        ("diffuser_hat_radius_deg = 1.25", "", "diffuser_hat_radius_deg is missing"),
        ("diffuser_hat_radius_deg = 1.25", "diffuser_lobe = [[0.0, 1.0], [0.0, 0.0]]", "rising degrees"),
        ("height_m = 0.35", "elevation_deg = 20.0", "viewing needs distance_m and height_m, or elevation_deg"),
        ("distance_m = 0.9", "distance_m = inf", "viewing.distance_m"),
        ("plane_order = \"rgb\"", "plane_order = \"rgbw\"", "plane_order: unknown variant `rgbw`"),
        ("width_px = 768", "width_px = 0", "projector.width_px"),
    ];
    for (from, to, expected) in cases {
        let text = REFERENCE.replacen(from, to, 1);
        assert_ne!(text, REFERENCE, "{from} is not in the file");
        let refused = refusal(&text);
        assert!(refused.contains(expected), "{to}: {refused}");
        assert_eq!(refused.lines().count(), 1, "{refused}");
    }
    assert!(refusal(&TENT.replace("#FFBE55", "orange")).contains("filters.lee-020-orange.srgb"));
}

/// The reference projector as a matrix, optionally with its columns' scale turned.
fn with_matrix(matrix: &str) -> String {
    let pose = ["position_m", "look_at_m", "image_down", "focal_px", "principal_px"];
    let kept: Vec<_> = REFERENCE.lines().filter(|line| !pose.iter().any(|key| line.starts_with(key))).collect();
    kept.join("\n").replace("width_px", &format!("matrix = {matrix}\nwidth_px"))
}

#[test]
fn a_matrix_is_the_pose_that_it_came_from() {
    let text = with_matrix("[[3072.0, -384.0, 0.0, 230.4], [0.0, -384.0, 3072.0, 230.4], [0.0, -1.0, 0.0, 0.6]]");
    let camera = Rig::parse(&text).unwrap().camera();
    let posed = Rig::parse(REFERENCE).unwrap().camera();
    let point = DVec3::new(0.03, -0.02, 0.05);
    assert!((camera.project(point).unwrap() - posed.project(point).unwrap()).length() < 1e-9);
    assert!((camera.position - posed.position).length() < 1e-12);
    let flat = with_matrix("[3072.0, -384.0, 0.0, 230.4, 0.0, -384.0, 3072.0, 230.4, 0.0, -1.0, 0.0, 0.6]");
    assert_eq!(Rig::parse(&flat).unwrap().camera(), camera);
    let negated = "[[-3072.0, 384.0, 0.0, -230.4], [0.0, 384.0, -3072.0, -230.4], [0.0, 1.0, 0.0, -0.6]]";
    assert!(refusal(&with_matrix(negated)).contains("negate"));
    assert!(refusal(&with_matrix("[1.0, 2.0]")).contains("three rows of four"));
    assert!(
        refusal(&with_matrix("[[-3072.0, -384.0, 0.0, 230.4], [0.0, -384.0, 3072.0, 230.4], [0.0, -1.0, 0.0, 0.6]]"))
            .contains("mirrors")
    );
    assert!(
        refusal(&with_matrix("[[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]")).contains("affine")
    );
}

#[test]
fn a_pixel_and_its_ray_agree_with_distortion() {
    let text = REFERENCE.replace("width_px", "radial = [0.9, -2.0]\nwidth_px");
    let camera = Rig::parse(&text).unwrap().camera();
    for pixel in [DVec2::ZERO, DVec2::new(384.0, 384.0), DVec2::new(767.0, 12.5)] {
        let back = camera.project(camera.position + camera.ray(pixel) * 0.6).unwrap();
        assert!((back - pixel).length() < 1e-9, "{pixel} {back}");
    }
    assert!(refusal(&REFERENCE.replace("width_px", "radial = [-20.0, 0.0]\nwidth_px")).contains("folds"));
}

#[test]
fn tracked_viewers_are_keys_too() {
    let tracked = "\n[[viewing.tracked]]\nazimuth_deg = 20.0\ndistance_m = 1.2\nheight_m = 0.6\n";
    let rig = Rig::parse(&format!("{REFERENCE}{tracked}")).unwrap();
    assert_eq!(rig.viewing.tracked, [TrackedViewer { azimuth_deg: 20.0, distance_m: 1.2, height_m: 0.6 }]);
    assert_eq!(Rig::parse(&toml::to_string(&rig).unwrap()).unwrap(), rig);
    assert_eq!(rig.at_rest(), Rig::parse(REFERENCE).unwrap());
    let far = REFERENCE.replace("distance_m = 0.9", "").replace("height_m = 0.35", "elevation_deg = 20.0");
    let refused = refusal(&format!("{far}{tracked}"));
    assert_eq!(refused, "viewing.tracked needs distance_m and height_m: viewers at infinity stand on no curve");
    let refused = refusal(&format!("{REFERENCE}{}", tracked.replace("1.2", "0.0")));
    assert_eq!(refused, "viewing.tracked[0].distance_m = 0: must be from 0.01 to 1000000000");
    let refused = refusal(&format!("{REFERENCE}{}", tracked.repeat(65)));
    assert_eq!(refused, "viewing.tracked stands 65 times: must be up to 64");
}
