//! What a scenario's actions do to a world.

use super::{Pulse, World};
use crate::scenario::Action;
use firmware::controller::{Input, Output};
use firmware::safety::Levels;
use protocol::message::Command;
use protocol::units::Turns;

impl World {
    /// The host commands something now.
    pub fn command(&mut self, command: Command) {
        match command {
            Command::Start => self.disturbed("start"),
            Command::Stop => self.collector.stopped(self.now * 1e-9),
            Command::ShiftPhase { shift } => self.checkers.turn_picture(f64::from(shift) / 4_294_967_296.0),
            _ => {}
        }
        self.feed(self.now, Input::Command(command));
    }

    /// Does what the controller wants now, which its host has asked of it and not this world.
    pub fn obey_now(&mut self, output: Output) {
        self.obey(self.now, self.plant.angle(), output);
    }

    /// Something happens now.
    pub fn act(&mut self, action: Action) {
        let later = |seconds: f64| self.now + seconds * 1e9;
        match action {
            Action::Start => self.command(Command::Start),
            Action::Stop => self.command(Command::Stop),
            Action::ClearFault => self.command(Command::ClearFault),
            Action::ShiftPhase { turns } => {
                self.command(Command::ShiftPhase { shift: Turns::from_turns(turns).0 as i32 });
            }
            Action::Service { slice, duration_ms } => self.command(Command::Service { slice, duration_ms }),
            Action::EmergencyStop => self.set_levels(Levels { emergency_stop: true, ..self.levels }),
            Action::EmergencyStopReleased => self.set_levels(Levels { emergency_stop: false, ..self.levels }),
            Action::GuardOpened => self.set_levels(Levels { guard_open: true, ..self.levels }),
            Action::GuardClosed => self.set_levels(Levels { guard_open: false, ..self.levels }),
            Action::LoseFramePulses { count } => self.frame_faults.lose(count),
            Action::NoFramePulses { seconds } => self.frame_faults.silence(later(seconds)),
            Action::ExtraFramePulse => self.pulses.push((self.now, Pulse::Frame)),
            Action::LosePlanePulses { count } => self.plane_faults.lose(count),
            Action::NoPlanePulses { seconds } => self.plane_faults.silence(later(seconds)),
            Action::ExtraPlanePulse => self.pulses.push((self.now, Pulse::Plane { stamp_ns: self.now })),
            Action::LoseIndexPulses { count } => self.index_faults.lose(count),
            Action::NoIndexPulses { seconds } => self.index_faults.silence(later(seconds)),
            Action::ExtraIndexPulse => self.pulses.push((self.now, Pulse::Index)),
            Action::EncoderSlip { counts } => self.encoder_faults.slip(i64::from(counts)),
            Action::EncoderFrozen { seconds } => self.encoder_faults.freeze(later(seconds)),
            Action::Video(fault) => self.projector.fail_video(fault),
            Action::ProjectorRate { hz } => {
                self.projector.set_rate(hz);
                self.checkers.set_turn_duration(1e9 * f64::from(self.rotation.frames()) / hz);
            }
            Action::PulseJitter { us } => self.projector.set_jitter(us * 1e3),
            Action::DoubledPulses { seconds } => {
                let until = later(seconds);
                for faults in [&mut self.frame_faults, &mut self.plane_faults, &mut self.index_faults] {
                    faults.double(until);
                }
            }
            Action::TorqueLimit { share } => self.plant.limit_torque(share),
            Action::Load { torque_nm } => self.plant.set_load(self.sign * torque_nm),
            Action::NoControlTicks { seconds } => self.ticks_silent_until = later(seconds),
        }
        if !matches!(action, Action::Start | Action::Stop | Action::ClearFault | Action::Service { .. }) {
            self.disturbed(&format!("{action:?}"));
        }
    }

    pub(super) fn disturbed(&mut self, cause: &str) {
        let speed = std::f64::consts::TAU * self.projector.nominal_hz() / f64::from(self.rotation.frames());
        let torque_limited_s = self.plant.torque_limited_seconds(self.sign * speed);
        self.collector.disturbed(cause.to_owned(), self.now * 1e-9, torque_limited_s);
    }

    fn set_levels(&mut self, levels: Levels) {
        self.levels = levels;
        self.feed(self.now, Input::Levels(levels));
    }
}
