//! The host's end of the wire, without a frame store: a host may watch and command what the simulator turns.

use crate::{HOST, with_session};
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};
use firmware::controller::{Estimates, Output};
use protocol::message::{Ack, Configure, HelloReply, Message, Nack, Reason, SCHEMA, Status, VERSION};
use protocol::packet::{Counts, Decoder, Packet, encode};

/// The longest packet that means something to a controller without a frame store, before framing. Parts of planes are passed over.
const PACKET_BYTES_MAX: usize = 64;
/// No message to the host is longer on the wire: Status, the longest, has 64 bytes of payload.
const ANSWER_BYTES_MAX: usize = 96;
/// How often the controller reports, by the machine's own time.
const REPORT: Duration = Duration::from_millis(10);

/// The conversation.
#[derive(Default)]
struct Link {
    connected: bool,
    sequence: u32,
    /// The last order's: an order is carried out once, however often its packet comes.
    last_order: Option<u32>,
}

/// Answers every packet by one, and reports once a host has said hello.
#[embassy_executor::task]
pub async fn host() {
    let mut decoder = Decoder::<PACKET_BYTES_MAX>::new();
    let mut link = Link::default();
    let mut frame = [0; ANSWER_BYTES_MAX];
    let mut report_at = Instant::MIN;
    loop {
        let message = match select(HOST.read(), Timer::at(report_at)).await {
            Either::First(byte) => match decoder.next(&mut &[byte][..]) {
                Some(Ok(packet)) => Some(link.answer(&packet)),
                _ => None,
            },
            Either::Second(()) => {
                report_at = Instant::from_ticks(Instant::now().as_ticks().saturating_add(REPORT.as_ticks()));
                link.report(decoder.counts())
            }
        };
        if let Some(message) = message {
            HOST.write(link.frame(&message, &mut frame)).await;
        }
    }
}

impl Link {
    fn answer(&mut self, packet: &Packet<'_>) -> Message<'static> {
        let answers = packet.sequence;
        let done = match packet.message() {
            Ok(Message::Hello(hello)) => {
                self.connected = hello.schema == SCHEMA;
                self.last_order = None;
                return HelloReply { answers, version: VERSION, schema: SCHEMA }.into();
            }
            Ok(_) if !self.connected => Err(Reason::NotConnected),
            Ok(Message::Configure(configure)) => configured(&configure),
            Ok(Message::Control(control)) => {
                // The host sends one order at a time, so that an older number is a repeated packet.
                if self.last_order.is_none_or(|last| answers.wrapping_sub(last) as i32 > 0) {
                    self.last_order = Some(answers);
                    with_session(|session| session.command(control.command));
                }
                Ok(())
            }
            // There is no frame store.
            Ok(Message::BeginTurn(_)) => Err(Reason::Configuration),
            Ok(Message::PlaneData(_) | Message::EndTurn(_)) => Err(Reason::WrongTurn),
            Ok(_) | Err(_) => Err(Reason::NotUnderstood),
        };
        match done {
            Ok(()) => Ack { answers }.into(),
            Err(reason) => Nack { answers, reason }.into(),
        }
    }

    fn report(&self, counts: Counts) -> Option<Message<'static>> {
        let (output, estimates, rotation) = with_session(|session| session.report()).flatten()?;
        self.connected.then(|| status(&output, &estimates, rotation.slices() as f32, counts).into())
    }

    /// `message` as a packet at the start of `frame`; nothing where it does not fit, which the table of messages rules out.
    fn frame<'a>(&mut self, message: &Message<'_>, frame: &'a mut [u8]) -> &'a [u8] {
        let length = encode(self.sequence, message, frame).unwrap_or(0);
        self.sequence = self.sequence.wrapping_add(1);
        frame.get(..length).unwrap_or_default()
    }
}

/// The simulator says how a turn is cut; a host may agree.
fn configured(configure: &Configure) -> Result<(), Reason> {
    let (rotation, _) = configure.parts().map_err(|_| Reason::Configuration)?;
    let (_, _, present) = with_session(|session| session.report()).flatten().ok_or(Reason::NotConfigured)?;
    if rotation == present { Ok(()) } else { Err(Reason::Configuration) }
}

fn status(output: &Output, estimates: &Estimates, slices: f32, counts: Counts) -> Status {
    Status {
        state: output.state,
        fault: output.fault,
        phase_error: (estimates.phase_error_slices / slices * 4_294_967_296.0) as i32,
        speed_microhertz: (estimates.speed_rad_s.abs() / core::f32::consts::TAU * 1e6) as u32,
        turns_shown: 0,
        turn_on_screen: None,
        turns_received: 0,
        turns_abandoned: 0,
        packets: counts.packets,
        packets_damaged: counts.damaged(),
    }
}
