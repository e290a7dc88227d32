//! What is known of the display at a moment, and what happened to it.

use protocol::rig::TrackedViewer;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What is known now.
#[derive(Clone, Debug, Default, PartialEq, Serialize, ToSchema)]
pub struct Telemetry {
    /// The rig's name.
    pub rig: String,
    /// The controller's name.
    pub device: String,
    /// Whether the controller is in this process.
    pub simulated: bool,
    /// Since the daemon began.
    pub uptime_s: f64,
    /// Whether there is a controller.
    pub connected: bool,
    /// Why there is none, or what it does not do.
    pub device_error: Option<String>,
    /// What the controller is doing: idle, spin-up, acquire, locked, holdover, fault, service, open loop.
    pub state: Option<String>,
    /// Whether planes are lit.
    pub lit: bool,
    /// Why it stopped, with what was measured and what is allowed.
    pub fault: Option<String>,
    /// The mirror's angle ahead of its place, in slices.
    pub phase_error_slices: Option<f64>,
    /// How fast the mirror turns.
    pub mirror_turns_per_second: f64,
    /// How fast it is to turn.
    pub wanted_turns_per_second: f64,
    /// Slices a turn.
    pub slices: u32,
    /// The number of the turn on screen.
    pub turn_on_screen: Option<u32>,
    /// Turns that the controller has got.
    pub turns_delivered: u64,
    /// Turns that came on screen since the controller was switched on.
    pub turns_shown: u32,
    /// Turns that were rendered and not shown: replaced by newer ones, late, or not taken.
    pub turns_dropped: u64,
    /// How often the controller went away and came back.
    pub reconnects: u64,
    /// Turns a second that the controller got, of the last second.
    pub link_turns_per_second: f64,
    /// Bytes a second on the wire, of the last second.
    pub link_bytes_per_second: f64,
    /// Bytes of planes by bytes on the wire, of the last second.
    pub link_ratio: Option<f64>,
    /// The scene that is shown.
    pub scene: Option<String>,
    /// The scene that is being loaded.
    pub loading: Option<String>,
    /// Whether the scene that is shown is being planned anew, for another budget or place.
    pub planning: bool,
    /// Why the scene that is wished for is not shown.
    pub scene_error: Option<String>,
    /// The clips of the scene that is shown.
    pub clips: Vec<String>,
    /// Triangles of that scene.
    pub triangles: usize,
    /// Who renders.
    pub renderer: String,
    /// What the last turn took to render.
    pub render_ms: f64,
    /// Slices of it that were rendered anew.
    pub rendered_slices: u32,
    /// Turns a second that were rendered, of the last second.
    pub renders_per_second: f64,
    /// The methods by which it is rendered.
    pub plan: String,
    /// How far things lie from where they belong at most, in projector pixels, as predicted.
    pub error_px: f64,
    /// What is allowed now; more than was asked for where rendering is late.
    pub budget_px: f64,
    /// Whether no plan with less detail would take less time.
    pub cheapest: bool,
    /// Where the viewing circle is when nobody is tracked: distance and height; nothing for viewers at infinity.
    pub viewing_m: Option<[f64; 2]>,
    /// Half the height of what the display shows, in metres.
    pub display_radius_m: f64,
    /// Who is tracked, where they are expected to be when the light leaves.
    pub viewers: Vec<SeenViewer>,
    /// The rig's trackers: what each is, and how it is.
    pub trackers: Vec<String>,
    /// Readings of trackers that were taken.
    pub readings_taken: u64,
    /// Readings that were refused.
    pub readings_refused: u64,
    /// From a tracker's reading to the first lit plane that follows it: the median of the last hundred.
    pub latency_ms: Option<f64>,
    /// How the video is, where pictures go to a monitor.
    pub video: Option<VideoOutput>,
    /// The number of the last event.
    pub events: u64,
}

/// Pictures on a monitor.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct VideoOutput {
    /// Its name.
    pub monitor: String,
    /// Its refreshes a second.
    pub refresh_hz: Option<f64>,
    /// Frames a second that came on screen in their own refresh, of the last second.
    pub frames_per_second: f64,
    /// Refreshes in which the frame that belongs there was on screen.
    pub frames_shown: u64,
    /// Refreshes in which another one was.
    pub frames_late: u64,
    /// Why there is no picture.
    pub error: Option<String>,
}

/// Somebody whose perspective is right.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SeenViewer {
    /// Who: a tracker's number times 256 and its sensor, or 2048 and more for those who were posted.
    pub id: u16,
    /// From the front toward the right.
    pub azimuth_deg: f64,
    /// From the axis.
    pub distance_m: f64,
    /// Above the middle of the mirror.
    pub height_m: f64,
}

impl From<&SeenViewer> for TrackedViewer {
    fn from(viewer: &SeenViewer) -> Self {
        let SeenViewer { azimuth_deg, distance_m, height_m, .. } = *viewer;
        Self { azimuth_deg, distance_m, height_m }
    }
}

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum EventKind {
    /// Somebody may want to know.
    Note,
    /// Something was not as it should be.
    Warning,
    /// The display is or was dark for it.
    Fault,
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Event {
    /// Counts up.
    pub number: u64,
    /// Seconds since 1970, UTC.
    pub unix_s: f64,
    /// How bad it is.
    pub kind: EventKind,
    /// What.
    pub text: String,
}
