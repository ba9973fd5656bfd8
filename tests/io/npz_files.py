"""Files like those of AMASS and Kimodo: the arrays of the public releases with made motions."""

import numpy as np

from mograft import Motion, Skeleton, write_bvh
from mograft.dancer import dance
from mograft.io.kimodo import SKELETONS
from mograft.io.smpl.body_models import SMPL_H, SMPL_X, stand_in
from mograft.library.spec import conform
from mograft.motion import rotations
from tests.strategies import smooth_rotations, still_motion


def amass_arrays(n_columns=156, n_frames=30, seed=0, dtype=np.float64):
    """Return the arrays of an AMASS file; SMPL-X files have the keys of that release."""
    rng = np.random.default_rng(seed)
    time = np.arange(n_frames)[:, None] / 60
    poses = 0.4 * np.sin(rng.uniform(1, 6, n_columns) * time + rng.uniform(0, 6, n_columns))
    poses[:, :3] = np.array([np.pi / 2, 0, 0]) + 0.1 * poses[:, :3]
    trans = np.column_stack([time[:, 0], 0.1 * np.sin(time[:, 0]), np.full(n_frames, 0.93)])
    poses, trans = poses.astype(dtype), trans.astype(dtype)
    arrays = {"trans": trans, "gender": np.array("female"), "betas": rng.normal(size=16)}
    if n_columns != 165:
        rate = {"mocap_framerate": np.array(60.0)}
        return arrays | rate | {"dmpls": rng.normal(size=(n_frames, 8)), "poses": poses}
    arrays |= {"surface_model_type": np.array("smplx"), "mocap_frame_rate": np.array(60.0)}
    parts = {name: poses[:, own] for name, own in SMPL_X.columns.items()}
    return arrays | {"num_betas": np.array(16), "poses": poses, **parts}


def dance_arrays(seed=0, n_frames=400):
    """Return the arrays of an SMPL-H file whose body dances."""
    motion = dance(seed=seed, strides=1).motion[:n_frames].resample(60)
    body = conform(motion, stand_in(SMPL_H), up=2, root=0)
    arrays = amass_arrays(156, body.n_frames, seed)
    poses = rotations.log(body.rotations).reshape(body.n_frames, -1)
    return arrays | {"poses": poses, "trans": body.positions[:, 0].copy()}


def write_rest_pose(skeleton, path):
    """Write a skeleton as a BVH of one frame in its rest pose, and return the path."""
    write_bvh(still_motion(skeleton, 1), path)
    return path


def write_arrays(path, arrays):
    """Write arrays as NPZ and return the path."""
    np.savez(path, **arrays)
    return path


def kimodo_arrays(n_joints=30, n_frames=5, seed=0):
    """World positions and rotation matrices of a random motion, and the motion."""
    rng = np.random.default_rng(seed)
    kind = SKELETONS[n_joints]
    skeleton = Skeleton(kind.joints, kind.parents, rng.uniform(-0.3, 0.3, (n_joints, 3)))
    quats = smooth_rotations(rng, n_frames, n_joints)
    positions = np.tile(skeleton.offsets, (n_frames, 1, 1))
    positions[:, 0] += rng.normal(1.0, size=(n_frames, 3))
    motion = Motion(skeleton, 1 / 30, quats, positions)
    world, places = motion.world_transforms()
    axes = np.eye(3)[:, None, None]  # the columns of a matrix are the rotated axes
    matrices = np.moveaxis(np.array([rotations.rotate(world, axis) for axis in axes]), 0, -1)
    arrays = {"posed_joints": np.float32(places), "global_rot_mats": np.float32(matrices)}
    return arrays | {"foot_contacts": np.zeros((n_frames, 4), bool)}, motion
