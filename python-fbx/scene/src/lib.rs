//! Hierarchy, rest pose, animation and meshes of FBX scenes, read with ufbx.
//!
//! World transforms are right-handed with y up, in the unit of the file. Nodes are in preorder: a
//! node precedes its children, and the nodes below a node follow it. Node 0 is the root that ufbx
//! adds above the nodes of the file.

mod bake;
mod glb;
mod hierarchy;
mod mesh;
mod orthogonal;

use std::fmt;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::orthogonal::nearest_rotation;

pub use bake::{BakeError, Poses};
pub use glb::{Figure, Glb, GlbError};
pub use hierarchy::{Kind, Node};
pub use mesh::{MAX_INFLUENCES, Material, Part, TooManyCorners};

/// Greatest depth of a hierarchy.
const MAX_DEPTH: u32 = 1000;

/// An animation stack: one take.
#[derive(Clone, Debug, PartialEq)]
pub struct Take {
    /// Name of the stack.
    pub name: String,
    /// First and last second that the stack names.
    pub range: (f64, f64),
    /// First and last second with a key of a node; None if no node has a key.
    pub key_range: Option<(f64, f64)>,
    /// Indices of the nodes that have keys.
    pub animated: Vec<usize>,
}

/// Settings of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Version, such as 7400.
    pub version: u32,
    /// Whether the file is text.
    pub is_ascii: bool,
    /// Metres in one unit of length.
    pub unit_metres: f64,
    /// Axes of the file that point to the right, up and to the front, such as `+X +Z -Y`.
    pub axes: String,
    /// Frames per second.
    pub rate: f64,
}

/// ufbx refused a file; the message is its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoadError(pub String);

impl fmt::Display for LoadError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.0)
    }
}

impl std::error::Error for LoadError {}

/// A loaded file.
pub struct Scene {
    root: ufbx::SceneRoot,
    nodes: Vec<Node>,
    /// `typed_id` of every node: its index in `ufbx::Scene::nodes`.
    ids: Vec<usize>,
}

impl Scene {
    /// Load a file from its bytes, with at most `memory_limit` bytes in each of ufbx' allocators.
    ///
    /// No other file is opened. Meshes and embedded files are skipped unless `with_geometry`.
    ///
    /// # Errors
    ///
    /// If ufbx refuses the file.
    pub fn load(data: &[u8], memory_limit: usize, with_geometry: bool) -> Result<Self, LoadError> {
        let allocator = || ufbx::AllocatorOpts { memory_limit, ..ufbx::AllocatorOpts::default() };
        let options = ufbx::LoadOpts {
            temp_allocator: allocator(),
            result_allocator: allocator(),
            ignore_geometry: !with_geometry,
            ignore_embedded: !with_geometry,
            skip_skin_vertices: !with_geometry,
            skip_mesh_parts: !with_geometry,
            generate_missing_normals: with_geometry,
            node_depth_limit: MAX_DEPTH,
            file_format: ufbx::FileFormat::Fbx,
            target_axes: ufbx::CoordinateAxes {
                right: ufbx::CoordinateAxis::PositiveX,
                up: ufbx::CoordinateAxis::PositiveY,
                front: ufbx::CoordinateAxis::PositiveZ,
            },
            ..ufbx::LoadOpts::default()
        };
        let root = ufbx::load_memory(data, options).map_err(|error| LoadError(describe(&error)))?;
        let ids = hierarchy::preorder(&root);
        let nodes = hierarchy::nodes(&root, &ids);
        Ok(Self { root, nodes, ids })
    }

    /// The nodes in preorder.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The rest pose of all nodes, as one frame.
    pub fn rest_pose(&self) -> Poses {
        let rests = self.nodes.iter().map(|node| &node.rest);
        Poses {
            rotations: rests
                .clone()
                .map(|rest| nearest_rotation(rest.matrix3, DQuat::IDENTITY).to_array())
                .collect(),
            positions: rests.map(|rest| rest.translation.to_array()).collect(),
        }
    }

    /// The takes in the order of the file.
    pub fn takes(&self) -> Vec<Take> {
        let indices = hierarchy::inverse(&self.ids);
        (&self.root.anim_stacks)
            .into_iter()
            .map(|stack| take(stack, &indices))
            .collect()
    }

    /// The settings of the file.
    pub fn settings(&self) -> Settings {
        let settings = &self.root.settings;
        let axes = settings.axes;
        Settings {
            version: self.root.metadata.version,
            is_ascii: self.root.metadata.ascii,
            unit_metres: settings.original_unit_meters,
            axes: [axes.right, axes.up, axes.front].map(axis_name).join(" "),
            rate: settings.frames_per_second,
        }
    }

    /// Number of constraints, which are not evaluated.
    pub fn n_constraints(&self) -> usize {
        self.root.constraints.count
    }
}

/// Return the first line of ufbx' message, without its version.
fn describe(error: &ufbx::Error) -> String {
    let mut buffer = [0; 1024];
    let length = ufbx::format_error(&mut buffer, error).min(buffer.len());
    let text = String::from_utf8_lossy(&buffer[..length]);
    let line = text.lines().next().unwrap_or_default();
    line.split_once("error: ")
        .map_or(line, |(_, message)| message)
        .to_owned()
}

fn take(stack: &ufbx::AnimStack, indices: &[usize]) -> Take {
    let mut key_range: Option<(f64, f64)> = None;
    let mut animated = Vec::new();
    for property in (&stack.layers)
        .into_iter()
        .flat_map(|layer| layer.anim_props.as_ref())
    {
        if property.element.type_ != ufbx::ElementType::Node {
            continue;
        }
        let keys: Vec<_> = property
            .anim_value
            .curves
            .iter()
            .flatten()
            .flat_map(|curve| curve.keyframes.as_ref())
            .collect();
        for key in &keys {
            let (first, last) = key_range.unwrap_or((key.time, key.time));
            key_range = Some((first.min(key.time), last.max(key.time)));
        }
        if !keys.is_empty() {
            animated.push(indices[property.element.typed_id as usize]);
        }
    }
    animated.sort_unstable();
    animated.dedup();
    Take {
        name: stack.element.name.to_string(),
        range: (stack.time_begin, stack.time_end),
        key_range,
        animated,
    }
}

fn axis_name(axis: ufbx::CoordinateAxis) -> &'static str {
    match axis {
        ufbx::CoordinateAxis::PositiveX => "+X",
        ufbx::CoordinateAxis::NegativeX => "-X",
        ufbx::CoordinateAxis::PositiveY => "+Y",
        ufbx::CoordinateAxis::NegativeY => "-Y",
        ufbx::CoordinateAxis::PositiveZ => "+Z",
        ufbx::CoordinateAxis::NegativeZ => "-Z",
        ufbx::CoordinateAxis::Unknown => "?",
    }
}

fn to_vector(vector: ufbx::Vec3) -> DVec3 {
    DVec3::new(vector.x, vector.y, vector.z)
}

fn to_affine(matrix: &ufbx::Matrix) -> DAffine3 {
    DAffine3 {
        matrix3: DMat3::from_cols(
            DVec3::new(matrix.m00, matrix.m10, matrix.m20),
            DVec3::new(matrix.m01, matrix.m11, matrix.m21),
            DVec3::new(matrix.m02, matrix.m12, matrix.m22),
        ),
        translation: DVec3::new(matrix.m03, matrix.m13, matrix.m23),
    }
}
