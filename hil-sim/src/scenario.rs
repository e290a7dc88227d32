//! What happens to a world, and when: a TOML file with a list of events.
//!
//! ```toml
//! name = "one-pulse-lost"
//! [[event]]
//! at_s = 0.05
//! do = "start"
//! [[event]]
//! at_s = 4.0
//! do = { lose-frame-pulses = { count = 1 } }
//! ```

use crate::check::{Range, ValueError};
use crate::expectation::Expectation;
use crate::projector::video::VideoFault;
pub use firmware::pacing::Pacing;
use protocol::rig::toml_problem;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A timeline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// For people.
    pub name: String,
    /// Who leads.
    #[serde(default)]
    pub pacing: Pacing,
    /// How the plant differs from the motor file that the firmware was configured from.
    #[serde(default)]
    pub plant: PlantScale,
    /// Where the controller's clock and counter stand at the start.
    #[serde(default)]
    pub counters: Counters,
    /// What a run must come to.
    pub expect: Option<Expectation>,
    /// What happens, in any order.
    #[serde(default, rename = "event")]
    pub events: Vec<Event>,
}

/// Factors on the motor file's figures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlantScale {
    /// Of inertia.
    pub inertia: f64,
    /// Of all friction.
    pub friction: f64,
}

impl Default for PlantScale {
    fn default() -> Self {
        Self { inertia: 1.0, friction: 1.0 }
    }
}

/// Where what counts without end begins, so that it wraps soon.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Counters {
    /// The controller's time, ns.
    pub time_ns: u64,
    /// Counts in the rig's direction until the encoder's 32 bits wrap; 0: they have just done so.
    pub encoder_counts_to_wrap: u32,
}

/// One thing that happens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// Seconds after the simulation started.
    pub at_s: f64,
    /// What.
    #[serde(rename = "do")]
    pub action: Action,
}

/// What may happen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Action {
    /// The host commands a start.
    Start,
    /// The host commands a stop.
    Stop,
    /// The host clears a fault.
    ClearFault,
    /// The host turns the picture of a mirror that nothing measures.
    ShiftPhase {
        /// By how much, in the mirror's direction.
        turns: f64,
    },
    /// The host asks for one slice on the parked mirror.
    Service {
        /// Which.
        slice: u16,
        /// For how long.
        duration_ms: u32,
    },
    /// The emergency stop is pressed.
    EmergencyStop,
    /// The emergency stop is pulled out again.
    EmergencyStopReleased,
    /// The guard is opened.
    GuardOpened,
    /// The guard is closed.
    GuardClosed,
    /// The next frame pulses are lost.
    LoseFramePulses {
        /// How many.
        count: u32,
    },
    /// No frame pulses arrive; the projector goes on.
    NoFramePulses {
        /// For how long.
        seconds: f64,
    },
    /// A frame pulse that means nothing.
    ExtraFramePulse,
    /// The next plane pulses are lost.
    LosePlanePulses {
        /// How many.
        count: u32,
    },
    /// No plane pulses arrive.
    NoPlanePulses {
        /// For how long.
        seconds: f64,
    },
    /// A plane pulse that means nothing.
    ExtraPlanePulse,
    /// The next index pulses are lost.
    LoseIndexPulses {
        /// How many.
        count: u32,
    },
    /// No index pulses arrive.
    NoIndexPulses {
        /// For how long.
        seconds: f64,
    },
    /// An index pulse that means nothing.
    ExtraIndexPulse,
    /// The encoder's counter slips: positive counts are added, negative ones lost.
    EncoderSlip {
        /// By how many counts.
        counts: i32,
    },
    /// The encoder's counter stands still; what passes is lost.
    EncoderFrozen {
        /// For how long.
        seconds: f64,
    },
    /// Something goes wrong with a frame that comes as video; of several at once, with one after the other.
    Video(VideoFault),
    /// The projector runs at another rate from its next frame on.
    ProjectorRate {
        /// Its nominal rate.
        hz: f64,
    },
    /// Frame and plane pulses scatter more than the controller was told.
    PulseJitter {
        /// Standard deviation, microseconds.
        us: f64,
    },
    /// Every frame, plane and index pulse comes twice, 3 µs apart.
    DoubledPulses {
        /// For how long.
        seconds: f64,
    },
    /// The supply sags: the drive gives this share of its torque from now on.
    TorqueLimit {
        /// 1 is all of it.
        share: f64,
    },
    /// A constant torque on the mirror from now on.
    Load {
        /// Positive where it drives the mirror in the rig's direction.
        torque_nm: f64,
    },
    /// The control timer stops.
    NoControlTicks {
        /// For how long.
        seconds: f64,
    },
}

/// Why a scenario is refused.
#[derive(Debug, Error)]
pub enum ScenarioError {
    /// Not TOML, or keys missing, unknown or of the wrong kind: line, key, and the parser's words.
    #[error("{0}")]
    Syntax(String),
    /// An impossible value.
    #[error("{0}")]
    Value(#[from] ValueError),
}

impl Default for Scenario {
    /// Starts after 0.05 s; nothing else happens.
    fn default() -> Self {
        Self {
            name: "plain".to_owned(),
            pacing: Pacing::default(),
            plant: PlantScale::default(),
            counters: Counters::default(),
            expect: None,
            events: vec![Event { at_s: 0.05, action: Action::Start }],
        }
    }
}

impl Scenario {
    /// The names of the scenarios that come with the simulator.
    pub const BUILT_IN: [&str; 28] = [
        "plain",
        "second-motor",
        "smooth-motor",
        "pulses",
        "bursts",
        "doubled-pulses",
        "pulse-jitter",
        "dropouts",
        "ten-seconds",
        "rate-step",
        "rate-steps",
        "drift",
        "hand",
        "sag",
        "overspeed",
        "stall",
        "sensors-dead",
        "wraps",
        "emergency-stop",
        "follow",
        "follow-drift",
        "follow-pulses",
        "follow-disturbed",
        "open-loop",
        "open-loop-rates",
        "open-loop-stop",
        "video",
        "video-faults",
    ];

    /// A scenario that comes with the simulator, by its name.
    pub fn built_in(name: &str) -> Option<Self> {
        let text = match name {
            "plain" => include_str!("../scenarios/plain.toml"),
            "second-motor" => include_str!("../scenarios/second-motor.toml"),
            "smooth-motor" => include_str!("../scenarios/smooth-motor.toml"),
            "pulses" => include_str!("../scenarios/pulses.toml"),
            "bursts" => include_str!("../scenarios/bursts.toml"),
            "doubled-pulses" => include_str!("../scenarios/doubled-pulses.toml"),
            "pulse-jitter" => include_str!("../scenarios/pulse-jitter.toml"),
            "dropouts" => include_str!("../scenarios/dropouts.toml"),
            "ten-seconds" => include_str!("../scenarios/ten-seconds.toml"),
            "rate-step" => include_str!("../scenarios/rate-step.toml"),
            "rate-steps" => include_str!("../scenarios/rate-steps.toml"),
            "drift" => include_str!("../scenarios/drift.toml"),
            "hand" => include_str!("../scenarios/hand.toml"),
            "sag" => include_str!("../scenarios/sag.toml"),
            "overspeed" => include_str!("../scenarios/overspeed.toml"),
            "stall" => include_str!("../scenarios/stall.toml"),
            "sensors-dead" => include_str!("../scenarios/sensors-dead.toml"),
            "wraps" => include_str!("../scenarios/wraps.toml"),
            "emergency-stop" => include_str!("../scenarios/emergency-stop.toml"),
            "follow" => include_str!("../scenarios/follow.toml"),
            "follow-drift" => include_str!("../scenarios/follow-drift.toml"),
            "follow-pulses" => include_str!("../scenarios/follow-pulses.toml"),
            "follow-disturbed" => include_str!("../scenarios/follow-disturbed.toml"),
            "open-loop" => include_str!("../scenarios/open-loop.toml"),
            "open-loop-rates" => include_str!("../scenarios/open-loop-rates.toml"),
            "open-loop-stop" => include_str!("../scenarios/open-loop-stop.toml"),
            "video" => include_str!("../scenarios/video.toml"),
            "video-faults" => include_str!("../scenarios/video-faults.toml"),
            _ => return None,
        };
        Some(Self::from_toml(text).expect("a file of this crate, tested below"))
    }

    /// Nothing happens by itself.
    pub fn without_events() -> Self {
        Self { events: Vec::new(), ..Self::default() }
    }

    /// Reads and checks a scenario file. Events come out in order of time.
    pub fn from_toml(text: &str) -> Result<Self, ScenarioError> {
        let mut scenario: Self = toml::from_str(text).map_err(|error| ScenarioError::Syntax(problem(text, &error)))?;
        let scale = Range { least: 0.01, most: 100.0 };
        scale.check("plant.inertia", scenario.plant.inertia)?;
        scale.check("plant.friction", scenario.plant.friction)?;
        scenario.expect.as_ref().map_or(Ok(()), Expectation::check)?;
        for (i, event) in scenario.events.iter().enumerate() {
            event.check(&format!("event[{i}]"))?;
        }
        scenario.events.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        Ok(scenario)
    }

    /// The same with one event more.
    pub fn with(mut self, at_s: f64, action: Action) -> Self {
        self.events.push(Event { at_s, action });
        self.events.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        self
    }
}

/// The parser's words, with how an action that has figures is written where they were left out.
fn problem(text: &str, error: &toml::de::Error) -> String {
    let problem = toml_problem(text, error);
    if problem.contains("struct variant") {
        format!("{problem}: an action with figures is written as in do = {{ no-frame-pulses = {{ seconds = 1.0 }} }}")
    } else {
        problem
    }
}

impl Event {
    fn check(&self, place: &str) -> Result<(), ValueError> {
        Range { least: 0.0, most: 1e6 }.check(&format!("{place}.at_s"), self.at_s)?;
        self.action.check(&format!("{place}.do"))
    }
}

impl Action {
    /// Whether its figures are in their ranges; `place` says whose they are.
    pub fn check(&self, place: &str) -> Result<(), ValueError> {
        let long = Range { least: 0.0, most: 1e6 };
        match *self {
            Self::NoFramePulses { seconds }
            | Self::NoPlanePulses { seconds }
            | Self::NoIndexPulses { seconds }
            | Self::EncoderFrozen { seconds }
            | Self::DoubledPulses { seconds }
            | Self::NoControlTicks { seconds } => long.check(&format!("{place}.*.seconds"), seconds),
            Self::ProjectorRate { hz } => {
                Range { least: 1.0, most: 10_000.0 }.check(&format!("{place}.projector-rate.hz"), hz)
            }
            Self::PulseJitter { us } => {
                Range { least: 0.0, most: 100.0 }.check(&format!("{place}.pulse-jitter.us"), us)
            }
            Self::TorqueLimit { share } => {
                Range { least: 0.0, most: 1.0 }.check(&format!("{place}.torque-limit.share"), share)
            }
            Self::ShiftPhase { turns } => {
                Range { least: -0.5, most: 0.5 }.check(&format!("{place}.shift-phase.turns"), turns)
            }
            Self::Load { torque_nm } => {
                Range { least: -1e4, most: 1e4 }.check(&format!("{place}.load.torque_nm"), torque_nm)
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_timeline_is_read_and_sorted() {
        let scenario = Scenario::from_toml(
            r#"
            name = "example"
            plant = { inertia = 0.5 }
            [[event]]
            at_s = 4.0
            do = { lose-frame-pulses = { count = 1 } }
            [[event]]
            at_s = 0.05
            do = "start"
            "#,
        )
        .unwrap();
        assert_eq!(scenario.events[0], Event { at_s: 0.05, action: Action::Start });
        assert_eq!(scenario.events[1].action, Action::LoseFramePulses { count: 1 });
        assert_eq!(scenario.plant, PlantScale { inertia: 0.5, friction: 1.0 });
    }

    #[test]
    fn built_in_scenarios_load_under_their_names() {
        for name in Scenario::BUILT_IN {
            assert_eq!(Scenario::built_in(name).unwrap().name, name);
        }
        assert_eq!(Scenario { expect: None, ..Scenario::built_in("plain").unwrap() }, Scenario::default());
        assert_eq!(Scenario::built_in("other"), None);
    }

    #[test]
    fn bad_files_are_refused_with_the_place() {
        for (text, told) in [
            ("name = 'x'\nspeed = 3", "speed"),
            ("name = 'x'\nevent = [{ at_s = 1.0, do = 'explode' }]", "line 2"),
            ("name = 'x'\nevent = [{ at_s = 1.0, do = { load = { nm = 1.0 } } }]", "nm"),
            ("name = 'x'\nevent = [{ at_s = 1.0, do = 'start', by = 'me' }]", "by"),
            ("name = 'x'\nevent = [{ at_s = nan, do = 'start' }]", "event[0].at_s = NaN"),
            (
                "name = 'x'\nevent = [{ at_s = 1, do = { projector-rate = { hz = 0.0 } } }]",
                "event[0].do.projector-rate.hz = 0",
            ),
            ("name = 'x'\n[[event]]\nat_s = 1\ndo = 'load'", "do = { no-frame-pulses = { seconds = 1.0 } }"),
            ("name = 'x'\nplant = { inertia = 0.0 }", "plant.inertia = 0"),
        ] {
            let message = Scenario::from_toml(text).unwrap_err().to_string();
            assert!(message.contains(told), "{message}");
        }
    }
}
