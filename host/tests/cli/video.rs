//! `praxi run --output video:…` on an X server without a monitor (Xvfb), whose screen is read back.

use crate::daemon::{Daemon, PATIENCE};
use crate::desk::Desk;
use host::pattern::{Pattern, draw};
use host::video::bytes_of;
use protocol::frame_mark::{SIDE, read};
use protocol::rig::Rig;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Instant;
use x11rb::connection::Connection;
use x11rb::protocol::randr::{self, ConnectionExt as _};
use x11rb::protocol::xproto::{ConnectionExt as _, ImageFormat};
use x11rb::rust_connection::RustConnection;

/// An X server, which ends with this. Its refreshes are 60 a second by its clock.
struct Xvfb {
    child: Child,
    display: String,
}

impl Xvfb {
    /// Of `size` pixels a side; nothing where there is no Xvfb. `display`: the name of one that has ended.
    fn start(size: u32, display: Option<&str>) -> Option<Self> {
        let (screen, mut command) = (format!("{size}x{size}x24"), Command::new("Xvfb"));
        command.args(["-displayfd", "1", "-screen", "0", &screen, "-nolisten", "tcp", "-noreset"]).args(display);
        let child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let Ok(mut child) = child else {
            println!("skipped: there is no Xvfb");
            return None;
        };
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let server = Self { child, display: format!(":{}", line.trim()) };
        // They are whatever was in memory.
        server.set_levels(1.0);
        Some(server)
    }

    /// Makes the middle levels brighter, with a gamma other than 1.
    fn set_levels(&self, gamma: f64) {
        let server = self.connect();
        let root = server.setup().roots[0].root;
        let crtc = server.randr_get_screen_resources_current(root).unwrap().reply().unwrap().crtcs[0];
        let size = randr::get_crtc_gamma_size(&server, crtc).unwrap().reply().unwrap().size;
        let bend = |level: u16| ((f64::from(level) / f64::from(size - 1)).powf(gamma) * 65_535.0).round() as u16;
        let levels: Vec<_> = (0..size).map(bend).collect();
        randr::set_crtc_gamma(&server, crtc, &levels, &levels, &levels).unwrap().check().unwrap();
    }

    fn connect(&self) -> RustConnection {
        RustConnection::connect(Some(&self.display)).unwrap().0
    }
}

impl Drop for Xvfb {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The reference rig of three frames a turn, 60 of them a second; where it is.
fn rig(desk: &Desk) -> (Rig, String) {
    let text = include_str!("../../rigs/reference.toml")
        .replace("slices = 288 ", "slices = 72 ")
        .replace("refresh_hz = 240.0", "refresh_hz = 60.0")
        .replace("diffuser_hat_radius_deg = 1.25", "diffuser_hat_radius_deg = 5.0");
    desk.write("video.toml", &text);
    (Rig::parse(&text).unwrap(), desk.path("video.toml").to_str().unwrap().into())
}

/// What is on screen: every pixel's three bytes that mean something, and the number that its mark tells.
fn screen(server: &RustConnection, rig: &Rig) -> (Vec<u8>, Option<u32>) {
    let (root, size) = (server.setup().roots[0].root, [rig.projector.width_px, rig.projector.height_px]);
    let [width, height] = size.map(|size| size as u16);
    let image = server.get_image(ImageFormat::Z_PIXMAP, root, 0, 0, width, height, u32::MAX).unwrap();
    let mut bytes = image.reply().unwrap().data;
    bytes.iter_mut().skip(3).step_by(4).for_each(|byte| *byte = 0);
    let pixels = bytes.as_chunks::<4>().0;
    let word = |&[blue, green, red, _]: &[u8; 4]| u32::from_le_bytes([red, green, blue, 0]);
    let side = SIDE as usize;
    let mark = std::array::from_fn(|place| word(&pixels[place / side * usize::from(width) + place % side]));
    (bytes, read(&mark))
}

fn shown(telemetry: &Value) -> u64 {
    telemetry["video"]["frames_shown"].as_u64().unwrap_or(0)
}

#[test]
fn every_bit_of_every_frame_is_on_screen() {
    let Some(server) = Xvfb::start(768, None) else { return };
    let desk = Desk::new();
    let (rig, path) = rig(&desk);
    let arguments = ["--rig", &path, "--output", "video:screen"];
    let daemon = Daemon::on_display(Some(&server.display), desk.folder.path(), &arguments);
    assert_eq!(daemon.patch(&json!({ "mode": "pattern", "pattern": "numbers" })).0, 200);
    let turn = draw(&rig, Pattern::Numbers).unwrap();
    let frames: Vec<_> = (0..3).map(|index| bytes_of(Some(&turn), &rig, index)).collect();
    let eye = server.connect();
    let (start, mut seen, mut numbers) = (Instant::now(), 0, BTreeSet::new());
    while seen < 60 || numbers.len() < frames.len() {
        assert!(start.elapsed() < PATIENCE, "after {seen} pictures {numbers:?}");
        let (bytes, Some(number)) = screen(&eye, &rig) else {
            assert_eq!(seen, 0, "a picture without a mark");
            continue;
        };
        let is_right = bytes == frames[number as usize];
        // Something else was on screen before.
        assert!(is_right || seen == 0, "frame {number} is another one than was packed");
        if is_right {
            seen += 1;
            numbers.insert(number);
        }
    }
    daemon.until("lit", |telemetry| telemetry["lit"] == true && shown(telemetry) > 60);
    let status = daemon.until("a rate", |telemetry| telemetry["video"]["frames_per_second"].as_f64() > Some(0.0));
    let video = &status["telemetry"]["video"];
    assert!(video["monitor"] == "screen" && video["error"].is_null(), "{video}");
    assert!((video["refresh_hz"].as_f64().unwrap() - 60.0).abs() < 0.6, "{video}");
    assert_eq!(status["telemetry"]["turns_delivered"], 0, "turns go over the wire, too");
    let figures = String::from_utf8(daemon.get("/metrics")).unwrap();
    assert!(figures.contains("praxi_video_frames_total{outcome=\"shown\"} "), "{figures}");
    assert!(figures.contains("praxi_video_frames_total{outcome=\"late\"} "), "{figures}");
    // The projector is given a desktop for ever.
    let desktop = json!({ "video": { "restart": { "gap": 1_000_000, "first": 0 } } });
    assert_eq!(daemon.ask("POST", "/api/v1/simulator", &[], desktop.to_string().as_bytes()).0, 202);
    daemon.until("dark", |telemetry| telemetry["lit"] == false && telemetry["state"] == "locked");
    let is_told = || daemon.json("/api/v1/events").to_string().contains("reads no numbers");
    let start = Instant::now();
    while !is_told() {
        assert!(start.elapsed() < PATIENCE, "nobody says why it is dark");
    }
    assert!(daemon.end().success());
}

#[test]
fn a_server_that_went_away_is_looked_for() {
    let Some(server) = Xvfb::start(768, None) else { return };
    let desk = Desk::new();
    let (_, path) = rig(&desk);
    let display = server.display.clone();
    let arguments = ["--rig", &path, "--output", "video:screen", "boxes"];
    let daemon = Daemon::on_display(Some(&display), desk.folder.path(), &arguments);
    daemon.until("shown", |telemetry| shown(telemetry) > 3);
    drop(server);
    daemon.until("away", |telemetry| telemetry["video"]["error"].is_string());
    let Some(_server) = Xvfb::start(768, Some(&display)) else { return };
    let before = shown(&daemon.json("/api/v1/status")["telemetry"]);
    daemon.until("back", |telemetry| telemetry["video"]["error"].is_null() && shown(telemetry) > before);
    assert!(daemon.end().success());
}

/// Standard error of a check that is refused.
fn refused(display: &str, rig: &Path, output: &str) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_praxi"));
    command.args(["run", "--check", "--output", output, "--rig"]).arg(rig).env("DISPLAY", display);
    let output = command.output().unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), text.lines().count()), (Some(2), 1), "{text}");
    text
}

#[test]
fn what_does_not_fit_is_refused_in_one_line() {
    let desk = Desk::new();
    let (_, path) = rig(&desk);
    let path = Path::new(&path);
    assert!(refused(":4077", path, "video:screen").contains("DISPLAY"));
    assert!(refused(":4077", path, "vga").contains("video:MONITOR"));
    let Some(server) = Xvfb::start(768, None) else { return };
    let display = &server.display;
    assert!(refused(display, path, "video:HDMI-9").contains("there is screen 768x768"));
    let list = Command::new(env!("CARGO_BIN_EXE_praxi"))
        .args(["run", "--output", "video:?"])
        .env("DISPLAY", display)
        .output()
        .unwrap();
    let text = String::from_utf8(list.stdout).unwrap();
    assert!(list.status.success() && text.starts_with("screen 768x768") && text.lines().count() == 1, "{text}");
    let small = refused(display, &desk.path("small.toml"), "video:screen");
    assert!(small.contains("768x768") && small.contains("needs 96x96"), "{small}");
    let fast = refused(display, Path::new("reference"), "video:screen");
    assert!(fast.contains("frames a second") && fast.contains("needs 240"), "{fast}");
    server.set_levels(0.8);
    let bent = refused(display, path, "video:screen");
    assert!(bent.contains("--gamma 1:1:1"), "{bent}");
}
