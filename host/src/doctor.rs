//! What is right and wrong with a way to a device, check by check, and what to do about it.

use crate::link::Link;
use crate::stream::StreamError;
use loopback::Loopback;
use probe::{Answer, Probe};
use protocol::message::{Fault, Faults, Hello, SCHEMA, State, Status, VERSION};
use protocol::rig::Rig;
use serde_json::{Value, json};
use std::time::Duration;

mod loopback;
mod probe;

/// Exchanges whose time is taken.
const EXCHANGES: usize = 50;
/// More of them are not waited for in vain.
const LOST_MAX: usize = 3;
/// How long a device that was greeted may say nothing of itself: it does a hundred times a second.
const STATUS_WITHIN: Duration = Duration::from_secs(2);
/// A device at USB that is slower than this is at full speed, 12 Mbit/s: it, its cable or a hub has no high speed.
const USB_HIGH_SPEED: f64 = 10e6;
/// How much smaller turns become on the wire: README, "On the wire": the bunny at 2 degrees a turn by blue noise and by the optimised diffusion.
const RATIOS: [(&str, f64); 2] = [("blue noise", 22.5), ("error diffusion", 10.3)];

/// How a check ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// As it should be.
    Ok,
    /// It works, and not as well as it could.
    Warning,
    /// It does not work.
    Failed,
    /// Not checked, for the reason given.
    Skipped,
}

impl Verdict {
    /// In one word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Warning => "warning",
            Self::Failed => "failed",
            Self::Skipped => "skipped",
        }
    }
}

/// What a check found.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// What was checked.
    pub check: &'static str,
    /// How it ended.
    pub verdict: Verdict,
    /// What there is, in words.
    pub text: String,
    /// What to do, where there is something.
    pub remedy: Option<String>,
    /// The same in numbers.
    pub figures: Value,
}

impl Finding {
    /// Without numbers and with nothing to do.
    pub fn new(check: &'static str, verdict: Verdict, text: impl Into<String>) -> Self {
        Self { check, verdict, text: text.into(), remedy: None, figures: Value::Null }
    }

    /// With what to do.
    pub fn and_do(self, remedy: impl Into<String>) -> Self {
        Self { remedy: Some(remedy.into()), ..self }
    }

    fn with(self, figures: Value) -> Self {
        Self { figures, ..self }
    }
}

/// Whether bytes come over USB itself, where a low speed is somebody's fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carrier {
    /// They do.
    Usb,
    /// Over something else.
    Other,
}

/// Checks what an open link leads to, for turns of `rig`, and tells each finding as soon as it is one. A display that runs is not disturbed;
/// one at rest gives up turns of another rig.
pub fn examine(link: &mut dyn Link, carrier: Carrier, rig: &Rig, tell: &mut dyn FnMut(Finding)) {
    if let Err(error) = try_to_examine(link, carrier, rig, tell) {
        let why = match error {
            // What the message adds is to ask a doctor.
            StreamError::NoAnswer { message, .. } => format!("{message} was not answered"),
            error => error.to_string(),
        };
        let text = format!("the conversation broke off: {why}");
        let remedy = "see that nothing else talks to it, switch the controller off and on, and try again";
        tell(Finding::new("answers", Verdict::Failed, text).and_do(remedy));
    }
}

fn try_to_examine(
    link: &mut dyn Link,
    carrier: Carrier,
    rig: &Rig,
    tell: &mut dyn FnMut(Finding),
) -> Result<(), StreamError> {
    let mut probe = Probe::new(link)?;
    let protocol = protocol(&mut probe, carrier)?;
    let is_ours = protocol.verdict == Verdict::Ok;
    tell(protocol);
    if !is_ours {
        return Ok(());
    }
    let until = probe.now() + STATUS_WITHIN;
    while (probe.status().is_none() || probe.faults().is_none()) && probe.now() < until {
        probe.listen(until - probe.now())?;
    }
    tell(firmware(probe.status(), probe.faults()));
    tell(speed(probe.bytes_per_second(), carrier));
    tell(round_trip(&mut probe)?);
    let outcome = loopback::run(&mut probe, rig)?;
    // What it left unfinished goes with the next turn that somebody begins.
    probe.ask(HELLO)?;
    let measured = match outcome {
        Loopback::Whole { bytes, seconds, .. } if seconds > 0.0 => Some(bytes as f64 / seconds),
        _ => None,
    };
    tell(loopback(outcome));
    tell(turns(measured.or(probe.bytes_per_second()), measured.is_some(), rig));
    Ok(())
}

const HELLO: Hello = Hello { version: VERSION, schema: SCHEMA };

/// How the same release comes to both ends.
fn same_release(carrier: Carrier) -> &'static str {
    match carrier {
        Carrier::Usb => "install the same release on both: praxi flash IMAGE --device usb",
        Carrier::Other => {
            "install the same release on both: firmware goes over the controller's USB (praxi flash IMAGE --device usb) or a debug probe, not over \
             this line"
        }
    }
}

fn protocol(probe: &mut Probe<'_>, carrier: Carrier) -> Result<Finding, StreamError> {
    const ATTEMPTS: usize = 3;
    let mut answer = probe.ask(HELLO);
    for _ in 1..ATTEMPTS {
        if !matches!(answer, Err(StreamError::NoAnswer { .. })) {
            break;
        }
        answer = probe.ask(HELLO);
    }
    let check = "protocol";
    Ok(match answer {
        Ok(Answer::Hello { version, schema }) if schema == SCHEMA => {
            let text = format!("version {version}, schema {schema:#018x}, here and there");
            Finding::new(check, Verdict::Ok, text)
                .with(json!({ "version": version, "schema": format!("{schema:#018x}") }))
        }
        Ok(Answer::Hello { version, schema }) => {
            let text = format!(
                "the device speaks version {version}, schema {schema:#018x}; this program version {VERSION}, schema {SCHEMA:#018x}"
            );
            Finding::new(check, Verdict::Failed, text).and_do(same_release(carrier))
        }
        Ok(answer) => Finding::new(check, Verdict::Failed, format!("the device answered a hello with {answer:?}")),
        Err(StreamError::NoAnswer { .. }) => Finding::new(check, Verdict::Failed, "the device does not answer a hello")
            .and_do("see that it is a controller, that it is switched on, and that the baud rate is its own"),
        Err(error) => return Err(error),
    })
}

fn firmware(status: Option<&Status>, faults: Option<&Faults>) -> Finding {
    let check = "firmware";
    let Some(status) = status else {
        return Finding::new(check, Verdict::Warning, "it answers, and says nothing of itself")
            .and_do("switch the controller off and on");
    };
    let speed = f64::from(status.speed_microhertz) * 1e-6;
    let screen = if status.turn_on_screen.is_some() { "a turn" } else { "no turn" };
    let Status { turns_received, turns_shown, .. } = status;
    let remembered: u32 =
        faults.map_or(0, |faults| Fault::ALL.iter().map(|fault| u32::from(faults.count(*fault))).sum());
    let mut text = format!(
        "{:?}, {speed:.2} turns/s, {screen} on screen; since it was switched on {turns_received} turn(s) came whole and {turns_shown} \
                 were shown; {remembered} fault(s) remembered",
        status.state
    );
    let figures = json!({
        "state": status.state, "turns_per_second": speed, "turn_on_screen": status.turn_on_screen,
        "turns_received": turns_received, "turns_shown": turns_shown, "faults": remembered, "packets": status.packets, "packets_damaged": status.packets_damaged,
    });
    if status.state == State::Fault || status.fault.is_some() {
        let fault = status.fault.map_or("no cause given".into(), |fault| fault.to_string());
        let cause = faults.map(|faults| faults.cause().to_string()).filter(|cause| !cause.is_empty());
        text = format!("stopped: {fault}{}; {text}", cause.map(|cause| format!(" ({cause})")).unwrap_or_default());
        let remedy = "remove the cause, then switch the controller off and on: a person must look at it";
        return Finding::new(check, Verdict::Failed, text).and_do(remedy).with(figures);
    }
    Finding::new(check, Verdict::Ok, text).with(figures)
}

/// Bytes for people.
fn amount(bytes: f64) -> String {
    if bytes >= 1e6 { format!("{:.1} MB", bytes / 1e6) } else { format!("{:.1} kB", bytes / 1e3) }
}

fn speed(bytes_per_second: Option<f64>, carrier: Carrier) -> Finding {
    let check = "link speed";
    let Some(bytes_per_second) = bytes_per_second else {
        return Finding::new(check, Verdict::Ok, "nothing limits it");
    };
    let figures = json!({ "bytes_per_second": bytes_per_second });
    let text = format!("{}/s at most", amount(bytes_per_second));
    if carrier == Carrier::Usb && bytes_per_second < USB_HIGH_SPEED {
        return Finding::new(check, Verdict::Warning, format!("{text}: USB full speed"))
            .and_do("take another cable or port, without a hub: the controller is made for high speed")
            .with(figures);
    }
    Finding::new(check, Verdict::Ok, text).with(figures)
}

fn round_trip(probe: &mut Probe<'_>) -> Result<Finding, StreamError> {
    let (mut times_us, mut lost) = (Vec::with_capacity(EXCHANGES), 0);
    while times_us.len() + lost < EXCHANGES && lost < LOST_MAX {
        let asked = probe.send(HELLO)?;
        match probe.answer(asked, asked.bytes) {
            Ok((_, at)) => times_us.push((at - asked.at).as_micros() as u64),
            Err(StreamError::NoAnswer { .. }) => lost += 1,
            Err(error) => return Err(error),
        }
    }
    times_us.sort_unstable();
    let check = "round trip";
    let (Some(&median), Some(&p99)) = (times_us.get(times_us.len() / 2), times_us.get(times_us.len() * 99 / 100))
    else {
        return Ok(
            Finding::new(check, Verdict::Failed, "no answer came back").and_do("switch the controller off and on")
        );
    };
    let text = format!("{median} us median, {p99} us 99th percentile of {} exchanges", times_us.len());
    let figures = json!({ "median_us": median, "p99_us": p99, "exchanges": times_us.len(), "lost": lost });
    if lost > 0 {
        return Ok(Finding::new(check, Verdict::Warning, format!("{text}; {lost} were not answered"))
            .and_do("the line damages bytes: a shorter cable, another port, a lower baud rate")
            .with(figures));
    }
    Ok(Finding::new(check, Verdict::Ok, text).with(figures))
}

fn loopback(outcome: Loopback) -> Finding {
    let check = "loopback";
    match outcome {
        Loopback::Whole { planes, bytes, seconds } => {
            let speed = if seconds > 0.0 { format!(" at {}/s", amount(bytes as f64 / seconds)) } else { String::new() };
            let text = format!(
                "{planes} planes, {}{speed}, expanded to the last bit; a wrong plane and a wrong turn refused; nothing shown",
                amount(bytes as f64)
            );
            let figures = json!({ "planes": planes, "bytes": bytes, "seconds": seconds });
            Finding::new(check, Verdict::Ok, text).with(figures)
        }
        Loopback::Skipped(why) => Finding::new(check, Verdict::Skipped, why),
        Loopback::Wrong(what) => Finding::new(check, Verdict::Failed, what)
            .and_do("install the same release on both; if it is, this is a fault of the controller's"),
    }
}

/// What the link makes of turns of `rig`.
fn turns(bytes_per_second: Option<f64>, is_measured: bool, rig: &Rig) -> Finding {
    let check = "turns";
    let wanted = rig.turns_per_second();
    let Some(bytes_per_second) = bytes_per_second else {
        return Finding::new(check, Verdict::Ok, format!("all; rig {} shows {wanted:.1}/s", rig.name));
    };
    let projector = &rig.projector;
    let turn_bytes =
        f64::from(rig.rotation.slices) * f64::from(projector.height_px) * f64::from(projector.width_px.div_ceil(8));
    let allowed = RATIOS.map(|(halftone, ratio)| (halftone, bytes_per_second * ratio / turn_bytes));
    let often = |turns: f64| if turns < 1.0 { format!("one in {:.0} s", 1.0 / turns) } else { format!("{turns:.1}/s") };
    let each = allowed.map(|(halftone, turns)| format!("{halftone} {}", often(turns))).join(", ");
    let how = if is_measured { "measured" } else { "nominal" };
    let text = format!("{each} ({how}); rig {} shows {wanted:.1}/s", rig.name);
    let figures = json!({
        "bytes_per_second": bytes_per_second, "measured": is_measured, "rig": wanted,
        "turns_per_second": allowed.iter().map(|(halftone, turns)| (halftone.replace(' ', "_"), json!(turns))).collect::<serde_json::Map<_, _>>(),
    });
    match allowed[0].1 >= wanted {
        true => Finding::new(check, Verdict::Ok, text).with(figures),
        false => Finding::new(check, Verdict::Warning, text)
            .and_do("each turn stands for several rotations: a faster link shows motion more smoothly")
            .with(figures),
    }
}

#[cfg(test)]
mod tests;
