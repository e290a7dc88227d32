//! `praxi record`: what happens to a display that runs, in a file.

use super::{Failure, say, say_json};
use crate::input;
use crate::output::reason;
use crate::recording::Entry;
use crate::recording::file::{Entries, FileError, Writer};
use std::fs::{File, Metadata};
use std::io::{self, BufWriter, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// How long a daemon may take to answer.
const ANSWER: Duration = Duration::from_secs(10);
/// What came can be read after so long, whatever becomes of this program.
const KEEP_EVERY: Duration = Duration::from_secs(1);

/// Record what happens to a display that runs: telemetry, trackers, orders, turns
#[derive(clap::Args)]
#[command(after_help = "Examples: praxi record problem.mcap\n          \
    praxi record problem.mcap --seconds 60 --from http://rig.local:7117 --token-file token\n\n\
    It goes on until Ctrl-C or --seconds; what came so far can be read at any time. praxi replay tells it again; other programs that read \
    MCAP files show its JSON messages.")]
pub(super) struct Args {
    /// Where to write; a file of that name stays, and is an error
    file: PathBuf,
    /// The daemon: where its page is
    #[arg(long, value_name = "URL", default_value = "http://127.0.0.1:7117")]
    from: String,
    /// The file with the daemon's token, where it wants one
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// How long to record, in seconds: 0.1 to 604800 [default: until Ctrl-C]
    #[arg(long, value_name = "SECONDS")]
    seconds: Option<f64>,
    /// Print the counts as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let interrupted = super::until_interrupted();
    let named = |reason: String| Failure(format!("{}: {reason}", args.file.display()));
    let body = ask(args)?;
    let file = create(&args.file).map_err(|error| named(reason(&error)))?;
    let failed = |error: FileError| named(error.to_string());
    let mut writer = Writer::new(BufWriter::new(file)).map_err(failed)?;
    let (mut entries, mut counts, mut kept_at, mut missing) =
        (Entries::new(body), Counts::default(), Instant::now(), None);
    while !interrupted.load(Ordering::Relaxed) {
        match entries.next() {
            Some(Ok(entry)) => {
                counts.add(&entry);
                writer.write(&entry).map_err(failed)?;
            }
            Some(Err(error)) => {
                missing = Some(error.to_string());
                break;
            }
            None => break,
        }
        if kept_at.elapsed() >= KEEP_EVERY {
            writer.flush().map_err(failed)?;
            kept_at = Instant::now();
        }
    }
    let written = writer.finish().map_err(failed)?;
    written.into_inner().map_err(|error| named(reason(error.error())))?.sync_all().or_else(is_no_disk)?;
    if args.json {
        say_json(&counts.json());
    } else {
        say(format!("{counts}: {}", args.file.display()));
    }
    if missing.is_none() && entries.is_cut() && !interrupted.load(Ordering::Relaxed) {
        missing = Some("the connection ended".into());
    }
    missing.map_or(Ok(()), |why| {
        Err(Failure(format!("{}: {why}; what came until then is in {}", args.from, args.file.display())))
    })
}

/// Terminals and pipes have nothing to be written to.
fn is_no_disk(error: io::Error) -> io::Result<()> {
    if error.kind() == io::ErrorKind::InvalidInput { Ok(()) } else { Err(error) }
}

/// A new file; or a terminal, a pipe, or whatever else is no file.
fn create(path: &Path) -> io::Result<File> {
    match File::create_new(path) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
            let is_file = path.metadata().as_ref().is_ok_and(Metadata::is_file) || path.is_dir();
            let there = || io::Error::new(io::ErrorKind::AlreadyExists, "is there: name another file");
            if is_file { Err(there()) } else { File::options().write(true).open(path) }
        }
        made => made,
    }
}

/// The recording as it comes.
fn ask(args: &Args) -> Result<impl Read + use<>, Failure> {
    let url = format!("{}/api/v1/recording.mcap", args.from.trim_end_matches('/'));
    let refused = |reason: String| Failure(format!("{}: {reason}", args.from));
    let agent = ureq::Agent::config_builder()
        .http_status_as_error(false)
        .timeout_recv_response(Some(ANSWER))
        .timeout_connect(Some(ANSWER));
    let mut request = agent.build().new_agent().get(url);
    if let Some(seconds) = args.seconds {
        request = request.query("seconds", seconds.to_string());
    }
    if let Some(path) = &args.token_file {
        let token = input::read_text(path).map_err(|error| Failure(format!("{}: {error}", path.display())))?;
        request = request.header("authorization", format!("Bearer {}", token.trim()));
    }
    let mut answer = request.call().map_err(|error| refused(format!("{error}: does praxi run run there?")))?;
    if answer.status() != 200 {
        let text = answer.body_mut().read_to_string().unwrap_or_default();
        let said = serde_json::from_str::<serde_json::Value>(&text).ok();
        let said = said
            .and_then(|json| json["error"].as_str().map(String::from))
            .unwrap_or_else(|| answer.status().to_string());
        return Err(refused(said));
    }
    Ok(answer.into_body().into_reader())
}

/// What was recorded.
#[derive(Default)]
struct Counts {
    first_ns: Option<u64>,
    last_ns: u64,
    turns: u64,
    readings: u64,
    orders: u64,
    events: u64,
    lost: u64,
}

impl Counts {
    fn seconds(&self) -> f64 {
        self.last_ns.saturating_sub(self.first_ns.unwrap_or(self.last_ns)) as f64 / 1e9
    }

    fn json(&self) -> serde_json::Value {
        let Self { turns, readings, orders, events, lost, .. } = self;
        serde_json::json!({
            "seconds": self.seconds(), "turns": turns, "readings": readings, "orders": orders, "events": events, "lost": lost,
        })
    }

    fn add(&mut self, (at_ns, entry): &(u64, Entry)) {
        self.first_ns.get_or_insert(*at_ns);
        self.last_ns = *at_ns;
        match entry {
            Entry::Stroke(stroke) if stroke.sectors.is_some() => self.turns += 1,
            Entry::Reading(_) | Entry::Eye(_) => self.readings += 1,
            Entry::Order(_) | Entry::Action(_) | Entry::Wish(_) => self.orders += 1,
            Entry::Event(_) => self.events += 1,
            Entry::Lost { entries } => self.lost += entries,
            _ => {}
        }
    }
}

impl std::fmt::Display for Counts {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { turns, readings, orders, events, lost, .. } = self;
        write!(
            formatter,
            "{:.1} s, {turns} turns, {readings} readings, {orders} orders, {events} events",
            self.seconds()
        )?;
        if *lost > 0 {
            write!(formatter, "; {lost} entries are missing: they came faster than they were written")?;
        }
        Ok(())
    }
}
