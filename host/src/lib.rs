//! Praxinoscope's host library: a scene becomes the slices of a turn, and what an eye would see of them.

pub mod commands;
pub mod measure;
pub mod output;
pub mod picture;
pub mod render;
pub mod rendered;
pub mod rigs;
pub mod scene;
pub mod seen;
pub mod sheet;
pub mod volume;
