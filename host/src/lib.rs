//! Praxinoscope's host library: a scene becomes the slices of a turn, the turn reaches a device, and what an eye sees of it.

pub mod bake;
pub mod bench;
pub mod chart;
pub mod commands;
pub mod daemon;
pub mod doctor;
pub mod flash;
pub mod halftoned;
pub mod input;
pub mod link;
pub mod machine;
pub mod measure;
pub mod output;
pub mod pattern;
pub mod picture;
pub mod render;
pub mod rendered;
pub mod rigs;
pub mod scene;
pub mod seen;
pub mod sheet;
pub mod stream;
pub mod tracking;
pub mod video;
pub mod volume;
pub mod wire_chart;
