//! The cone's answer beside the planar one, tabulated over the mirror's frame.
//!
//! With the projector on the axis nothing else depends on the slice. With one off the axis the projector goes round in the mirror's
//! frame, and the table is an interpolation, by the trigonometric polynomial, of tables at equally spaced mirror angles.

use super::kernel::SliceProjector;
use super::{Method, Real};
use crate::project::{Model, SliceOptics};
use core::f64::consts::TAU;
use protocol::rig::Rig;
use std::sync::Arc;

/// Nodes along each axis.
const NODES: usize = 12;
/// Cells whose middle is off by more than this are left to Newton's method. The middle is where the error is largest.
const TOLERANCE_PX: f64 = 0.03;
/// How many angles are tried in turn where the table depends on the slice, as long as it gains by them.
const ANGLES: [usize; 2] = [8, 16];
/// The projector's distance from the axis over its height up to which a table is made. The trigonometric polynomial's terms fall
/// off like this ratio's powers; far beyond it a cone may miss the viewing circle at angles between the samples.
const ASIDE_MAX: f64 = 0.5;

/// A face's table: how far the cone moves the viewer across, over the planar line's way across, which it is about proportional to.
#[derive(Clone, Debug)]
pub(super) struct Table<F> {
    reach: f64,
    /// For each of the equally spaced angles the nodes, x fastest, then y, then z; NaN where there is no answer.
    samples: Vec<Arc<[F]>>,
}

/// The table in one slice.
#[derive(Clone, Debug)]
pub(super) struct SliceTable<F> {
    reach: F,
    /// Cells a metre.
    density: F,
    nodes: Arc<[F]>,
}

impl<F: Real> Table<F> {
    /// `None` where the projector is too far aside for a table of few angles.
    pub(super) fn new(rig: &Rig, face: usize) -> Option<Self> {
        let position = rig.camera().position;
        if position.x.hypot(position.z) > ASIDE_MAX * position.y {
            return None;
        }
        let optics = |theta| SliceOptics::new(rig, face, theta, Model::Cone);
        let root = |theta| SliceProjector::new(optics(theta), Method::ConeRoot, None);
        let reach = optics(0.0).reach_m();
        let sampled = |angles: usize| {
            let angle = |index| TAU * index as f64 / angles as f64;
            let mut table =
                Table { reach, samples: (0..angles).map(|index| sample(reach, &root(angle(index)))).collect() };
            let refused = table.refuse(|theta| (root(theta), optics(theta)));
            (table, refused)
        };
        let (mut table, mut refused) = sampled(1);
        for angles in ANGLES {
            let few = refused * 100 <= (NODES - 1).pow(3);
            let finer = if few { break } else { sampled(angles) };
            if finer.1 >= refused {
                break;
            }
            (table, refused) = finer;
        }
        let rounded = |nodes: &Arc<[f64]>| nodes.iter().map(|value| F::of(*value)).collect();
        Some(Self { reach, samples: table.samples.iter().map(rounded).collect() })
    }

    /// The table at mirror angle `theta` radians.
    pub(super) fn at(&self, theta: f64) -> SliceTable<F> {
        let nodes = match self.samples.as_slice() {
            [only] => only.clone(),
            samples => {
                let weights: Vec<_> =
                    (0..samples.len()).map(|angle| F::of(weight(theta, angle, samples.len()))).collect();
                let mut nodes = vec![F::zero(); NODES.pow(3)];
                for (sample, weight) in samples.iter().zip(weights) {
                    nodes.iter_mut().zip(sample.iter()).for_each(|(node, value)| *node = *node + weight * *value);
                }
                nodes.into()
            }
        };
        SliceTable { reach: F::of(self.reach), density: F::of((NODES - 1) as f64 / (2.0 * self.reach)), nodes }
    }
}

impl Table<f64> {
    /// Empties the cells whose middle is off by more than [`TOLERANCE_PX`] at an angle between the samples. How many of them
    /// lie in the ball of the panel's reach, which holds what is visible.
    fn refuse(&mut self, root: impl Fn(f64) -> (SliceProjector<f64>, SliceOptics)) -> usize {
        let angles = self.samples.len().max(ANGLES[0]);
        let trials: Vec<_> = (0..angles)
            .map(|angle| {
                let theta = TAU * (angle as f64 + 0.5) / angles as f64;
                let (root, optics) = root(theta);
                (root.with_table(self.at(theta)), optics.px_per_m())
            })
            .collect();
        let refused: Vec<_> = nodes()
            .filter(|node| node.iter().all(|index| *index < NODES - 1))
            .filter(|node| {
                let middle = node.map(|index| place(self.reach, index as f64 + 0.5));
                trials.iter().any(|(root, px_per_m)| {
                    !root.table_error_m(middle).is_some_and(|error| error * px_per_m <= TOLERANCE_PX)
                })
            })
            .collect();
        for sample in &mut self.samples {
            let mut nodes = sample.to_vec();
            refused.iter().for_each(|node| nodes[at(*node)] = f64::NAN);
            *sample = nodes.into();
        }
        let level = |index: usize| (2.0 * (index as f64 + 0.5) / (NODES - 1) as f64 - 1.0).powi(2);
        refused.iter().filter(|node| node.map(level).iter().sum::<f64>() < 1.0).count()
    }
}

impl<F: Real> SliceTable<F> {
    /// At a point of the mirror's frame, linear between nodes; `None` outside the table and in emptied cells.
    pub(super) fn correction(&self, point: [F; 3]) -> Option<F> {
        let place = point.map(|coordinate| (coordinate + self.reach) * self.density);
        let last = F::of((NODES - 1) as f64);
        if !place.iter().all(|coordinate| *coordinate >= F::zero() && *coordinate < last) {
            return None;
        }
        let cell = place.map(|coordinate| coordinate.to_usize().unwrap_or(0));
        let [x, y, z] = [0, 1, 2].map(|axis| place[axis] - F::of(cell[axis] as f64));
        let corner = at(cell);
        let between = |low: F, high: F, part: F| low + (high - low) * part;
        let row = |start: usize| between(self.nodes[start], self.nodes[start + 1], x);
        let plane = |start: usize| between(row(start), row(start + NODES), y);
        let value = between(plane(corner), plane(corner + NODES * NODES), z);
        (!value.is_nan()).then_some(value)
    }
}

fn nodes() -> impl Iterator<Item = [usize; 3]> {
    (0..NODES).flat_map(|z| (0..NODES).flat_map(move |y| (0..NODES).map(move |x| [x, y, z])))
}

fn at([x, y, z]: [usize; 3]) -> usize {
    (z * NODES + y) * NODES + x
}

/// The coordinate, in metres, of a place between nodes.
fn place(reach: f64, index: f64) -> f64 {
    reach * (2.0 * index / (NODES - 1) as f64 - 1.0)
}

fn sample(reach: f64, root: &SliceProjector<f64>) -> Arc<[f64]> {
    nodes().map(|node| root.correction(node.map(|index| place(reach, index as f64))).unwrap_or(f64::NAN)).collect()
}

/// The weight at `theta` of sample `angle` of an even number of `angles` in trigonometric interpolation.
fn weight(theta: f64, angle: usize, angles: usize) -> f64 {
    let (angle, angles) = (angle as f64, angles as f64);
    let apart = theta - TAU * angle / angles;
    let tangent = (apart / 2.0).tan();
    if tangent.abs() < 1e-9 { 1.0 } else { (apart * angles / 2.0).sin() / (angles * tangent) }
}
