//! What keeps a turn from its device, in words.

use crate::link::LinkError;
use protocol::message::{Reason, SCHEMA, State, VERSION};
use protocol::packet::PacketError;
use std::time::Duration;
use thiserror::Error;

/// Why a turn or an order did not reach the device.
#[derive(Debug, Error)]
pub enum StreamError {
    /// See the message.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// See the message.
    #[error(transparent)]
    Packet(#[from] PacketError),
    /// See the message.
    #[error(
        "the device speaks protocol version {device_version}, schema {device_schema:#018x}; this program speaks version \
         {VERSION}, schema {SCHEMA:#018x}: install the same release on both; praxi doctor says how"
    )]
    Schema {
        /// The device's version.
        device_version: u16,
        /// The device's schema.
        device_schema: u64,
    },
    /// See the message.
    #[error("the device did not answer {message}, sent {attempts} time(s): praxi doctor may say why")]
    NoAnswer {
        /// The message's name.
        message: &'static str,
        /// How often it was sent.
        attempts: u32,
    },
    /// See the message.
    #[error("the device refused {message}: {reason}")]
    Refused {
        /// The message's name.
        message: &'static str,
        /// Why.
        #[source]
        reason: Reason,
    },
    /// See the message.
    #[error("the device was busy for {waited:?}: it holds two turns and shows neither to its end{}", in_state(*state))]
    Busy {
        /// How long it was asked.
        waited: Duration,
        /// What the controller was doing, if it said so.
        state: Option<State>,
    },
    /// See the message.
    #[error("turn {turn}: {planes} planes did not arrive in {attempts} attempts")]
    PlanesLost {
        /// The turn.
        turn: u32,
        /// How many.
        planes: usize,
        /// How often they were sent.
        attempts: usize,
    },
    /// See the message.
    #[error(
        "the mirror turns with turns of another rig or size: stop it first (praxi order stop), or give the rig that they \
         were streamed for"
    )]
    OtherTurns,
    /// Whoever gave the turn wants it no more.
    #[error("turn {turn} came too late and was left")]
    Left {
        /// The turn.
        turn: u32,
    },
    /// See the message.
    #[error("a turn of {slices} slices for a display of {expected}")]
    Slices {
        /// What was given.
        slices: u32,
        /// What the rotation has.
        expected: u32,
    },
    /// See the message.
    #[error("slice {slice} has {bytes} bytes: {expected} are needed")]
    PlaneBytes {
        /// The slice.
        slice: u32,
        /// What was given.
        bytes: usize,
        /// What the image size needs.
        expected: usize,
    },
}

impl StreamError {
    /// Whether the message names the device: see [`LinkError::names_device`].
    pub fn names_device(&self) -> bool {
        matches!(self, Self::Link(error) if error.names_device())
    }
}

fn in_state(state: Option<State>) -> String {
    state.map_or_else(String::new, |state| format!(" (state {state:?})"))
}
