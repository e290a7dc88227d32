//! Halftone by a search over the slices of a turn together, for content that is baked.
//!
//! An eye sums two or three slices on each sight line. With e = b − l the energy over all sight lines is
//! Σ ω(k, j) ⟨G e(k), G e(k + j) at p′⟩, where ω is the mean product of the weights with which two slices reach a random eye,
//! and p′ is what slice k + j shows on the sight line that slice k shows at p. Slices are searched in turn while their neighbours
//! are held; those that do not see each other are searched at once. Nothing is listed by eyes, so no eye is favoured.

use super::blur::eye_blur;
use super::plan::Halftone;
use super::turn::{Depth, Turn, TurnTooLarge};
use glam::{DVec2, Vec2};
use protocol::rig::Rig;
use rayon::prelude::*;
use shaders::halftone::search::{Field, Kernel, Moves, Search};
use shaders::halftone::{Slot, halftone};
use shaders::project::{Model, SliceOptics, Viewer};

/// The share of the error that an eye is taken to see without blur. Sharper eyes, nearer ones and cameras do; it makes the dots of
/// neighbouring slices fill each other's gaps, which is worth 0.2 dB to the measure on top of [`Kernel::sampled`].
const SHARP: f32 = 0.1;
/// Moments of an exposure at which the mirror is taken.
const MOMENTS: i32 = 4;
/// Couplings weaker than this, against a slice's with itself, are left out.
const FAINT: f64 = 0.02;
/// Columns and rows of the squares of pixels that share a motion.
const TILE: u32 = 8;

/// Sweeps after which another one gains less than 0.1 dB.
pub const SWEEPS: u32 = 4;

/// The search over a turn of grey slices.
pub struct Joint<'a> {
    rig: &'a Rig,
    grey: &'a Turn,
    /// By face.
    couplings: Vec<Vec<Coupling>>,
}

/// How a slice feels another at some moments of their exposures.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Coupling {
    /// The other slice less this one; not 0.
    step: i32,
    /// How far the mirror turns between the moments, in slices.
    turned: f64,
    /// ω against ω(k, k).
    weight: f64,
}

impl<'a> Joint<'a> {
    /// A search for `rig` toward the slices of `grey`, which must hold grey.
    pub fn new(rig: &'a Rig, grey: &'a Turn) -> Self {
        Self { rig, grey, couplings: (0..rig.mirror.face.len()).map(|face| couplings(rig, face)).collect() }
    }

    /// The bits that the search begins with.
    pub fn start(&self) -> Result<Turn, TurnTooLarge> {
        let (slices, width, height) = (self.rig.rotation.slices, self.grey.width(), self.grey.height());
        let mut turn = Turn::dark(slices, width, height, Depth::Binary)?;
        let bytes = turn.slice_bytes();
        let method = Halftone::OptimisedDiffusion.binary().expect("a binary method");
        turn.bytes_mut().par_chunks_mut(bytes).zip(0..slices).for_each(|(plane, slice)| {
            let slot = Slot { slice, turn: 0, blur: eye_blur(self.rig, slice) };
            halftone(method, slot, width, &self.luminance(slice), plane);
        });
        Ok(turn)
    }

    /// All of it: the bits after `sweeps` sweeps. `done` is called from any thread after each slice of each sweep.
    pub fn search_all(&self, sweeps: u32, done: &(dyn Fn() + Sync)) -> Result<Turn, TurnTooLarge> {
        let mut turn = self.start()?;
        (0..sweeps * self.stages()).for_each(|stage| self.improve(&mut turn, stage, done));
        Ok(turn)
    }

    /// Stages of a sweep: in each, slices that do not feel each other are searched.
    pub fn stages(&self) -> u32 {
        self.apart() + self.rig.rotation.slices % self.apart()
    }

    /// The slices of stage `stage`, counted on over sweeps: every so many of them, and one by one those that are left over where
    /// the turn closes.
    pub fn members(&self, stage: u32) -> Vec<u32> {
        let (slices, apart) = (self.rig.rotation.slices, self.apart());
        let (stage, regular) = (stage % self.stages(), slices - slices % apart);
        if stage < apart { (stage..regular).step_by(apart as usize).collect() } else { vec![regular + stage - apart] }
    }

    /// How far apart the slices of a stage are.
    fn apart(&self) -> u32 {
        (self.reach() + 1).min(self.rig.rotation.slices)
    }

    /// How many slices away the farthest is that a slice feels.
    fn reach(&self) -> u32 {
        self.couplings.iter().flatten().map(|coupling| coupling.step.unsigned_abs()).max().unwrap_or(0)
    }

    /// Searches the slices of stage `stage`, counted on over sweeps. `done` is called from any thread after each slice.
    pub fn improve(&self, turn: &mut Turn, stage: u32, done: &(dyn Fn() + Sync)) {
        let members = self.members(stage);
        let held = &*turn;
        let improve = |slice: &u32| {
            let plane = self.improved(held, *slice);
            done();
            plane
        };
        let planes: Vec<Vec<u8>> = members.par_iter().map(improve).collect();
        let bytes = turn.slice_bytes();
        for (slice, plane) in members.into_iter().zip(planes) {
            turn.bytes_mut()[slice as usize * bytes..][..bytes].copy_from_slice(&plane);
        }
    }

    /// The bits of `slice` after one sweep, the others of `turn` being held.
    fn improved(&self, turn: &Turn, slice: u32) -> Vec<u8> {
        let mut plane = turn.slice(slice).to_vec();
        let (kernel, mut search) = self.search(turn, slice);
        let slices = i64::from(self.rig.rotation.slices);
        let other = |step: i32| (i64::from(slice) + i64::from(step)).rem_euclid(slices) as u32;
        let reach = self.reach() as i32;
        let fields: Vec<Option<Field>> = (-reach..=reach)
            .map(|step| {
                let felt =
                    self.couplings.iter().flatten().any(|coupling| coupling.step == step) && other(step) != slice;
                felt.then(|| {
                    let (kernel, search) = self.search(turn, other(step));
                    search.field(&kernel, SHARP)
                })
            })
            .collect();
        let motions = Motions::new(self.rig, slice);
        search.add_field(|x, y| {
            let Some((face, motion)) = motions.at(x, y) else { return 0.0 };
            let pixel = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let felt = self.couplings[face].iter().filter_map(|coupling| {
                let at = pixel + coupling.turned as f32 * motion;
                let field = fields[(coupling.step + reach) as usize].as_ref()?;
                Some(coupling.weight as f32 * field.at(at.x, at.y))
            });
            felt.sum()
        });
        search.sweep(&kernel, Moves::Swaps);
        search.write(turn.width(), &mut plane);
        plane
    }

    fn search(&self, turn: &Turn, slice: u32) -> (Kernel, Search) {
        let kernel = Kernel::sampled(eye_blur(self.rig, slice));
        let search = Search::new(&kernel, turn.width(), &self.luminance(slice), turn.slice(slice));
        (kernel, search)
    }

    fn luminance(&self, slice: u32) -> Vec<f32> {
        self.grey.slice(slice).iter().map(|byte| f32::from(*byte) / 255.0).collect()
    }
}

/// How the slices of `face` are coupled: the lobe's autocorrelation over the moments of two exposures.
fn couplings(rig: &Rig, face: usize) -> Vec<Coupling> {
    let lobe = rig.mirror.face[face].lobe();
    let per_slice = skew_per_slice(rig, face);
    let weight = |skew: f64| {
        let pair = lobe.windows(2).find(|pair| pair[0][0] <= skew && skew < pair[1][0]);
        pair.map_or(0.0, |pair| {
            pair[0][1] + (pair[1][1] - pair[0][1]) * (skew - pair[0][0]) / (pair[1][0] - pair[0][0])
        })
    };
    let (first, last) = (lobe[0][0], lobe[lobe.len() - 1][0]);
    let correlation = |turned: f64| -> f64 {
        const PARTS: i32 = 256;
        let skews = (0..PARTS).map(|part| first + (last - first) * (f64::from(part) + 0.5) / f64::from(PARTS));
        skews.map(|skew| weight(skew) * weight(skew + turned * per_slice)).sum()
    };
    // Two moments of MOMENTS each differ by `lag` of them in as many ways as the triangle says.
    let between = |step: i32, lag: i32| {
        let turned = f64::from(step) + f64::from(lag) / f64::from(MOMENTS);
        (turned, f64::from(MOMENTS - lag.abs()) * correlation(turned))
    };
    let lags = 1 - MOMENTS..MOMENTS;
    let itself: f64 = lags.clone().map(|lag| between(0, lag).1).sum();
    let reach = ((last - first) / per_slice).ceil() as i32;
    let steps = (-reach..=reach).filter(|step| *step != 0);
    let pairs = steps.flat_map(|step| lags.clone().map(move |lag| (step, lag)));
    let all = pairs.map(|(step, lag)| {
        let (turned, product) = between(step, lag);
        Coupling { step, turned, weight: product / itself }
    });
    all.filter(|coupling| coupling.weight > FAINT).collect()
}

/// How far the light of a sight line through the panel's middle leaves the lobe's axis while the mirror turns by a slice, in radians.
fn skew_per_slice(rig: &Rig, face: usize) -> f64 {
    let keys = &rig.mirror.face[face];
    let width = core::f64::consts::TAU / f64::from(rig.rotation.slices);
    let frame = keys.frame(rig.slice_angle(0));
    let middle = keys.offset_m * frame.normal + keys.slope_span_m.iter().sum::<f64>() / 2.0 * frame.slope;
    let optics = SliceOptics::new(rig, face, rig.slice_angle(0), Model::Planar);
    let Some(toward) = optics.sight_of(middle).map(|sight| toward(sight.viewer, middle)) else { return width };
    let skew = |theta: f64| {
        let frame = keys.frame(theta);
        let hit = middle + toward * ((keys.offset_m - frame.normal.dot(middle)) / frame.normal.dot(toward));
        let inward = (hit - rig.camera().position).normalize();
        frame.across.dot(toward.normalize()).asin() - frame.across.dot(inward).asin()
    };
    let theta = rig.slice_angle(0);
    let per_slice = (skew(theta + width / 2.0) - skew(theta - width / 2.0)).abs();
    // A lobe that the mirror's turning hardly moves would couple all slices; no mirror that shows a picture does that.
    per_slice.max(width / 4.0)
}

/// From `point` toward `viewer`, not of unit length.
fn toward(viewer: Viewer, point: glam::DVec3) -> glam::DVec3 {
    match viewer {
        Viewer::At(position) => position - point,
        Viewer::Toward(direction) => direction,
    }
}

/// Where the sight lines that a slice shows move on the projector's image while the mirror turns by a slice.
struct Motions {
    columns: usize,
    /// By square: the face that it shows, and px a slice.
    squares: Vec<Option<(usize, Vec2)>>,
}

impl Motions {
    fn new(rig: &Rig, slice: u32) -> Self {
        let theta = rig.slice_angle(slice);
        let faces: Vec<_> =
            (0..rig.mirror.face.len()).map(|face| SliceOptics::new(rig, face, theta, Model::Cone)).collect();
        let [columns, rows] = [rig.projector.width_px, rig.projector.height_px].map(|side| side.div_ceil(TILE));
        let middle = |square: u32| {
            let corner = [square % columns, square / columns].map(|place| f64::from(place * TILE));
            DVec2::from(corner) + f64::from(TILE) / 2.0
        };
        let squares = (0..columns * rows).map(|square| motion(rig, &faces, slice, middle(square))).collect();
        Self { columns: columns as usize, squares }
    }

    fn at(&self, x: usize, y: usize) -> Option<(usize, Vec2)> {
        self.squares[y / TILE as usize * self.columns + x / TILE as usize]
    }
}

/// The face that `pixel` shows in `slice`, the first on the projector's ray, and how far its sight line moves.
fn motion(rig: &Rig, faces: &[SliceOptics], slice: u32, pixel: DVec2) -> Option<(usize, Vec2)> {
    let hits = faces.iter().enumerate().filter_map(|(face, optics)| {
        let mirror = optics.mirror_of(pixel).filter(|mirror| optics.sides(*mirror) == 0)?;
        Some((face, mirror))
    });
    let (face, mirror) =
        hits.min_by(|(a, near), (b, far)| faces[*a].throw_m(*near).total_cmp(&faces[*b].throw_m(*far)))?;
    let moved = seen_after(rig, face, &faces[face], mirror, rig.slice_angle(slice + 1))?;
    Some((face, (moved - pixel).as_vec2()))
}

/// The pixel that the sight line through `mirror` meets when the mirror has turned to `theta`.
fn seen_after(rig: &Rig, face: usize, optics: &SliceOptics, mirror: glam::DVec3, theta: f64) -> Option<DVec2> {
    let toward = toward(optics.sight_of(mirror)?.viewer, mirror);
    let keys = &rig.mirror.face[face];
    let normal = keys.frame(theta).normal;
    rig.camera().project(mirror + toward * ((keys.offset_m - normal.dot(mirror)) / normal.dot(toward)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rigs;

    fn grey(rig: &Rig) -> Turn {
        Turn::dark(rig.rotation.slices, rig.projector.width_px, rig.projector.height_px, Depth::Grey).unwrap()
    }

    #[test]
    fn neighbours_couple_as_the_hat_says() {
        // rig.md: the hat's width of a slice, a ray that leaves it within two slices.
        let couplings = couplings(&rigs::find("reference").unwrap(), 0);
        let sum: f64 = couplings.iter().map(|coupling| coupling.weight).sum();
        assert!((0.7..0.85).contains(&sum), "{sum}");
        for coupling in &couplings {
            let back = Coupling { step: -coupling.step, turned: -coupling.turned, ..*coupling };
            let mirrored =
                couplings.iter().find(|other| other.step == back.step && other.turned == back.turned).unwrap();
            assert!((mirrored.weight - coupling.weight).abs() < 1e-6 && coupling.step.abs() == 1);
        }
    }

    #[test]
    fn a_sight_line_comes_back_when_the_mirror_does() {
        for name in ["reference", "high-viewer", "tent"] {
            let mut rig = rigs::find(name).unwrap();
            for clockwise in [false, true] {
                if clockwise {
                    rig.rotation.direction = protocol::timing::Direction::Clockwise;
                }
                let (here, there) = (Motions::new(&rig, 20), Motions::new(&rig, 21));
                let (mut far, mut known) = (0.0f32, 0);
                for (x, y) in (40..728).step_by(37).flat_map(|x| (40..728).step_by(41).map(move |y| (x, y))) {
                    let Some((face, motion)) = here.at(x, y) else { continue };
                    let [u, v] = (Vec2::new(x as f32, y as f32) + motion).to_array().map(|place| place as usize);
                    let Some((other, back)) = there.at(u.min(767), v.min(767)) else { continue };
                    if other == face {
                        // Motion is taken alike within a square, and nearly so from slice to slice.
                        assert!((motion - back).length() < 0.3, "{name} ({x}, {y}): {motion} {back}");
                        far = far.max(motion.length());
                        known += 1;
                    }
                }
                assert!(known > 80 && (2.0..9.0).contains(&far), "{name}: {known}, {far} px");
            }
        }
    }

    #[test]
    fn every_slice_is_searched_once_a_sweep_and_none_beside_another() {
        let mut rig = rigs::find("reference").unwrap();
        (rig.projector.width_px, rig.projector.height_px) = (8, 8);
        for (slices, hat_deg) in [(288, 1.25), (288, 3.0), (25, 14.0), (7, 30.0), (3, 80.0), (1, 1.0)] {
            rig.rotation.slices = slices;
            rig.mirror.face[0].diffuser_hat_radius_deg = Some(hat_deg);
            let grey = grey(&rig);
            let joint = Joint::new(&rig, &grey);
            let mut all: Vec<u32> = (0..joint.stages()).flat_map(|stage| joint.members(stage)).collect();
            all.sort_unstable();
            assert_eq!(all, (0..slices).collect::<Vec<_>>(), "{slices} {hat_deg}");
            for stage in 0..joint.stages() {
                let members = joint.members(stage);
                for (a, b) in members.iter().flat_map(|a| members.iter().map(move |b| (*a, *b))) {
                    let apart = a.abs_diff(b).min(slices - a.abs_diff(b));
                    assert!(apart == 0 || apart > joint.reach(), "{slices} {hat_deg}: {a} {b}");
                }
            }
        }
    }
}
