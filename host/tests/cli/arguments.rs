//! What every command does with arguments and files that cannot be.

use crate::desk::Desk;
use std::fs;
use std::process::Command;

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
    desk.write("firmware.bin", [7; 100]);
    assert!(desk.run("image key owner.key").status.success());
    let sign = "image sign firmware.bin --board sim --version 1.2.3 --out firmware.img";
    desk.refuses(&format!("{sign} --key owner.key.pub"), &["owner.key.pub", "public", "secret"]);
    desk.refuses("paint", &["paint"]);
}

#[test]
fn a_full_disk_is_refused_with_what_to_do() {
    let full = || fs::File::options().write(true).open("/dev/full").unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_praxi")).args(["rig", "check", "reference"]).stdout(full()).output();
    let output = output.unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), text.lines().count()), (Some(2), 1), "{text}");
    assert!(text.contains("standard output") && text.contains("make room"), "{text}");
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
fn every_command_has_help_with_an_example() {
    let desk = Desk::new();
    for command in ["demo", "sim", "render", "bake", "see", "truth", "compare", "project", "rig", "rig check"] {
        let output = desk.run(&format!("{command} --help"));
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success() && text.contains("Example: praxi "), "{command}: {text}");
    }
}

#[test]
fn every_command_prints_json() {
    let desk = Desk::new();
    let help = String::from_utf8(desk.run("--help").stdout).unwrap();
    let (_, commands) = help.split_once("Commands:").unwrap();
    // Words that go on below stand farther in.
    let heads = commands.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names =
        heads.filter_map(|line| line.split_whitespace().next()).filter(|name| !["help", "-h,", "-V,"].contains(name));
    let both = names.flat_map(|name| match name {
        "image" => vec!["image key".to_string(), "image sign".into()],
        "rig" => vec!["rig check".into()],
        name => vec![name.into()],
    });
    let names: Vec<_> = both.collect();
    assert!(names.len() > 20, "{help}");
    // What a daemon says is its log, in JSON by log = "json".
    for name in names.into_iter().filter(|name| name != "run") {
        let text = String::from_utf8(desk.run(&format!("{name} --help")).stdout).unwrap();
        assert!(text.contains("--json"), "{name}: {text}");
    }
    desk.write("firmware.bin", [7; 100]);
    let key = desk.json("image key owner.key");
    assert_eq!(key, serde_json::json!({ "secret": "owner.key", "public": "owner.key.pub" }));
    let image = desk.json("image sign firmware.bin --key owner.key --board sim --version 1.2.3 --out firmware.img");
    let bytes = fs::metadata(desk.path("firmware.img")).unwrap().len();
    assert_eq!((&image["version"], &image["bytes"]), (&"1.2.3".into(), &bytes.into()));
}
