//! `praxi bake`, killed and damaged.

use crate::desk::Desk;
use std::fs;
use std::path::Path;
use std::process::Command;

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
