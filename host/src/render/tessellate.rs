//! Long edges are cut so that straight pieces stay close to the curves that the optics make of them.

use super::RenderError;
use crate::scene::ShadedScene;
use core::f64::consts::TAU;
use glam::{DVec3, Vec2, Vec3};
use protocol::rig::{Rig, Viewers};
use shaders::project::{Model, SliceOptics};
use std::collections::HashMap;

/// More triangles than this are refused: at 100 bytes each they would fill 5 GB.
pub const TRIANGLES_MAX: usize = 50_000_000;

/// Triangles with shared vertices, so that each vertex is projected once a slice.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// World metres.
    pub positions: Vec<DVec3>,
    /// The triangles.
    pub triangles: Vec<Triangle>,
}

/// A triangle of a [`Mesh`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// Indices of positions.
    pub corners: [u32; 3],
    /// Linear RGB at each corner, without the texture.
    pub radiance: [Vec3; 3],
    /// Texture coordinates at each corner.
    pub uv: [Vec2; 3],
    /// Index into the scene's textures.
    pub texture: Option<u32>,
}

/// Cuts edges longer than [`edge_limit_m`] in half until none is. What lies wholly farther from the axis than any sight line
/// reaches is left out.
///
/// Whether an edge is cut depends on its ends alone, so that both its triangles cut it alike and no crack opens.
pub fn tessellate(scene: &ShadedScene, rig: &Rig, model: Model, bow_px: f64) -> Result<Mesh, RenderError> {
    let limit = edge_limit_m(rig, model, scene_radius(scene), bow_px);
    let mut builder = Builder {
        limit_squared: (limit * limit) as f32,
        reach: reach_m(rig) as f32,
        mesh: Mesh::default(),
        index: HashMap::new(),
    };
    for triangle in &scene.triangles {
        builder.add(Piece {
            positions: triangle.positions,
            radiance: triangle.radiance,
            uv: triangle.uv,
            texture: triangle.texture,
        });
        if builder.mesh.triangles.len() > TRIANGLES_MAX {
            return Err(RenderError::TooManyTriangles {
                limit_mm: (limit * 1e3).round() as u32,
                allowed: TRIANGLES_MAX,
            });
        }
    }
    Ok(builder.mesh)
}

fn scene_radius(scene: &ShadedScene) -> f64 {
    let corners = scene.triangles.iter().flat_map(|triangle| triangle.positions);
    f64::from(corners.map(|position| position.length_squared()).fold(0.0, f32::max)).sqrt()
}

/// Beyond this distance from the origin no point has a sight line: it lies past the viewing circle; for viewers at infinity,
/// twenty times the panel's size away.
fn reach_m(rig: &Rig) -> f64 {
    match rig.viewers() {
        Viewers::Circle { distance_m, height_m } => distance_m.hypot(height_m),
        Viewers::Infinity { .. } => 20.0 * panel_m(rig),
    }
}

fn panel_m(rig: &Rig) -> f64 {
    let extents = rig.mirror.face.iter().flat_map(|face| {
        [face.width_m / 2.0, face.slope_span_m[0].abs(), face.slope_span_m[1].abs(), face.offset_m.abs()]
    });
    extents.fold(0.0, f64::max)
}

/// The longest edge whose middle stays within `bow_px` of the middle of its ends' pixels, anywhere within `radius_m` of the
/// origin or of the panel, whichever is smaller.
///
/// The bow grows with the square of the length (18.8 px for 100 mm, 0.29 px for 12.5 mm on the reference rig), so the largest
/// of a scatter of short segments gives it, with a quarter in reserve.
pub fn edge_limit_m(rig: &Rig, model: Model, radius_m: f64, bow_px: f64) -> f64 {
    const SEGMENTS: u32 = 600;
    let radius = radius_m.min(1.5 * panel_m(rig)).max(1e-6);
    let length = radius / 8.0;
    let worst = (0..SEGMENTS).filter_map(|index| bow_of_segment(rig, model, index, radius, length)).fold(0.0, f64::max);
    // Half a panel at most: the renderer takes it that a piece with a corner a panel's size off the panel does not meet it.
    let sizes = rig.mirror.face.iter().map(|face| face.width_m.min(face.slope_span_m[1] - face.slope_span_m[0]));
    (length * (bow_px / (1.25 * worst).max(1e-12)).sqrt()).min(0.5 * sizes.fold(f64::INFINITY, f64::min))
}

fn bow_of_segment(rig: &Rig, model: Model, index: u32, radius: f64, length: f64) -> Option<f64> {
    let scatter = |step: f64| (f64::from(index) * step).fract();
    let middle = on_sphere(scatter(0.618_034), scatter(0.754_878)) * radius * scatter(0.569_840).cbrt();
    let half = on_sphere(scatter(0.819_173), scatter(0.671_044)) * length / 2.0;
    let slice = index.wrapping_mul(97) % rig.rotation.slices;
    let face = index as usize % rig.mirror.face.len();
    let optics = SliceOptics::new(rig, face, rig.slice_angle(slice), model);
    let [start, between, end] = [middle - half, middle, middle + half].map(|point| optics.project(point).pixel);
    Some((between? - (start? + end?) / 2.0).length())
}

/// A point of the unit sphere from two fractions, spread evenly where they are.
fn on_sphere(around: f64, along: f64) -> DVec3 {
    let height = 2.0 * along - 1.0;
    let level = (1.0 - height * height).max(0.0).sqrt();
    DVec3::new(level * (TAU * around).sin(), height, level * (TAU * around).cos())
}

#[derive(Clone, Copy)]
struct Piece {
    positions: [Vec3; 3],
    radiance: [Vec3; 3],
    uv: [Vec2; 3],
    texture: Option<u32>,
}

struct Builder {
    limit_squared: f32,
    reach: f32,
    mesh: Mesh,
    index: HashMap<[u32; 3], u32>,
}

impl Builder {
    fn add(&mut self, piece: Piece) {
        let mut waiting = vec![piece];
        while let Some(piece) = waiting.pop() {
            if self.is_out_of_reach(&piece) || self.mesh.triangles.len() > TRIANGLES_MAX {
                continue;
            }
            let long = [0, 1, 2].map(|edge| {
                piece.positions[edge].distance_squared(piece.positions[(edge + 1) % 3]) > self.limit_squared
            });
            match long.iter().filter(|long| **long).count() {
                0 => self.emit(&piece),
                _ => waiting.extend(piece.cut(long)),
            }
        }
    }

    /// Whether the triangle lies outside the ball of reach: by the ball about its centre, which holds it.
    fn is_out_of_reach(&self, piece: &Piece) -> bool {
        let centre = piece.positions.iter().sum::<Vec3>() / 3.0;
        let radius = piece.positions.iter().map(|position| position.distance(centre)).fold(0.0, f32::max);
        centre.length() - radius > self.reach
    }

    fn emit(&mut self, piece: &Piece) {
        let corners = piece.positions.map(|position| {
            let key = position.to_array().map(|value| (value + 0.0).to_bits());
            *self.index.entry(key).or_insert_with(|| {
                self.mesh.positions.push(position.into());
                self.mesh.positions.len() as u32 - 1
            })
        });
        let Piece { radiance, uv, texture, .. } = *piece;
        self.mesh.triangles.push(Triangle { corners, radiance, uv, texture });
    }
}

impl Piece {
    /// Cuts the edges named in `cut` (edge i runs from corner i to the next) at their middles.
    fn cut(&self, cut: [bool; 3]) -> Vec<Self> {
        // Corners 0, 1, 2, then the middles of edges 0, 1, 2.
        let pieces: &[[usize; 3]] = match cut {
            [true, false, false] => &[[0, 3, 2], [3, 1, 2]],
            [false, true, false] => &[[0, 1, 4], [0, 4, 2]],
            [false, false, true] => &[[0, 1, 5], [5, 1, 2]],
            [true, true, false] => &[[3, 1, 4], [0, 3, 4], [0, 4, 2]],
            [false, true, true] => &[[4, 2, 5], [1, 4, 5], [1, 5, 0]],
            [true, false, true] => &[[5, 0, 3], [2, 5, 3], [2, 3, 1]],
            _ => &[[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
        };
        pieces.iter().map(|corners| self.piece(*corners)).collect()
    }

    fn piece(&self, corners: [usize; 3]) -> Self {
        Self {
            positions: corners.map(|corner| at(&self.positions, corner)),
            radiance: corners.map(|corner| at(&self.radiance, corner)),
            uv: corners.map(|corner| at(&self.uv, corner)),
            texture: self.texture,
        }
    }
}

/// A corner (0 … 2) or the middle of an edge (3 … 5). The sum does not depend on the order of the ends.
fn at<T: Copy + core::ops::Add<Output = T> + core::ops::Mul<f32, Output = T>>(values: &[T; 3], corner: usize) -> T {
    match corner {
        0..=2 => values[corner],
        _ => (values[corner - 3] + values[(corner - 2) % 3]) * 0.5,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::ShadedTriangle;

    const REFERENCE: &str = include_str!("../../rigs/reference.toml");

    fn square(side: f32) -> ShadedScene {
        let at = |x: f32, y: f32| Vec3::new((x - 0.5) * side, (y - 0.5) * side, 0.0);
        let triangle =
            |positions| ShadedTriangle { positions, radiance: [Vec3::ONE; 3], uv: [Vec2::ZERO; 3], texture: None };
        let triangles = vec![
            triangle([at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0)]),
            triangle([at(0.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)]),
        ];
        ShadedScene { triangles, textures: Vec::new() }
    }

    #[test]
    fn the_limit_is_what_the_prototype_measured() {
        // targets.md: 18.8 px for 100 mm, 0.29 px for 12.5 mm, so 0.5 px at 16 mm; a reserve of a quarter makes it 14 to 15.
        let rig = Rig::parse(REFERENCE).unwrap();
        let limit = edge_limit_m(&rig, Model::Planar, 0.06, 0.5);
        assert!((0.011..0.018).contains(&limit), "{limit}");
    }

    #[test]
    fn a_square_is_cut_without_cracks_and_keeps_its_area() {
        let rig = Rig::parse(REFERENCE).unwrap();
        let mesh = tessellate(&square(0.1), &rig, Model::Cone, 0.5).unwrap();
        let mut edges = HashMap::new();
        let mut area = 0.0;
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.corners.map(|corner| mesh.positions[corner as usize]);
            area += (b - a).cross(c - a).z / 2.0;
            for (from, to) in [(0, 1), (1, 2), (2, 0)].map(|(from, to)| (triangle.corners[from], triangle.corners[to]))
            {
                *edges.entry((from.min(to), from.max(to))).or_insert(0) += if from < to { 1 } else { -1 };
            }
        }
        assert!((area - 0.01).abs() < 1e-9, "{area}");
        assert!(mesh.triangles.len() > 100);
        // An edge inside is run through once in each way; what is left over must lie on the square's border.
        let border = |corner: u32| mesh.positions[corner as usize].abs().max_element() > 0.05 - 1e-6;
        assert!(edges.iter().all(|((from, to), sum)| *sum == 0 || (border(*from) && border(*to))));
    }

    #[test]
    fn no_edge_bows_more_than_asked() {
        let tent = include_str!("../../rigs/tent.toml");
        let high = include_str!("../../rigs/high-viewer.toml");
        let off_axis = REFERENCE.replace("[0.0, 0.6, 0.0]", "[0.05, 0.5, 0.02]");
        for (text, model) in [REFERENCE, tent, high, &off_axis]
            .into_iter()
            .flat_map(|text| [Model::Planar, Model::Cone].map(|model| (text, model)))
        {
            let rig = Rig::parse(text).unwrap();
            for budget in [0.5, 0.1] {
                let (worst, longest) = worst_bow(&rig, model, budget);
                println!(
                    "{} {model:?}: asked {budget} px, seen {worst:.3} px with edges up to {longest:.4} m",
                    rig.name
                );
                assert!(worst < budget, "{} {model:?}: {worst} px of {budget}", rig.name);
            }
        }
    }

    /// The largest bow, in pixels, over edges of tilted squares of 80 mm in many slices; and the longest edge, in metres.
    fn worst_bow(rig: &Rig, model: Model, budget: f64) -> (f64, f64) {
        let mut scene = square(0.08);
        for (index, triangle) in (0u8..).zip(&mut scene.triangles) {
            let pose = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.7, 0.4 + f32::from(index), 1.1);
            triangle.positions = triangle.positions.map(|position| pose * position);
        }
        let mesh = tessellate(&scene, rig, model, budget).unwrap();
        let (mut worst, mut longest) = (0.0f64, 0.0f64);
        for slice in (0..rig.rotation.slices).step_by(7) {
            let optics = SliceOptics::new(rig, 0, rig.slice_angle(slice), model);
            for [a, b, c] in mesh.triangles.iter().map(|triangle| triangle.corners) {
                for (from, to) in [(a, b), (b, c), (c, a)] {
                    let (from, to) = (mesh.positions[from as usize], mesh.positions[to as usize]);
                    let pixels = [from, (from + to) / 2.0, to].map(|point| optics.project(point).pixel.unwrap());
                    worst = worst.max((pixels[1] - (pixels[0] + pixels[2]) / 2.0).length());
                    longest = longest.max(from.distance(to));
                }
            }
        }
        (worst, longest)
    }

    #[test]
    fn a_wall_beyond_the_viewers_costs_nothing() {
        let rig = Rig::parse(REFERENCE).unwrap();
        let mesh = tessellate(&square(500.0), &rig, Model::Cone, 0.5).unwrap();
        assert!(mesh.triangles.len() < 400_000, "{}", mesh.triangles.len());
        assert!(!mesh.triangles.is_empty());
    }
}
