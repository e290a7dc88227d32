//! Primitives of a glTF document in their own space, with what changes them from pose to pose: morph targets and joints.

use glam::{Mat3, Mat4, Vec2, Vec3};
use gltf::mesh::Mode;
use gltf::{Accessor, Primitive, Semantic};

use super::Fault;
use super::assembly::{Part, check_numbers};
use super::gltf_accessor::Buffers;

/// A primitive in its own space, decoded once for all poses.
pub(super) struct Shape {
    /// How errors call it.
    pub place: String,
    part: Part,
    targets: Vec<Target>,
    influences: Influences,
}

/// What a morph target adds to each vertex at weight 1; empty where it adds nothing.
struct Target {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
}

/// Which joints move each vertex, and how much.
#[derive(Default)]
struct Influences {
    /// One past each vertex's last pair.
    ends: Vec<usize>,
    /// Joint and weight; no weight is 0.
    pairs: Vec<(u32, f32)>,
}

/// Reads attributes of one primitive.
struct Reader<'a> {
    place: &'a str,
    buffers: &'a Buffers,
    primitive: &'a Primitive<'a>,
}

impl Shape {
    /// Whether anything of a primitive is drawn.
    pub fn is_drawn(primitive: &Primitive<'_>) -> bool {
        !matches!(primitive.mode(), Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip)
    }

    /// Decodes a primitive; its joints only where it `has_joints`.
    pub fn read(place: String, primitive: &Primitive<'_>, buffers: &Buffers, has_joints: bool) -> Result<Self, Fault> {
        let reader = Reader { place: &place, buffers, primitive };
        let part = reader.part()?;
        let targets = reader.targets(part.positions.len())?;
        let influences = if has_joints { reader.influences(part.positions.len())? } else { Influences::default() };
        Ok(Self { place, part, targets, influences })
    }

    /// Vertices that an instance of it takes, and triangles.
    pub fn size(&self) -> [usize; 2] {
        [self.part.positions.len(), self.part.triangles.len()]
    }

    /// Every vertex hangs on one of `joints` joints at least, and on none that is not there.
    pub fn check_joints(&self, joints: usize) -> Result<(), Fault> {
        let mut start = 0;
        for (vertex, &end) in self.influences.ends.iter().enumerate() {
            let pairs = &self.influences.pairs[start..end];
            if let Some((index, _)) = pairs.iter().find(|(joint, _)| *joint as usize >= joints) {
                return Err(Fault::IndexOutOfRange {
                    place: format!("{} vertex {vertex}", self.place),
                    index: (*index).into(),
                    allowed: format!("joints 0 to {}", joints as i64 - 1),
                });
            }
            // A sum that is no number takes no vertex anywhere, and is refused with the vertex.
            if pairs.iter().map(|(_, weight)| weight).sum::<f32>() <= 0.0 {
                let place = format!("{} vertex {vertex}", self.place);
                return Err(Fault::malformed(place, "has no joint, one is needed"));
            }
            start = end;
        }
        Ok(())
    }

    /// In its own space, morphed by `weights`, one a target.
    pub fn morphed(&self, weights: &[f32]) -> Part {
        let mut part = self.part.clone();
        for (target, &weight) in self.targets.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            let add = |value: &mut Vec3, more: &Vec3| *value += weight * *more;
            part.positions.iter_mut().zip(&target.positions).for_each(|(value, more)| add(value, more));
            part.normals.iter_mut().zip(&target.normals).for_each(|(value, more)| add(value, more));
        }
        part
    }

    /// What takes each vertex to the world, by what takes one that hangs on a joint there.
    pub fn blended(&self, world_from_joints: &[Mat4]) -> Vec<Mat4> {
        let mut start = 0;
        let blend = |&end: &usize| {
            let (mut sum, mut total) = (Mat4::ZERO, 0.0);
            for &(joint, weight) in &self.influences.pairs[std::mem::replace(&mut start, end)..end] {
                sum += world_from_joints[joint as usize] * weight;
                total += weight;
            }
            sum * f32::recip(total)
        };
        self.influences.ends.iter().map(blend).collect()
    }
}

impl Reader<'_> {
    fn part(&self) -> Result<Part, Fault> {
        let &Self { place, buffers, primitive } = self;
        let positions = primitive
            .get(&Semantic::Positions)
            .ok_or_else(|| Fault::malformed(place, "no attribute POSITION, one is needed"))?;
        let mut part = Part { positions: self.vectors(&positions)?, ..Part::default() };
        let count = part.positions.len();
        if let Some(normals) = primitive.get(&Semantic::Normals) {
            part.normals = self.vectors(&normals)?;
        }
        if let Some(colours) = primitive.get(&Semantic::Colors(0)) {
            part.colours = match colours.dimensions().multiplicity() {
                4 => buffers.floats::<4>(place, &colours)?.iter().map(|c| Vec3::new(c[0], c[1], c[2])).collect(),
                _ => self.vectors(&colours)?,
            };
        }
        let info = primitive.material().pbr_metallic_roughness().base_color_texture();
        let set = info.map_or(0, |info| info.tex_coord());
        if let Some(uvs) = primitive.get(&Semantic::TexCoords(set)) {
            part.uvs = buffers.floats::<2>(place, &uvs)?.into_iter().map(Vec2::from).collect();
        }
        for (name, length) in
            [("NORMAL", part.normals.len()), ("COLOR_0", part.colours.len()), ("TEXCOORD", part.uvs.len())]
        {
            same_count(place, name, length, count)?;
        }
        let indices: Vec<u32> = match primitive.indices() {
            Some(accessor) => buffers.integers::<1>(place, &accessor)?.into_iter().map(|[i]| i).collect(),
            None => (0..count as u32).collect(),
        };
        part.triangles = triangles(place, primitive.mode(), &indices, count)?;
        // As in the file: a transform would spread what is not finite over all three coordinates.
        check_numbers(place, &part)?;
        Ok(part)
    }

    fn targets(&self, count: usize) -> Result<Vec<Target>, Fault> {
        let read = |(number, target): (usize, gltf::mesh::MorphTarget<'_>)| {
            let vectors = |accessor: Option<Accessor<'_>>| accessor.map_or(Ok(Vec::new()), |a| self.vectors(&a));
            let target = Target { positions: vectors(target.positions())?, normals: vectors(target.normals())? };
            let place = format!("{} morph target {number}", self.place);
            same_count(&place, "POSITION", target.positions.len(), count)?;
            same_count(&place, "NORMAL", target.normals.len(), count)?;
            check_numbers(&place, &Part { positions: target.positions.clone(), ..Part::default() })?;
            Ok(target)
        };
        self.primitive.morph_targets().enumerate().map(read).collect()
    }

    fn influences(&self, count: usize) -> Result<Influences, Fault> {
        let mut sets = Vec::new();
        for set in 0.. {
            let (Some(indices), Some(weights)) =
                (self.primitive.get(&Semantic::Joints(set)), self.primitive.get(&Semantic::Weights(set)))
            else {
                break;
            };
            let indices = self.buffers.integers::<4>(self.place, &indices)?;
            let weights = self.buffers.floats::<4>(self.place, &weights)?;
            same_count(self.place, "JOINTS", indices.len(), count)?;
            same_count(self.place, "WEIGHTS", weights.len(), count)?;
            sets.push((indices, weights));
        }
        let mut influences = Influences::default();
        for vertex in 0..count {
            let of_set = |(indices, weights): &(Vec<[u32; 4]>, Vec<[f32; 4]>)| {
                // An accessor of none is taken for none by `same_count`.
                let pair = indices.get(vertex).zip(weights.get(vertex)).map(|(indices, weights)| (*indices, *weights));
                pair.into_iter().flat_map(|(indices, weights)| indices.into_iter().zip(weights))
            };
            influences.pairs.extend(sets.iter().flat_map(of_set).filter(|(_, weight)| *weight != 0.0));
            influences.ends.push(influences.pairs.len());
        }
        Ok(influences)
    }

    fn vectors(&self, accessor: &Accessor<'_>) -> Result<Vec<Vec3>, Fault> {
        Ok(self.buffers.floats(self.place, accessor)?.into_iter().map(Vec3::from).collect())
    }
}

/// An attribute is absent or has an element for each vertex.
fn same_count(place: &str, name: &str, length: usize, count: usize) -> Result<(), Fault> {
    if length == 0 || length == count {
        return Ok(());
    }
    Err(Fault::malformed(place, format!("{length} elements of {name} for {count} vertices")))
}

/// Triangles of a list, strip or fan of indices.
fn triangles(place: &str, mode: Mode, indices: &[u32], vertex_count: usize) -> Result<Vec<[u32; 3]>, Fault> {
    if let Some(i) = indices.iter().position(|&index| index as usize >= vertex_count) {
        let allowed = format!("0 to {}", vertex_count as i64 - 1);
        let place = format!("{place} index {i}");
        return Err(Fault::IndexOutOfRange { place, index: indices[i].into(), allowed });
    }
    Ok(match mode {
        Mode::TriangleStrip => {
            let turned = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] };
            indices.windows(3).enumerate().map(turned).collect()
        }
        Mode::TriangleFan => indices.windows(2).skip(1).map(|w| [indices[0], w[0], w[1]]).collect(),
        _ => {
            let (triangles, rest) = indices.as_chunks();
            if !rest.is_empty() {
                let problem = format!("{} corners of triangles, allowed are multiples of 3", indices.len());
                return Err(Fault::malformed(place, problem));
            }
            triangles.to_vec()
        }
    })
}

/// Takes a part to the world with one matrix for all of its vertices or one for each. Where a matrix mirrors, the
/// triangles' corners change their order, so that outside stays outside.
pub(super) fn transform(part: &mut Part, world_from_vertices: &[Mat4]) {
    let matrix = |i: usize| &world_from_vertices[if world_from_vertices.len() == 1 { 0 } else { i }];
    let mirrors = |i: usize| matrix(i).determinant() < 0.0;
    for (i, position) in part.positions.iter_mut().enumerate() {
        *position = matrix(i).transform_point3(*position);
    }
    for (i, normal) in part.normals.iter_mut().enumerate() {
        let side = if mirrors(i) { -1.0 } else { 1.0 };
        *normal = (side * cofactors(&Mat3::from_mat4(*matrix(i))) * *normal).normalize_or_zero();
    }
    for corners in &mut part.triangles {
        if mirrors(corners[0] as usize) {
            corners.swap(1, 2);
        }
    }
}

/// Takes normals along: the inverse transpose times the determinant, which exists for flattening matrices, too.
fn cofactors(m: &Mat3) -> Mat3 {
    Mat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}
