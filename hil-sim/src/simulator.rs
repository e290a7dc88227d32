//! The simulated controller as a host meets it: the wire's end, the frame store, the firmware's core and the world around it.

use crate::device::{Device, Endpoint, Input, Report};
use crate::eye::{Flash, Picture};
use crate::motor::Motor;
use crate::scenario::{Action, Scenario};
use crate::streaming::Subject;
use crate::world::World;
use firmware::config::ConfigError;
use firmware::hosted::Screen;
use firmware::plane_store::{Plane, TurnHandle};
use protocol::codec::plane_check;
use protocol::rig::Rig;
use protocol::timing::Rotation;
use protocol::units::Nanos;
use std::sync::{Arc, Mutex, PoisonError};

/// How often the controller reports to the host, seconds.
pub(crate) const REPORT_S: f64 = 0.01;

/// A way to let something happen to a simulator from outside while it runs. Clones are the same one.
#[derive(Clone, Debug, Default)]
pub struct Injector(Arc<Mutex<Vec<Action>>>);

impl Injector {
    /// Lets `action` happen at the simulator's next step.
    pub fn inject(&self, action: Action) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(action);
    }

    fn take(&self) -> Vec<Action> {
        std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// A device whose projector and mirror are simulated.
pub struct Simulator {
    device: Device,
    world: World,
    motor: Motor,
    scenario: Scenario,
    seed: u64,
    frame_latency: Nanos,
    /// Whether the controller took the rotation that the host configured last.
    in_step_with_host: bool,
    report_at: Nanos,
    injector: Injector,
}

impl Simulator {
    /// A device for `rig`, switched on.
    pub fn new(rig: &Rig, motor: Motor, scenario: Scenario, seed: u64) -> Result<Self, ConfigError> {
        let frame_latency = Nanos::from_seconds(rig.projector.frame_latency_us * 1e-6);
        Self::turning(&rig.rotation(), frame_latency, motor, scenario, seed)
    }

    /// The same for turns of `rotation`; a frame's first plane follows its pulse after `frame_latency`.
    pub fn turning(
        rotation: &Rotation,
        frame_latency: Nanos,
        motor: Motor,
        scenario: Scenario,
        seed: u64,
    ) -> Result<Self, ConfigError> {
        let world = World::new(rotation, frame_latency, &motor, &scenario, seed)?;
        Ok(Self {
            device: Device::new(),
            world,
            motor,
            scenario,
            seed,
            frame_latency,
            in_step_with_host: true,
            report_at: Nanos::ZERO,
            injector: Injector::default(),
        })
    }

    /// The same, to which things happen by `injector`.
    pub fn with_injector(self, injector: Injector) -> Self {
        Self { injector, ..self }
    }

    /// Motor, projector and controller.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Motor, projector and controller.
    pub fn world_mut(&mut self) -> &mut World {
        &mut self.world
    }

    /// The wire's end, with the planes that arrived.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// What the eye takes of a flash that the world recorded: pixels from the frame store, angles as the mirror really stood.
    /// `None` where the turn has left the store since.
    pub fn flash(&self, flash: &crate::checkers::Flash) -> Option<Flash<'_>> {
        let picture = match flash.plane {
            Plane::Dark => Picture::Dark,
            Plane::Slice { turn, slice } => Picture::Binary(self.device.store().plane(turn, slice)?.bytes()),
        };
        Some(Flash { start: flash.angle_start, end: flash.angle_end, picture })
    }

    /// What arrived over the wire goes to the controller.
    fn deliver(&mut self) {
        while let Some(input) = self.device.next_input() {
            match input {
                Input::Configured(rotation, _) => self.configure(&rotation),
                Input::Vacate => self.world.vacate(),
                Input::Command(command) => self.world.command(command),
                Input::TurnReady(turn) => self.turn_ready(turn),
            }
        }
        self.release();
    }

    /// Another rotation restarts the controller, and the world with it. One that the controller refuses leaves both as they are,
    /// and turns for it stay dark: [`Simulator::turn_ready`].
    fn configure(&mut self, rotation: &Rotation) {
        self.in_step_with_host = true;
        if *rotation == *self.world.rotation() {
            return;
        }
        match World::new(rotation, self.frame_latency, &self.motor, &self.scenario, self.seed) {
            Ok(world) => {
                let screen = Screen { turn: None, ..self.world.screen() };
                self.world = world;
                self.world.screen = screen;
                // The new world's time begins at 0: reports must not wait for the old one's.
                self.report_at = Nanos::ZERO;
            }
            Err(_) => self.in_step_with_host = false,
        }
    }

    /// A turn that was cut for another rotation than the controller's is given back unseen.
    fn turn_ready(&mut self, turn: TurnHandle) {
        if self.in_step_with_host {
            self.world.turn_ready(turn);
        } else {
            self.device.release(turn);
        }
    }

    fn release(&mut self) {
        for turn in self.world.take_released() {
            self.device.release(turn);
        }
    }

    fn report(&self) -> Report {
        let (world, slices) = (&self.world, self.world.rotation().slices());
        Report::new(world.state(), world.fault(), &world.estimates(), slices, world.screen())
    }
}

impl Endpoint for Simulator {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        let mut rest = bytes;
        while self.device.take_packet(&mut rest) {
            self.deliver();
        }
        bytes.len()
    }

    fn transmit(&mut self) -> Vec<u8> {
        if self.world.now() >= self.report_at {
            self.report_at = self.world.now() + Nanos::from_seconds(REPORT_S);
            self.device.report(self.report());
            self.device.faults(self.world.faults());
        }
        self.device.transmit()
    }

    fn advance(&mut self, seconds: f64) {
        self.injector.take().into_iter().for_each(|action| self.world.act(action));
        self.world.advance(seconds);
        self.release();
    }

    fn lose_link(&mut self) {
        self.device.lose_link();
    }

    fn is_at_rest(&self) -> bool {
        self.world.state().is_at_rest()
    }
}

impl Subject for Simulator {
    fn world(&self) -> &World {
        &self.world
    }

    fn world_mut(&mut self) -> &mut World {
        &mut self.world
    }

    fn check_of(&mut self, turn: TurnHandle, slice: u16) -> Option<u64> {
        self.device.store().plane(turn, slice).map(|plane| plane_check(plane.bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::message::{Command, Fault, State};
    use protocol::timing::Direction;
    use protocol::units::Turns;

    const RIG: &str = include_str!("../../host/rigs/reference.toml");

    fn rotation(refresh_hz: u64) -> Rotation {
        Rotation::new(288, 24, refresh_hz * 1_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap()
    }

    /// Configured for `refresh_hz`, given a turn, and started: how many planes were lit.
    fn lit(refresh_hz: u64) -> u64 {
        let scenario = Scenario::without_events();
        let mut simulator = Simulator::new(&Rig::parse(RIG).unwrap(), Motor::reference(), scenario, 1).unwrap();
        simulator.advance(1.0);
        simulator.configure(&rotation(refresh_hz));
        simulator.turn_ready(TurnHandle(0));
        simulator.world.command(Command::Start);
        simulator.advance(4.0);
        assert_eq!(simulator.world.state(), State::Locked);
        simulator.world.statistics().verdict.lit
    }

    #[test]
    fn a_turn_for_a_rotation_that_the_controller_refuses_stays_dark() {
        assert!(lit(240) > 5_000 && lit(180) > 5_000);
        // 4000 control ticks a second cannot arm 3000 frames.
        assert_eq!(lit(3_000), 0);
    }

    #[test]
    fn what_is_injected_happens() {
        let injector = Injector::default();
        let simulator =
            Simulator::new(&Rig::parse(RIG).unwrap(), Motor::reference(), Scenario::without_events(), 1).unwrap();
        let mut simulator = simulator.with_injector(injector.clone());
        simulator.advance(0.1);
        assert_eq!(simulator.world.state(), State::Idle);
        injector.inject(Action::EmergencyStop);
        simulator.advance(0.1);
        assert_eq!(simulator.world.fault(), Some(Fault::EmergencyStop));
    }

    #[test]
    fn another_rotation_is_reported_at_once() {
        let mut simulator =
            Simulator::new(&Rig::parse(RIG).unwrap(), Motor::reference(), Scenario::default(), 1).unwrap();
        simulator.advance(1.0);
        simulator.transmit();
        simulator.configure(&rotation(180));
        assert!(simulator.world.now() >= simulator.report_at);
    }
}
