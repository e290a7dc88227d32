use hil_sim::{motor::Motor, scenario::*, world::*};
use protocol::{timing::*, units::*};
fn main() {
    let rotation = Rotation::new(288, 24, 240_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap();
    for action in [Action::Load { torque_nm: -0.02 }, Action::Load { torque_nm: 0.1 }, Action::Load { torque_nm: -0.2 }, Action::EncoderSlip { counts: -1 }, Action::EncoderSlip { counts: 1 }, Action::EncoderSlip { counts: 7 }, Action::ExtraIndexPulse, Action::LoseIndexPulses { count: 1 },Action::ExtraFramePulse, Action::LoseFramePulses { count: 1 }, Action::NoFramePulses { seconds: 1.0 }, Action::NoIndexPulses { seconds: 1.0 }, Action::EncoderFrozen { seconds: 1.0 }, Action::NoFramePulses { seconds: 9.9 }, Action::ProjectorRate { hz: 180.0 }, Action::ProjectorRate { hz: 241.0 }] {
        let mut v = vec![];
        for seed in 0..12 {
            let mut world = World::new(&rotation, Nanos(0), &Motor::reference(), &Scenario::default().with(3.0, action), seed).unwrap();
            world.turn_ready(firmware::plane_store::TurnHandle(0));
            world.advance(if let Action::NoFramePulses { seconds } = action { 5.0 + seconds } else { 6.0 });
            let s = world.statistics();
            let r = &s.recoveries[1];
            v.push((r.peak_slices, r.settled_s, s.verdict.misplaced, s.states.len(), world.state(), s.verdict.disordered + s.verdict.torn));
        }
        v.sort_by(|a, b| a.0.total_cmp(&b.0));
        println!("{action:?}: peak {:.4} .. {:.4} .. {:.4} settled max {:?} misplaced {} states {} {:?} dis {}", v[0].0, v[6].0, v[11].0, v.iter().map(|x| x.1.unwrap_or(99.0)).fold(0.0, f64::max), v.iter().map(|x| x.2).max().unwrap(), v.iter().map(|x| x.3).max().unwrap(), v[11].4, v.iter().map(|x| x.5).max().unwrap());
    }
    for (from, to) in [(180, 240.0), (240, 180.0)] { for inertia in [1.0, 0.5] {
        let rotation = Rotation::new(288, 24, from * 1_000_000, Turns::ZERO, Direction::CounterClockwise).unwrap();
        let mut scenario = Scenario::default().with(3.0, Action::ProjectorRate { hz: to });
        scenario.plant.inertia = inertia;
        let mut v: Vec<f64> = (0..20).map(|seed| { let mut world = World::new(&rotation, Nanos(0), &Motor::reference(), &scenario, seed).unwrap();
            world.advance(6.0); world.statistics().recoveries[1].ratio().unwrap_or(99.0) }).collect();
        v.sort_by(f64::total_cmp);
        println!("{from} -> {to} inertia {inertia}: ratio {:.3} .. {:.3} .. {:.3}", v[0], v[10], v[19]);
    }}
}
