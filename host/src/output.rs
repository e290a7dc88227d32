//! Results appear whole or not at all: they are made under a name of their own beside their place, then moved there.

use crate::input;
use std::ffi::OsString;
use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use tempfile::{Builder, NamedTempFile, TempDir};
use thiserror::Error;

/// Why a result has no place.
#[derive(Debug, Error)]
pub enum OutputError {
    /// The operating system refuses.
    #[error("cannot write {0}: {reason}", reason = reason(.1))]
    Refused(PathBuf, io::Error),
    /// Something is in the way that praxi did not make.
    #[error("{0} is not empty, it holds {1}, and was not written by praxi: name a new or empty folder")]
    Foreign(PathBuf, String),
    /// A file is in the way.
    #[error("{0} is no folder: name one, or a new name")]
    NotAFolder(PathBuf),
    /// Something else than a picture is in the way.
    #[error("{0} is there and no PNG file: name another")]
    NotAPicture(PathBuf),
}

/// What the operating system says, and what to do where the disk is full.
pub fn reason(error: &io::Error) -> String {
    use io::ErrorKind::{QuotaExceeded, StorageFull};
    let remedy =
        if matches!(error.kind(), StorageFull | QuotaExceeded) { ": make room there, or write elsewhere" } else { "" };
    format!("{error}{remedy}")
}

/// Whether `name` is one that praxi gives to a file in a folder of results.
pub fn is_ours(name: &str) -> bool {
    let numbered = |stem: &str| {
        let number = name.strip_prefix(stem).and_then(|rest| rest.strip_suffix(".png"));
        number.is_some_and(|number| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()))
    };
    let chart = ["chart.svg", "chart.png", "chart.csv", "chart.json", "summary.md"];
    let lock_chart = ["lock-chart.svg", "lock-chart.png", "lock-chart.json"];
    let bench = ["bench.svg", "bench.png", "bench.txt", "bench.json"];
    matches!(name, "rotation.json" | "report.json" | "eyes.png" | "orbit.gif" | "slices.png" | "lock.png")
        || chart.contains(&name)
        || bench.contains(&name)
        || lock_chart.contains(&name)
        || numbered("frame_")
        || numbered("slice_")
}

/// What lies in `folder` that is not ours.
fn foreign(folder: &Path) -> io::Result<Vec<OsString>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if !entry.file_type()?.is_file() || !is_ours(&entry.file_name().to_string_lossy()) {
            names.push(entry.file_name());
        }
    }
    Ok(names)
}

/// Whether praxi wrote a result into `folder`: its note says so.
fn is_result(folder: &Path) -> bool {
    ["rotation.json", "report.json", "chart.json", "bench.json", "lock-chart.json"].iter().any(|note| {
        let text = input::read_text(&folder.join(note)).unwrap_or_default();
        serde_json::from_str(&text).is_ok_and(|note: serde_json::Value| note["program"] == "praxi")
    })
}

/// Says why without the name under which a result is made.
fn plain(error: &io::Error) -> io::Error {
    match (error.raw_os_error(), error.kind()) {
        (Some(number), _) => io::Error::from_raw_os_error(number),
        (None, io::ErrorKind::NotFound) => io::Error::new(io::ErrorKind::NotFound, "no such folder"),
        (None, kind) => kind.into(),
    }
}

/// Half-made results, removed by [`remove_half_made`].
static HALF_MADE: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn half_made<T>(change: impl FnOnce(&mut Vec<PathBuf>) -> T) -> T {
    change(&mut HALF_MADE.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Removes what is half made, for a program that is told to stop.
pub fn remove_half_made() {
    half_made(|paths| {
        for path in paths.drain(..) {
            // Either of the two fails; neither matters any more.
            let _ = fs::remove_dir_all(&path).or_else(|_| fs::remove_file(&path));
        }
    });
}

/// Permissions as a plain `open` or `mkdir` would give them: the process's mask decides.
fn builder() -> Builder<'static, 'static> {
    let mut builder = Builder::new();
    builder.prefix(".praxi-");
    builder
}

#[cfg(unix)]
fn mode(mode: u32) -> fs::Permissions {
    std::os::unix::fs::PermissionsExt::from_mode(mode)
}

/// The folder that `path` stands in.
fn parent(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A folder in the making.
#[derive(Debug)]
pub struct Folder {
    place: PathBuf,
    staging: TempDir,
}

impl Folder {
    /// Begins a folder that will stand at `place`: where nothing is, an empty folder, or an earlier result. A link is followed.
    pub fn begin(place: &Path) -> Result<Self, OutputError> {
        let refused = |error: io::Error| OutputError::Refused(place.into(), plain(&error));
        let target = followed(place).map_err(refused)?;
        if target.exists() {
            if !target.is_dir() {
                return Err(OutputError::NotAFolder(place.into()));
            }
            may_replace(&target)?;
        }
        fs::create_dir_all(parent(&target)).map_err(refused)?;
        let mut builder = builder();
        #[cfg(unix)]
        builder.permissions(mode(0o777));
        let staging = builder.tempdir_in(parent(&target)).map_err(refused)?;
        half_made(|paths| paths.push(staging.path().into()));
        Ok(Self { place: target, staging })
    }

    /// Where to write until it is finished.
    pub fn path(&self) -> &Path {
        self.staging.path()
    }

    /// Writes a file into it.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), OutputError> {
        fs::write(self.path().join(name), bytes)
            .map_err(|error| OutputError::Refused(self.place.join(name), plain(&error)))
    }

    /// Moves it to its place. An earlier result that stood there is gone only then; whatever else lay with it stays.
    pub fn finish(self) -> Result<(), OutputError> {
        let staging = self.staging.path().to_path_buf();
        // Whoever is told to stop waits for the lock, so that a result is never between its places.
        half_made(|paths| {
            self.replace(&staging)?;
            paths.retain(|path| *path != staging);
            Ok(())
        })?;
        // Nothing is left there for it to remove.
        let _ = self.staging.keep();
        Ok(())
    }

    fn replace(&self, staging: &Path) -> Result<(), OutputError> {
        let refused = |error: io::Error| OutputError::Refused(self.place.clone(), plain(&error));
        if !self.place.exists() {
            return fs::rename(staging, &self.place).map_err(refused);
        }
        may_replace(&self.place)?;
        let kept = foreign(&self.place).map_err(refused)?;
        let old = builder().tempdir_in(parent(&self.place)).map_err(refused)?;
        let old_place = old.path().join("old");
        fs::rename(&self.place, &old_place).map_err(refused)?;
        let moved = kept.iter().try_for_each(|name| fs::rename(old_place.join(name), staging.join(name)));
        if let Err(error) = moved.and_then(|()| fs::rename(staging, &self.place)) {
            // Back to how it was; what cannot be moved back must not be removed.
            let back = |name: &OsString| fs::rename(staging.join(name), old_place.join(name));
            kept.iter().filter(|name| staging.join(name).exists()).for_each(|name| drop(back(name)));
            if fs::rename(&old_place, &self.place).is_err() {
                let _ = old.keep();
            }
            return Err(refused(error));
        }
        Ok(())
    }
}

/// Whether a result may take the place of the folder `place`: it is empty, or an earlier result.
fn may_replace(place: &Path) -> Result<(), OutputError> {
    let mut entries = fs::read_dir(place).map_err(|error| OutputError::Refused(place.into(), plain(&error)))?;
    match entries.next() {
        Some(Ok(entry)) if !is_result(place) => {
            Err(OutputError::Foreign(place.into(), entry.file_name().to_string_lossy().into_owned()))
        }
        _ => Ok(()),
    }
}

/// Where `place` leads, if it is a link.
fn followed(place: &Path) -> io::Result<PathBuf> {
    if place.is_symlink() { fs::canonicalize(place) } else { Ok(place.into()) }
}

/// A file in the making.
#[derive(Debug)]
pub struct File {
    place: PathBuf,
    staging: NamedTempFile,
}

impl File {
    /// Begins a picture that will stand at `place`, in a folder that exists: where nothing is, or another PNG file. A link is
    /// followed.
    pub fn begin(place: &Path) -> Result<Self, OutputError> {
        let refused = |error: io::Error| OutputError::Refused(place.into(), plain(&error));
        let target = followed(place).map_err(refused)?;
        if target.is_dir() {
            return Err(refused(io::ErrorKind::IsADirectory.into()));
        }
        if target.exists() && !is_png(&target).map_err(refused)? {
            return Err(OutputError::NotAPicture(place.into()));
        }
        Self::begin_over(&target)
    }

    /// Begins a file that will stand at `place`, in a folder that exists, and take the place of whatever file is there: the caller
    /// knows it as its own.
    pub fn begin_over(place: &Path) -> Result<Self, OutputError> {
        let refused = |error: io::Error| OutputError::Refused(place.into(), plain(&error));
        let mut builder = builder();
        #[cfg(unix)]
        builder.permissions(mode(0o666));
        let staging = builder.tempfile_in(parent(place)).map_err(refused)?;
        half_made(|paths| paths.push(staging.path().into()));
        Ok(Self { place: place.into(), staging })
    }

    /// Writes it and moves it to its place.
    pub fn finish(mut self, bytes: &[u8]) -> Result<(), OutputError> {
        let staging = self.staging.path().to_path_buf();
        let refused = |error: io::Error| OutputError::Refused(self.place.clone(), plain(&error));
        self.staging.write_all(bytes).map_err(refused)?;
        let place = self.place.clone();
        let persisted = self.staging.persist(&place).map_err(|error| OutputError::Refused(place, plain(&error.error)));
        half_made(|paths| paths.retain(|path| *path != staging));
        persisted.map(drop)
    }
}

/// Whether the file at `path` is a regular one that is empty or begins as a PNG does.
fn is_png(path: &Path) -> io::Result<bool> {
    if !fs::metadata(path)?.is_file() {
        return Ok(false);
    }
    let mut start = Vec::new();
    fs::File::open(path)?.take(8).read_to_end(&mut start)?;
    Ok(start.is_empty() || start == *b"\x89PNG\r\n\x1a\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_appears_whole_or_not_at_all() {
        let root = tempfile::tempdir().unwrap();
        let place = root.path().join("a/b");
        drop(Folder::begin(&place).unwrap());
        assert!(!place.exists());
        for text in [r#"{"program": "praxi", "turn": 1}"#, r#"{"program": "praxi", "turn": 2}"#] {
            let folder = Folder::begin(&place).unwrap();
            folder.write("report.json", text.as_bytes()).unwrap();
            folder.finish().unwrap();
            assert_eq!(fs::read_to_string(place.join("report.json")).unwrap(), text);
        }
        assert_eq!(fs::read_dir(root.path().join("a")).unwrap().count(), 1);
    }

    #[test]
    fn what_praxi_did_not_make_stays() {
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join("precious.txt");
        for note in ["", "{}", "{\"program\": \"other\"}"] {
            fs::write(root.path().join("rotation.json"), note).unwrap();
            fs::write(&file, "x").unwrap();
            assert!(matches!(Folder::begin(root.path()), Err(OutputError::Foreign(..))));
        }
        assert!(matches!(Folder::begin(&file), Err(OutputError::NotAFolder(_))));
        assert!(matches!(Folder::begin(&file.join("in")), Err(OutputError::Refused(..))));
        assert!(matches!(File::begin(&file), Err(OutputError::NotAPicture(_))));
        assert!(File::begin(root.path()).is_err());
        assert!(File::begin(&root.path().join("none/a.png")).is_err());
        // What comes while the result is made stays too.
        let place = root.path().join("turn");
        let folder = Folder::begin(&place).unwrap();
        fs::create_dir(&place).unwrap();
        fs::write(place.join("notes.txt"), "x").unwrap();
        assert!(matches!(folder.finish(), Err(OutputError::Foreign(..))));
        assert_eq!(fs::read_dir(&place).unwrap().count(), 1);
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 3);
    }

    #[test]
    fn what_lies_beside_an_earlier_result_stays() {
        let root = tempfile::tempdir().unwrap();
        let place = root.path().join("turn");
        fs::create_dir_all(place.join("sub")).unwrap();
        fs::write(place.join("sub/thesis.txt"), "x").unwrap();
        fs::write(place.join("rotation.json"), "{\"program\": \"praxi\"}").unwrap();
        fs::write(place.join("frame_00.png"), "old").unwrap();
        let folder = Folder::begin(&place).unwrap();
        folder.write("report.json", b"{}").unwrap();
        folder.finish().unwrap();
        let mut names: Vec<_> = fs::read_dir(&place).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["report.json", "sub"]);
        assert_eq!(fs::read_to_string(place.join("sub/thesis.txt")).unwrap(), "x");
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_devices_refused() {
        let root = tempfile::tempdir().unwrap();
        let path = |name: &str| root.path().join(name);
        fs::create_dir(path("real")).unwrap();
        std::os::unix::fs::symlink(path("real"), path("link")).unwrap();
        let folder = Folder::begin(&path("link")).unwrap();
        folder.write("report.json", b"x").unwrap();
        folder.finish().unwrap();
        assert!(path("link").is_symlink() && path("real/report.json").is_file());
        assert!(matches!(File::begin(Path::new("/dev/null")), Err(OutputError::NotAPicture(_))));
        assert!(matches!(Folder::begin(Path::new("/dev/null")), Err(OutputError::NotAFolder(_))));
    }

    #[test]
    fn a_file_appears_whole_or_not_at_all() {
        let root = tempfile::tempdir().unwrap();
        let place = root.path().join("a.png");
        drop(File::begin(&place).unwrap());
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 0);
        File::begin(&place).unwrap().finish(b"x").unwrap();
        assert_eq!(fs::read(&place).unwrap(), b"x");
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 1);
    }
}
