//! Rigs unlike the built-in ones: each must show the eye the right picture, which a sign or an order gone wrong would not.

use glam::DVec3;
use host::render::plan::{Halftone, Plan};
use host::render::truth::{Caster, Pinhole};
use host::rendered;
use host::scene::luminance;
use host::seen::{Brightness, View, see};
use protocol::rig::Rig;
use tests::{builtin, turn};

const REFERENCE: &str = include_str!("../../host/rigs/reference.toml");
const TENT: &str = include_str!("../../host/rigs/tent.toml");

fn changed(text: &str, changes: &[(&str, &str)]) -> Rig {
    let text = changes.iter().fold(text.to_string(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    });
    Rig::parse(&text).unwrap()
}

/// PSNR of what an eye at azimuth `azimuth` (radians), `distance` from the axis and `height` up, sees of the built-in scene.
fn psnr(rig: &Rig, halftone: Halftone, [azimuth, distance, height]: [f64; 3], gain: f32) -> f64 {
    let scene = builtin();
    let turn = turn(&scene, rig, &Plan { halftone, ..Plan::default() });
    let from = DVec3::new(distance * azimuth.sin(), height, distance * azimuth.cos());
    let view = View { from, look_at: DVec3::ZERO, window_m: 0.11, pixels: 128, rays: 4 };
    let mut seen = see(rig, &turn, &view, 4, Brightness::Divided, &|| ());
    seen.colours.iter_mut().flatten().for_each(|value| *value *= gain);
    let pinhole = Pinhole { from, look_at: DVec3::ZERO, window_m: 0.11, pixels: 128, rays: 4 };
    let likeness = host::measure::compare(&seen, &Caster::new(&scene).picture(&pinhole, &|| ())).unwrap();
    println!("{}: {:.2} dB over {:.3} from azimuth {azimuth}", rig.name, likeness.psnr_db, likeness.share);
    assert!(likeness.share > 0.85, "{} of the picture", likeness.share);
    likeness.psnr_db
}

#[test]
fn every_key_of_a_rig_means_what_it_says() {
    let cases: &[(&str, &[(&str, &str)])] = &[
        ("as it is", &[]),
        ("clockwise", &[("\"counter-clockwise\"", "\"clockwise\"")]),
        ("phase offset", &[("phase_offset_deg = 0.0", "phase_offset_deg = 123.4")]),
        (
            "clockwise with offset",
            &[("\"counter-clockwise\"", "\"clockwise\""), ("phase_offset_deg = 0.0", "phase_offset_deg = -77.0")],
        ),
        ("face turned", &[("azimuth_deg = 0.0 ", "azimuth_deg = 50.0 ")]),
        ("projector off the axis", &[("[0.0, 0.6, 0.0]", "[0.03, 0.62, -0.02]")]),
        ("projector rolled", &[("[0.0, 0.0, 1.0]", "[0.5, 0.0, 0.8]")]),
        ("principal point", &[("[384.0, 384.0]", "[400.0, 370.0]")]),
        ("steeper mirror", &[("tilt_deg = 45.0", "tilt_deg = 48.0")]),
        ("mirror off the origin", &[("offset_m = 0.0 ", "offset_m = 0.004 ")]),
        ("distortion", &[("width_px", "radial = [0.4, -0.5]\nwidth_px")]),
        (
            "more slices",
            &[("slices = 288 ", "slices = 576 "), ("diffuser_hat_radius_deg = 1.25", "diffuser_hat_radius_deg = 0.7")],
        ),
        ("odd width", &[("width_px = 768", "width_px = 771"), ("height_px = 768", "height_px = 765")]),
        ("near viewers", &[("distance_m = 0.9", "distance_m = 0.5")]),
    ];
    for (name, changes) in cases {
        let mut rig = changed(REFERENCE, changes);
        rig.name = (*name).to_string();
        let distance = rig.viewing.distance_m.unwrap();
        let psnr = psnr(&rig, Halftone::Grey, [2.2, distance, 0.35], 1.0);
        // 43.2 to 45.6 dB were seen; a wrong sign leaves less than 30.
        assert!(psnr > 42.0, "{name}: {psnr:.2} dB");
    }
}

#[test]
fn viewers_at_infinity_see_it_from_afar() {
    let rig = changed(REFERENCE, &[("distance_m = 0.9", ""), ("height_m = 0.35", "elevation_deg = 21.0")]);
    let far = 200.0;
    let psnr = psnr(&rig, Halftone::Grey, [4.0, far, far * 21f64.to_radians().tan()], 1.0);
    assert!(psnr > 41.5, "{psnr}");
}

#[test]
fn a_calibrated_matrix_shows_what_the_pose_shows() {
    let pose = ["position_m", "look_at_m", "image_down", "focal_px", "principal_px"];
    let kept: Vec<_> = REFERENCE.lines().filter(|line| !pose.iter().any(|key| line.starts_with(key))).collect();
    // The reference pose times −2: a homogeneous matrix has no scale, but a sign, which puts the mirror in front.
    let matrix =
        "matrix = [[6144.0, -768.0, 0.0, 460.8], [0.0, -768.0, 6144.0, 460.8], [0.0, -2.0, 0.0, 1.2]]\nwidth_px";
    let rig = Rig::parse(&kept.join("\n").replacen("width_px", matrix, 1)).unwrap();
    let plan = Plan { halftone: Halftone::Grey, ..Plan::default() };
    let (posed, calibrated) = (turn(&builtin(), &tests::rig("reference"), &plan), turn(&builtin(), &rig, &plan));
    let different = posed.bytes().iter().zip(calibrated.bytes()).filter(|(a, b)| a != b).count();
    assert!(different < posed.bytes().len() / 100_000, "{different} pixels");
    assert!(psnr(&rig, Halftone::Grey, [1.0, 0.9, 0.35], 1.0) > 43.5);
}

#[test]
fn both_faces_of_a_tent_show_the_scene() {
    // White is the sum of the filters' luminances there.
    let rig = Rig::parse(TENT).unwrap();
    let of_face = |face| luminance(DVec3::from_array(rig.filter_colour(face)).as_vec3());
    let white: f32 = (0..2).map(of_face).sum();
    let psnr = psnr(&rig, Halftone::Grey, [0.7, 0.9, 0.35], 1.0 / white);
    assert!(psnr > 36.0, "{psnr}");
}

#[test]
fn frames_keep_their_planes_in_any_channel_order() {
    for order in ["rgb", "grb", "bgr"] {
        let rig = changed(REFERENCE, &[("plane_order = \"rgb\"", &format!("plane_order = \"{order}\""))]);
        let plan = Plan::default();
        let turn = turn(&builtin(), &rig, &plan);
        let folder = tempfile::tempdir().unwrap();
        let note = rendered::SceneNote { source: "builtin".into(), triangles: 1, fit_m: None };
        let method = rendered::Method { plan, shading: "lambert".into(), smooth: false };
        let rotation = rendered::Rotation::new(&rig, note, method);
        rendered::write(folder.path(), &turn, &rotation, &|| ()).unwrap();
        let (read, planes) = rendered::load(folder.path()).unwrap();
        assert!(read == rotation && planes == turn, "{order}");
        let word = image_word(&rendered::frame(&turn, &rig, 0), 384, 300);
        for slice in 0..24 {
            // The channel that is shown as number slice div 8 has its place in the word by its colour.
            let place = "rgb".find(&order[slice / 8..=slice / 8]).unwrap() * 8 + slice % 8;
            let lit = turn.slice(slice as u32)[300 * 96 + 48] & 1 == 1;
            assert_eq!(word >> place & 1 == 1, lit, "{order}, slice {slice}");
        }
        assert_ne!(word, 0);
    }
}

/// The 24-bit word of a frame's pixel: R | G << 8 | B << 16.
fn image_word(frame: &[u8], x: usize, y: usize) -> u32 {
    let pixel = &frame[(y * 768 + x) * 3..][..3];
    u32::from(pixel[0]) | u32::from(pixel[1]) << 8 | u32::from(pixel[2]) << 16
}
