use firmware::controller::*;
use hil_sim::{motor::Motor, scenario::*, world::*};
use protocol::{timing::*, units::*};
use std::{cell::RefCell, rc::Rc};
struct Shared(Rc<RefCell<Controller>>);
impl Core for Shared {
    fn step(&mut self, now: Nanos, input: Input) -> Output {
        self.0.borrow_mut().step(now, input)
    }
}
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let hz: u64 = args[1].parse().unwrap();
    let seconds: f64 = args[2].parse().unwrap();
    let seed: u64 = args[3].parse().unwrap();
    let from: f64 = args[4].parse().unwrap();
    let every: usize = args[5].parse().unwrap();
    let rotation = Rotation::new(288, 24, hz * 1_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap();
    let mut scenario = Scenario::default();
    if args.len() > 6 {
        scenario.plant = PlantScale { inertia: args[6].parse().unwrap(), friction: args[7].parse().unwrap() };
    }
    if args.len() > 8 { scenario = scenario.with(3.0, match args[8].as_str() { "load" => Action::Load { torque_nm: std::env::var("LOAD").map_or(-0.02, |s| s.parse().unwrap()) }, _ => Action::EncoderSlip { counts: -1 } }); }
    let m = Motor::reference();
    let c = Rc::new(RefCell::new(Controller::new(m.firmware_config(&rotation, Nanos(0))).unwrap()));
    let mut world = World::with_core(&rotation, Nanos(0), &m, &scenario, seed, Box::new(Shared(c.clone())));
    let mut i = 0;
    while world.now().seconds() < seconds {
        world.advance(250e-6);
        i += 1;
        if world.now().seconds() < from || i % every != 0 {
            continue;
        }
        let c = c.borrow();
        let e = c.estimates();
        let err = (e.angle.turns() - world.true_angle() / std::f64::consts::TAU).rem_euclid(1.0);
        let err = if err > 0.5 { err - 1.0 } else { err } * 288.0;
        println!(
            "{:.4} {:?} est err {:.4} sl, v err {:.4} v {:.2} | {}",
            world.now().seconds(),
            world.state(),
            err,
            e.speed_rad_s as f64 - world.true_speed(),
            world.true_speed(),
            c.rotation().debug()
        );
    }
}
