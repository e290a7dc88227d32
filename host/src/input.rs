//! Files from outside: regular ones of bounded size. A device or a pipe may never end.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

/// Rigs, motors, scenarios, notes: text that people write.
pub const TEXT_BYTES_MAX: u64 = 16 << 20;
/// A picture: 4096 × 4096 pixels of 8 bytes, uncompressed, and some.
pub const PICTURE_BYTES_MAX: u64 = 256 << 20;
/// The largest recording.
pub const RECORDING_BYTES_MAX: u64 = 1 << 30;

/// The bytes of the regular file at `path`, of which there may be `bytes_max`.
pub fn read(path: &Path, bytes_max: u64) -> io::Result<Vec<u8>> {
    let metadata = fs::metadata(path)?;
    if !metadata.is_file() {
        return Err(io::Error::new(ErrorKind::InvalidInput, "not a regular file"));
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(bytes_max + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > bytes_max {
        let message = format!("{} bytes, allowed are at most {bytes_max}", metadata.len());
        return Err(io::Error::new(ErrorKind::FileTooLarge, message));
    }
    Ok(bytes)
}

/// The regular file at `path`, to be read piece by piece, and its length.
pub fn open(path: &Path) -> io::Result<(File, u64)> {
    let file = File::open(path)?;
    let metadata = file.metadata()?;
    if !metadata.is_file() {
        return Err(io::Error::new(ErrorKind::InvalidInput, "not a regular file"));
    }
    Ok((file, metadata.len()))
}

/// Whether the file at `path` is a regular one that begins with `start`.
pub fn begins_with(path: &Path, start: &[u8]) -> io::Result<bool> {
    if !fs::metadata(path)?.is_file() {
        return Ok(false);
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(start.len() as u64).read_to_end(&mut bytes)?;
    Ok(bytes == start)
}

/// The text of the regular file at `path`, UTF-8, of which there may be [`TEXT_BYTES_MAX`].
pub fn read_text(path: &Path) -> io::Result<String> {
    String::from_utf8(read(path, TEXT_BYTES_MAX)?)
        .map_err(|error| io::Error::new(ErrorKind::InvalidData, format!("not UTF-8 text: {}", error.utf8_error())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_of_moderate_size_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, "text").unwrap();
        assert_eq!(read(&path, 4).unwrap(), b"text");
        assert!(read(&path, 3).unwrap_err().to_string().contains("at most 3"));
        assert!(read(folder.path(), 4).is_err());
        fs::write(&path, [0xFF]).unwrap();
        assert!(read_text(&path).unwrap_err().to_string().contains("UTF-8"));
        #[cfg(unix)]
        assert!(read(Path::new("/dev/zero"), 4).unwrap_err().to_string().contains("regular"));
    }
}
