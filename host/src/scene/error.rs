//! What can be wrong with a scene file, each in one line that says what, where, and what is allowed.

use std::path::Path;

use super::{EXTENSIONS, TRIANGLES_MAX};

/// A scene that could not be loaded: the file, and what is wrong with it.
#[derive(Debug, thiserror::Error)]
#[error("{file}: {fault}")]
pub struct SceneError {
    /// The path as it was given.
    pub file: String,
    /// What is wrong.
    pub fault: Fault,
}

impl SceneError {
    pub(super) fn new(path: &Path, fault: Fault) -> Self {
        Self { file: path.display().to_string(), fault }
    }
}

/// What is wrong with a scene file. `place` says where in it, e.g. `mesh 2 primitive 0 vertex 17` or `line 12`.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// The file itself, or one that it refers to, cannot be opened or read.
    #[error("{place}cannot be read: {reason}")]
    Unreadable {
        /// Empty for the file itself, else what refers to which file, with a colon and a space.
        place: String,
        /// The operating system's words, or why the name is refused.
        reason: String,
    },
    /// The file's ending is not one we read.
    #[error("unknown kind of file \"{extension}\", allowed are .{} and the names {}", EXTENSIONS.join(", ."), super::BUILT_IN.join(", "))]
    UnknownKind {
        /// In lower case, without its dot.
        extension: String,
    },
    /// The file does not follow its format, or ends early.
    #[error("{place}: {problem}")]
    Malformed {
        /// Where.
        place: String,
        /// What, and what is allowed.
        problem: String,
    },
    /// The file asks for something that we do not draw.
    #[error("{place}: {feature} is not supported, allowed is {allowed}")]
    Unsupported {
        /// Where.
        place: String,
        /// What the file asks for.
        feature: String,
        /// What it may ask for.
        allowed: String,
    },
    /// There is nothing to draw.
    #[error("no triangles{detail}; at least one triangle with an area is needed")]
    Empty {
        /// What there was instead, beginning with a space or comma, or empty.
        detail: String,
    },
    /// A number is not finite or beyond all measure.
    #[error("{place}: {what} {value} is out of range, allowed are finite numbers within +-1e15")]
    NotFinite {
        /// Where.
        place: String,
        /// Which number, e.g. `position`.
        what: &'static str,
        /// As read.
        value: String,
    },
    /// An index points past the end of what it counts.
    #[error("{place}: index {index} is out of range, allowed are {allowed}")]
    IndexOutOfRange {
        /// Where.
        place: String,
        /// As in the file.
        index: i64,
        /// In words.
        allowed: String,
    },
    /// More triangles, vertices or bytes than we take.
    #[error("{place}: {count} {what}, allowed are at most {limit} (and {TRIANGLES_MAX} triangles in all)")]
    TooLarge {
        /// Where.
        place: String,
        /// How many.
        count: u64,
        /// Of what.
        what: &'static str,
        /// How many would do.
        limit: u64,
    },
}

impl Fault {
    pub(super) fn malformed(place: impl Into<String>, problem: impl std::fmt::Display) -> Self {
        Self::Malformed { place: place.into(), problem: one_line(&problem.to_string()) }
    }
}

/// Messages of other libraries, without line breaks and without quoting half of the file.
fn one_line(text: &str) -> String {
    let mut line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if line.chars().count() > 240 {
        line = line.chars().take(240).chain("...".chars()).collect();
    }
    line
}
