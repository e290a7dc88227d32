//! The command line as a user meets it: results, bad input, exit codes, nothing half-written.

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder of its own for each test, with a rig small enough to be quick: 48 slices of 96 × 96 pixels at the reference's speed.
struct Desk {
    folder: tempfile::TempDir,
}

impl Desk {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let rig = include_str!("../rigs/reference.toml")
            .replace("slices = 288 ", "slices = 48 ")
            .replace("refresh_hz = 240.0", "refresh_hz = 40.0")
            .replace("diffuser_hat_radius_deg = 1.25", "diffuser_hat_radius_deg = 7.5")
            .replace("_px = 768", "_px = 96")
            .replace("focal_px = 3072.0", "focal_px = 384.0")
            .replace("[384.0, 384.0]", "[48.0, 48.0]");
        fs::write(folder.path().join("small.toml"), rig).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        fs::write(self.path(name), text).unwrap();
    }

    fn run(&self, arguments: &str) -> Output {
        let arguments = arguments.split_whitespace();
        // Mesa's layer that chooses a device complains on standard error where there is no desktop.
        let mut command = Command::new(env!("CARGO_BIN_EXE_praxi"));
        command.args(arguments).current_dir(&self.folder).env("NODEVICE_SELECT", "1").output().unwrap()
    }

    /// Runs, and gives what is printed as JSON.
    fn json(&self, arguments: &str) -> Value {
        let output = self.run(&format!("{arguments} --json"));
        assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// Runs, and expects exit code 2, one line with every one of `words`, and a folder that is as it was.
    fn refuses(&self, arguments: &str, words: &[&str]) {
        let before = self.listing();
        let output = self.run(arguments);
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments}: {text}");
        let errors: Vec<_> = text.lines().filter(|line| !line.starts_with("praxi: warning: ")).collect();
        assert_eq!(errors.len(), 1, "{arguments}: {text}");
        assert!(errors[0].starts_with("praxi: error: "), "{arguments}: {text}");
        for word in words {
            assert!(errors[0].contains(word), "{arguments}: «{word}» is not in: {text}");
        }
        assert_eq!(self.listing(), before, "{arguments} left something behind");
    }

    fn warnings(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{arguments}: {text}");
        text
    }

    fn listing(&self) -> Vec<PathBuf> {
        fn walk(folder: &Path, into: &mut Vec<PathBuf>) {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    walk(&path, into);
                }
                into.push(path);
            }
        }
        let mut paths = Vec::new();
        walk(self.folder.path(), &mut paths);
        paths.sort();
        paths
    }
}

const TRIANGLE: &str = "v 0 0 0\nv 0.03 0 0\nv 0 0.03 0\nf 1 2 3\n";

#[test]
fn a_turn_is_rendered_seen_and_compared() {
    let desk = Desk::new();
    let rendered = desk.json("render builtin --rig small.toml --out turn");
    assert_eq!((&rendered["slices"], &rendered["pictures"]), (&48.into(), &2.into()));
    let names: Vec<_> = fs::read_dir(desk.path("turn")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 3, "{names:?}");
    let note: Value = serde_json::from_slice(&fs::read(desk.path("turn/rotation.json")).unwrap()).unwrap();
    assert_eq!(note["method"]["precision"], "single");
    assert_eq!(note["method"]["halftone"], "optimised-diffusion");
    assert!(rendered["error_px"].as_f64().unwrap() <= 0.5, "{rendered}");
    assert_eq!(note["method"]["shading"], "lambert");
    assert_eq!(note["rig"]["projector"]["width_px"], 96);

    desk.json("see turn --from -0.2,0.35,0.85 --pixels 64 --out eye.png");
    desk.json("truth builtin --from -0.2,0.35,0.85 --pixels 64 --out truth.png");
    let likeness = desk.json("compare eye.png truth.png");
    assert!(likeness["psnr_db"].as_f64().unwrap() > 18.0, "{likeness}");

    desk.json("see turn --from 0,0.35,0.9 --pixels 64 --eyes 0.064 --linear --physical --out eye.png");
    let different = desk.json("compare eye-left.png eye-right.png");
    assert!(different["psnr_db"].as_f64().unwrap() < 40.0, "{different}");
    assert_eq!(image::open(desk.path("eye-left.png")).unwrap().color(), image::ColorType::La16);
}

/// Every file of a folder.
fn contents(folder: &Path) -> Vec<(std::ffi::OsString, Vec<u8>)> {
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    let mut files: Vec<_> = files.map(|entry| (entry.file_name(), fs::read(entry.path()).unwrap())).collect();
    files.sort();
    files
}

#[test]
fn a_bake_that_is_killed_goes_on_where_it_was() {
    let desk = Desk::new();
    let bake = "bake builtin --rig small.toml --sweeps 40 --out";
    assert_eq!(desk.json(&format!("{bake} whole"))["plan"]["halftone"], "joint");
    desk.json("see whole --from 0,0.35,0.9 --pixels 32 --out eye.png");
    let mut killed = Command::new(env!("CARGO_BIN_EXE_praxi"))
        .args(format!("{bake} turn").split_whitespace())
        .current_dir(&desk.folder)
        .spawn()
        .unwrap();
    while !desk.path("turn.bake").exists() && killed.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    killed.kill().unwrap();
    killed.wait().unwrap();
    assert!(!desk.path("turn").exists(), "it was not stopped halfway");
    assert!(desk.warnings(&format!("{bake} turn")).contains("turn.bake: going on after"));
    assert!(contents(&desk.path("turn")) == contents(&desk.path("whole")));
    assert!(!desk.path("turn.bake").exists() && !desk.path("whole.bake").exists());
}

#[test]
fn a_checkpoint_that_is_none_is_not_taken() {
    let desk = Desk::new();
    desk.write("turn.bake", "precious");
    desk.refuses("bake builtin --rig small.toml --out turn", &["turn.bake", "no checkpoint"]);
    desk.write("turn.bake", "praxi bake 1\nnonsense");
    assert!(desk.warnings("bake builtin --rig small.toml --sweeps 1 --out turn").contains("turn.bake: damaged"));
    desk.refuses("bake builtin --rig small.toml --sweeps 0 --out turn", &["--sweeps", "1..=1000"]);
    desk.refuses("render builtin --rig small.toml --halftone joint --out turn", &["joint", "search"]);
}

#[test]
fn a_plan_is_explained_and_impossible_ones_are_refused() {
    let desk = Desk::new();
    let plan = desk.json("plan builtin --rig small.toml --budget-px 0.5");
    assert!(plan["chosen"]["error_px"].as_f64().unwrap() <= 0.5, "{plan}");
    assert!(plan["weighed"].as_array().unwrap().len() > 5 && plan["ms_per_cost"].as_f64().unwrap() > 0.0, "{plan}");
    let fixed =
        desk.json("plan builtin --rig small.toml --projection planar --precision double --edges uniform --budget-px 9");
    assert_eq!(
        (&fixed["chosen"]["plan"]["edges"], &fixed["chosen"]["plan"]["precision"]),
        (&"uniform".into(), &"double".into())
    );
    let plan = "plan builtin --rig small.toml";
    desk.refuses(&format!("{plan} --budget-px 1e-12"), &["--budget-px", "most accurate", "px"]);
    desk.refuses(&format!("{plan} --budget-ms 0.001"), &["--budget-ms 0.001", "fastest", "ms"]);
    desk.refuses(&format!("{plan} --budget-px 0"), &["--budget-px", "above 0"]);
    desk.refuses(&format!("{plan} --budget-ms -3"), &["--budget-ms", "above 0"]);
    desk.refuses(&format!("{plan} --budget-px NaN"), &["--budget-px", "above 0"]);
    desk.refuses(&format!("{plan} --budget-px 1 --budget-ms 1"), &["--budget-px", "--budget-ms"]);
    desk.refuses(&format!("{plan} --projection cylinder"), &["--projection", "planar", "cone-newton"]);
    desk.write("far.obj", "v 100 0 0\nv 100 1 0\nv 100 0 1\nf 1 2 3\n");
    desk.refuses("plan far.obj --rig small.toml", &["nothing", "visible", "--fit-m"]);
    desk.refuses("render far.obj --rig small.toml --out turn", &["nothing", "visible"]);
}

/// On a terminal, which `script` plays; nothing of it stays.
#[test]
#[cfg(target_os = "linux")]
fn waiting_is_shown_on_a_terminal_alone() {
    let desk = Desk::new();
    let plan = "plan knot-5k --rig small.toml";
    assert!(desk.run(plan).stderr.is_empty());
    let line = format!("{} {plan}", env!("CARGO_BIN_EXE_praxi"));
    let Ok(shown) = Command::new("script").args(["-qec", &line, "/dev/null"]).current_dir(&desk.folder).output() else {
        return println!("skipped: there is no script to play a terminal");
    };
    let shown = String::from_utf8(shown.stdout).unwrap();
    assert!(shown.contains("choosing methods") && shown.contains("weighing other methods"), "{shown:?}");
}

#[test]
fn a_chart_is_written_whole() {
    let desk = Desk::new();
    let chart = desk.json("chart boxes --rig small.toml --quick --out chart");
    assert!(chart["optics"].as_array().unwrap().len() > 10 && chart["halftones"].as_array().unwrap().len() > 10);
    let csv = fs::read_to_string(desk.path("chart/chart.csv")).unwrap();
    let columns = csv.lines().next().unwrap().split(',').count();
    assert!(csv.lines().count() > 20 && csv.lines().all(|line| line.split(',').count() == columns));
    let summary = fs::read_to_string(desk.path("chart/summary.md")).unwrap();
    assert!(["## What to use when", "## Where methods fail", "on the front"].iter().all(|part| summary.contains(part)));
    assert!(fs::read_to_string(desk.path("chart/chart.svg")).unwrap().contains("<svg"));
    assert!(image::open(desk.path("chart/chart.png")).unwrap().width() > 1000);
    desk.refuses("chart nosuch.obj --rig small.toml --quick --out chart", &["nosuch.obj"]);
    desk.refuses("chart boxes --rig nosuch --quick --out chart", &["nosuch"]);
}

#[test]
fn grey_slices_are_pictures_of_luminance() {
    let desk = Desk::new();
    desk.json("render builtin --rig small.toml --halftone grey --projection planar --fit-m 0.1 --out turn");
    let slice = image::open(desk.path("turn/slice_000.png")).unwrap();
    assert_eq!((slice.width(), slice.color()), (96, image::ColorType::L8));
    assert_eq!(fs::read_dir(desk.path("turn")).unwrap().count(), 49);
    desk.json("see turn --from 0,0.35,0.9 --pixels 32 --out eye.png");
}

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
    desk.write("steep.toml", include_str!("../rigs/reference.toml").replace("height_m = 0.35", "height_m = 0.95"));
    assert!(desk.warnings("rig check steep.toml").contains("ghosts"));
}

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

    let motor = include_str!("../../hil-sim/motors/reference.toml");
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

#[test]
fn bad_scenes_are_refused() {
    let desk = Desk::new();
    desk.write("empty.obj", "v 0 0 0\n");
    desk.write("nan.obj", TRIANGLE.replace("0.03", "nan"));
    desk.write("index.obj", TRIANGLE.replace("f 1 2 3", "f 1 2 9"));
    desk.write("flat.obj", "v 0 0 0\nv 0.03 0 0\nv 0.06 0 0\nf 1 2 3\n");
    desk.write("noise.glb", [7u8; 300]);
    desk.write("noise.ply", "ply\nformat ascii 1.0\nelement vertex 4000000000\n");
    desk.write("scene.txt", "x");
    for (scene, words) in [
        ("none.obj", vec!["none.obj", "No such file"]),
        ("empty.obj", vec!["empty.obj", "triangle"]),
        ("nan.obj", vec!["nan.obj", "line 2", "finite"]),
        ("index.obj", vec!["index.obj", "line 4", "9"]),
        ("flat.obj", vec!["flat.obj", "triangle"]),
        ("noise.glb", vec!["noise.glb"]),
        ("noise.ply", vec!["noise.ply"]),
        ("scene.txt", vec!["scene.txt", ".glb", ".obj", ".ply"]),
        (".", vec!["."]),
    ] {
        desk.refuses(&format!("render {scene} --rig small.toml --out turn"), &words);
        desk.refuses(&format!("truth {scene} --from 0,0.35,0.9 --out truth.png"), &words);
    }
}

#[test]
fn odd_scenes_are_drawn_with_a_warning() {
    let desk = Desk::new();
    desk.write("some.obj", format!("{TRIANGLE}v 0 0 0\nf 1 1 2\nf 1 4 2\n"));
    assert!(desk.warnings("render some.obj --rig small.toml --out turn").contains("degenerate"));
    desk.write("mark.obj", format!("\u{feff}{TRIANGLE}"));
    assert!(desk.warnings("render mark.obj --rig small.toml --out turn").is_empty());
    assert!(desk.warnings("render some.obj --fit-m 0.0001 --rig small.toml --out turn").contains("--fit-m"));
    desk.write("large.obj", TRIANGLE.replace("0.03", "3"));
    let text = desk.warnings("render large.obj --rig small.toml --out turn");
    let fit = text.split("--fit-m ").nth(1).and_then(|rest| rest.split(' ').next()).expect(&text);
    assert!(desk.warnings(&format!("render large.obj --rig small.toml --fit-m {fit} --out turn")).is_empty());
    let larger = fit.parse::<f64>().unwrap() + 0.005;
    assert!(!desk.warnings(&format!("render large.obj --rig small.toml --fit-m {larger} --out turn")).is_empty());
}

#[test]
fn bad_rigs_are_refused() {
    let desk = Desk::new();
    let reference = include_str!("../rigs/reference.toml");
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

#[test]
fn bad_arguments_are_refused_on_one_line() {
    let desk = Desk::new();
    desk.refuses("render builtin --rig reference", &["--out"]);
    desk.refuses("render builtin --rig reference --out a --fit-m 0", &["--fit-m", "0.000001"]);
    desk.refuses("render builtin --rig reference --out a --halftone dots", &["dots", "blue-noise"]);
    desk.refuses("see turn --from 1,2 --out a.png", &["--from", "0.01,0.35,0.9"]);
    desk.refuses("see turn --from 0,0,0 --out a.png", &["--from", "--look-at"]);
    desk.refuses("see turn --from 0,1,1 --rays 0 --out a.png", &["--rays"]);
    desk.refuses("see turn --from 0,1,1 --window-m -1 --out a.png", &["--window-m", "from 0.000001"]);
    desk.refuses("see turn --from 0,1,1e300 --out a.png", &["--from", "1e9"]);
    for command in ["render builtin --rig small.toml", "bake builtin --rig small.toml", "demo"] {
        let arguments = format!("{command} --out a --renderer cpu --adapter llvmpipe");
        desk.refuses(&arguments, &["--adapter llvmpipe", "--renderer cpu", "auto and gpu"]);
    }
    desk.refuses("paint", &["paint"]);
}

#[test]
fn places_that_cannot_be_written_are_refused_before_the_work() {
    let desk = Desk::new();
    desk.write("file", "precious");
    fs::create_dir(desk.path("full")).unwrap();
    desk.write("full/precious.txt", "x");
    desk.refuses("render builtin --rig small.toml --out file", &["file"]);
    desk.refuses("render builtin --rig small.toml --out file/turn", &["file/turn"]);
    desk.refuses("render builtin --rig small.toml --out full", &["full", "not empty"]);
    desk.refuses("render builtin --rig small.toml --out /proc/praxi/turn", &["/proc/praxi/turn"]);
    desk.refuses("truth builtin --from 0,1,1 --out none/truth.png", &["none/truth.png"]);
    desk.refuses("truth builtin --from 0,1,1 --out full", &["full"]);
    desk.refuses("truth builtin --from 0,1,1 --out file", &["file", "PNG"]);
    desk.refuses("truth builtin --from 0,1,1 --out /dev/null", &["/dev/null", "PNG"]);
    desk.json("render builtin --rig small.toml --out turn");
    desk.refuses("see turn --from 0,1,1 --out turn/frame_00.png", &["turn/frame_00.png"]);
}

#[test]
fn files_that_never_end_are_refused() {
    let desk = Desk::new();
    desk.json("render builtin --rig small.toml --out turn");
    for arguments in [
        "rig check /dev/zero",
        "rig check .",
        "sim --motor /dev/zero",
        "sim --scenario /dev/zero",
        "compare /dev/zero /dev/zero",
        "see /dev --from 0,1,1 --out a.png",
        "render /dev/zero --rig small.toml --out a",
    ] {
        desk.refuses(arguments, &[]);
    }
    fs::remove_file(desk.path("turn/frame_00.png")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", desk.path("turn/frame_00.png")).unwrap();
    desk.refuses("see turn --from 0,1,1 --out a.png", &["frame_00.png", "regular"]);
}

#[test]
fn a_damaged_turn_is_refused() {
    let desk = Desk::new();
    desk.json("render builtin --rig small.toml --out turn");
    let see = "see turn --from 0,0.35,0.9 --pixels 16 --out eye.png";
    let frame = fs::read(desk.path("turn/frame_01.png")).unwrap();
    let note = fs::read_to_string(desk.path("turn/rotation.json")).unwrap();
    for length in [0, 8, frame.len() / 2, frame.len() - 20] {
        desk.write("turn/frame_01.png", &frame[..length]);
        desk.refuses(see, &["turn/frame_01.png"]);
    }
    fs::remove_file(desk.path("turn/frame_01.png")).unwrap();
    desk.refuses(see, &["turn/frame_01.png", "No such file"]);
    image::RgbImage::new(95, 96).save(desk.path("turn/frame_01.png")).unwrap();
    desk.refuses(see, &["turn/frame_01.png", "96 × 96"]);
    desk.write("turn/frame_01.png", &frame);
    for broken in [&note[..note.len() / 2], "{}", &note.replace("\"slices\": 48", "\"slices\": 72")] {
        desk.write("turn/rotation.json", broken);
        desk.refuses(see, &["turn/rotation.json"]);
    }
    desk.write("turn/rotation.json", note.replace("\"tilt_deg\": 45.0", "\"tilt_deg\": 145.0"));
    desk.refuses(see, &["turn/rotation.json", "tilt_deg"]);
    fs::remove_file(desk.path("turn/rotation.json")).unwrap();
    desk.refuses(see, &["turn/rotation.json"]);
}

#[test]
fn pictures_that_cannot_be_compared_are_refused() {
    let desk = Desk::new();
    image::RgbImage::new(4, 4).save(desk.path("a.png")).unwrap();
    image::RgbImage::new(4, 5).save(desk.path("b.png")).unwrap();
    desk.write("c.png", "x");
    desk.refuses("compare a.png b.png", &["4 × 4", "4 × 5"]);
    desk.refuses("compare a.png c.png", &["c.png"]);
    desk.refuses("compare a.png d.png", &["d.png"]);
}

#[test]
fn every_command_has_help_with_an_example() {
    let desk = Desk::new();
    for command in ["demo", "sim", "render", "bake", "see", "truth", "compare", "project", "rig", "rig check"] {
        let output = desk.run(&format!("{command} --help"));
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success() && text.contains("Example: praxi "), "{command}: {text}");
    }
}

#[test]
fn renderers_are_timed_and_bad_wishes_refused() {
    let desk = Desk::new();
    let bench = "bench --scene boxes --rig small.toml";
    let slow_and_fast = format!("{bench} --renderer clear --renderer cpu-portable");
    let report = desk.json(&format!("{slow_and_fast} --rounds 2 --halftone blue-noise --slices-sweep --out bench"));
    let rows = report["rows"].as_array().unwrap();
    // Two renderers, two models; and the quick one by the first model with five other slice counts, without a baseline.
    assert_eq!(rows.len(), 4 + 5, "{report}");
    assert!(rows.iter().all(|row| row["turn_ms"]["median"].as_f64().unwrap() > 0.0));
    assert!(rows[..2].iter().all(|row| row["times_faster"].is_f64() && row["work"]["triangles"].is_f64()));
    assert!(rows[0]["slices_rendered"] == 48 && rows[1]["slices_rendered"] == 48 && rows[0]["slices"] == 48);
    #[cfg(target_os = "linux")]
    assert!(rows[0]["peak_bytes"].as_f64().unwrap() > 1e6 && rows[0]["cores_ms"].is_f64());
    assert_eq!((&report["baseline"], &report["rounds"]), (&"clear".into(), &2.into()));
    let text = fs::read_to_string(desk.path("bench/bench.txt")).unwrap();
    assert!(text.contains("cpu-portable") && text.contains("packing 48 slices"), "{text}");
    assert!(fs::read_to_string(desk.path("bench/bench.svg")).unwrap().contains("<svg"));
    assert!(image::open(desk.path("bench/bench.png")).unwrap().width() > 1000);
    let quick = desk.json(&format!("{slow_and_fast} --quick --out bench"));
    assert_eq!(quick["rows"].as_array().unwrap().len(), 2);

    desk.refuses("bench --scene nosuch.obj --quick", &["nosuch.obj", "No such file"]);
    desk.refuses("bench --scene knot --quick", &["knot", ".obj"]);
    desk.refuses(&format!("{bench} --scene boxes"), &["boxes", "own name"]);
    desk.refuses(&format!("{bench} --rounds 0"), &["--rounds", "1..=500"]);
    desk.refuses(&format!("{bench} --seconds 0"), &["--seconds", "0.1"]);
    desk.refuses(&format!("{bench} --rounds 3 --seconds 3"), &["--rounds", "--seconds"]);
    desk.refuses(&format!("{bench} --budget-px 1e-12"), &["most accurate"]);
    desk.refuses(&format!("{bench} --renderer fast"), &["--renderer", "cpu-portable", "gpu-slice"]);
    desk.refuses(&format!("{bench} --adapter nosuch"), &["gpu-slice", "no GPU adapter", "nosuch"]);
    desk.refuses(&format!("{bench} --renderer gpu-compute --adapter nosuch"), &["gpu-compute", "nosuch"]);
    desk.refuses(&format!("{bench} --renderer clear --adapter nosuch"), &["--adapter nosuch", "--renderer"]);
    desk.refuses(&format!("{bench} --halftone joint"), &["joint", "blue-noise"]);
}
