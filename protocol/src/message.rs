//! What host and controller say to each other.

use serde::{Deserialize, Serialize};

/// What the controller is doing. The projector is dark in all states but `Locked`, `Holdover` and `Service`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[repr(u8)]
pub enum State {
    /// No torque, dark; waits for [`Command::Start`].
    #[default]
    Idle,
    /// The mirror is brought to the speed that the projector's clock asks for.
    SpinUp,
    /// At speed; the phase is pulled in.
    Acquire,
    /// The mirror is in step: planes are lit.
    Locked,
    /// Pulses are missing; planes are lit on the last good model, for a limited time.
    Holdover,
    /// Stopped for a reason that a person must look at; left only by [`Command::ClearFault`].
    Fault,
    /// Mirror parked without torque, a pattern lit for a limited time on command.
    Service,
}

impl State {
    /// Whether a plane may be lit.
    pub const fn may_light(self) -> bool {
        matches!(self, Self::Locked | Self::Holdover | Self::Service)
    }
}

/// Why the controller stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[repr(u8)]
pub enum Fault {
    /// The emergency stop input is active.
    EmergencyStop,
    /// The guard is open.
    GuardOpen,
    /// The mirror turns faster than the rig allows.
    Overspeed,
    /// Torque is applied and the mirror does not turn.
    Stall,
    /// Neither index nor encoder pulses arrive.
    SensorLost,
    /// No frame pulses for longer than holdover bridges.
    ProjectorLost,
    /// The lock was not reached, or not regained, in time.
    LockTimeout,
    /// The control step was not called in time.
    Watchdog,
}

/// What the host asks of the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Command {
    /// Spin up and lock.
    Start,
    /// Go dark, let the mirror run out.
    Stop,
    /// Show slice `slice` of the current turn on the parked mirror for `duration_ms`, at most 60 000.
    Service {
        /// The slice to show.
        slice: u16,
        /// For how long.
        duration_ms: u32,
    },
    /// Leave [`State::Fault`], if its cause is gone.
    ClearFault,
}
