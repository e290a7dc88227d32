//! Everything at once: a daemon on the simulated rig whose viewers walk, whose operator changes what is shown, whose network talks nonsense,
//! and whose controller fails. `tests/soak --everything MINUTES` does it for so long, on the reference rig.

use crate::daemon::{Daemon, PATIENCE, glb, nonsense};
use crate::desk::Desk;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Memory may grow by so much from the middle third of the run to the last: first it fills with what is kept, and the heap with gaps between turns.
const MEMORY: f64 = 0.05;
/// Shorter runs still fill what fills up.
const MEMORY_MINUTES: u64 = 10;

/// What happens to the controller: its name, what is done, and what undoes it; whether it must become a fault.
fn incidents() -> Vec<(&'static str, Value, Option<Value>, bool)> {
    let plain = |name: &'static str| (name, json!(name), None, false);
    let lasting = |name: &'static str, seconds: f64| (name, json!({ name: { "seconds": seconds } }), None, false);
    vec![
        ("emergency-stop", json!("emergency-stop"), Some(json!("emergency-stop-released")), true),
        ("guard-opened", json!("guard-opened"), Some(json!("guard-closed")), true),
        plain("extra-frame-pulse"),
        plain("extra-plane-pulse"),
        plain("extra-index-pulse"),
        ("lose-frame-pulses", json!({ "lose-frame-pulses": { "count": 3 } }), None, false),
        ("lose-index-pulses", json!({ "lose-index-pulses": { "count": 2 } }), None, false),
        ("encoder-slip", json!({ "encoder-slip": { "counts": 40 } }), None, false),
        lasting("no-frame-pulses", 1.0),
        lasting("no-index-pulses", 1.0),
        lasting("encoder-frozen", 0.5),
        lasting("doubled-pulses", 0.5),
        (
            "hand on the mirror",
            json!({ "load": { "torque_nm": -0.2 } }),
            Some(json!({ "load": { "torque_nm": 0.0 } })),
            false,
        ),
        (
            "supply sags",
            json!({ "torque-limit": { "share": 0.1 } }),
            Some(json!({ "torque-limit": { "share": 1.0 } })),
            false,
        ),
        (
            "pulses scatter",
            json!({ "pulse-jitter": { "us": 30.0 } }),
            Some(json!({ "pulse-jitter": { "us": 2.0 } })),
            false,
        ),
    ]
}

/// A port that nobody has.
fn port() -> u16 {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// Somebody walks around with opentrack's tracker, which is not always well, beside a camera that talks nonsense.
fn walk([opentrack, freed]: [u16; 2], ends: &AtomicBool) {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let start = Instant::now();
    while !ends.load(Ordering::Relaxed) {
        let seconds = start.elapsed().as_secs_f64();
        let (sin, cos) = (0.3 * seconds).sin_cos();
        // Centimetres and degrees.
        let pose = [80.0 * sin, 40.0 + 10.0 * seconds.sin(), 80.0 * cos, 0.0, 0.0, 0.0];
        let mut bytes: Vec<u8> = pose.iter().flat_map(|number: &f64| number.to_le_bytes()).collect();
        if random.random_bool(0.1) {
            bytes.resize(random.random_range(0..3_000), 0);
            random.fill_bytes(&mut bytes);
        }
        let _ = socket.send_to(&bytes, ("127.0.0.1", opentrack));
        let mut packet = vec![0; random.random_range(0..60)];
        random.fill_bytes(&mut packet);
        let _ = socket.send_to(&packet, ("127.0.0.1", freed));
        thread::sleep(Duration::from_millis(16));
    }
}

struct Run {
    daemon: Daemon,
    random: ChaCha8Rng,
    counts: BTreeMap<&'static str, u64>,
    resident: Vec<f64>,
    longest: f64,
}

impl Run {
    fn count(&mut self, what: &'static str) {
        *self.counts.entry(what).or_default() += 1;
    }

    fn ask(&self, method: &str, path: &str, body: &[u8], expected: u16) {
        let (status, answer) = self.daemon.ask(method, path, &[], body);
        assert_eq!(status, expected, "{method} {path}: {}", String::from_utf8_lossy(&answer));
    }

    fn change(&mut self) {
        let random = &mut self.random;
        let mut one = |of: &[Value]| of[random.random_range(0..of.len())].clone();
        let patch = match one(&[0, 1, 2, 3, 4].map(Value::from)).as_u64() {
            Some(0) => json!({ "scene": one(&["builtin", "boxes", "knot-5k", "mine"].map(Value::from)) }),
            Some(1) => json!({ "animation": one(&[
                json!({ "kind": "still" }), json!({ "kind": "spin", "degrees_per_turn": 2.0 }),
                json!({ "kind": "spin", "degrees_per_turn": -7.5 }),
            ]) }),
            Some(2) => json!({ "mode": one(&["scene", "blank", "freeze", "pattern"].map(Value::from)),
                "pattern": one(&["grid", "numbers", "markers", "cross-hairs"].map(Value::from)) }),
            Some(3) => json!({ "budget_px": one(&[0.2, 0.5, 3.0].map(Value::from)),
                "halftone": one(&["blue-noise", "bayer", "optimised-diffusion"].map(Value::from)) }),
            _ => {
                json!({ "transform": { "yaw_deg": one(&[0.0, 30.0, -170.0].map(Value::from)), "scale": one(&[0.5, 1.0].map(Value::from)) } })
            }
        };
        self.ask("PATCH", "/api/v1/display", patch.to_string().as_bytes(), 200);
        self.count("changes");
    }

    fn look(&mut self) {
        let azimuth = self.random.random_range(0..360);
        let png = self.daemon.get(&format!("/api/v1/eye.png?azimuth_deg={azimuth}&pixels=128"));
        assert!(png.starts_with(b"\x89PNG"));
        assert!(self.daemon.get("/api/v1/ring.png").starts_with(b"\x89PNG"));
        assert!(String::from_utf8(self.daemon.get("/metrics")).unwrap().contains("praxi_turns_total"));
        assert_eq!(self.daemon.json("/healthz")["alive"], true);
        self.count("looks");
    }

    fn talk_nonsense(&mut self) {
        for kind in 0..8 {
            let (method, path, body) = nonsense(&mut self.random, kind);
            let (status, _) = self.daemon.ask(method, &path, &[], &body);
            assert!((400..500).contains(&status), "{method} {path}: {status}");
        }
        self.count("refusals");
    }

    fn record(&mut self) {
        let bytes = self.daemon.get("/api/v1/recording.mcap?seconds=1");
        assert!(bytes.windows(5).any(|part| part == b"\x89MCAP"));
        self.count("recordings");
    }

    /// Something happens to the controller; it gets over it, or stands with its cause until it is cleared.
    fn fail(&mut self, incident: usize) {
        let incidents = incidents();
        let (name, action, remedy, must) = &incidents[incident % incidents.len()];
        let simulate =
            |run: &Self, action: &Value| run.ask("POST", "/api/v1/simulator", action.to_string().as_bytes(), 202);
        simulate(self, action);
        thread::sleep(Duration::from_millis(self.random.random_range(200..2_000)));
        if *must {
            self.daemon.until(name, |telemetry| telemetry["state"] == "fault");
        }
        if let Some(remedy) = remedy {
            simulate(self, remedy);
        }
        thread::sleep(Duration::from_millis(300));
        let start = Instant::now();
        let mut stood = false;
        loop {
            let telemetry = self.daemon.json("/api/v1/status")["telemetry"].clone();
            if telemetry["state"] == "locked" {
                break;
            }
            if telemetry["state"] == "fault" {
                let cause = telemetry["fault"].as_str().unwrap_or_default().to_string();
                assert!(!cause.is_empty(), "{name}: a fault without its cause");
                stood = true;
                self.ask("POST", "/api/v1/faults/clear", &[], 202);
            }
            if telemetry["state"] == "idle" {
                self.ask("POST", "/api/v1/motor/start", &[], 200);
            }
            assert!(start.elapsed() < PATIENCE, "{name}: {telemetry:#}");
            thread::sleep(Duration::from_millis(200));
        }
        self.longest = self.longest.max(start.elapsed().as_secs_f64());
        self.count(if stood { "faults that stood with their cause" } else { "incidents got over" });
    }

    /// As it was at first, and how much memory that takes.
    fn calm(&mut self) {
        let wish = json!({
            "scene": "builtin", "mode": "scene", "animation": { "kind": "spin", "degrees_per_turn": 2.0 }, "budget_px": 0.5,
            "halftone": "blue-noise", "transform": { "yaw_deg": 0.0, "scale": 1.0 },
        });
        self.ask("PATCH", "/api/v1/display", wish.to_string().as_bytes(), 200);
        self.daemon.until("calm", |telemetry| telemetry["scene"] == "builtin" && telemetry["lit"] == true);
        thread::sleep(Duration::from_millis(500));
        let status = fs::read_to_string(format!("/proc/{}/status", self.daemon.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kilobytes = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok());
        self.resident.extend(kilobytes.map(|kilobytes| kilobytes / 1e3));
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

#[test]
fn everything_at_once_takes_nothing_down() {
    let variable = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let (minutes, seed) = (variable("SOAK_EVERYTHING_MINUTES"), variable("SOAK_SEED").unwrap_or(1));
    let desk = Desk::new();
    let ports = [port(), port()];
    let small = fs::read_to_string(desk.path("small.toml")).unwrap();
    let rig = if minutes.is_some() { include_str!("../../rigs/reference.toml") } else { &small };
    let [opentrack, freed] = ports;
    let tracking = format!(
        "world_from_tracker = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]\n\
         source = [\"opentrack:{opentrack}\", \"freed:{freed}\"]\n"
    );
    desk.write("small.toml", format!("{rig}\n[tracking]\n{tracking}"));
    let daemon = Daemon::start(desk.folder.path(), &["--device", "sim:usb", "builtin"]);
    daemon.until("lit", |telemetry| telemetry["lit"] == true);
    assert_eq!(daemon.ask("PUT", "/api/v1/scenes/mine", &[], &glb(None)).0, 201);
    let ends = Arc::new(AtomicBool::new(false));
    let walking = thread::spawn({
        let ends = Arc::clone(&ends);
        move || walk(ports, &ends)
    });
    let random = ChaCha8Rng::seed_from_u64(seed);
    let mut run = Run { daemon, random, counts: BTreeMap::new(), resident: Vec::new(), longest: 0.0 };
    let until = Instant::now() + minutes.map_or(Duration::from_secs(15), |minutes| Duration::from_secs(60 * minutes));
    let mut step = 0;
    while Instant::now() < until || step < 8 {
        match step % 8 {
            0 => run.calm(),
            1 | 5 => run.look(),
            2 => run.talk_nonsense(),
            3 | 4 => run.change(),
            6 if step % 3 == 0 => run.record(),
            6 => run.change(),
            _ => run.fail(step / 8),
        }
        step += 1;
        thread::sleep(Duration::from_millis(run.random.random_range(50..400)));
    }
    run.calm();
    let telemetry = run.daemon.json("/api/v1/status")["telemetry"].clone();
    let number = |key: &str| telemetry[key].as_f64().unwrap_or_default();
    assert!(number("readings_taken") > 100.0 && number("readings_refused") > 10.0, "{telemetry:#}");
    assert!(telemetry["latency_ms"].is_number());
    ends.store(true, Ordering::Relaxed);
    walking.join().unwrap();
    println!("seed {seed}: {:.0} s, {:?}; longest way back {:.1} s", number("uptime_s"), run.counts, run.longest);
    println!(
        "turns delivered {}, dropped {}; readings taken {}, refused {}; latency median {:.0} ms",
        number("turns_delivered"),
        number("turns_dropped"),
        number("readings_taken"),
        number("readings_refused"),
        number("latency_ms"),
    );
    if !run.resident.is_empty() {
        // One turn more or less on its way is 21 MB.
        let thirds: Vec<f64> = run.resident.chunks(run.resident.len().div_ceil(3)).map(median).collect();
        println!("memory, medians of thirds: {thirds:.1?} MB");
        let (early, late) = (thirds[thirds.len() / 2], thirds[thirds.len() - 1]);
        let is_long = minutes.is_some_and(|minutes| minutes >= MEMORY_MINUTES);
        assert!(!is_long || late < (1.0 + MEMORY) * early, "memory grows: {:?}", run.resident);
    }
    assert!(run.daemon.end().success());
}

/// From tracker to light on the reference rig, for README and CHANGELOG; nothing is asserted of the time itself.
#[test]
fn somebody_who_walks_is_followed() {
    let desk = Desk::new();
    let daemon = Daemon::launch(desk.folder.path(), &["--device", "sim:usb"]);
    daemon.until("lit", |telemetry| telemetry["lit"] == true);
    let start = Instant::now();
    for (name, animation) in [
        ("while the scene turns", json!({ "kind": "spin", "degrees_per_turn": 2.0 })),
        ("at rest", json!({ "kind": "still" })),
    ] {
        assert_eq!(daemon.patch(&json!({ "animation": animation })).0, 200);
        let until = Instant::now() + Duration::from_secs(12);
        while Instant::now() < until {
            let seconds = start.elapsed().as_secs_f64();
            let (sin, cos) = (0.3 * seconds).sin_cos();
            let here = json!([{ "id": 1, "position_m": [0.9 * sin, 0.4 + 0.1 * seconds.sin(), 0.9 * cos] }]);
            assert_eq!(daemon.ask("POST", "/api/v1/viewers", &[], here.to_string().as_bytes()).0, 202);
            thread::sleep(Duration::from_millis(16));
        }
        let telemetry = &daemon.json("/api/v1/status")["telemetry"];
        let number = |key: &str| telemetry[key].as_f64().unwrap_or(f64::NAN);
        println!(
            "{name}: tracker to light {:.0} ms median, {} slices a turn, {:.1} turns a second on the link",
            number("latency_ms"),
            number("rendered_slices"),
            number("link_turns_per_second"),
        );
        assert!(number("latency_ms") > 0.0, "{telemetry:#}");
    }
    assert!(daemon.end().success());
}
