//! Long edges are cut so that straight pieces stay close to the curves that the optics make of them.

use super::RenderError;
use super::bow::{Samples, Track, edge_limit_m, reach_m, whole_edge_m};
use super::mesh::{Mesh, Triangle};
use super::plan::{Edges, Plan};
use crate::scene::ShadedScene;
use glam::DVec3;
use protocol::rig::Rig;
use shaders::project::methods::Method;
use std::collections::HashMap;

/// More triangles than this are refused: at 100 bytes each they would fill 5 GB.
pub const TRIANGLES_MAX: usize = 50_000_000;

/// No edge shorter than this many metres is cut, whatever is asked: what bows there is the optics' own edge.
const SHORTEST_M: f64 = 1e-5;

/// The bow by samples, times this, is not below the bow in any slice: 24 of 288 slices and a few places on each piece miss some
/// of it.
const RESERVE: f64 = 1.1;

/// Cuts the scene's triangles as `plan.edges` says. What lies wholly farther from the axis than any sight line reaches is left out.
///
/// Whether and where an edge is cut depends on the edge alone, so that both its triangles cut it alike and no crack opens. A triangle
/// of which more than one edge is to be cut is cut across the most pressing one first, and its parts are looked at again.
pub fn tessellate(scene: &ShadedScene, rig: &Rig, plan: &Plan) -> Result<Mesh, RenderError> {
    let method = Method::from(plan.projection);
    let limit_m = |bow_px| edge_limit_m(rig, method.model(), scene_radius_m(scene), bow_px).max(SHORTEST_M);
    let rule = match plan.edges {
        Edges::Uniform => Rule { short_m: limit_m(plan.bow_px), whole_m: whole_edge_m(rig), optics: None },
        Edges::Straight | Edges::Rays => {
            let optics = Optics { samples: Samples::new(rig, method), tolerance_px: f64::INFINITY };
            Rule { short_m: whole_edge_m(rig), whole_m: whole_edge_m(rig), optics: Some(optics) }
        }
        Edges::Adaptive | Edges::Discard => {
            let optics = Optics { samples: Samples::new(rig, method), tolerance_px: plan.bow_px / RESERVE };
            // The middle of a triangle bows by a third more than its edges at most.
            Rule { short_m: limit_m(0.75 * plan.bow_px), whole_m: whole_edge_m(rig), optics: Some(optics) }
        }
    };
    let mut whole = Mesh::new(scene);
    let triangles = std::mem::take(&mut whole.triangles);
    let mut cutter = Cutter { rule, reach_m: reach_m(rig), mesh: whole, tracks: HashMap::new(), edges: HashMap::new() };
    for triangle in triangles {
        cutter.add(triangle);
        if cutter.mesh.triangles.len() > TRIANGLES_MAX {
            return Err(RenderError::TooManyTriangles {
                limit_mm: (cutter.rule.short_m * 1e3).round() as u32,
                allowed: TRIANGLES_MAX,
            });
        }
    }
    Ok(cutter.mesh)
}

fn scene_radius_m(scene: &ShadedScene) -> f64 {
    let corners = scene.triangles.iter().flat_map(|triangle| triangle.positions);
    f64::from(corners.map(|position| position.length_squared()).fold(0.0, f32::max)).sqrt()
}

/// Which edges are cut.
struct Rule {
    /// Edges up to this length in metres stay.
    short_m: f64,
    /// Longer edges with an end that has no pixel are cut.
    whole_m: f64,
    /// By what longer ones are judged; `None` where their length suffices.
    optics: Option<Optics>,
}

struct Optics {
    samples: Samples,
    tolerance_px: f64,
}

/// What becomes of an edge.
#[derive(Clone, Copy)]
struct Verdict {
    /// Above 1 for an edge that has to be cut, the more the sooner.
    pressing: f64,
    /// Into how many parts of one length it is to be cut in the end.
    parts: u32,
}

impl Verdict {
    const KEEP: Self = Self { pressing: 0.0, parts: 1 };

    fn new(pressing: f64) -> Self {
        Self { pressing, parts: pressing.ceil().clamp(1.0, 1e6) as u32 }
    }
}

/// An edge, by its ends in the order of their indices.
struct Edge {
    verdict: Verdict,
    /// The vertex at which it is cut.
    place: Option<u32>,
}

struct Cutter {
    rule: Rule,
    reach_m: f64,
    mesh: Mesh,
    tracks: HashMap<u32, Track>,
    edges: HashMap<[u32; 2], Edge>,
}

impl Cutter {
    fn add(&mut self, triangle: Triangle) {
        let mut waiting = vec![triangle];
        while let Some(triangle) = waiting.pop() {
            let lengths = [0, 1, 2].map(|edge| self.length_m(triangle.edge(edge)));
            let longest = lengths.into_iter().fold(0.0, f64::max);
            if self.is_out_of_reach(&triangle) || self.mesh.triangles.len() > TRIANGLES_MAX {
                continue;
            }
            if longest <= self.rule.short_m {
                self.mesh.triangles.push(triangle);
                continue;
            }
            let pressing = [0, 1, 2].map(|edge| self.verdict(triangle.edge(edge)).pressing);
            let worst = (0..3).max_by(|a, b| pressing[*a].total_cmp(&pressing[*b])).unwrap_or(0);
            if pressing[worst] > 1.0 {
                waiting.extend(self.cut(&triangle, worst));
            } else if let Some(place) = self.bulge(&triangle) {
                waiting.extend(triangle.cut_at_centroid(place));
            } else {
                self.mesh.triangles.push(triangle);
            }
        }
    }

    /// Whether the triangle lies outside the ball of reach: by the ball about its centre, which holds it.
    fn is_out_of_reach(&self, triangle: &Triangle) -> bool {
        let corners = self.mesh.corners(triangle);
        let centre = corners.iter().sum::<DVec3>() / 3.0;
        let radius = corners.iter().map(|position| position.distance(centre)).fold(0.0, f64::max);
        centre.length() - radius > self.reach_m
    }

    fn position(&self, vertex: u32) -> DVec3 {
        self.mesh.positions[vertex as usize]
    }

    fn length_m(&self, [from, to]: [u32; 2]) -> f64 {
        self.position(from).distance(self.position(to))
    }

    fn cut(&mut self, triangle: &Triangle, edge: usize) -> [Triangle; 2] {
        let [from, to] = triangle.edge(edge);
        let ends = [from.min(to), from.max(to)];
        let parts = self.verdict(ends).parts;
        let along = f64::from(parts / 2) / f64::from(parts);
        let known = self.edges[&ends].place;
        let place = known.unwrap_or_else(|| self.mesh.add(self.position(ends[0]).lerp(self.position(ends[1]), along)));
        self.edges.entry(ends).and_modify(|edge| edge.place = Some(place));
        triangle.cut_edge(edge, place, if from < to { along } else { 1.0 - along } as f32)
    }

    /// What becomes of the edge between two vertices, in either order.
    fn verdict(&mut self, [from, to]: [u32; 2]) -> Verdict {
        let ends = [from.min(to), from.max(to)];
        if let Some(edge) = self.edges.get(&ends) {
            return edge.verdict;
        }
        let verdict = self.judge(ends);
        self.edges.insert(ends, Edge { verdict, place: None });
        verdict
    }

    fn judge(&mut self, ends: [u32; 2]) -> Verdict {
        let length = self.length_m(ends);
        if length <= self.rule.short_m {
            return Verdict::KEEP;
        }
        let Some(Optics { samples, tolerance_px }) = &self.rule.optics else {
            return Verdict { pressing: length / self.rule.short_m, parts: 2 };
        };
        for end in ends {
            self.tracks.entry(end).or_insert_with(|| samples.track(self.mesh.positions[end as usize]));
        }
        let [from, to] = ends.map(|end| &self.tracks[&end]);
        if length > self.rule.whole_m && [from, to].into_iter().flatten().any(Option::is_none) {
            return Verdict::new(length / self.rule.whole_m);
        }
        if tolerance_px.is_infinite() {
            return Verdict::KEEP;
        }
        let [start, end] = ends.map(|end| self.mesh.positions[end as usize]);
        let bow = |along: f64| {
            samples.bow_px(&samples.track(start.lerp(end, along)), [from, to], [1.0 - along, along]) / tolerance_px
        };
        // The bow grows with the square of the length. Where it is small in the middle it may still be an S.
        let middle = bow(0.5).sqrt();
        if middle > 1.0 {
            return Verdict::new(middle);
        }
        Verdict::new(bow(0.25).max(bow(0.75)).sqrt())
    }

    /// A vertex at the centroid of a triangle that bows in the middle, though not along its edges.
    fn bulge(&mut self, triangle: &Triangle) -> Option<u32> {
        let Optics { samples, tolerance_px } = self.rule.optics.as_ref()?;
        if tolerance_px.is_infinite() {
            return None;
        }
        for corner in triangle.corners {
            self.tracks.entry(corner).or_insert_with(|| samples.track(self.mesh.positions[corner as usize]));
        }
        let centroid = self.mesh.corners(triangle).iter().sum::<DVec3>() / 3.0;
        let track = samples.track(centroid);
        let corners = triangle.corners.map(|corner| &self.tracks[&corner]);
        (samples.bow_px(&track, corners, [1.0 / 3.0; 3]) > *tolerance_px).then(|| self.mesh.add(centroid))
    }
}
