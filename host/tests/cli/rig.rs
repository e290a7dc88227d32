//! `praxi rig` and `praxi project`.

use crate::desk::Desk;
use serde_json::Value;

#[test]
fn a_projection_has_its_keys_and_takes_negative_numbers() {
    let desk = Desk::new();
    let columns = "-0.0030600028593 0.0412899553487 0.0258156692042";
    for arguments in [format!("--json -- {columns}"), format!("{columns} --json")] {
        let output = desk.run(&format!("project --rig reference --model planar --slice 39 {arguments}"));
        let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!((answer["u_px"].as_f64().unwrap() - 204.495_190_523).abs() < 1e-6);
        assert!((answer["v_px"].as_f64().unwrap() - 372.193_533_269).abs() < 1e-6);
        assert!((answer["viewer_m"][0].as_f64().unwrap() - 0.647_645_621_475).abs() < 1e-9);
        assert!((answer["depth_m"].as_f64().unwrap() - 0.937).abs() < 0.01);
        assert_eq!(answer["visible"], true);
    }
    let hidden = desk.json("project --rig tent --slice 0 --face 1 0 0.5 0");
    assert_eq!(hidden["visible"], false);
    assert!(hidden["reason"].as_str().unwrap().len() > 5);
}

#[test]
fn a_rig_is_described_and_warned_about() {
    let desk = Desk::new();
    let facts = desk.json("rig check reference");
    assert_eq!(facts["turns_per_second"], 20.0);
    assert!((facts["display_radius_mm"].as_f64().unwrap() - 65.0).abs() < 5.0, "{facts}");
    assert!((18..=21).contains(&facts["slices_reaching_an_eye"].as_u64().unwrap()), "{facts}");
    assert_eq!(facts["warnings"].as_array().unwrap().len(), 0);
    desk.write("steep.toml", include_str!("../../rigs/reference.toml").replace("height_m = 0.35", "height_m = 0.95"));
    assert!(desk.warnings("rig check steep.toml").contains("ghosts"));
}

#[test]
fn bad_rigs_are_refused() {
    let desk = Desk::new();
    let reference = include_str!("../../rigs/reference.toml");
    for (name, from, to, words) in [
        ("focal.toml", "focal_px = 3072.0", "focal_px = 0.0", ["focal.toml", "projector.focal_px"]),
        ("below.toml", "[0.0, 0.6, 0.0]", "[0.0, -0.6, 0.0]", ["below.toml", "projector.position_m"]),
        ("slices.toml", "slices = 288", "slices = 287", ["planes_per_frame", "287"]),
        ("unit.toml", "distance_m", "distance_mm", ["unit.toml", "distance_mm"]),
        ("type.toml", "tilt_deg = 45.0", "tilt_deg = \"steep\"", ["type.toml", "tilt_deg"]),
        ("syntax.toml", "[viewing]", "[viewing", ["syntax.toml", "line"]),
    ] {
        desk.write(name, reference.replace(from, to));
        desk.refuses(&format!("rig check {name}"), &words);
        desk.refuses(&format!("render builtin --rig {name} --out turn"), &words);
        desk.refuses(&format!("project --rig {name} --slice 0 0 0 0"), &words);
    }
    let vast = reference.replace("slices = 288", "slices = 2016").replace("_px = 768", "_px = 4096");
    desk.write("vast.toml", vast);
    desk.refuses("render builtin --rig vast.toml --halftone grey --out turn", &["33.8 GB", "6.4 GB"]);
    desk.refuses("rig check nowhere", &["nowhere", "reference", "tent"]);
    desk.refuses("project --rig reference --slice 288 0 0 0", &["288", "0 to 287"]);
    desk.refuses("project --rig reference --slice 0 --face 1 0 0 0", &["--face 1", "0 to 0"]);
    desk.refuses("project --rig reference --slice 0 nan 0 0", &["finite"]);
}
