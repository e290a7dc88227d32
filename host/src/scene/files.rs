//! Files and what they refer to.

use std::fs;
use std::io::Read;
use std::path::Path;

use super::Fault;

/// Larger files are refused before they are read.
const BYTES_MAX: u64 = 8 << 30;

/// Where a scene file finds the files that it names. Tests put memory in place of a folder.
pub(super) trait Resources {
    /// The bytes of the file called `name` beside the scene. `place` says what refers to it.
    fn read(&self, place: &str, name: &str) -> Result<Vec<u8>, Fault>;
}

/// The folder that the scene file lies in.
pub(super) struct Folder<'a>(pub &'a Path);

impl Resources for Folder<'_> {
    fn read(&self, place: &str, name: &str) -> Result<Vec<u8>, Fault> {
        let at = format!("{place} \"{name}\": ");
        if Path::new(name).is_absolute() {
            let reason = "allowed are names relative to the scene's folder".into();
            return Err(Fault::Unreadable { place: at, reason });
        }
        read(&self.0.join(name)).map_err(|fault| match fault {
            Fault::Unreadable { reason, .. } => Fault::Unreadable { place: at, reason },
            Fault::TooLarge { count, what, limit, .. } => Fault::TooLarge { place: at, count, what, limit },
            other => other,
        })
    }
}

/// The bytes of a regular file.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, Fault> {
    let unreadable = |reason: String| Fault::Unreadable { place: String::new(), reason };
    let metadata = fs::metadata(path).map_err(|e| unreadable(e.to_string()))?;
    // A device or a pipe may never end.
    if !metadata.is_file() {
        return Err(unreadable("not a regular file".into()));
    }
    if metadata.len() > BYTES_MAX {
        let place = "file".into();
        return Err(Fault::TooLarge { place, count: metadata.len(), what: "bytes", limit: BYTES_MAX });
    }
    let mut bytes = Vec::new();
    let file = fs::File::open(path).map_err(|e| unreadable(e.to_string()))?;
    file.take(BYTES_MAX).read_to_end(&mut bytes).map_err(|e| unreadable(e.to_string()))?;
    Ok(bytes)
}
