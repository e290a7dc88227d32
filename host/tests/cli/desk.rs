//! Where a test of the command line works.

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder of its own for each test, with a rig small enough to be quick: 48 slices of 96 × 96 pixels at the reference's speed.
pub struct Desk {
    pub folder: tempfile::TempDir,
}

impl Desk {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let rig = include_str!("../../rigs/reference.toml")
            .replace("slices = 288 ", "slices = 48 ")
            .replace("refresh_hz = 240.0", "refresh_hz = 40.0")
            .replace("diffuser_hat_radius_deg = 1.25", "diffuser_hat_radius_deg = 7.5")
            .replace("_px = 768", "_px = 96")
            .replace("focal_px = 3072.0", "focal_px = 384.0")
            .replace("[384.0, 384.0]", "[48.0, 48.0]");
        fs::write(folder.path().join("small.toml"), rig).unwrap();
        Self { folder }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        fs::write(self.path(name), text).unwrap();
    }

    pub fn run(&self, arguments: &str) -> Output {
        let arguments = arguments.split_whitespace();
        // Mesa's layer that chooses a device complains on standard error where there is no desktop.
        let mut command = Command::new(env!("CARGO_BIN_EXE_praxi"));
        command.args(arguments).current_dir(&self.folder).env("NODEVICE_SELECT", "1").output().unwrap()
    }

    /// Runs, and gives what is printed as JSON.
    pub fn json(&self, arguments: &str) -> Value {
        let output = self.run(&format!("{arguments} --json"));
        assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// Runs, and expects exit code 2, one line with every one of `words`, and a folder that is as it was.
    pub fn refuses(&self, arguments: &str, words: &[&str]) {
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

    pub fn warnings(&self, arguments: &str) -> String {
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
