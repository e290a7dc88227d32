//! Files and what they refer to.

use std::io;
use std::path::Path;

use super::Fault;
use crate::input;

/// Larger files are refused.
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
            other => other,
        })
    }
}

/// Beside a file that may not name others.
pub(super) struct Nowhere;

impl Resources for Nowhere {
    fn read(&self, place: &str, name: &str) -> Result<Vec<u8>, Fault> {
        let reason = "this file must hold everything itself: export it as one .glb".into();
        Err(Fault::Unreadable { place: format!("{place} \"{name}\": "), reason })
    }
}

/// The bytes of a regular file.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, Fault> {
    let unreadable = |error: io::Error| Fault::Unreadable { place: String::new(), reason: error.to_string() };
    input::read(path, BYTES_MAX).map_err(unreadable)
}
