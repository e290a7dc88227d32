//! Renderers against each other: how long a turn takes, on what, and where the time goes.

pub mod draw;
mod parts;
pub mod rounds;
pub mod table;
pub mod who;

use crate::machine::Machine;
use crate::render::plan::choose::{Budget, Fixed, PlanError, choose, predict};
use crate::render::plan::cost::Work;
use crate::render::plan::{Edges, Halftone, Plan, Projection};
use crate::render::tessellate::tessellate;
use crate::scene::ShadedScene;
use protocol::rig::Rig;
use serde::Serialize;
use std::collections::BTreeMap;
use who::Who;

/// Slice counts of a sweep: from 2 to 48 frames.
pub const SWEEP: [u32; 6] = [48, 96, 144, 288, 576, 1152];

/// One thing to measure: a renderer on a scene, on a rig, by a plan.
#[derive(Clone)]
pub struct Case<'a> {
    /// What the scene is called.
    pub scene_name: &'a str,
    /// Lit.
    pub scene: &'a ShadedScene,
    /// The hardware.
    pub rig: Rig,
    /// The methods.
    pub plan: Plan,
    /// What there is to do for a turn of the rig that was asked for.
    pub work: Work,
    /// Who renders.
    pub who: Who,
    /// Whether it belongs to the sweep over slice counts.
    pub is_of_sweep: bool,
}

impl Case<'_> {
    /// The slices that are rendered: all, or of the clear renderer, which is slow, up to 48, whose time is scaled up. Fewer
    /// would show what it allocates for each call: at 12 of 288 a turn seems to take half as long again.
    pub fn slices(&self) -> Vec<u32> {
        let all = self.rig.rotation.slices;
        let step = if self.who == Who::Clear { all.div_ceil(48) } else { 1 };
        (0..all).step_by(step as usize).collect()
    }
}

/// The quartiles of many times, in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// The smallest.
    pub least: f64,
    /// A quarter of all are below.
    pub lower: f64,
    /// Half of all are below.
    pub median: f64,
    /// Three quarters of all are below.
    pub upper: f64,
}

impl Spread {
    /// Of `values`, of which there must be one at least; linear between neighbours.
    pub fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let at = |part: f64| {
            let place = part * (values.len() - 1) as f64;
            let (below, above) = (values[place.floor() as usize], values[place.ceil() as usize]);
            below + (above - below) * place.fract()
        };
        Self { least: at(0.0), lower: at(0.25), median: at(0.5), upper: at(0.75) }
    }
}

/// What was measured of a [`Case`].
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// What the scene is called.
    pub scene: String,
    /// Triangles of the scene.
    pub triangles: usize,
    /// What there was to do for a turn; with another number of slices, of the rig that was asked for.
    pub work: Work,
    /// Slices a turn.
    pub slices: u32,
    /// The methods.
    pub plan: Plan,
    /// Who rendered.
    pub who: Who,
    /// What it calls itself.
    pub renderer: String,
    /// Whether it belongs to the sweep over slice counts.
    pub is_of_sweep: bool,
    /// How many turns, or samples of one, were timed.
    pub runs: usize,
    /// How many slices were rendered in each; fewer than `slices` where the time was scaled up.
    pub slices_rendered: u32,
    /// To prepare the scene, once.
    pub prepare_ms: f64,
    /// For a turn.
    pub turn_ms: Spread,
    /// Median time of all cores together for a turn; `None` where the system does not say it.
    pub cores_ms: Option<f64>,
    /// Slices a second, by the median.
    pub slices_per_second: f64,
    /// Turns a second, by the median.
    pub turns_per_second: f64,
    /// How many times faster than the baseline on the same scene, rig, model and halftone, by the medians.
    pub times_faster: Option<f64>,
    /// The same by the time of all cores together, which other programs on the machine disturb less.
    pub times_less_cores: Option<f64>,
    /// Medians of the parts of a turn in milliseconds, in order, as [`crate::render::Prepared::stages`] has them.
    pub stages: Vec<(&'static str, f64)>,
    /// The most memory of a process that does nothing else, in bytes.
    pub peak_bytes: Option<u64>,
}

/// All that a run measured.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// `praxi`.
    pub program: &'static str,
    /// Its version.
    pub version: &'static str,
    /// On what.
    pub machine: Machine,
    /// GPUs that took part.
    pub adapters: Vec<String>,
    /// The rig.
    pub rig: String,
    /// Image width and height.
    pub image_px: [u32; 2],
    /// Turns that the rig shows in a second.
    pub rig_turns_per_second: f64,
    /// How far lines may lie from where the model puts them, projector pixels.
    pub budget_px: f64,
    /// The seed of the order of measurements.
    pub seed: u64,
    /// How often each case had its turn.
    pub rounds: u32,
    /// Whose time ratios refer to.
    pub baseline: Option<Who>,
    /// One for each case.
    pub rows: Vec<Row>,
    /// To pack a turn into frames, by slices a turn.
    pub pack_ms: BTreeMap<u32, Spread>,
    /// What was left out, and why.
    pub notes: Vec<String>,
}

impl Report {
    /// Sets ratios: to the pass for each slice, or to the clear renderer where no GPU took part.
    pub fn compare(&mut self) {
        self.baseline = [Who::GpuSlice, Who::Clear].into_iter().find(|who| self.rows.iter().any(|row| row.who == *who));
        let same = |a: &Row, b: &Row| (&a.scene, a.slices, a.plan) == (&b.scene, b.slices, b.plan);
        let baseline = |row: &Row| self.rows.iter().find(|one| Some(one.who) == self.baseline && same(one, row));
        let ratio = |of: &dyn Fn(&Row) -> Option<f64>| -> Vec<Option<f64>> {
            self.rows.iter().map(|row| Some(of(baseline(row)?)? / of(row)?)).collect()
        };
        let (times, cores) = (ratio(&|row| Some(row.turn_ms.median)), ratio(&|row| row.cores_ms));
        for ((row, times), cores) in self.rows.iter_mut().zip(times).zip(cores) {
            (row.times_faster, row.times_less_cores) = (times, cores);
        }
    }
}

impl Report {
    /// The scenes in order.
    pub fn scenes(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.rows.iter().map(|row| row.scene.as_str()).collect();
        names.dedup();
        names
    }

    /// The rows of a scene's sweep over slice counts by one renderer, rising; none where there was no sweep.
    pub fn sweep(&self, scene: &str, who: Who) -> Vec<&Row> {
        let of_case = |row: &&Row| row.scene == scene && row.who == who;
        let Some(swept) = self.rows.iter().filter(of_case).find(|row| row.is_of_sweep) else { return Vec::new() };
        let mut rows: Vec<&Row> = self.rows.iter().filter(of_case).filter(|row| row.plan == swept.plan).collect();
        rows.sort_by_key(|row| row.slices);
        rows
    }
}

/// What to measure.
pub struct Wish<'a> {
    /// Names and scenes.
    pub scenes: &'a [(String, ShadedScene)],
    /// The rig.
    pub rig: &'a Rig,
    /// Who renders.
    pub renderers: &'a [Who],
    /// How V' is found.
    pub projections: &'a [Projection],
    /// How luminance becomes bits.
    pub halftones: &'a [Halftone],
    /// How far lines may lie from where the model puts them, projector pixels.
    pub budget_px: f64,
    /// Whether the first scene, projection and halftone are measured at [`SWEEP`]'s slice counts too.
    pub sweep: bool,
}

/// The cases of `wish`, those of one scene together. `done` is called after each scene.
///
/// Every plan cuts edges so that they stay within the budget. The planar fan as a model lies farther than that from the cone; its plan is
/// the one by which Newton's cone keeps the budget, with the other model, so that both do the same work.
pub fn cases<'a>(wish: &Wish<'a>, done: &dyn Fn()) -> Result<Vec<Case<'a>>, PlanError> {
    let mut cases = Vec::new();
    for (place, (scene_name, scene)) in wish.scenes.iter().enumerate() {
        for (index, projection) in wish.projections.iter().enumerate() {
            let (plan, work) = plan(scene, wish.rig, *projection, wish.budget_px)?;
            let mut add = |slices, halftone, is_of_sweep: bool| {
                // A sample of slices, scaled up, grows as they do: there is nothing to see.
                let renderers = wish.renderers.iter().filter(|who| !is_of_sweep || **who != Who::Clear);
                cases.extend(renderers.map(|who| Case {
                    scene_name,
                    scene,
                    rig: with_slices(wish.rig, slices),
                    plan: Plan { halftone, ..plan },
                    work,
                    who: *who,
                    is_of_sweep,
                }));
            };
            for halftone in wish.halftones {
                add(wish.rig.rotation.slices, *halftone, false);
            }
            if let (true, [0, 0], Some(halftone)) = (wish.sweep, [place, index], wish.halftones.first()) {
                // The rig's own count has been measured already.
                let others = SWEEP.into_iter().filter(|slices| *slices != wish.rig.rotation.slices);
                others.for_each(|slices| add(slices, *halftone, true));
            }
        }
        done();
    }
    Ok(cases)
}

fn plan(scene: &ShadedScene, rig: &Rig, projection: Projection, px: f64) -> Result<(Plan, Work), PlanError> {
    let model = if projection == Projection::Planar { Projection::ConeNewton } else { projection };
    let fixed = Fixed { projection: Some(model), edges: Some(Edges::Adaptive), ..Fixed::default() };
    let chosen = choose(scene, rig, fixed, Budget::Error(px))?.chosen;
    if projection == model {
        return Ok((chosen.plan, chosen.work));
    }
    let plan = Plan { projection, ..chosen.plan };
    // The planar fan must draw the whole scene, too.
    let drawn = predict(&tessellate(scene, rig, &plan)?, rig, &plan);
    drawn.map(|drawn| (plan, drawn.work)).ok_or_else(|| PlanError::Lost(rig.name.clone()))
}

/// `rig` with another number of slices a turn, at the same turns a second where the projector can be so fast.
fn with_slices(rig: &Rig, slices: u32) -> Rig {
    let mut other = rig.clone();
    other.rotation.slices = slices;
    other.rotation.refresh_hz *= f64::from(slices) / f64::from(rig.rotation.slices);
    other.checked().unwrap_or_else(|_| {
        let mut other = rig.clone();
        other.rotation.slices = slices;
        other
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rigs;
    use crate::scene::{Scene, Shading, shade};

    #[test]
    fn quartiles_are_those_of_the_textbook() {
        let spread = Spread::of(vec![4.0, 1.0, 3.0, 2.0, 5.0]);
        assert_eq!(spread, Spread { least: 1.0, lower: 2.0, median: 3.0, upper: 4.0 });
        assert_eq!(Spread::of(vec![1.0, 2.0, 4.0, 8.0]).median, 3.0);
        assert_eq!(Spread::of(vec![7.0]), Spread { least: 7.0, lower: 7.0, median: 7.0, upper: 7.0 });
    }

    #[test]
    fn both_models_are_cut_for_the_same_budget_and_sweeps_keep_the_turn_rate() {
        let scenes = [("boxes".to_string(), shade(&Scene::load("boxes").unwrap(), Shading::Lambert, false))];
        let rig = rigs::find("reference").unwrap();
        let wish = Wish {
            scenes: &scenes,
            rig: &rig,
            renderers: &[Who::Clear, Who::CpuPortable],
            projections: &[Projection::Planar, Projection::ConeNewton],
            halftones: &[Halftone::BlueNoise, Halftone::Bayer],
            budget_px: 0.5,
            sweep: true,
        };
        let cases = cases(&wish, &|| ()).unwrap();
        let (swept, main): (Vec<_>, Vec<_>) = cases.iter().partition(|case| case.is_of_sweep);
        assert_eq!((main.len(), swept.len()), (8, 5));
        let [planar, cone] = [0, 4].map(|index| Plan { projection: Projection::Planar, ..main[index].plan });
        assert!(planar == cone && main[4].plan.projection == Projection::ConeNewton);
        assert!(main.iter().all(|case| case.work.triangles_a_slice > 2 * scenes[0].1.triangles.len()));
        assert!(swept.iter().all(|case| (case.rig.turns_per_second() - 20.0).abs() < 1e-9));
        assert_eq!((main[0].slices().len(), main[1].slices().len()), (48, 288));
    }
}
