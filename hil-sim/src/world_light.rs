//! What is lit in a world, and where.

use super::{Pulse, Sample, World};
use crate::checkers::Flash;
use crate::projector::PlaneStart;
use firmware::plane_store::Plane;
use protocol::message::State;
use protocol::units::Nanos;
use std::f64::consts::TAU;

impl World {
    pub(super) fn change_light(&mut self, at: f64, angle: f64) {
        let change = self.projector.change();
        self.between_planes = change.is_none();
        match change {
            Some(start) => self.start_plane(at, angle, start),
            None => self.relight(at, angle, false),
        }
    }

    fn start_plane(&mut self, at: f64, angle: f64, start: PlaneStart) {
        if !self.plane_was_lit {
            self.collector.dark_plane();
        }
        self.plane_was_lit = false;
        self.on_screen = start.frame.plane(&self.rotation, start.plane);
        let unmeasured = self.output.state == State::OpenLoop;
        let phase = self.checkers.phase().filter(|_| unmeasured);
        let progress = self.sign * (angle - self.rotation.phase_offset().radians()) / TAU - phase.unwrap_or(0.0);
        let planes = f64::from(self.rotation.planes_per_frame());
        let frames = (progress * f64::from(self.rotation.slices()) - f64::from(start.plane)) / planes;
        // A frame that says which it is belongs in one place, any other in the nearest.
        let [apart, off] = match start.number {
            Some(number) => [f64::from(self.rotation.frames()), frames - f64::from(number)],
            None => [1.0, frames],
        };
        let error_slices = (off - apart * (off / apart).round()) * planes;
        // Where planes belong that nothing measures is not known before some have been seen.
        let light = self.output.light && (phase.is_some() || !unmeasured);
        self.collector.plane(at * 1e-9, error_slices, start.duration_ns, self.output.state, light);
        self.sample(at, error_slices);
        self.relight(at, angle, true);
        if self.plane_faults.passes(at) {
            // Light and pulse start together; a stamp may be early, its arrival not.
            let stamp_ns = at + start.pulse_error_ns;
            let echo = self.plane_faults.echo(stamp_ns);
            let pulse = |stamp_ns: f64| (at.max(stamp_ns), Pulse::Plane { stamp_ns });
            self.pulses.extend([stamp_ns].into_iter().chain(echo).map(pulse));
        }
    }

    fn sample(&mut self, at: f64, error_slices: f64) {
        let every = u64::from(self.recording.sample_every.max(1));
        if self.samples.len() < self.recording.samples_max && self.collector.planes().is_multiple_of(every) {
            let (speed_rad_s, state) = (self.plant.speed(), self.output.state);
            self.samples.push(Sample { at_s: at * 1e-9, error_slices, speed_rad_s, state });
        }
    }

    /// Ends the flash that was lit and begins the one that is, if anything changed.
    pub(super) fn relight(&mut self, at: f64, angle: f64, new_plane: bool) {
        let shown = self.output.light && self.on_screen != Plane::Dark && !self.between_planes;
        let wanted = shown.then_some((self.on_screen, self.output.state));
        if !new_plane && self.lit.map(|flash| (flash.plane, flash.state)) == wanted {
            return;
        }
        let now = Nanos((at + 0.5) as u64);
        if let Some(mut flash) = self.lit.take() {
            (flash.end, flash.angle_end) = (now, angle);
            if flash.end > flash.start {
                self.checkers.see(&flash);
                self.keep(flash);
            }
        }
        self.plane_was_lit |= wanted.is_some();
        self.lit = wanted.map(|(plane, state)| Flash {
            start: now,
            end: now,
            angle_start: angle,
            angle_end: angle,
            plane,
            state,
        });
    }

    fn keep(&mut self, flash: Flash) {
        if self.recording.flashes_max == 0 {
            return;
        }
        if self.flashes.len() == self.recording.flashes_max {
            self.flashes.pop_front();
        }
        self.flashes.push_back(flash);
    }
}
