//! Triangles to slices on the CPU: blocks of 8 × 4 pixels in 16-bit fixed point, with the vector instructions that the machine has.
//!
//! It knows no scenes and no plans: a [`Figure`] is plain numbers. All `unsafe` of the workspace but for libusb's transfers
//! (`host/bulk`) is here, and nothing that is slow to compile, so that an interpreter that sees undefined behaviour can run all of it:
//! `cargo +nightly miri test --package raster`.
//!
//! Everything that is generic over [`Block`] is `inline(always)`, so that it is compiled for the instructions of the [`Level`] that runs
//! it. The types that are blocks cannot be named outside of this crate: who has one got it in [`Level::run`], which has asked the machine.

mod block;
mod cover;
mod draw;
mod figure;
mod grid;
mod level;
mod panel;
mod picture;
mod setup;
mod surface;
#[cfg(test)]
mod tests;
mod tile;
mod vertices;

pub use block::Block;
pub use draw::{Scene, Touched, View, draw};
pub use figure::{Figure, Ink, Inks, SMOOTH_MAX, WHITE, level};
pub use grid::{FAR_PX, Grid, depth_step_m};
pub use level::{Level, Work};
pub use panel::Panel;
pub use picture::{FULL, Picture, Skin, Wrap};
pub use surface::{Bits, Greys, Surface};
pub use tile::Tile;
pub use vertices::Vertices;
