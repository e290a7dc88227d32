//! A projector that begins a frame when told, and shows its planes as far apart as told.

use super::{PlaneStart, Projector};
use crate::motor::ProjectorClock;
use crate::noise::{Noise, Source};
use firmware::follower::LIT_SHARE;
use firmware::sequencer::Frame;
use protocol::timing::Rotation;
use std::collections::VecDeque;

/// By how much light answers a trigger sooner or later than its latency, ns, standard deviation: as the index's own jitter.
const RESPONSE_JITTER_NS: f64 = 500.0;

/// A frame that was told to begin.
#[derive(Clone, Copy, Debug)]
struct Burst {
    start: f64,
    plane_ns: f64,
}

/// The trigger line and what is on screen. Times in nanoseconds.
#[derive(Clone, Debug)]
pub struct Triggered {
    planes: u32,
    nominal_hz: f64,
    latency_ns: f64,
    jitter_ns: f64,
    response_noise: Noise,
    pulse_noise: Noise,
    plane_noise: Noise,
    free_at: f64,
    pulses: VecDeque<f64>,
    bursts: VecDeque<Burst>,
    /// Half planes of the first burst that have been: a plane's light, then the dark after it.
    halves: u32,
    armed: Option<Frame>,
    shown: Frame,
    refused: u64,
}

impl Triggered {
    /// Dark, and waits. `latency_ns`: from a trigger to its first plane.
    pub fn new(rotation: &Rotation, latency_ns: f64, clock: &ProjectorClock, seed: u64) -> Self {
        Self {
            planes: rotation.planes_per_frame(),
            nominal_hz: rotation.refresh_microhertz() as f64 * 1e-6,
            latency_ns,
            jitter_ns: clock.frame_jitter_us * 1e3,
            response_noise: Noise::new(seed, Source::Trigger),
            pulse_noise: Noise::new(seed, Source::FramePulses),
            plane_noise: Noise::new(seed, Source::PlanePulses),
            free_at: f64::NEG_INFINITY,
            pulses: VecDeque::new(),
            bursts: VecDeque::new(),
            halves: 0,
            armed: None,
            shown: Frame::Dark,
            refused: 0,
        }
    }

    /// Triggers that came before the last frame's light had ended.
    pub fn refused(&self) -> u64 {
        self.refused
    }
}

impl Projector for Triggered {
    fn set_rate(&mut self, _hz: f64) {}

    fn set_jitter(&mut self, jitter_ns: f64) {
        self.jitter_ns = jitter_ns;
    }

    fn nominal_hz(&self) -> f64 {
        self.nominal_hz
    }

    fn arm(&mut self, frame: Frame) {
        self.armed = Some(frame);
    }

    fn trigger(&mut self, at: f64, plane_ns: f64) {
        let at = at + RESPONSE_JITTER_NS * self.response_noise.normal();
        let start = at + self.latency_ns;
        if start < self.free_at {
            self.refused += 1;
            return;
        }
        self.free_at = start + (f64::from(self.planes - 1) + f64::from(LIT_SHARE)) * plane_ns;
        self.pulses.push_back(at + self.jitter_ns * self.pulse_noise.normal());
        self.bursts.push_back(Burst { start, plane_ns });
    }

    fn next_change_at(&self) -> f64 {
        self.bursts.front().map_or(f64::INFINITY, |burst| {
            let within = if self.halves.is_multiple_of(2) { 0.0 } else { f64::from(LIT_SHARE) };
            burst.start + (f64::from(self.halves / 2) + within) * burst.plane_ns
        })
    }

    fn change(&mut self) -> Option<PlaneStart> {
        let burst = *self.bursts.front()?;
        let half = self.halves;
        self.halves += 1;
        if self.halves == 2 * self.planes {
            (self.halves, _) = (0, self.bursts.pop_front());
        }
        if !half.is_multiple_of(2) {
            return None;
        }
        if half == 0 {
            self.shown = self.armed.take().unwrap_or_default();
        }
        Some(PlaneStart {
            plane: half / 2,
            frame: self.shown,
            number: None,
            duration_ns: burst.plane_ns,
            pulse_error_ns: self.jitter_ns * self.plane_noise.normal(),
        })
    }

    fn pulse_at(&self) -> f64 {
        self.pulses.front().copied().unwrap_or(f64::INFINITY)
    }

    fn pass_pulse(&mut self) {
        self.pulses.pop_front();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motor::Motor;
    use firmware::plane_store::TurnHandle;
    use protocol::timing::Direction;
    use protocol::units::Turns;

    const PLANE_NS: f64 = 200_000.0;

    fn projector() -> Triggered {
        let rotation = Rotation::new(288, 24, 240_000_000, Turns::ZERO, Direction::Clockwise).unwrap();
        Triggered::new(&rotation, 50_000.0, &Motor::reference().projector_clock, 5)
    }

    #[test]
    fn a_frame_has_its_planes_where_it_was_told_and_is_shown_once() {
        let mut projector = projector();
        assert_eq!((projector.next_change_at(), projector.pulse_at()), (f64::INFINITY, f64::INFINITY));
        let frame = Frame::Still { turn: TurnHandle(1), slice: 3 };
        projector.arm(frame);
        projector.trigger(1e6, PLANE_NS);
        assert!((projector.pulse_at() - 1e6).abs() < 15_000.0);
        for plane in 0..24 {
            let place = 1.05e6 + f64::from(plane) * PLANE_NS;
            assert!((projector.next_change_at() - place).abs() < 5.0 * RESPONSE_JITTER_NS);
            let start = projector.change().unwrap();
            assert_eq!((start.plane, start.frame, start.duration_ns), (plane, frame, PLANE_NS));
            assert!((projector.next_change_at() - place - 0.95 * PLANE_NS).abs() < 5.0 * RESPONSE_JITTER_NS);
            assert_eq!(projector.change(), None);
        }
        assert_eq!(projector.next_change_at(), f64::INFINITY);
        projector.trigger(1e7, PLANE_NS);
        assert_eq!(projector.change().unwrap().frame, Frame::Dark);
    }

    #[test]
    fn a_trigger_that_comes_before_the_light_has_ended_is_refused() {
        let mut projector = projector();
        projector.trigger(1e6, PLANE_NS);
        projector.trigger(1e6 + 23.9 * PLANE_NS, PLANE_NS);
        assert_eq!(projector.refused(), 1);
        projector.trigger(1e6 + 23.99 * PLANE_NS, PLANE_NS);
        assert_eq!((projector.refused(), projector.bursts.len()), (1, 2));
    }
}
