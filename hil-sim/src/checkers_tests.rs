use super::*;
use protocol::units::Turns;

const PLANE_NS: u64 = 173_611;

fn rotation(direction: Direction) -> Rotation {
    Rotation::new(288, 24, 240_000_000, Turns::fraction(1, 7), direction).unwrap()
}

/// `turns` perfect rotations, alternating between two slots.
fn perfect(rotation: &Rotation, turns: u64) -> Vec<Flash> {
    let sign = if rotation.direction() == Direction::Clockwise { -1.0 } else { 1.0 };
    let slice_rad = TAU / 288.0;
    (0..turns * 288)
        .map(|number| {
            let slice = (number % 288) as u16;
            let middle = rotation.slice_middle(u32::from(slice)).radians() + sign * TAU * (number / 288) as f64;
            Flash {
                start: Nanos(number * PLANE_NS),
                end: Nanos((number + 1) * PLANE_NS),
                angle_start: middle - sign * 0.5 * slice_rad,
                angle_end: middle + sign * 0.5 * slice_rad,
                plane: Plane::Slice { turn: TurnHandle((number / 288 % 2) as u8), slice },
                state: State::Locked,
            }
        })
        .collect()
}

fn judge(rotation: &Rotation, flashes: &[Flash]) -> Verdict {
    let mut checkers = Checkers::new(rotation);
    for flash in flashes {
        checkers.see(flash);
    }
    checkers.verdict().clone()
}

#[test]
fn a_perfect_record_is_clean_both_ways_round() {
    for direction in [Direction::Clockwise, Direction::CounterClockwise] {
        let rotation = rotation(direction);
        let verdict = judge(&rotation, &perfect(&rotation, 4));
        assert!(verdict.is_clean(), "{verdict:?}");
        assert_eq!(verdict.lit, 4 * 288);
        assert!(verdict.farthest_slices < 1e-6);
    }
}

#[test]
fn a_plane_off_its_place_is_seen() {
    let rotation = rotation(Direction::CounterClockwise);
    for off in [-0.51, 0.51, 3.0] {
        let mut flashes = perfect(&rotation, 1);
        flashes[100].angle_start += off * TAU / 288.0;
        flashes[100].angle_end += off * TAU / 288.0;
        let verdict = judge(&rotation, &flashes);
        assert_eq!((verdict.misplaced, verdict.torn), (1, 0));
        assert!((verdict.farthest_slices - f64::abs(off)).abs() < 1e-6);
        assert!(verdict.first.unwrap().contains("slice 100"));
    }
    // Half a slice off the whole time, and the whole record one frame off.
    let mut frame_off = perfect(&rotation, 1);
    for flash in &mut frame_off {
        flash.angle_start += TAU / 12.0;
        flash.angle_end += TAU / 12.0;
    }
    assert_eq!(judge(&rotation, &frame_off).misplaced, 288);
}

#[test]
fn a_part_of_a_plane_may_lie_anywhere_within_it() {
    let rotation = rotation(Direction::Clockwise);
    let mut flashes = perfect(&rotation, 1);
    let quarter = 0.25 * (flashes[9].angle_end - flashes[9].angle_start);
    flashes[9].angle_end = flashes[9].angle_start + quarter;
    flashes[9].end = Nanos(flashes[9].start.0 + PLANE_NS / 4);
    assert!(judge(&rotation, &flashes).is_clean());
    let mut rest = flashes[9];
    (rest.start, rest.end) = (rest.end, Nanos(rest.start.0 + PLANE_NS));
    (rest.angle_start, rest.angle_end) = (rest.angle_end, rest.angle_start + 4.0 * quarter);
    flashes.insert(10, rest);
    assert!(judge(&rotation, &flashes).is_clean());
    flashes[10].angle_end -= 0.6 * TAU / 288.0;
    assert_eq!(judge(&rotation, &flashes).misplaced, 1);
}

#[test]
fn light_in_a_dark_state_is_seen() {
    let rotation = rotation(Direction::Clockwise);
    for state in [State::Idle, State::SpinUp, State::Acquire, State::Fault] {
        let mut flashes = perfect(&rotation, 1);
        flashes[5].state = state;
        assert_eq!(judge(&rotation, &flashes).forbidden, 1);
    }
}

#[test]
fn a_torn_turn_is_seen() {
    let rotation = rotation(Direction::CounterClockwise);
    let mut swapped = perfect(&rotation, 2);
    for flash in &mut swapped[24..48] {
        let Plane::Slice { slice, .. } = flash.plane else { unreachable!() };
        flash.plane = Plane::Slice { turn: TurnHandle(1), slice };
    }
    // To the other turn and back.
    assert_eq!(judge(&rotation, &swapped).torn, 2);
    let late = &perfect(&rotation, 2)[24..];
    assert_eq!(judge(&rotation, late).torn, 1);
    let mut gap = perfect(&rotation, 2);
    gap.drain(200..288 + 24);
    assert_eq!(judge(&rotation, &gap).torn, 1);
}

#[test]
fn a_slice_shown_twice_is_seen() {
    let rotation = rotation(Direction::CounterClockwise);
    let mut flashes = perfect(&rotation, 1);
    let Plane::Slice { turn, slice } = flashes[10].plane else { unreachable!() };
    flashes[34].plane = Plane::Slice { turn, slice };
    let verdict = judge(&rotation, &flashes);
    assert!(verdict.disordered >= 1 && verdict.misplaced == 1, "{verdict:?}");
}

#[test]
fn service_lights_any_slice_for_long() {
    let rotation = rotation(Direction::CounterClockwise);
    let mut flashes = perfect(&rotation, 1);
    for flash in &mut flashes {
        flash.state = State::Service;
        flash.plane = Plane::Slice { turn: TurnHandle(0), slice: 77 };
    }
    assert!(judge(&rotation, &flashes).is_clean());
}

#[test]
fn a_mirror_that_stands_in_an_open_loop_is_seen() {
    let rotation = rotation(Direction::CounterClockwise);
    let mut flashes = perfect(&rotation, 3);
    for flash in &mut flashes {
        (flash.angle_start, flash.angle_end, flash.state) = (0.0, 0.0, State::OpenLoop);
    }
    let verdict = judge(&rotation, &flashes);
    assert_eq!(verdict.misplaced, 2 * 288);
    assert!(verdict.first.unwrap().contains("does not turn"));
}
