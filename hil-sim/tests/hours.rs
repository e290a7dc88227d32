//! Hours of control in simulated time, with random faults and an operator who puts them right: no wrong plane is lit, every fault is got over
//! or stands with its cause until somebody clears it, and nothing grows.
//!
//! `tests/soak --hours 24 --seed 1` runs it for longer; a run that fails names its seed, time and incident.

use firmware::plane_store::{Plane, TurnHandle};
use hil_sim::motor::Motor;
use hil_sim::scenario::{Action, Scenario};
use hil_sim::world::{Recording, World};
use protocol::message::{Command, State};
use protocol::timing::{Direction, Rotation};
use protocol::units::{Nanos, Turns};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::{BTreeMap, VecDeque};

#[path = "../../tests/src/soaking.rs"]
mod soaking;
use soaking::{number, resident_bytes};

const SLICES: u16 = 288;
/// So often the host looks, and may have a turn: once a rotation.
const STEP_S: f64 = 0.05;
/// In step again, or a fault, by then: spinning up takes 1.5 s, and the lock gives up after 10 s.
const RECOVERY_S: f64 = 20.0;
/// Nobody tries for longer.
const PATIENCE_S: f64 = 120.0;
/// Turns that the controller holds.
const SLOTS: usize = 2;

/// One thing that goes wrong, and what puts it right when it is over.
struct Incident {
    name: &'static str,
    actions: Vec<Action>,
    /// For so long, seconds.
    lasts_s: f64,
    after: Vec<Action>,
}

/// The next incident.
fn incident(random: &mut ChaCha8Rng, motor: &Motor) -> Incident {
    let nominal_hz = 240.0;
    let short = random.random_range(0.001..0.3);
    let seconds = random.random_range(0.05..12.0);
    let count = random.random_range(1..40);
    let torque_nm = motor.plant.max_torque_nm * random.random_range(-1.0..0.6);
    let one = |name, action| Incident { name, actions: vec![action], lasts_s: 0.0, after: Vec::new() };
    let until = |name, action, after| Incident { name, actions: vec![action], lasts_s: seconds, after: vec![after] };
    match random.random_range(0..22) {
        0 => one("lost frame pulses", Action::LoseFramePulses { count }),
        1 => one("no frame pulses", Action::NoFramePulses { seconds }),
        2 => one("extra frame pulse", Action::ExtraFramePulse),
        3 => one("lost plane pulses", Action::LosePlanePulses { count }),
        4 => one("no plane pulses", Action::NoPlanePulses { seconds }),
        5 => one("extra plane pulse", Action::ExtraPlanePulse),
        6 => one("lost index pulses", Action::LoseIndexPulses { count }),
        7 => one("no index pulses", Action::NoIndexPulses { seconds }),
        8 => one("extra index pulse", Action::ExtraIndexPulse),
        9 => one("encoder slips", Action::EncoderSlip { counts: random.random_range(-400..400) }),
        10 => one("encoder stands", Action::EncoderFrozen { seconds: short }),
        11 => one("doubled pulses", Action::DoubledPulses { seconds }),
        12 => one("no control ticks", Action::NoControlTicks { seconds: short }),
        13 => {
            let jitter = Action::PulseJitter { us: motor.projector_clock.frame_jitter_us };
            until("pulse jitter", Action::PulseJitter { us: random.random_range(1.0..40.0) }, jitter)
        }
        14 => {
            let hz = nominal_hz * random.random_range(0.99..1.01);
            until("projector drifts", Action::ProjectorRate { hz }, Action::ProjectorRate { hz: nominal_hz })
        }
        15 => {
            let share = random.random_range(0.05..1.0);
            until("supply sags", Action::TorqueLimit { share }, Action::TorqueLimit { share: 1.0 })
        }
        16 | 17 => until("hand on the mirror", Action::Load { torque_nm }, Action::Load { torque_nm: 0.0 }),
        18 => until("emergency stop", Action::EmergencyStop, Action::EmergencyStopReleased),
        19 => until("guard", Action::GuardOpened, Action::GuardClosed),
        20 => until("stopped and started", Action::Stop, Action::Start),
        _ => Incident { name: "host away", actions: Vec::new(), lasts_s: seconds, after: Vec::new() },
    }
}

/// How incidents ended.
#[derive(Debug, Default)]
struct Counts {
    incidents: u64,
    /// In step without a fault.
    got_over: u64,
    /// Stood with its cause until it was cleared.
    latched: u64,
}

/// A rig, a host that sends turns of which only a number is known, and an operator.
struct Day {
    seed: u64,
    world: World,
    random: ChaCha8Rng,
    motor: Motor,
    /// What each slot holds: the number of a turn, for all its planes.
    slots: [Option<u64>; SLOTS],
    turns: u64,
    /// The newest turn that was lit.
    shown: u64,
    host_is_away: bool,
    lit: u64,
    /// Of everything that was lit and when: the same for the same seed.
    digest: u64,
    counts: BTreeMap<&'static str, Counts>,
    faults: BTreeMap<String, u64>,
    doing: String,
    /// What happened last.
    before: VecDeque<String>,
}

impl Day {
    fn new(seed: u64) -> Self {
        let direction = if seed.is_multiple_of(2) { Direction::CounterClockwise } else { Direction::Clockwise };
        let rotation = Rotation::new(SLICES.into(), 24, 240_000_000, Turns::fraction(1, 9), direction).unwrap();
        let motor = Motor::reference();
        let mut world = World::new(&rotation, Nanos(0), &motor, &Scenario::without_events(), seed).unwrap();
        world.record(Recording { flashes_max: 4 * usize::from(SLICES), ..Recording::default() });
        Self {
            seed,
            world,
            random: ChaCha8Rng::seed_from_u64(seed),
            motor,
            slots: [None; SLOTS],
            turns: 0,
            shown: 0,
            host_is_away: false,
            lit: 0,
            digest: seed,
            counts: BTreeMap::new(),
            faults: BTreeMap::new(),
            doing: "start".into(),
            before: VecDeque::new(),
        }
    }

    /// Where a failure is found again.
    fn here(&self) -> String {
        let hours = self.world.now().seconds() / 3600.0;
        format!("seed {}, {:.3} s ({hours:.2} h), {}", self.seed, self.world.now().seconds(), self.doing)
    }

    /// Lets a rotation's time pass.
    fn step(&mut self) {
        self.world.advance(STEP_S);
        for flash in self.world.take_flashes() {
            let Plane::Slice { turn, slice } = flash.plane else { continue };
            let number = self.slots[usize::from(turn.0)];
            let number = number.unwrap_or_else(|| panic!("{}: an empty slot is lit: {flash:?}", self.here()));
            assert!(number >= self.shown, "{}: turn {number} after turn {}", self.here(), self.shown);
            self.shown = number;
            self.lit += 1;
            for word in [number, slice.into(), flash.start.0] {
                self.digest = (self.digest ^ word).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(29);
            }
        }
        let verdict = self.world.verdict();
        assert!(verdict.is_clean(), "{}: {verdict:?}, {:?}, {:?}", self.here(), self.world.state(), self.before);
        for turn in self.world.take_released() {
            self.slots[usize::from(turn.0)] = None;
        }
        let spare = self.slots.iter().position(Option::is_none);
        if let (Some(slot), false, true) = (spare, self.host_is_away, self.random.random_bool(0.6)) {
            self.turns += 1;
            self.slots[slot] = Some(self.turns);
            self.world.turn_ready(TurnHandle(slot as u8));
        }
    }

    fn wait(&mut self, seconds: f64) {
        let end = self.world.now().seconds() + seconds;
        while self.world.now().seconds() < end {
            self.step();
        }
    }

    /// As somebody does who looks after the rig: waits, reads the fault, clears it, starts again. Gives whether there was a fault.
    fn see_to_it(&mut self) -> bool {
        let (mut had_fault, began) = (false, self.world.now().seconds());
        let mut deadline = self.world.now().seconds() + RECOVERY_S;
        while self.world.state() != State::Locked {
            match self.world.state() {
                State::Fault => {
                    let fault = self.world.fault().unwrap_or_else(|| panic!("{}: a fault without a name", self.here()));
                    if !had_fault {
                        let cause = self.world.faults().cause().to_string();
                        *self.faults.entry(format!("{fault:?}")).or_default() += 1;
                        let is_level = self.doing == "emergency stop" || self.doing == "guard";
                        assert!(is_level || !cause.is_empty(), "{}: {fault:?} without a cause", self.here());
                    }
                    had_fault = true;
                    let lit = self.lit;
                    let pause = self.random.random_range(0.2..5.0);
                    self.wait(pause);
                    assert_eq!(self.world.fault(), Some(fault), "{}: a fault went away by itself", self.here());
                    assert_eq!(self.lit, lit, "{}: lit in a fault", self.here());
                    self.world.command(Command::ClearFault);
                    deadline = deadline.max(self.world.now().seconds() + RECOVERY_S);
                }
                State::Idle => self.world.command(Command::Start),
                _ => {}
            }
            self.step();
            let (state, fault) = (self.world.state(), self.world.fault());
            assert!(
                self.world.now().seconds() < began + PATIENCE_S,
                "{}: still {state:?} {fault:?}: {}",
                self.here(),
                self.world.faults().cause()
            );
            if self.world.now().seconds() > deadline && self.world.state() != State::Fault {
                panic!("{}: neither in step nor a fault after {RECOVERY_S} s: {:?}", self.here(), self.world.state());
            }
        }
        had_fault
    }

    fn suffer(&mut self, incident: Incident) {
        self.doing = incident.name.into();
        self.before.push_back(format!(
            "{:.3} s: {:?} for {:.3} s",
            self.world.now().seconds(),
            incident.actions,
            incident.lasts_s
        ));
        self.before.drain(..self.before.len().saturating_sub(4));
        self.host_is_away = incident.actions.is_empty();
        incident.actions.iter().for_each(|action| self.world.act(*action));
        self.wait(incident.lasts_s);
        incident.after.iter().for_each(|action| self.world.act(*action));
        self.host_is_away = false;
        self.wait(0.3);
        let had_fault = self.see_to_it();
        let counts = self.counts.entry(incident.name).or_default();
        counts.incidents += 1;
        *(if had_fault { &mut counts.latched } else { &mut counts.got_over }) += 1;
    }

    fn run(&mut self, hours: f64, mut look: impl FnMut(f64)) {
        self.world.command(Command::Start);
        self.see_to_it();
        while self.world.now().seconds() < hours * 3600.0 {
            self.doing = "calm".into();
            let calm = self.random.random_range(2.0..40.0);
            // Whatever is left of the last incident may still hurt.
            self.wait(calm);
            if self.see_to_it() {
                *self.faults.entry("later".into()).or_default() += 1;
            }
            let next = incident(&mut self.random, &self.motor);
            self.suffer(next);
            look(self.world.now().seconds() / 3600.0);
        }
    }
}

#[test]
fn hours_of_control_with_faults_of_all_kinds() {
    let (minutes, seed) = (number("SOAK_MINUTES", 10), number("SOAK_SEED", 1));
    let hours = minutes as f64 / 60.0;
    let (mut day, mut early, mut told) = (Day::new(seed), None, 1.0);
    day.run(hours, |now| {
        if early.is_none() && now > hours / 10.0 {
            early = resident_bytes();
        }
        if now >= told {
            println!("{told:.0} h");
            told = now.floor() + 1.0;
        }
    });
    let farthest = day.world.verdict().farthest_slices;
    println!(
        "seed {seed}: {hours:.2} h, {} turns sent, {} planes lit, farthest {farthest:.3} slices, digest {:016x}",
        day.turns, day.lit, day.digest
    );
    for (name, counts) in &day.counts {
        println!(
            "{name:<22} {:5} times: {:5} got over, {:5} faults that stood with their cause",
            counts.incidents, counts.got_over, counts.latched
        );
    }
    println!("faults: {:?}", day.faults);
    if let (Some(early), Some(late), true) = (early, resident_bytes(), minutes >= 60) {
        println!("memory: {:.1} MB after a tenth, {:.1} MB at the end", early as f64 / 1e6, late as f64 / 1e6);
        assert!(late < early + early / 20, "memory grew from {early} to {late} bytes");
    }
}

#[test]
fn the_same_seed_is_the_same_day() {
    let digests = [5, 5, 6].map(|seed| {
        let mut day = Day::new(seed);
        day.run(0.02, |_| ());
        day.digest
    });
    assert!(digests[0] == digests[1] && digests[0] != digests[2], "{digests:x?}");
}
