//! World transforms of joints at equally spaced times.

use std::fmt;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::orthogonal::nearest_rotation;
use crate::{Scene, to_vector};

/// World rotations and positions of joints, frame-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Poses {
    /// Unit quaternions xyzw, `n_frames * n_joints`.
    pub rotations: Vec<[f64; 4]>,
    /// Positions in the unit of the file, `n_frames * n_joints`.
    pub positions: Vec<[f64; 3]>,
}

/// Why a take cannot be baked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BakeError {
    /// The scene has no such take.
    NoSuchTake,
    /// The scene has no such node.
    NoSuchNode,
    /// The result does not fit into memory.
    OutOfMemory,
}

impl fmt::Display for BakeError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::NoSuchTake => "`take` must be the index of a take",
            Self::NoSuchNode => "`joints` must be indices of nodes",
            Self::OutOfMemory => "the poses must fit into memory",
        })
    }
}

impl std::error::Error for BakeError {}

/// World transform of a node at one time, in the terms of `ufbx::InheritMode`.
#[derive(Clone, Copy)]
struct World {
    transform: DAffine3,
    /// The transform without the scale of the node itself.
    unscaled: DAffine3,
    /// Scale that children with another inherit mode than `Normal` take over.
    inherit_scale: DVec3,
    /// Rotation nearest to the transform.
    rotation: DQuat,
}

/// A node to evaluate.
struct Step<'a> {
    node: &'a ufbx::Node,
    /// Index of the step of the parent, and of the node that passes its scale on.
    parent: Option<usize>,
    scale_source: Option<usize>,
    is_animated: bool,
}

impl Scene {
    /// Return the world transforms of `joints`, indices of nodes, at `n_frames` times.
    ///
    /// Frame i is at `begin` + i / `rate` seconds, rounded to the resolution of times in FBX, so
    /// that it coincides with a key there. Animation layers, pivots, pre- and post-rotations are
    /// evaluated by ufbx. Rotations are those nearest to the transforms, which may scale and shear;
    /// a transform that mirrors is negated first. Time is in O(`n_frames` × nodes).
    ///
    /// # Errors
    ///
    /// If `take` or `joints` are out of range, or the result does not fit into memory.
    pub fn bake(
        &self,
        take: usize,
        joints: &[usize],
        begin: f64,
        rate: f64,
        n_frames: usize,
    ) -> Result<Poses, BakeError> {
        let stack = self
            .root
            .anim_stacks
            .as_ref()
            .get(take)
            .ok_or(BakeError::NoSuchTake)?;
        let (steps, step_of_node) = self.steps(take, joints)?;
        let n_poses = n_frames
            .checked_mul(joints.len())
            .ok_or(BakeError::OutOfMemory)?;
        let mut poses = Poses { rotations: Vec::new(), positions: Vec::new() };
        poses
            .rotations
            .try_reserve_exact(n_poses)
            .map_err(|_| BakeError::OutOfMemory)?;
        poses
            .positions
            .try_reserve_exact(n_poses)
            .map_err(|_| BakeError::OutOfMemory)?;
        let ticks = self.root.metadata.ktime_second as f64;
        let mut worlds: Vec<World> = Vec::with_capacity(steps.len());
        for frame in 0..n_frames {
            let time = ((begin + frame as f64 / rate) * ticks).round() / ticks;
            worlds.clear();
            for step in &steps {
                let local = if step.is_animated {
                    ufbx::evaluate_transform(&stack.anim, step.node, time)
                } else {
                    step.node.local_transform
                };
                worlds.push(world(step, &local, &worlds));
            }
            for &joint in joints {
                let world = &worlds[step_of_node[joint]];
                poses.rotations.push(world.rotation.to_array());
                poses.positions.push(world.transform.translation.to_array());
            }
        }
        Ok(poses)
    }

    /// Return the nodes to evaluate, parents first, and the index of the step of every node.
    fn steps(
        &self,
        take: usize,
        joints: &[usize],
    ) -> Result<(Vec<Step<'_>>, Vec<usize>), BakeError> {
        let mut is_needed = vec![false; self.nodes.len()];
        for &joint in joints {
            let mut next = Some(joint);
            while let Some(node) = next {
                let slot = is_needed.get_mut(node).ok_or(BakeError::NoSuchNode)?;
                if std::mem::replace(slot, true) {
                    break;
                }
                next = self.nodes[node].parent;
            }
        }
        let mut is_animated = vec![false; self.nodes.len()];
        for layer in &self.root.anim_stacks[take].layers {
            for property in layer.anim_props.as_ref() {
                if property.element.type_ == ufbx::ElementType::Node {
                    is_animated[property.element.typed_id as usize] = true;
                }
            }
        }
        let mut step_of_id = vec![0; self.nodes.len()];
        let mut step_of_node = vec![0; self.nodes.len()];
        let mut steps = Vec::new();
        for (index, &id) in self
            .ids
            .iter()
            .enumerate()
            .filter(|&(index, _)| is_needed[index])
        {
            step_of_id[id] = steps.len();
            step_of_node[index] = steps.len();
            let node = &self.root.nodes[id];
            let step_of =
                |other: &ufbx::Ref<ufbx::Node>| step_of_id[other.element.typed_id as usize];
            steps.push(Step {
                node,
                parent: node.parent.as_ref().map(step_of),
                // A scale source is an ancestor, so that its step exists.
                scale_source: node.inherit_scale_node.as_ref().map(step_of),
                is_animated: is_animated[id],
            });
        }
        Ok((steps, step_of_node))
    }
}

/// Return the world transform of a node: the equations of `ufbx_inherit_mode` in ufbx.h.
fn world(step: &Step<'_>, local: &ufbx::Transform, worlds: &[World]) -> World {
    let rotation = local.rotation;
    let rotation = DQuat::from_xyzw(rotation.x, rotation.y, rotation.z, rotation.w);
    let (mut translation, mut scale) = (to_vector(local.translation), to_vector(local.scale));
    let parent = step.parent.map(|parent| &worlds[parent]);
    let mut base = parent.map_or(DAffine3::IDENTITY, |parent| parent.transform);
    if let Some(parent) = parent
        && step.node.inherit_mode != ufbx::InheritMode::Normal
    {
        base = parent.unscaled;
        translation *= parent.inherit_scale;
        scale *= step
            .scale_source
            .map_or(DVec3::ONE, |source| worlds[source].inherit_scale);
    }
    let transform = base * DAffine3::from_scale_rotation_translation(scale, rotation, translation);
    let fallback = parent.map_or(DQuat::IDENTITY, |parent| parent.rotation) * rotation;
    World {
        transform,
        unscaled: base * DAffine3 { matrix3: DMat3::from_quat(rotation), translation },
        inherit_scale: scale,
        rotation: nearest_rotation(transform.matrix3, fallback),
    }
}
