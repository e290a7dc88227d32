//! To come.
use super::*;
pub(super) fn parse(_: &[u8]) -> Result<Scene, Fault> {
    Err(Fault::malformed("file", "PLY is not read yet"))
}
