//! The world around the firmware: seeded, deterministic, one clock.
pub mod eye;
