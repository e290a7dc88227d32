//! `praxi run`: a display that runs by itself, with a page to watch it.

use super::{Failure, say};
use crate::daemon::config::{Config, DOCUMENTED, LogForm, address};
use crate::daemon::{Daemon, check_only};
use crate::video::x11::Monitor;
use std::net::SocketAddr;
use std::path::PathBuf;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::filter::LevelFilter;

/// Run a display by itself and serve its page: what an eye sees, how it does, orders to it
#[derive(clap::Args)]
#[command(after_help = "Examples: praxi run\n          praxi run --rig rig.toml --device usb Fox.glb\n          \
    praxi run --config /etc/praxi.toml --check\n          \
    praxi run --rig rig.toml --device usb --output video:HDMI-1\n\nThe page is at http://127.0.0.1:7117/. The command line stands above the file.")]
pub(super) struct Args {
    /// What is shown: a model file, or the name of a built-in or uploaded scene [default: what was shown last]
    scene: Option<String>,
    /// Read this file; --print-config shows every key
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// A rig file, or reference, reference-180hz, high-viewer, tent
    #[arg(long)]
    rig: Option<String>,
    /// The controller: usb, usb:VID:PID[:SERIAL], /dev/ttyACM0[@BAUD], COM3[@BAUD], sim, sim:usb, sim:serial[@BAUD]
    #[arg(long, value_name = "DEVICE")]
    device: Option<String>,
    /// Where pictures go: device, or video:MONITOR for a monitor at DISPLAY; video:? lists monitors and ends
    #[arg(long, value_name = "OUTPUT")]
    output: Option<String>,
    /// Where the page and the interface are served; others than loopback need token_file in the configuration
    #[arg(long, value_name = "ADDR:PORT", value_parser = address)]
    listen: Option<SocketAddr>,
    /// Where the state is kept, and the scenes that were uploaded
    #[arg(long, value_name = "FOLDER")]
    state_dir: Option<PathBuf>,
    /// Check the configuration, print what holds, and end
    #[arg(long)]
    check: bool,
    /// Print every key with its default, and end
    #[arg(long, conflicts_with = "check")]
    print_config: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if args.print_config {
        say(DOCUMENTED);
        return Ok(());
    }
    let config = config(args)?;
    if config.output == "video:?" {
        say(Monitor::there()?.join("\n"));
        return Ok(());
    }
    if args.check {
        check_only(&config)?;
        say(toml::to_string(&config)?);
        return Ok(());
    }
    log(config.log);
    let interrupted = super::until_interrupted();
    let daemon = Daemon::begin(&config, std::env::current_exe()?, args.scene.as_deref())?;
    tracing::info!("the page is at http://{}/", daemon.address());
    daemon.run(interrupted)?;
    Ok(())
}

/// The file's, under what the command line says.
fn config(args: &Args) -> Result<Config, Failure> {
    let file = args.config.as_deref().map_or_else(|| Ok(Config::default()), Config::load)?;
    Ok(Config {
        rig: args.rig.clone().unwrap_or(file.rig),
        device: args.device.clone().unwrap_or(file.device),
        output: args.output.clone().unwrap_or(file.output),
        scene: args.scene.clone().unwrap_or(file.scene),
        listen: args.listen.unwrap_or(file.listen),
        state_dir: args.state_dir.clone().or(file.state_dir),
        ..file
    })
}

fn log(form: LogForm) {
    let filter = EnvFilter::builder().with_default_directive(LevelFilter::INFO.into()).from_env_lossy();
    let lines = tracing_subscriber::fmt().with_writer(std::io::stderr).with_env_filter(filter);
    match form {
        LogForm::Text => {
            let is_terminal = std::io::IsTerminal::is_terminal(&std::io::stderr());
            lines.with_ansi(is_terminal).with_target(false).init();
        }
        LogForm::Json => lines.json().init(),
    }
}
