use super::*;
use crate::config::Config;
use crate::config::tests::example;
use crate::controller::Controller;
use crate::plane_store::TurnHandle;
use proptest::prelude::*;
use protocol::codec::ImageSize;
use protocol::message::{Command, Fault, State};
use protocol::timing::{Direction, Rotation};
use protocol::units::Nanos;
use std::format;
use std::vec::Vec;

/// Five nanoseconds a count, as on a board: 21 s to a wrap.
const HZ: NonZeroU32 = NonZeroU32::new(200_000_000).unwrap();
const STOPPED: Levels = Levels { emergency_stop: true, guard_open: false };

fn figures(rotation: Rotation) -> Option<Config> {
    Some(Config { rotation, ..example(288, 240, Direction::CounterClockwise) })
}

fn station() -> Station {
    let controller = Controller::new(example(288, 240, Direction::CounterClockwise)).unwrap();
    Station::new(Hosted::new(controller, figures), HZ)
}

fn outputs(station: &mut Station, count: u32, event: Option<Event>, levels: Levels) -> Vec<Output> {
    let mut outputs = Vec::new();
    station.take(count, event, levels, |output, _| outputs.push(*output));
    outputs
}

fn state(station: &mut Station, count: u32, event: Event) -> State {
    outputs(station, count, Some(event), Levels::default());
    station.hosted.report().state
}

fn configured(slices: u32) -> Event {
    let rotation = Rotation::new(slices, 24, 240_000_000, Default::default(), Direction::Clockwise).unwrap();
    Event::Request(Request::Configured(rotation, ImageSize::new(8, 8).unwrap()))
}

const START: Event = Event::Request(Request::Command(Command::Start));
const CLEAR: Event = Event::Request(Request::Command(Command::ClearFault));
const TURN: Event = Event::Request(Request::TurnReady(TurnHandle(1)));

#[test]
fn a_safety_input_comes_first_and_with_any_event() {
    for event in [None, Some(Event::Tick(0)), Some(Event::Frame(50_000)), Some(START), Some(TURN)] {
        let mut station = station();
        assert_eq!(state(&mut station, 1_000, START), State::SpinUp);
        let seen = outputs(&mut station, 51_000, event, STOPPED);
        assert_eq!(seen.len(), 1 + usize::from(event.is_some()));
        for output in seen {
            let expected = (State::Fault, Some(Fault::EmergencyStop), 0.0, false);
            assert_eq!((output.state, output.fault, output.torque_nm, output.light), expected, "{event:?}");
        }
        assert_eq!(state(&mut station, 52_000, CLEAR), State::Idle);
    }
}

#[test]
fn only_an_idle_controller_is_put_aside() {
    let mut station = station();
    let given_back = [Some(TurnHandle(1)), None];
    assert_eq!(state(&mut station, 1, START), State::SpinUp);
    assert_eq!(state(&mut station, 2, configured(576)), State::SpinUp);
    assert_eq!(station.hosted.config().rotation.slices(), 288);
    assert_eq!(outputs(&mut station, 3, Some(TURN), Levels::default())[0].released, given_back);
    // Nor one that holds a fault, which would be forgotten.
    outputs(&mut station, 4, None, STOPPED);
    assert_eq!(state(&mut station, 5, configured(576)), State::Fault);
    assert_eq!(state(&mut station, 6, CLEAR), State::Idle);
    assert_eq!(state(&mut station, 7, configured(576)), State::Idle);
    assert_eq!(station.hosted.config().rotation.slices(), 576);
    assert_eq!(outputs(&mut station, 8, Some(TURN), Levels::default())[0].released, [None; 2]);
    // 4000 ticks a second cannot arm so many frames: the controller stays, and turns for it come back.
    let fast = Rotation::new(288, 24, 3_000_000_000, Default::default(), Direction::Clockwise).unwrap();
    let fast = Event::Request(Request::Configured(fast, ImageSize::new(8, 8).unwrap()));
    assert_eq!(state(&mut station, 9, fast), State::Idle);
    assert_eq!(outputs(&mut station, 10, Some(TURN), Levels::default())[0].released, given_back);
}

#[test]
fn a_mirror_at_rest_gives_its_turns_back() {
    let mut station = station();
    let vacate = || Some(Event::Request(Request::Vacate));
    let turn = |number| Some(Event::Request(Request::TurnReady(TurnHandle(number))));
    outputs(&mut station, 1, turn(0), Levels::default());
    assert_eq!(outputs(&mut station, 2, vacate(), Levels::default())[0].released, [Some(TurnHandle(0)), None]);
    assert_eq!(outputs(&mut station, 3, vacate(), Levels::default())[0].released, [None; 2]);
    outputs(&mut station, 4, turn(1), Levels::default());
    assert_eq!(state(&mut station, 5, START), State::SpinUp);
    let kept = outputs(&mut station, 6, vacate(), Levels::default())[0];
    assert_eq!((kept.released, kept.armed), ([None; 2], None));
}

#[test]
fn a_guard_that_opens_while_the_host_configures_is_not_forgotten() {
    let mut station = station();
    let guard = Levels { guard_open: true, ..Levels::default() };
    assert_eq!(outputs(&mut station, 1, Some(configured(576)), guard).len(), 1);
    assert_eq!(outputs(&mut station, 2, Some(START), guard).last().map(|output| output.state), Some(State::Fault));
    assert_eq!(station.hosted.config().rotation.slices(), 288);
}

#[test]
fn a_shown_slice_is_a_shown_turn() {
    let mut station = station();
    let service = Event::Request(Request::Command(Command::Service { slice: 3, duration_ms: 10 }));
    for (count, event) in [(1, Event::Tick(0)), (2, TURN), (3, service), (50_003, Event::Tick(0))] {
        outputs(&mut station, count, Some(event), Levels::default());
    }
    let report = station.hosted.report();
    assert_eq!((report.on_screen, report.turns_shown), (Some(TurnHandle(1)), 1));
}

proptest! {
    #[test]
    fn a_station_is_its_controller_with_another_clock(
        start in 4_200_000_000u32..4_290_000_000, steps in prop::collection::vec((1u32..1_000_000, 0u32..2_000, 0u8..5), 1..200),
    ) {
        let mut station = station();
        let mut controller = Controller::new(example(288, 240, Direction::CounterClockwise)).unwrap();
        let mut count = u64::from(start / 2);
        let nanos = |count: u64| Nanos(count * 5);
        outputs(&mut station, count as u32, Some(Event::Tick(0)), Levels::default());
        controller.step(nanos(count), Input::Tick { encoder_count: 0 });
        // Near the wrap, and over it.
        count = u64::from(start);
        for (step, early, kind) in steps {
            count += u64::from(step) + 2_000;
            let captured = count - u64::from(early);
            let at = nanos(captured);
            let (event, input) = match kind {
                0 => (Event::Tick(step), Input::Tick { encoder_count: step }),
                1 => (Event::Index(captured as u32), Input::IndexPulse { at }),
                2 => (Event::Frame(captured as u32), Input::FramePulse { at }),
                3 => (Event::Plane(captured as u32), Input::PlanePulse { at }),
                _ => (START, Input::Command(Command::Start)),
            };
            let seen = outputs(&mut station, count as u32, Some(event), Levels::default());
            prop_assert_eq!(seen, [controller.step(nanos(count), input)]);
        }
        prop_assert_eq!(format!("{:?}", station.hosted.controller()), format!("{controller:?}"));
    }
}
