//! Turns that come over the wire while the mirror is lit, from a host that stops, talks nonsense or is late; and what the light shows of
//! them.

use crate::checkers::Flash;
use crate::device::Endpoint;
use crate::motor::Motor;
use crate::scenario::Scenario;
use crate::simulator::Simulator;
use crate::statistics::LockStatistics;
use crate::world::{Recording, World};
use firmware::plane_store::TurnHandle;
use protocol::codec::{Compressor, Hint, ImageSize, plane_check, turn_check};
use protocol::message::Status;
use protocol::timing::{Direction, Rotation};
use protocol::units::{Nanos, Turns};
use sender::Sender;
use witness::Witness;

pub mod sender;
pub mod witness;

/// What is wrong with a host between [`TROUBLE_S`] and its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// It stops in the middle of a packet, and goes on later: where it stopped, or with another connection.
    Silence,
    /// Random bytes, damaged packets, and packets that are whole and mean nothing.
    Garbage,
    /// Each turn becomes whole at a random time, 5 to 180 ms after it was begun.
    Lateness,
}

impl Trouble {
    /// Each of them.
    pub const ALL: [Self; 3] = [Self::Silence, Self::Garbage, Self::Lateness];
}

/// When a host's trouble begins, seconds: the mirror has been in step for a while.
pub const TROUBLE_S: f64 = 2.5;
/// It is over at the latest.
pub const OVER_S: f64 = 4.0;
/// A run's length.
pub const RUN_S: f64 = 4.5;
/// The host looks after the device so often.
const STEP_S: f64 = 0.0005;

/// A device with its world, whose host is somebody else.
pub trait Subject: Endpoint {
    /// The world.
    fn world(&self) -> &World;

    /// The world.
    fn world_mut(&mut self) -> &mut World;

    /// [`plane_check`] of a slice as it lies in the store now; nothing where its turn is not whole.
    fn check_of(&mut self, turn: TurnHandle, slice: u16) -> Option<u64>;
}

/// A turn of the host.
#[derive(Clone, Debug)]
pub struct Turn {
    /// Its number.
    pub number: u32,
    /// Its planes, compressed.
    pub planes: Vec<Vec<u8>>,
    /// [`plane_check`] of each.
    pub checks: Vec<u64>,
}

impl Turn {
    /// Planes of `size` that no other turn and no other slice has.
    pub fn new(number: u32, slices: u32, size: ImageSize) -> Self {
        let plane = |slice: u32| -> Vec<u8> {
            let start = (number.wrapping_mul(0x9e37_79b9) ^ slice).wrapping_mul(0x85eb_ca6b);
            (0..size.plane_bytes() as u32)
                .map(|at| (start.wrapping_add(at).wrapping_mul(0xc2b2_ae35) >> 24) as u8)
                .collect()
        };
        let planes: Vec<_> = (0..slices).map(plane).collect();
        let packed = |plane: &Vec<u8>| {
            let mut out = Vec::new();
            Compressor::new(size).compress(plane, Hint::None, &mut out);
            out
        };
        Self {
            number,
            checks: planes.iter().map(|plane| plane_check(plane)).collect(),
            planes: planes.iter().map(packed).collect(),
        }
    }

    /// [`turn_check`].
    pub fn check(&self) -> u64 {
        turn_check(self.number, self.checks.iter().copied())
    }
}

/// How turns are cut in a run of `seed`: odd ones turn clockwise.
pub fn rotation(seed: u64) -> Rotation {
    let direction = if seed.is_multiple_of(2) { Direction::CounterClockwise } else { Direction::Clockwise };
    Rotation::new(288, 24, 240_000_000, Turns::fraction(1, 9), direction).expect("a rotation that can be")
}

/// A run on the simulated device, with the reference motor.
pub fn native(trouble: Trouble, seed: u64) -> Outcome {
    let (rotation, motor) = (rotation(seed), Motor::reference());
    let simulator = Simulator::turning(&rotation, Nanos::ZERO, motor, Scenario::without_events(), seed);
    run(&mut simulator.expect("a controller for the reference motor"), &rotation, trouble, seed)
}

/// What came of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// What may not be, the first few of each kind.
    pub wrong: Vec<String>,
    /// Everything that the device said.
    pub said: Vec<u8>,
    /// Everything that was lit.
    pub lit: Vec<Flash>,
    /// What the device said last of itself.
    pub status: Option<Status>,
    /// What the run was.
    pub statistics: LockStatistics,
}

/// Streams turns of `rotation` to `subject`, a device that has just been switched on, for [`RUN_S`] seconds. `seed` decides what the
/// host does.
pub fn run(subject: &mut impl Subject, rotation: &Rotation, trouble: Trouble, seed: u64) -> Outcome {
    let size = ImageSize::new(64, 48).expect("a size that can be");
    let mut sender = Sender::new(rotation, size, trouble, seed);
    let mut witness = Witness::new(rotation);
    let (mut lit, mut dark_before) = (Vec::new(), None);
    let recording = Recording { flashes_max: 64, ..Recording::default() };
    subject.world_mut().record(recording);
    while subject.world().now().seconds() < RUN_S {
        subject.advance(STEP_S);
        for flash in subject.world_mut().take_flashes() {
            witness.see(&flash, &sender, |turn, slice| subject.check_of(turn, slice));
            lit.push(flash);
        }
        let now = subject.world().now();
        sender.act(now, subject);
        if now.seconds() >= TROUBLE_S && dark_before.is_none() {
            dark_before = Some(subject.world().statistics().dark);
        }
    }
    let statistics = subject.world().statistics();
    let mut wrong = witness.wrong;
    let dark = statistics.dark - dark_before.unwrap_or(0);
    if dark > 0 {
        wrong.push(format!("{dark} planes dark since the host was in trouble"));
    }
    if witness.shown.is_none_or(|turn| sender.whole_at(turn).is_none_or(|at| at < sender.returned_at())) {
        wrong.push(format!("turn {:?} is the last that was shown: none that came after the trouble", witness.shown));
    }
    wrong.extend(statistics.verdict.first.clone());
    Outcome { wrong, said: sender.heard, lit, status: sender.status, statistics }
}

/// A turn that the device has whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Whole {
    /// The turn's number.
    pub number: u32,
    /// When the device said so.
    pub at: Nanos,
}
