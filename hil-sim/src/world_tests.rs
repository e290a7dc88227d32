use super::*;
use crate::scenario::PlantScale;
use protocol::message::{Command, Fault};
use protocol::units::Turns;

fn rotation(slices: u32, refresh_hz: u64, direction: Direction) -> Rotation {
    Rotation::new(slices, 24, refresh_hz * 1_000_000, Turns::fraction(1, 9), direction).unwrap()
}

/// The reference rig at 240 Hz with two turns to show, after `seconds` of `scenario`.
fn run(scenario: &Scenario, seed: u64, seconds: f64) -> World {
    let rotation = rotation(288, 240, Direction::CounterClockwise);
    run_rig(&rotation, scenario, seed, seconds)
}

fn run_rig(rotation: &Rotation, scenario: &Scenario, seed: u64, seconds: f64) -> World {
    let mut world = World::new(rotation, Nanos(0), &Motor::reference(), scenario, seed).unwrap();
    play(&mut world, seconds);
    world
}

/// Hands every released turn back at once, as a host that always has the next picture ready.
fn play(world: &mut World, seconds: f64) {
    if world.now() == Nanos::ZERO {
        world.turn_ready(TurnHandle(0));
        world.turn_ready(TurnHandle(1));
    }
    let until = world.now().seconds() + seconds;
    while world.now().seconds() < until - 1e-9 {
        world.advance(0.01_f64.min(until - world.now().seconds()));
        for turn in world.take_released() {
            world.turn_ready(turn);
        }
    }
}

fn states(world: &World) -> Vec<State> {
    world.statistics().states.into_iter().map(|(_, state)| state).collect()
}

fn started(action: Action) -> Scenario {
    Scenario::default().with(3.0, action)
}

#[test]
fn the_mirror_locks_and_shows_both_turns_in_order() {
    let world = run(&Scenario::default(), 1, 4.0);
    let statistics = world.statistics();
    assert_eq!(states(&world), [State::Idle, State::SpinUp, State::Acquire, State::Locked]);
    assert!(statistics.verdict.is_clean(), "{:?}", statistics.verdict);
    assert!(statistics.verdict.lit > 10_000);
    assert!(statistics.rms_slices < 0.01 && statistics.peak_slices < 0.1, "{statistics:?}");
    assert!(statistics.recoveries[0].ratio().unwrap() < 1.15);
}

#[test]
fn a_run_repeats_by_its_seed() {
    let scenario = started(Action::ExtraFramePulse);
    let (a, b, other) = (run(&scenario, 5, 4.0), run(&scenario, 5, 4.0), run(&scenario, 6, 4.0));
    assert_eq!(a.statistics(), b.statistics());
    assert_ne!(a.statistics(), other.statistics());
}

#[test]
fn how_often_one_looks_changes_nothing_that_matters() {
    let mut often = run(&Scenario::default(), 2, 0.0);
    for _ in 0..30_000 {
        often.advance(1e-4);
    }
    let once = run(&Scenario::default(), 2, 3.0);
    assert!((often.true_angle() - once.true_angle()).abs() < 1e-4);
}

#[test]
fn clockwise_rigs_lock_as_well() {
    let world = run_rig(&rotation(288, 240, Direction::Clockwise), &Scenario::default(), 3, 3.0);
    assert_eq!(world.state(), State::Locked);
    assert!(world.true_speed() < -100.0);
    assert!(world.statistics().verdict.is_clean(), "{:?}", world.statistics().verdict);
}

#[test]
fn other_divisions_of_a_turn_lock_as_well() {
    for (slices, refresh_hz) in [(2_880, 1_440), (1_152, 240), (96, 60), (720, 480), (24, 24)] {
        let world = run_rig(&rotation(slices, refresh_hz, Direction::Clockwise), &Scenario::default(), 3, 12.0);
        let statistics = world.statistics();
        assert_eq!(world.state(), State::Locked, "{slices} at {refresh_hz}: {:?}", statistics.states);
        assert!(statistics.verdict.is_clean(), "{slices}: {:?}", statistics.verdict);
        assert!(statistics.verdict.lit > 1_000);
    }
}

/// At 1.4 turns a second cogging alone moves the mirror by a tenth of a slice, and counts are two slices wide: the controller must know that
/// it does not know.
#[test]
fn what_the_sensors_cannot_resolve_stays_dark() {
    let world = run_rig(&rotation(4_080, 240, Direction::Clockwise), &Scenario::default(), 3, 16.0);
    assert_eq!(world.fault(), Some(Fault::LockTimeout));
    assert_eq!(world.statistics().verdict.lit, 0);
}

#[test]
fn a_projector_that_answers_late_is_allowed_for() {
    let rotation = rotation(288, 240, Direction::CounterClockwise);
    let mut world = World::new(&rotation, Nanos(7_300_000), &Motor::reference(), &Scenario::default(), 4).unwrap();
    play(&mut world, 3.0);
    assert_eq!(world.state(), State::Locked);
    assert!(world.statistics().verdict.is_clean());
    assert!(world.statistics().peak_slices < 0.1);
}

#[test]
fn another_motor_needs_no_retuning() {
    for (inertia, friction) in [(0.5, 0.5), (0.5, 1.5), (1.6, 1.0)] {
        let scenario = Scenario { plant: PlantScale { inertia, friction }, ..Scenario::default() };
        let world = run(&scenario, 7, 5.0);
        let statistics = world.statistics();
        assert_eq!(world.state(), State::Locked);
        assert!(statistics.rms_slices < 0.03 && statistics.peak_slices < 0.1, "{statistics:?}");
        assert!(statistics.verdict.is_clean());
    }
}

#[test]
fn a_lost_and_an_extra_pulse_are_hardly_felt() {
    let pulses = [
        Action::LoseFramePulses { count: 1 },
        Action::ExtraFramePulse,
        Action::LosePlanePulses { count: 30 },
        Action::ExtraPlanePulse,
        Action::LoseIndexPulses { count: 1 },
        Action::ExtraIndexPulse,
        Action::EncoderSlip { counts: -1 },
        Action::EncoderSlip { counts: 1 },
    ];
    for (seed, action) in pulses.into_iter().enumerate() {
        let world = run(&started(action), seed as u64, 4.0);
        let statistics = world.statistics();
        // A slip of one count is a seventh of a slice; where the count does not say so at once the index must.
        let allowed = if matches!(action, Action::EncoderSlip { .. }) { 0.16 } else { 0.02 };
        assert!(statistics.recoveries[1].peak_slices < allowed, "{action:?}: {:?}", statistics.recoveries[1]);
        assert!(statistics.verdict.is_clean(), "{action:?}: {:?}", statistics.verdict);
        assert_eq!(states(&world).last(), Some(&State::Locked));
    }
}

#[test]
fn a_second_without_frame_pulses_is_held_over() {
    let world = run(&started(Action::NoFramePulses { seconds: 1.0 }), 8, 5.0);
    let statistics = world.statistics();
    assert_eq!(states(&world)[3..], [State::Locked, State::Holdover, State::Locked]);
    assert!(statistics.recoveries[1].peak_slices < 0.05, "{:?}", statistics.recoveries[1]);
    assert!(statistics.verdict.is_clean(), "{:?}", statistics.verdict);
}

#[test]
fn a_projector_that_stays_silent_is_a_fault_after_ten_seconds() {
    let world = run(&started(Action::NoFramePulses { seconds: 100.0 }), 9, 14.0);
    let statistics = world.statistics();
    assert_eq!(world.fault(), Some(Fault::ProjectorLost));
    assert!(statistics.verdict.is_clean(), "{:?}", statistics.verdict);
    assert!(statistics.verdict.farthest_slices < 0.4);
}

#[test]
fn a_second_without_index_or_encoder_is_held_over() {
    for action in [Action::NoIndexPulses { seconds: 1.0 }, Action::EncoderFrozen { seconds: 1.0 }] {
        let world = run(&started(action), 10, 5.0);
        let statistics = world.statistics();
        assert_eq!(states(&world)[3..], [State::Locked, State::Holdover, State::Locked], "{action:?}");
        assert!(statistics.recoveries[1].peak_slices < 0.05, "{action:?}: {:?}", statistics.recoveries[1]);
        assert!(statistics.verdict.is_clean(), "{:?}", statistics.verdict);
    }
}

#[test]
fn without_both_sensors_the_mirror_is_let_go() {
    let scenario = started(Action::EncoderFrozen { seconds: 10.0 }).with(3.0, Action::NoIndexPulses { seconds: 10.0 });
    let world = run(&scenario, 11, 4.0);
    assert_eq!(world.fault(), Some(Fault::SensorLost));
    assert!(world.statistics().verdict.is_clean());
}

#[test]
fn an_emergency_stop_is_dark_at_once_and_latched() {
    for (pressed, fault) in [(Action::EmergencyStop, Fault::EmergencyStop), (Action::GuardOpened, Fault::GuardOpen)] {
        let scenario = started(pressed)
            .with(3.5, Action::ClearFault)
            .with(4.0, Action::Start)
            .with(4.5, Action::EmergencyStopReleased)
            .with(4.5, Action::GuardClosed);
        let mut world = run(&scenario, 12, 2.9);
        world.record(Recording { flashes_max: 10_000, ..Recording::default() });
        play(&mut world, 2.1);
        assert_eq!(world.fault(), Some(fault));
        let last = world.take_flashes().last().unwrap().end;
        assert_eq!(last, Nanos(3_000_000_000));
        assert!(world.statistics().verdict.is_clean());
        world.command(Command::ClearFault);
        assert_eq!(world.state(), State::Idle);
        world.command(Command::Start);
        play(&mut world, 3.0);
        assert_eq!(world.state(), State::Locked);
        assert!(world.statistics().verdict.is_clean(), "{:?}", world.statistics().verdict);
    }
}

#[test]
fn a_new_rate_is_followed() {
    for (from, to) in [(180, 240.0), (240, 180.0)] {
        let rotation = rotation(288, from, Direction::CounterClockwise);
        let world = run_rig(&rotation, &started(Action::ProjectorRate { hz: to }), 13, 6.0);
        let statistics = world.statistics();
        assert_eq!(world.state(), State::Locked);
        assert_eq!(states(&world)[3..].last(), Some(&State::Locked));
        let ratio = statistics.recoveries[1].ratio().unwrap();
        assert!(ratio < 1.25, "{from} to {to}: {ratio}");
        // The first plane pulse at a wrong time makes it dark, before a plane is half a slice off.
        assert!(statistics.verdict.is_clean(), "{from} to {to}: {:?}", statistics.verdict);
        assert!(statistics.verdict.farthest_slices > 0.2, "nothing happened");
    }
}

#[test]
fn no_step_of_the_rate_lights_a_plane_in_a_wrong_place() {
    // Below 160 Hz the first plane is half a slice overdue before anything can tell.
    for (seed, to) in (20..).zip([165.0, 200.0, 225.0, 236.0, 239.0, 241.0, 246.0, 260.0, 300.0]) {
        let rotation = rotation(288, 240, Direction::CounterClockwise);
        let world = run_rig(&rotation, &started(Action::ProjectorRate { hz: to }), seed, 6.0);
        let verdict = &world.statistics().verdict;
        assert!(verdict.is_clean(), "240 to {to}: {verdict:?}");
    }
}

#[test]
fn a_load_is_learnt() {
    let world = run(&started(Action::Load { torque_nm: -0.02 }), 14, 6.0);
    let statistics = world.statistics();
    assert_eq!(world.state(), State::Locked);
    assert!(statistics.recoveries[1].settled_s.unwrap() < 0.5, "{:?}", statistics.recoveries[1]);
    assert!(statistics.verdict.is_clean(), "{:?}", statistics.verdict);
}

#[test]
fn a_stop_is_dark_and_without_torque() {
    let mut world = run(&started(Action::Stop), 15, 3.1);
    assert_eq!(world.state(), State::Idle);
    let speed = world.true_speed();
    play(&mut world, 1.0);
    assert!(world.true_speed() < speed - 10.0);
    // The start came to its end before the stop.
    assert!(world.statistics().recoveries[0].ratio().unwrap() < 1.15);
    assert!(world.statistics().verdict.is_clean());
    // A start while it still turns.
    world.command(Command::Start);
    play(&mut world, 2.0);
    assert_eq!(world.state(), State::Locked);
}

#[test]
fn safety_inputs_and_doubt_are_dark_within_a_plane() {
    // At once; a pulse that is missing shows when the next one comes.
    for (action, planes) in [
        (Action::EmergencyStop, 0.0),
        (Action::GuardOpened, 0.0),
        (Action::ExtraPlanePulse, 1.0),
        (Action::LosePlanePulses { count: 1 }, 2.0),
    ] {
        let mut world = run(&started(action), 19, 2.99);
        world.record(Recording { flashes_max: 1_000, ..Recording::default() });
        play(&mut world, 0.011);
        let flashes = world.take_flashes();
        let last = flashes.last().unwrap().end.seconds();
        assert!(last > 2.9998, "{action:?}: dark too early, at {last}");
        let jitter_s = 2e-5;
        assert!(last <= 3.0 + planes / 5_760.0 + jitter_s, "{action:?}: lit until {last}");
    }
}

#[test]
fn a_control_timer_that_stops_is_a_fault() {
    let world = run(&started(Action::NoControlTicks { seconds: 0.1 }), 16, 4.0);
    assert_eq!(world.fault(), Some(Fault::Watchdog));
    let faults = world.faults();
    assert_eq!((faults.latched, faults.count(Fault::Watchdog), faults.limit_micro), (world.fault(), 1, 5_000));
    // Something comes with every plane: the watchdog is no more than one late.
    assert!((5_000..5_000 + 180).contains(&faults.value_micro), "{faults:?}");
    assert!(world.statistics().verdict.is_clean());
}

#[test]
fn a_control_timer_that_pauses_is_dark_within_a_plane_and_lit_a_turn_later() {
    let mut world = run(&started(Action::NoControlTicks { seconds: 0.003 }), 16, 2.9);
    world.record(Recording { flashes_max: 10_000, ..Recording::default() });
    play(&mut world, 0.4);
    let flashes = world.take_flashes();
    let gap = flashes.windows(2).map(|pair| [pair[0].end.seconds(), pair[1].start.seconds()]);
    let [dark, lit] = gap.max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0]))).unwrap();
    // Two control periods after the last tick, and what comes then comes with a plane.
    assert!(dark > 3.0 && dark < 3.0 + 5e-4 + 1.0 / 5_760.0 + 2e-5, "lit until {dark}");
    assert!(lit > 3.053 && lit < 3.2, "dark until {lit}");
    assert!(world.fault().is_none() && world.statistics().verdict.is_clean(), "{:?}", world.statistics());
}

#[test]
fn a_blocked_mirror_is_a_stall() {
    let scenario = Scenario { plant: PlantScale { inertia: 1.0, friction: 50.0 }, ..Scenario::default() };
    let world = run(&scenario, 17, 3.0);
    assert_eq!(world.fault(), Some(Fault::Stall));
}

#[test]
fn service_shows_one_slice_on_the_parked_mirror() {
    let scenario = Scenario { events: Vec::new(), ..Scenario::default() }
        .with(0.5, Action::Service { slice: 100, duration_ms: 300 });
    let mut world = run(&scenario, 18, 0.1);
    world.record(Recording { flashes_max: 10_000, ..Recording::default() });
    play(&mut world, 0.9);
    let flashes = world.take_flashes();
    assert!(!flashes.is_empty());
    assert!(matches!(flashes[0].plane, Plane::Slice { slice: 100, .. }));
    assert!(flashes.iter().all(|flash| flash.plane == flashes[0].plane));
    assert!(flashes[0].start.seconds() >= 0.5 && flashes[flashes.len() - 1].end.seconds() <= 0.801);
    assert_eq!(world.state(), State::Idle);
    assert!(world.statistics().verdict.is_clean());
}
