//! The cheapest plan whose predicted error is within a budget, or the most accurate one within a time.

use super::cost::{Work, turn_ns, vertex_ns};
use super::error::geometric_error;
use super::{DepthTest, Edges, Halftone, Plan, Precision, Projection};
use crate::render::bow::reach_m;
use crate::render::clear::ClearRenderer;
use crate::render::mesh::Mesh;
use crate::render::tessellate::{is_out_of_reach, tessellate};
use crate::render::{RenderError, Renderer, anything_visible};
use crate::scene::ShadedScene;
use glam::{DVec2, DVec3};
use protocol::rig::{Rig, Viewers};
use serde::Serialize;
use shaders::project::{Model, SliceOptics};
use thiserror::Error;

/// A plan and what is expected of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Candidate {
    /// The methods.
    pub plan: Plan,
    /// The largest distance on the projector's image between drawn and exact, in pixels: what was seen on a sample, with a reserve.
    pub error_px: f64,
    /// The same as an eye sees it, in minutes of arc.
    pub error_arcmin: f64,
    /// By how much interpolated depth errs at most, in metres. [`DepthTest::Exact`] mends it where surfaces come close.
    pub depth_m: f64,
    /// Time of one core for a turn on the machine whose prices [`turn_ns`] has, in milliseconds, without halftone.
    pub cost_ms: f64,
    /// What there is to do for it.
    pub work: Work,
}

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// The cheapest plan that errs by no more than this many projector pixels.
    Error(f64),
    /// The most accurate plan that costs no more than this many milliseconds, as [`Candidate::cost_ms`] counts them.
    Cost(f64),
}

/// Why there is no plan.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PlanError {
    /// No slice shows anything of the scene.
    #[error(
        "nothing of the scene is visible on rig {0}: bring it to the origin and to the display's size with --fit-m"
    )]
    NothingVisible(String),
    /// What is fixed would leave out parts of the scene.
    #[error(
        "no plan with what is fixed draws all of the scene on rig {0}: sight lines graze the mirror, and pieces have corners without \
         a pixel; allow --edges rays"
    )]
    Lost(String),
    /// The budget is below what the most accurate plan reaches.
    #[error(
        "--budget-px {asked}: the most accurate plan for this scene and rig is expected within {reached:.2e} px ({best})"
    )]
    TooAccurate {
        /// What was asked for, px.
        asked: f64,
        /// What is possible, px.
        reached: f64,
        /// By which methods.
        best: String,
    },
    /// The budget is below what the cheapest plan costs.
    #[error(
        "--budget-ms {asked}: the fastest plan for this scene and rig is expected to take {possible:.0} ms ({fastest})"
    )]
    TooFast {
        /// What was asked for, ms.
        asked: f64,
        /// What is possible, ms.
        possible: f64,
        /// By which methods.
        fastest: String,
    },
    /// The scene cannot be cut.
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// Methods that are fixed beforehand.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fixed {
    /// How V' is found.
    pub projection: Option<Projection>,
    /// In which precision.
    pub precision: Option<Precision>,
    /// How edges are brought to their curves.
    pub edges: Option<Edges>,
    /// How depth is compared.
    pub depth: Option<DepthTest>,
}

/// Pairs of piece and slice in a prediction's sample; some milliseconds.
const PAIRS: usize = 3000;
/// And at most, where fewer than [`POINTS`] of it are visible: what is seldom seen is seldom lost too, but not less wrong.
const PAIRS_MAX: usize = 16 * PAIRS;
const POINTS: usize = 1000;
/// A sample's largest error is below the largest of all by less than this factor: see the test on random rigs.
const RESERVE: f64 = 1.25;
/// What rounding vertices to 1/256 pixel adds, in px.
const SNAP_PX: f64 = 0.003;
/// No smaller error is claimed, in px: the reference itself is no better.
const FLOOR_PX: f64 = 1e-6;
/// How far the pieces of [`Edges::Discard`] may bow, px: coarser ones are not dearer by the pixel, finer ones are more.
const COARSE_PX: f64 = 8.0;
/// Of 255 levels of grey, a difference that can be seen.
const VISIBLE_STEP: u8 = 8;
/// Where linear depth gets no more than this share of the lit pixels wrong, exact depth is not worth its time.
const CROSSING_SHARE: f64 = 2e-3;
/// The smallest bow that edges are cut to, px: below it cutting is dearer than the test by pixel.
const FINE_PX: f64 = 0.01;

/// What `plan`, drawing `mesh`, is expected to cost and to err by. `None` where it would lose parts of the scene, or where the sample
/// meets nothing visible.
pub fn predict(mesh: &Mesh, rig: &Rig, plan: &Plan) -> Option<Candidate> {
    let mut pairs = PAIRS;
    let mut error = geometric_error(mesh, rig, plan, pairs);
    while error.points + error.lost < POINTS && pairs < PAIRS_MAX {
        pairs *= 4;
        error = geometric_error(mesh, rig, plan, pairs);
    }
    let snap = if matches!(plan.edges, Edges::Discard | Edges::Rays) { 0.0 } else { SNAP_PX };
    let work = Work::of(mesh, rig);
    let error_px = (RESERVE * error.worst_px + snap).max(FLOOR_PX);
    (error.points > 0 && error.lost == 0).then(|| Candidate {
        plan: *plan,
        error_px,
        error_arcmin: error.worst_arcmin * error_px / error.worst_px.max(FLOOR_PX),
        depth_m: RESERVE * error.worst_depth_m,
        cost_ms: turn_ns(plan, &work) / 1e6,
        work,
    })
}

/// What was weighed for a budget, the cheapest first; the choice is [`Choice::chosen`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Choice {
    /// The plan to take.
    pub chosen: Candidate,
    /// All that was weighed, the cheapest first.
    pub candidates: Vec<Candidate>,
}

/// Chooses for `scene` on `rig` among the plans that have what is `fixed`, with the default halftone, which has no part in it. The
/// choice does not depend on the machine or on chance.
pub fn choose(scene: &ShadedScene, rig: &Rig, fixed: Fixed, budget: Budget) -> Result<Choice, PlanError> {
    let chooser = Chooser::new(scene, rig, fixed)?;
    match budget {
        Budget::Error(px) => chooser.cheapest_within(px),
        Budget::Cost(ms) => chooser.most_accurate_within(ms),
    }
}

/// Plans of less and less cost: the cheapest within `px`, or the most accurate one where none is, and each further one within twice as
/// much and at least a tenth cheaper; `rungs` at most.
pub fn ladder(scene: &ShadedScene, rig: &Rig, px: f64, rungs: u32) -> Result<Vec<Candidate>, PlanError> {
    let chooser = Chooser::new(scene, rig, Fixed::default())?;
    let first = match chooser.cheapest_within(px) {
        Err(PlanError::TooAccurate { reached, .. }) => chooser.cheapest_within(1.001 * reached),
        choice => choice,
    };
    let mut ladder = vec![first?.chosen];
    for rung in 1..rungs {
        let next = chooser.cheapest_within(px * f64::from(1 << rung))?.chosen;
        if ladder.last().is_some_and(|last| next.cost_ms < 0.9 * last.cost_ms) {
            ladder.push(next);
        }
    }
    Ok(ladder)
}

/// A scene and a rig, and the ways to find V' that are worth weighing for them.
struct Chooser<'a> {
    scene: &'a ShadedScene,
    rig: &'a Rig,
    fixed: Fixed,
    straight: Mesh,
    /// Whether the scene passes the viewers: only rays are weighed.
    near_viewers: bool,
    /// Each with the error of its projection alone, by rays.
    ways: Vec<Candidate>,
}

impl<'a> Chooser<'a> {
    fn new(scene: &'a ShadedScene, rig: &'a Rig, fixed: Fixed) -> Result<Self, PlanError> {
        let straight = tessellate(scene, rig, &Plan { edges: Edges::Straight, ..Plan::default() })?;
        let ways = Projection::ALL.into_iter().flat_map(|projection| {
            [Precision::Single, Precision::Double].map(|precision| Plan {
                projection,
                precision,
                edges: Edges::Rays,
                depth: DepthTest::Exact,
                ..Plan::default()
            })
        });
        let ways = ways.filter(|plan| {
            fixed.projection.is_none_or(|fixed| fixed == plan.projection)
                && fixed.precision.is_none_or(|fixed| fixed == plan.precision)
        });
        let near_viewers = reaches_viewers(scene, rig);
        // Rays cost the same by every projection, and far points take long: where only rays will do, by the exact one if it is allowed.
        let mut ways: Vec<Candidate> = match near_viewers.then(|| exact(scene, rig, &straight, fixed)) {
            Some(Ok(exact)) => vec![exact],
            _ => ways.filter_map(|plan| predict(&straight, rig, &plan)).collect(),
        };
        if ways.is_empty() {
            ways.push(exact(scene, rig, &straight, fixed)?);
        }
        ways.sort_by(|a, b| vertex_ns(&a.plan).total_cmp(&vertex_ns(&b.plan)));
        let mut best = f64::INFINITY;
        ways.retain(|way| {
            let better = way.error_px < 0.95 * best;
            best = best.min(way.error_px);
            better
        });
        Ok(Self { scene, rig, fixed, straight, near_viewers, ways })
    }

    /// Every way, by straight and by cut edges, by the test by pixel and by rays; edges are cut so that all errors together keep
    /// within `px`.
    fn candidates(&self, px: f64) -> Result<Vec<Candidate>, PlanError> {
        let mut candidates = Vec::new();
        for way in &self.ways {
            for edges in Edges::ALL {
                if self.near_viewers && edges != Edges::Rays {
                    continue;
                }
                // Cutting to one length costs more than adaptive cutting wherever both will do: only on demand.
                let weighed = self.fixed.edges.map_or(edges != Edges::Uniform, |fixed| fixed == edges);
                if weighed {
                    candidates.extend(self.by_edges(way, edges, px)?);
                }
            }
        }
        candidates.sort_by(|a, b| a.cost_ms.total_cmp(&b.cost_ms));
        Ok(candidates)
    }

    fn by_edges(&self, way: &Candidate, edges: Edges, px: f64) -> Result<Option<Candidate>, PlanError> {
        let with = |bow_px| Plan { edges, bow_px, depth: self.fixed.depth.unwrap_or(DepthTest::Linear), ..way.plan };
        let cut = |bow_px| -> Result<Option<Candidate>, PlanError> {
            let plan = with(bow_px);
            Ok(predict(&tessellate(self.scene, self.rig, &plan)?, self.rig, &plan))
        };
        match edges {
            Edges::Rays => return Ok(Some(*way)),
            Edges::Straight => return Ok(predict(&self.straight, self.rig, &with(COARSE_PX))),
            Edges::Discard => return cut(COARSE_PX),
            Edges::Uniform | Edges::Adaptive => {}
        }
        // The errors of projection and bow do not just add, so a second cut uses what the first one left or takes back what it exceeded.
        let first_px = (px - way.error_px - SNAP_PX) / RESERVE;
        if first_px < FINE_PX {
            // What the projection alone exceeds, edges cannot mend: a candidate only where nothing else is allowed.
            return if self.fixed.edges.is_some() { cut((px / 4.0).max(FINE_PX)) } else { Ok(None) };
        }
        let Some(first) = cut(first_px)? else { return Ok(None) };
        if (0.8 * px..=px).contains(&first.error_px) {
            return Ok(Some(first));
        }
        let used = (first.error_px - way.error_px).max(0.1 * first_px);
        let second_px = (first_px * (0.95 * px - way.error_px) / used).clamp(FINE_PX, px);
        Ok(cut(second_px)?.filter(|second| second.error_px <= px).or(Some(first)))
    }

    fn cheapest_within(&self, px: f64) -> Result<Choice, PlanError> {
        let mut candidates = self.candidates(px)?;
        // Smaller pieces fill the boxes around them better, so that half the error may cost less.
        let is_cut =
            |one: &&Candidate| matches!(one.plan.edges, Edges::Uniform | Edges::Adaptive) && one.error_px <= px;
        if let Some(cut) = candidates.iter().find(is_cut).copied() {
            let same = |way: &&Candidate| {
                (way.plan.projection, way.plan.precision) == (cut.plan.projection, cut.plan.precision)
            };
            if let Some(way) = self.ways.iter().find(same) {
                candidates.extend(self.by_edges(way, cut.plan.edges, px / 2.0)?);
                candidates.sort_by(|a, b| a.cost_ms.total_cmp(&b.cost_ms));
            }
        }
        // Exact depth, where it is needed, may make dearer what was cheapest.
        let mut chosen: Option<Candidate> = None;
        for candidate in candidates.iter().filter(|candidate| candidate.error_px <= px) {
            if chosen.is_some_and(|chosen| chosen.cost_ms <= candidate.cost_ms) {
                break;
            }
            let candidate = self.with_depth(*candidate)?;
            chosen = chosen.filter(|chosen| chosen.cost_ms <= candidate.cost_ms).or(Some(candidate));
        }
        let Some(chosen) = chosen else {
            let Some(best) = most_accurate(&candidates) else {
                return Err(PlanError::Lost(self.rig.name.clone()));
            };
            return Err(PlanError::TooAccurate { asked: px, reached: best.error_px, best: best.plan.to_string() });
        };
        // Exact depth is dear. Pieces that bow less may do without it, and be cheaper.
        if chosen.plan.depth == DepthTest::Exact && self.fixed.depth.is_none() {
            match self.cheapest_within(px / 4.0) {
                Ok(finer) if finer.chosen.cost_ms < chosen.cost_ms => return Ok(finer),
                _ => {}
            }
        }
        Ok(Choice { chosen, candidates })
    }

    /// `candidate` with exact depth if that is needed: if surfaces come so close that it changes a sample of slices.
    fn with_depth(&self, candidate: Candidate) -> Result<Candidate, PlanError> {
        let is_open = self.fixed.depth.is_none() && !matches!(candidate.plan.edges, Edges::Discard | Edges::Rays);
        if !is_open || candidate.depth_m < 0.1 * pitch_m(self.rig) {
            return Ok(candidate);
        }
        let linear = Plan { halftone: Halftone::Grey, ..candidate.plan };
        let exact = Plan { depth: DepthTest::Exact, ..linear };
        let slices: Vec<u32> = (0..3).map(|index| index * self.rig.rotation.slices / 3).collect();
        let render = |plan| ClearRenderer.render_slices(self.scene, self.rig, plan, &slices, &|| ());
        let (linear, exact) = (render(&linear)?, render(&exact)?);
        let lit = exact.bytes().iter().filter(|byte| **byte > 0).count();
        let wrong = linear.bytes().iter().zip(exact.bytes()).filter(|(a, b)| a.abs_diff(**b) > VISIBLE_STEP).count();
        if (wrong as f64) <= CROSSING_SHARE * lit as f64 {
            return Ok(candidate);
        }
        let plan = Plan { depth: DepthTest::Exact, ..candidate.plan };
        Ok(Candidate { plan, cost_ms: turn_ns(&plan, &candidate.work) / 1e6, ..candidate })
    }

    /// Cost falls as the budget in pixels grows, so that the smallest that can be paid is found by halving.
    fn most_accurate_within(&self, ms: f64) -> Result<Choice, PlanError> {
        let budgets: Vec<f64> = (0..14).map(|step| 32.0 / f64::from(1 << step)).collect();
        let mut candidates = Vec::new();
        let (mut paid, mut unpaid) = (0, budgets.len());
        while paid < unpaid {
            let middle = (paid + unpaid) / 2;
            let weighed = self.candidates(budgets[middle])?;
            let cheapest = weighed.iter().find(|candidate| candidate.error_px <= budgets[middle]);
            match cheapest.is_some_and(|candidate| candidate.cost_ms <= ms) {
                true => paid = middle + 1,
                false => unpaid = middle,
            }
            candidates.extend(weighed);
        }
        candidates.sort_by(|a, b| a.cost_ms.total_cmp(&b.cost_ms));
        let within: Vec<Candidate> = candidates.iter().filter(|candidate| candidate.cost_ms <= ms).copied().collect();
        let Some(chosen) = most_accurate(&within) else {
            let Some(cheapest) = candidates.first() else {
                return Err(PlanError::Lost(self.rig.name.clone()));
            };
            return Err(PlanError::TooFast {
                asked: ms,
                possible: cheapest.cost_ms,
                fastest: cheapest.plan.to_string(),
            });
        };
        let exact = self.with_depth(chosen)?;
        Ok(Choice { chosen: if exact.cost_ms <= ms { exact } else { chosen }, candidates })
    }
}

/// Rays by the reference itself, for scenes of which so little is visible that no sample meets it.
fn exact(scene: &ShadedScene, rig: &Rig, straight: &Mesh, fixed: Fixed) -> Result<Candidate, PlanError> {
    if !anything_visible(scene, rig) {
        return Err(PlanError::NothingVisible(rig.name.clone()));
    }
    let plan = Plan {
        projection: Projection::ConeRoot,
        precision: Precision::Double,
        edges: Edges::Rays,
        depth: DepthTest::Exact,
        ..Plan::default()
    };
    let is_allowed = fixed.projection.is_none_or(|projection| projection == plan.projection)
        && fixed.precision.is_none_or(|precision| precision == plan.precision);
    if !is_allowed {
        return Err(PlanError::Lost(rig.name.clone()));
    }
    let work = Work::of(straight, rig);
    let cost_ms = turn_ns(&plan, &work) / 1e6;
    Ok(Candidate { plan, error_px: FLOOR_PX, error_arcmin: 0.0, depth_m: 0.0, cost_ms, work })
}

/// Whether `scene` comes so near to where viewers are that pieces of it pass them, which only rays draw right. Triangles that lie
/// wholly beyond all sight lines do not count.
fn reaches_viewers(scene: &ShadedScene, rig: &Rig) -> bool {
    let distance_m = match rig.viewers() {
        Viewers::Circle { distance_m, .. } => distance_m,
        Viewers::Curve(curve) => curve.distances()[0],
        Viewers::Infinity { .. } => return false,
    };
    let reach_m = reach_m(rig);
    let triangles = scene.triangles.iter().map(|triangle| triangle.positions.map(DVec3::from));
    let corners = triangles.filter(|corners| !is_out_of_reach(*corners, reach_m)).flatten();
    corners.map(|position| position.with_y(0.0).length()).fold(0.0, f64::max) > 0.9 * distance_m
}

/// The first, which is the cheapest, of those with the smallest error.
fn most_accurate(candidates: &[Candidate]) -> Option<Candidate> {
    candidates.iter().copied().min_by(|a, b| a.error_px.total_cmp(&b.error_px))
}

/// Metres on the mirror between two pixels at the middle of the panel.
fn pitch_m(rig: &Rig) -> f64 {
    let optics = SliceOptics::new(rig, 0, rig.slice_angle(0), Model::Planar);
    let middle = DVec2::new(rig.projector.width_px.into(), rig.projector.height_px.into()) / 2.0;
    let ends = [middle, middle + DVec2::X].map(|pixel| optics.mirror_of(pixel));
    match ends {
        [Some(a), Some(b)] => a.distance(b),
        _ => 1e-4,
    }
}
