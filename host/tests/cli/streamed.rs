//! `praxi stream` and `praxi order`.

use crate::desk::Desk;
use serde_json::Value;
use std::process::{Command, Stdio};
use std::time::Duration;

#[test]
fn turns_are_streamed_and_every_one_is_accounted_for() {
    let desk = Desk::new();
    let run = desk.run("stream boxes --device sim --rig small.toml --animate spin --turns 30 --json");
    let text = String::from_utf8(run.stdout).unwrap();
    assert_eq!(run.status.code(), Some(0), "{text}");
    let end: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    let number = |name: &str| end[name].as_u64().unwrap();
    let dropped = |name: &str| end["dropped"][name].as_u64().unwrap();
    assert_eq!((end["end"].as_bool(), number("turns")), (Some(true), 30), "{end}");
    let before = dropped("replaced") + dropped("late") + dropped("failed");
    assert_eq!(dropped("all"), before + dropped("passed_over"));
    // One may be on its way, and one may lie there, when there are enough.
    assert!((30..=32).contains(&(number("turns_rendered") - before)), "{end}");
    assert_eq!(number("turns_shown") + dropped("passed_over"), 30, "{end}");
    assert!(number("bytes_raw") > number("bytes_on_wire"), "{end}");
    assert!(end["phase_error_slices"].as_f64().unwrap().abs() < 1.0, "{end}");
}

#[test]
fn a_turn_that_takes_long_is_watched() {
    let desk = Desk::new();
    // A turn of some 11 kB, 3,840 bytes a second.
    let run =
        desk.run("stream boxes --device sim:serial@38400 --halftone white-noise --rig small.toml --turns 1 --json");
    let text = String::from_utf8(run.stdout).unwrap();
    assert_eq!(run.status.code(), Some(0), "{text}");
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let under_way = |line: &&Value| {
        let planes = line["turn_under_way"]["planes"].as_u64().unwrap_or(0);
        line["turns"] == 0 && (1..48).contains(&planes) && line["bytes_per_second"].as_f64() > Some(0.0)
    };
    assert!(lines.iter().filter(under_way).count() >= 2, "{text}");
    let end = lines.last().unwrap();
    assert_eq!((&end["turns"], &end["error"]), (&1.into(), &Value::Null));
    assert!(end["simulated_seconds"].as_f64() <= end["seconds"].as_f64(), "{end}");
}

#[test]
fn a_stream_without_its_device_is_summed_up() {
    let desk = Desk::new();
    for is_json in [true, false] {
        let mut served = crate::devices::Served::at(3_000_000);
        let (path, json) = (served.path.clone(), if is_json { "--json" } else { "--seed=1" });
        let mut stream = Command::new(env!("CARGO_BIN_EXE_praxi"));
        stream.args(["stream", "boxes", "--rig", "small.toml", "--animate", "spin", "--look-for-s", "0.2", json]);
        stream.args(["--device", &path]).current_dir(&desk.folder).stdout(Stdio::piped()).stderr(Stdio::piped());
        let stream = stream.spawn().unwrap();
        served.next("opened");
        // Until the mirror is in step, which nothing here tells of.
        std::thread::sleep(Duration::from_secs(8));
        drop(served);
        let output = stream.wait_with_output().unwrap();
        let (said, error) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
        assert_eq!(output.status.code(), Some(2), "{said}{error}");
        let last = error.lines().last().unwrap();
        assert!(last.starts_with("praxi: error: ") && last.matches(&path).count() == 1, "{error}");
        if is_json {
            let end: Value = serde_json::from_str(said.lines().last().unwrap()).unwrap();
            assert_eq!(end["end"], true, "{end}");
            assert!(last.ends_with(end["error"].as_str().unwrap()), "{end}");
        } else {
            assert!(said.contains("turns    ") && said.contains("wire     "), "{said}{error}");
        }
    }
}

/// A triangle that a clip moves to and fro.
const MOVING: &str = r#"{"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"scene":0,"nodes":[{"mesh":0}],
  "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"buffers":[{"uri":"moving.bin","byteLength":68}],
  "bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":8},{"buffer":0,"byteOffset":44,"byteLength":24}],
  "accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":3,"min":[0,0,0],"max":[0.03,0.03,0]},
    {"bufferView":1,"componentType":5126,"type":"SCALAR","count":2,"min":[0],"max":[1]},
    {"bufferView":2,"componentType":5126,"type":"VEC3","count":2}],
  "animations":[{"name":"Slide","channels":[{"sampler":0,"target":{"node":0,"path":"translation"}}],
    "samplers":[{"input":1,"output":2}]}]}"#;

#[test]
fn a_scene_without_the_clip_stands_still_beside_one_that_has_it() {
    let desk = Desk::new();
    let numbers: [f32; 17] = [0.0, 0.0, 0.0, 0.03, 0.0, 0.0, 0.0, 0.03, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0];
    desk.write("moving.bin", numbers.map(f32::to_le_bytes).concat());
    desk.write("moving.gltf", MOVING);
    let both = "stream boxes moving.gltf --device sim --rig small.toml --hold 3 --turns 8 --animate clip";
    let said = desk.warnings(both);
    assert!(said.contains("boxes: no clip: it has none: stands still"), "{said}");
    desk.refuses(&format!("{both} --clip Walk"), &["no clip Walk"]);
}

#[test]
fn a_picture_that_stands_still_is_rendered_and_sent_once() {
    let desk = Desk::new();
    let run = desk.run("stream boxes --device sim --rig small.toml --turns 12 --at-end stop --standby attract");
    let text = String::from_utf8(run.stdout).unwrap();
    assert_eq!(run.status.code(), Some(0), "{text}");
    assert!(text.contains("clock    all seconds are the wall's"), "{text}");
    assert!(text.contains("planes stayed") && text.contains("turns    12 sent"), "{text}");
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    let order = desk.run("order stop --device sim");
    assert_eq!(String::from_utf8(order.stdout).unwrap(), "sim: idle\n");
}

#[test]
fn what_cannot_be_streamed_is_refused_in_one_line() {
    let desk = Desk::new();
    desk.refuses("stream boxes --device usb:ffff:fffe", &["usb:ffff:fffe"]);
    desk.refuses("stream boxes --device /dev/tty-of-nobody", &["/dev/tty-of-nobody"]);
    desk.refuses("stream boxes --device lpt1", &["lpt1", "allowed"]);
    desk.refuses("stream nowhere.glb --device sim", &["nowhere.glb"]);
    desk.refuses("stream boxes --device sim --animate clip", &["boxes", "no clip", "it has none"]);
    desk.refuses("stream boxes --device sim --turns 0", &["--turns"]);
    desk.refuses("stream boxes --device sim --halftone grey", &["grey"]);
    desk.refuses("stream --device sim", &["SCENE"]);
    desk.refuses("order shift-phase --device sim --degrees 200", &["180"]);
    desk.refuses("order shift-phase --device sim", &["--degrees"]);
    desk.refuses("stream boxes --device sim --clip Walk", &["--animate"]);
}
