//! The inner operations of rendering a turn, as pure functions on the CPU. Those that a GPU runs stand beside
//! their WGSL pair `x.wgsl`: see [`wgsl`].
//!
//! [`project`]: scene point to (u, v, depth), and a pixel back to its sight line. [`halftone`]: luminance to one bit.
//! [`pack`]: 24 slices to one frame.

pub mod halftone;
pub mod pack;
pub mod project;
mod shuffle;
pub mod wgsl;
