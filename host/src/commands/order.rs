//! `praxi order`: one order to a controller.

use super::{Failure, say, say_json};
use crate::link::address::Address;
use crate::link::sim::{Clock, Simulated};
use crate::rigs;
use crate::stream::order;
use protocol::message::Command;
use serde_json::json;
use std::time::Duration;

/// The controller reports a hundred times a second; on a slow line it takes a while until that is through.
const REPORTED_WITHIN: Duration = Duration::from_millis(200);

/// Give a controller one order: start or stop the mirror, clear a fault, turn the picture of a mirror that nothing measures
#[derive(clap::Args)]
#[command(
    after_help = "Examples: praxi order stop --device usb\n          praxi order shift-phase --degrees 1.5 --device /dev/ttyACM0"
)]
pub(super) struct Args {
    /// What to do
    #[arg(value_enum)]
    order: Order,
    /// The controller: usb, usb:VID:PID[:SERIAL], /dev/ttyACM0[@BAUD], COM3[@BAUD]; a simulated one lives in each program anew
    #[arg(long, value_name = "DEVICE", default_value = "usb")]
    device: Address,
    /// By how much to turn the picture, in the way in which the mirror turns
    #[arg(long, value_name = "DEGREES", required_if_eq("order", "shift-phase"), value_parser = degrees, allow_negative_numbers = true)]
    degrees: Option<f64>,
    /// Print JSON
    #[arg(long)]
    json: bool,
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
    let simulated = Simulated::new(rigs::find("reference")?, 1, Clock::Simulated);
    let command = match args.order {
        Order::Start => Command::Start,
        Order::Stop => Command::Stop,
        Order::ClearFault => Command::ClearFault,
        Order::ShiftPhase => {
            let turns = args.degrees.unwrap_or_default() / 360.0;
            Command::ShiftPhase { shift: (turns * 4_294_967_296.0) as i64 as i32 }
        }
    };
    let mut way = args.device.way(&simulated)?;
    let link = way.connect().map_err(|error| Failure::at(&args.device, &error.into()))?;
    let status = order(link, command, REPORTED_WITHIN).map_err(|error| Failure::at(&args.device, &error))?;
    let Some(status) = status else {
        return Err(Failure(format!(
            "{}: it took the order and does not report: praxi doctor may say why",
            args.device
        )));
    };
    let fault = status.fault.map(|fault| format!(": {fault}")).unwrap_or_default();
    if args.json {
        say_json(&json!({ "device": args.device.to_string(), "state": status.state, "fault": status.fault }));
    } else {
        say(format!("{}: {}{fault}", args.device, status.state.name()));
    }
    Ok(())
}
