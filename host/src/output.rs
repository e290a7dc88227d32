//! Results appear whole or not at all: they are made under a name of their own beside their place, then moved there.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use tempfile::{Builder, NamedTempFile, TempDir};
use thiserror::Error;

/// Why a result has no place.
#[derive(Debug, Error)]
pub enum OutputError {
    /// The operating system refuses.
    #[error("cannot write {0}: {1}")]
    Refused(PathBuf, io::Error),
    /// A folder is in the way that praxi did not make.
    #[error("{0} is not empty and was not made by praxi: name a new or empty folder")]
    Foreign(PathBuf),
    /// A file is in the way.
    #[error("{0} is a file: name a folder")]
    NotAFolder(PathBuf),
}

/// The files by which a folder is known as one that praxi made, and may replace.
const MARKS: [&str; 2] = ["rotation.json", "report.json"];

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
    /// Begins a folder that will stand at `place`: where nothing, an empty folder, or an earlier result of praxi is.
    pub fn begin(place: &Path) -> Result<Self, OutputError> {
        let refused = |error| OutputError::Refused(place.into(), error);
        if place.exists() {
            if !place.is_dir() {
                return Err(OutputError::NotAFolder(place.into()));
            }
            let empty = fs::read_dir(place).map_err(refused)?.next().is_none();
            if !empty && !MARKS.iter().any(|mark| place.join(mark).is_file()) {
                return Err(OutputError::Foreign(place.into()));
            }
        }
        fs::create_dir_all(parent(place)).map_err(refused)?;
        let mut builder = builder();
        #[cfg(unix)]
        builder.permissions(mode(0o777));
        let staging = builder.tempdir_in(parent(place)).map_err(refused)?;
        half_made(|paths| paths.push(staging.path().into()));
        Ok(Self { place: place.into(), staging })
    }

    /// Where to write until it is finished.
    pub fn path(&self) -> &Path {
        self.staging.path()
    }

    /// Writes a file into it.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), OutputError> {
        fs::write(self.path().join(name), bytes).map_err(|error| OutputError::Refused(self.place.join(name), error))
    }

    /// Moves it to its place; what stood there is gone only then.
    pub fn finish(self) -> Result<(), OutputError> {
        let refused = |error| OutputError::Refused(self.place.clone(), error);
        let staging = self.staging.path().to_path_buf();
        if self.place.exists() {
            let old = builder().tempdir_in(parent(&self.place)).map_err(refused)?;
            fs::rename(&self.place, old.path().join("old")).map_err(refused)?;
        }
        fs::rename(&staging, &self.place).map_err(refused)?;
        half_made(|paths| paths.retain(|path| *path != staging));
        // Nothing is left there for it to remove.
        let _ = self.staging.keep();
        Ok(())
    }
}

/// A file in the making.
#[derive(Debug)]
pub struct File {
    place: PathBuf,
    staging: NamedTempFile,
}

impl File {
    /// Begins a file that will stand at `place`, in a folder that exists.
    pub fn begin(place: &Path) -> Result<Self, OutputError> {
        let refused = |error| OutputError::Refused(place.into(), error);
        if place.is_dir() {
            return Err(refused(io::ErrorKind::IsADirectory.into()));
        }
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
        let refused = |error| OutputError::Refused(self.place.clone(), error);
        self.staging.write_all(bytes).map_err(refused)?;
        let place = self.place.clone();
        let persisted = self.staging.persist(&place).map_err(|error| OutputError::Refused(place, error.error));
        half_made(|paths| paths.retain(|path| *path != staging));
        persisted.map(drop)
    }
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
        for text in ["one", "two"] {
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
        fs::write(root.path().join("precious.txt"), "x").unwrap();
        assert!(matches!(Folder::begin(root.path()), Err(OutputError::Foreign(_))));
        let file = root.path().join("precious.txt");
        assert!(matches!(Folder::begin(&file), Err(OutputError::NotAFolder(_))));
        assert!(matches!(Folder::begin(&file.join("in")), Err(OutputError::Refused(..))));
        assert!(File::begin(root.path()).is_err());
        assert!(File::begin(&root.path().join("none/a.png")).is_err());
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
