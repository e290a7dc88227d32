use super::*;
use crate::config::tests::example;
use protocol::timing::Direction;

/// Pulses of a clock that runs `ppm` fast, with a triangular jitter of a few microseconds that does not repeat.
struct Clock {
    sync: ProjectorSync,
    period_ns: f64,
    next_ns: f64,
    noise: u32,
}

impl Clock {
    fn new(ppm: f64) -> Self {
        let sync = ProjectorSync::new(&example(288, 240, Direction::Clockwise));
        Self { sync, period_ns: 1e9 / 240.0 / (1.0 + ppm * 1e-6), next_ns: 1e6, noise: 1 }
    }

    fn jitter_ns(&mut self) -> f64 {
        let mut uniform = || {
            self.noise = self.noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(self.noise >> 8) / f64::from(1 << 24) - 0.5
        };
        (uniform() + uniform()) * 4_900.0
    }

    fn tick(&mut self) -> Pulse {
        let at = Nanos((self.next_ns + self.jitter_ns()) as u64);
        self.next_ns += self.period_ns;
        self.sync.coast(at);
        self.sync.pulse(at)
    }

    fn skip(&mut self, frames: u32) {
        for _ in 0..frames {
            self.next_ns += self.period_ns;
            self.sync.coast(Nanos(self.next_ns as u64 - 1_000_000));
        }
    }

    /// Estimated less true phase in nanoseconds, at the last true edge.
    fn error_ns(&self) -> f32 {
        let reading = self.sync.reading(Nanos((self.next_ns - self.period_ns) as u64)).unwrap();
        let fraction = if reading.fraction > 0.5 { reading.fraction - 1.0 } else { reading.fraction };
        fraction * self.sync.period_ns()
    }
}

#[test]
fn a_clock_with_known_error_is_estimated() {
    let mut clock = Clock::new(50.0);
    let mut squares = 0.0;
    for frame in 0..4_800 {
        assert_ne!(clock.tick(), Pulse::Refused);
        if frame >= 2_400 {
            squares += clock.error_ns() * clock.error_ns();
        }
    }
    let rms_ns = (squares / 2_400.0).sqrt();
    assert!(rms_ns < 450.0, "{rms_ns}");
    let ppm = (clock.period_ns as f32 / clock.sync.period_ns() - 1.0) * 1e6;
    assert!(ppm.abs() < 2.0, "{ppm}");
}

#[test]
fn three_agreeing_intervals_start_the_clock() {
    let mut clock = Clock::new(0.0);
    let pulses = [clock.tick(), clock.tick(), clock.tick(), clock.tick(), clock.tick()];
    use Pulse::{Accepted, Restarted, Searching};
    assert_eq!(pulses, [Searching, Searching, Searching, Restarted, Accepted]);
}

#[test]
fn a_lost_pulse_is_bridged_and_an_extra_one_refused() {
    let mut clock = Clock::new(20.0);
    for _ in 0..500 {
        clock.tick();
    }
    let before = clock.sync.reading(Nanos((clock.next_ns - 0.5 * clock.period_ns) as u64)).unwrap();
    clock.skip(1);
    assert_eq!(clock.tick(), Pulse::Accepted);
    let after = clock.sync.reading(Nanos((clock.next_ns - 0.5 * clock.period_ns) as u64)).unwrap();
    assert_eq!(after.frame, (before.frame + 2) % 12);
    let extra = Nanos((clock.next_ns - 0.6 * clock.period_ns) as u64);
    assert_eq!(clock.sync.pulse(extra), Pulse::Refused);
    assert!(clock.sync.is_doubtful());
    assert_eq!(clock.tick(), Pulse::Accepted);
    assert!(!clock.sync.is_doubtful());
    assert!(clock.error_ns().abs() < 2_000.0);
}

#[test]
fn ten_seconds_of_silence_stay_within_a_tenth_of_a_slice() {
    let mut clock = Clock::new(50.0);
    for _ in 0..2_400 {
        clock.tick();
    }
    clock.skip(2_400);
    assert_eq!(clock.sync.frames_missing(), 2_400);
    // A slice is 173 611 ns.
    assert!(clock.error_ns().abs() < 17_000.0, "{}", clock.error_ns());
    assert!(clock.sync.sigma_frames() * 24.0 < 0.3);
}

#[test]
fn a_new_rate_is_found_after_three_intervals() {
    for new_hz in [180.0, 120.0, 480.0, 241.0, 239.9, 238.0, 720.0] {
        let mut clock = Clock::new(0.0);
        for _ in 0..300 {
            clock.tick();
        }
        clock.period_ns = 1e9 / new_hz;
        let mut pulses = 0;
        // The pulse that is already on its way keeps its time.
        while clock.tick() != Pulse::Restarted {
            pulses += 1;
            assert!(pulses < 20, "{new_hz}");
        }
        for _ in 0..100 {
            assert_eq!(clock.tick(), Pulse::Accepted, "{new_hz}");
        }
        assert!((clock.sync.period_ns() * new_hz as f32 * 1e-9 - 1.0).abs() < 1e-4, "{new_hz}");
    }
}

#[test]
fn time_that_runs_backwards_is_refused() {
    let mut clock = Clock::new(0.0);
    for _ in 0..10 {
        clock.tick();
    }
    assert_eq!(clock.sync.pulse(Nanos(5)), Pulse::Refused);
    assert_eq!(clock.tick(), Pulse::Accepted);
}

#[test]
fn a_plane_pulse_contradicts_a_clock_that_stepped() {
    for (stretch, doubtful) in [(1.0, false), (1.002, false), (4.0 / 3.0, true), (0.75, true), (1.2, true), (2.0, true)]
    {
        let mut clock = Clock::new(50.0);
        (0..100).for_each(|_| {
            clock.tick();
        });
        let edge = clock.next_ns - clock.period_ns;
        let doubted_after = (0..24).find(|plane| {
            let at = edge + f64::from(*plane) * clock.period_ns / 24.0 * stretch + clock.jitter_ns();
            clock.sync.plane_pulse(Nanos(at as u64));
            clock.sync.is_doubtful()
        });
        assert_eq!(doubted_after.is_some(), doubtful, "{stretch}");
        // As soon as a plane starts in a wrong place.
        assert!(doubted_after.is_none_or(|plane| f64::from(plane) * (stretch - 1.0).abs() <= 1.0), "{stretch}");
        // A frame in which everything agrees ends the doubt.
        clock.tick();
        clock.tick();
        assert!(!clock.sync.is_doubtful());
    }
}

#[test]
fn planes_tell_a_new_rate_within_their_frame() {
    for stretch in [4.0 / 3.0, 0.75, 1.2] {
        let mut clock = Clock::new(50.0);
        (0..100).for_each(|_| {
            clock.tick();
        });
        let edge = clock.next_ns - clock.period_ns;
        let plane_ns = clock.period_ns / 24.0;
        for plane in -10..10 {
            let at = edge + f64::from(plane) * plane_ns * if plane < 0 { 1.0 } else { stretch };
            clock.sync.plane_pulse(Nanos(at as u64));
        }
        let told = f64::from(clock.sync.period_ns()) / clock.period_ns;
        assert!((told / stretch - 1.0).abs() < 3e-3, "{stretch}: {told}");
        assert!(clock.sync.is_doubtful());
        clock.period_ns *= stretch;
        clock.next_ns = edge + clock.period_ns;
        assert_eq!(clock.tick(), Pulse::Accepted);
        assert!(!clock.sync.is_doubtful());
    }
}

#[test]
fn planes_that_begin_nowhere_tell_nothing() {
    let mut clock = Clock::new(50.0);
    (0..100).for_each(|_| {
        clock.tick();
    });
    let (edge, period_ns) = (clock.next_ns - clock.period_ns, clock.sync.period_ns());
    for plane in 0..20 {
        clock.sync.plane_pulse(Nanos((edge + 90_000.0 + f64::from(plane) * 231_481.0) as u64));
    }
    assert_eq!(clock.sync.period_ns(), period_ns);
    assert!(clock.sync.is_doubtful());
}

#[test]
fn pulses_that_scatter_more_than_was_told_are_learnt_and_forgotten() {
    let mut clock = Clock::new(50.0);
    (0..100).for_each(|_| {
        clock.tick();
    });
    let scatter = |clock: &mut Clock, times: f64| {
        let at = Nanos((clock.next_ns + times * clock.jitter_ns()) as u64);
        clock.next_ns += clock.period_ns;
        clock.sync.coast(at);
        clock.sync.pulse(at)
    };
    let refused = |clock: &mut Clock, times: f64| (0..100).filter(|_| scatter(clock, times) == Pulse::Refused).count();
    assert_ne!(refused(&mut clock, 8.0), 0);
    assert_eq!(refused(&mut clock, 8.0), 0);
    (0..300).for_each(|_| {
        scatter(&mut clock, 1.0);
    });
    assert_ne!(refused(&mut clock, 8.0), 0);
}

#[test]
fn a_serial_number_wraps_early_and_nothing_else_is_seen_of_it() {
    let mut clock = Clock::new(50.0);
    let mut last: Option<ClockReading> = None;
    let mut wraps = 0;
    for _ in 0..1_000 {
        clock.tick();
        let reading = clock.sync.reading(Nanos((clock.next_ns - 0.5 * clock.period_ns) as u64));
        if let (Some(last), Some(reading)) = (last, reading) {
            assert_eq!(reading.serial, last.serial.wrapping_add(1));
            assert_eq!(reading.frame, (last.frame + 1) % 12);
            assert!((reading.fraction - 0.5).abs() < 0.01);
            wraps += u32::from(reading.serial < last.serial);
        }
        last = reading.or(last);
    }
    assert_eq!(wraps, 1);
}
