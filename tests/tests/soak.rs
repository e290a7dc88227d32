//! Turns streamed to the simulated rig over a line on which everything goes wrong, by hosts that come and go: no wrong and no torn plane
//! is lit, and every turn is shown whole or counted as dropped.
//!
//! `tests/soak --turns 10000 --seed 1` runs it for longer; a leg that fails names the seed that repeats it.

use hil_sim::checkers::Flash;
use hil_sim::device::{Endpoint, Plane};
use hil_sim::faulty::{FaultRates, Faulty};
use hil_sim::motor::Motor;
use hil_sim::scenario::Scenario;
use hil_sim::simulator::Simulator;
use hil_sim::world::Recording;
use host::link::Connect;
use host::link::sim::{Clock, Shared, SimConnect};
use host::stream::live::{Live, Nothing, Source, Step};
use host::stream::{StreamError, TurnPlanes};
use protocol::codec::{Hint, ImageSize};
use protocol::message::{Command, State};
use protocol::timing::{Direction, Rotation};
use protocol::units::{Nanos, Turns};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeSet;
use std::ops::AddAssign;
use std::time::Duration;
use tests::soaking::{number, resident_bytes};

const SLICES: u32 = 288;
/// A new turn comes so often: a little sooner than a rotation is over.
const PERIOD: Duration = Duration::from_millis(45);
/// A turn that took longer is left where there is a newer one.
const DEADLINE: Duration = Duration::from_millis(400);
const LOOK_FOR: Duration = Duration::from_secs(60);
/// Turns of a leg, which has a line and a seed of its own.
const LEG_TURNS: u32 = 100;
/// So many come over a line that is whole again.
const CALM_TURNS: u32 = 40;

fn size() -> ImageSize {
    ImageSize::new(64, 48).unwrap()
}

fn rotation() -> Rotation {
    Rotation::new(SLICES, 24, 240_000_000, Turns::fraction(1, 9), Direction::CounterClockwise).unwrap()
}

/// Slice `slice` as turn `version` made it: nothing else looks like it.
fn plane(seed: u64, version: u32, slice: u32) -> Vec<u8> {
    let mut bytes = vec![0; size().plane_bytes()];
    bytes[..4].copy_from_slice(&version.to_le_bytes());
    bytes[4..8].copy_from_slice(&slice.to_le_bytes());
    let mut noise = ChaCha8Rng::seed_from_u64(seed ^ u64::from(version) << 32 ^ u64::from(slice));
    noise.fill(&mut bytes[8..120]);
    bytes
}

/// A turn.
struct Picture {
    planes: Vec<Vec<u8>>,
    is_masked: bool,
}

const RANKS: [u16; 64] = {
    let mut ranks = [0; 64];
    let mut cell = 0;
    while cell < 64 {
        ranks[cell as usize] = cell * 37 % 64;
        cell += 1;
    }
    ranks
};

impl TurnPlanes for Picture {
    fn slices(&self) -> u32 {
        SLICES
    }

    fn plane_bytes(&self, slice: u32) -> &[u8] {
        &self.planes[slice as usize]
    }

    fn hint(&self, slice: u32) -> Hint {
        if self.is_masked { Hint::Mask { shift: (slice % 64) as u16 } } else { Hint::None }
    }

    fn mask_ranks(&self) -> &[u16] {
        if self.is_masked { &RANKS } else { &[] }
    }
}

/// Makes a turn each [`PERIOD`], of which a sector differs from the one before.
struct Camera {
    seed: u64,
    random: ChaCha8Rng,
    start: Duration,
    /// Of every turn so far.
    history: Vec<Vec<u32>>,
    /// The number of the last one that was taken.
    taken: Option<u32>,
    replaced: u64,
}

impl Camera {
    fn new(seed: u64) -> Self {
        let random = ChaCha8Rng::seed_from_u64(seed ^ 0x5eed);
        Self { seed, random, start: Duration::ZERO, history: Vec::new(), taken: None, replaced: 0 }
    }

    /// The newest turn's number.
    fn newest(&self, now: Duration) -> u32 {
        (now.saturating_sub(self.start).as_nanos() / PERIOD.as_nanos()) as u32
    }

    fn shoot(&mut self, number: u32) -> Picture {
        while self.history.len() <= number as usize {
            let number = self.history.len() as u32;
            let mut versions = self.history.last().cloned().unwrap_or(vec![0; SLICES as usize]);
            let sector = match self.random.random_range(0..4) {
                0 => 0..SLICES as usize,
                _ => {
                    let start = self.random.random_range(0..SLICES as usize);
                    start..(start + self.random.random_range(1..100)).min(SLICES as usize)
                }
            };
            versions[sector].fill(number);
            self.history.push(versions);
        }
        let planes = (0..)
            .zip(&self.history[number as usize])
            .map(|(slice, version)| plane(self.seed, *version, slice))
            .collect();
        Picture { planes, is_masked: self.seed.is_multiple_of(2) }
    }
}

impl Source for Camera {
    type Turn = Picture;

    fn take(&mut self, now: Duration) -> Option<Picture> {
        let newest = self.newest(now);
        let before = self.taken.map_or(0, |taken| taken + 1);
        if newest < before {
            return None;
        }
        self.replaced += u64::from(newest - before);
        self.taken = Some(newest);
        Some(self.shoot(newest))
    }

    fn has_newer(&mut self, now: Duration) -> bool {
        self.taken.is_none_or(|taken| self.newest(now) > taken)
    }
}

/// The rig, and somebody who looks at every plane that is lit.
struct Watched {
    rig: Simulator,
    seed: u64,
    /// Versions of the slices that were lit since the last slice 0.
    rotation: Vec<Option<u32>>,
    /// Of each rotation that was lit whole, without repeats.
    shown: Vec<Vec<u32>>,
    lit: u64,
    wrong: Vec<String>,
}

impl Watched {
    fn new(seed: u64) -> Self {
        let scenario = Scenario::without_events();
        let rig = Simulator::turning(&rotation(), Nanos::ZERO, Motor::reference(), scenario, seed);
        let mut rig = rig.expect("a controller for the reference motor");
        rig.world_mut().record(Recording { flashes_max: 64, ..Recording::default() });
        Self { rig, seed, rotation: vec![None; SLICES as usize], shown: Vec::new(), lit: 0, wrong: Vec::new() }
    }

    fn look(&mut self, flash: &Flash) {
        let Plane::Slice { turn, slice } = flash.plane else { return };
        self.lit += 1;
        if slice == 0 {
            self.end_rotation();
        }
        let found = self.rig.device().store().plane(turn, slice).map(|plane| plane.bytes().to_vec());
        let version = found.as_ref().map(|bytes| u32::from_le_bytes(bytes[..4].try_into().unwrap()));
        let is_right = version.is_some_and(|version| found == Some(plane(self.seed, version, slice.into())));
        if !is_right {
            self.wrong.push(format!("{:.6} s: slice {slice} is no slice of any turn", flash.start.seconds()));
        }
        self.rotation[usize::from(slice)] = version;
    }

    fn end_rotation(&mut self) {
        let rotation = std::mem::replace(&mut self.rotation, vec![None; SLICES as usize]);
        if let Some(whole) = rotation.into_iter().collect::<Option<Vec<_>>>()
            && self.shown.last() != Some(&whole)
        {
            self.shown.push(whole);
        }
    }
}

impl Endpoint for Watched {
    fn receive(&mut self, bytes: &[u8]) -> usize {
        self.rig.receive(bytes)
    }

    fn transmit(&mut self) -> Vec<u8> {
        self.rig.transmit()
    }

    fn advance(&mut self, seconds: f64) {
        // A plane is looked at before its turn can leave the store.
        const LOOK_S: f64 = 0.0005;
        let mut left = seconds;
        while left > 0.0 {
            self.rig.advance(left.min(LOOK_S));
            left -= LOOK_S;
            for flash in self.rig.world_mut().take_flashes() {
                self.look(&flash);
            }
        }
    }

    fn lose_link(&mut self) {
        self.rig.lose_link();
    }
}

type Way = SimConnect<Faulty<Watched>>;

/// What a leg came to.
#[derive(Clone, Copy, Debug, Default)]
struct Leg {
    turns: u64,
    delivered: u64,
    dropped: u64,
    kept: u64,
    resumed: u64,
    reconnects: u64,
    restarts: u64,
    damaged: u64,
    stalls: u64,
    unplugs: u64,
    lit: u64,
}

impl AddAssign for Leg {
    fn add_assign(&mut self, other: Self) {
        let Self { turns, delivered, dropped, kept, resumed, reconnects, restarts, damaged, stalls, unplugs, lit } =
            other;
        self.turns += turns;
        self.delivered += delivered;
        self.dropped += dropped;
        self.kept += kept;
        self.resumed += resumed;
        self.reconnects += reconnects;
        self.restarts += restarts;
        self.damaged += damaged;
        self.stalls += stalls;
        self.unplugs += unplugs;
        self.lit += lit;
    }
}

/// The worst of it is another one in each leg.
fn rates(seed: u64) -> FaultRates {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut rate = |most: f64| if random.random_bool(0.6) { random.random_range(0.0..most) } else { 0.0 };
    FaultRates {
        flip: rate(2e-4),
        drop: rate(1e-4),
        repeat: rate(1e-4),
        repeat_transfer: rate(0.02),
        swap: rate(0.02),
        stall: rate(3.0),
        unplug: rate(3.0),
    }
}

/// A host that was just started, as soon as there is a device.
fn start(way: &Way) -> Live<Way, Picture> {
    for _ in 0..1_000 {
        match Live::new(way.clone(), &rotation(), size(), [DEADLINE, LOOK_FOR]) {
            Ok(live) => return live,
            Err(StreamError::Schema { .. }) => panic!("another schema"),
            Err(_) => way.clone().wait(Duration::from_millis(20)),
        }
    }
    panic!("no device in 20 s")
}

/// The mirror in step, over a line without faults.
fn locked(way: &Way, camera: &mut Camera) -> Live<Way, Picture> {
    let mut live = start(way);
    live.command(Command::Start).unwrap();
    while live.status().is_none_or(|status| status.state != State::Locked) {
        assert!(live.now() < Duration::from_secs(20), "not in step: {:?}", live.status());
        live.step(&mut Nothing::default()).unwrap();
    }
    camera.start = live.now();
    live
}

fn leg(seed: u64) -> Leg {
    let rig = Shared::new(Faulty::new(Watched::new(seed), FaultRates::default(), seed));
    let way = SimConnect::new(rig.clone(), Clock::Simulated, None);
    let mut camera = Camera::new(seed);
    let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0xc0ffee);
    let mut live = locked(&way, &mut camera);
    rig.with(|line| line.set_rates(rates(seed)));
    let (mut delivered, mut leg) = (BTreeSet::new(), Leg::default());
    let (mut calm_from, mut calm_delivered) = (None, 0);
    // The last turns come over a line that is whole again.
    while calm_from.is_none_or(|from| camera.taken < Some(from + CALM_TURNS)) {
        if calm_from.is_none() && camera.taken >= Some(LEG_TURNS - CALM_TURNS) {
            rig.with(|line| line.set_rates(FaultRates::default()));
            calm_from = camera.taken;
        }
        let is_calm = calm_from.is_some();
        let step = live.step(&mut camera).unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        if matches!(step, Step::Delivered(_)) {
            delivered.insert(camera.taken.unwrap());
            calm_delivered += u32::from(is_calm);
        }
        let restarts = if matches!(step, Step::Away(_)) { 0.2 } else { 0.01 };
        if !is_calm && random.random_bool(restarts) {
            note(&mut leg, &live);
            leg.restarts += 1;
            live = start(&way);
        }
    }
    // The last one comes on screen.
    let end = live.now() + Duration::from_millis(300);
    while live.now() < end {
        live.step(&mut Nothing::default()).unwrap();
    }
    note(&mut leg, &live);
    let faults = rig.with(|line| line.counts());
    (leg.damaged, leg.stalls, leg.unplugs) = (faults.bytes + faults.transfers, faults.stalls, faults.unplugs);
    rig.with(|line| judge(seed, line.endpoint_mut(), &camera, &delivered, &mut leg));
    assert!(calm_delivered >= 5, "seed {seed}: {calm_delivered} turns after the line was whole again: {leg:?}");
    leg
}

/// Adds up what a host did.
fn note(leg: &mut Leg, live: &Live<Way, Picture>) {
    let (totals, statistics) = (live.totals(), live.statistics());
    leg.delivered += totals.delivered;
    leg.dropped += totals.late + totals.failed;
    leg.reconnects += totals.reconnects;
    leg.kept += statistics.planes_kept;
    leg.resumed += statistics.planes_resumed;
}

fn judge(seed: u64, watched: &mut Watched, camera: &Camera, delivered: &BTreeSet<u32>, leg: &mut Leg) {
    watched.end_rotation();
    assert!(watched.wrong.is_empty(), "seed {seed}: {:?}", watched.wrong);
    let mut numbers = Vec::new();
    for versions in &watched.shown {
        let number = camera.history.iter().position(|turn| turn == versions);
        numbers.push(number.unwrap_or_else(|| panic!("seed {seed}: a torn turn was lit: {versions:?}")) as u32);
    }
    assert!(numbers.is_sorted(), "seed {seed}: turns out of order: {numbers:?}");
    let shown: BTreeSet<u32> = numbers.into_iter().collect();
    let unseen: Vec<_> = delivered.difference(&shown).collect();
    // Before anything is on screen a turn that waits for the index is passed over where the next one is whole by then: both slots are free.
    let passed_over = watched.rig.device().counters().turns_received - watched.rig.world().screen().turns_shown;
    assert!(
        unseen.len() <= passed_over as usize,
        "seed {seed}: {unseen:?} delivered, and neither shown nor passed over"
    );
    leg.delivered -= unseen.len() as u64;
    leg.dropped += unseen.len() as u64;
    leg.turns = u64::from(camera.taken.unwrap()) + 1;
    leg.lit = watched.lit;
    // What is neither: the turns that a host had in hand when it ended, at most one each.
    let lost = leg.turns - leg.delivered - leg.dropped - camera.replaced;
    assert!(lost <= leg.restarts, "seed {seed}: {lost} turns not accounted for: {leg:?}");
    leg.dropped += lost + camera.replaced;
}

#[test]
fn no_fault_of_the_line_shows_a_wrong_or_torn_plane() {
    let (turns, first) = (number("SOAK_TURNS", 300), number("SOAK_SEED", 1));
    let legs = turns.div_ceil(LEG_TURNS.into());
    let (mut sum, mut early) = (Leg::default(), None);
    for seed in first..first + legs {
        sum += leg(seed);
        if seed == first + legs / 5 {
            early = resident_bytes();
        }
    }
    println!("{sum:?}");
    assert!(sum.delivered > sum.turns / 3, "{sum:?}");
    assert!(sum.damaged > 0 && sum.unplugs > 0 && sum.kept > 0, "the faults did not happen: {sum:?}");
    if let (Some(early), Some(late), true) = (early, resident_bytes(), legs >= 20) {
        println!(
            "memory: {:.1} MB after a fifth of the turns, {:.1} MB at the end",
            early as f64 / 1e6,
            late as f64 / 1e6
        );
        assert!(late < early + early / 10, "memory grew from {early} to {late} bytes");
    }
}
