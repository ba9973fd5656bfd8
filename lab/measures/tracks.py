"""Motions as arrays that the measures of generated motions compare."""

import numpy as np

from mograft import rotations
from mograft.body.anatomy import feature_joints

COMPARED_RATE = 10.0  # frames per second at which windows are compared


def rotations_6d(quats):
    """Return two columns of the rotation matrices of `quats`, shape (..., 6).

    Source: Zhou et al., On the continuity of rotation representations, CVPR 2019.
    """
    first, second = (rotations.rotate(quats, np.eye(3)[axis]) for axis in (0, 1))
    return np.concatenate([first, second], axis=-1)


def pose_track(motion, root):
    """Return the 6D rotations of the body at about 10 frames per second, (n_frames, 6 * n_joints).

    The locomotion root, its ancestors, fingers, toes and the face are left out, so that neither
    position nor heading has an effect.
    """
    joints = feature_joints(motion.skeleton, np.arange(motion.n_joints))
    joints = joints[~np.isin(joints, [root, *motion.skeleton.ancestors(root)])]
    frames = np.arange(0, motion.n_frames, max(round(motion.rate / COMPARED_RATE), 1))
    return rotations_6d(motion.rotations[frames][:, joints]).reshape(len(frames), -1)
