//! One file a subcommand. This one reads the command line, and is the edge at which errors become one line and exit code 2.

mod args;
mod bake;
mod bench;
mod calibrate;
mod chart;
mod compare;
mod demo;
mod devices;
mod doctor;
mod flash;
mod image;
mod lock_chart;
mod order;
mod pattern;
mod plan;
mod project;
mod record;
mod register;
mod render;
mod replay;
mod rig;
mod rig_file;
mod run;
mod scene;
mod see;
mod sim;
mod stream;
mod truth;
mod tune;
mod wire_chart;

use crate::link::address::Address;
use crate::output;
use crate::stream::StreamError;
use clap::error::ErrorKind;
use clap::{Parser, Subcommand};
use std::fmt::Display;
use std::io::{ErrorKind as ErrorKindIo, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

/// Praxinoscope: what a 360-degree light-field display shows, rendered, simulated and seen.
#[derive(Parser)]
#[command(name = "praxi", version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Demo(demo::Args),
    Render(render::Args),
    Bake(bake::Args),
    See(see::Args),
    Plan(plan::Args),
    Chart(chart::Args),
    LockChart(lock_chart::Args),
    WireChart(wire_chart::Args),
    Bench(bench::Args),
    Truth(truth::Args),
    Compare(compare::Args),
    Project(project::Args),
    Rig(rig::Args),
    Scene(scene::Args),
    Pattern(pattern::Args),
    VerifyMarkers(pattern::VerifyArgs),
    Run(run::Args),
    Record(record::Args),
    Replay(replay::Args),
    Register(register::Args),
    Calibrate(calibrate::Args),
    Stream(stream::Args),
    Order(order::Args),
    Sim(sim::Args),
    Tune(tune::Args),
    Image(image::Args),
    Flash(flash::Args),
    Devices(devices::Args),
    Doctor(doctor::Args),
}

/// What is printed on one line before exit code 2: what, where, what is allowed.
#[derive(Debug)]
struct Failure(String);

impl<E: std::error::Error> From<E> for Failure {
    fn from(error: E) -> Self {
        Self(error.to_string())
    }
}

impl Failure {
    /// What went wrong with `device`, which is named once.
    fn at(device: &Address, error: &StreamError) -> Self {
        Self(if error.names_device() { error.to_string() } else { format!("{device}: {error}") })
    }
}

/// Whether the command watches [`INTERRUPTED`].
static ENDS_BY_ITSELF: AtomicBool = AtomicBool::new(false);
/// Ctrl-C was pressed once.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Becomes true at the first Ctrl-C, which then ends nothing by itself; the second one ends the program.
fn until_interrupted() -> &'static AtomicBool {
    ENDS_BY_ITSELF.store(true, Ordering::Relaxed);
    &INTERRUPTED
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return refuse_arguments(&error),
    };
    // Without the handler a stopped program leaves a hidden folder behind, and nothing worse.
    let _ = ctrlc::set_handler(|| {
        if ENDS_BY_ITSELF.load(Ordering::Relaxed) && !INTERRUPTED.swap(true, Ordering::Relaxed) {
            return;
        }
        output::remove_half_made();
        std::process::exit(130);
    });
    let result = match cli.command {
        Command::Demo(args) => demo::run(&args),
        Command::Render(args) => render::run(&args),
        Command::Bake(args) => bake::run(&args),
        Command::See(args) => see::run(&args),
        Command::Chart(args) => chart::run(&args),
        Command::LockChart(args) => lock_chart::run(&args),
        Command::WireChart(args) => wire_chart::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Plan(args) => plan::run(&args),
        Command::Truth(args) => truth::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Project(args) => project::run(&args),
        Command::Rig(args) => rig::run(&args),
        Command::Scene(args) => scene::run(&args),
        Command::Pattern(args) => pattern::run(&args),
        Command::VerifyMarkers(args) => pattern::verify(&args),
        Command::Run(args) => run::run(&args),
        Command::Record(args) => record::run(&args),
        Command::Replay(args) => replay::run(&args),
        Command::Register(args) => register::run(&args),
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Order(args) => order::run(&args),
        Command::Stream(args) => stream::run(&args),
        Command::Sim(args) => sim::run(&args),
        Command::Tune(args) => tune::run(&args),
        Command::Image(args) => image::run(&args),
        Command::Flash(args) => flash::run(&args),
        Command::Devices(args) => devices::run(&args),
        Command::Doctor(args) => doctor::run(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure(message)) => fail(&message),
    }
}

fn fail(message: &str) -> ExitCode {
    const LONGEST: usize = 600;
    let mut line = message.split_whitespace().collect::<Vec<_>>().join(" ");
    if let Some((end, _)) = line.char_indices().nth(LONGEST) {
        line.truncate(end);
        line.push('…');
    }
    eprintln!("praxi: error: {line}");
    ExitCode::from(2)
}

fn refuse_arguments(error: &clap::Error) -> ExitCode {
    match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => {
            say(error.render());
            ExitCode::SUCCESS
        }
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            eprint!("{}", error.render());
            ExitCode::from(2)
        }
        _ => {
            let text = error.render().to_string();
            let text = text.split("\n\nUsage:").next().unwrap_or(&text).replace("\n\n  tip: ", "; ");
            fail(text.split("\n\nFor more").next().unwrap_or(&text).trim_start_matches("error: "))
        }
    }
}

/// Prints to standard output. A reader that has gone away, as in `praxi … | head`, is no error.
fn say(text: impl Display) {
    let mut out = std::io::stdout().lock();
    let written = writeln!(out, "{}", text.to_string().trim_end()).and_then(|()| out.flush());
    if let Err(error) = &written
        && error.kind() != ErrorKindIo::BrokenPipe
    {
        eprintln!("praxi: error: standard output: {}", output::reason(error));
        std::process::exit(2);
    }
    if written.is_err() {
        // Nobody reads: what goes on until it is interrupted ends.
        INTERRUPTED.store(true, Ordering::Relaxed);
    }
}

fn say_json(value: &serde_json::Value) {
    say(format!("{value:#}"));
}

/// `text` beside `head`, its words in lines of at most 80 characters below each other. A word is never broken.
fn hanging(head: &str, text: &str) -> String {
    const COLUMNS: usize = 80;
    let indent = head.chars().count();
    let mut lines = vec![head.to_string()];
    for word in text.split_whitespace() {
        let column = lines.last().map_or(0, |line| line.chars().count());
        if column + 1 + word.chars().count() > COLUMNS && column > indent {
            lines.push(" ".repeat(indent));
        }
        let line = lines.last_mut().expect("there is one");
        line.push_str(if line.chars().count() > indent { " " } else { "" });
        line.push_str(word);
    }
    lines.join("\n")
}

fn warn(message: impl Display) {
    eprintln!("praxi: warning: {message}");
}
