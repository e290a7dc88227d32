//! The tree of a glTF document's nodes.

use glam::{Mat4, Quat, Vec3};
use gltf::Document;
use gltf::scene::Transform;

use super::Fault;

/// Every node with its transform at rest, parents before their children.
pub(super) struct Nodes {
    at_rest: Vec<Transform>,
    /// A node and its parent.
    order: Vec<(usize, Option<usize>)>,
}

impl Nodes {
    /// # Errors
    /// A node with two parents, or that is its own ancestor: the format wants a forest.
    pub fn read(document: &Document) -> Result<Self, Fault> {
        let count = document.nodes().len();
        let mut parents: Vec<Option<usize>> = vec![None; count];
        for node in document.nodes() {
            for child in node.children() {
                if parents[child.index()].replace(node.index()).is_some() {
                    let place = format!("node {}", child.index());
                    return Err(Fault::malformed(place, "has more than one parent, allowed is one"));
                }
            }
        }
        let mut order = Vec::with_capacity(count);
        let mut pending: Vec<_> = document.nodes().filter(|node| parents[node.index()].is_none()).collect();
        while let Some(node) = pending.pop() {
            order.push((node.index(), parents[node.index()]));
            pending.extend(node.children());
        }
        // One parent each, and not reached from above: a ring.
        if order.len() < count {
            return Err(Fault::malformed("nodes", "a node is its own ancestor, allowed are trees"));
        }
        Ok(Self { at_rest: document.nodes().map(|node| node.transform()).collect(), order })
    }

    /// `parent_from_node` of every node at rest, as the file has it.
    pub fn at_rest(&self) -> &[Transform] {
        &self.at_rest
    }

    /// `world_from_node` of every node, from such transforms.
    pub fn world_from_nodes(&self, transforms: &[Transform]) -> Vec<Mat4> {
        let mut world = vec![Mat4::IDENTITY; transforms.len()];
        for &(node, parent) in &self.order {
            let world_from_parent = parent.map_or(Mat4::IDENTITY, |parent| world[parent]);
            world[node] = world_from_parent * parent_from_node(&transforms[node]);
        }
        world
    }
}

fn parent_from_node(transform: &Transform) -> Mat4 {
    match transform {
        Transform::Matrix { matrix } => Mat4::from_cols_array_2d(matrix),
        Transform::Decomposed { translation, rotation, scale } => {
            let rotation = Quat::from_array(*rotation);
            // Written by programs with few digits; a quaternion of length zero turns nothing.
            let length = rotation.length();
            let rotation = if length > 0.0 && length.is_finite() { rotation / length } else { Quat::IDENTITY };
            Mat4::from_scale_rotation_translation(Vec3::from(*scale), rotation, Vec3::from(*translation))
        }
    }
}

/// The nodes that are shown: those below the roots of the default scene, or of all scenes where none is the default, or
/// all where there are no scenes. Each once.
pub(super) fn shown_nodes(document: &Document) -> Vec<usize> {
    if document.scenes().len() == 0 {
        return document.nodes().map(|node| node.index()).collect();
    }
    let mut pending: Vec<_> = match document.default_scene() {
        Some(scene) => scene.nodes().collect(),
        None => document.scenes().flat_map(|scene| scene.nodes()).collect(),
    };
    let mut shown = vec![false; document.nodes().len()];
    while let Some(node) = pending.pop() {
        if !std::mem::replace(&mut shown[node.index()], true) {
            pending.extend(node.children());
        }
    }
    (0..shown.len()).filter(|&i| shown[i]).collect()
}
