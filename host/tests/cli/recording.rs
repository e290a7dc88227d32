//! `praxi record` and `praxi replay`: what happened to a display, told again.

use crate::daemon::Daemon;
use crate::desk::Desk;
use serde_json::{Value, json};
use std::fs;
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::Duration;

/// A command line that goes on.
fn begin(desk: &Desk, arguments: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_praxi"));
    command.args(arguments).current_dir(&desk.folder).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn end(child: Child) -> Output {
    let id = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(id, rustix::process::Signal::INT).unwrap();
    child.wait_with_output().unwrap()
}

/// Viewer `id` walks around for a second, and is told of where nobody can be, too.
fn walk(daemon: &Daemon, id: u8) {
    for step in 0..30 {
        let angle = 0.02 * f64::from(step);
        let here = json!([{ "id": id, "position_m": [0.8 * angle.sin(), 0.4, 0.8 * angle.cos()] }]);
        assert_eq!(daemon.ask("POST", "/api/v1/viewers", &[], here.to_string().as_bytes()).0, 202);
        thread::sleep(Duration::from_millis(30));
    }
    let nowhere = json!([{ "id": id, "position_m": [0.0, 90.0, 0.0] }]);
    assert_eq!(daemon.ask("POST", "/api/v1/viewers", &[], nowhere.to_string().as_bytes()).0, 400);
}

fn url(daemon: &Daemon) -> String {
    format!("http://{}", daemon.address)
}

fn replay(desk: &Desk, file: &str, code: i32) -> Value {
    let output = desk.run(&format!("replay {file} --json"));
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(code), "{text} {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn what_happened_happens_again() {
    let desk = Desk::new();
    let daemon = Daemon::start(desk.folder.path(), &["boxes"]);
    // The recording begins in the middle.
    daemon.until("lit", |telemetry| telemetry["lit"] == true && telemetry["state"] == "locked");
    let child = begin(&desk, &["record", "a.mcap", "--from", &url(&daemon)]);
    thread::sleep(Duration::from_millis(700));
    walk(&daemon, 1);
    daemon.patch(&json!({ "transform": { "yaw_deg": 20.0 }, "halftone": "bayer" }));
    walk(&daemon, 2);
    daemon.patch(&json!({ "scene": "knot-5k", "animation": { "kind": "still" } }));
    daemon.until("the knot", |telemetry| telemetry["scene"] == "knot-5k");
    walk(&daemon, 3);
    let simulate = |action: &str| assert_eq!(daemon.ask("POST", "/api/v1/simulator", &[], action.as_bytes()).0, 202);
    simulate("\"emergency-stop\"");
    daemon.until("a fault", |telemetry| telemetry["fault"] != Value::Null);
    simulate("\"emergency-stop-released\"");
    thread::sleep(Duration::from_millis(500));
    assert_eq!(daemon.ask("POST", "/api/v1/faults/clear", &[], &[]).0, 202);
    daemon.until("idle", |telemetry| telemetry["state"] == "idle");
    thread::sleep(Duration::from_millis(700));
    let output = end(child);
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && said.contains(" turns, ") && said.contains("a.mcap"), "{said}");
    assert!(daemon.end().success());

    let report = replay(&desk, "a.mcap", 0);
    let count = |part: &str| report[part]["count"].as_u64().unwrap();
    assert!(count("turns") > 30 && count("readings") == 93 && count("viewers") > 30, "{report:#}");
    // Locked, the fault, idle.
    assert_eq!((count("controller"), &report["is_cut"]), (3, &json!(false)), "{report:#}");
    let text = String::from_utf8(desk.run("replay a.mcap").stdout).unwrap();
    assert!(text.contains("93 of 93 as recorded") && text.lines().all(|line| line.chars().count() <= 80), "{text}");

    // Cut off in the middle it is told as far as it goes.
    let bytes = fs::read(desk.path("a.mcap")).unwrap();
    desk.write("cut.mcap", &bytes[..2 * bytes.len() / 3]);
    let report = replay(&desk, "cut.mcap", 0);
    assert_eq!(report["is_cut"], true);
    assert!(report["turns"]["count"].as_u64().unwrap() > 10, "{report:#}");
}

#[test]
fn a_recording_of_some_seconds_ends_by_itself() {
    let desk = Desk::new();
    let mut daemon = Daemon::start(desk.folder.path(), &["boxes"]);
    let counts = desk.json(&format!("record a.mcap --seconds 1 --from {}", url(&daemon)));
    assert!(counts["seconds"].as_f64() > Some(0.5) && counts["lost"] == 0, "{counts}");
    assert!(!fs::read(desk.path("a.mcap")).unwrap().is_empty());
    assert_eq!(replay(&desk, "a.mcap", 0)["is_cut"], false);
    // As a browser takes it.
    let bytes = daemon.get("/api/v1/recording.mcap?seconds=0.5");
    assert!(bytes.windows(8).any(|part| part == b"\x89MCAP0\r\n"));
    // The file stays; what is asked for must make sense.
    desk.refuses(&format!("record a.mcap --from {}", url(&daemon)), &["a.mcap", "is there"]);
    desk.refuses(&format!("record b.mcap --seconds 0 --from {}", url(&daemon)), &["0.1 to 604800"]);
    #[cfg(target_os = "linux")]
    desk.refuses(&format!("record /dev/full --seconds 3 --from {}", url(&daemon)), &["/dev/full", "make room there"]);
    // Somebody who lost the daemon has what came until then.
    let child = begin(&desk, &["record", "c.mcap", "--from", &url(&daemon)]);
    thread::sleep(Duration::from_millis(1_500));
    daemon.kill();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("what came until then is in c.mcap"));
    replay(&desk, "c.mcap", 0);
    desk.refuses(&format!("record d.mcap --from {}", url(&daemon)), &["does praxi run run there?"]);
}

#[test]
fn no_recording_is_told() {
    let desk = Desk::new();
    desk.write("empty.mcap", "");
    desk.write("text.mcap", "no recording at all, but some text that is long enough");
    desk.refuses("replay empty.mcap", &["empty.mcap", "no recording"]);
    desk.refuses("replay text.mcap", &["text.mcap", "no recording"]);
    desk.refuses("replay nothing.mcap", &["nothing.mcap"]);
    desk.refuses("replay .", &["not a regular file"]);
}
