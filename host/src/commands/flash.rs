//! `praxi flash`: another firmware for a controller.

use super::args::progress;
use super::{Failure, say, say_json};
use crate::flash::usb::Usb;
use crate::flash::{Device, FlashError, IMAGE_BYTES_MAX, flash, public, read_key, verify};
use crate::input;
use crate::link::usb::Name;
use hil_sim::dfu::{Accept, Controller, Owner, Port, UsbError};
use protocol::image::{Board, Identity, split};
use serde_json::json;
use std::path::PathBuf;

/// The name of the simulated controller's board.
const SIMULATED_BOARD: &str = "sim";

/// Send a signed firmware image to a controller, and see it run; the old one comes back by itself where it does not
#[derive(clap::Args)]
#[command(after_help = "Example: praxi flash firmware.img --device sim --key owner.key.pub")]
pub(super) struct Args {
    /// A signed image, as praxi image sign writes it
    image: PathBuf,
    /// usb, or usb:VID:PID[:SERIAL] with the numbers that lsusb lists, or sim: a blank controller, another one each time
    #[arg(long, value_name = "DEVICE", value_parser = target)]
    device: Target,
    /// The owner's public key: the image is checked before it is sent; the simulated controller trusts it
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
    /// Take an older version as well
    #[arg(long)]
    force: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone)]
enum Target {
    Simulated,
    Usb(Name),
}

fn target(text: &str) -> Result<Target, String> {
    match text {
        "sim" => Ok(Target::Simulated),
        text => text.parse().map(Target::Usb).map_err(|error| format!("{error}; or sim")),
    }
}

/// A blank controller in this process.
struct Simulated(Controller);

impl Device for Simulated {
    type Error = UsbError;
    type Io = Port;

    fn running(&mut self) -> Result<Option<Identity>, FlashError> {
        self.open(false)?;
        Ok(self.0.identity())
    }

    fn open(&mut self, takes_any: bool) -> Result<Port, FlashError> {
        let accept = if takes_any { Accept::Any } else { Accept::Newer };
        self.0.open(accept).map_err(|error| FlashError::Device(error.to_string()))
    }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let file = |error| FlashError::File(args.image.clone(), error);
    let image = input::read(&args.image, IMAGE_BYTES_MAX).map_err(file)?;
    split(&image).map_err(|error| FlashError::Image(args.image.clone(), error))?;
    let key = args.key.as_deref().map(read_key).transpose()?;
    if let (Some(file), Some(key)) = (&args.key, &key)
        && let Err(error) = verify(key, &image)
    {
        // The secret half in its place would go unnoticed otherwise: both look alike.
        let is_secret = verify(&public(key), &image).is_ok();
        return Err(Failure(match is_secret {
            true => format!("{}: that is the secret key: its public half checks", file.display()),
            false => format!("{}: {error}", args.image.display()),
        }));
    }
    let bar = progress("sending bytes", image.len() as u64);
    let shown = bar.clone();
    let report = move |sent| shown.set_position(sent);
    let outcome = match &args.device {
        Target::Usb(name) => flash(&mut Usb::new(name.clone()), &image, args.force, report),
        Target::Simulated => {
            let key = key.ok_or(Failure("--device sim needs --key FILE: the public key that it trusts".into()))?;
            let owner = Owner { board: Board::new(SIMULATED_BOARD)?, key };
            flash(&mut Simulated(Controller::new(owner)), &image, args.force, report)
        }
    };
    bar.finish_and_clear();
    let header = outcome.map_err(|error| Failure(format!("{}: {error}", args.image.display())))?;
    if args.json {
        let version = header.version.to_string();
        say_json(&json!({ "board": header.board.name(), "version": version, "bytes": image.len() }));
    } else {
        say(format!("{} runs {}: tested by itself, and confirmed", header.board, header.version));
    }
    Ok(())
}
