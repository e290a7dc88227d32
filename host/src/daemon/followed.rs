//! Who is followed: trackers' readings on their way to the turns.

use super::hub::Hub;
use super::telemetry::SeenViewer;
use crate::tracking::source::{Follower, State};
use crate::tracking::{Refusal, Viewer};
use protocol::rig::{Rig, Tracking, Viewers};
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Who moves less than this, in metres and degrees, is where they were: a third of what an eye tells apart on the reference rig.
const STILL: [f64; 2] = [5e-4, 0.03];
/// From the reading of viewers to the light of a turn by which they are rendered, as long as it was not measured: in turns.
const AHEAD_TURNS: f64 = 1.5;
/// Nobody's head is foreseen for longer.
const AHEAD_MAX: Duration = Duration::from_millis(200);
/// How often refused readings are logged.
const LOG_EVERY: Duration = Duration::from_secs(10);

/// A thread for each of the rig's trackers.
pub fn listen(hub: &Arc<Hub>, tracking: &Tracking) -> io::Result<Vec<Follower>> {
    let follower = |(number, source)| {
        let hub = Arc::clone(hub);
        let epoch = hub.start();
        Follower::start(source, number, epoch, move |arrived| {
            // Counted there, and told by a `Teller`.
            let _ = hub.arrive(arrived);
        })
    };
    (0..).zip(&tracking.source).map(follower).collect()
}

/// Brings the trackers' states and counts to where people read them.
#[derive(Debug, Default)]
pub struct Teller {
    /// What was refused when that was logged last, by reason, and when.
    logged: [u64; Refusal::ALL.len()],
    at: Option<Instant>,
}

impl Teller {
    /// Call often.
    pub fn tell(&mut self, hub: &Hub, followers: &[Follower]) {
        let counters = hub.viewer_counters();
        let refused = Refusal::ALL.map(|reason| counters.refused(reason));
        let readings = &hub.metrics.readings;
        let outcomes = Refusal::ALL.map(Refusal::name).into_iter().zip(refused);
        for (outcome, count) in outcomes.clone().chain([("taken", counters.taken)]) {
            let counter = readings.get_or_create(&[("outcome", outcome)]);
            counter.inc_by(count.saturating_sub(counter.get()));
        }
        self.log(outcomes, refused);
        let state = |follower: &Follower| match follower.state() {
            State::Open(place) => format!("{place}: open"),
            State::Closed(why) => why,
        };
        let trackers = followers.iter().map(state).collect();
        hub.tell(|telemetry| {
            telemetry.trackers = trackers;
            telemetry.readings_taken = counters.taken;
            telemetry.readings_refused = refused.iter().sum();
        });
    }

    /// A line for what was refused since the last one, not too often: a network may talk nonsense all day.
    fn log<'a>(&mut self, outcomes: impl Iterator<Item = (&'a str, u64)>, refused: [u64; Refusal::ALL.len()]) {
        if refused == self.logged || self.at.is_some_and(|at| at.elapsed() < LOG_EVERY) {
            return;
        }
        let news = outcomes.zip(self.logged).filter(|((_, count), before)| count > before);
        let words = news.map(|((reason, count), before)| format!("{} {reason}", count - before));
        tracing::warn!("refused readings of viewers: {}", Vec::from_iter(words).join(", "));
        (self.logged, self.at) = (refused, Some(Instant::now()));
    }
}

/// Who is there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Followed {
    /// Where they are expected to be when the light leaves.
    pub viewers: Vec<Viewer>,
}

impl Followed {
    /// Who is there now on `rig`, where light leaves some `ahead` later; the same as `before` where nobody moved.
    pub fn now(hub: &Hub, rig: &Rig, before: &Self) -> Self {
        if let Viewers::Infinity { .. } = rig.viewers() {
            return Self::default();
        }
        let measured = hub.telemetry().latency_ms.map(|ms| Duration::from_secs_f64(ms / 1e3));
        let guessed = Duration::from_secs_f64(AHEAD_TURNS / rig.turns_per_second());
        let light = hub.start().elapsed() + measured.unwrap_or(guessed).min(AHEAD_MAX);
        let now = Self { viewers: hub.viewers_at(light) };
        if now.is_near(before) { before.clone() } else { now }
    }

    fn is_near(&self, other: &Self) -> bool {
        let near = |(a, b): (&Viewer, &Viewer)| {
            let turned = (a.azimuth - b.azimuth).to_degrees().rem_euclid(360.0);
            let moved = (a.distance_m - b.distance_m).abs().max((a.height_m - b.height_m).abs());
            a.id == b.id && moved < STILL[0] && turned.min(360.0 - turned) < STILL[1]
        };
        self.viewers.len() == other.viewers.len() && self.viewers.iter().zip(&other.viewers).all(near)
    }

    /// For people and pictures.
    pub fn seen(&self) -> Vec<SeenViewer> {
        let seen = |&Viewer { id, azimuth, distance_m, height_m, .. }: &Viewer| SeenViewer {
            id,
            azimuth_deg: azimuth.to_degrees(),
            distance_m,
            height_m,
        };
        self.viewers.iter().map(seen).collect()
    }

    /// When the newest reading among them came, on the hub's clock.
    pub fn read_at(&self) -> Option<Duration> {
        self.viewers.iter().map(|viewer| viewer.read_at).max()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use protocol::rig::TrackedViewer;

    fn followed(azimuth_deg: f64, height_m: f64) -> Followed {
        let viewer = Viewer {
            id: 1,
            position_m: DVec3::ZERO,
            azimuth: azimuth_deg.to_radians(),
            distance_m: 0.9,
            height_m,
            read_at: Duration::from_secs(1),
        };
        Followed { viewers: vec![viewer] }
    }

    #[test]
    fn who_hardly_moves_is_where_they_were() {
        assert!(followed(179.99, 0.35).is_near(&followed(-179.999, 0.3502)));
        for other in [followed(10.05, 0.35), followed(10.0, 0.351), Followed::default()] {
            assert!(!followed(10.0, 0.35).is_near(&other), "{other:?}");
        }
    }

    #[test]
    fn they_stand_around_the_rig() {
        let rig = crate::rigs::find("reference").unwrap();
        let around = |followed: Followed| crate::daemon::painter::around(&rig, &followed.seen());
        let tracked = TrackedViewer { azimuth_deg: 10.0, distance_m: 0.9, height_m: 0.6 };
        assert_eq!(around(followed(10.0, 0.6)).viewing.tracked, [tracked]);
        assert_eq!(around(Followed::default()), rig);
    }
}
