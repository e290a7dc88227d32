//! `praxi stream`: scenes to a controller, turn after turn, for as long as somebody wants.

mod meter;
mod program;
mod report;

use super::args::{PlanArgs, RendererArgs, seed};
use super::{Failure, say, warn};
use crate::halftoned::Halftoned;
use crate::link::address::{Address, Way};
use crate::link::sim::{Clock, Simulated};
use crate::render::Renderer;
use crate::render::plan::Halftone;
use crate::render::turn::Turn;
use crate::rigs;
use crate::stream::live::{Live, Nothing, Progress, Source, Standby, Step};
use crate::stream::mailbox::Mailbox;
use meter::Meter;
use program::Program;
use protocol::codec::ImageSize;
use protocol::message::{Command, State};
use protocol::rig::Rig;
use report::Report;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// A turn that is under way for so long is left where there is a newer one: it shows what was, not what is.
const DEADLINE: Duration = Duration::from_secs(1);
/// When turns stop coming, the standby follows after this.
const STANDBY_AFTER: Duration = Duration::from_secs(2);
/// The last turn is on screen within three turns of the slowest mirror.
const ON_SCREEN_WITHIN: Duration = Duration::from_secs(1);
/// How long the mirror may take until it is in step.
const LOCK_WITHIN: Duration = Duration::from_secs(60);

/// Render scenes and stream them to a controller, turn after turn: the newest one is shown, a device that goes away is looked for
#[derive(clap::Args)]
#[command(after_help = "Examples: praxi stream builtin --device usb --animate spin\n          \
    praxi stream builtin --device sim:usb --turns 100 --json\n\n\
    The last turn stays on the display when the program ends, until praxi order stop; --at-end stop stops the mirror.\n    \
    Ctrl-C leaves the turn that is under way; pressed twice, it ends everything at once.")]
pub(super) struct Args {
    /// .gltf, .glb, .obj or .ply files, or built-in scenes, each scaled to fill the display; several are shown one after the other
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<String>,
    /// The controller: usb, usb:VID:PID[:SERIAL], /dev/ttyACM0[@BAUD], COM3[@BAUD], sim, sim:usb, sim:serial[@BAUD]
    #[arg(long, value_name = "DEVICE", default_value = "sim")]
    device: Address,
    /// A rig file, or reference, reference-180hz, high-viewer, tent
    #[arg(long, default_value = "reference")]
    rig: String,
    /// End when the device has N turns; without it, on Ctrl-C
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    turns: Option<u64>,
    /// What moves: the scene as a whole, or what its file's clip moves
    #[arg(long, value_enum)]
    animate: Option<Motion>,
    /// Turn a spinning scene by so many degrees in each turn of the mirror
    #[arg(long, value_name = "DEGREES", default_value_t = 2.0, requires = "animate", value_parser = degrees, allow_negative_numbers = true)]
    spin_deg: f64,
    /// The clip of this name, in place of the file's first one
    #[arg(long, value_name = "NAME", requires = "animate")]
    clip: Option<String>,
    /// Of several scenes, show each for so many turns of the mirror
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..))]
    hold: u64,
    /// How luminance becomes bits: masks compress twice as well as diffusion
    #[arg(long, value_enum, default_value = "blue-noise")]
    halftone: Halftone,
    /// What stands on the display when turns stop coming
    #[arg(long, value_enum, default_value = "last")]
    standby: StandbyArg,
    /// What becomes of the display at the end
    #[arg(long, value_enum, default_value = "leave")]
    at_end: AtEnd,
    /// Look for a device that went away for so many seconds
    #[arg(long, value_name = "S", default_value_t = 30.0, value_parser = look_for, allow_negative_numbers = true)]
    look_for_s: f64,
    /// All noise of a simulated rig follows from it
    #[arg(long, default_value_t = 1, value_parser = seed, allow_negative_numbers = true)]
    seed: u64,
    #[command(flatten)]
    plan: PlanArgs,
    #[command(flatten)]
    renderer: RendererArgs,
    /// Print a line of JSON each second, and one at the end
    #[arg(long)]
    json: bool,
}

/// What moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Motion {
    /// The scene turns about the axis.
    Spin,
    /// A clip of the scene's file goes on and on.
    Clip,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum StandbyArg {
    /// The last turn
    Last,
    /// The built-in scene
    Attract,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum AtEnd {
    /// The mirror goes on, with what stands then, until praxi order stop
    Leave,
    /// The mirror stops, dark
    Stop,
}

fn degrees(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "must be a number of degrees".to_string())?;
    if value.abs() <= 360.0 { Ok(value) } else { Err("must be from -360 to 360 degrees".into()) }
}

fn look_for(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "must be a number of seconds".to_string())?;
    if (0.0..=1e9).contains(&value) { Ok(value) } else { Err("must be from 0 to 1e9 seconds".into()) }
}

/// A turn as it is sent: pictures that stand still are rendered once.
type Picture = Halftoned<Arc<Turn>>;
type Display = Live<Way, Picture>;

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rig = rigs::find(&args.rig)?;
    let size = ImageSize::new(rig.projector.width_px, rig.projector.height_px)?;
    let renderer = args.renderer.open()?;
    let program = Program::load(args, &rig)?;
    let standby = standby(args, &rig, renderer.as_ref())?;
    let simulated = Simulated::new(rig.clone(), args.seed, Clock::Wall);
    let way = args.device.way(&simulated)?;
    let look_for = Duration::from_secs_f64(args.look_for_s);
    let display = Live::new(way, &rig.rotation(), size, [DEADLINE, look_for]);
    let mut display = display.map_err(|error| Failure::at(&args.device, &error))?;
    if let Some(turn) = standby {
        display.set_standby(Standby { after: STANDBY_AFTER, turn });
    }
    let interrupted = super::until_interrupted();
    let mailbox = Mailbox::default();
    let wants_more = || !interrupted.load(Ordering::Relaxed);
    let meter = Meter::new(args.json, &rig, size.plane_bytes(), &display);
    let mut source = Watched { mailbox: mailbox.clone(), wants_more: &wants_more, meter };
    let (streamed, rendered) = std::thread::scope(|scope| {
        let rendering = scope.spawn(|| {
            let rendered = program.render(renderer.as_ref(), &rig, &mailbox);
            mailbox.close();
            rendered
        });
        let streamed = show(args, &mut display, &mut source);
        source.meter.clear();
        mailbox.close();
        (streamed, rendering.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    });
    let (rendering, rendered) = rendered.map_or_else(|error| (Default::default(), Err(error)), |its| (its, Ok(())));
    let outcome = streamed.and(rendered).and_then(|()| leave(args, &mut display));
    let report = Report::new(args, &display, &mailbox, &source.meter, rendering, outcome.as_ref().err());
    if args.json {
        say(report.as_json())
    } else if outcome.is_ok() || source.meter.has_begun {
        say(report.as_text())
    }
    outcome
}

/// The turn that stands when turns stop coming.
fn standby(args: &Args, rig: &Rig, renderer: &dyn Renderer) -> Result<Option<Picture>, Failure> {
    if args.standby == StandbyArg::Last {
        return Ok(None);
    }
    let program = Program::attract(args, rig)?;
    Ok(Some(program.picture(renderer, rig, 0)?))
}

/// Brings the mirror into step, then sends turns until there are enough.
fn show(args: &Args, display: &mut Display, source: &mut Watched<'_>) -> Result<(), Failure> {
    spin_up(args, display, source)?;
    source.meter.start(display);
    while !source.is_over()
        && args.turns.is_none_or(|turns| display.totals().delivered < turns)
        && !source.mailbox.is_closed()
    {
        let stepped = step(args, display, source)?;
        let meter = &mut source.meter;
        match stepped {
            Step::Away(error) if display.totals().reconnects == meter.losses => {
                meter.losses += 1;
                let Failure(text) = Failure::at(&args.device, &error);
                warn(format!("{text}: looking for it"));
            }
            Step::Back => {
                meter.losses = display.totals().reconnects;
                warn(format!("{}: back", args.device));
            }
            _ => {}
        }
        start(args, display)?;
        meter.tell(display, &source.mailbox);
    }
    let until = display.now() + ON_SCREEN_WITHIN;
    while !display.shows_last() && display.is_connected() && display.now() < until {
        step(args, display, &mut Nothing::default())?;
    }
    Ok(())
}

/// One step; a fault of the controller ends the stream.
fn step(args: &Args, display: &mut Display, source: &mut impl Source<Turn = Picture>) -> Result<Step, Failure> {
    let step = display.step(source).map_err(|error| Failure::at(&args.device, &error))?;
    let fault = display.status().filter(|status| status.state == State::Fault).and_then(|status| status.fault);
    if let Some(fault) = fault {
        let cause = display.faults().map(|faults| format!(" ({})", faults.cause())).unwrap_or_default();
        let cause = cause.replace(" ()", "");
        let what = format!("the controller stopped: {fault}{cause}; see to it, then praxi order clear-fault");
        return Err(Failure(format!("{}: {what}", args.device)));
    }
    Ok(step)
}

/// A controller that waits is told to start.
fn start(args: &Args, display: &mut Display) -> Result<(), Failure> {
    if display.is_connected() && display.status().is_some_and(|status| status.state == State::Idle) {
        display.command(Command::Start).map_err(|error| Failure::at(&args.device, &error))?;
    }
    Ok(())
}

fn spin_up(args: &Args, display: &mut Display, source: &mut Watched<'_>) -> Result<(), Failure> {
    let began = display.now();
    while !source.is_over() && !display.status().is_some_and(|status| status.state.may_light()) {
        step(args, display, &mut Nothing::default())?;
        start(args, display)?;
        source.meter.spinning_up(display);
        if display.now().saturating_sub(began) > LOCK_WITHIN {
            let state = display.status().map(|status| status.state);
            return Err(Failure(format!(
                "{}: the mirror is not in step after {} s (state {state:?}): praxi doctor says more",
                args.device,
                LOCK_WITHIN.as_secs()
            )));
        }
    }
    Ok(())
}

/// What the display is left with.
fn leave(args: &Args, display: &mut Display) -> Result<(), Failure> {
    if args.standby == StandbyArg::Attract && args.at_end == AtEnd::Leave {
        let until = display.now() + STANDBY_AFTER + Duration::from_secs(5);
        while !display.stands_by() && display.now() < until {
            step(args, display, &mut Nothing::default())?;
        }
    }
    if args.at_end == AtEnd::Stop {
        display.command(Command::Stop).map_err(|error| Failure::at(&args.device, &error))?;
    }
    Ok(())
}

/// Turns until Ctrl-C, and how they do.
struct Watched<'a> {
    mailbox: Mailbox<Picture>,
    wants_more: &'a dyn Fn() -> bool,
    meter: Meter,
}

impl Source for Watched<'_> {
    type Turn = Picture;

    fn take(&mut self, now: Duration) -> Option<Picture> {
        self.mailbox.take(now)
    }

    fn has_newer(&mut self, now: Duration) -> bool {
        self.mailbox.has_newer(now)
    }

    fn is_over(&mut self) -> bool {
        !(self.wants_more)()
    }

    fn watch(&mut self, progress: &Progress) {
        self.meter.watch(progress, &self.mailbox);
    }
}
