use super::*;
use crate::config::tests::example;
use proptest::prelude::*;
use protocol::timing::Direction;

const TICK: Nanos = Nanos(250_000);
const TURN_NS: u64 = 50_000_000;

/// What was asked for, with its time.
#[derive(Clone, Copy)]
struct Due {
    at: Nanos,
    plane_ns: f32,
    frame: u32,
    in_order: bool,
}

impl Due {
    fn new(now: Nanos, asked: &Asked) -> Self {
        let Trigger { wait_ns, plane_ns } = asked.trigger;
        Self { at: now + Nanos(wait_ns.into()), plane_ns, frame: asked.frame, in_order: asked.in_order }
    }
}

/// A mirror that turns 20 times a second, seen without noise by an estimator that has been told of no torque.
struct Bench {
    follower: Follower,
    mirror: RotationEstimator,
    ticks: u64,
    asked: std::vec::Vec<Due>,
}

impl Bench {
    fn new(latency: Nanos) -> Self {
        let mut config = example(288, 240, Direction::CounterClockwise);
        config.clock.frame_latency = latency;
        let follower = Follower::new(&config);
        Self { follower, mirror: RotationEstimator::new(&config), ticks: 0, asked: std::vec::Vec::new() }
    }

    fn now(&self) -> Nanos {
        Nanos(self.ticks * TICK.0)
    }

    /// So many ticks; `pulses`: the projector obeys, and says so.
    fn run(&mut self, ticks: u64, pulses: bool) {
        for _ in 0..ticks {
            self.ticks += 1;
            let now = self.now();
            if now.0.is_multiple_of(TURN_NS) {
                self.mirror.index(now);
            }
            // 2,000 counts a turn: ten a tick.
            self.mirror.tick(now, (self.ticks * 10 + 5) as u32, 0.0867);
            if pulses {
                self.pulses();
            }
            self.follower.coast(now);
            if let Some(asked) = self.follower.ask(now, &self.mirror) {
                self.asked.push(Due::new(now, &asked));
            }
        }
    }

    /// Frame and plane pulses since the last tick.
    fn pulses(&mut self) {
        let (from, to) = (self.now() - TICK, self.now());
        let latency = self.follower.latency_ns;
        for trigger in self.asked.iter().rev().take(3).rev().copied() {
            let within = |at: Nanos| at > from && at <= to;
            if within(trigger.at) {
                self.follower.frame_pulse(trigger.at);
            }
            for plane in 0..24 {
                let at = trigger.at + Nanos(latency + (plane as f32 * trigger.plane_ns) as u64);
                if within(at) {
                    self.follower.plane_pulse(at);
                }
            }
        }
    }

    fn followed(latency: Nanos) -> Self {
        let mut bench = Self::new(latency);
        bench.run(4_000, true);
        assert!(bench.follower.is_known() && !bench.follower.is_doubtful());
        bench
    }
}

#[test]
fn a_way_takes_as_long_as_it_does_at_constant_acceleration() {
    for (speed, acceleration, seconds) in
        [(125.0f64, 0.0, 4e-3), (125.0, 90.0, 5e-3), (31.0, 95.0, 15e-3), (40.0, -90.0, 2e-3), (500.0, 90.0, 1e-3)]
    {
        let way = speed * seconds + 0.5 * acceleration * seconds * seconds;
        let found = seconds_for(way as f32, speed as f32, acceleration as f32);
        assert!((f64::from(found) / seconds - 1.0).abs() < 1e-5, "{speed}, {acceleration}: {found}");
    }
}

#[test]
fn each_frame_is_asked_for_once_in_time_and_at_its_angle() {
    for latency in [Nanos(0), Nanos(300_000), Nanos(2_000_000)] {
        let bench = Bench::followed(latency);
        assert!(bench.asked.len() > 190, "{}", bench.asked.len());
        // The first turns teach the estimator.
        for pair in bench.asked[100..].windows(2) {
            assert_eq!(pair[1].frame, (pair[0].frame + 1) % 12);
            assert!(pair[1].in_order);
            let start = (pair[1].at + latency).0 % TURN_NS;
            let place = u64::from(pair[1].frame) * TURN_NS / 12;
            // A twentieth of a slice: an encoder whose counts never tell anything new is no better.
            assert!(start.abs_diff(place).min(TURN_NS - start.abs_diff(place)) < 9_000, "{start} for {place}");
            assert!((pair[1].plane_ns - 173_611.0).abs() < 200.0);
        }
    }
}

#[test]
fn a_frame_that_does_not_begin_as_told_is_in_doubt_within_a_plane() {
    for (pulse_off_ns, doubt) in [(0, false), (10_000, false), (40_000, true), (-40_000, true)] {
        let mut bench = Bench::followed(Nanos(0));
        let asked = bench.asked.len();
        while bench.asked.len() == asked {
            bench.run(1, true);
        }
        let start = bench.asked[asked].at;
        bench.follower.frame_pulse(Nanos(start.0.wrapping_add_signed(pulse_off_ns)));
        assert_eq!(bench.follower.is_doubtful(), doubt, "{pulse_off_ns}");
        // Two frames that agree end it.
        bench.run(50, true);
        assert!(!bench.follower.is_doubtful());
    }
    let mut silent = Bench::followed(Nanos(0));
    let asked = silent.asked.len();
    while silent.asked.len() == asked {
        silent.run(1, true);
    }
    let start = silent.asked[asked].at;
    silent.follower.coast(start + Nanos(173_000));
    assert!(!silent.follower.is_doubtful());
    silent.follower.coast(start + Nanos(174_000));
    assert!(silent.follower.is_doubtful());
}

#[test]
fn planes_that_are_lost_added_or_late_are_in_doubt() {
    let doubt = |disturb: fn(&mut Follower, Nanos, f32)| {
        let mut bench = Bench::followed(Nanos(0));
        let asked = bench.asked.len();
        while bench.asked.len() == asked {
            bench.run(1, true);
        }
        let Due { at, plane_ns, .. } = bench.asked[asked];
        disturb(&mut bench.follower, at, plane_ns);
        bench.follower.is_doubtful()
    };
    assert!(!doubt(|follower, at, ns| (0..24).for_each(|i| follower.plane_pulse(at + Nanos((i as f32 * ns) as u64)))));
    // An echo, 3 us later.
    assert!(!doubt(|follower, at, _| [0, 3_000].iter().for_each(|late| follower.plane_pulse(at + Nanos(*late)))));
    assert!(doubt(|follower, at, ns| {
        follower.plane_pulse(at);
        follower.plane_pulse(at + Nanos((2.0 * ns) as u64));
    }));
    assert!(doubt(|follower, at, ns| {
        follower.plane_pulse(at);
        follower.plane_pulse(at + Nanos((0.5 * ns) as u64));
    }));
    assert!(doubt(|follower, at, ns| {
        follower.plane_pulse(at);
        follower.plane_pulse(at + Nanos((1.2 * ns) as u64));
    }));
    // Neither frame pulse nor first plane.
    assert!(doubt(|follower, at, ns| follower.plane_pulse(at + Nanos(ns as u64))));
}

#[test]
fn a_projector_that_never_answers_is_never_known() {
    let mut bench = Bench::new(Nanos(0));
    bench.run(4_000, false);
    assert!(bench.asked.len() > 100);
    assert!(bench.follower.is_doubtful() && !bench.follower.is_known());
    assert!(bench.follower.frames_missing() > 100);
}

#[test]
fn a_parked_mirror_gets_frames_one_after_the_other() {
    let mut bench = Bench::new(Nanos(100_000));
    let mut last: Option<Nanos> = None;
    let mut count = 0;
    for tick in 1..4_000 {
        let now = Nanos(tick * TICK.0);
        bench.follower.coast(now);
        if let Some(trigger) = bench.follower.ask_parked(now) {
            let at = now + Nanos(trigger.wait_ns.into());
            assert!(at > now && last.is_none_or(|last| (at - last).0.abs_diff(4_166_666) < 1_000));
            last = Some(at);
            count += 1;
        }
    }
    assert!((235..=240).contains(&count), "{count}");
}

proptest! {
    #[test]
    fn frames_never_overlap_whatever_pulses_say(
        pulses in prop::collection::vec((0u64..400_000, 0u8..3), 0..2_000), pushes in -0.4f32..0.4,
    ) {
        let mut bench = Bench::followed(Nanos(0));
        let mut last: Option<Due> = None;
        for (late, line) in pulses {
            let at = bench.now() + Nanos(late);
            match line {
                0 => bench.follower.frame_pulse(at),
                1 => bench.follower.plane_pulse(at),
                _ => {}
            }
            bench.ticks += 1;
            let now = bench.now();
            bench.mirror.tick(now, (bench.ticks * 10) as u32, pushes);
            bench.follower.coast(now);
            if let Some(asked) = bench.follower.ask(now, &bench.mirror) {
                let due = Due::new(now, &asked);
                prop_assert!(due.at > now && due.plane_ns.is_finite());
                if let Some(Due { at, plane_ns, .. }) = last {
                    let room = due.at.signed_since(at) as f32;
                    prop_assert!(room > 23.95 * plane_ns, "{room} after {plane_ns}");
                }
                last = Some(due);
            }
        }
    }
}
