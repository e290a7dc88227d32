//! The scenes that may be wished for: built-in ones, the file of the command line, and those in a folder of the daemon's own.
//!
//! Nothing outside that folder is read or written by a name that came over the network: names are checked by their letters, links are
//! not followed, and a file may not name others. What is uploaded is read by a process of its own first, with little memory and time:
//! a parser that fails there fails alone.

use super::config::UploadKeys;
use crate::scene::{Animated, BUILT_IN, SceneError};
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::NamedTempFile;
use thiserror::Error;
use utoipa::ToSchema;

const ENDING: &str = ".glb";
/// The longest name.
const NAME_MAX: usize = 64;
/// What reading an uploaded file may take: seconds by the clock and of the processor, bytes.
const CHECK_TIME: Duration = Duration::from_secs(60);
const CHECK_CPU_S: u64 = 30;
const CHECK_BYTES: u64 = 6 << 30;
/// A file on its way has this before its name.
const ON_ITS_WAY: &str = ".upload-";

/// Why a scene is not taken, or not there.
#[derive(Debug, Error)]
pub enum LibraryError {
    /// See the message.
    #[error("{0:?} is no name: allowed are 1 to {NAME_MAX} letters, digits, '-' and '_', the first a letter or digit")]
    Name(String),
    /// See the message.
    #[error("{0}: a built-in scene, or the command line's, has this name: choose another")]
    BuiltIn(String),
    /// See the message.
    #[error("{0}: is no uploaded scene: only those can be deleted")]
    NotOwn(String),
    /// See the message.
    #[error("{0}: no such scene")]
    Unknown(String),
    /// See the message.
    #[error("{0}: is on the display: select another scene first")]
    InUse(String),
    /// See the message.
    #[error("the scene folder holds {0} scenes, the most that are allowed: delete one first")]
    Full(usize),
    /// See the message.
    #[error("{name}: {triangles} triangles: at most {allowed} are allowed")]
    TooManyTriangles {
        /// The scene.
        name: String,
        /// What it has.
        triangles: usize,
        /// The most.
        allowed: usize,
    },
    /// It cannot be read: the parser's words.
    #[error("{name}: {reason}")]
    Refused {
        /// The scene.
        name: String,
        /// Why.
        reason: String,
    },
    /// See the message.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// See the message.
    #[error("the scene folder: {0}")]
    Io(#[from] io::Error),
}

/// Where a scene comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Origin {
    /// It is part of the program.
    BuiltIn,
    /// The daemon was started with it.
    CommandLine,
    /// It lies in the scene folder.
    Folder,
}

/// A scene that may be wished for.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, ToSchema)]
pub struct Entry {
    /// Its name.
    pub name: String,
    /// Where it comes from.
    pub origin: Origin,
    /// The file's size, where there is one.
    pub bytes: Option<u64>,
}

/// What a scene file holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Content {
    /// Triangles at rest.
    pub triangles: usize,
    /// The clips' names.
    pub clips: Vec<String>,
    /// What the reader had to leave out or guess.
    pub notes: Vec<String>,
}

impl Content {
    /// Of a scene that was read.
    pub fn of(scene: &Animated) -> Self {
        Self {
            triangles: scene.at_rest().triangles.len(),
            clips: scene.clips().iter().map(|clip| clip.name.clone()).collect(),
            notes: scene.at_rest().notes.iter().map(ToString::to_string).collect(),
        }
    }
}

/// The scenes.
#[derive(Debug)]
pub struct Library {
    folder: PathBuf,
    given: Option<(String, PathBuf)>,
    limits: UploadKeys,
    /// The program whose command `scene` reads a file.
    checker: PathBuf,
}

impl Library {
    /// Over `folder`, which is made. `checker` is the program `praxi`.
    pub fn open(folder: PathBuf, limits: UploadKeys, checker: PathBuf) -> io::Result<Self> {
        fs::create_dir_all(&folder)?;
        for entry in fs::read_dir(&folder)?.flatten() {
            // What an earlier daemon was stopped in the middle of.
            if entry.file_name().to_string_lossy().starts_with(ON_ITS_WAY) {
                let _ = fs::remove_file(entry.path());
            }
        }
        Ok(Self::over(folder, limits, checker))
    }

    /// The same over a folder that need not be there; nothing is made or removed.
    pub fn over(folder: PathBuf, limits: UploadKeys, checker: PathBuf) -> Self {
        Self { folder, given: None, limits, checker }
    }

    /// Takes the scene of the command line: a name, or a file, which whoever starts the daemon may read. Gives its name.
    pub fn give(&mut self, scene: &str) -> Result<String, LibraryError> {
        let path = Path::new(scene);
        if path.extension().is_none() && !scene.contains(std::path::MAIN_SEPARATOR) {
            return self.find(scene).map(|entry| entry.name);
        }
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let plain = |letter: char| if letter.is_ascii_alphanumeric() || letter == '-' { letter } else { '_' };
        let name: String = stem.chars().map(plain).take(NAME_MAX).collect();
        let name = if BUILT_IN.contains(&name.as_str()) || name.starts_with(['-', '_']) {
            format!("file-{name}")
        } else {
            name
        };
        self.give_as(&name, path)?;
        Ok(name)
    }

    /// Takes the file at `path` as the scene `name`, in place of what was given before.
    pub fn give_as(&mut self, name: &str, path: &Path) -> Result<(), LibraryError> {
        check_name(name)?;
        // Read now: what cannot be shown is refused before anything begins.
        Animated::load(path)?;
        self.given = Some((name.into(), fs::canonicalize(path)?));
        Ok(())
    }

    /// All scenes, by origin and name.
    pub fn list(&self) -> Result<Vec<Entry>, LibraryError> {
        let mut entries: Vec<_> =
            BUILT_IN.iter().map(|name| Entry { name: (*name).into(), origin: Origin::BuiltIn, bytes: None }).collect();
        if let Some((name, path)) = &self.given {
            let bytes = fs::metadata(path).ok().map(|data| data.len());
            entries.push(Entry { name: name.clone(), origin: Origin::CommandLine, bytes });
        }
        entries.extend(self.in_folder()?);
        Ok(entries)
    }

    fn in_folder(&self) -> Result<Vec<Entry>, LibraryError> {
        let mut entries = Vec::new();
        let there = match fs::read_dir(&self.folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(entries),
            there => there?,
        };
        for entry in there {
            let entry = entry?;
            let file = entry.file_name().to_string_lossy().into_owned();
            let Some(name) = file.strip_suffix(ENDING).filter(|name| check_name(name).is_ok()) else { continue };
            // Of the entry itself, not of what a link leads to.
            let Ok(data) = entry.metadata() else { continue };
            let is_given = self.given.as_ref().is_some_and(|(given, _)| given == name);
            if data.is_file() && !is_given {
                entries.push(Entry { name: name.into(), origin: Origin::Folder, bytes: Some(data.len()) });
            }
        }
        entries.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(entries)
    }

    /// The scene called `name`.
    pub fn find(&self, name: &str) -> Result<Entry, LibraryError> {
        check_name(name)?;
        self.list()?.into_iter().find(|entry| entry.name == name).ok_or_else(|| LibraryError::Unknown(name.into()))
    }

    /// Reads the scene called `name`.
    pub fn load(&self, name: &str) -> Result<Animated, LibraryError> {
        let scene = match self.find(name)?.origin {
            Origin::BuiltIn => Animated::load(name)?,
            Origin::CommandLine => Animated::load(self.given.as_ref().map_or(Path::new(name), |(_, path)| path))?,
            Origin::Folder => Animated::load_alone(&self.path(name))?,
        };
        Ok(scene)
    }

    /// Takes `bytes` as the scene `name`, in place of one that has the name: all of it or nothing.
    pub fn upload(&self, name: &str, bytes: &[u8]) -> Result<Content, LibraryError> {
        check_name(name)?;
        if BUILT_IN.contains(&name) || self.given.as_ref().is_some_and(|(given, _)| given == name) {
            return Err(LibraryError::BuiltIn(name.into()));
        }
        let there = self.in_folder()?;
        if there.len() >= self.limits.scenes_max && !there.iter().any(|entry| entry.name == name) {
            return Err(LibraryError::Full(there.len()));
        }
        let mut file = tempfile::Builder::new().prefix(ON_ITS_WAY).suffix(ENDING).tempfile_in(&self.folder)?;
        file.write_all(bytes)?;
        file.as_file().sync_all()?;
        let content = self.check(name, &file)?;
        if content.triangles > self.limits.triangles_max {
            let (triangles, allowed) = (content.triangles, self.limits.triangles_max);
            return Err(LibraryError::TooManyTriangles { name: name.into(), triangles, allowed });
        }
        file.persist(self.path(name)).map_err(|error| error.error)?;
        Ok(content)
    }

    /// Whether the scene called `name` was uploaded.
    pub fn is_own(&self, name: &str) -> Result<bool, LibraryError> {
        Ok(self.find(name)?.origin == Origin::Folder)
    }

    /// Removes an uploaded scene.
    pub fn delete(&self, name: &str) -> Result<(), LibraryError> {
        if !self.is_own(name)? {
            return Err(LibraryError::NotOwn(name.into()));
        }
        Ok(fs::remove_file(self.path(name))?)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}{ENDING}"))
    }

    /// What `file` holds, as another process reads it.
    fn check(&self, name: &str, file: &NamedTempFile) -> Result<Content, LibraryError> {
        let refused = |reason: String| LibraryError::Refused { name: name.into(), reason };
        let child = Command::new(&self.checker)
            .arg("scene")
            .arg(file.path())
            .args(["--alone", "--json"])
            .env_clear()
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        limit(&child);
        let Some(output) = within(child, CHECK_TIME)? else {
            return Err(refused(format!("reading it took longer than {} s", CHECK_TIME.as_secs())));
        };
        if output.status.success() {
            return serde_json::from_slice(&output.stdout).map_err(|error| refused(error.to_string()));
        }
        let text = String::from_utf8_lossy(&output.stderr);
        let own_name = file.path().display().to_string();
        let reason = text
            .lines()
            .find_map(|line| line.strip_prefix("praxi: error: "))
            .map(|line| line.replace(&format!("{own_name}: "), "").replace(&own_name, name));
        Err(refused(
            reason.unwrap_or_else(|| "its parser failed: it needs too much memory or time, or is damaged".into()),
        ))
    }
}

#[cfg(target_os = "linux")]
fn limit(child: &Child) {
    use rustix::process::{Pid, Resource, Rlimit, prlimit};
    let Some(pid) = i32::try_from(child.id()).ok().and_then(Pid::from_raw) else { return };
    for (resource, most) in [(Resource::As, CHECK_BYTES), (Resource::Cpu, CHECK_CPU_S), (Resource::Fsize, 0)] {
        // It has ended already where this fails.
        let _ = prlimit(Some(pid), resource, Rlimit { current: Some(most), maximum: Some(most) });
    }
}

/// Elsewhere time alone is limited.
#[cfg(not(target_os = "linux"))]
fn limit(_child: &Child) {}

/// What `child` said, if it ends within `time`.
fn within(mut child: Child, time: Duration) -> io::Result<Option<Output>> {
    let until = Instant::now() + time;
    while child.try_wait()?.is_none() {
        if Instant::now() >= until {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child.wait_with_output().map(Some)
}

fn check_name(name: &str) -> Result<(), LibraryError> {
    let letter = |byte: u8| byte.is_ascii_alphanumeric();
    let first = name.bytes().next().is_some_and(letter);
    if first && name.len() <= NAME_MAX && name.bytes().all(|byte| letter(byte) || byte == b'-' || byte == b'_') {
        Ok(())
    } else {
        Err(LibraryError::Name(name.chars().take(NAME_MAX).collect()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::BUILTIN;
    use proptest::prelude::*;

    fn library(folder: &Path) -> Library {
        Library::open(folder.join("scenes"), UploadKeys::default(), "praxi".into()).unwrap()
    }

    #[test]
    fn names_that_lead_elsewhere_are_none() {
        let folder = tempfile::tempdir().unwrap();
        let library = library(folder.path());
        fs::write(folder.path().join("secret.glb"), "secret").unwrap();
        for name in
            ["", "..", ".", "../secret", "/etc/passwd", "a/b", "a\\b", "a.glb", "-a", "ä", "a\0", &"a".repeat(65)]
        {
            assert!(matches!(library.find(name), Err(LibraryError::Name(_))), "{name:?}");
            assert!(matches!(library.upload(name, b"x"), Err(LibraryError::Name(_))), "{name:?}");
            assert!(matches!(library.delete(name), Err(LibraryError::Name(_))), "{name:?}");
        }
        assert!(matches!(library.load("nothing"), Err(LibraryError::Unknown(_))));
    }

    #[test]
    #[cfg(unix)]
    fn links_are_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let library = library(folder.path());
        fs::write(folder.path().join("secret.glb"), "secret").unwrap();
        std::os::unix::fs::symlink(folder.path().join("secret.glb"), folder.path().join("scenes/link.glb")).unwrap();
        assert!(matches!(library.load("link"), Err(LibraryError::Unknown(_))));
    }

    #[test]
    fn built_in_scenes_stay() {
        let folder = tempfile::tempdir().unwrap();
        let library = library(folder.path());
        assert_eq!(library.list().unwrap().len(), BUILT_IN.len());
        assert!(BUILT_IN.iter().all(|name| library.load(name).is_ok()));
        assert!(matches!(library.upload(BUILTIN, b"x"), Err(LibraryError::BuiltIn(_))));
        assert!(matches!(library.delete(BUILTIN), Err(LibraryError::NotOwn(_))));
    }

    #[test]
    fn what_was_half_uploaded_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        drop(library(folder.path()));
        let half = folder.path().join("scenes/.upload-abc.glb");
        fs::write(&half, "half").unwrap();
        let library = library(folder.path());
        assert!(!half.exists() && library.in_folder().unwrap().is_empty());
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn a_name_that_is_taken_stays_in_the_folder(name in "\\PC{0,70}") {
            if check_name(&name).is_ok() {
                let path = Path::new("/scenes").join(format!("{name}{ENDING}"));
                prop_assert_eq!(path.parent(), Some(Path::new("/scenes")));
                prop_assert_eq!(path.components().count(), 3);
            }
        }
    }
}
