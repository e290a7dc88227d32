//! The words that payloads are made of.

#[cfg(doc)]
use super::{Configure, Hello, Learn};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Defines enums and lists their words, so that [`SCHEMA`] changes with them too.
macro_rules! vocabulary {
    ($(
        $(#[$meta:meta])*
        pub enum $name:ident {
            $( $(#[$word_meta:meta])* $word:ident
               $({ $( $(#[$field_meta:meta])* $field:ident: $kind:ty ),* $(,)? })? ),* $(,)?
        }
    )+) => {
        $( $(#[$meta])* pub enum $name {
            $( $(#[$word_meta])* $word $({ $( $(#[$field_meta])* $field: $kind ),* })? ),*
        } )+
        /// The words as they are written here, a type each.
        pub const VOCABULARY: &[&str] =
            &[$( stringify!($name { $( $word $({ $($field: $kind),* })? ),* }) ),+];
    };
}

vocabulary! {
    /// What the controller is doing. The projector is dark in all states but `Locked`, `Holdover`, `Service` and `OpenLoop`.
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
        /// Planes are lit on the word of a drive that keeps its own speed: nothing measures where the mirror is.
        OpenLoop,
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
        /// What was kept of earlier faults is damaged or was never written.
        Unknown,
    }

    /// What was measured when a fault was found, and its unit.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
    #[repr(u8)]
    pub enum Quantity {
        /// An input's level or a record's state: 1 where 0 is allowed.
        #[default]
        Level,
        /// Speed, rad/s.
        Speed,
        /// Time, seconds.
        Time,
        /// Turns of the mirror.
        Turns,
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
        /// Turn the picture of a mirror that nothing measures, from the start of a turn on; nothing happens where the mirror is measured.
        ShiftPhase {
            /// By how much, in 2⁻³² turn; positive is the way in which the mirror turns.
            shift: i32,
        },
    }

    /// What both ends must know before some planes can be expanded.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    pub enum Knowledge {
        /// A halftone's mask: its ranks row by row, 16 bits each, little-endian. See [`Mask`](crate::codec::Mask).
        Mask,
        /// The lengths of codes. See [`ByteCodes`](crate::codec::ByteCodes).
        Codes,
    }

    /// Why the device refused a packet.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, Error)]
    pub enum Reason {
        /// No [`Hello`] with the device's schema came before.
        #[error("the device waits for a hello of its own schema")]
        NotConnected,
        /// No [`Configure`] came before.
        #[error("the device has no configuration")]
        NotConfigured,
        /// The device does not take this message, or not in this form.
        #[error("the device does not understand the message")]
        NotUnderstood,
        /// The configuration is impossible or too large for the device.
        #[error("the device cannot hold turns of this configuration")]
        Configuration,
        /// Every slot holds a turn that is shown or waits to be shown.
        #[error("every slot of the device holds a turn that is shown or waits to be shown")]
        Busy,
        /// The turn is not the one that was begun.
        #[error("the turn is not the one that was begun")]
        WrongTurn,
        /// The slice is not one of the configuration's.
        #[error("the slice is not one of the turn's")]
        SliceOutOfRange,
        /// The part does not follow the last one of its plane.
        #[error("a part of the plane is missing before this one")]
        PartMissing,
        /// The plane did not expand to what its check says.
        #[error("the plane is damaged")]
        PlaneDamaged,
        /// The plane was compressed by what the device does not know; see [`Learn`].
        #[error("the plane was compressed by a mask or codes that the device was not told")]
        NotKnown,
        /// The device cannot keep what it is told, or it makes no sense.
        #[error("the device has no room for masks and codes, or these are none")]
        NotLearnt,
        /// The turn is ended while planes are missing.
        #[error("planes of the turn are missing")]
        SliceMissing,
        /// The planes are not those of the turn's check.
        #[error("the turn as a whole is not what its check says")]
        TurnDamaged,
    }
}

impl State {
    /// As people say it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::SpinUp => "spin-up",
            Self::Acquire => "acquire",
            Self::Locked => "locked",
            Self::Holdover => "holdover",
            Self::Fault => "fault",
            Self::Service => "service",
            Self::OpenLoop => "open loop",
        }
    }

    /// Whether a plane may be lit.
    pub const fn may_light(self) -> bool {
        matches!(self, Self::Locked | Self::Holdover | Self::Service | Self::OpenLoop)
    }

    /// Whether nothing is driven and nothing lit.
    pub const fn is_at_rest(self) -> bool {
        matches!(self, Self::Idle | Self::Fault)
    }

    /// Whether the mirror may be driven.
    pub const fn may_drive(self) -> bool {
        matches!(self, Self::SpinUp | Self::Acquire | Self::Locked | Self::Holdover | Self::OpenLoop)
    }
}

impl Fault {
    /// Every fault, in the order of codes.
    pub const ALL: [Self; 9] = [
        Self::EmergencyStop,
        Self::GuardOpen,
        Self::Overspeed,
        Self::Stall,
        Self::SensorLost,
        Self::ProjectorLost,
        Self::LockTimeout,
        Self::Watchdog,
        Self::Unknown,
    ];

    /// The code, which no other fault ever gets.
    pub const fn code(self) -> u8 {
        self as u8
    }
}

impl Quantity {
    /// Every quantity, in the order of codes.
    pub const ALL: [Self; 4] = [Self::Level, Self::Speed, Self::Time, Self::Turns];

    /// The code, which no other quantity ever gets.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The unit's symbol.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Level => "",
            Self::Speed => "rad/s",
            Self::Time => "s",
            Self::Turns => "turns",
        }
    }
}

impl core::fmt::Display for Fault {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::EmergencyStop => "the emergency stop is pressed",
            Self::GuardOpen => "the guard is open",
            Self::Overspeed => "the mirror turned too fast",
            Self::Stall => "the mirror did not turn under torque",
            Self::SensorLost => "neither index nor encoder pulses arrived",
            Self::ProjectorLost => "no frame pulses arrived",
            Self::LockTimeout => "the mirror did not come into step in time",
            Self::Watchdog => "the control timer stopped",
            Self::Unknown => "the record of faults is damaged",
        })
    }
}
