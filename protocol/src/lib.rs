//! What host, firmware and simulator agree on, and nothing else: units, the timing of a turn, rigs, and the wire.
//!
//! `no_std` without the default feature `std`, which adds [`rig`] (files, vectors, trigonometry).
#![cfg_attr(not(feature = "std"), no_std)]

pub mod codec;
pub mod frame_mark;
pub mod image;
pub mod message;
pub mod packet;
#[cfg(feature = "std")]
pub mod rig;
pub mod timing;
pub mod units;
