use super::*;
use firmware::fault_log::{Cause, FaultLog};
use proptest::prelude::*;
use protocol::codec::{Compressor, Hint, ImageSize, plane_check, turn_check};
use protocol::message::{Ack, AskMissing, BeginTurn, Configure, Control, EndTurn, Hello, HelloReply, KeepPlanes};
use protocol::message::{Command, Fault, PlaneData, Reason, SCHEMA, State, VERSION};
use protocol::message::{Message, Missing, Nack};
use protocol::packet::{Decoder, FRAME_BYTES_MAX, PACKET_BYTES_MAX, encode};
use protocol::timing::{Direction, Rotation};
use protocol::units::{Nanos, Turns};

const SLICES: u32 = 24;
const HELLO: Hello = Hello { version: VERSION, schema: SCHEMA };

fn size() -> ImageSize {
    ImageSize::new(16, 8).unwrap()
}

fn rotation() -> Rotation {
    Rotation::new(SLICES, 24, 240_000_000, Turns::ZERO, Direction::Clockwise).unwrap()
}

fn plane(turn: u32, slice: u16) -> Vec<u8> {
    (0..16).map(|at| (u32::from(slice) * 31 + turn % 256 * 7 + at * 11) as u8).collect()
}

fn frame<'a>(sequence: u32, message: impl Into<Message<'a>>) -> Vec<u8> {
    let mut out = vec![0; FRAME_BYTES_MAX];
    let length = encode(sequence, &message.into(), &mut out).unwrap();
    out.truncate(length);
    out
}

/// Sends one message and returns what came back, in words.
fn ask<'a>(device: &mut Device, message: impl Into<Message<'a>>) -> Result<(), Reason> {
    device.receive(&frame(77, message));
    let bytes = device.transmit();
    let mut decoder = Decoder::<PACKET_BYTES_MAX>::new();
    let packet = decoder.next(&mut &bytes[..]).expect("an answer").unwrap();
    match packet.message().unwrap() {
        Message::Ack(Ack { answers: 77 }) | Message::HelloReply(HelloReply { answers: 77, .. }) => Ok(()),
        Message::Nack(Nack { answers: 77, reason }) => Err(reason),
        other => panic!("{other:?}"),
    }
}

fn ready() -> Device {
    let mut device = Device::new();
    ask(&mut device, HELLO).unwrap();
    ask(&mut device, Configure::new(&rotation(), size())).unwrap();
    assert_eq!(device.next_input(), Some(Input::Configured(rotation(), size())));
    device
}

fn begin(turn: u32) -> BeginTurn {
    BeginTurn { turn, slices: SLICES as u16 }
}

fn end(turn: u32) -> EndTurn {
    EndTurn { turn, check: turn_check(turn, (0..SLICES as u16).map(|slice| plane_check(&plane(turn, slice)))) }
}

fn send_plane(device: &mut Device, turn: u32, slice: u16) -> Result<(), Reason> {
    let (plane, mut bytes) = (plane(turn, slice), Vec::new());
    Compressor::new(size()).compress(&plane, Hint::None, &mut bytes);
    let (total, check) = (bytes.len() as u32, plane_check(&plane));
    ask(device, PlaneData { turn, slice, offset: 0, total, check, bytes: &bytes })
}

fn send_turn(device: &mut Device, turn: u32) -> Result<TurnHandle, Reason> {
    ask(device, begin(turn))?;
    (0..SLICES as u16).try_for_each(|slice| send_plane(device, turn, slice))?;
    ask(device, end(turn))?;
    match device.next_input() {
        Some(Input::TurnReady(handle)) => Ok(handle),
        other => panic!("{other:?}"),
    }
}

#[test]
fn two_turns_and_then_busy_until_one_is_released() {
    let mut device = ready();
    let first = send_turn(&mut device, 1).unwrap();
    let second = send_turn(&mut device, 2).unwrap();
    assert_eq!(device.store().plane(second, 5).unwrap().bytes(), plane(2, 5));
    assert_eq!(ask(&mut device, begin(3)), Err(Reason::Busy));
    assert_eq!((device.turn_number(first), device.turn_number(second)), (Some(1), Some(2)));
    device.release(first);
    assert_eq!(send_turn(&mut device, 3), Ok(first));
    assert_eq!(device.store().plane(second, 5).unwrap().bytes(), plane(2, 5), "on screen all the time");
    let counters = device.counters();
    assert_eq!((counters.turns_received, counters.turns_abandoned, counters.refused), (3, 0, 1));
}

#[test]
fn messages_out_of_order_are_refused() {
    let mut device = Device::new();
    assert_eq!(ask(&mut device, begin(1)), Err(Reason::NotConnected));
    ask(&mut device, HELLO).unwrap();
    assert_eq!(ask(&mut device, begin(1)), Err(Reason::NotConfigured));
    let configure = Configure::new(&rotation(), size());
    assert_eq!(ask(&mut device, Configure { slices: 25, ..configure }), Err(Reason::Configuration));
    let large = Configure { slices: 4080, width: 4096, height: 4096, ..configure };
    assert_eq!(ask(&mut device, large), Err(Reason::Configuration));
    ask(&mut device, configure).unwrap();
    assert_eq!(send_plane(&mut device, 1, 0), Err(Reason::WrongTurn));
    assert_eq!(ask(&mut device, BeginTurn { turn: 1, slices: 48 }), Err(Reason::SliceOutOfRange));
    ask(&mut device, begin(1)).unwrap();
    assert_eq!(send_plane(&mut device, 2, 0), Err(Reason::WrongTurn));
    assert_eq!(send_plane(&mut device, 1, SLICES as u16), Err(Reason::SliceOutOfRange));
    assert_eq!(ask(&mut device, end(1)), Err(Reason::SliceMissing));
    (0..SLICES as u16).for_each(|slice| send_plane(&mut device, 1, slice).unwrap());
    assert_eq!(ask(&mut device, EndTurn { turn: 1, check: 0 }), Err(Reason::TurnDamaged));
    ask(&mut device, end(1)).unwrap();
    assert_eq!(ask(&mut device, Ack { answers: 0 }), Err(Reason::NotUnderstood));
    assert_eq!(ask(&mut device, Configure { width: 24, ..configure }), Err(Reason::Busy));
    let last = std::iter::from_fn(|| device.next_input()).last();
    assert_eq!(last, Some(Input::Vacate), "the controller is asked to give its turns back");
    assert_eq!(ask(&mut device, configure), Ok(()), "the same again");
}

#[test]
fn an_unfinished_turn_is_abandoned() {
    let mut device = ready();
    let shown = send_turn(&mut device, 1).unwrap();
    ask(&mut device, begin(2)).unwrap();
    send_plane(&mut device, 2, 0).unwrap();
    ask(&mut device, begin(3)).unwrap();
    assert_eq!(send_plane(&mut device, 2, 1), Err(Reason::WrongTurn));
    device.lose_link();
    assert_eq!(ask(&mut device, begin(4)), Err(Reason::NotConnected));
    ask(&mut device, HELLO).unwrap();
    assert_eq!(device.counters().turns_abandoned, 1, "turn 3 may go on");
    assert_eq!(device.store().plane(shown, 0).unwrap().bytes(), plane(1, 0));
    let next = send_turn(&mut device, 4).unwrap();
    assert_eq!(device.counters().turns_abandoned, 2);
    // What is not the controller's to release stays.
    device.release(TurnHandle(7));
    assert_eq!(device.store().plane(next, 0).unwrap().bytes(), plane(4, 0));
}

/// What the device says is missing of `turn`, from slice `from` on.
fn missing(device: &mut Device, turn: u32, from: u16) -> Result<[u16; 2], Reason> {
    device.receive(&frame(78, AskMissing { turn, from }));
    let bytes = device.transmit();
    let mut decoder = Decoder::<PACKET_BYTES_MAX>::new();
    let packet = decoder.next(&mut &bytes[..]).expect("an answer").unwrap();
    match packet.message().unwrap() {
        Message::Missing(Missing { answers: 78, from, to }) => Ok([from, to]),
        Message::Nack(Nack { answers: 78, reason }) => Err(reason),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_turn_goes_on_after_the_link_was_lost() {
    let mut device = ready();
    assert_eq!(missing(&mut device, 1, 0), Err(Reason::WrongTurn));
    ask(&mut device, begin(1)).unwrap();
    for slice in [0, 1, 2, 7, 8, 23] {
        send_plane(&mut device, 1, slice).unwrap();
    }
    device.lose_link();
    ask(&mut device, HELLO).unwrap();
    assert_eq!(missing(&mut device, 2, 0), Err(Reason::WrongTurn));
    assert_eq!(
        [0, 7, 5, 9, 23, 24, 999].map(|from| missing(&mut device, 1, from)),
        [Ok([3, 7]), Ok([9, 23]), Ok([5, 7]), Ok([9, 23]), Ok([24, 24]), Ok([24, 24]), Ok([24, 24])]
    );
    // A plane that comes again and is damaged is missing.
    let bad = PlaneData { turn: 1, slice: 8, offset: 0, total: 2, check: 5, bytes: &[9, 9] };
    assert_eq!(ask(&mut device, bad), Err(Reason::PlaneDamaged));
    assert_eq!(missing(&mut device, 1, 7), Ok([8, 23]));
    (3..23).for_each(|slice| send_plane(&mut device, 1, slice).unwrap());
    assert_eq!(missing(&mut device, 1, 0), Ok([24, 24]));
    ask(&mut device, end(1)).unwrap();
    // The host did not hear that, asks again, and ends it again.
    device.lose_link();
    ask(&mut device, HELLO).unwrap();
    assert_eq!(missing(&mut device, 1, 0), Ok([24, 24]));
    ask(&mut device, end(1)).unwrap();
    assert!(matches!(device.next_input(), Some(Input::TurnReady(_))));
    assert_eq!(device.next_input(), None);
}

#[test]
fn planes_of_the_turn_before_are_kept() {
    let mut device = ready();
    let first = send_turn(&mut device, 1).unwrap();
    ask(&mut device, begin(2)).unwrap();
    let keep = KeepPlanes { turn: 2, of: 1, from: 3, to: 23 };
    assert_eq!(ask(&mut device, KeepPlanes { turn: 1, ..keep }), Err(Reason::WrongTurn));
    assert_eq!(ask(&mut device, KeepPlanes { of: 2, ..keep }), Err(Reason::WrongTurn));
    assert_eq!(ask(&mut device, KeepPlanes { to: 25, ..keep }), Err(Reason::SliceOutOfRange));
    assert_eq!(ask(&mut device, KeepPlanes { to: 2, ..keep }), Err(Reason::SliceOutOfRange));
    ask(&mut device, keep).unwrap();
    ask(&mut device, keep).unwrap();
    assert_eq!(missing(&mut device, 2, 0), Ok([0, 3]));
    [0, 1, 2, 23].into_iter().for_each(|slice| send_plane(&mut device, 2, slice).unwrap());
    assert_eq!(ask(&mut device, end(2)), Err(Reason::TurnDamaged), "the check is of other planes");
    let of = |slice: u16| if (3..23).contains(&slice) { 1 } else { 2 };
    let planes: Vec<_> = (0..SLICES as u16).map(|slice| plane(of(slice), slice)).collect();
    let check = turn_check(2, planes.iter().map(|plane| plane_check(plane)));
    ask(&mut device, EndTurn { turn: 2, check }).unwrap();
    let second = TurnHandle(1 - first.0);
    for (slice, plane) in (0..).zip(&planes) {
        assert_eq!(device.store().plane(second, slice).unwrap().bytes(), plane);
        assert_eq!(device.store().plane(first, slice).unwrap().bytes(), self::plane(1, slice));
    }
    device.release(first);
    ask(&mut device, begin(3)).unwrap();
    assert_eq!(ask(&mut device, KeepPlanes { turn: 3, of: 1, ..keep }), Err(Reason::WrongTurn), "gone");
}

#[test]
fn repeated_packets_change_nothing() {
    let mut device = ready();
    ask(&mut device, begin(1)).unwrap();
    (0..SLICES as u16).for_each(|slice| send_plane(&mut device, 1, slice).unwrap());
    ask(&mut device, begin(1)).unwrap();
    ask(&mut device, end(1)).unwrap();
    ask(&mut device, end(1)).unwrap();
    ask(&mut device, begin(1)).unwrap();
    assert!(matches!(device.next_input(), Some(Input::TurnReady(_))));
    assert_eq!(device.next_input(), None);
    let (start, stop) = (Control { command: Command::Start }, Control { command: Command::Stop });
    for (sequence, order) in [(5, start), (5, start), (6, stop), (5, start)] {
        device.receive(&frame(sequence, order));
    }
    let inputs: Vec<_> = std::iter::from_fn(|| device.next_input()).collect();
    assert_eq!(inputs, [Input::Command(Command::Start), Input::Command(Command::Stop)]);
}

#[test]
fn numbers_of_orders_and_turns_wrap() {
    let mut device = ready();
    let (start, stop) = (Control { command: Command::Start }, Control { command: Command::Stop });
    for (sequence, order) in [(u32::MAX - 1, start), (u32::MAX, stop), (0, start), (u32::MAX, stop), (1, stop)] {
        device.receive(&frame(sequence, order));
    }
    let inputs: Vec<_> = std::iter::from_fn(|| device.next_input()).collect();
    assert_eq!(inputs, [start, stop, start, stop].map(|order| Input::Command(order.command)));
    device.transmit();
    let last = send_turn(&mut device, u32::MAX).unwrap();
    let next = send_turn(&mut device, 0).unwrap();
    assert_eq!([last, next].map(|turn| device.turn_number(turn)), [Some(u32::MAX), Some(0)]);
}

#[test]
fn another_schema_is_answered_and_not_served() {
    let mut device = ready();
    ask(&mut device, Hello { version: 9, schema: !SCHEMA }).unwrap();
    assert_eq!(ask(&mut device, begin(1)), Err(Reason::NotConnected));
}

#[test]
fn a_status_names_the_turn_on_screen() {
    let mut device = ready();
    let turn = send_turn(&mut device, 41).unwrap();
    let report = Report { state: State::Locked, on_screen: Some(turn), ..Report::default() };
    device.report(Report { state: State::Acquire, ..report });
    device.report(report);
    device.receive(&[9, 9, 0]);
    let bytes = device.transmit();
    let mut decoder = Decoder::<PACKET_BYTES_MAX>::new();
    let packet = decoder.next(&mut &bytes[..]).unwrap().unwrap();
    let Ok(Message::Status(status)) = packet.message() else { panic!("{packet:?}") };
    assert_eq!((status.state, status.turn_on_screen, status.turns_received), (State::Locked, Some(41), 1));
    assert_eq!((status.packets, status.packets_damaged), (SLICES + 4, 1));
    assert_eq!(device.transmit(), []);
}

#[test]
fn faults_are_told_after_a_hello_and_where_they_change() {
    let mut device = ready();
    let told = |device: &mut Device| {
        device.report(Report::default());
        let bytes = device.transmit();
        let (mut decoder, mut bytes) = (Decoder::<PACKET_BYTES_MAX>::new(), bytes.as_slice());
        let mut faults = Vec::new();
        while let Some(packet) = decoder.next(&mut bytes) {
            if let Ok(Message::Faults(told)) = packet.unwrap().message() {
                faults.push(told);
            }
        }
        faults
    };
    let mut log = FaultLog::default();
    device.faults(log.faults());
    assert_eq!(told(&mut device), [log.faults()]);
    assert_eq!(told(&mut device), []);
    log.latch(Fault::Stall, Cause::LEVEL, Nanos(1));
    device.faults(log.faults());
    assert_eq!(told(&mut device), [log.faults()]);
    device.receive(&frame(90, HELLO));
    assert_eq!(told(&mut device), [log.faults()]);
}

proptest! {
    #[test]
    fn any_well_framed_nonsense_leaves_the_screen_alone(
        messages in prop::collection::vec((0u8..17, prop::collection::vec(0u8..30, 0..40)), 0..60),
    ) {
        let mut device = ready();
        let shown = send_turn(&mut device, 1).unwrap();
        for (id, payload) in &messages {
            if let Ok(message) = Message::decode(*id, payload) {
                device.receive(&frame(3, message));
            }
            device.transmit();
        }
        for slice in 0..SLICES as u16 {
            prop_assert_eq!(device.store().plane(shown, slice).unwrap().bytes(), plane(1, slice));
        }
    }
}
