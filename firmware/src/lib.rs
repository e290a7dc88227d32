//! The controller's core: pure, `no_std`, without allocation. One [`step`](controller::Controller::step) an input.
#![no_std]

pub mod plane_store;
