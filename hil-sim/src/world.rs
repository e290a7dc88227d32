//! Mirror, projector, sensors and controller under one clock.
//!
//! The mirror is integrated from control tick to control tick (or to whatever changes its torque in between); everything else happens
//! at its own exact time within such a stretch, at the angle that the mirror had then. Nothing in here tells the controller the truth.

use crate::checkers::{Checkers, Flash};
use crate::faults::{CounterFaults, PulseFaults};
use crate::motor::Motor;
use crate::plant::{Plant, Stretch};
use crate::projector::triggered::Triggered;
use crate::projector::video::Video;
use crate::projector::{FreeRunning, Projector};
use crate::scenario::{Action, Scenario};
use crate::sensors::{Encoder, Index};
use crate::speed_drive::SpeedDrive;
use crate::statistics::Collector;
use firmware::config::{Config, ConfigError};
use firmware::controller::{Controller, Estimates, Input, Output};
use firmware::fault_log::FaultLog;
use firmware::follower::Trigger;
use firmware::hosted::Screen;
use firmware::pacing::Pacing;
use firmware::plane_store::{Plane, TurnHandle};
use firmware::safety::Levels;
use protocol::message::{Faults, State};
use protocol::timing::{Direction, Rotation};
use protocol::units::Nanos;
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Whatever steps as the controller does: the native core, an image in an emulator, a board. One that fails keeps its error and
/// answers with what is safe: no torque, no light.
pub trait Core {
    /// Takes one input.
    fn step(&mut self, now: Nanos, input: Input) -> Output;

    /// What it believes.
    fn estimates(&self) -> Estimates;

    /// Its faults so far; of one that does not tell, none.
    fn faults(&self) -> Faults {
        FaultLog::default().faults()
    }
}

impl Core for Controller {
    fn step(&mut self, now: Nanos, input: Input) -> Output {
        Controller::step(self, now, input)
    }

    fn estimates(&self) -> Estimates {
        Controller::estimates(self)
    }

    fn faults(&self) -> Faults {
        Controller::faults(self).faults()
    }
}

/// What a world keeps for later. Nothing, unless asked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recording {
    /// Keep this many flashes; the oldest go first.
    pub flashes_max: usize,
    /// Keep this many samples of the phase error; sampling stops there.
    pub samples_max: usize,
    /// Sample every so many planes; 0 is 1.
    pub sample_every: u32,
}

/// The one command that repeats a run: a rig's name or file, and the files of motor and scenario.
pub fn repeat_command(rig: &str, motor: &str, scenario: &str, seconds: f64, seed: u64) -> String {
    format!("praxi sim --rig {rig} --motor {motor} --scenario {scenario} --seconds {seconds} --seed {seed}")
}

/// One sample of the phase error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Seconds since the start.
    pub at_s: f64,
    /// True mirror angle less where the plane on screen belongs, modulo a frame, in slices.
    pub error_slices: f64,
    /// True speed, rad/s, counter-clockwise positive.
    pub speed_rad_s: f64,
    /// What the controller said that it was doing.
    pub state: State,
}

/// The world.
pub struct World {
    pub(crate) rotation: Rotation,
    sign: f64,
    tick_ns: f64,
    delay_ns: f64,
    plant: Plant,
    encoder: Encoder,
    index: Index,
    projector: Box<dyn Projector>,
    /// What turns a mirror that nothing measures.
    drive: Option<SpeedDrive>,
    core: Box<dyn Core + Send>,
    now: f64,
    ticks: u64,
    torques: VecDeque<(f64, f64)>,
    pulses: Vec<(f64, Pulse)>,
    output: Output,
    lit: Option<Flash>,
    plane_was_lit: bool,
    on_screen: Plane,
    /// The light of what is on screen is over, and nothing else is yet.
    between_planes: bool,
    released: Vec<TurnHandle>,
    pub(crate) screen: Screen,

    actions: VecDeque<(f64, Action)>,
    levels: Levels,
    frame_faults: PulseFaults,
    plane_faults: PulseFaults,
    index_faults: PulseFaults,
    encoder_faults: CounterFaults,
    ticks_silent_until: f64,
    /// What the controller's clock showed at the start, ns, and its counter.
    epoch: (u64, u32),

    checkers: Checkers,
    collector: Collector,
    recording: Recording,
    flashes: VecDeque<Flash>,
    samples: Vec<Sample>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Pulse {
    Frame,
    Index,
    /// The mark of the frame that comes next has been read.
    Mark(Option<u32>),
    /// A plane's, with the time by which the controller is stamped it.
    Plane {
        stamp_ns: f64,
    },
}

impl World {
    /// A world with the native controller, configured from `motor` and not from what `scenario` makes of it.
    pub fn new(
        rotation: &Rotation,
        frame_latency: Nanos,
        motor: &Motor,
        scenario: &Scenario,
        seed: u64,
    ) -> Result<Self, ConfigError> {
        let config = motor.firmware_config(rotation, frame_latency);
        let controller = Controller::new(Config { pacing: scenario.pacing, ..config })?;
        Ok(Self::with_core(rotation, frame_latency, motor, scenario, seed, Box::new(controller)))
    }

    /// A world around any core.
    pub fn with_core(
        rotation: &Rotation,
        frame_latency: Nanos,
        motor: &Motor,
        scenario: &Scenario,
        seed: u64,
        core: Box<dyn Core + Send>,
    ) -> Self {
        let mut plant = Plant::new(&motor.plant, seed);
        plant.scale(scenario.plant.inertia, scenario.plant.friction);
        let (latency_ns, clock) = (frame_latency.0 as f64, &motor.projector_clock);
        let projector: Box<dyn Projector> = match scenario.pacing {
            Pacing::SensorLocked => Box::new(Triggered::new(rotation, latency_ns, clock, seed)),
            Pacing::FrameLocked | Pacing::FixedSpeed => Box::new(FreeRunning::new(rotation, latency_ns, clock, seed)),
            Pacing::VideoLocked => {
                // Nothing in the rig says with which frame a host begins.
                let video = Video::new(rotation, (seed % u64::from(rotation.frames())) as u32, seed);
                Box::new(FreeRunning::new(rotation, latency_ns, clock, seed).showing(video))
            }
        };
        let unmeasured = scenario.pacing == Pacing::FixedSpeed;
        Self {
            rotation: *rotation,
            sign: match rotation.direction() {
                Direction::CounterClockwise => 1.0,
                Direction::Clockwise => -1.0,
            },
            tick_ns: 1e9 / motor.controller.rate_hz,
            delay_ns: motor.plant.command_delay_us * 1e3,
            plant,
            encoder: Encoder::new(&motor.sensors, seed),
            index: Index::new(&motor.sensors, seed),
            projector,
            drive: unmeasured.then(|| SpeedDrive::new(&motor.plant, &motor.speed_drive)),
            core,
            now: 0.0,
            ticks: 0,
            torques: VecDeque::new(),
            pulses: Vec::new(),
            output: Output::default(),
            lit: None,
            plane_was_lit: false,
            on_screen: Plane::Dark,
            between_planes: false,
            released: Vec::new(),
            screen: Screen::default(),
            actions: scenario.events.iter().map(|event| (event.at_s * 1e9, event.action)).collect(),
            levels: Levels::default(),
            frame_faults: PulseFaults::default(),
            plane_faults: PulseFaults::default(),
            index_faults: PulseFaults::default(),
            encoder_faults: CounterFaults::default(),
            ticks_silent_until: 0.0,
            epoch: (
                scenario.counters.time_ns,
                match rotation.direction() {
                    Direction::CounterClockwise => scenario.counters.encoder_counts_to_wrap.wrapping_neg(),
                    Direction::Clockwise => scenario.counters.encoder_counts_to_wrap,
                },
            ),
            checkers: Checkers::new(rotation),
            collector: match scenario.pacing {
                Pacing::SensorLocked => Collector::following(),
                Pacing::FrameLocked | Pacing::VideoLocked | Pacing::FixedSpeed => Collector::default(),
            },
            recording: Recording::default(),
            flashes: VecDeque::new(),
            samples: Vec::new(),
        }
    }

    /// The host has filled the slot `turn`.
    pub fn turn_ready(&mut self, turn: TurnHandle) {
        self.feed(self.now, Input::TurnReady(turn));
    }

    /// Turns of another cut are to come: those that it has come back, where nothing is driven or lit.
    pub fn vacate(&mut self) {
        self.feed(self.now, Input::Vacate);
    }

    /// Moves on by `seconds`.
    pub fn advance(&mut self, seconds: f64) {
        let until = self.now + seconds * 1e9;
        while self.now < until {
            self.stretch(until);
        }
    }

    /// Moves on until `done` or for `seconds`; whether it was done.
    pub fn advance_until(&mut self, seconds: f64, mut done: impl FnMut(&Self) -> bool) -> bool {
        let until = self.now + seconds * 1e9;
        while self.now < until {
            if done(self) {
                return true;
            }
            self.stretch(until);
        }
        done(self)
    }

    fn next_tick(&self) -> f64 {
        self.ticks as f64 * self.tick_ns
    }

    /// One stretch of the mirror under a constant command, with all that happens in it.
    fn stretch(&mut self, until: f64) {
        let from = self.now;
        while self.torques.front().is_some_and(|&(at, _)| at <= from) {
            let (_, torque) = self.torques.pop_front().unwrap_or_default();
            self.plant.set_command(torque);
        }
        let arrival = self.torques.front().map_or(f64::INFINITY, |&(at, _)| at);
        let action = self.actions.front().map_or(f64::INFINITY, |&(at, _)| at.max(from));
        let longest = from + self.plant.longest_step() * 1e9;
        let to = until.min(self.next_tick().max(from)).min(arrival).min(action).min(longest);
        let seconds = (to - from) * 1e-9;
        if let Some(drive) = &mut self.drive {
            let torque = drive.torque(seconds, self.plant.angle(), self.plant.speed());
            self.plant.set_command(torque);
        }
        let stretch = self.plant.advance(seconds);
        self.pass_index(from, &stretch);
        loop {
            let (frame, plane) = (self.projector.pulse_at(), self.projector.next_change_at());
            let (waiting, index) = self.first_pulse();
            let first = frame.min(plane).min(waiting);
            if first > to {
                break;
            }
            if first == plane {
                self.change_light(plane.max(from), stretch.angle((plane.max(from) - from) * 1e-9));
            } else if first == frame {
                self.projector.pass_pulse();
                self.pulses.extend(self.projector.take_mark().map(|(at, number)| (at, Pulse::Mark(number))));
                if self.frame_faults.passes(frame) {
                    let echo = self.frame_faults.echo(frame.max(from)).map(|at| (at, Pulse::Frame));
                    self.pulses.extend([(frame.max(from), Pulse::Frame)].into_iter().chain(echo));
                }
            } else if let Some(index) = index {
                let (at, pulse) = self.pulses.swap_remove(index);
                self.deliver(at, pulse, stretch.angle((at.max(from) - from) * 1e-9));
            }
        }
        self.now = to;
        while self.actions.front().is_some_and(|&(at, _)| at <= to) {
            if let Some((_, action)) = self.actions.pop_front() {
                self.act(action);
            }
        }
        if to >= self.next_tick() {
            self.tick();
        }
    }

    fn first_pulse(&self) -> (f64, Option<usize>) {
        let first = self.pulses.iter().enumerate().min_by(|(_, a), (_, b)| a.0.total_cmp(&b.0));
        first.map_or((f64::INFINITY, None), |(i, &(at, _))| (at, Some(i)))
    }

    fn tick(&mut self) {
        self.ticks += 1;
        if self.now < self.ticks_silent_until {
            return;
        }
        // A drive that keeps its own speed has no encoder.
        let count = if self.drive.is_none() { self.encoder.count(self.plant.angle()) } else { 0 };
        let encoder_count = self.encoder_faults.read(self.now, count).wrapping_add(self.epoch.1);
        self.feed(self.now, Input::Tick { encoder_count });
    }

    /// The index, wherever the mirror passed it in this stretch.
    fn pass_index(&mut self, from: f64, stretch: &Stretch) {
        let offset = self.rotation.phase_offset().radians();
        let [start, end] = stretch.ends().map(|angle| (angle - offset) / TAU);
        let passed = if end > start { end.floor() } else { start.floor() };
        if start.floor() == end.floor() || self.drive.is_some() {
            return;
        }
        let at = from + stretch.time_of(passed * TAU + offset) * 1e9 + self.index.lateness();
        if self.index_faults.passes(at) {
            let echo = self.index_faults.echo(at).map(|at| (at, Pulse::Index));
            self.pulses.extend([(at, Pulse::Index)].into_iter().chain(echo));
        }
    }

    fn deliver(&mut self, at: f64, pulse: Pulse, angle: f64) {
        let stamp = |at: f64| self.stamp(at);
        let input = match pulse {
            Pulse::Frame => Input::FramePulse { at: stamp(at) },
            Pulse::Index => Input::IndexPulse { at: stamp(at) },
            Pulse::Mark(number) => Input::FrameMark { at: stamp(at), number },
            Pulse::Plane { stamp_ns } => Input::PlanePulse { at: stamp(stamp_ns) },
        };
        self.feed_at(at.max(self.now), angle, input);
    }

    /// The controller's time at `at`.
    fn stamp(&self, at: f64) -> Nanos {
        Nanos(self.epoch.0.wrapping_add((at + 0.5).max(0.0) as u64))
    }

    fn feed(&mut self, at: f64, input: Input) {
        self.feed_at(at, self.plant.angle(), input);
    }

    fn feed_at(&mut self, at: f64, angle: f64, input: Input) {
        let output = self.core.step(self.stamp(at), input);
        self.obey(at, angle, output);
    }

    fn obey(&mut self, at: f64, angle: f64, output: Output) {
        if output.torque_nm != self.output.torque_nm {
            self.torques.push_back((at + self.delay_ns, f64::from(output.torque_nm)));
        }
        if let (true, Some(drive)) = (output.speed_rad_s != self.output.speed_rad_s, &mut self.drive) {
            drive.command(f64::from(output.speed_rad_s), self.plant.angle());
        }
        if let Some(frame) = output.armed {
            self.projector.arm(frame);
        }
        self.screen.take(output.armed);
        if let Some(Trigger { wait_ns, plane_ns }) = output.trigger {
            self.projector.trigger(at + f64::from(wait_ns), f64::from(plane_ns));
        }
        match output.state {
            State::OpenLoop => {}
            state if state.may_drive() => self.checkers.out_of_open_loop(),
            _ => self.checkers.forget_phase(),
        }
        self.released.extend(output.released.into_iter().flatten());
        self.collector.state(at * 1e-9, output.state, output.fault);
        self.output = output;
        self.relight(at, angle, false);
    }
}

#[path = "world_actions.rs"]
mod actions;
#[path = "world_light.rs"]
mod light;
#[path = "world_view.rs"]
mod view;

#[cfg(test)]
#[path = "world_tests.rs"]
mod tests;
