//! The command line as a user meets it: results, bad input, exit codes, nothing half-written.

mod arguments;
mod bake;
mod calibrate;
#[cfg(unix)]
mod daemon;
mod desk;
#[cfg(unix)]
mod devices;
#[cfg(unix)]
mod everything;
mod measured;
mod plan;
#[cfg(unix)]
mod recording;
mod register;
mod render;
mod rig;
mod served;
mod simulated;
mod streamed;
#[cfg(unix)]
mod video;

const TRIANGLE: &str = "v 0 0 0\nv 0.03 0 0\nv 0 0.03 0\nf 1 2 3\n";
