//! `praxi run`: a display that runs by itself, asked over the network.

use crate::desk::Desk;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// How long anything may take on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// A daemon, which ends with this.
pub struct Daemon {
    child: Child,
    pub address: String,
    pub token: Option<String>,
}

impl Daemon {
    /// One of a small rig, with its state below `folder`.
    pub fn start(folder: &Path, arguments: &[&str]) -> Self {
        let rig = folder.join("small.toml");
        Self::launch(folder, &[&["--rig", rig.to_str().unwrap()], arguments].concat())
    }

    /// The same of the rig that there is without any word.
    pub fn launch(folder: &Path, arguments: &[&str]) -> Self {
        Self::on_display(None, folder, arguments)
    }

    /// The same, with the X display of this name.
    pub fn on_display(display: Option<&str>, folder: &Path, arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_praxi"));
        command.args(["run", "--listen", "127.0.0.1:0", "--state-dir"]).arg(folder.join("state")).args(arguments);
        command.envs(display.map(|display| ("DISPLAY", display)));
        let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
        let mut log = BufReader::new(child.stderr.take().unwrap()).lines();
        let line = log.by_ref().map(Result::unwrap).find(|line| line.contains("http://")).unwrap();
        // Somebody must read the log, or the daemon waits for it.
        thread::spawn(move || log.for_each(drop));
        let address = line.split_once("http://").unwrap().1.trim_end_matches('/').to_string();
        Self { child, address, token: None }
    }

    /// Status and body of the answer to a request.
    pub fn ask(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> (u16, Vec<u8>) {
        let mut head = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\nContent-Length: {}\r\n", body.len());
        if !headers.iter().any(|(name, _)| *name == "Host") {
            head += &format!("Host: {}\r\n", self.address);
        }
        if let Some(token) = &self.token {
            head += &format!("Authorization: Bearer {token}\r\n");
        }
        headers.iter().for_each(|(name, value)| head += &format!("{name}: {value}\r\n"));
        self.send(&[head.as_bytes(), b"\r\n", body].concat(), false)
    }

    /// The answer to whatever `bytes` are; 0 where there was none. Whoever `ends` sends nothing after them.
    fn send(&self, bytes: &[u8], ends: bool) -> (u16, Vec<u8>) {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        // Refused in the middle is refused, too.
        let _ = stream.write_all(bytes);
        if ends {
            let _ = stream.shutdown(std::net::Shutdown::Write);
        }
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let text = String::from_utf8_lossy(&answer);
        let status = text.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
        let end = answer.windows(4).position(|four| four == b"\r\n\r\n").map_or(answer.len(), |at| at + 4);
        (status, answer[end..].to_vec())
    }

    pub fn get(&self, path: &str) -> Vec<u8> {
        let (status, body) = self.ask("GET", path, &[], &[]);
        assert_eq!(status, 200, "{path}: {}", String::from_utf8_lossy(&body));
        body
    }

    pub fn json(&self, path: &str) -> Value {
        serde_json::from_slice(&self.get(path)).unwrap()
    }

    pub fn patch(&self, patch: &Value) -> (u16, Value) {
        let (status, body) = self.ask("PATCH", "/api/v1/display", &[], patch.to_string().as_bytes());
        (status, serde_json::from_slice(&body).unwrap())
    }

    /// Waits until the telemetry is as `is` wants it.
    pub fn until(&self, what: &str, is: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        loop {
            let status = self.json("/api/v1/status");
            if is(&status["telemetry"]) {
                return status;
            }
            assert!(start.elapsed() < PATIENCE, "not {what}: {status:#}");
            thread::sleep(Duration::from_millis(50));
        }
    }

    /// Its process.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Ends it as a power cut does.
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Tells it to end, as a service manager does.
    pub fn end(mut self) -> ExitStatus {
        let id = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(id, rustix::process::Signal::TERM).unwrap();
        self.child.wait().unwrap()
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A binary glTF file of one triangle; `image` is a file that it names.
pub fn glb(image: Option<&str>) -> Vec<u8> {
    let corners: [f32; 9] = [-0.5, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0, 0.0];
    let binary: Vec<u8> = corners.iter().flat_map(|value| value.to_le_bytes()).collect();
    let mut document = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "materials": [{}],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [-0.5, 0, 0], "max": [0.5, 1, 0] }],
        "bufferViews": [{ "buffer": 0, "byteLength": 36 }], "buffers": [{ "byteLength": 36 }],
    });
    if let Some(uri) = image {
        document["images"] = json!([{ "uri": uri }]);
        document["textures"] = json!([{ "source": 0 }]);
        document["materials"] = json!([{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }]);
    }
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let word = |value: usize| (value as u32).to_le_bytes();
    let length = 12 + 8 + text.len() + 8 + binary.len();
    [b"glTF".as_slice(), &word(2), &word(length), &word(text.len()), b"JSON", &text, &word(36), b"BIN\0", &binary]
        .concat()
}

fn folder() -> TempDir {
    Desk::new().folder
}

#[test]
fn a_newcomer_sees_the_built_in_scene_and_changes_it() {
    let folder = folder();
    let daemon = Daemon::launch(folder.path(), &[]);
    assert!(String::from_utf8(daemon.get("/")).unwrap().contains("<html"));
    daemon.until("lit", |telemetry| telemetry["lit"] == true && telemetry["state"] == "locked");
    let (status, wish) = daemon.patch(&json!({ "animation": { "kind": "still" } }));
    assert_eq!((status, &wish["animation"]), (200, &json!({ "kind": "still" })));
    let delivered = daemon.json("/api/v1/status")["telemetry"]["turns_delivered"].as_u64().unwrap();
    daemon.until("still", |telemetry| telemetry["turns_delivered"].as_u64().unwrap() > delivered);
    let eye = |azimuth: u32| {
        let png = daemon.get(&format!("/api/v1/eye.png?azimuth_deg={azimuth}&pixels=64"));
        image::load_from_memory(&png).unwrap().into_luma8().into_raw()
    };
    let mean =
        |a: &[u8], b: &[u8]| a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64;
    let [front, again, side] = [eye(0), eye(0), eye(90)];
    assert!(
        mean(&front, &again) < 1.0 && mean(&front, &side) > 5.0,
        "{} {}",
        mean(&front, &again),
        mean(&front, &side)
    );
    assert_eq!(daemon.patch(&json!({ "mode": "blank" })).0, 200);
    let start = Instant::now();
    while eye(0).iter().any(|value| *value > 0) {
        assert!(start.elapsed() < PATIENCE, "it is not dark");
    }
    assert_eq!(daemon.patch(&json!({ "scene": "boxes" })).1["mode"], "scene");
    daemon.until("boxes", |telemetry| telemetry["scene"] == "boxes" && telemetry["lit"] == true);
    assert!(daemon.end().success());
}

#[test]
fn a_fault_is_told_and_an_emergency_stop_waits_for_a_start() {
    let folder = folder();
    let daemon = Daemon::start(folder.path(), &["boxes"]);
    daemon.until("locked", |telemetry| telemetry["state"] == "locked");
    let simulate = |action: &str| assert_eq!(daemon.ask("POST", "/api/v1/simulator", &[], action.as_bytes()).0, 202);
    simulate("\"emergency-stop\"");
    daemon.until("a fault", |telemetry| telemetry["fault"] == "the emergency stop is pressed");
    simulate("\"emergency-stop-released\"");
    assert_eq!(daemon.ask("POST", "/api/v1/faults/clear", &[], &[]).0, 202);
    daemon.until("idle", |telemetry| telemetry["state"] == "idle");
    assert_eq!(daemon.json("/api/v1/display")["motor"], false);
    assert_eq!(daemon.ask("POST", "/api/v1/motor/start", &[], &[]).0, 200);
    daemon.until("locked", |telemetry| telemetry["state"] == "locked");
    let events = daemon.json("/api/v1/events").to_string();
    assert!(events.contains("emergency stop") && events.contains("the fault is over"), "{events}");
    let figures = String::from_utf8(daemon.get("/metrics")).unwrap();
    assert!(figures.contains("praxi_faults_total{fault=\"EmergencyStop\"} 1"), "{figures}");
}

#[test]
fn what_goes_by_itself_is_told_afterwards() {
    let folder = folder();
    let daemon = Daemon::start(folder.path(), &["boxes"]);
    daemon.until("lit", |telemetry| telemetry["lit"] == true);
    let missing = br#"{"no-frame-pulses": {"seconds": 1}}"#;
    assert_eq!(daemon.ask("POST", "/api/v1/simulator", &[], missing).0, 202);
    let start = Instant::now();
    while !daemon.json("/api/v1/events").to_string().contains("in step again after") {
        assert!(start.elapsed() < PATIENCE);
    }
    assert!(daemon.json("/api/v1/events").to_string().contains("pulses are missing"));
}

#[test]
fn a_scene_without_the_clip_of_the_one_before_stands_still() {
    let folder = folder();
    let daemon = Daemon::start(folder.path(), &["boxes"]);
    let (_, wish) = daemon.patch(&json!({ "animation": { "kind": "clip", "name": "Walk", "speed": 1 } }));
    assert_eq!(wish["animation"]["name"], "Walk");
    daemon.until("why not", |telemetry| telemetry["scene_error"].is_string());
    daemon.patch(&json!({ "scene": "knot-5k" }));
    let telemetry = daemon.until("the knot", |telemetry| telemetry["scene"] == "knot-5k" && telemetry["lit"] == true);
    assert!(telemetry["telemetry"]["scene_error"].is_null());
    assert_eq!(daemon.json("/api/v1/display")["animation"], json!({ "kind": "still" }));
}

#[test]
fn reasons_name_the_key_and_what_is_allowed() {
    let folder = folder();
    fs::write(folder.path().join("praxi.toml"), "[upload]\nbytes_max = 1000").unwrap();
    let config = folder.path().join("praxi.toml");
    let daemon = Daemon::start(folder.path(), &["--config", config.to_str().unwrap()]);
    let many: Vec<_> = (0..10).map(|id| json!({ "id": id, "position_m": [0.0, 0.35, 0.9] })).collect();
    for (method, path, body, words) in [
        ("PATCH", "display", r#"{"budget_px": "x"}"#.into(), ["budget_px", "expected f64"]),
        ("PATCH", "display", "[]".into(), ["expected an object", "budget_px"]),
        ("PATCH", "display", r#"{"transform": {"move_m": [5, 0, 0]}}"#.into(), ["transform.move_m", "in metres"]),
        (
            "POST",
            "viewers",
            r#"[{"id": 0, "position_m": [100, 0, 0]}]"#.into(),
            ["viewer 0", "0.2 to 6 m from the axis"],
        ),
        ("POST", "viewers", json!(many).to_string(), ["viewer 8 at", "viewer 9 at"]),
        ("PUT", "scenes/large", "x".repeat(2_000), ["at most 1000 bytes", "too large"]),
        ("PATCH", "display", "x".repeat(70_000), ["at most 65536 bytes", "too large"]),
        ("DELETE", "scenes/boxes", String::new(), ["boxes", "only those can be deleted"]),
        ("DELETE", "scenes/builtin", String::new(), ["builtin", "only those can be deleted"]),
        ("POST", "status", String::new(), ["method", "openapi.json"]),
    ] {
        let (status, answer) = daemon.ask(method, &format!("/api/v1/{path}"), &[], body.as_bytes());
        let error = serde_json::from_slice::<Value>(&answer).unwrap()["error"].to_string();
        assert!(
            (400..500).contains(&status) && words.iter().all(|word| error.contains(word)),
            "{path}: {status} {error}"
        );
    }
}

#[test]
fn what_was_wished_for_outlives_the_daemon() {
    let folder = folder();
    let daemon = Daemon::start(folder.path(), &["boxes"]);
    let (status, body) = daemon.ask("PUT", "/api/v1/scenes/mine", &[], &glb(None));
    assert_eq!(status, 201, "{}", String::from_utf8_lossy(&body));
    let wish = json!({ "scene": "mine", "budget_px": 1.5, "transform": { "yaw_deg": 20.0 }, "motor": false });
    let (_, wish) = daemon.patch(&wish);
    daemon.until("mine", |telemetry| telemetry["scene"] == "mine");
    assert!(daemon.end().success());
    let daemon = Daemon::start(folder.path(), &[]);
    assert_eq!(daemon.json("/api/v1/display"), wish);
    daemon.until("mine", |telemetry| telemetry["scene"] == "mine" && telemetry["state"] == "idle");
    assert_eq!(daemon.ask("DELETE", "/api/v1/scenes/mine", &[], &[]).0, 409);
    assert!(daemon.end().success());
    fs::remove_file(folder.path().join("state/scenes/mine.glb")).unwrap();
    let daemon = Daemon::start(folder.path(), &[]);
    assert_eq!(daemon.json("/api/v1/display")["scene"], "builtin");
    assert!(daemon.json("/api/v1/events").to_string().contains("mine that was shown last is not there any more"));
    assert_eq!(daemon.ask("PUT", "/api/v1/scenes/mine", &[], &glb(None)).0, 201);
    assert_eq!(daemon.ask("DELETE", "/api/v1/scenes/mine", &[], &[]).0, 204);
    let other = Command::new(env!("CARGO_BIN_EXE_praxi"))
        .args(["run", "--listen", "127.0.0.1:0", "--state-dir"])
        .arg(folder.path().join("state"))
        .output()
        .unwrap();
    assert_eq!(other.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&other.stderr).contains("another praxi run has it"));
}

#[test]
fn whoever_has_no_token_stays_out() {
    let folder = folder();
    let token = "0123456789abcdef0123456789abcdef";
    fs::write(folder.path().join("token"), token).unwrap();
    let config = folder.path().join("praxi.toml");
    fs::write(&config, format!("token_file = {:?}\n", folder.path().join("token"))).unwrap();
    let mut daemon = Daemon::start(folder.path(), &["--config", config.to_str().unwrap()]);
    let status = |daemon: &Daemon, path: &str| daemon.ask("GET", path, &[], &[]).0;
    assert_eq!(["/", "/healthz"].map(|path| status(&daemon, path)), [200, 200]);
    for path in ["/api/v1/status", "/metrics", "/openapi.json", "/api/v1/telemetry", "/nothing"] {
        assert_eq!(status(&daemon, path), 401, "{path}");
    }
    for wrong in ["", "0123456789abcdef", "0123456789abcdef0123456789abcdee", "0123456789abcdef0123456789abcdef0"] {
        daemon.token = Some(wrong.into());
        assert_eq!(status(&daemon, "/api/v1/status"), 401, "{wrong}");
    }
    let lower = format!("bearer {token}");
    daemon.token = None;
    assert_eq!(daemon.ask("GET", "/api/v1/status", &[("Authorization", &lower)], &[]).0, 200);
    daemon.token = Some(token.into());
    assert_eq!(status(&daemon, "/api/v1/status"), 200);
}

#[test]
fn pages_from_elsewhere_give_no_orders() {
    let folder = folder();
    let daemon = Daemon::start(folder.path(), &["boxes"]);
    let stop = |headers: &[(&str, &str)]| daemon.ask("POST", "/api/v1/motor/stop", headers, &[]).0;
    assert_eq!(stop(&[("Host", "evil.example:7117")]), 403);
    assert_eq!(stop(&[("Origin", "http://evil.example")]), 403);
    assert_eq!(stop(&[("Origin", "null")]), 403);
    assert_eq!(daemon.json("/api/v1/display")["motor"], true);
    assert_eq!(stop(&[("Origin", &format!("http://{}", daemon.address))]), 200);
}

/// Seeded: `wrong` requests, each one of many kinds.
pub fn nonsense(random: &mut ChaCha8Rng, kind: u32) -> (&'static str, String, Vec<u8>) {
    let bytes = |random: &mut ChaCha8Rng, most: usize| {
        let mut bytes = vec![0; random.random_range(0..most)];
        random.fill_bytes(&mut bytes);
        bytes
    };
    let display = || "/api/v1/display".to_string();
    match kind % 8 {
        0 => ("PATCH", display(), bytes(random, 300)),
        1 => ("PATCH", display(), format!("{}1{}", "[".repeat(20_000), "]".repeat(20_000)).into_bytes()),
        2 => ("PATCH", display(), vec![b' '; 70_000 + random.random_range(0..200_000)]),
        3 => {
            let key = ["budget_px", "scene", "mode", "transform", "animation", "halftone", "motor", "extra"];
            let value = ["null", "-1e999", "[]", "{\"x\":1}", "\"\\u0000\"", "1e300", "\"../../etc/passwd\"", "true1"];
            let [key, value] = [key, value].map(|list| list[random.random_range(0..list.len())]);
            (
                "PATCH",
                display(),
                format!("{{\"{key}\":{value}}}")
                    .replace("\"motor\":null", "\"motor\":7")
                    .replace("\"extra\":null", "\"extra\":7")
                    .into_bytes(),
            )
        }
        4 => {
            let mut file = glb(None);
            for _ in 0..random.random_range(1..12) {
                let place = random.random_range(0..file.len());
                file[place] = random.random_range(0..=255);
            }
            file.truncate(random.random_range(0..file.len()));
            ("PUT", "/api/v1/scenes/fuzzed".into(), file)
        }
        5 => {
            let names = ["..%2f..%2fx", "%2e%2e", "a%00b", "a%2fb", "%ff", "x.glb", "", "builtin"];
            ("PUT", format!("/api/v1/scenes/{}", names[random.random_range(0..names.len())]), glb(None))
        }
        6 => {
            let places = ["pixels=1000000", "azimuth_deg=nan", "distance_m=-1", "height_m=1e9", "what=1", "pixels=-1"];
            ("GET", format!("/api/v1/eye.png?{}", places[random.random_range(0..places.len())]), Vec::new())
        }
        _ => {
            let actions = ["\"explode\"", "{\"load\":{\"torque_nm\":1e9}}", "{\"load\":1}", "", "7"];
            ("POST", "/api/v1/simulator".into(), actions[random.random_range(0..actions.len())].into())
        }
    }
}

#[test]
fn five_hundred_malformed_requests_change_a_counter() {
    let folder = folder();
    fs::write(folder.path().join("secret.png"), "secret").unwrap();
    let daemon = Daemon::start(folder.path(), &["boxes"]);
    daemon.until("lit", |telemetry| telemetry["lit"] == true);
    let before = [daemon.json("/api/v1/display"), daemon.json("/api/v1/scenes")];
    let mut random = ChaCha8Rng::seed_from_u64(7);
    for kind in 0..460 {
        let (method, path, body) = nonsense(&mut random, kind);
        let (status, answer) = daemon.ask(method, &path, &[], &body);
        let answer = String::from_utf8_lossy(&answer);
        assert!((400..500).contains(&status), "{method} {path} {}: {status} {answer}", String::from_utf8_lossy(&body));
    }
    for _ in 0..40 {
        let mut bytes = vec![0; random.random_range(1..2_000)];
        random.fill_bytes(&mut bytes);
        let (status, _) = daemon.send(&bytes, true);
        assert!(status == 0 || (400..500).contains(&status), "{status}");
    }
    let (status, answer) = daemon.ask("PUT", "/api/v1/scenes/thief", &[], &glb(Some("../../secret.png")));
    let answer = String::from_utf8(answer).unwrap();
    assert!(status == 400 && answer.contains("must hold everything itself"), "{status} {answer}");
    assert_eq!([daemon.json("/api/v1/display"), daemon.json("/api/v1/scenes")], before);
    let left: Vec<_> = fs::read_dir(folder.path().join("state/scenes")).unwrap().collect();
    assert!(left.is_empty(), "{left:?}");
    let figures = String::from_utf8(daemon.get("/metrics")).unwrap();
    let refused =
        figures.lines().find_map(|line| line.strip_prefix("praxi_refused_requests_total{reason=\"request\"} "));
    assert!(refused.unwrap().parse::<u32>().unwrap() >= 460, "{figures}");
    daemon.until("lit", |telemetry| telemetry["lit"] == true);
    assert!(daemon.end().success());
}

#[test]
fn the_interface_describes_itself() {
    let folder = folder();
    let daemon = Daemon::start(folder.path(), &["boxes"]);
    let document = daemon.json("/openapi.json");
    let paths: Vec<_> = document["paths"].as_object().unwrap().keys().cloned().collect();
    for path in
        ["status", "display", "scenes", "scenes/{name}", "motor/{order}", "faults/clear", "telemetry", "eye.png"]
    {
        assert!(paths.contains(&format!("/api/v1/{path}")), "{path}: {paths:?}");
    }
    assert!(document["components"]["schemas"]["Wish"]["properties"]["budget_px"].is_object());
}

#[test]
fn a_configuration_is_checked() {
    let desk = Desk::new();
    desk.refuses("run --check --device sum", &["sum", "sim:usb"]);
    desk.refuses("run --check --rig nowhere", &["nowhere", "reference"]);
    desk.refuses("run --check --listen 0.0.0.0:7117", &["token_file", "127.0.0.1"]);
    desk.refuses("run --check --config nowhere.toml", &["nowhere.toml"]);
    desk.refuses("run --check nowhere.glb", &["nowhere.glb"]);
    desk.refuses("run --check nowhere --state-dir state", &["nowhere", "no such scene"]);
    assert!(!desk.path("state").exists());
    desk.refuses("run --check --listen 127.0.0.1", &["ADDR:PORT", "127.0.0.1:7117"]);
    fs::write(desk.path("praxi.toml"), "listen = \"1.2.3\"").unwrap();
    desk.refuses("run --check --config praxi.toml", &["praxi.toml", "listen = 1.2.3", "127.0.0.1:7117"]);
    fs::write(desk.path("file"), "").unwrap();
    desk.refuses("run --state-dir file", &["file", "is no folder"]);
    fs::write(desk.path("praxi.toml"), "[render]\nbudget = 1").unwrap();
    desk.refuses("run --check --config praxi.toml", &["praxi.toml", "line 2", "budget"]);
}
