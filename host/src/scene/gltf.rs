//! To come.
use super::*;
pub(super) fn parse(_: &[u8], _: &dyn files::Resources) -> Result<Scene, Fault> {
    Err(Fault::malformed("file", "glTF is not read yet"))
}
