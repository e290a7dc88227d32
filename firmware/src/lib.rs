//! The controller's core: pure, `no_std`, without allocation. One [`step`](controller::Controller::step) an input.
//!
//! Where the projector's planes run on a free clock the mirror follows it, by torque or by a drive that keeps its own speed; where they begin
//! when told they follow the mirror: [`pacing`]. Angles inside are *progress*: how far the mirror has turned since the index in its own direction, so that clockwise rigs differ in one sign only.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod actuator;
pub mod angle;
pub mod config;
pub mod controller;
pub mod conversation;
pub mod covariance;
pub mod drive;
pub mod fault_log;
pub mod follower;
pub mod frame_store;
pub mod frames;
pub mod hosted;
pub mod lockstep;
pub mod pacing;
pub mod plane_run;
pub mod plane_store;
pub mod port_store;
pub mod probit;
pub mod projector_sync;
pub mod rotation;
pub mod safety;
pub mod sequencer;
pub mod single;
pub mod speed_command;
pub mod speed_window;
pub mod station;
pub mod time_base;
pub mod trajectory;
pub mod velocity_lock;
pub mod video_index;
pub mod wire_end;
