//! What a daemon is told at its start: the file, every key of which `praxi.toml` beside this one documents.

use crate::input;
use crate::link::address::{Address, AddressError};
use crate::render::pick::Asked;
use crate::render::plan::Halftone;
use crate::video::{Output, OutputError};
use serde::{Deserialize, Serialize};
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Every key with its default, for people.
pub const DOCUMENTED: &str = include_str!("praxi.toml");

/// The shortest token in characters: 16 of 64 are 96 bits.
pub const TOKEN_CHARS_MIN: usize = 16;

/// Why a configuration is none.
#[derive(Debug, Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{}: {error}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// Not TOML, or an unknown key or value.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line, key, and the parser's words.
        reason: String,
    },
    /// See the message.
    #[error("device: {0}")]
    Device(#[from] AddressError),
    /// See the message.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A number out of its range.
    #[error("{key} = {value}: allowed is {allowed}")]
    Value {
        /// The key.
        key: &'static str,
        /// What was given.
        value: String,
        /// In words.
        allowed: &'static str,
    },
    /// See the message.
    #[error("listen = {0}: other machines reach it, so it needs token_file; allowed without one is 127.0.0.1 or [::1]")]
    NoToken(SocketAddr),
    /// See the message.
    #[error("token_file {}: {chars} characters: at least {TOKEN_CHARS_MIN} printable ones without spaces are needed", path.display())]
    WeakToken {
        /// The file.
        path: PathBuf,
        /// What it holds.
        chars: usize,
    },
    /// See the message.
    #[error("no folder for the state: set state_dir, or HOME")]
    NoStateDir,
}

/// The configuration. Fields are the keys of the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[expect(missing_docs, reason = "praxi.toml says it")]
pub struct Config {
    pub rig: String,
    pub device: String,
    pub output: String,
    pub seed: u64,
    pub scene: String,
    #[serde(deserialize_with = "listen_at")]
    pub listen: SocketAddr,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub token_file: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state_dir: Option<PathBuf>,
    pub motor: MotorAtStart,
    pub log: LogForm,
    pub render: RenderKeys,
    pub upload: UploadKeys,
    pub faults: FaultKeys,
}

/// An address and a port, as on the command line.
pub fn address(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| {
        format!("listen = {text}: allowed is ADDR:PORT, such as 127.0.0.1:7117, 0.0.0.0:7117 or [::1]:7117")
    })
}

fn listen_at<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<SocketAddr, D::Error> {
    address(&String::deserialize(deserializer)?).map_err(serde::de::Error::custom)
}

/// `[render]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[expect(missing_docs, reason = "praxi.toml says it")]
pub struct RenderKeys {
    pub renderer: Asked,
    pub budget_px: f64,
    pub halftone: Halftone,
}

/// `[upload]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[expect(missing_docs, reason = "praxi.toml says it")]
pub struct UploadKeys {
    pub bytes_max: usize,
    pub triangles_max: usize,
    pub scenes_max: usize,
}

/// `[faults]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[expect(missing_docs, reason = "praxi.toml says it")]
pub struct FaultKeys {
    pub clear_after_s: f64,
    pub clears_an_hour: u32,
}

/// What becomes of the motor at the first start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MotorAtStart {
    /// It spins up.
    Start,
    /// It waits for somebody.
    Wait,
}

/// How log lines are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LogForm {
    /// For people.
    Text,
    /// A line of JSON each.
    Json,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            rig: "reference".into(),
            device: "sim".into(),
            output: "device".into(),
            seed: 1,
            scene: "builtin".into(),
            listen: SocketAddr::from(([127, 0, 0, 1], 7117)),
            token_file: None,
            state_dir: None,
            motor: MotorAtStart::Start,
            log: LogForm::Text,
            render: RenderKeys::default(),
            upload: UploadKeys::default(),
            faults: FaultKeys::default(),
        }
    }
}

impl Default for RenderKeys {
    fn default() -> Self {
        Self { renderer: Asked::Auto, budget_px: 0.5, halftone: Halftone::BlueNoise }
    }
}

impl Default for UploadKeys {
    fn default() -> Self {
        Self { bytes_max: 64 << 20, triangles_max: 1_000_000, scenes_max: 100 }
    }
}

impl Default for FaultKeys {
    fn default() -> Self {
        Self { clear_after_s: 0.0, clears_an_hour: 6 }
    }
}

impl Config {
    /// Reads the file at `path`. Values are checked by [`Config::check`].
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let text =
            input::read_text(path).map_err(|error| ConfigError::Unreadable { path: path.to_path_buf(), error })?;
        toml::from_str(&text).map_err(|error| {
            let line = error.span().map(|span| 1 + text[..span.start.min(text.len())].matches('\n').count());
            let place = line.map(|line| format!("line {line}: ")).unwrap_or_default();
            ConfigError::Malformed { path: path.to_path_buf(), reason: format!("{place}{}", error.message()) }
        })
    }

    /// The device, if everything is in its range; and the token, if there is one.
    pub fn check(&self) -> Result<(Address, Option<String>), ConfigError> {
        let refuse = |key, value: String, allowed| Err(ConfigError::Value { key, value, allowed });
        let address = self.device.parse()?;
        self.output()?;
        let budget = self.render.budget_px;
        if !super::wish::BUDGETS_PX.contains(&budget) {
            return refuse("render.budget_px", budget.to_string(), super::wish::BUDGETS_PX_ALLOWED);
        }
        if self.render.halftone.binary().is_none() {
            let allowed = "any halftone that needs one slice at a time: not sight-line, joint or grey";
            return refuse("render.halftone", self.render.halftone.to_string(), allowed);
        }
        if !(0.0..=86_400.0).contains(&self.faults.clear_after_s) {
            return refuse("faults.clear_after_s", self.faults.clear_after_s.to_string(), "0 to 86400");
        }
        for (key, value) in [
            ("upload.bytes_max", self.upload.bytes_max),
            ("upload.triangles_max", self.upload.triangles_max),
            ("upload.scenes_max", self.upload.scenes_max),
        ] {
            if !(1..=4 << 30).contains(&value) {
                return refuse(key, value.to_string(), "1 to 4294967296");
            }
        }
        let token = self.token()?;
        if token.is_none() && !self.listen.ip().is_loopback() {
            return Err(ConfigError::NoToken(self.listen));
        }
        Ok((address, token))
    }

    /// Where pictures go.
    pub fn output(&self) -> Result<Output, ConfigError> {
        Ok(self.output.parse()?)
    }

    fn token(&self) -> Result<Option<String>, ConfigError> {
        let Some(path) = &self.token_file else { return Ok(None) };
        let text = input::read_text(path).map_err(|error| ConfigError::Unreadable { path: path.clone(), error })?;
        let token = text.trim();
        let is_plain = token.bytes().all(|byte| byte.is_ascii_graphic());
        if token.chars().count() < TOKEN_CHARS_MIN || !is_plain {
            return Err(ConfigError::WeakToken { path: path.clone(), chars: token.chars().count() });
        }
        Ok(Some(token.into()))
    }

    /// Where the state is kept.
    pub fn state_dir(&self) -> Result<PathBuf, ConfigError> {
        let variable = |name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
        self.state_dir
            .clone()
            .or_else(|| variable("STATE_DIRECTORY"))
            .or_else(|| variable("XDG_STATE_HOME").map(|home| home.join("praxinoscope")))
            .or_else(|| variable("HOME").map(|home| home.join(".local/state/praxinoscope")))
            .ok_or(ConfigError::NoStateDir)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(table: &toml::Table, prefix: &str) -> Vec<String> {
        let key = |(name, value): (&String, &toml::Value)| match value {
            toml::Value::Table(table) => keys(table, &format!("{prefix}{name}.")),
            _ => vec![format!("{prefix}{name}")],
        };
        table.iter().flat_map(key).collect()
    }

    #[test]
    fn the_documented_file_is_the_default_and_has_every_key() {
        assert_eq!(toml::from_str::<Config>(DOCUMENTED).unwrap(), Config::default());
        let everything = DOCUMENTED.replace("\n# token_file", "\ntoken_file").replace("\n# state_dir", "\nstate_dir");
        let full = Config { token_file: Some("t".into()), state_dir: Some("s".into()), ..Config::default() };
        let written = keys(&toml::Table::try_from(&full).unwrap(), "");
        assert_eq!(keys(&everything.parse().unwrap(), ""), written);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("praxi.toml");
        let of = |text: &str| {
            std::fs::write(&path, text).unwrap();
            let checked = Config::load(&path).and_then(|config| config.check().map(|_| ()));
            checked.unwrap_err().to_string()
        };
        assert!(of("\nrigs = 1").contains("line 2") && of("rigs = 1").contains("rigs"), "{}", of("\nrigs = 1"));
        assert!(of("device = \"sum\"").contains("sim:usb"));
        assert!(of("output = \"vga\"").contains("video:MONITOR"));
        assert!(of("listen = \"0.0.0.0:80\"").contains("token_file"));
        assert!(of("[render]\nbudget_px = nan").contains("render.budget_px"));
        assert!(of("[render]\nhalftone = \"grey\"").contains("sight-line"));
        assert!(of("[upload]\nbytes_max = 0").contains("upload.bytes_max"));
        let token = folder.path().join("token");
        for (text, ok) in [("short", false), ("0123456789abcdef\n", true), ("0123456789 abcdef", false)] {
            std::fs::write(&token, text).unwrap();
            let config = Config {
                token_file: Some(token.clone()),
                listen: SocketAddr::from(([0, 0, 0, 0], 80)),
                ..Config::default()
            };
            assert_eq!(config.check().is_ok(), ok, "{text}");
        }
    }
}
