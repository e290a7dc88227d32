use hil_sim::{motor::Motor, scenario::*, world::*};
use protocol::{timing::*, units::*};
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let hz: u64 = args[1].parse().unwrap();
    let seconds: f64 = args[2].parse().unwrap();
    let seeds: u64 = args[3].parse().unwrap();
    let inertia: f64 = args.get(4).map_or(1.0, |s| s.parse().unwrap());
    let friction: f64 = args.get(5).map_or(1.0, |s| s.parse().unwrap());
    let rotation = Rotation::new(288, 24, hz * 1_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap();
    let mut scenario = Scenario::default();
    scenario.plant = PlantScale { inertia, friction };
    for seed in 0..seeds {
        let mut world = World::new(&rotation, Nanos(0), &Motor::reference(), &scenario, seed).unwrap();
        world.turn_ready(firmware::plane_store::TurnHandle(0));
        if args.len() > 6 {
            world.record(Recording { samples_max: 1 << 20, sample_every: 24 * 3, flashes_max: 0 });
        }
        let t = std::time::Instant::now();
        world.advance(seconds);
        let s = world.statistics();
        println!(
            "seed {seed}: rms {:.4} p99 {:.4} peak {:.4} locked {:.2} settled {:?} limited {:.3} ratio {:?} | {} misplaced far {:.3} dark {} of {} {:?} {:?} [{:.0} x]",
            s.rms_slices,
            s.p99_slices,
            s.peak_slices,
            s.locked_seconds,
            s.recoveries[0].settled_s,
            s.recoveries[0].torque_limited_s,
            s.recoveries[0].ratio(),
            s.verdict.misplaced,
            s.verdict.farthest_slices,
            s.dark,
            s.planes,
            s.states,
            s.faults,
            seconds / t.elapsed().as_secs_f64()
        );
        for x in world.take_samples() {
            println!("{:.4} {:.4} {:.3} {:?}", x.at_s, x.error_slices, x.speed_rad_s, x.state);
        }
    }
}
