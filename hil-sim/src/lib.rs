//! The world around the firmware: seeded, deterministic, one clock.

pub mod device;
pub mod eye;
pub mod frame_store;
