//! A display that runs by itself: a thread that renders, one that talks to the controller, one that answers the network, and this one,
//! which keeps the state and tells the service manager.

pub mod config;
pub mod cuts;
pub mod detail;
pub mod eye;
pub mod focus;
pub mod followed;
pub mod http;
pub mod hub;
pub mod latency;
pub mod library;
pub mod metrics;
mod notices;
pub mod painter;
pub mod phase;
pub mod recorder;
pub mod rendering;
pub mod show;
pub mod stage;
pub mod state;
pub mod telemetry;
pub mod video;
pub mod wish;

use crate::link::address::Address;
use crate::link::sim::{Clock, Injector, Simulated};
use crate::pattern::Pattern;
use crate::recording::{Entry, Setup};
use crate::render::pick::{Notice, pick};
use crate::rigs;
use crate::stream::mailbox::Mailbox;
use crate::tracking::source::Follower;
use crate::video::x11::Monitor;
use crate::video::{Output, VideoError};
use crate::volume::display_radius_m;
use config::{Config, ConfigError, MotorAtStart};
use http::Door;
use hub::{Hub, Picture};
use library::{Library, LibraryError};
use protocol::codec::{ImageSize, ImageSizeError};
use protocol::rig::{Rig, Viewers};
use rendering::Rendering;
use sd_notify::NotifyState;
use show::Show;
use state::{Left, State, Store};
use std::collections::BTreeMap;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use telemetry::{EventKind, Telemetry};
use thiserror::Error;
use video::Video;
use wish::{Animation, Mode, Transform, Wish};

/// The folder of uploaded scenes, in the one where the state is kept.
const SCENES: &str = "scenes";
/// How often this thread looks around.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// How often the state is kept, where it changed.
const SAVE_EVERY: Duration = Duration::from_secs(1);
/// Without a sign of life from the thread that talks to the controller for so long, the service manager gets none either.
const DEAD: Duration = Duration::from_secs(10);

/// Why the daemon does not begin, or ends.
#[derive(Debug, Error)]
pub enum DaemonError {
    /// See the message.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// See the message.
    #[error(transparent)]
    Rig(#[from] rigs::RigsError),
    /// See the message.
    #[error("rig {0}: {1}")]
    Size(String, ImageSizeError),
    /// See the message.
    #[error("rig {0} shows no point from every side: see praxi rig check")]
    ShowsNothing(String),
    /// See the message.
    #[error("video: {0}")]
    Video(#[from] VideoError),
    /// See the message.
    #[error("scene {0}: {1}")]
    Scene(String, LibraryError),
    /// See the message.
    #[error("listen = {0}: {1}: end the other program that has it, or choose another port")]
    Listen(SocketAddr, io::Error),
    /// See the message.
    #[error("{path}: {1}", path = .0.display())]
    State(PathBuf, io::Error),
    /// See the message.
    #[error("{0} ended by itself: the log says more")]
    Thread(&'static str),
}

/// A daemon that is ready to begin: everything was checked that can be without a device.
pub struct Daemon {
    door: Arc<Door>,
    listener: TcpListener,
    threads: Vec<(&'static str, JoinHandle<()>)>,
    mailbox: Mailbox<Picture>,
    store: Store,
    followers: Vec<Follower>,
}

/// What was checked of a configuration.
struct Checked {
    rig: Arc<Rig>,
    address: Address,
    output: Output,
    token: Option<String>,
    display_radius_m: f64,
}

fn check(config: &Config) -> Result<Checked, DaemonError> {
    let (address, token) = config.check()?;
    let rig = rigs::find(&config.rig)?;
    let (width, height) = (rig.projector.width_px, rig.projector.height_px);
    ImageSize::new(width, height).map_err(|error| DaemonError::Size(rig.name.clone(), error))?;
    let display_radius_m = display_radius_m(&rig);
    if display_radius_m == 0.0 {
        return Err(DaemonError::ShowsNothing(rig.name));
    }
    let output = config.output()?;
    if let Output::Video(monitor) = &output {
        Monitor::find(monitor, &rig)?;
    }
    Ok(Checked { rig: Arc::new(rig), address, output, token, display_radius_m })
}

/// Whether a daemon could begin by `config`; nothing is begun or written.
///
/// # Errors
/// What is wrong, the first thing only. Whether the address is free and the device there is not tried; a monitor is looked at.
pub fn check_only(config: &Config) -> Result<(), DaemonError> {
    check(config)?;
    let mut library = Library::over(config.state_dir()?.join(SCENES), config.upload, PathBuf::new());
    library.give(&config.scene).map(drop).map_err(|error| DaemonError::Scene(config.scene.clone(), error))
}

impl Daemon {
    /// Begins as `config` says. `praxi` is the program itself; `scene` is what the command line asks for, over what was shown last.
    pub fn begin(config: &Config, praxi: PathBuf, scene: Option<&str>) -> Result<Self, DaemonError> {
        let Checked { rig, address, output, token, display_radius_m } = check(config)?;
        let folder = config.state_dir()?;
        let failed = |error| DaemonError::State(folder.clone(), error);
        let store = Store::open(&folder).map_err(failed)?;
        let mut library = Library::open(folder.join(SCENES), config.upload, praxi).map_err(failed)?;
        let listener = TcpListener::bind(config.listen).map_err(|error| DaemonError::Listen(config.listen, error))?;
        let listen = listener.local_addr().map_err(|error| DaemonError::Listen(config.listen, error))?;
        let (wish, events, warnings) = first_wish(config, scene, &mut library, &store)?;
        let telemetry = Telemetry {
            rig: rig.name.clone(),
            device: address.to_string(),
            simulated: matches!(address, Address::Sim(_)),
            wanted_turns_per_second: rig.turns_per_second(),
            slices: rig.rotation.slices,
            viewing_m: match rig.at_rest().viewers() {
                Viewers::Circle { distance_m, height_m } => Some([distance_m, height_m]),
                Viewers::Curve(_) | Viewers::Infinity { .. } => None,
            },
            display_radius_m,
            budget_px: wish.budget_px,
            events: events.last().map_or(0, |event: &telemetry::Event| event.number),
            ..Telemetry::default()
        };
        let setup = Setup {
            version: env!("CARGO_PKG_VERSION").into(),
            began_unix_ns: 0,
            rig: Rig::clone(&rig),
            device: address.to_string(),
            seed: config.seed,
            by_video: output != Output::Device,
            triangles_max: config.upload.triangles_max,
            heads: BTreeMap::new(),
        };
        let tracking = rig.tracking.clone().unwrap_or_default();
        let hub = Arc::new(Hub::new(wish, telemetry, events, &tracking));
        warnings.into_iter().for_each(|text| hub.event(EventKind::Warning, text));
        let injector = Injector::default();
        let by_video = setup.by_video;
        let simulated = Simulated::new(Rig::clone(&rig), config.seed, Clock::Wall);
        let simulated = Simulated { injector: injector.clone(), by_video, ..simulated };
        let injector = matches!(address, Address::Sim(_)).then_some(injector);
        let mailbox = Mailbox::default();
        let notice: Notice = {
            let hub = Arc::clone(&hub);
            Box::new(move |error| hub.event(EventKind::Warning, format!("{error}: rendering on the CPU")))
        };
        let library = Arc::new(library);
        let rendering = Rendering::new(
            Arc::clone(&hub),
            Arc::clone(&rig),
            Arc::clone(&library),
            pick(config.render.renderer, None, notice),
            mailbox.clone(),
            [display_radius_m, config.upload.triangles_max as f64],
        );
        let video = match output {
            Output::Device => None,
            Output::Video(monitor) => Some(Video::new(Arc::clone(&hub), Arc::clone(&rig), monitor, mailbox.clone())),
        };
        let to_send = mailbox.clone();
        let show = Show::new(Arc::clone(&hub), Arc::clone(&rig), address, simulated, to_send, by_video, config.faults);
        let followers =
            followed::listen(&hub, &tracking).map_err(|error| DaemonError::State("trackers".into(), error))?;
        let door =
            Door::new(hub, rig, library, injector, token, listen, config.upload.bytes_max, display_radius_m, setup);
        let mut threads = vec![
            ("the thread that renders", spawn("render", move || rendering.run())?),
            ("the thread that talks to the controller", spawn("show", move || show.run())?),
        ];
        if let Some(video) = video {
            threads.push(("the thread that shows video", spawn("video", move || video.run())?));
        }
        Ok(Self { door, listener, threads, mailbox, store, followers })
    }

    /// Where the page is.
    pub fn address(&self) -> SocketAddr {
        self.door.listen
    }

    /// Runs until `interrupted`; then the mirror runs out, the state is kept, and all threads end.
    pub fn run(self, interrupted: &AtomicBool) -> Result<(), DaemonError> {
        let Self { door, listener, mut threads, mailbox, store, followers } = self;
        let hub = Arc::clone(&door.hub);
        let served = Arc::clone(&door);
        let serving = move || {
            if let Err(error) = http::serve(&served, listener) {
                tracing::error!("the door: {error}");
            }
        };
        threads.push(("the thread that answers the network", spawn("http", serving)?));
        let _ = sd_notify::notify(&[NotifyState::Ready]);
        let (mut keeper, mut teller) = (Keeper::new(&hub, &store), followed::Teller::default());
        let mut ended = None;
        while !interrupted.load(Ordering::Relaxed) && ended.is_none() {
            thread::sleep(LOOK_EVERY);
            ended = threads.iter().find(|(_, thread)| thread.is_finished()).map(|(name, _)| *name);
            keeper.look();
            teller.tell(&hub, &followers);
            hub.record(|| Entry::telemetry(&hub.telemetry()));
            if hub.silent_for() < DEAD {
                let _ = sd_notify::notify(&[NotifyState::Watchdog]);
            }
        }
        let _ = sd_notify::notify(&[NotifyState::Stopping]);
        hub.event(EventKind::Note, "the daemon ends");
        hub.stop();
        mailbox.close();
        drop(followers);
        for (name, thread) in threads {
            if thread.join().is_err() {
                tracing::error!("{name} failed");
            }
        }
        keeper.save();
        ended.map_or(Ok(()), |name| Err(DaemonError::Thread(name)))
    }
}

fn spawn(name: &str, run: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, DaemonError> {
    let thread = thread::Builder::new().name(name.into()).spawn(run);
    thread.map_err(|error| DaemonError::State(PathBuf::from(name), error))
}

/// What is to be seen first: what was seen last, but for what the command line says; and where a file is that could not be read.
fn first_wish(
    config: &Config,
    scene: Option<&str>,
    library: &mut Library,
    store: &Store,
) -> Result<(Wish, Vec<telemetry::Event>, Vec<String>), DaemonError> {
    let left = store.load().map_err(|error| DaemonError::State("state.json".into(), error))?;
    let mut give = |scene: &str| library.give(scene).map_err(|error| DaemonError::Scene(scene.into(), error));
    let first = Wish {
        mode: Mode::Scene,
        pattern: Pattern::CrossHairs,
        scene: "builtin".into(),
        transform: Transform::default(),
        animation: Animation::SPIN,
        budget_px: config.render.budget_px,
        halftone: config.render.halftone,
        motor: config.motor == MotorAtStart::Start,
    };
    let mut warnings = Vec::new();
    let (mut wish, events) = match left {
        Left::State(state) => (state.wish, state.events),
        Left::Nothing => (Wish { scene: give(&config.scene)?, ..first }, Vec::new()),
        Left::Damaged(path) => {
            let path = path.display();
            warnings.push(format!("what was kept cannot be read: it is in {path}, and everything begins anew"));
            (Wish { scene: give(&config.scene)?, ..first }, Vec::new())
        }
    };
    if let Some(scene) = scene {
        let name = give(scene)?;
        let animation = if name == wish.scene { wish.animation } else { Animation::SPIN };
        wish = Wish { mode: Mode::Scene, scene: name, animation, ..wish };
    } else if library.find(&wish.scene).is_err() {
        // The file of an earlier command line, or one that was removed since.
        warnings.push(format!("the scene {} that was shown last is not there any more", wish.scene));
        wish.scene = library.give(&config.scene).map_err(|error| DaemonError::Scene(config.scene.clone(), error))?;
    }
    Ok((wish, events, warnings))
}

/// Keeps the state where it changed, not too often.
struct Keeper<'a> {
    hub: &'a Hub,
    store: &'a Store,
    kept: (u64, u64),
    at: Instant,
}

impl<'a> Keeper<'a> {
    fn new(hub: &'a Hub, store: &'a Store) -> Self {
        Self { hub, store, kept: (u64::MAX, 0), at: Instant::now() }
    }

    fn look(&mut self) {
        let now = (self.hub.wish().1, self.hub.telemetry().events);
        if now != self.kept && self.at.elapsed() >= SAVE_EVERY {
            self.save();
            self.kept = now;
            self.at = Instant::now();
        }
    }

    fn save(&self) {
        let state = State { wish: self.hub.wish().0, events: self.hub.events_after(0) };
        if let Err(error) = self.store.save(state) {
            // Not an event: that would be kept, too.
            tracing::error!("the state cannot be kept: {error}");
        }
    }
}
