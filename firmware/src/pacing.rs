//! Who leads and who follows: the ways to keep mirror and projector in step.

use serde::{Deserialize, Serialize};

/// One of them. What each needs, promises and cannot notice is a table in `firmware/README.md`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pacing {
    /// The projector's clock is free and leads; the motor's torque keeps the mirror in step with it.
    #[default]
    FrameLocked,
    /// The same, of a projector that shows video: each frame says by a mark in its picture which of the turn it is, and the mirror is held to
    /// the one place that belongs to it.
    VideoLocked,
    /// The mirror leads: the projector is told when to begin each frame. The motor's torque keeps the speed near the rig's own.
    SensorLocked,
    /// The projector's clock leads, and a drive that keeps its own speed is told how fast to turn. Nothing measures the mirror.
    FixedSpeed,
}
