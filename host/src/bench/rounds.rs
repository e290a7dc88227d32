//! The measurement: every case has its turn in every round, in another order, so that what disturbs the machine disturbs all alike.

use super::who::Who;
use super::{Case, Report, Row, Spread};
use crate::machine::{Machine, processor_time};
use crate::render::plan::Halftone;
use crate::render::turn::Turn;
use crate::render::{Prepared, RenderError, Renderer, Wanted, dark_turn};
use crate::rendered::frame;
use core::time::Duration;
use protocol::rig::Rig;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::time::Instant;

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub enum Effort {
    /// So many rounds.
    Rounds(u32),
    /// As many rounds as take about so long, from [`ROUNDS_MIN`] to [`ROUNDS_MAX`].
    Seconds(f64),
}

/// Fewer rounds show no spread.
pub const ROUNDS_MIN: u32 = 3;
/// More rounds say nothing new.
pub const ROUNDS_MAX: u32 = 500;

/// A case that is quick is rendered until this has passed before the next one is: turn after turn, as it is used.
const VISIT: Duration = Duration::from_millis(100);
const VISIT_TURNS_MAX: u32 = 8;

/// A call that takes so long takes about as long when it is not the first.
const SLOW_S: f64 = 1.0;

/// What is being done: its name, how much of it has been done, and how much there is.
pub type Progress<'a> = dyn Fn(&'static str, u64, u64) + 'a;

/// A case on its renderer, with what was measured.
struct Runner<'a> {
    case: &'a Case<'a>,
    renderer: String,
    prepared: Box<dyn Prepared + 'a>,
    slices: Vec<u32>,
    prepare_ms: f64,
    /// Turns in each round.
    turns: u32,
    wall_ms: Vec<f64>,
    cores_ms: Vec<f64>,
    stages: BTreeMap<usize, (&'static str, Vec<f64>)>,
}

/// Measures `cases` by `renderers` in rounds whose order follows from `seed`. A case that its renderer refuses is left out, and noted;
/// too little memory ends it all.
pub fn run(
    cases: &[Case<'_>],
    renderers: &[(Who, Box<dyn Renderer>)],
    effort: Effort,
    seed: u64,
    progress: &Progress<'_>,
) -> Result<Report, RenderError> {
    let mut report = empty(cases, seed);
    let mut turns = turns_for(cases)?;
    let mut runners = Vec::new();
    let start = Instant::now();
    for (index, case) in cases.iter().enumerate() {
        let Some((_, renderer)) = renderers.iter().find(|(who, _)| *who == case.who) else { continue };
        match Runner::new(case, renderer.as_ref(), &mut turns) {
            Ok(runner) => runners.push(runner),
            Err(error @ (RenderError::TurnTooLarge(_) | RenderError::TooManyTriangles { .. })) => return Err(error),
            Err(error) => report.notes.push(format!("{} on {}: {error}; left out", case.who, case.scene_name)),
        }
        progress("preparing", index as u64 + 1, cases.len() as u64);
    }
    // A turn of every case has been rendered, so that it is known how long a round takes.
    let round_s: f64 = runners.iter().map(|runner| runner.once_s() * f64::from(runner.turns)).sum();
    report.rounds = match effort {
        Effort::Rounds(rounds) => rounds,
        Effort::Seconds(seconds) => { ((seconds - start.elapsed().as_secs_f64()).max(0.0) / round_s.max(1e-3)) as u32 }
            .clamp(ROUNDS_MIN, ROUNDS_MAX),
    };
    runners.iter_mut().for_each(Runner::forget);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut packs: BTreeMap<u32, Vec<f64>> = BTreeMap::new();
    let steps = u64::from(report.rounds) * runners.len() as u64;
    for round in 0..report.rounds {
        let mut order: Vec<usize> = (0..runners.len()).collect();
        order.shuffle(&mut random);
        for (step, index) in (0..).zip(order) {
            runners[index].visit(&mut turns)?;
            progress("measuring", u64::from(round) * runners.len() as u64 + step + 1, steps);
        }
        for ((slices, _), (rig, turn)) in turns.iter().filter(|(key, _)| !key.1) {
            packs.entry(*slices).or_default().push(pack_ms(rig, turn));
        }
    }
    report.pack_ms = packs.into_iter().map(|(slices, times)| (slices, Spread::of(times))).collect();
    report.rows = runners.into_iter().map(Runner::row).collect();
    report.compare();
    Ok(report)
}

/// Turns to render into, by slices and whether they are grey, with a rig of so many.
type Turns = BTreeMap<(u32, bool), (Rig, Turn)>;

fn key(case: &Case<'_>) -> (u32, bool) {
    (case.rig.rotation.slices, case.plan.halftone == Halftone::Grey)
}

fn turns_for(cases: &[Case<'_>]) -> Result<Turns, RenderError> {
    let mut turns = Turns::new();
    for case in cases {
        if let Entry::Vacant(place) = turns.entry(key(case)) {
            place.insert((case.rig.clone(), dark_turn(&case.rig, &case.plan)?));
        }
    }
    Ok(turns)
}

fn empty(cases: &[Case<'_>], seed: u64) -> Report {
    let rig = cases.iter().find(|case| !case.is_of_sweep).map(|case| &case.rig);
    Report {
        program: "praxi",
        version: env!("CARGO_PKG_VERSION"),
        machine: Machine::here(),
        adapters: Vec::new(),
        rig: rig.map(|rig| rig.name.clone()).unwrap_or_default(),
        image_px: rig.map_or([0; 2], |rig| [rig.projector.width_px, rig.projector.height_px]),
        rig_turns_per_second: rig.map_or(f64::NAN, Rig::turns_per_second),
        budget_px: f64::NAN,
        seed,
        rounds: 0,
        baseline: None,
        rows: Vec::new(),
        pack_ms: BTreeMap::new(),
        notes: Vec::new(),
    }
}

impl<'a> Runner<'a> {
    /// Prepares a case and renders it: the first time allocates and compiles, so that of a quick one only the second shows how long it
    /// takes.
    fn new(case: &'a Case<'a>, renderer: &'a dyn Renderer, turns: &mut Turns) -> Result<Self, RenderError> {
        let start = Instant::now();
        let prepared = renderer.prepare(case.scene, &case.rig, &case.plan)?;
        let mut runner = Self {
            case,
            renderer: renderer.name(),
            prepared,
            slices: case.slices(),
            prepare_ms: start.elapsed().as_secs_f64() * 1e3,
            turns: 1,
            wall_ms: Vec::new(),
            cores_ms: Vec::new(),
            stages: BTreeMap::new(),
        };
        runner.visit(turns)?;
        if runner.once_s() < SLOW_S {
            runner.forget();
            runner.visit(turns)?;
        }
        runner.turns = ((VISIT.as_secs_f64() / runner.once_s().max(1e-6)) as u32).clamp(1, VISIT_TURNS_MAX);
        Ok(runner)
    }

    fn forget(&mut self) {
        self.wall_ms.clear();
        self.cores_ms.clear();
        self.stages.clear();
    }

    /// Seconds that the first call took that is not forgotten.
    fn once_s(&self) -> f64 {
        self.wall_ms.first().map_or(0.0, |ms| ms / 1e3 / self.scale())
    }

    /// From the slices that are rendered to a turn.
    fn scale(&self) -> f64 {
        f64::from(self.case.rig.rotation.slices) / self.slices.len() as f64
    }

    fn visit(&mut self, turns: &mut Turns) -> Result<(), RenderError> {
        let Some((_, turn)) = turns.get_mut(&key(self.case)) else { return Ok(()) };
        let scale = 1e3 * self.scale();
        for _ in 0..self.turns {
            let cores = processor_time();
            let start = Instant::now();
            self.prepared.render(Wanted { slices: &self.slices, number: 0, done: &|| () }, turn)?;
            self.wall_ms.push(start.elapsed().as_secs_f64() * scale);
            let used = processor_time().zip(cores).map(|(after, before)| after.saturating_sub(before));
            self.cores_ms.extend(used.map(|used| used.as_secs_f64() * scale));
            for (place, (name, time)) in self.prepared.stages().into_iter().flatten().enumerate() {
                self.stages.entry(place).or_insert((name, Vec::new())).1.push(time.as_secs_f64() * scale);
            }
        }
        Ok(())
    }

    fn row(self) -> Row {
        let median = |values: Vec<f64>| Spread::of(values).median;
        let (case, turn_ms) = (self.case, Spread::of(self.wall_ms.clone()));
        let turns_per_second = 1e3 / turn_ms.median;
        Row {
            scene: case.scene_name.into(),
            triangles: case.scene.triangles.len(),
            work: case.work,
            slices: case.rig.rotation.slices,
            plan: case.plan,
            who: case.who,
            renderer: self.renderer,
            is_of_sweep: case.is_of_sweep,
            runs: self.wall_ms.len(),
            slices_rendered: self.slices.len() as u32,
            prepare_ms: self.prepare_ms,
            turn_ms,
            cores_ms: (!self.cores_ms.is_empty()).then(|| median(self.cores_ms)),
            slices_per_second: turns_per_second * f64::from(case.rig.rotation.slices),
            turns_per_second,
            times_faster: None,
            times_less_cores: None,
            stages: self.stages.into_values().map(|(name, times)| (name, median(times))).collect(),
            peak_bytes: None,
        }
    }
}

/// Packs a turn into its frames on all cores.
fn pack_ms(rig: &Rig, turn: &Turn) -> f64 {
    let start = Instant::now();
    let bytes: usize = (0..rig.rotation().frames()).into_par_iter().map(|index| frame(turn, rig, index).len()).sum();
    std::hint::black_box(bytes);
    start.elapsed().as_secs_f64() * 1e3
}

/// Renders a turn of `case` once, for its memory to be seen.
pub fn render_once(case: &Case<'_>, renderer: &dyn Renderer) -> Result<(), RenderError> {
    let mut turn = dark_turn(&case.rig, &case.plan)?;
    let mut prepared = renderer.prepare(case.scene, &case.rig, &case.plan)?;
    prepared.render(Wanted { slices: &case.slices(), number: 0, done: &|| () }, &mut turn)
}
