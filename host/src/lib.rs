//! Praxinoscope's host library.

pub mod scene;
