//! The nodes of a scene and their rest pose.

use glam::DAffine3;

use crate::to_affine;

/// What a node holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A bone, or a node to which a skin is bound.
    Bone,
    /// A mesh.
    Mesh,
    /// A camera.
    Camera,
    /// A light.
    Light,
    /// A group, or something else.
    Other,
}

/// A node of the hierarchy.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Name, empty for the root.
    pub name: String,
    /// Index of the parent; None for the root.
    pub parent: Option<usize>,
    /// What the node holds.
    pub kind: Kind,
    /// World transform in the rest pose. That is the transform to which a skin is bound, else that
    /// of a bind pose of the file, else the static transform relative to the rest pose of the
    /// parent.
    pub rest: DAffine3,
}

/// Return the `typed_id` of every node in preorder.
pub fn preorder(scene: &ufbx::Scene) -> Vec<usize> {
    let mut ids = Vec::with_capacity(scene.nodes.count);
    let mut pending = vec![scene.root_node.as_ref()];
    while let Some(node) = pending.pop() {
        ids.push(node.element.typed_id as usize);
        pending.extend(node.children.as_ref().iter().rev().map(AsRef::as_ref));
    }
    ids
}

/// Return the index in preorder of every `typed_id`.
pub fn inverse(ids: &[usize]) -> Vec<usize> {
    let mut indices = vec![0; ids.len()];
    for (index, &id) in ids.iter().enumerate() {
        indices[id] = index;
    }
    indices
}

/// Return the nodes in preorder.
pub fn nodes(scene: &ufbx::Scene, ids: &[usize]) -> Vec<Node> {
    let indices = inverse(ids);
    let (bound, is_skinned) = bind_transforms(scene);
    let mut nodes: Vec<Node> = Vec::with_capacity(ids.len());
    for &id in ids {
        let node = &scene.nodes[id];
        let parent = node
            .parent
            .as_ref()
            .map(|parent| indices[parent.element.typed_id as usize]);
        let world = to_affine(&node.node_to_world);
        let from_parent = || {
            let parent_world = to_affine(&node.parent.as_ref()?.node_to_world);
            let rest = nodes[parent?].rest * parent_world.inverse() * world;
            is_usable(&rest).then_some(rest)
        };
        let rest = bound[id].or_else(from_parent).unwrap_or(world);
        nodes.push(Node {
            name: node.element.name.to_string(),
            parent,
            kind: kind(node, is_skinned[id]),
            rest,
        });
    }
    nodes
}

/// Return for every `typed_id` the bind transform, and whether a skin is bound to the node.
fn bind_transforms(scene: &ufbx::Scene) -> (Vec<Option<DAffine3>>, Vec<bool>) {
    let mut bound: Vec<Option<DAffine3>> = vec![None; scene.nodes.count];
    let mut is_skinned = vec![false; scene.nodes.count];
    let mut bind = |id: u32, matrix: &ufbx::Matrix| {
        let transform = to_affine(matrix);
        let slot = &mut bound[id as usize];
        if slot.is_none() && is_usable(&transform) {
            *slot = Some(transform);
        }
    };
    for cluster in &scene.skin_clusters {
        if let Some(node) = &cluster.bone_node {
            is_skinned[node.element.typed_id as usize] = true;
            bind(node.element.typed_id, &cluster.bind_to_world);
        }
    }
    for pose in scene.poses.into_iter().filter(|pose| pose.is_bind_pose) {
        for bone in pose.bone_poses.as_ref() {
            bind(bone.bone_node.element.typed_id, &bone.bone_to_world);
        }
    }
    (bound, is_skinned)
}

/// Return whether a transform is finite and can be inverted.
fn is_usable(transform: &DAffine3) -> bool {
    transform.is_finite() && transform.matrix3.determinant().is_normal()
}

fn kind(node: &ufbx::Node, is_skinned: bool) -> Kind {
    if node.bone.is_some() || is_skinned {
        Kind::Bone
    } else if node.mesh.is_some() {
        Kind::Mesh
    } else if node.camera.is_some() {
        Kind::Camera
    } else if node.light.is_some() {
        Kind::Light
    } else {
        Kind::Other
    }
}
