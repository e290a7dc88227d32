//! The image as its host meets it: its own end of the wire, its own frame store, and the world that it drives.

use super::{Image, ImageError, SharedImage};
use crate::device::Endpoint;
use crate::motor::Motor;
use crate::scenario::Scenario;
use crate::simulator::REPORT_S;
use crate::streaming::{self, Outcome, Subject, Trouble};
use crate::world::World;
use firmware::plane_store::TurnHandle;
use protocol::units::Nanos;

/// A world that an image drives, which has a host.
pub struct Bench {
    image: SharedImage,
    world: World,
    said: Vec<u8>,
    report_at: Nanos,
}

impl Bench {
    /// `image` is the core of `world` as well.
    pub fn new(image: SharedImage, world: World) -> Self {
        Self { image, world, said: Vec::new(), report_at: Nanos::ZERO }
    }
}

/// A run of `image` like [`streaming::native`](crate::streaming::native)'s.
pub fn streamed(image: &SharedImage, trouble: Trouble, seed: u64) -> Result<Outcome, ImageError> {
    let (rotation, motor) = (streaming::rotation(seed), Motor::reference());
    image.lock().begin(&motor.firmware_config(&rotation, Nanos::ZERO))?;
    let core = Box::new(image.clone());
    let world = World::with_core(&rotation, Nanos::ZERO, &motor, &Scenario::without_events(), seed, core);
    let outcome = streaming::run(&mut Bench::new(image.clone(), world), &rotation, trouble, seed);
    image.lock().failure.take().map_or(Ok(outcome), Err)
}

impl Endpoint for Bench {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        let mut rest = bytes;
        while !rest.is_empty() {
            let now = self.world.controller_time();
            let Some(heard) = self.image.try_get(|image| image.hear(now, rest)) else { break };
            self.said.extend_from_slice(&heard.said);
            rest = rest.get(heard.taken..).unwrap_or_default();
            if let Some(output) = heard.output {
                self.world.obey_now(output);
            }
        }
        bytes.len() - rest.len()
    }

    fn transmit(&mut self) -> Vec<u8> {
        if self.world.now() >= self.report_at {
            self.report_at = self.world.now() + Nanos::from_seconds(REPORT_S);
            self.said.extend_from_slice(&self.image.get(Image::report));
        }
        std::mem::take(&mut self.said)
    }

    fn advance(&mut self, seconds: f64) {
        self.world.advance(seconds);
    }
}

impl Subject for Bench {
    fn world(&self) -> &World {
        &self.world
    }

    fn world_mut(&mut self) -> &mut World {
        &mut self.world
    }

    fn check_of(&mut self, turn: TurnHandle, slice: u16) -> Option<u64> {
        self.image.get(|image| image.plane(turn, slice))
    }
}
