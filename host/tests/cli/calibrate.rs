//! `praxi calibrate`: clicks to a rig.

use crate::desk::Desk;
use serde_json::Value;
use std::fs;

const REFERENCE: &str = include_str!("../../rigs/reference.toml");

/// A desk with a rig that leans by 2° more than the reference rig and stands 5 mm off, and clicks on it.
fn desk() -> Desk {
    let desk = Desk::new();
    let built = REFERENCE.replace("tilt_deg = 45.0", "tilt_deg = 47.0").replace("offset_m = 0.0 ", "offset_m = 0.005 ");
    desk.write("built.toml", built);
    let clicks = desk.run("calibrate --simulate --rig built.toml --noise-px 0.2 --seed 3").stdout;
    desk.write("clicks.csv", clicks);
    desk
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

#[test]
fn a_rig_is_found_and_written_with_all_that_it_said() {
    let desk = desk();
    let found = desk.json("calibrate clicks.csv --rig reference --write calibrated.toml");
    assert!(number(&found["rms_px"]) < 0.5 && number(&found["picture_px"]) < 0.5, "{found}");
    assert_eq!((found["clicks"].as_array().unwrap().len(), found["left_out"].as_array().unwrap().len()), (10, 0));
    let text = fs::read_to_string(desk.path("calibrated.toml")).unwrap();
    for line in REFERENCE
        .lines()
        .filter(|line| line.starts_with('#') || line.contains("distance_m") || line.contains("refresh"))
    {
        assert!(text.lines().any(|kept| kept == line), "{line}");
    }
    let rig = protocol::rig::Rig::parse(&text).unwrap();
    let face = &rig.mirror.face[0];
    assert!((face.tilt_deg - 47.0).abs() < 0.1 && (face.offset_m - 0.005).abs() < 2e-4, "{face:?}");
    // What it wrote is a rig to start from again, and comes to the same.
    let again = desk.json("calibrate clicks.csv --rig calibrated.toml --write calibrated.toml");
    for (a, b) in found["parameters"].as_array().unwrap().iter().zip(again["parameters"].as_array().unwrap()) {
        let close =
            a["found"].is_null() || (number(&a["found"]) - number(&b["found"])).abs() < 0.01 * number(&a["uncertain"]);
        assert!(close, "{a} {b}");
    }
    let words = String::from_utf8(desk.run("calibrate clicks.csv --rig reference").stdout).unwrap();
    assert!(words.contains("10 clicks, ") && words.contains("tilt of face 0 (deg)") && words.contains("matrix = ["));
    assert!(words.lines().all(|line| line.chars().count() <= 80), "{words}");
}

#[test]
fn a_wrong_click_is_left_out_and_said() {
    let desk = desk();
    let clicks = fs::read_to_string(desk.path("clicks.csv")).unwrap();
    let mut lines: Vec<String> = clicks.lines().map(str::to_string).collect();
    let (u, rest) = lines[3].split_once(',').unwrap();
    lines[3] = format!("{},{rest}", u.parse::<f64>().unwrap() - 30.0);
    desk.write("clicks.csv", lines.join("\n"));
    let warned = desk.warnings("calibrate clicks.csv --rig reference");
    assert!(warned.contains("clicks.csv: line 4 is") && warned.contains("left out"), "{warned}");
}

#[test]
fn bad_clicks_are_refused_in_a_line_and_nothing_is_written() {
    let desk = desk();
    let clicks = fs::read_to_string(desk.path("clicks.csv")).unwrap();
    let head = clicks.lines().next().unwrap();
    desk.write("swapped.csv", clicks.replacen("u_px,v_px", "v_px,u_px", 1));
    desk.write("few.csv", clicks.lines().take(5).collect::<Vec<_>>().join("\n"));
    let one_stop: Vec<_> = clicks.lines().filter(|line| *line == head || line.ends_with(",0,")).collect();
    let twice: Vec<_> = one_stop.iter().chain(&one_stop[1..]).copied().collect();
    desk.write("flat.csv", twice.join("\n"));
    desk.write(
        "metres.csv",
        clicks
            .replacen("across_m,slope_m", "slope_m,across_m", 1)
            .replacen("u_px", "x_m", 1)
            .replacen(",x_m", ",u_px", 1),
    );
    desk.write("notes.txt", "mine");
    for (file, words) in [
        ("swapped.csv", "mirrored image"),
        ("few.csv", "4 clicks: must be at least 6"),
        ("flat.csv", "one plane: click them at a second stop"),
        ("metres.csv", "line 2: "),
        ("nowhere.csv", "nowhere.csv"),
    ] {
        desk.refuses(&format!("calibrate {file} --rig reference --write out.toml"), &[words]);
        assert!(!desk.path("out.toml").exists());
    }
    desk.refuses("calibrate clicks.csv --rig reference --write notes.txt", &["notes.txt is there and no rig file"]);
    assert_eq!(fs::read_to_string(desk.path("notes.txt")).unwrap(), "mine");
    desk.refuses("calibrate clicks.csv --rig reference --within-px 0.01", &["disagree by", "allowed are 0.01"]);
}
