//! `praxi register`: a tracker's place from a few points.

use crate::desk::Desk;
use std::net::UdpSocket;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The tracker's x, y, z are the world's -z, x, -y, and its origin is 0.5 m to the right, 1.2 m up and 0.3 m behind the axis.
const PAIRS: &str = "tracker_x_m,tracker_y_m,tracker_z_m,world_x_m,world_y_m,world_z_m
-0.7,-1,1.2,-0.5,0,0.4
-0.7,0,1.2,0.5,0,0.4
0.3,0,1.2,0.5,0,-0.6
0.3,-1,1.2,-0.5,0,-0.6
-0.7,-1,0.5,-0.5,0.7,0.4
";
/// An eye 0.1 m along the sensor's z, at (0, 0.35, 0.9) while the head nods by 0, 30 and -30 degrees about the sensor's x.
const EYES: &str = "what,tracker_x_m,tracker_y_m,tracker_z_m,world_x_m,world_y_m,world_z_m,qx,qy,qz,qw
eye,-1.2,-0.5,0.75,0,0.35,0.9,0,0,0,1
eye,-1.2,-0.45,0.7633975,0,0.35,0.9,0.2588190,0,0,0.9659258
eye,-1.2,-0.55,0.7633975,0,0.35,0.9,-0.2588190,0,0,0.9659258
";

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("pairs.csv", PAIRS);
    let columns: String = PAIRS.lines().skip(1).map(|line| format!("sensor,{line},,,,\n")).collect();
    desk.write("both.csv", format!("{EYES}{columns}"));
    desk
}

#[test]
fn a_tracker_is_found_and_its_block_is_a_rigs() {
    let desk = desk();
    let found = desk.json("register both.csv");
    assert_eq!(
        found["world_from_tracker"],
        serde_json::json!([[0.0, 1.0, 0.0, 0.5], [0.0, 0.0, -1.0, 1.2], [-1.0, 0.0, 0.0, -0.3]])
    );
    assert!(
        found["rms_mm"].as_f64().unwrap() < 1e-6 && found["flat"] == false && found["residuals"][0]["pair"] == "line 5"
    );
    let eye = &found["eye"]["sensor_to_eye_m"];
    assert!((eye[2].as_f64().unwrap() - 0.1).abs() < 1e-6 && eye[0].as_f64().unwrap().abs() < 1e-6, "{found}");
    // What is printed can be put at the end of a rig file.
    let printed = String::from_utf8(desk.run("register both.csv").stdout).unwrap();
    assert!(
        printed.contains("# 5 pairs agree within 0.0 mm RMS") && printed.contains("sensor_to_eye_m = ["),
        "{printed}"
    );
    let rig = format!("{}\n{printed}", include_str!("../../rigs/reference.toml"));
    desk.write("printed.toml", &rig);
    desk.json("rig check printed.toml");
    // The same from TOML.
    let pair = |line: &str| {
        let fields: Vec<_> = line.split(',').collect();
        format!("[[sensor]]\ntracker_m = [{}]\nworld_m = [{}]\n", fields[..3].join(","), fields[3..].join(","))
    };
    desk.write("pairs.toml", PAIRS.lines().skip(1).map(pair).collect::<String>());
    assert_eq!(desk.json("register pairs.toml")["world_from_tracker"], found["world_from_tracker"]);
}

#[test]
fn a_rig_file_keeps_what_else_it_says() {
    let desk = desk();
    let reference = include_str!("../../rigs/reference.toml");
    let tracked = "\n[tracking]\nsource = \"opentrack:4242\" # on the desk\n\
        world_from_tracker = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] # a guess\n";
    for (name, before) in [("bare.toml", reference.to_string()), ("tracked.toml", format!("{reference}{tracked}"))] {
        desk.write(name, &before);
        let output = desk.run(&format!("register pairs.csv --write {name}"));
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let after = std::fs::read_to_string(desk.path(name)).unwrap();
        assert!(
            before.lines().all(|line| line.starts_with("world_from_tracker") || after.lines().any(|kept| kept == line)),
            "{after}"
        );
        let rig = protocol::rig::Rig::parse(&after).unwrap();
        let tracking = rig.tracking.unwrap();
        assert_eq!(tracking.world_from_tracker[0], [0.0, 1.0, 0.0, 0.5]);
        assert_eq!(tracking.source.len(), usize::from(name == "tracked.toml"));
        assert_eq!(after.contains("] # a guess"), name == "tracked.toml", "{after}");
        // Written twice is written once.
        desk.run(&format!("register pairs.csv --write {name}"));
        assert_eq!(std::fs::read_to_string(desk.path(name)).unwrap(), after);
    }
}

#[cfg(unix)]
#[test]
fn a_link_to_a_rig_file_stays_one() {
    let desk = desk();
    desk.write("rig.toml", include_str!("../../rigs/reference.toml"));
    std::os::unix::fs::symlink("rig.toml", desk.path("link.toml")).unwrap();
    assert!(desk.run("register pairs.csv --write link.toml").status.success());
    assert!(desk.path("link.toml").is_symlink());
    assert!(std::fs::read_to_string(desk.path("rig.toml")).unwrap().contains("[tracking]"));
}

#[test]
fn bad_pairs_are_refused_and_nothing_is_written() {
    let desk = desk();
    desk.write("rig.toml", include_str!("../../rigs/reference.toml"));
    for (from, to, words) in [
        ("-0.7,0,1.2,0.5,0,0.4", "-0.7,0,1.2,0.5,0.3,0.4", ["line 3", "the others agree", "measure it again"]),
        ("-0.7,0,1.2,0.5,0,0.4", "-0.7,0,1.2,0.5,nan,0.4", ["line 3", "world_y_m = nan", "must be a number"]),
        ("tracker_x_m", "x", ["line 1", "\"x\" is no column", "tracker_x_m"]),
        (",1.2", ",-1.2", ["mirrored", "invert one axis", "bad.csv"]),
        ("-1,", "-1.6,", ["disagree by", "allowed are 20.0", "the worst is line"]),
    ] {
        let text = if from == ",1.2" {
            PAIRS.replace(from, to).replace(",0.5,-0.5", ",-0.5,-0.5")
        } else {
            PAIRS.replace(from, to)
        };
        assert_ne!(text, PAIRS);
        desk.write("bad.csv", text);
        desk.refuses("register bad.csv --write rig.toml", &words);
    }
    desk.write("few.csv", PAIRS.lines().take(3).collect::<Vec<_>>().join("\n"));
    desk.refuses("register few.csv", &["few.csv", "2 pairs", "at least 3"]);
    desk.write(
        "line.csv",
        [&PAIRS.lines().take(2).collect::<Vec<_>>().join("\n"), "\n-0.7,-0.5,1.2,0,0,0.4\n-0.7,0,1.2,0.5,0,0.4\n"]
            .concat(),
    );
    desk.refuses("register line.csv", &["within 0.0 mm of one line"]);
    assert_eq!(std::fs::read_to_string(desk.path("rig.toml")).unwrap(), include_str!("../../rigs/reference.toml"));
    // And what is no rig file, or is not there.
    desk.write("other.toml", "tracking = 3\n");
    desk.refuses("register pairs.csv --write other.toml", &["other.toml", "tracking must be a table"]);
    desk.write("half.toml", "name = \"half\"\n");
    desk.refuses("register pairs.csv --write half.toml", &["half.toml", "missing field"]);
    desk.write("syntax.toml", "[name\n");
    desk.refuses("register pairs.csv --write syntax.toml", &["syntax.toml", "line 1"]);
    desk.refuses("register pairs.csv --write nowhere.toml", &["nowhere.toml", "No such file"]);
    desk.refuses("register nowhere.csv", &["nowhere.csv"]);
    desk.refuses("register pairs.csv --within-mm 0", &["--within-mm", "0.001 to 1000"]);
    desk.refuses("register pairs.csv --listen freed:1", &["--listen"]);
    desk.refuses("register --listen kinect:1", &["kinect:1", "opentrack:PORT"]);
    desk.refuses("register", &["FILE"]);
}

#[test]
fn points_in_one_plane_are_warned_about() {
    let desk = desk();
    desk.write("flat.csv", PAIRS.lines().take(5).collect::<Vec<_>>().join("\n"));
    assert!(desk.warnings("register flat.csv").contains("one plane"));
    assert_eq!(desk.warnings("register pairs.csv"), "");
}

/// A port that was free a moment ago.
fn free_port() -> u16 {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

#[test]
fn what_a_tracker_says_becomes_lines_to_fill_in() {
    let port = free_port();
    let ends = AtomicBool::new(false);
    let packet: Vec<u8> =
        [-70.0f64, 0.0, 120.0, 0.0, 0.0, 0.0].iter().flat_map(|number| number.to_le_bytes()).collect();
    let output = std::thread::scope(|scope| {
        scope.spawn(|| {
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            while !ends.load(Ordering::Relaxed) {
                let _ = socket.send_to(&packet, ("127.0.0.1", port));
                std::thread::sleep(Duration::from_millis(10));
            }
        });
        let mut command = Command::new(env!("CARGO_BIN_EXE_praxi"));
        command.args(["register", "--listen", &format!("opentrack:{port}"), "--rows", "2"]).stdout(Stdio::piped());
        let output = command.output();
        ends.store(true, Ordering::Relaxed);
        output.unwrap()
    });
    let text = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<_> = text.lines().collect();
    assert!(output.status.success() && lines.len() == 3, "{text}");
    assert!(lines[0].starts_with("what,tracker_x_m"), "{text}");
    assert!(
        lines[1].starts_with("sensor,-0.7000,0.0000,1.2000,,,,0.00000,0.00000,0.00000,1.00000 # sensor 0, "),
        "{text}"
    );
    // Filled in, it is what a file takes.
    let desk = Desk::new();
    let filled = text.replace(",,,,", ",0.5,0,0.4,");
    desk.write("filled.csv", filled);
    desk.refuses("register filled.csv", &["2 pairs"]);
}
