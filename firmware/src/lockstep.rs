//! What a simulator and an image in lockstep say to each other: inputs one way, what the controller makes of each the other way.
//!
//! The simulator's time is the controller's: an image that runs on a slow emulator, or waits for a day between two inputs, answers as
//! the native controller does, bit for bit. One request is under way at a time, and has one input: any answer may change light or torque,
//! and with them what happens next.
//!
//! A frame is postcard of a serial number (u8) and a request or an answer; the answer has its request's serial number. Whatever carries
//! frames keeps them apart and whole.

use crate::config::Config;
use crate::controller::{Controller, Estimates, Input, Output};
use protocol::message::Command;
use protocol::timing::Rotation;
use protocol::units::Nanos;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Counts up where requests or answers change.
pub const VERSION: u16 = 1;

/// The longest frame, bytes: a configuration has 119.
pub const FRAME_BYTES_MAX: usize = 128;

/// From the simulator.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request {
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
}

/// From the image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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
    /// An impossible configuration, or a step without one.
    Refused,
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
#[derive(Debug, Default)]
pub struct Session(Option<Running>);

#[derive(Debug)]
struct Running {
    controller: Controller,
    now: Nanos,
    output: Output,
}

impl Running {
    fn step(&mut self, now: Nanos, input: Input) -> Output {
        self.now = now;
        self.output = self.controller.step(now, input);
        self.output
    }
}

impl Session {
    /// Without a controller.
    pub const fn new() -> Self {
        Self(None)
    }

    /// Does what `request` asks.
    pub fn answer(&mut self, request: &Request, gauge: &mut impl Gauge) -> Answer {
        match (request, &mut self.0) {
            (Request::Hello, _) => Answer::Hello(VERSION),
            (Request::StackBytes, _) => Answer::StackBytes(gauge.stack_bytes()),
            (Request::Thousand, _) => Answer::Thousand(gauge.thousand()),
            (Request::Begin(config), running) => {
                let output = Output::default();
                *running = begun(config).map(|controller| Running { controller, now: Nanos::ZERO, output });
                if running.is_some() { Answer::Begun } else { Answer::Refused }
            }
            (Request::Estimates, Some(running)) => Answer::Estimates(running.controller.estimates()),
            (&Request::Step { now, input }, Some(running)) => {
                let (output, ticks) = gauge.count(|| running.step(now, input));
                Answer::Stepped { output, ticks }
            }
            (Request::Estimates | Request::Step { .. }, None) => Answer::Refused,
        }
    }

    /// An order that did not come from the simulator, carried out at the time of the last step; what follows from it shows with the
    /// next one.
    pub fn command(&mut self, command: Command) {
        if let Some(running) = &mut self.0 {
            running.step(running.now, Input::Command(command));
        }
    }

    /// What the controller does and believes, and how its turns are cut. `None` without a controller.
    pub fn report(&self) -> Option<(Output, Estimates, Rotation)> {
        let Running { controller, output, .. } = self.0.as_ref()?;
        Some((*output, controller.estimates(), controller.config().rotation))
    }
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
pub fn read<T: DeserializeOwned>(frame: &[u8]) -> Option<(u8, T)> {
    postcard::from_bytes(frame).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::tests::example;
    use protocol::timing::Direction;
    use protocol::units::Turns;

    struct NoGauge;

    impl Gauge for NoGauge {
        fn count<T>(&mut self, step: impl FnOnce() -> T) -> (T, u32) {
            (step(), 0)
        }

        fn stack_bytes(&self) -> u32 {
            0
        }

        fn thousand(&mut self) -> u32 {
            0
        }
    }

    #[test]
    fn a_session_answers_as_the_controller_does() {
        let config = example(288, 240, Direction::Clockwise);
        let (mut session, mut controller) = (Session::new(), Controller::new(config).unwrap());
        let inputs = [
            Input::Command(Command::Start),
            Input::Tick { encoder_count: 7 },
            Input::FramePulse { at: Nanos(4_000_000) },
            Input::Tick { encoder_count: 8 },
        ];
        let now = Nanos(5_000_000);
        assert_eq!(session.answer(&Request::Step { now, input: inputs[0] }, &mut NoGauge), Answer::Refused);
        assert_eq!(session.answer(&Request::Begin(config), &mut NoGauge), Answer::Begun);
        for input in inputs {
            let output = controller.step(now, input);
            let answer = session.answer(&Request::Step { now, input }, &mut NoGauge);
            assert_eq!(answer, Answer::Stepped { output, ticks: 0 });
            assert_eq!(session.report().unwrap(), (output, controller.estimates(), config.rotation));
        }
        session.command(Command::Stop);
        assert_eq!(session.report().unwrap().0.state, protocol::message::State::Idle);
    }

    #[test]
    fn a_rotation_that_cannot_be_is_refused() {
        let mut frame = [0; FRAME_BYTES_MAX];
        let mut session = Session::new();
        let config = example(288, 240, Direction::Clockwise);
        let written = write(9, &Request::Begin(config), &mut frame).unwrap().len();
        let (serial, request) = read::<Request>(&frame[..written]).unwrap();
        assert_eq!((serial, &request), (9, &Request::Begin(config)));
        // 0 slices: the second byte of postcard's 288 and the one before it.
        let mut bytes = [0; FRAME_BYTES_MAX];
        let plain = postcard::to_slice(&request, &mut bytes).unwrap();
        assert_eq!(plain[1..3], [0xa0, 0x02]);
        plain[1..3].copy_from_slice(&[0x80, 0x00]);
        let request: Request = postcard::from_bytes(plain).unwrap();
        assert_eq!(session.answer(&request, &mut NoGauge), Answer::Refused);
    }

    #[test]
    fn the_longest_messages_fit_a_frame() {
        let handle = crate::plane_store::TurnHandle(255);
        let output = Output {
            torque_nm: f32::MIN,
            light: true,
            armed: Some(crate::sequencer::Frame::Slices { turn: handle, frame: u16::MAX }),
            released: [Some(handle); 2],
            state: protocol::message::State::Fault,
            fault: Some(protocol::message::Fault::Watchdog),
        };
        let at = Nanos(u64::MAX);
        let mut config = example(288, 240, Direction::Clockwise);
        config.rotation = Rotation::new(4_080, 24, 10_000_000_000, Turns(u32::MAX), Direction::Clockwise).unwrap();
        config.sensors.encoder_counts_per_turn = u32::MAX;
        (config.motor.command_delay, config.clock.frame_latency) = (at, at);
        (config.limits.holdover, config.limits.lock, config.limits.watchdog) = (at, at, at);
        let mut frame = [0; FRAME_BYTES_MAX];
        let begin = write(255, &Request::Begin(config), &mut frame).unwrap();
        assert_eq!(begin.len(), 127);
        assert!(write(255, &Answer::Stepped { output, ticks: u32::MAX }, &mut frame).is_some());
        assert!(write(255, &Request::Step { now: at, input: Input::PlanePulse { at } }, &mut frame).is_some());
        assert_eq!(read::<Answer>(&[3, 77]), None);
    }
}
