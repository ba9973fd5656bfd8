"""Arrays as Kimodo writes them, with made motions."""

import numpy as np

import mograft as mg
from mograft.io.kimodo import SKELETONS
from mograft.motion import rotations
from tests.strategies import smooth_rotations


def kimodo_arrays(n_joints=30, n_frames=5, seed=0):
    """World positions and rotation matrices of a random motion, and the motion."""
    rng = np.random.default_rng(seed)
    kind = SKELETONS[n_joints]
    skeleton = mg.Skeleton(kind.joints, kind.parents, rng.uniform(-0.3, 0.3, (n_joints, 3)))
    quats = smooth_rotations(rng, n_frames, n_joints)
    positions = np.tile(skeleton.offsets, (n_frames, 1, 1))
    positions[:, 0] += rng.normal(1.0, size=(n_frames, 3))
    motion = mg.Motion(skeleton, 1 / 30, quats, positions)
    world, places = motion.world_transforms()
    axes = np.eye(3)[:, None, None]  # the columns of a matrix are the rotated axes
    matrices = np.moveaxis(np.array([rotations.rotate(world, axis) for axis in axes]), 0, -1)
    arrays = {
        "posed_joints": places.astype(np.float32),
        "global_rot_mats": matrices.astype(np.float32),
        "foot_contacts": np.zeros((n_frames, 4), bool),
    }
    return arrays, motion
