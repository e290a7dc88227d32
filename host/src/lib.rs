//! Praxinoscope's host library.

pub mod measure;
pub mod picture;
pub mod render;
pub mod scene;
pub mod seen;
