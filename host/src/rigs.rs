//! Rigs by name or file.

use crate::input;
use protocol::rig::{Rig, RigError};
use std::io::{self, ErrorKind};
use std::path::Path;
use thiserror::Error;

/// The rigs that are built in: name and text.
pub const BUILT_IN: [(&str, &str); 4] = [
    ("reference", include_str!("../rigs/reference.toml")),
    ("reference-180hz", include_str!("../rigs/reference-180hz.toml")),
    ("high-viewer", include_str!("../rigs/high-viewer.toml")),
    ("tent", include_str!("../rigs/tent.toml")),
];

/// Why there is no such rig.
#[derive(Debug, Error)]
pub enum RigsError {
    /// The rig is refused.
    #[error("{0}: {1}")]
    Refused(String, RigError),
    /// The file cannot be read.
    #[error("{0}: {1}")]
    Unreadable(String, io::Error),
    /// Neither a file nor a name.
    #[error("{0}: no such file; built-in rigs are {names}", names = BUILT_IN.map(|(name, _)| name).join(", "))]
    Unknown(String),
}

/// The built-in rig `name`, or the one in file `name`.
pub fn find(name: &str) -> Result<Rig, RigsError> {
    Rig::parse(&text(name)?).map_err(|error| RigsError::Refused(name.into(), error))
}

/// What stands in its file.
pub fn text(name: &str) -> Result<String, RigsError> {
    if let Some((_, text)) = BUILT_IN.iter().find(|(built_in, _)| *built_in == name) {
        return Ok((*text).into());
    }
    match input::read_text(Path::new(name)) {
        Ok(text) => Ok(text),
        Err(error) if error.kind() == ErrorKind::NotFound => Err(RigsError::Unknown(name.into())),
        Err(error) => Err(RigsError::Unreadable(name.into(), error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_rigs_are_possible_and_called_what_they_are() {
        for (name, _) in BUILT_IN {
            assert_eq!(find(name).unwrap().name, name);
        }
        assert!(find("nowhere").unwrap_err().to_string().contains("reference, reference-180hz, high-viewer, tent"));
    }
}
