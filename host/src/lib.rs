//! Praxinoscope's host library.

pub mod link;
pub mod stream;
