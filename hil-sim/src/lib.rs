//! The world around the firmware: seeded, deterministic, one clock.

pub mod check;
pub mod checkers;
pub mod device;
pub mod dfu;
pub mod expectation;
pub mod eye;
pub mod faults;
pub mod faulty;
pub mod flash;
pub mod frame_store;
pub mod image;
pub mod lock_sweep;
pub mod loop_model;
pub mod motor;
pub mod noise;
pub mod observer;
pub mod plant;
pub mod projector;
pub mod scenario;
pub mod sensors;
pub mod simulator;
pub mod speed_drive;
pub mod statistics;
pub mod streaming;
pub mod tuning;
pub mod world;
