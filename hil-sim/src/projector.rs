//! The projector: a free clock, pulses that announce its frames with jitter, and light that follows the clock smoothly; or one that begins a
//! frame when told, in [`triggered`].

use crate::motor::ProjectorClock;
use crate::noise::{Noise, Source};
use firmware::plane_store::TurnHandle;
use firmware::sequencer::Frame;
use protocol::frame_mark;
use protocol::timing::Rotation;
use std::collections::VecDeque;
use video::{Video, VideoFault};

pub mod triggered;
pub mod video;

/// A projector, whoever leads it. Times in nanoseconds.
pub trait Projector: Send {
    /// Runs at another nominal rate from the next frame on, if it has one.
    fn set_rate(&mut self, hz: f64);

    /// Pulses scatter by `jitter_ns` from now on, standard deviation.
    fn set_jitter(&mut self, jitter_ns: f64);

    /// The rate that it is set to, Hz.
    fn nominal_hz(&self) -> f64;

    /// What to show in the next frame.
    fn arm(&mut self, frame: Frame);

    /// The trigger line is pulled at `at`, and told planes `plane_ns` apart. One that runs freely does not listen.
    fn trigger(&mut self, at: f64, plane_ns: f64);

    /// When a plane starts, or its light ends with none to follow at once.
    fn next_change_at(&self) -> f64;

    /// Goes on to that change; `None` where light ends.
    fn change(&mut self) -> Option<PlaneStart>;

    /// When the next frame pulse is seen.
    fn pulse_at(&self) -> f64;

    /// The pulse has been.
    fn pass_pulse(&mut self);

    /// The mark of the frame whose pulse comes next, once: when it has been read, and its number. Only where frames come as video.
    fn take_mark(&mut self) -> Option<(f64, Option<u32>)> {
        None
    }

    /// Something happens to the video, where there is one.
    fn fail_video(&mut self, _fault: VideoFault) {}
}

/// One frame of light.
#[derive(Clone, Copy, Debug)]
struct Light {
    start: f64,
    period: f64,
    /// The frame of the turn that its picture is, where it comes as video; none is a desktop.
    number: Option<u32>,
}

/// A mark has been read so long after the pulse of the frame before its own, in frames: it is in the first of the lines that a link carries.
const MARK_READ_AFTER: f64 = 0.03;

/// The clock and what is on screen. Times in nanoseconds.
#[derive(Clone, Debug)]
pub struct FreeRunning {
    planes: u32,
    period_ns: f64,
    rate_error: f64,
    wander_per_sqrt_s: f64,
    jitter_ns: f64,
    latency_ns: f64,
    rate_noise: Noise,
    pulse_noise: Noise,
    plane_noise: Noise,
    next_edge: f64,
    pulse_at: f64,
    coming: VecDeque<Light>,
    light: Light,
    next_plane: u32,
    armed: Option<Frame>,
    shown: Frame,
    video: Option<Video>,
    mark: Option<(f64, Option<u32>)>,
}

/// The start of a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneStart {
    /// Which plane of its frame.
    pub plane: u32,
    /// What the projector shows in this frame.
    pub frame: Frame,
    /// Which frame of the turn the picture is that is there to be lit, where it comes as video.
    pub number: Option<u32>,
    /// How long the plane lasts, ns.
    pub duration_ns: f64,
    /// By how much the plane's pulse is off, ns.
    pub pulse_error_ns: f64,
}

impl FreeRunning {
    /// Starts somewhere in its first frame. `latency_ns`: from a frame pulse to its first plane.
    pub fn new(rotation: &Rotation, latency_ns: f64, clock: &ProjectorClock, seed: u64) -> Self {
        let mut start = Noise::new(seed ^ 0x9e37_79b9_7f4a_7c15, Source::Start);
        let period_ns = 1e15 / rotation.refresh_microhertz() as f64;
        let mut projector = Self {
            planes: rotation.planes_per_frame(),
            period_ns,
            rate_error: clock.error_ppm * 1e-6,
            wander_per_sqrt_s: clock.wander_ppm_per_sqrt_s * 1e-6,
            jitter_ns: clock.frame_jitter_us * 1e3,
            latency_ns,
            rate_noise: Noise::new(seed, Source::ProjectorRate),
            pulse_noise: Noise::new(seed, Source::FramePulses),
            plane_noise: Noise::new(seed, Source::PlanePulses),
            next_edge: (0.1 + start.uniform()) * period_ns,
            pulse_at: 0.0,
            coming: VecDeque::new(),
            light: Light { start: 0.0, period: period_ns, number: None },
            next_plane: 0,
            armed: None,
            shown: Frame::Dark,
            video: None,
            mark: None,
        };
        projector.begin_frame();
        projector.light = projector.coming.pop_front().unwrap_or(projector.light);
        projector
    }

    /// The same where frames come as `video`: what is armed says whether they are lit, not what they are.
    pub fn showing(self, video: Video) -> Self {
        Self { video: Some(video), ..self }
    }

    fn begin_frame(&mut self) {
        let period = self.draw_period();
        let number = self.video.as_ref().and_then(Video::on_screen);
        self.coming.push_back(Light { start: self.next_edge + self.latency_ns, period, number });
        self.pulse_at = self.next_edge + self.jitter_ns * self.pulse_noise.normal();
        if let Some(video) = &mut self.video {
            let pixels = video.refresh();
            self.mark = Some((self.next_edge + MARK_READ_AFTER * period, frame_mark::read(&pixels)));
        }
        self.next_edge += period;
    }

    /// What is lit where `armed` is what the controller wants: of video, the picture that is there. A desktop is no slice of any turn.
    fn lit(&self, armed: Frame) -> Frame {
        let turn = TurnHandle::VIDEO;
        match (armed, &self.video, self.light.number) {
            (Frame::Dark | Frame::Still { .. }, ..) | (_, None, _) => armed,
            (_, Some(_), Some(number)) => Frame::Slices { turn, frame: number as u16 },
            (_, Some(_), None) => Frame::Still { turn, slice: u16::MAX },
        }
    }

    fn draw_period(&mut self) -> f64 {
        let seconds = self.period_ns * 1e-9;
        self.rate_error += self.wander_per_sqrt_s * seconds.sqrt() * self.rate_noise.normal();
        self.period_ns / (1.0 + self.rate_error)
    }
}

impl Projector for FreeRunning {
    fn set_rate(&mut self, hz: f64) {
        self.period_ns = 1e9 / hz;
    }

    fn set_jitter(&mut self, jitter_ns: f64) {
        self.jitter_ns = jitter_ns;
    }

    fn nominal_hz(&self) -> f64 {
        1e9 / self.period_ns
    }

    fn arm(&mut self, frame: Frame) {
        self.armed = Some(frame);
    }

    fn trigger(&mut self, _at: f64, _plane_ns: f64) {}

    fn next_change_at(&self) -> f64 {
        self.light.start + self.light.period * f64::from(self.next_plane) / f64::from(self.planes)
    }

    fn change(&mut self) -> Option<PlaneStart> {
        if self.next_plane == 0 {
            let armed = self.armed.take().unwrap_or_default();
            self.shown = self.lit(armed);
        }
        let start = PlaneStart {
            plane: self.next_plane,
            frame: self.shown,
            number: self.light.number,
            duration_ns: self.light.period / f64::from(self.planes),
            pulse_error_ns: self.jitter_ns * self.plane_noise.normal(),
        };
        self.next_plane += 1;
        if self.next_plane == self.planes {
            self.next_plane = 0;
            let after = Light { start: self.light.start + self.light.period, ..self.light };
            self.light = self.coming.pop_front().unwrap_or(after);
        }
        Some(start)
    }

    fn pulse_at(&self) -> f64 {
        self.pulse_at
    }

    fn pass_pulse(&mut self) {
        self.begin_frame();
    }

    fn take_mark(&mut self) -> Option<(f64, Option<u32>)> {
        self.mark.take()
    }

    fn fail_video(&mut self, fault: VideoFault) {
        if let Some(video) = &mut self.video {
            video.fail(fault);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motor::Motor;
    use protocol::timing::Direction;
    use protocol::units::Turns;

    fn projector(latency_ns: f64) -> FreeRunning {
        let rotation = Rotation::new(288, 24, 240_000_000, Turns::ZERO, Direction::Clockwise).unwrap();
        FreeRunning::new(&rotation, latency_ns, &Motor::reference().projector_clock, 11)
    }

    #[test]
    fn planes_follow_each_other_without_gaps_and_pulses_announce_them() {
        for latency_ns in [0.0, 300_000.0, 9_000_000.0] {
            let mut projector = projector(latency_ns);
            let (mut pulses, mut starts) = (Vec::new(), Vec::new());
            let mut expected = projector.next_change_at();
            while starts.len() < 200 {
                if projector.pulse_at() < projector.next_change_at() {
                    pulses.push(projector.pulse_at());
                    projector.pass_pulse();
                    continue;
                }
                let at = projector.next_change_at();
                assert!((at - expected).abs() < 1e-3);
                let plane = projector.change().unwrap();
                expected = at + plane.duration_ns;
                if plane.plane == 0 {
                    starts.push(at);
                }
            }
            for (pulse, start) in pulses.iter().zip(&starts) {
                assert!((start - pulse - latency_ns).abs() < 12_000.0);
            }
            let rate_hz = 199.0 * 1e9 / (starts[199] - starts[0]);
            assert!(((rate_hz / 240.0 - 1.0) * 1e6 - 50.0).abs() < 5.0, "{rate_hz}");
        }
    }

    #[test]
    fn what_is_armed_is_shown_once() {
        let mut projector = projector(0.0);
        let frame = Frame::Still { turn: firmware::plane_store::TurnHandle(1), slice: 3 };
        projector.arm(frame);
        let shown: Vec<Frame> = (0..48)
            .map(|_| {
                if projector.pulse_at() < projector.next_change_at() {
                    projector.pass_pulse();
                }
                projector.change().unwrap().frame
            })
            .collect();
        assert_eq!(shown[..24], [frame; 24]);
        assert_eq!(shown[24..], [Frame::Dark; 24]);
    }
}
