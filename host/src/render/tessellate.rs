//! Long edges are cut so that straight pieces stay close to the curves that the optics make of them.

use super::RenderError;
use super::bow::{Samples, Track, edge_limit_m, finest_edge_m, reach_m, whole_edge_m};
use super::mesh::{Mesh, Triangle};
use super::plan::{Edges, Plan};
use crate::scene::ShadedScene;
use glam::{DVec3, Mat3, Vec3};
use protocol::rig::Rig;
use shaders::project::methods::Method;
use std::collections::HashMap;

/// More triangles than this are refused: at 100 bytes each they would fill 5 GB.
pub const TRIANGLES_MAX: usize = 50_000_000;

/// Pieces of as many cuts stay as they are. Four or five suffice, but where an edge has an end without a pixel it may stay while its
/// parts are cut, and cutting could go on for ever.
const GENERATIONS: u32 = 10;

/// Edges longer than the reach are cut into no more parts at once: what of them is out of reach is soon left out.
const PARTS_FAR: u32 = 16;

/// Edges that need as many parts bow evenly along each.
const PARTS_EVEN: u32 = 8;

/// The bow by samples, times this, is not below the bow in any slice: 24 of 288 slices and a few places on each piece miss some
/// of it.
const RESERVE: f64 = 1.05;

/// Cuts the scene's triangles as `plan.edges` says. What lies wholly farther from the axis than any sight line reaches is left out.
///
/// Whether and where an edge is cut depends on the edge alone, so that both its triangles cut it alike and no crack opens.
pub fn tessellate(scene: &ShadedScene, rig: &Rig, plan: &Plan) -> Result<Mesh, RenderError> {
    cut(Mesh::new(scene), rig, plan, reach_m(rig))
}

/// The same for a mesh; what is left out lies farther from the axis than `reach_m` metres.
pub fn cut(mesh: Mesh, rig: &Rig, plan: &Plan, reach_m: f64) -> Result<Mesh, RenderError> {
    let model = Method::from(plan.projection).model();
    let whole_m = whole_edge_m(rig);
    let radius_m = mesh.radius_m();
    let limit_m = |bow_px| edge_limit_m(rig, model, radius_m, bow_px).max(finest_edge_m(rig));
    let rule = match plan.edges {
        Edges::Uniform => Rule { short_m: limit_m(plan.bow_px), whole_m, optics: None },
        Edges::Straight | Edges::Rays => {
            let optics = Optics { samples: Samples::new(rig, model), tolerance_px: f64::INFINITY };
            Rule { short_m: whole_m, whole_m, optics: Some(optics) }
        }
        Edges::Adaptive | Edges::Discard => {
            let optics = Optics { samples: Samples::new(rig, model), tolerance_px: plan.bow_px / RESERVE };
            // The middle of a triangle bows by a third more than its edges at most.
            Rule { short_m: limit_m(0.75 * plan.bow_px), whole_m, optics: Some(optics) }
        }
    };
    let Mesh { positions, triangles } = mesh;
    let mesh = Mesh { positions, triangles: Vec::with_capacity(triangles.len()) };
    let mut cutter = Cutter { rule, reach_m, mesh, tracks: HashMap::new(), edges: HashMap::new() };
    for triangle in &triangles {
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

/// Which edges are cut.
struct Rule {
    /// Edges up to this length in metres stay, and none is cut into shorter parts: they bow less than is allowed wherever that is
    /// possible.
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

impl Rule {
    /// The bow of an edge over what is allowed. It grows with the square of the length. Where it is small in the middle it may still be
    /// an S.
    fn strain(&self, start: DVec3, end: DVec3, from: &Track, to: &Track) -> f64 {
        let Some(Optics { samples, tolerance_px }) = &self.optics else { return 0.0 };
        let bow = |along: f64| {
            samples.bow_px(&samples.track(start.lerp(end, along)), [from, to], [1.0 - along, along]) / tolerance_px
        };
        let middle = bow(0.5);
        if middle > 1.0 { middle } else { middle.max(bow(0.25)).max(bow(0.75)) }
    }
}

/// Whether a triangle lies outside the ball of [`reach_m`]: by the ball about its centre, which holds it.
pub fn is_out_of_reach(corners: [DVec3; 3], reach_m: f64) -> bool {
    let centre = corners.iter().sum::<DVec3>() / 3.0;
    let radius = corners.iter().map(|position| position.distance(centre)).fold(0.0, f64::max);
    centre.length() - radius > reach_m
}

fn along(start: DVec3, end: DVec3, part: u32, parts: u32) -> DVec3 {
    start.lerp(end, f64::from(part) / f64::from(parts))
}

/// A vertex of a piece, with its weights of the corners of the scene's triangle.
#[derive(Clone, Copy)]
struct Corner {
    vertex: u32,
    weights: Vec3,
}

struct Cutter {
    rule: Rule,
    reach_m: f64,
    mesh: Mesh,
    tracks: HashMap<u32, Track>,
    /// The vertices at which edges are cut into parts of one length, by their ends in the order of their indices.
    edges: HashMap<[u32; 2], Vec<u32>>,
}

impl Cutter {
    fn add(&mut self, triangle: &Triangle) {
        let whole = [0, 1, 2].map(|corner| Corner { vertex: triangle.corners[corner], weights: Vec3::AXES[corner] });
        let mut waiting = vec![(whole, 0)];
        while let Some((piece, generation)) = waiting.pop() {
            let lengths = [0, 1, 2].map(|edge| self.length_m([piece[edge].vertex, piece[(edge + 1) % 3].vertex]));
            if is_out_of_reach(piece.map(|corner| self.position(corner.vertex)), self.reach_m)
                || self.mesh.triangles.len() > TRIANGLES_MAX
            {
                continue;
            }
            // Halving all that is too long ends by itself.
            let last = generation == GENERATIONS && self.rule.optics.is_some();
            if last || lengths.iter().all(|length| *length <= self.rule.short_m) {
                self.emit(triangle, &piece);
                continue;
            }
            let parts = [0, 1, 2].map(|edge| self.chain(piece[edge], piece[(edge + 1) % 3]).len() - 1);
            let mut pieces = Vec::new();
            if parts != [1; 3] {
                self.divide(piece, parts, &mut pieces);
            } else if let Some(centre) = self.bulge(&piece) {
                pieces.extend([0, 1, 2].map(|edge| [piece[edge], piece[(edge + 1) % 3], centre]));
            } else {
                self.emit(triangle, &piece);
            }
            waiting.extend(pieces.into_iter().map(|piece| (piece, generation + 1)));
        }
    }

    fn emit(&mut self, triangle: &Triangle, piece: &[Corner; 3]) {
        self.mesh.triangles.push(Triangle {
            corners: piece.map(|corner| corner.vertex),
            radiance: piece.map(|corner| Mat3::from_cols_array_2d(&triangle.radiance.map(Vec3::into)) * corner.weights),
            uv: piece.map(|corner| (0..3).map(|index| triangle.uv[index] * corner.weights[index]).sum()),
            texture: triangle.texture,
        });
    }

    fn position(&self, vertex: u32) -> DVec3 {
        self.mesh.positions[vertex as usize]
    }

    fn length_m(&self, [from, to]: [u32; 2]) -> f64 {
        self.position(from).distance(self.position(to))
    }

    /// Lays a ladder between the two edges that have the most `parts`, from the corner where they meet to the third edge. Rungs are
    /// edges like any other and are cut in their turn; what lies between two rungs is filled with triangles.
    fn divide(&mut self, piece: [Corner; 3], parts: [usize; 3], pieces: &mut Vec<[Corner; 3]>) {
        let base = (0..3).min_by_key(|edge| parts[*edge]).unwrap_or(0);
        let [top, left, right] = [(base + 2) % 3, base, (base + 1) % 3].map(|corner| piece[corner]);
        let rails = [left, right].map(|foot| self.chain(top, foot));
        let rungs = rails[0].len().max(rails[1].len()) - 1;
        let mut above = vec![top];
        for rung in 1..=rungs {
            let [from, to] = rails.each_ref().map(|rail| rail[(rung * (rail.len() - 1)).div_ceil(rungs)]);
            let below = self.chain(from, to);
            self.fill(&above, &below, pieces);
            above = below;
        }
    }

    /// Triangles between two rungs, across the shorter diagonal each. The rungs may meet at either end.
    fn fill(&self, mut above: &[Corner], mut below: &[Corner], pieces: &mut Vec<[Corner; 3]>) {
        let is_same = |a: &Corner, b: &Corner| a.vertex == b.vertex;
        if let ([start, next_above, ..], [first, next_below, ..]) = (above, below)
            && is_same(start, first)
        {
            pieces.push([*start, *next_below, *next_above]);
            (above, below) = (&above[1..], &below[1..]);
        }
        if let ([.., before_above, end], [.., before_below, last]) = (above, below)
            && is_same(end, last)
        {
            pieces.push([*before_above, *before_below, *end]);
            (above, below) = (&above[..above.len() - 1], &below[..below.len() - 1]);
        }
        while let ([upper, ..], [lower, ..]) = (above, below) {
            let distance = |a: &Corner, b: &Corner| self.length_m([a.vertex, b.vertex]);
            let along_above = above.get(1).map_or(f64::INFINITY, |next| distance(next, lower));
            let along_below = below.get(1).map_or(f64::INFINITY, |next| distance(upper, next));
            if along_above < along_below {
                pieces.push([*upper, *lower, above[1]]);
                above = &above[1..];
            } else if let Some(next) = below.get(1) {
                pieces.push([*upper, *lower, *next]);
                below = &below[1..];
            } else {
                break;
            }
        }
    }

    /// The vertices of the edge from one vertex to another, with its ends.
    fn chain(&mut self, from: Corner, to: Corner) -> Vec<Corner> {
        let ends = [from.vertex.min(to.vertex), from.vertex.max(to.vertex)];
        if !self.edges.contains_key(&ends) {
            let parts = self.parts(ends);
            let [start, end] = ends.map(|end| self.position(end));
            let places = (1..parts).map(|part| self.mesh.add(along(start, end, part, parts))).collect();
            self.edges.insert(ends, places);
        }
        let places = &self.edges[&ends];
        let parts = places.len() + 1;
        let corner = |part: usize| match part {
            0 => from,
            _ if part == parts => to,
            _ => Corner {
                vertex: places[if from.vertex == ends[0] { part - 1 } else { parts - 1 - part }],
                weights: from.weights.lerp(to.weights, part as f32 / parts as f32),
            },
        };
        (0..=parts).map(corner).collect()
    }

    /// Into how many parts an edge is to be cut.
    fn parts(&mut self, ends: [u32; 2]) -> u32 {
        let length = self.length_m(ends);
        if length <= self.rule.short_m {
            return 1;
        }
        let Some(Optics { samples, tolerance_px }) = &self.rule.optics else { return 2 };
        for end in ends {
            self.tracks.entry(end).or_insert_with(|| samples.track(self.mesh.positions[end as usize]));
        }
        let [from, to] = ends.map(|end| &self.tracks[&end]);
        let most = (length / self.rule.short_m).ceil() as u32;
        let needed = |need: f64| (need.ceil() as u32).clamp(1, most);
        if length > self.rule.whole_m && [from, to].into_iter().flatten().any(Option::is_none) {
            let parts = needed(length / self.rule.whole_m);
            return if length > self.reach_m { parts.min(PARTS_FAR) } else { parts };
        }
        if tolerance_px.is_infinite() {
            return 1;
        }
        let [start, end] = ends.map(|end| self.position(end));
        let first = needed(self.rule.strain(start, end, from, to).sqrt());
        let holds = |parts: u32| {
            let tracks: Vec<_> = (0..=parts).map(|part| samples.track(along(start, end, part, parts))).collect();
            (0..parts).all(|part| {
                let [from, to] = [part, part + 1].map(|part| along(start, end, part, parts));
                self.rule.strain(from, to, &tracks[part as usize], &tracks[part as usize + 1]) <= 1.0
            })
        };
        // Where the bow is not even, some parts are too long. One part more serves better than cutting those alone: parallel edges of
        // a scene are then cut alike. Many parts are even enough.
        if (2..most.min(PARTS_EVEN)).contains(&first) && !holds(first) && holds(first + 1) { first + 1 } else { first }
    }

    /// The centroid of a triangle that bows in the middle, though not along its edges.
    fn bulge(&mut self, piece: &[Corner; 3]) -> Option<Corner> {
        let Optics { samples, tolerance_px } = self.rule.optics.as_ref()?;
        let [a, b, c] = piece.map(|corner| self.position(corner.vertex));
        // A piece of this area has an edge or a height that is short enough.
        let is_small = (b - a).cross(c - a).length() < 0.5 * self.rule.short_m.powi(2);
        if tolerance_px.is_infinite() || is_small {
            return None;
        }
        for corner in piece {
            let position = self.mesh.positions[corner.vertex as usize];
            self.tracks.entry(corner.vertex).or_insert_with(|| samples.track(position));
        }
        let centroid = (a + b + c) / 3.0;
        let corners = piece.map(|corner| &self.tracks[&corner.vertex]);
        if samples.bow_px(&samples.track(centroid), corners, [1.0 / 3.0; 3]) <= *tolerance_px {
            return None;
        }
        let weights = piece.iter().map(|corner| corner.weights).sum::<Vec3>() / 3.0;
        Some(Corner { vertex: self.mesh.add(centroid), weights })
    }
}
