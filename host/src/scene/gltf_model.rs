//! What a glTF document shows, decoded once and posed as often as one likes.

use std::collections::HashMap;

use glam::Mat4;
use gltf::Document;
use gltf::scene::Transform;

use super::assembly::{Assembly, room_beside};
use super::files::Resources;
use super::gltf_accessor::Buffers;
use super::gltf_material::Materials;
use super::gltf_nodes::{self, Nodes};
use super::gltf_shape::{Shape, transform};
use super::{Fault, Scene};

/// Everything that is shown, in spaces of its own.
pub(super) struct Model {
    nodes: Nodes,
    /// Weights of morph targets at rest, per node.
    weights: Vec<Vec<f32>>,
    /// Those that are used, by their numbers in the document.
    skins: HashMap<usize, Skin>,
    shapes: Vec<Shape>,
    shown: Vec<Shown>,
    /// Materials and remarks; no triangles yet.
    start: Assembly,
}

struct Skin {
    /// Nodes.
    joints: Vec<usize>,
    /// `joint_from_mesh` per joint, or none where all are the identity.
    inverse_binds: Vec<Mat4>,
}

/// An instance of a shape.
struct Shown {
    node: usize,
    skin: Option<usize>,
    shape: usize,
    material: u32,
}

/// Where everything is at a moment.
#[derive(Clone)]
pub(super) struct Pose {
    /// `parent_from_node` per node.
    pub transforms: Vec<Transform>,
    /// Weights of morph targets per node.
    pub weights: Vec<Vec<f32>>,
}

impl Model {
    pub fn read(document: &Document, buffers: &Buffers, resources: &dyn Resources) -> Result<Self, Fault> {
        let mut model = Self {
            nodes: Nodes::read(document)?,
            weights: document.nodes().map(|node| weights(&node)).collect(),
            skins: HashMap::new(),
            shapes: Vec::new(),
            shown: Vec::new(),
            start: Assembly::default(),
        };
        let mut reader = Reader {
            buffers,
            materials: Materials::new(document, buffers, resources),
            shapes: HashMap::new(),
            taken: [0; 2],
        };
        if document.extensions_used().any(|e| e == "KHR_texture_transform") {
            model.start.note("KHR_texture_transform is not applied");
        }
        for index in gltf_nodes::shown_nodes(document) {
            reader.node(&document.nodes().nth(index).expect("an index of a node"), &mut model)?;
        }
        Ok(model)
    }

    /// The pose in which the file has everything.
    pub fn rest(&self) -> Pose {
        Pose { transforms: self.nodes.at_rest().to_vec(), weights: self.weights.clone() }
    }

    /// What is to be seen at rest.
    pub fn at_rest(&self) -> Result<Scene, Fault> {
        self.assembly(&self.rest())?.finish()
    }

    /// What is to be seen in a pose; it may be nothing.
    pub fn posed(&self, pose: &Pose) -> Result<Scene, Fault> {
        Ok(self.assembly(pose)?.finish_even_empty())
    }

    fn assembly(&self, pose: &Pose) -> Result<Assembly, Fault> {
        let world_from_nodes = self.nodes.world_from_nodes(&pose.transforms);
        let world_from_joints: HashMap<usize, Vec<Mat4>> =
            self.skins.iter().map(|(&index, skin)| (index, skin.world_from_joints(&world_from_nodes))).collect();
        let mut assembly = self.start.clone();
        for shown in &self.shown {
            let shape = &self.shapes[shown.shape];
            let mut part = shape.morphed(&pose.weights[shown.node]);
            // The node that holds a skinned mesh has no say in where it is.
            match shown.skin.and_then(|skin| world_from_joints.get(&skin)) {
                Some(joints) => transform(&mut part, &shape.blended(joints)),
                None => transform(&mut part, &[world_from_nodes[shown.node]]),
            }
            part.materials = vec![shown.material];
            assembly.add(&shape.place, part)?;
        }
        Ok(assembly)
    }
}

/// A node's own weights of morph targets, or its mesh's, or none.
fn weights(node: &gltf::Node<'_>) -> Vec<f32> {
    let Some(mesh) = node.mesh() else { return Vec::new() };
    let targets = mesh.primitives().map(|primitive| primitive.morph_targets().len()).max().unwrap_or(0);
    let mut weights = node.weights().or(mesh.weights()).unwrap_or_default().to_vec();
    weights.resize(targets, 0.0);
    weights
}

impl Skin {
    fn read(skin: &gltf::Skin<'_>, buffers: &Buffers) -> Result<Self, Fault> {
        let place = format!("skin {}", skin.index());
        let joints: Vec<usize> = skin.joints().map(|joint| joint.index()).collect();
        let Some(accessor) = skin.inverse_bind_matrices() else {
            return Ok(Self { joints, inverse_binds: Vec::new() });
        };
        let inverse_binds = buffers.floats::<16>(&place, &accessor)?;
        if inverse_binds.len() < joints.len() {
            let problem = format!("{} inverse bind matrices for {} joints", inverse_binds.len(), joints.len());
            return Err(Fault::malformed(place, problem));
        }
        Ok(Self { joints, inverse_binds: inverse_binds.iter().map(Mat4::from_cols_array).collect() })
    }

    /// What takes a vertex bound to a joint to the world, per joint.
    fn world_from_joints(&self, world_from_nodes: &[Mat4]) -> Vec<Mat4> {
        let joints = self.joints.iter().map(|&joint| world_from_nodes[joint]);
        if self.inverse_binds.is_empty() {
            return joints.collect();
        }
        joints.zip(&self.inverse_binds).map(|(joint, bind)| joint * *bind).collect()
    }
}

/// Reads a document node by node.
struct Reader<'a> {
    buffers: &'a Buffers,
    materials: Materials<'a>,
    /// Shapes by mesh, primitive, and whether they have joints.
    shapes: HashMap<(usize, usize, bool), usize>,
    /// Vertices and triangles so far, those of morph targets and of sets of joints with them.
    taken: [usize; 2],
}

impl Reader<'_> {
    fn node(&mut self, node: &gltf::Node<'_>, model: &mut Model) -> Result<(), Fault> {
        let Some(mesh) = node.mesh() else { return Ok(()) };
        let skin = node.skin();
        if let Some(skin) = &skin {
            model.skins.insert(skin.index(), Skin::read(skin, self.buffers)?);
        }
        let skin = skin.map(|skin| skin.index());
        for primitive in mesh.primitives() {
            if !Shape::is_drawn(&primitive) {
                model.start.note("points and lines are not drawn");
                continue;
            }
            let shape = self.shape(&mesh, &primitive, skin.is_some(), model)?;
            if let Some(skin) = skin.and_then(|skin| model.skins.get(&skin)) {
                model.shapes[shape].check_joints(skin.joints.len())?;
            }
            let material = self.materials.index(&primitive.material(), &mut model.start)?;
            model.shown.push(Shown { node: node.index(), skin, shape, material });
        }
        Ok(())
    }

    /// The index of a primitive's shape, where there is room for another instance of it.
    fn shape(
        &mut self,
        mesh: &gltf::Mesh<'_>,
        primitive: &gltf::Primitive<'_>,
        has_joints: bool,
        model: &mut Model,
    ) -> Result<usize, Fault> {
        let key = (mesh.index(), primitive.index(), has_joints);
        if let Some(&index) = self.shapes.get(&key) {
            let shape = &model.shapes[index];
            self.take(&shape.place, shape.size())?;
            return Ok(index);
        }
        let place = format!("mesh {} primitive {}", mesh.index(), primitive.index());
        if let Some(positions) = primitive.get(&gltf::Semantic::Positions) {
            let indices = primitive.indices().map_or(positions.count(), |indices| indices.count());
            let is_joints = |(semantic, _): &(gltf::Semantic, _)| matches!(semantic, gltf::Semantic::Joints(_));
            let joints = if has_joints { primitive.attributes().filter(is_joints).count() } else { 0 };
            let layers = 1 + joints + primitive.morph_targets().len();
            self.take(&place, [positions.count().saturating_mul(layers), indices / 3])?;
        }
        model.shapes.push(Shape::read(place, primitive, self.buffers, has_joints)?);
        self.shapes.insert(key, model.shapes.len() - 1);
        Ok(model.shapes.len() - 1)
    }

    /// Refuses what there is no room for, before memory is spent on it.
    fn take(&mut self, place: &str, [vertices, triangles]: [usize; 2]) -> Result<(), Fault> {
        room_beside(self.taken, place, vertices, triangles)?;
        self.taken = [self.taken[0] + vertices, self.taken[1] + triangles];
        Ok(())
    }
}
