//! `praxi demo` and `praxi sim`.

use crate::TRIANGLE;
use crate::desk::Desk;
use serde_json::Value;
use std::fs;

#[test]
fn a_demo_is_the_whole_way() {
    let desk = Desk::new();
    let report = desk.json("demo --rig small.toml --out show");
    let names: Vec<_> = fs::read_dir(desk.path("show")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 5, "{names:?}");
    let written: Value = serde_json::from_slice(&fs::read(desk.path("show/report.json")).unwrap()).unwrap();
    assert_eq!(written, report);
    assert_eq!(report["eyes"].as_array().unwrap().len(), 3);
    assert!(report["eyes"].as_array().unwrap().iter().all(|eye| eye["psnr_db"].as_f64().unwrap() > 17.0), "{report}");
    assert_eq!(report["lock"]["planes_misplaced"], 0);
    assert!(report["lock"]["planes_shown"].as_u64().unwrap() > 48 * 20);
    assert!(report["lock"]["time_to_lock_ratio"].as_f64().unwrap() < 1.5);
    assert_eq!(report["stream"]["turns"], 3);
    assert_eq!(report["stream"]["bytes_raw"], 3 * 48 * 96 * 12);
    // The same seed gives the same show; and a second demo replaces the first.
    assert_eq!(desk.json("demo --rig small.toml --out show"), report);

    desk.write("some.obj", TRIANGLE.replace("0.03", "3000"));
    let output = desk.run("demo some.obj --rig small.toml --out show --seed 2");
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("PSNR") && text.contains("time to lock") && text.contains("0 misplaced"), "{text}");
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    desk.refuses("demo none.obj --rig small.toml", &["none.obj"]);
}

#[test]
fn a_simulation_is_repeatable_and_takes_files() {
    let desk = Desk::new();
    let run = desk.json("sim --seconds 4 --seed 7");
    for key in ["rms_slices", "p99_slices", "peak_slices", "rms_us", "p99_us", "peak_us", "time_to_lock_s"] {
        assert!(run[key].as_f64().unwrap() > 0.0, "{key}: {run}");
    }
    assert_eq!(run["planes_misplaced"], 0);
    assert!(run["planes_shown"].as_u64().unwrap() > 5760 && run["planes_dark"].as_u64().unwrap() > 0);
    assert_eq!(desk.json("sim --seconds 4 --seed 7"), run);
    assert_ne!(desk.json("sim --seconds 4 --seed 8"), run);

    let motor = include_str!("../../../hil-sim/motors/reference.toml");
    desk.write("light.toml", motor.replace("inertia_kg_m2 = 0.0045", "inertia_kg_m2 = 0.00225"));
    let light = desk.json("sim --seconds 4 --seed 7 --motor light.toml");
    assert!(light["time_to_lock_s"].as_f64() < run["time_to_lock_s"].as_f64());
    for (name, from, to, words) in [
        ("unit.toml", "inertia_kg_m2", "inertia_g_cm2", ["unit.toml", "inertia_g_cm2"]),
        ("negative.toml", "= 0.0045", "= -0.0045", ["negative.toml", "inertia_kg_m2"]),
        ("nan.toml", "= 0.45", "= nan", ["nan.toml", "max_torque_nm"]),
    ] {
        desk.write(name, motor.replace(from, to));
        desk.refuses(&format!("sim --motor {name}"), &words);
        desk.refuses(&format!("sim --scenario {name}"), &[name, "line"]);
    }
    let short = desk.json("sim --seconds 0.01");
    assert!(short["rms_slices"].is_null() && short["time_to_lock_s"].is_null(), "{short}");
    desk.refuses("sim --motor none.toml", &["none.toml", "No such file"]);
    desk.refuses("sim --scenario none.toml", &["none.toml", "No such file"]);
    desk.refuses("sim --seconds 0", &["--seconds"]);
}
