//! The host's end of the wire, without a frame store: a host may watch and command what the simulator turns.

use crate::{HOST, SESSION};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_time::{Duration, Ticker};
use firmware::controller::{Estimates, Output};
use protocol::message::{Ack, Configure, HelloReply, Message, Nack, Reason, SCHEMA, Status, VERSION};
use protocol::packet::{Counts, Decoder, encode};

/// The longest packet that means something to a controller without a frame store, before framing. Parts of planes are passed over.
const PACKET_BYTES_MAX: usize = 64;
/// No message to the host is longer on the wire: Status, the longest, has 64 bytes of payload.
const ANSWER_BYTES_MAX: usize = 96;
/// How often the controller reports, by the machine's own time.
const REPORT: Duration = Duration::from_millis(10);

/// What both tasks share.
struct Link {
    connected: bool,
    sequence: u32,
    /// The last order's: an order is carried out once, however often its packet comes.
    last_order: Option<u32>,
    counts: Counts,
}

static LINK: Mutex<CriticalSectionRawMutex, Link> = Mutex::new(Link {
    connected: false,
    sequence: 0,
    last_order: None,
    counts: Counts { packets: 0, framing: 0, too_long: 0, too_short: 0, check: 0 },
});

/// Answers every packet by one.
#[embassy_executor::task]
pub async fn answers() {
    let mut decoder = Decoder::<PACKET_BYTES_MAX>::new();
    loop {
        let byte = HOST.read().await;
        let mut link = LINK.lock().await;
        if let Some(Ok(packet)) = decoder.next(&mut &[byte][..]) {
            let sequence = packet.sequence;
            let answer = match packet.message() {
                Ok(message) => link.answer(sequence, &message).await,
                Err(_) => Nack { answers: sequence, reason: Reason::NotUnderstood }.into(),
            };
            link.send(&answer).await;
        }
        link.counts = decoder.counts();
    }
}

/// Reports, once a host has said hello.
#[embassy_executor::task]
pub async fn reports() {
    let mut ticker = Ticker::every(REPORT);
    loop {
        ticker.next().await;
        let mut link = LINK.lock().await;
        let report = SESSION.lock().await.report();
        if let Some((output, estimates, rotation)) = report.filter(|_| link.connected) {
            let status = status(&output, &estimates, rotation.slices() as f32, link.counts);
            link.send(&status.into()).await;
        }
    }
}

impl Link {
    async fn answer(&mut self, sequence: u32, message: &Message<'_>) -> Message<'static> {
        let done = match message {
            Message::Hello(hello) => {
                self.connected = hello.schema == SCHEMA;
                self.last_order = None;
                return HelloReply { answers: sequence, version: VERSION, schema: SCHEMA }.into();
            }
            _ if !self.connected => Err(Reason::NotConnected),
            Message::Configure(configure) => configured(configure).await,
            Message::Control(control) => {
                // The host sends one order at a time, so that an older number is a repeated packet.
                if self.last_order.is_none_or(|last| sequence.wrapping_sub(last) as i32 > 0) {
                    self.last_order = Some(sequence);
                    SESSION.lock().await.command(control.command);
                }
                Ok(())
            }
            // There is no frame store.
            Message::BeginTurn(_) => Err(Reason::Configuration),
            Message::PlaneData(_) | Message::EndTurn(_) => Err(Reason::WrongTurn),
            _ => Err(Reason::NotUnderstood),
        };
        match done {
            Ok(()) => Ack { answers: sequence }.into(),
            Err(reason) => Nack { answers: sequence, reason }.into(),
        }
    }

    async fn send(&mut self, message: &Message<'_>) {
        let mut frame = [0; ANSWER_BYTES_MAX];
        let length = encode(self.sequence, message, &mut frame);
        if let Some(bytes) = length.ok().and_then(|length| frame.get(..length)) {
            self.sequence = self.sequence.wrapping_add(1);
            HOST.write(bytes).await;
        }
    }
}

/// The simulator says how a turn is cut; a host may agree.
async fn configured(configure: &Configure) -> Result<(), Reason> {
    let (rotation, _) = configure.parts().map_err(|_| Reason::Configuration)?;
    let present = SESSION.lock().await.report().ok_or(Reason::NotConfigured)?.2;
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
