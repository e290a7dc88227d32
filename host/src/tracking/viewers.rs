//! Who is there: readings of any trackers become eyes in the world, at the time at which the light will leave.

use super::filter::{Filter, Refused};
use super::{ParseError, Reading};
use glam::{DAffine3, DVec3};
use protocol::rig::Tracking;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::time::Duration;

/// So many viewers have places of their own; who comes later waits until one has gone.
pub const VIEWERS_MAX: usize = 8;
/// Who is silent for so long has gone.
pub const SILENCE: Duration = Duration::from_secs(1);

/// Somebody who looks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Viewer {
    /// As in [`Reading::viewer`], or as whoever posted it said.
    pub id: u16,
    /// The middle between the eyes, world metres, within the rig's plausible region.
    pub position_m: DVec3,
    /// About the axis, radians from -π to π: 0 toward +z, growing toward +x, counter-clockwise seen from above, as mirror angles do.
    pub azimuth: f64,
    /// From the axis, horizontally.
    pub distance_m: f64,
    /// Above the middle of the mirror.
    pub height_m: f64,
    /// When the newest reading in it came: from there latency counts.
    pub read_at: Duration,
}

impl Viewer {
    /// Where `head` will be, brought back to where heads may be. Nobody walks through the display: who is predicted in or beyond it stops
    /// before it.
    fn new(id: u16, head: &Filter, photon_time: Duration, place: &Place) -> Self {
        let [here, there] = [head.at(), photon_time].map(|at| head.predicted(at));
        let is_beyond = there.x.hypot(there.z) < place.distance_m[0] || here.x * there.x + here.z * there.z < 0.0;
        let (toward, distance) = if is_beyond {
            (here, place.distance_m[0])
        } else {
            (there, there.x.hypot(there.z).min(place.distance_m[1]))
        };
        let azimuth = toward.x.atan2(toward.z);
        let height_m = there.y.clamp(place.height_m[0], place.height_m[1]);
        let (sin, cos) = azimuth.sin_cos();
        let position_m = DVec3::new(distance * sin, height_m, distance * cos);
        Self { id, position_m, azimuth, distance_m: distance, height_m, read_at: head.at() }
    }
}

/// What became of something that came: the names under which it is counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Refusal {
    /// Bytes that are no packet, or that the tracker itself doubts.
    Malformed,
    /// A packet with numbers that are none, or that no head reaches.
    Absurd,
    /// Outside the region in which the rig says that heads are.
    Outside,
    /// Not later than the viewer's last one.
    Backwards,
    /// Farther away than a head goes meanwhile.
    Jump,
    /// From one viewer more than [`VIEWERS_MAX`].
    TooMany,
}

impl Refusal {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Malformed, Self::Absurd, Self::Outside, Self::Backwards, Self::Jump, Self::TooMany];

    /// A word for metrics and logs.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Malformed => "malformed",
            Self::Absurd => "absurd",
            Self::Outside => "outside",
            Self::Backwards => "backwards",
            Self::Jump => "jump",
            Self::TooMany => "too_many",
        }
    }
}

impl From<&ParseError> for Refusal {
    fn from(error: &ParseError) -> Self {
        match error {
            ParseError::Absurd { .. } => Self::Absurd,
            _ => Self::Malformed,
        }
    }
}

impl From<Refused> for Refusal {
    fn from(refused: Refused) -> Self {
        match refused {
            Refused::Backwards => Self::Backwards,
            Refused::Jump => Self::Jump,
        }
    }
}

/// What came so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Readings that moved a viewer.
    pub taken: u64,
    refused: [u64; Refusal::ALL.len()],
}

impl Counters {
    /// How many were refused for `reason`.
    pub fn refused(&self, reason: Refusal) -> u64 {
        self.refused[reason as usize]
    }
}

/// Where sensors are in the world, and where heads may be.
#[derive(Clone, Debug, PartialEq)]
struct Place {
    world_from_tracker: DAffine3,
    sensor_to_eye: DVec3,
    distance_m: [f64; 2],
    height_m: [f64; 2],
}

impl Place {
    fn new(tracking: &Tracking) -> Self {
        Self {
            world_from_tracker: tracking.motion(),
            sensor_to_eye: tracking.sensor_to_eye_m.into(),
            distance_m: tracking.plausible_distance_m,
            height_m: tracking.plausible_height_m,
        }
    }

    fn is_plausible(&self, eye: DVec3) -> bool {
        let within = |[low, high]: [f64; 2], value: f64| (low..=high).contains(&value);
        within(self.distance_m, eye.x.hypot(eye.z)) && within(self.height_m, eye.y)
    }
}

/// Everybody who is tracked.
#[derive(Clone, Debug)]
pub struct Viewers {
    place: Place,
    heads: BTreeMap<u16, Filter>,
    counters: Counters,
}

impl Viewers {
    /// Nobody yet.
    pub fn new(tracking: &Tracking) -> Self {
        Self { place: Place::new(tracking), heads: BTreeMap::new(), counters: Counters::default() }
    }

    /// Takes what a tracker's thread brings: a reading, or bytes that are none.
    pub fn arrive(&mut self, arrived: Result<Reading, ParseError>) -> Result<(), Refusal> {
        match arrived {
            Ok(reading) => self.take(&reading),
            Err(error) => self.counted(Err((&error).into())),
        }
    }

    /// Takes a sensor's reading.
    pub fn take(&mut self, reading: &Reading) -> Result<(), Refusal> {
        let sensor = reading.position_m + reading.orientation * self.place.sensor_to_eye;
        self.take_eye(reading.viewer, self.place.world_from_tracker.transform_point3(sensor), reading.at)
    }

    /// Takes the place of an eye, world metres, that somebody says viewer `id` had at `at`. A rig's sources have ids below 2048.
    pub fn take_eye(&mut self, id: u16, eye_m: DVec3, at: Duration) -> Result<(), Refusal> {
        let taken = self.moved(id, eye_m, at);
        self.counted(taken)
    }

    fn moved(&mut self, id: u16, eye: DVec3, at: Duration) -> Result<(), Refusal> {
        // A distance that is no number is not within.
        if !self.place.is_plausible(eye) {
            return Err(Refusal::Outside);
        }
        if self.heads.len() == VIEWERS_MAX && !self.heads.contains_key(&id) {
            // By the time of what comes alone: a recording that is told again lets the same ones go.
            self.heads.retain(|_, head| at.abs_diff(head.at()) <= SILENCE);
        }
        let count = self.heads.len();
        match self.heads.entry(id) {
            Entry::Occupied(mut head) if at.saturating_sub(head.get().at()) > SILENCE => {
                head.insert(Filter::new(eye, at));
            }
            Entry::Occupied(mut head) => head.get_mut().take(eye, at)?,
            Entry::Vacant(_) if count == VIEWERS_MAX => return Err(Refusal::TooMany),
            Entry::Vacant(head) => {
                head.insert(Filter::new(eye, at));
            }
        }
        Ok(())
    }

    fn counted(&mut self, taken: Result<(), Refusal>) -> Result<(), Refusal> {
        match taken {
            Ok(()) => self.counters.taken += 1,
            Err(reason) => self.counters.refused[reason as usize] += 1,
        }
        taken
    }

    /// Who is there at `photon_time`, when the light of the turn that is asked for will leave, and where; by rising `id`. Who was silent for
    /// [`SILENCE`] until then is gone, and whose last word bears a time so far ahead that it cannot be true.
    pub fn at(&mut self, photon_time: Duration) -> Vec<Viewer> {
        self.heads.retain(|_, head| head.at() <= photon_time + SILENCE);
        let there = self.heads.iter().filter(|(_, head)| photon_time.abs_diff(head.at()) <= SILENCE);
        there.map(|(id, head)| Viewer::new(*id, head, photon_time, &self.place)).collect()
    }

    /// The paths of those who came last, also of some who have gone.
    pub fn heads(&self) -> &BTreeMap<u16, Filter> {
        &self.heads
    }

    /// The same as these, with the paths of others.
    pub fn with_heads(self, heads: BTreeMap<u16, Filter>) -> Self {
        Self { heads, ..self }
    }

    /// What came so far.
    pub fn counters(&self) -> Counters {
        self.counters
    }
}

#[cfg(test)]
mod tests;
