//! `praxi devices`: what there is to talk to.

use super::{Failure, hanging, say, say_json};
use crate::link::address::Address;
use crate::link::serial::{BAUD, ports};
use crate::link::sim::Cable;
use crate::link::usb::{Found, NO_USB, list};
use rusb::{Context, UsbContext};
use serde_json::{Value, json};

/// List the controllers and ports that --device takes
#[derive(clap::Args)]
#[command(after_help = "Example: praxi devices --json")]
pub(super) struct Args {
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// How many devices of any kind are at this machine's USB; nothing where it has none, or none that this user may ask.
pub(super) fn usb_devices() -> Option<usize> {
    Context::new().and_then(|context| context.devices()).ok().map(|devices| devices.len())
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let (at_usb, found, ports) = (usb_devices(), list(), ports());
    let simulated = [Cable::None, Cable::Usb, Cable::Serial(BAUD)].map(|cable| Address::Sim(cable).to_string());
    if args.json {
        let devices: Vec<_> = found.iter().map(as_json).collect();
        let usb = json!({ "present": at_usb.is_some(), "devices": devices });
        say_json(&json!({ "usb": usb, "serial": ports, "simulated": simulated }));
        return Ok(());
    }
    let mut lines: Vec<_> = found.iter().map(|found| format!("{}  {}", found.name, about(found))).collect();
    if lines.is_empty() {
        lines.push(match at_usb {
            None => NO_USB[0].into(),
            Some(count) => format!("no controller among {count} device(s): plug it in and switch it on"),
        });
    }
    let serial = if ports.is_empty() { "no port".into() } else { ports.join("\n") };
    let heads = [("USB", lines.join("\n")), ("serial", serial), ("simulated", simulated.join(", "))];
    let mut text = Vec::new();
    for (head, lines) in &heads {
        for (number, line) in lines.lines().enumerate() {
            text.push(hanging(&format!("{:<11}", if number == 0 { head } else { "" }), line));
        }
    }
    say(text.join("\n"));
    Ok(())
}

fn role(found: &Found) -> &'static str {
    if found.endpoints.is_some() { "controller" } else { "loader" }
}

fn about(found: &Found) -> String {
    let product = found.product.as_deref().unwrap_or("a controller");
    match (&found.trouble, found.endpoints) {
        (Some(trouble), _) => trouble.to_string(),
        (None, None) => format!("{product}: waits for firmware: praxi flash IMAGE --device {}", found.name),
        (None, Some(_)) => {
            let speed = found.bytes_per_second.map(|rate| format!(", {:.1} MB/s at most", rate / 1e6));
            format!("{product}{}", speed.unwrap_or_default())
        }
    }
}

fn as_json(found: &Found) -> Value {
    json!({
        "name": found.name, "product": found.product, "role": role(found), "bytes_per_second": found.bytes_per_second,
        "trouble": found.trouble.as_ref().map(ToString::to_string),
    })
}
