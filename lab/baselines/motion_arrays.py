"""Motions as arrays of features from which baselines synthesize new motions."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from lab.measures.tracks import rotations_6d
from mograft.body.mass import mass_model


@dataclass(frozen=True, eq=False)
class MotionArrays:
    """The frame of reference in which motions of one skeleton are arrays.

    A row has the velocity of the root over the floor, in skeleton heights per second, its height
    in skeleton heights, and the 6D rotations of all joints.
    """

    template: object  # motion whose skeleton and translations of other joints are used
    root: int
    up: int

    @classmethod
    def of(cls, library):
        """Return the frame of reference of a library."""
        return cls(library.clips[0], library.root, library.up)

    @property
    def _level(self):
        return [axis for axis in range(3) if axis != self.up]

    def encode(self, motion):
        """Return the features of a motion, shape (n_frames, 3 + 6 * n_joints)."""
        track = motion.positions[:, self.root] / mass_model(motion.skeleton).height
        steps = np.diff(track[:, self._level], axis=0, prepend=track[:1, self._level])
        steps[0] = steps[1] if len(steps) > 1 else 0.0
        quats = rotations_6d(motion.rotations).reshape(motion.n_frames, -1)
        return np.concatenate([steps * motion.rate, track[:, [self.up]], quats], axis=1)

    def joint_columns(self, joints):
        """Return the columns of the rotations of some joints."""
        return (3 + 6 * np.asarray(joints)[:, None] + np.arange(6)).ravel()

    def decode(self, features, start=(0.0, 0.0), name=""):
        """Return the motion of features; its root starts at `start`, in the unit of the file."""
        n = len(features)
        height = mass_model(self.template.skeleton).height
        positions = np.repeat(np.median(self.template.positions, axis=0)[None], n, axis=0)
        steps = features[:, :2] * height / self.template.rate
        steps[0] = 0.0
        positions[:, self.root, self._level] = np.asarray(start) + np.cumsum(steps, axis=0)
        positions[:, self.root, self.up] = features[:, 2] * height
        return replace(
            self.template,
            rotations=quaternions(features[:, 3:].reshape(n, -1, 6)),
            positions=positions,
            channel_values=None,
            name=name,
        )


def quaternions(columns):
    """Return the quaternions (xyzw) of 6D rotations, shape (..., 6), after orthogonalization."""
    first = columns[..., :3] / np.linalg.norm(columns[..., :3], axis=-1, keepdims=True)
    second = columns[..., 3:] - (first * columns[..., 3:]).sum(-1, keepdims=True) * first
    second /= np.linalg.norm(second, axis=-1, keepdims=True)
    matrices = np.stack([first, second, np.cross(first, second)], axis=-1)
    return Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_quat().reshape(*first.shape[:-1], 4)
