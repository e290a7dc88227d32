//! `praxi devices`, `praxi doctor`, and `praxi sim --serve serial` with a stream to it.

use crate::desk::Desk;
use host::link::serial::SerialLink;
use host::stream::{Stream, StreamError, TurnPlanes};
use protocol::codec::ImageSize;
use protocol::timing::{Direction, Rotation};
use protocol::units::Turns;
use serde_json::Value;
use std::io::{BufRead, BufReader, Lines};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

#[test]
fn devices_are_listed_and_wrong_names_refused() {
    let desk = Desk::new();
    let devices = desk.json("devices");
    assert_eq!(devices["simulated"], serde_json::json!(["sim", "sim:usb", "sim:serial"]));
    assert!(devices["serial"].is_array() && devices["usb"]["present"].is_boolean(), "{devices}");
    let text = String::from_utf8(desk.run("devices").stdout).unwrap();
    assert!(text.contains("sim:serial") && text.lines().all(|line| line.chars().count() <= 80), "{text}");
    desk.refuses("doctor --device /dev/tty-of-nobody", &["/dev/tty-of-nobody", "there is"]);
    for (path, kind) in [("/dev/null", "a device"), ("/tmp", "a folder"), ("/etc/passwd", "a file")] {
        desk.refuses(&format!("doctor --device {path}"), &[&format!("{path}: device: is {kind} and no serial port: ")]);
        desk.refuses(&format!("order stop --device {path}"), &[&format!("{path} is {kind} and no serial port: ")]);
    }
    desk.refuses("doctor --device usb:ffff:fffe", &["usb:ffff:fffe"]);
    desk.refuses("doctor --device sim:can", &["sim:can", "sim:serial[@BAUD]"]);
    desk.refuses("doctor --device sim:serial@7", &["300"]);
    desk.refuses("doctor --device sim --rig nowhere", &["nowhere"]);
    desk.refuses("sim --baud 9600", &["--serve"]);
    desk.refuses("sim --serve serial --baud 7", &["--baud", "300"]);
    desk.refuses("sim --serve serial --listen 127.0.0.1:0", &["--listen", "--serve usb"]);
    desk.refuses("sim --serve serial --key owner.key.pub", &["--key", "--serve usb"]);
    desk.refuses("sim --serve usb --baud 9600", &["--baud", "--serve serial"]);
}

#[test]
fn simulated_devices_are_healthy() {
    let desk = Desk::new();
    for device in ["sim", "sim:usb", "sim:serial", "sim:serial@115200"] {
        let report = desk.json(&format!("doctor --device {device} --rig small.toml"));
        let findings = report["findings"].as_array().unwrap();
        let verdict = |check: &str| &findings.iter().find(|finding| finding["check"] == check).unwrap()["verdict"];
        for check in ["device", "permissions", "opens", "protocol", "firmware", "link speed", "round trip", "loopback"]
        {
            assert_eq!(verdict(check), "ok", "{device}, {check}: {report:#}");
        }
        let text = String::from_utf8(desk.run(&format!("doctor --device {device}")).stdout).unwrap();
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
        assert_eq!(desk.json(&format!("doctor --device {device} --rig small.toml")), report, "the same every time");
    }
}

/// `praxi sim --serve serial`, ended with the test.
pub struct Served {
    child: Child,
    events: Lines<BufReader<ChildStdout>>,
    pub path: String,
}

impl Served {
    pub fn at(baud: u32) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_praxi"));
        command.args(["sim", "--serve", "serial", "--json", "--baud", &baud.to_string()]).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let events = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut served = Self { child, events, path: String::new() };
        served.path = served.next("ready")["path"].as_str().unwrap().into();
        served
    }

    /// The next event, which must be of that name.
    pub fn next(&mut self, name: &str) -> Value {
        let event: Value = serde_json::from_str(&self.events.next().unwrap().unwrap()).unwrap();
        assert_eq!(event["event"], name, "{event}");
        event
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_served_controller_outlives_its_hosts() {
    let desk = Desk::new();
    let mut served = Served::at(1_000_000);
    for _ in 0..2 {
        let report = desk.json(&format!("doctor --device {}@1000000 --rig small.toml", served.path));
        assert!(
            report["findings"].as_array().unwrap().iter().all(|finding| finding["verdict"] != "failed"),
            "{report:#}"
        );
        served.next("opened");
        let closed = served.next("closed");
        assert!(closed["heard"]["bytes"].as_u64().unwrap() > 10_000, "{closed}");
        assert!(closed["said"]["bytes"].as_u64().unwrap() > 500, "{closed}");
    }
    let link = SerialLink::open(&served.path, 1_000_000).unwrap();
    desk.refuses(&format!("doctor --device {}", served.path), &["another program", "end that program"]);
    for command in ["order stop", "stream boxes --rig small.toml"] {
        let output = desk.run(&format!("{command} --device {}", served.path));
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), text.matches(&served.path).count()), (Some(2), 1), "{text}");
    }
    drop(link);
    assert_eq!(ended(&mut served.child), Some(0));
}

/// The exit code of a child that is told to end.
pub fn ended(child: &mut Child) -> Option<i32> {
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    child.wait().unwrap().code()
}

#[test]
fn each_finding_is_told_at_once() {
    // Opened by the test, which answers nothing.
    let (far, near) = serialport::TTYPort::pair().unwrap();
    let path = serialport::SerialPort::name(&near).unwrap();
    drop(near);
    let mut command = Command::new(env!("CARGO_BIN_EXE_praxi"));
    command.args(["doctor", "--device", &path]).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = command.spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.by_ref().any(|line| line.contains("opens")));
    assert!(child.try_wait().unwrap().is_none(), "it asks still");
    assert!(lines.by_ref().any(|line| line.starts_with("failed") && line.contains("does not answer a hello")));
    assert_eq!(child.wait().unwrap().code(), Some(2));
    drop(far);
}

/// Noise, which does not become smaller.
struct Noise {
    slices: u32,
    plane: Vec<u8>,
}

impl TurnPlanes for Noise {
    fn slices(&self) -> u32 {
        self.slices
    }

    fn plane_bytes(&self, _slice: u32) -> &[u8] {
        &self.plane
    }
}

/// The share of the line's rate that two turns of about a second each reach, by the served line's own clock.
fn share(baud: u32) -> Result<f64, StreamError> {
    // 96 planes of 1.2 kB a second at 1 Mbaud.
    let slices = 96 * (baud / 1_000_000);
    let microhertz = u64::from(slices / 24) * 20_000_000;
    let rotation = Rotation::new(slices, 24, microhertz, Turns::ZERO, Direction::CounterClockwise).unwrap();
    let size = ImageSize::new(96, 96).unwrap();
    let mut state = 1u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    let turn = Noise { slices, plane: (0..size.plane_bytes()).map(|_| noise()).collect() };
    let mut served = Served::at(baud);
    let mut stream = Stream::new(SerialLink::open(&served.path, baud)?, &rotation, size)?;
    stream.submit(&turn)?;
    stream.submit(&turn)?;
    let statistics = stream.statistics();
    let received = loop {
        match stream.poll(Duration::from_millis(100))? {
            Some(status) if status.turns_received >= 2 => break status.turns_received,
            _ => {}
        }
    };
    drop(stream);
    served.next("opened");
    let closed = served.next("closed");
    let share = closed["heard"]["share"].as_f64().unwrap();
    println!("{baud} baud: {statistics:?}, {received} turns whole, {closed}");
    assert_eq!((received, &closed["heard"]["bytes"]), (2, &statistics.bytes_on_wire.into()));
    // What was sent twice is no use of the line.
    Ok(if statistics.retries == 0 { share } else { 0.0 })
}

#[test]
fn a_stream_keeps_a_serial_line_full() {
    // A machine that is busy elsewhere answers late, and the line idles meanwhile: the best of several runs is the link's own.
    const RUNS: usize = 8;
    for baud in [1_000_000, 3_000_000] {
        let mut shares = Vec::new();
        while shares.len() < RUNS && shares.last().is_none_or(|share| *share < 0.95) {
            shares.push(share(baud).unwrap_or_else(|error| {
                println!("{baud} baud: {error}");
                0.0
            }));
        }
        println!("{baud} baud: {shares:.4?} of the line's rate");
        assert!(shares.last().is_some_and(|share| *share >= 0.95), "{baud} baud: {shares:?}");
    }
}
