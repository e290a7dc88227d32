//! A recording is told again: what was rendered is rendered anew, who was followed is followed, and a simulated controller is given the same
//! orders. What comes out otherwise is said.

mod machine;
mod pictures;

use crate::daemon::library::{Library, LibraryError};
use crate::link::LinkError;
use crate::recording::file::{FileError, Timed};
use crate::recording::{Arrived, Controller, Entry, Expected, Setup};
use crate::render::Renderer;
use crate::stream::StreamError;
use crate::tracking::viewers::Refusal;
use crate::tracking::{Viewer, Viewers};
use crate::volume::display_radius_m;
use machine::Machine;
use pictures::Pictures;
use protocol::codec::{ImageSize, ImageSizeError};
use protocol::rig::RigError;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;
use thiserror::Error;

/// Of what differs so many of each kind are told; all are counted.
const TOLD_MAX: usize = 20;
/// A viewer may be elsewhere by this: JSON keeps every bit, so any is too much.
const VIEWER_M: f64 = 1e-9;
/// A simulated controller does the same a little sooner or later, in seconds, and one that is not simulated has another motor.
const SOONER_OR_LATER_S: f64 = 1.0;
/// Something is recorded many times a second: longer than this, in seconds, nothing was never.
const GAP_S: f64 = 3_600.0;
/// What a controller did for less time may have been missed by whoever asked it.
const BRIEF_S: f64 = 0.2;

/// Why a recording cannot be told again.
#[derive(Debug, Error)]
pub enum ReplayError {
    /// See the message.
    #[error(transparent)]
    File(#[from] FileError),
    /// See the message.
    #[error("it holds nothing")]
    Empty,
    /// See the message.
    #[error(
        "it does not begin with what is needed to tell it again: it was not written by praxi record, or its beginning is missing"
    )]
    NoSetup,
    /// See the message.
    #[error("nothing happens from {from_s:.1} to {to_s:.1} s: it is damaged")]
    Gap {
        /// The last entry's time, seconds since the recording began.
        from_s: f64,
        /// The next one's.
        to_s: f64,
    },
    /// See the message.
    #[error("its rig: {0}")]
    Rig(#[from] RigError),
    /// See the message.
    #[error("its rig: {0}")]
    Size(#[from] ImageSizeError),
    /// See the message.
    #[error("the simulated controller: {0}")]
    Link(#[from] LinkError),
    /// See the message.
    #[error("the simulated controller: {0}")]
    Stream(#[from] StreamError),
    /// See the message.
    #[error("scene {0}: not built in: give its file by --scene")]
    NoScene(String),
    /// See the message.
    #[error("scene {0}: {1}")]
    Scene(String, String),
}

/// Something that came out otherwise.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// When, seconds since the recording began.
    pub at_s: f64,
    /// What.
    pub what: String,
}

/// How many there were, and the first that differ.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Compared {
    /// All.
    pub count: u64,
    /// Those that differ.
    pub different: u64,
    /// The first of them.
    pub first: Vec<Difference>,
}

impl Compared {
    fn differs(&mut self, at_s: f64, what: String) {
        self.different += 1;
        if self.first.len() < TOLD_MAX {
            self.first.push(Difference { at_s, what });
        }
    }
}

/// What came of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// The rig's name.
    pub rig: String,
    /// The controller's address.
    pub device: String,
    /// The length of the recording.
    pub seconds: f64,
    /// Turns that were rendered.
    pub turns: Compared,
    /// Readings and posted viewers: whether they are taken.
    pub readings: Compared,
    /// Where viewers were expected.
    pub viewers: Compared,
    /// What the controller did: states and faults, one after the other.
    pub controller: Compared,
    /// Orders to the controller, and what was made to happen to it.
    pub orders: u64,
    /// Turns that the controller got, and that came on screen in the simulation.
    pub sent: [u64; 2],
    /// Entries that are missing: nobody took them in time.
    pub lost: u64,
    /// The recording ends in the middle.
    pub is_cut: bool,
}

impl Report {
    /// Whether everything came out as it was.
    pub fn is_same(&self) -> bool {
        self.parts().iter().all(|(_, part)| part.different == 0)
    }

    /// By their names.
    pub fn parts(&self) -> [(&'static str, &Compared); 4] {
        [
            ("turns", &self.turns),
            ("readings", &self.readings),
            ("viewers", &self.viewers),
            ("controller", &self.controller),
        ]
    }
}

/// By what a recording is told again.
pub struct Means {
    /// Who renders.
    pub renderer: Box<dyn Renderer>,
    /// The file of a scene that is not built in.
    pub scene: Option<PathBuf>,
    /// An empty folder.
    pub folder: PathBuf,
}

/// A recording that is being told.
pub struct Replay {
    report: Report,
    first_ns: u64,
    pictures: Pictures,
    viewers: Viewers,
    machine: Machine,
    /// What the controller did, and when.
    did: Vec<(f64, Controller)>,
    /// The recording began while the mirror was brought to its speed: nobody knows how far it was.
    began_on_the_way: bool,
}

impl Replay {
    /// Of a recording that begins with `first`.
    pub fn begin(first: Timed, means: Means) -> Result<Self, ReplayError> {
        let (first_ns, Entry::Setup(setup)) = first else { return Err(ReplayError::NoSetup) };
        let Setup { rig, device, seed, by_video, triangles_max, heads, .. } = *setup;
        let rig = Arc::new(rig.checked()?);
        let size = ImageSize::new(rig.projector.width_px, rig.projector.height_px)?;
        let viewers = Viewers::new(&rig.tracking.clone().unwrap_or_default()).with_heads(heads);
        let report = Report { rig: rig.name.clone(), device, ..Report::default() };
        let machine = Machine::new(Arc::clone(&rig), size, seed, by_video)?;
        let Means { renderer, scene, folder } = means;
        let library = Library::open(folder, crate::daemon::config::UploadKeys::default(), PathBuf::new());
        let library = library.map_err(|error| ReplayError::Scene("folder".into(), error.to_string()))?;
        let limits = (display_radius_m(&rig), triangles_max);
        let pictures = Pictures::new(rig, renderer, (library, scene), limits);
        Ok(Self { report, first_ns, pictures, viewers, machine, did: Vec::new(), began_on_the_way: false })
    }

    /// Tells `entry` again.
    pub fn tell(&mut self, (at_ns, entry): Timed) -> Result<(), ReplayError> {
        let at_s = at_ns.saturating_sub(self.first_ns) as f64 / 1e9;
        let from_s = self.report.seconds;
        if at_s - from_s > GAP_S {
            return Err(ReplayError::Gap { from_s, to_s: at_s });
        }
        self.report.seconds = from_s.max(at_s);
        match entry {
            Entry::Stage(cast) => self.pictures.stage(&cast)?,
            Entry::Stroke(stroke) => self.pictures.paint(at_s, &stroke, &mut self.report.turns),
            Entry::Reading(Arrived { what: Some(reading), refused }) => {
                let taken = self.viewers.take(&reading);
                self.compare(at_s, "reading", taken, refused);
            }
            Entry::Reading(Arrived { what: None, .. }) => self.report.readings.count += 1,
            Entry::Eye(Arrived { what: Some(eye), refused }) => {
                let taken = self.viewers.take_eye(eye.id, eye.position_m, eye.at);
                self.compare(at_s, "posted viewer", taken, refused);
            }
            Entry::Viewers(expected) => self.expect(at_s, &expected),
            Entry::Order(order) => {
                self.report.orders += 1;
                self.machine.order(at_s, order)?;
            }
            Entry::Action(action) => {
                self.report.orders += 1;
                self.machine.act(at_s, &action)?;
            }
            Entry::Controller(controller) => self.hear(at_s, controller)?,
            Entry::Sent(sent) => {
                self.report.sent[0] += 1;
                if let Some(planes) = self.pictures.of(sent.stroke) {
                    self.machine.send(at_s, &planes)?;
                }
            }
            Entry::Lost { entries } => self.report.lost += entries,
            Entry::Setup(_) | Entry::Wish(_) | Entry::Eye(_) | Entry::Telemetry(_) | Entry::Event(_) => {}
        }
        Ok(())
    }

    /// What came of it all.
    pub fn end(mut self, is_cut: bool) -> Result<Report, ReplayError> {
        self.machine.run_until(self.report.seconds)?;
        if self.began_on_the_way {
            let states = lasting(&self.did).len();
            self.machine.run_on(|did| lasting(did).len() >= states)?;
        }
        let (recorded, mut simulated) = (lasting(&self.did), lasting(self.machine.did()));
        if recorded.is_empty() {
            // There was no controller.
            simulated.clear();
        }
        self.report.controller.count = recorded.len() as u64;
        for (place, (at_s, was)) in recorded.iter().enumerate() {
            match simulated.get(place) {
                Some((again_s, is)) if is.state == was.state && is.fault == was.fault => {
                    if !self.began_on_the_way && (again_s - at_s).abs() > SOONER_OR_LATER_S {
                        let what = format!("{}; here at {again_s:.2} s", said(was));
                        self.report.controller.differs(*at_s, what);
                    }
                }
                other => {
                    let here =
                        other.map_or("nothing more".into(), |(again_s, is)| format!("{} at {again_s:.2} s", said(is)));
                    self.report.controller.differs(*at_s, format!("{}; here {here}", said(was)));
                    break;
                }
            }
        }
        if let Some((again_s, is)) = simulated.get(recorded.len())
            && self.report.controller.different == 0
            && !self.began_on_the_way
        {
            self.report.controller.differs(*again_s, format!("nothing more; here {}", said(is)));
        }
        self.report.sent[1] = self.machine.shown();
        self.report.is_cut = is_cut;
        Ok(self.report)
    }

    fn compare(&mut self, at_s: f64, what: &str, taken: Result<(), Refusal>, recorded: Option<String>) {
        let readings = &mut self.report.readings;
        readings.count += 1;
        let here = taken.err().map(Refusal::name);
        if here != recorded.as_deref() {
            let said = |refused: Option<&str>| refused.map_or("taken".into(), |reason| format!("refused: {reason}"));
            readings.differs(at_s, format!("a {what} was {}; here {}", said(recorded.as_deref()), said(here)));
        }
    }

    fn expect(&mut self, at_s: f64, expected: &Expected) {
        let here = self.viewers.at(expected.light_at);
        let compared = &mut self.report.viewers;
        compared.count += 1;
        let ids = |viewers: &[Viewer]| Vec::from_iter(viewers.iter().map(|viewer| viewer.id));
        if ids(&here) != ids(&expected.viewers) {
            compared.differs(at_s, format!("viewers {:?}; here {:?}", ids(&expected.viewers), ids(&here)));
            return;
        }
        let off = here.iter().zip(&expected.viewers).map(|(one, other)| one.position_m.distance(other.position_m));
        let off_m = off.fold(0.0, f64::max);
        if off_m > VIEWER_M {
            compared.differs(at_s, format!("viewers are {:.3} mm elsewhere", off_m * 1e3));
        }
    }

    fn hear(&mut self, at_s: f64, controller: Controller) -> Result<(), ReplayError> {
        if let (true, Some(state)) = (self.did.is_empty(), &controller.state) {
            // The recording may begin while the mirror turns.
            self.began_on_the_way = self.machine.begin(state)?;
        }
        self.machine.run_until(at_s)?;
        self.did.push((at_s, controller));
        Ok(())
    }
}

fn said(controller: &Controller) -> String {
    let state = controller.state.as_deref().unwrap_or("away");
    match (&controller.fault, &controller.cause) {
        (Some(fault), Some(cause)) => format!("{state}, {fault}: {cause}"),
        (Some(fault), None) => format!("{state}, {fault}"),
        _ => state.into(),
    }
}

/// What `did` says without what was brief, the controller's absences, and repetitions.
fn lasting(did: &[(f64, Controller)]) -> Vec<(f64, Controller)> {
    let mut lasting: Vec<(f64, Controller)> = Vec::new();
    for (place, (at_s, what)) in did.iter().enumerate() {
        let until = did.get(place + 1).map_or(f64::INFINITY, |(next_s, _)| *next_s);
        if what.state.is_none() || until - at_s < BRIEF_S && what.fault.is_none() {
            continue;
        }
        match lasting.last_mut() {
            // What was measured comes after the fault.
            Some((_, last)) if (&last.state, &last.fault) == (&what.state, &what.fault) => {
                last.cause = what.cause.clone().or(last.cause.take());
            }
            _ => lasting.push((*at_s, what.clone())),
        }
    }
    lasting
}

impl From<LibraryError> for ReplayError {
    fn from(error: LibraryError) -> Self {
        match error {
            LibraryError::Unknown(name) => Self::NoScene(name),
            error => Self::Scene("of the recording".into(), error.to_string()),
        }
    }
}

#[cfg(test)]
mod tests;
