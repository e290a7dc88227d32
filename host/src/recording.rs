//! What happened to a display, to be told again: telemetry, trackers' readings, orders and turns.
//!
//! A recording is an MCAP file (<https://mcap.dev/spec>) of JSON messages, one topic for each kind of [`Entry`]. Times are seconds since
//! 1970, UTC, counted on by a clock that never jumps from when the daemon began.

pub mod file;

use crate::daemon::painter::{Key, View};
use crate::daemon::stage::Cast;
use crate::daemon::telemetry::{Event, Telemetry};
use crate::daemon::wish::Wish;
use crate::render::turn::Turn;
use crate::tracking::filter::Filter;
use crate::tracking::{Reading, Refusal, Viewer};
use glam::DVec3;
use protocol::message::{Command, State, Status};
use protocol::rig::Rig;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::time::Duration;

/// A turn's checksums are of so many parts: of a circle in equal sectors, so that where a turn differs can be said.
pub const SECTORS: usize = 8;

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Entry {
    /// The recording begins.
    Setup(Box<Setup>),
    /// Something else is wished for.
    Wish(Box<Wish>),
    /// A scene is ready, and what is painted from here on depends on nothing before.
    Stage(Cast),
    /// Something was rendered.
    Stroke(Box<Stroke>),
    /// A tracker's reading came, or something from it that is none.
    Reading(Arrived<Reading>),
    /// Somebody said where an eye was.
    Eye(Arrived<Eye>),
    /// Who was expected to be where.
    Viewers(Expected),
    /// The controller was given an order.
    Order(Command),
    /// Something was made to happen to a simulated controller.
    Action(Value),
    /// The controller does something else.
    Controller(Controller),
    /// The controller has a turn whole.
    Sent(Sent),
    /// What is known.
    Telemetry(Box<Value>),
    /// Something for the timeline.
    Event(Event),
    /// Entries that nobody took in time are missing here.
    Lost {
        /// How many.
        entries: u64,
    },
}

/// What a recording begins with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// Of the program that recorded.
    pub version: String,
    /// When the daemon began, nanoseconds since 1970, UTC.
    pub began_unix_ns: u64,
    /// The rig.
    pub rig: Rig,
    /// The controller's address.
    pub device: String,
    /// From which a simulated controller's noise follows.
    pub seed: u64,
    /// Whether turns went to a monitor.
    pub by_video: bool,
    /// The most triangles that a scene might have.
    pub triangles_max: usize,
    /// Who was followed already.
    pub heads: BTreeMap<u16, Filter>,
}

/// Something that came, and whether it was taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Arrived<T> {
    /// Nothing where it could not be understood.
    pub what: Option<T>,
    /// Why it was refused.
    pub refused: Option<String>,
}

impl<T> Arrived<T> {
    /// `what` came; nothing where it could not be understood.
    pub fn new(what: Option<T>, taken: Result<(), Refusal>) -> Self {
        Self { what, refused: taken.err().map(|reason| reason.name().into()) }
    }
}

/// Where somebody said that an eye was.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Eye {
    /// Whose.
    pub id: u16,
    /// World metres.
    pub position_m: DVec3,
    /// When, since the daemon began.
    pub at: Duration,
}

/// Who was expected to be where.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Expected {
    /// When light was expected to leave, since the daemon began.
    pub light_at: Duration,
    /// Who.
    pub viewers: Vec<Viewer>,
}

/// For what slices were rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layer {
    /// For a turn that was offered at once.
    Front,
    /// For the next turn.
    Ahead,
}

/// Slices that were rendered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stroke {
    /// Of the turn, counting from 1; ahead of a turn of the one before.
    pub number: u64,
    /// As what.
    pub key: Key,
    /// For what.
    pub layer: Layer,
    /// Which, as ranges: first and behind the last.
    pub slices: Vec<[u32; 2]>,
    /// CRC-32s of the turn's sectors, in order.
    pub sectors: Option<[u32; SECTORS]>,
    /// How long it took.
    pub took_ms: f64,
}

impl Stroke {
    /// Of those `slices`, in order, after which a turn that is offered is `turn`.
    pub fn new(number: u64, key: &Key, layer: Layer, slices: &[u32], turn: Option<&Turn>, took: Duration) -> Self {
        let mut ranges: Vec<[u32; 2]> = Vec::new();
        for slice in slices {
            match ranges.last_mut() {
                Some([_, end]) if end == slice => *end += 1,
                _ => ranges.push([*slice, slice + 1]),
            }
        }
        let (key, sectors) = (key.clone(), turn.map(sectors));
        Self { number, key, layer, slices: ranges, sectors, took_ms: took.as_secs_f64() * 1e3 }
    }

    /// Which of `slices` slices, in order, each once.
    pub fn slices(&self, slices: u32) -> Vec<u32> {
        (0..slices).filter(|slice| self.slices.iter().any(|[first, end]| (first..end).contains(&slice))).collect()
    }

    /// The view, where it is of a scene.
    pub fn view(&self) -> Option<&View> {
        match &self.key {
            Key::Scene(view) => Some(view),
            Key::Dark | Key::Pattern(_) => None,
        }
    }
}

/// CRC-32s of the sectors of `turn`.
pub fn sectors(turn: &Turn) -> [u32; SECTORS] {
    let slices = turn.slices() as usize;
    let bytes = turn.slice_bytes();
    std::array::from_fn(|sector| {
        let [first, end] = [sector, sector + 1].map(|sector| slices * sector / SECTORS * bytes);
        crc32fast::hash(&turn.bytes()[first..end])
    })
}

/// What the controller does.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Controller {
    /// Its state's name; nothing where there is no controller.
    pub state: Option<String>,
    /// Why it stopped.
    pub fault: Option<String>,
    /// What was measured and what is allowed.
    pub cause: Option<String>,
}

impl Controller {
    /// What `status` says; `cause` is what was measured and what is allowed, if that is known.
    pub fn of(status: &Status, cause: &str) -> Self {
        let fault = status.fault.filter(|_| status.state == State::Fault);
        Self {
            state: Some(status.state.name().into()),
            fault: fault.map(|fault| fault.to_string()),
            cause: fault.and_then(|_| (!cause.is_empty()).then(|| cause.into())),
        }
    }
}

/// A turn that the controller has whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sent {
    /// The number of its [`Stroke`].
    pub stroke: u64,
    /// The link's number of it.
    pub turn: u32,
}

impl Entry {
    /// What is known, as an entry.
    pub fn telemetry(telemetry: &Telemetry) -> Self {
        Self::Telemetry(Box::new(serde_json::to_value(telemetry).unwrap_or_default()))
    }

    /// Its topic, and the message in JSON.
    fn message(&self) -> (String, Vec<u8>) {
        match serde_json::to_value(self) {
            Ok(Value::Object(map)) if map.len() == 1 => {
                let (topic, body) = map.into_iter().next().unwrap_or_default();
                (topic, body.to_string().into_bytes())
            }
            // Every kind of entry is a map of one key.
            _ => ("lost".into(), br#"{"entries":1}"#.to_vec()),
        }
    }

    /// The entry of `topic` that `json` is; nothing for topics of other programs.
    fn read(topic: &str, json: &[u8]) -> Result<Option<Self>, serde_json::Error> {
        const TOPICS: [&str; 14] = [
            "setup",
            "wish",
            "stage",
            "stroke",
            "reading",
            "eye",
            "viewers",
            "order",
            "action",
            "controller",
            "sent",
            "telemetry",
            "event",
            "lost",
        ];
        if !TOPICS.contains(&topic) {
            return Ok(None);
        }
        let body: Value = serde_json::from_slice(json)?;
        let entry = Value::Object(serde_json::Map::from_iter([(topic.to_string(), body)]));
        serde_json::from_value(entry).map(Some)
    }
}
