//! The world around the firmware: seeded, deterministic, one clock.

pub mod check;
pub mod checkers;
pub mod faults;
pub mod motor;
pub mod noise;
pub mod plant;
pub mod projector;
pub mod scenario;
pub mod sensors;
pub mod statistics;
pub mod world;
