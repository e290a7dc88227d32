use super::*;
use crate::config::tests::example;
use crate::follower::Trigger;
use crate::safety::Levels;
use protocol::codec::{Codebook, ImageSize, turn_check};
use protocol::message::{BeginTurn, Command, Configure, Control, EndTurn, Hello, Message, PlaneData, SCHEMA};
use protocol::packet::{Decoder, encode};
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

/// Room for two turns of 24 slices of 8 x 8 pixels.
#[derive(Debug)]
struct Small([u8; 1_024], Codebook);

impl Default for Small {
    fn default() -> Self {
        Self([7; 1_024], Codebook::EMPTY)
    }
}

impl Memory for Small {
    fn make_room(&mut self, bytes: usize) -> bool {
        bytes <= self.0.len()
    }

    fn bytes(&self) -> &[u8] {
        &self.0
    }

    fn parts(&mut self) -> (&mut [u8], &mut Codebook) {
        (&mut self.0, &mut self.1)
    }
}

fn session() -> Session<Small> {
    Session::new(Small::default())
}

/// What the image makes of a packet at `now`: its answer in words, and the controller's.
fn ask<'a>(
    session: &mut Session<Small>,
    now: Nanos,
    sequence: u32,
    message: impl Into<Message<'a>>,
) -> (bool, Option<Output>) {
    let mut frame = [0; HOST_BYTES_MAX];
    let length = encode(sequence, &message.into(), &mut frame).unwrap();
    // What follows a packet is left.
    frame[length] = 9;
    let answer = session.answer(&Request::Host { now, bytes: &frame[..length + 1] }, &mut NoGauge);
    let Answer::Heard { taken, said, output, .. } = answer else { panic!("{answer:?}") };
    assert_eq!(usize::from(taken), length);
    let mut decoder = Decoder::<ANSWER_BYTES_MAX>::new();
    let packet = decoder.next(&mut &said[..]).unwrap().unwrap();
    (!matches!(packet.message(), Ok(Message::Nack(_))), output)
}

#[test]
fn a_session_answers_as_the_controller_does() {
    let config = example(288, 240, Direction::Clockwise);
    let (mut session, mut controller) = (session(), Controller::new(config).unwrap());
    let inputs = [
        Input::Command(Command::Start),
        Input::Tick { encoder_count: 7 },
        Input::FramePulse { at: Nanos(4_000_000) },
        Input::Tick { encoder_count: 8 },
    ];
    let now = Nanos(5_000_000);
    assert_eq!(session.answer(&Request::Step { now, input: inputs[0] }, &mut NoGauge), Answer::Refused);
    assert_eq!(session.answer(&Request::Host { now, bytes: &[1, 0] }, &mut NoGauge), Answer::Refused);
    assert_eq!(session.answer(&Request::Begin(config), &mut NoGauge), Answer::Begun);
    for input in inputs {
        let output = controller.step(now, input);
        let answer = session.answer(&Request::Step { now, input }, &mut NoGauge);
        assert_eq!(answer, Answer::Stepped { output, ticks: 0 });
        let estimates = session.answer(&Request::Estimates, &mut NoGauge);
        assert_eq!(estimates, Answer::Estimates(controller.estimates()));
    }
    let stop = Input::Levels(Levels { emergency_stop: true, guard_open: false });
    session.answer(&Request::Step { now, input: stop }, &mut NoGauge);
    controller.step(now, stop);
    let faults = session.answer(&Request::Faults, &mut NoGauge);
    assert_eq!(faults, Answer::Faults(controller.faults().faults()));
    assert_ne!(controller.faults().latched(), None);
}

#[test]
fn a_host_is_answered_and_its_orders_are_steps() {
    let config = example(24, 240, Direction::Clockwise);
    let (mut session, mut controller) = (session(), Controller::new(config).unwrap());
    session.answer(&Request::Begin(config), &mut NoGauge);
    let (now, size) = (Nanos(8_000), ImageSize::new(8, 8).unwrap());
    let start = Control { command: Command::Start };
    assert_eq!(session.answer(&Request::Report, &mut NoGauge), Answer::Said(Said::new()), "nobody is there");
    assert_eq!(ask(&mut session, now, 1, start), (false, None));
    assert_eq!(ask(&mut session, now, 2, Hello { version: 9, schema: SCHEMA }), (true, None));
    assert_eq!(ask(&mut session, now, 3, Configure::new(&config.rotation, size)), (true, None));
    let output = controller.step(now, Input::Command(Command::Start));
    assert_eq!(ask(&mut session, now, 4, start), (true, Some(output)));
    assert!(matches!(session.answer(&Request::Report, &mut NoGauge), Answer::Said(said) if said.len() > 40));
    // A turn of planes that are lit all over: eight times 0xff.
    let (check, turn) = (plane_check(&[0xff; 8]), TurnHandle(0));
    assert_eq!(ask(&mut session, now, 5, BeginTurn { turn: 7, slices: 24 }), (true, None));
    for slice in 0..24 {
        let part = PlaneData { turn: 7, slice, offset: 0, total: 3, check, bytes: &[0, 0x87, 0xff] };
        assert_eq!(ask(&mut session, now, 6, part), (true, None));
    }
    assert_eq!(session.answer(&Request::Plane { turn, slice: 3 }, &mut NoGauge), Answer::Plane(None));
    let output = controller.step(now, Input::TurnReady(turn));
    let end = EndTurn { turn: 7, check: turn_check(7, [check; 24]) };
    assert_eq!(ask(&mut session, now, 7, end), (true, Some(output)));
    assert_eq!(session.answer(&Request::Plane { turn, slice: 3 }, &mut NoGauge), Answer::Plane(Some(check)));
    // Whoever begins again has another wire.
    session.answer(&Request::Begin(config), &mut NoGauge);
    assert_eq!(ask(&mut session, now, 8, start), (false, None));
}

#[test]
fn a_rotation_that_cannot_be_is_refused() {
    let mut frame = [0; FRAME_BYTES_MAX];
    let mut session = session();
    let config = example(288, 240, Direction::Clockwise);
    let written = write(9, &Request::Begin(config), &mut frame).unwrap().len();
    let (serial, request) = read::<Request<'_>>(&frame[..written]).unwrap();
    assert_eq!((serial, &request), (9, &Request::Begin(config)));
    // 0 slices: the second byte of postcard's 288 and the one before it.
    let mut bytes = [0; FRAME_BYTES_MAX];
    let plain = postcard::to_slice(&request, &mut bytes).unwrap();
    assert_eq!(plain[1..3], [0xa0, 0x02]);
    plain[1..3].copy_from_slice(&[0x80, 0x00]);
    let request: Request<'_> = postcard::from_bytes(plain).unwrap();
    assert_eq!(session.answer(&request, &mut NoGauge), Answer::Refused);
}

#[test]
fn the_longest_messages_fit_a_frame() {
    let handle = crate::plane_store::TurnHandle(255);
    let output = Output {
        torque_nm: f32::MIN,
        speed_rad_s: f32::MIN,
        light: true,
        armed: Some(crate::sequencer::Frame::Slices { turn: handle, frame: u16::MAX }),
        trigger: Some(Trigger { wait_ns: u32::MAX, plane_ns: f32::MAX }),
        released: [Some(handle); 2],
        state: protocol::message::State::Fault,
        fault: Some(protocol::message::Fault::Watchdog),
    };
    let at = Nanos(u64::MAX);
    let mut config = example(288, 240, Direction::Clockwise);
    config.rotation = Rotation::new(4_080, 24, 10_000_000_000, Turns(u32::MAX), Direction::Clockwise).unwrap();
    config.sensors.encoder_counts_per_turn = u32::MAX;
    (config.motor.command_delay, config.clock.frame_latency, config.speed_drive.settle) = (at, at, at);
    (config.limits.holdover, config.limits.lock, config.limits.watchdog) = (at, at, at);
    let mut frame = [0; FRAME_BYTES_MAX];
    let begin = write(255, &Request::Begin(config), &mut frame).unwrap();
    assert_eq!(begin.len(), 142);
    assert!(write(255, &Request::Host { now: at, bytes: &[255; HOST_BYTES_MAX] }, &mut frame).is_some());
    let said = Said::from_slice(&[255; 2 * ANSWER_BYTES_MAX]).unwrap();
    assert!(
        write(255, &Answer::Heard { taken: u16::MAX, said, output: Some(output), ticks: u32::MAX }, &mut frame)
            .is_some()
    );
    assert!(write(255, &Answer::Stepped { output, ticks: u32::MAX }, &mut frame).is_some());
    assert!(write(255, &Request::Step { now: at, input: Input::PlanePulse { at } }, &mut frame).is_some());
    assert_eq!(read::<Answer>(&[3, 77]), None);
}
