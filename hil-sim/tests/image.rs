//! The image in QEMU against the native core, output by output; and what the image costs.
//!
//! `tests/run` builds the image first. Without it, or without QEMU, these tests fail: they say what is missing.

use firmware::controller::{Controller, Estimates, Input, Output};
use firmware::plane_store::TurnHandle;
use hil_sim::image::costs::KINDS;
use hil_sim::image::{Image, SharedImage};
use hil_sim::motor::Motor;
use hil_sim::scenario::Scenario;
use hil_sim::world::{Core, World, repeat_command};
use protocol::message::State;
use protocol::timing::{Direction, Rotation};
use protocol::units::{Nanos, Turns};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

const SEEDS: u64 = 5;
/// A window lasts so long, or until this long after the last event.
const WINDOW_S: f64 = 5.0;
const AFTER_S: f64 = 1.5;

fn elf() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/mps2/thumbv7em-none-eabihf/release/mps2")
}

fn rotation(refresh_hz: u64) -> Rotation {
    Rotation::new(288, 24, refresh_hz * 1_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap()
}

/// The image drives the world; the native core gets the same inputs, and must give the same outputs.
struct Twins {
    image: SharedImage,
    native: Controller,
    steps: u64,
    first_difference: Arc<Mutex<Option<String>>>,
}

impl Core for Twins {
    fn step(&mut self, now: Nanos, input: Input) -> Output {
        let (image, native) = (Core::step(&mut self.image, now, input), self.native.step(now, input));
        self.steps += 1;
        let bits = |output: &Output| output.torque_nm.to_bits();
        let mut same = image == native && bits(&image) == bits(&native);
        if self.steps.is_multiple_of(500) {
            same &= self.image.estimates() == self.native.estimates();
        }
        if !same {
            let difference = || format!("{now:?}, {input:?}: image {image:?}, native {native:?}");
            self.first_difference.lock().unwrap().get_or_insert_with(difference);
        }
        image
    }

    fn estimates(&self) -> Estimates {
        self.native.estimates()
    }
}

/// Runs one window; what was wrong with it.
fn run(image: &SharedImage, refresh_hz: u64, name: &str, seed: u64) -> Vec<String> {
    let (rotation, motor, scenario) = (rotation(refresh_hz), Motor::reference(), Scenario::built_in(name).unwrap());
    let config = motor.firmware_config(&rotation, Nanos::ZERO);
    image.lock().begin(&config).unwrap();
    let first_difference = Arc::new(Mutex::new(None));
    let twins = Twins {
        image: image.clone(),
        native: Controller::new(config).unwrap(),
        steps: 0,
        first_difference: first_difference.clone(),
    };
    let seconds = scenario.events.iter().map(|event| event.at_s + AFTER_S).fold(WINDOW_S, f64::max);
    let mut world = World::with_core(&rotation, Nanos::ZERO, &motor, &scenario, seed, Box::new(twins));
    world.turn_ready(TurnHandle(0));
    world.advance(seconds);
    let statistics = world.statistics();
    let mut wrong = Vec::new();
    wrong.extend(first_difference.lock().unwrap().take());
    wrong.extend(image.lock().failure().map(ToString::to_string));
    if !statistics.verdict.is_clean() || world.state() != State::Locked {
        wrong.push(format!("{:?}, {:?}", world.state(), statistics.verdict));
    }
    let ratio = statistics.recoveries[0].ratio().unwrap_or(f64::INFINITY);
    if name == "plain" && (statistics.rms_slices > 0.005 || statistics.peak_slices > 0.03 || ratio > 1.15) {
        wrong.push(format!("{statistics:?}"));
    }
    let rig = if refresh_hz == 240 { "reference" } else { "reference-180hz" };
    let command = repeat_command(rig, "reference", name, seconds, seed);
    wrong.iter().map(|wrong| format!("{command}: {wrong}")).collect()
}

#[test]
fn image_and_native_core_agree_bit_for_bit_and_keep_within_the_budget() {
    let images: Vec<_> = (0..SEEDS)
        .into_par_iter()
        .map(|seed| {
            let image = SharedImage::new(Image::boot(&elf()).unwrap_or_else(|error| panic!("{error}")));
            let mut wrong = run(&image, 180, "plain", seed);
            wrong.extend(Scenario::BUILT_IN.iter().flat_map(|name| run(&image, 240, name, seed)));
            (image, wrong)
        })
        .collect();
    let wrong: Vec<_> = images.iter().flat_map(|(_, wrong)| wrong).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
    for (image, _) in &images {
        let mut image = image.lock();
        for (kind, dearest) in KINDS.iter().zip(image.costs().kinds()) {
            println!("{kind} {dearest:?}");
        }
        let stack = image.stack_bytes();
        println!("plane {:?} stack {stack:?}", image.costs().plane());
    }
}
