//! The world around the firmware: seeded, deterministic, one clock.

pub mod check;
pub mod checkers;
pub mod device;
pub mod dfu;
pub mod eye;
pub mod faults;
pub mod flash;
pub mod frame_store;
pub mod motor;
pub mod noise;
pub mod plant;
pub mod projector;
pub mod scenario;
pub mod sensors;
pub mod simulator;
pub mod statistics;
pub mod world;
