//! `praxi order`: one order to a controller.

use super::{Failure, say};
use crate::link::address::Address;
use crate::link::sim::{Clock, Simulated};
use crate::rigs;
use crate::stream::Stream;
use protocol::codec::ImageSize;
use protocol::message::Command;
use std::time::Duration;

/// Give a controller one order: start or stop the mirror, clear a fault, turn the picture of a mirror that nothing measures
#[derive(clap::Args)]
#[command(
    after_help = "Examples: praxi order stop --device usb\n          praxi order shift-phase --degrees 1.5 --device /dev/ttyACM0"
)]
pub(super) struct Args {
    /// What to do
    #[arg(value_enum)]
    order: Order,
    /// The controller: usb, usb:VID:PID[:SERIAL], /dev/ttyACM0[@BAUD]
    #[arg(long, value_name = "DEVICE", default_value = "usb")]
    device: Address,
    /// A rig file, or reference, reference-180hz, high-viewer, tent: how turns are cut there
    #[arg(long, default_value = "reference")]
    rig: String,
    /// By how much to turn the picture, in the way in which the mirror turns
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, value_parser = degrees, allow_negative_numbers = true)]
    degrees: f64,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Order {
    /// Spin up and lock
    Start,
    /// Go dark, let the mirror run out
    Stop,
    /// Leave the fault, if its cause is gone
    ClearFault,
    /// Turn the picture by --degrees, where nothing measures the mirror
    ShiftPhase,
}

fn degrees(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "must be a number of degrees".to_string())?;
    if value.abs() <= 180.0 { Ok(value) } else { Err("must be from -180 to 180 degrees".into()) }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rig = rigs::find(&args.rig)?;
    let size = ImageSize::new(rig.projector.width_px, rig.projector.height_px)?;
    let simulated = Simulated { rig: rig.clone(), seed: 1, clock: Clock::Simulated };
    let named = |error: &dyn std::fmt::Display| Failure(format!("{}: {error}", args.device));
    let mut way = args.device.way(&simulated).map_err(|error| named(&error))?;
    let link = way.connect().map_err(|error| named(&error))?;
    let mut stream = Stream::new(link, &rig.rotation(), size).map_err(|error| named(&error))?;
    let command = match args.order {
        Order::Start => Command::Start,
        Order::Stop => Command::Stop,
        Order::ClearFault => Command::ClearFault,
        Order::ShiftPhase => Command::ShiftPhase { shift: (args.degrees / 360.0 * 4_294_967_296.0) as i64 as i32 },
    };
    stream.command(command).map_err(|error| named(&error))?;
    // The controller reports a hundred times a second; the order is carried out by then.
    stream.poll(Duration::from_millis(100)).map_err(|error| named(&error))?;
    let status = stream.poll(Duration::from_millis(100)).map_err(|error| named(&error))?;
    let Some(status) = status else { return Err(named(&"it took the order and does not report")) };
    let fault = status.fault.map(|fault| format!(": {fault}")).unwrap_or_default();
    say(format!("{}: {}{fault}", args.device, super::stream::word(status.state)));
    Ok(())
}
