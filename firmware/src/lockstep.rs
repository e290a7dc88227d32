//! What a simulator and an image in lockstep say to each other: inputs one way, what the controller makes of each the other way.
//!
//! The simulator's time is the controller's: an image that runs on a slow emulator, or waits for a day between two inputs, answers as
//! the native controller does, bit for bit. One request is under way at a time, and has one input: any answer may change light or torque,
//! and with them what happens next. What the host says travels the same way, so that it arrives at a time that is the same in every run.
//!
//! A frame is postcard of a serial number (u8) and a request or an answer; the answer has its request's serial number. Whatever carries
//! frames keeps them apart and whole.

use crate::config::Config;
use crate::controller::{Controller, Estimates, Input, Output};
use crate::conversation::ANSWER_BYTES_MAX;
use crate::frame_store::{FrameStore, Memory};
use crate::hosted::Hosted;
use crate::plane_store::TurnHandle;
use crate::wire_end::{Packet, WireEnd};
use heapless::Vec;
use protocol::codec::plane_check;
use protocol::message::Faults;
use protocol::timing::Rotation;
use protocol::units::Nanos;
use serde::{Deserialize, Serialize};

/// Counts up where requests or answers change.
pub const VERSION: u16 = 6;

/// The most bytes of the host in one request.
pub const HOST_BYTES_MAX: usize = 512;

/// The longest frame, bytes: what is around those of the host has 16.
pub const FRAME_BYTES_MAX: usize = HOST_BYTES_MAX + 16;

/// What the host is told at once: a status and its faults at most.
pub type Said = Vec<u8, { 2 * ANSWER_BYTES_MAX }>;

/// From the simulator.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request<'a> {
    /// Who is there? Keeps its place in later versions, so that any two of them can name both.
    Hello,
    /// A new controller.
    Begin(Config),
    /// A step.
    Step {
        /// The controller's time.
        now: Nanos,
        /// What happens.
        input: Input,
    },
    /// What the controller believes.
    Estimates,
    /// How deep the stack has been.
    StackBytes,
    /// How long is a thousand instructions?
    Thousand,
    /// The host has said this, which is read to the end of the first packet.
    Host {
        /// The controller's time.
        now: Nanos,
        /// At most [`HOST_BYTES_MAX`].
        bytes: &'a [u8],
    },
    /// It is time to tell the host how the controller does.
    Report,
    /// What lies in the frame store?
    Plane {
        /// The slot.
        turn: TurnHandle,
        /// The slice.
        slice: u16,
    },
    /// Faults so far.
    Faults,
}

/// From the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Answer {
    /// The image's [`VERSION`].
    Hello(u16),
    /// The controller is new.
    Begun,
    /// What a step came to.
    Stepped {
        /// The controller's answer.
        output: Output,
        /// How long the step took, ticks of the machine's counter; 0 where nothing counts.
        ticks: u32,
    },
    /// What the controller believes.
    Estimates(Estimates),
    /// The deepest that the stack has been, bytes.
    StackBytes(u32),
    /// Ticks of the machine's counter.
    Thousand(u32),
    /// An impossible configuration, or anything that needs a controller without one.
    Refused,
    /// What the host's bytes came to.
    Heard {
        /// How many of them were read.
        taken: u16,
        /// What the host is told.
        said: Said,
        /// What the controller answered, if it was asked.
        output: Option<Output>,
        /// How long it took, as for a step.
        ticks: u32,
    },
    /// What the host is told, if it has said hello.
    Said(Said),
    /// [`plane_check`] of what lies in the store now; nothing where the turn is not whole.
    Plane(Option<u64>),
    /// As a host is told of them.
    Faults(Faults),
}

/// What the machine measures around a controller.
pub trait Gauge {
    /// What `step` returns, and how many ticks it took.
    fn count<T>(&mut self, step: impl FnOnce() -> T) -> (T, u32);

    /// The deepest that the stack has been, bytes.
    fn stack_bytes(&self) -> u32;

    /// How many ticks a thousand instructions take.
    fn thousand(&mut self) -> u32;
}

/// The image's end.
#[derive(Debug)]
pub struct Session<M> {
    wire: WireEnd<FrameStore<M>>,
    running: Option<Running>,
}

#[derive(Debug)]
struct Running {
    hosted: Hosted,
    now: Nanos,
}

impl<M: Memory + Default> Session<M> {
    /// Without a controller; planes go to `memory`.
    pub const fn new(memory: M) -> Self {
        Self { wire: WireEnd::new(FrameStore::over(memory)), running: None }
    }

    /// Does what `request` asks.
    pub fn answer(&mut self, request: &Request<'_>, gauge: &mut impl Gauge) -> Answer {
        match (request, &mut self.running) {
            (Request::Hello, _) => Answer::Hello(VERSION),
            (Request::StackBytes, _) => Answer::StackBytes(gauge.stack_bytes()),
            (Request::Thousand, _) => Answer::Thousand(gauge.thousand()),
            (Request::Begin(config), _) => self.begin(config),
            (Request::Estimates, Some(running)) => Answer::Estimates(running.hosted.controller().estimates()),
            (&Request::Step { now, input }, Some(running)) => {
                running.now = now;
                let (output, ticks) = gauge.count(|| running.hosted.step(now, input));
                self.release(&output);
                Answer::Stepped { output, ticks }
            }
            (&Request::Host { now, bytes }, Some(running)) => {
                running.now = now;
                let mut left = bytes;
                let (heard, ticks) = gauge.count(|| self.hear(&mut left));
                let (said, output) = heard.unwrap_or_default();
                Answer::Heard {
                    taken: bytes.len().saturating_sub(left.len()) as u16,
                    said: said_by([Some(said), None]),
                    output,
                    ticks,
                }
            }
            (Request::Report, Some(_)) => Answer::Said(self.report()),
            (&Request::Plane { turn, slice }, Some(_)) => {
                let plane = self.wire.conversation.store().plane(turn, slice);
                Answer::Plane(plane.map(|plane| plane_check(plane.bytes())))
            }
            (Request::Faults, Some(running)) => Answer::Faults(running.hosted.faults().faults()),
            (_, None) => Answer::Refused,
        }
    }

    /// The host has said this at the time of the last step: see [`WireEnd::hear`]. Without a controller nobody listens.
    pub fn hear(&mut self, bytes: &mut &[u8]) -> Option<(Packet, Option<Output>)> {
        let running = self.running.as_mut()?;
        let (said, request) = self.wire.hear(bytes)?;
        let output = request.and_then(|request| running.hosted.request(running.now, request));
        if let Some(output) = &output {
            self.release(output);
        }
        Some((said, output))
    }

    /// What the host is told of the controller now; nothing where nobody has said hello.
    pub fn report(&mut self) -> Said {
        let Some(Running { hosted, .. }) = &self.running else { return Said::new() };
        said_by([self.wire.status(&hosted.report()), self.wire.faults(hosted.faults().faults())])
    }

    /// A new controller, and a new end of the wire.
    fn begin(&mut self, config: &Config) -> Answer {
        self.wire = WireEnd::new(FrameStore::over(M::default()));
        let hosted = begun(config).map(|controller| Hosted::new(controller, |_| None));
        self.running = hosted.map(|hosted| Running { hosted, now: Nanos::ZERO });
        if self.running.is_some() { Answer::Begun } else { Answer::Refused }
    }

    fn release(&mut self, output: &Output) {
        output.released.into_iter().flatten().for_each(|turn| self.wire.conversation.release(turn));
    }
}

/// One after the other.
fn said_by(packets: [Option<Packet>; 2]) -> Said {
    let mut said = Said::new();
    for packet in packets.into_iter().flatten() {
        // There is room for both.
        let _ = said.extend_from_slice(&packet);
    }
    said
}

/// Bytes came over a wire: a rotation may be one that nobody could have made.
fn begun(config: &Config) -> Option<Controller> {
    let told = &config.rotation;
    let (slices, planes) = (told.slices(), told.planes_per_frame());
    let rotation =
        Rotation::new(slices, planes, told.refresh_microhertz(), told.phase_offset(), told.direction()).ok()?;
    Controller::new(Config { rotation, ..*config }).ok()
}

/// `message` as a frame at the start of `frame`; `None` where it does not fit, which [`FRAME_BYTES_MAX`] bytes rule out.
pub fn write<'a>(serial: u8, message: &impl Serialize, frame: &'a mut [u8]) -> Option<&'a [u8]> {
    postcard::to_slice(&(serial, message), frame).ok().map(|bytes| &*bytes)
}

/// The serial number and the message in `frame`. `None` where it is no such message.
pub fn read<'a, T: Deserialize<'a>>(frame: &'a [u8]) -> Option<(u8, T)> {
    postcard::from_bytes(frame).ok()
}

#[cfg(test)]
#[path = "lockstep_tests.rs"]
mod tests;
