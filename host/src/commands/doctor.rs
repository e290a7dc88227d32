//! `praxi doctor`: whether a device can be talked to, how well, and what to do where it cannot.

use super::args::{busy, seed};
use super::devices::usb_devices;
use super::{Failure, hanging, say, say_json};
use crate::doctor::{Carrier, Finding, Verdict, examine};
use crate::link::LinkError;
use crate::link::address::Address;
use crate::link::sim::{Clock, Simulated};
use crate::link::usb::NO_USB;
use crate::rigs;
use protocol::rig::Rig;
use serde_json::json;

/// Check the way to a device step by step, and say what to do where something is wrong
#[derive(clap::Args)]
#[command(after_help = "Example: praxi doctor --device /dev/ttyUSB0@3000000\n\n\
    A display that runs is not disturbed; one at rest gives up turns of another rig. The simulated devices' times are those of the simulation.")]
pub(super) struct Args {
    /// usb, usb:VID:PID[:SERIAL], /dev/ttyACM0[@BAUD], COM3[@BAUD], sim, sim:usb, sim:serial[@BAUD]; praxi devices lists what is there
    #[arg(long, default_value = "usb")]
    device: Address,
    /// Whose turns the link is measured for: a rig file, or reference, reference-180hz, high-viewer, tent
    #[arg(long, default_value = "reference")]
    rig: String,
    /// All noise of a simulated device follows from it
    #[arg(long, value_parser = seed, allow_negative_numbers = true, default_value_t = 1)]
    seed: u64,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rig = rigs::find(&args.rig)?;
    let mut findings = Vec::new();
    let busy = busy("asking");
    examined(args, &rig, &mut |finding| {
        if !args.json {
            busy.aside(|| say(as_text(&finding)));
        }
        findings.push(finding);
    });
    drop(busy);
    if args.json {
        let findings: Vec<_> = findings
            .iter()
            .map(|Finding { check, verdict, text, remedy, figures }| {
                json!({ "check": check, "verdict": verdict.name(), "text": text, "remedy": remedy, "figures": figures })
            })
            .collect();
        say_json(&json!({ "device": args.device.to_string(), "findings": findings }));
    }
    let failed: Vec<_> = findings.iter().filter(|finding| finding.verdict == Verdict::Failed).collect();
    match failed[..] {
        [] => Ok(()),
        [first, ..] => {
            let remedy = first.remedy.as_ref().map(|remedy| format!(": {remedy}")).unwrap_or_default();
            Err(Failure(format!("{}: {}: {}{remedy}", args.device, first.check, first.text)))
        }
    }
}

/// Tells each finding as soon as it is one.
fn examined(args: &Args, rig: &Rig, tell: &mut dyn FnMut(Finding)) {
    let usb = usb(&args.device);
    let has_none = usb.verdict == Verdict::Failed;
    tell(usb);
    if has_none {
        return;
    }
    let simulated = Simulated::new(rig.clone(), args.seed, Clock::Simulated);
    let link = args.device.way(&simulated).and_then(|mut way| way.connect());
    reached(&args.device, link.as_ref().err()).into_iter().for_each(&mut *tell);
    if let Ok(mut link) = link {
        let carrier = if matches!(args.device, Address::Usb(_)) { Carrier::Usb } else { Carrier::Other };
        examine(&mut *link, carrier, rig, tell);
    }
}

fn as_text(finding: &Finding) -> String {
    let text = hanging(&format!("{:<9}{:<13}", finding.verdict.name(), finding.check), &finding.text);
    let remedy = finding.remedy.as_ref().map(|remedy| format!("\n{}", hanging(&format!("{:22}-> ", ""), remedy)));
    text + &remedy.unwrap_or_default()
}

/// Whether there is USB, for a device that needs it.
fn usb(device: &Address) -> Finding {
    let check = "USB";
    match (device, usb_devices()) {
        (Address::Usb(_), None) => {
            let [cause, remedy] = NO_USB;
            Finding::new(check, Verdict::Failed, cause).and_do(remedy)
        }
        (Address::Usb(_), Some(count)) => Finding::new(check, Verdict::Ok, format!("{count} device(s) of any kind")),
        _ => Finding::new(check, Verdict::Skipped, format!("{device} needs none")),
    }
}

/// What came of opening `device`: whether it is there, ours to open, and free.
fn reached(device: &Address, error: Option<&LinkError>) -> Vec<Finding> {
    let what = match device {
        Address::Usb(_) => "is there".into(),
        Address::Serial(port) => format!("is a serial port, at {} baud", port.baud),
        Address::Sim(_) => "is a simulated controller, in simulated time".into(),
    };
    let ok = |check, text: &str| Finding::new(check, Verdict::Ok, text);
    let failed = |check, text: String| Finding::new(check, Verdict::Failed, text);
    let there = ok("device", &format!("{device} {what}"));
    let permitted = ok("permissions", "this user may open it");
    match error {
        None => vec![there, permitted, ok("opens", "yes")],
        Some(LinkError::Absent { remedy, .. }) => vec![failed("device", "is not there".into()).and_do(remedy)],
        Some(LinkError::Other { what, remedy, .. }) => vec![failed("device", format!("is {what}")).and_do(remedy)],
        Some(LinkError::Several { found, .. }) => {
            let remedy = format!("name one of {}", found.join(", "));
            vec![failed("device", "is more than one".into()).and_do(remedy)]
        }
        Some(LinkError::Forbidden { remedy, .. }) => {
            vec![there, failed("permissions", "this user may not open it".into()).and_do(remedy)]
        }
        Some(LinkError::InUse { .. }) => {
            let busy = failed("opens", "another program has it open".into()).and_do("end that program");
            vec![there, permitted, busy]
        }
        Some(error) => {
            vec![there, permitted, failed("opens", error.to_string()).and_do("plug it in again, or try another port")]
        }
    }
}
