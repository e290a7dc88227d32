//! The show: the simulated rig spins up, locks, and gets turns over the wire.

use crate::commands::Failure;
use crate::commands::args::progress;
use crate::halftoned::Halftoned;
use crate::link::sim::SimLink;
use crate::render::plan::Halftone;
use crate::render::turn::Turn;
use crate::stream::{Statistics, Stream};
use core::f64::consts::TAU;
use hil_sim::eye::Flash;
use hil_sim::motor::Motor;
use hil_sim::scenario::Scenario;
use hil_sim::simulator::Simulator;
use hil_sim::statistics::LockStatistics;
use hil_sim::world::{Recording, Sample};
use protocol::codec::ImageSize;
use protocol::message::{Command, State};
use protocol::rig::Rig;
use std::time::Duration;

/// How long the mirror may take to lock, simulated.
const LOCK_WITHIN_S: f64 = 60.0;
/// How long the last turn is shown before the eyes look.
const SHOWN_S: f64 = 2.0;

/// What happened.
pub(super) struct Show {
    simulator: Simulator,
    /// The last rotation that was shown whole.
    flashes: Vec<hil_sim::checkers::Flash>,
    /// Phase error and speed over time.
    pub samples: Vec<Sample>,
    /// The lock.
    pub statistics: LockStatistics,
    /// The wire.
    pub stream: Statistics,
}

/// Spins up, locks, streams `turns`, which were made by `halftone`, and lets the last one stand.
pub(super) fn run(rig: &Rig, turns: &[Turn], halftone: Halftone, seed: u64) -> Result<Show, Failure> {
    let scenario = Scenario { events: Vec::new(), ..Scenario::default() };
    let simulator = Simulator::new(rig, Motor::reference(), scenario, seed)?;
    let size = ImageSize::new(rig.projector.width_px, rig.projector.height_px)?;
    let mut stream = Stream::new(SimLink::new(simulator), &rig.rotation(), size)?;
    let recording = Recording { flashes_max: 3 * rig.rotation.slices as usize, samples_max: 400_000, sample_every: 4 };
    stream.link_mut().endpoint_mut().world_mut().record(recording);
    stream.command(Command::Start)?;
    wait_for_lock(rig, &mut stream)?;
    let bar = progress("streaming turns", turns.len() as u64);
    for turn in turns {
        stream.submit(&Halftoned { turn, halftone, number: 0 })?;
        bar.inc(1);
    }
    let until = now_s(&stream) + SHOWN_S;
    while now_s(&stream) < until {
        stream.poll(Duration::from_millis(20))?;
    }
    bar.finish_and_clear();
    let counted = stream.statistics();
    let simulator = stream.into_link().into_endpoint();
    Ok(finish(rig, simulator, counted))
}

fn now_s(stream: &Stream<SimLink<Simulator>>) -> f64 {
    stream.link().endpoint().world().now().seconds()
}

/// The bar is the mirror's speed.
fn wait_for_lock(rig: &Rig, stream: &mut Stream<SimLink<Simulator>>) -> Result<(), Failure> {
    let bar = progress("spinning up (%)", 100);
    while now_s(stream) < LOCK_WITHIN_S {
        let Some(status) = stream.poll(Duration::from_millis(20))? else { continue };
        match status.state {
            State::Locked => {
                bar.finish_and_clear();
                return Ok(());
            }
            State::Fault => {
                let fault = status.fault.map_or("no cause given".into(), |fault| fault.to_string());
                let cause = stream.faults().map(|faults| faults.cause().to_string()).unwrap_or_default();
                return Err(Failure(format!("rig {}, with the reference motor, stopped: {fault} {cause}", rig.name)));
            }
            _ => bar.set_position((f64::from(status.speed_microhertz) / rig.turns_per_second() / 1e4) as u64),
        }
    }
    Err(Failure(format!("rig {}: the simulated mirror did not lock within {LOCK_WITHIN_S} s", rig.name)))
}

fn finish(rig: &Rig, mut simulator: Simulator, stream: Statistics) -> Show {
    let world = simulator.world_mut();
    let recorded = world.take_flashes();
    let samples = world.take_samples();
    let statistics = world.statistics();
    let slices = rig.rotation.slices as usize;
    let is_first =
        |flash: &hil_sim::checkers::Flash| matches!(flash.plane, hil_sim::device::Plane::Slice { slice: 0, .. });
    let start = recorded.iter().rposition(is_first).and_then(|last| last.checked_sub(slices)).unwrap_or(0);
    let flashes = recorded.into_iter().skip(start).take(slices).collect();
    Show { simulator, flashes, samples, statistics, stream }
}

impl Show {
    /// The light of one rotation, as the mirror really stood, with the pixels that the device held.
    pub(super) fn flashes(&self) -> Vec<Flash<'_>> {
        self.flashes.iter().filter_map(|flash| self.simulator.flash(flash)).collect()
    }

    /// Samples as (seconds, turns a second).
    pub(super) fn speeds(&self) -> Vec<(f64, f64)> {
        self.samples.iter().map(|sample| (sample.at_s, sample.speed_rad_s.abs() / TAU)).collect()
    }

    /// Samples as (seconds, slices), from when the mirror was last a slice or more from its place before it locked: earlier, the
    /// phase goes round and round.
    pub(super) fn phase_errors(&self) -> Vec<(f64, f64)> {
        let locked = self.samples.iter().position(|sample| sample.state == State::Locked).unwrap_or(0);
        let near = self.samples[..locked]
            .iter()
            .rposition(|sample| sample.error_slices.abs() > 1.0)
            .map_or(0, |last| last + 1);
        self.samples[near..].iter().map(|sample| (sample.at_s, sample.error_slices)).collect()
    }
}
