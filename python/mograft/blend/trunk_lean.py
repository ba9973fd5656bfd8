"""`Config.torso`: the lean of a grafted trunk whose parent joint belongs to another group."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mograft._util.arrays import FloatArray, IntArray, make_read_only
from mograft._util.containers import remember
from mograft._util.gaussian import gaussian_filter_columns
from mograft.blend.rigid_alignment import joint_track
from mograft.body.anatomy import anatomy
from mograft.config import Config
from mograft.motion import rotations
from mograft.motion.motion import Motion

HEADING_SMOOTHING = 0.2
"""Standard deviation, in seconds, of the Gaussian that smooths headings.

Chosen from 0 to 0.4 s on the clips `dance_*`, `basket` and `bandai` by the detectability of seams.
"""

ROBOT_HEADING_SMOOTHING = 0.035
"""`HEADING_SMOOTHING` of robots, whose waists follow the pelvis more than those of people.

Chosen from 0 to 0.2 s on recordings of the G1: neither the angle of the waist nor the heading of
the trunk has larger accelerations than in the recordings.
"""


@dataclass(frozen=True, eq=False)
class TrunkLean:
    """The trunk joints of a group that keep the lean that they have in the donor's clip.

    The lean is relative to the vertical. The local rotation q_k in a donor's clip k becomes
    R_i⁻¹ Y_i Y_k⁻¹ R_k q_k on the base i. R is the world rotation of the parent joint, and Y the
    part of R about the up axis, its heading. Y is smoothed over `HEADING_SMOOTHING` seconds,
    because the pelvis swings about the up axis with every step and the trunk compensates for that.
    After Heck, Kovar and Gleicher (2006).
    """

    joints: IntArray  # the group's joints
    columns: Sequence[int]  # indices in `joints` of trunk joints whose parent is in another group
    up: int  # the axis that points up
    uprights: FloatArray  # result of `_uprights` for the parent of each trunk joint
    base_leans: FloatArray  # Y_i⁻¹ R_i in each frame of the base, (n_frames, n_columns, 4)

    @classmethod
    def from_config(cls, base: Motion, joints: IntArray, up: int, config: Config) -> "TrunkLean":
        """Find the trunk joints with a parent in another group; none if ``torso="pelvis"``."""
        parents, columns = base.skeleton.parents, []
        if config.torso != "pelvis":
            parts = anatomy(base.skeleton).parts
            columns = [
                column
                for column, joint in enumerate(joints.tolist())
                if parts[joint] == "trunk" and parents[joint] >= 0 and parents[joint] not in joints
            ]
        if not columns:
            no_leans = np.empty((base.n_frames, 0, 4))
            return cls(joints, [], up, np.empty((0, 4)), no_leans)
        trunks = joints[columns]
        key = ("uprights", parents[trunks].tobytes(), up)
        uprights = remember(
            base, key, lambda: _uprights(_world_rotations(base, parents[trunks]), up)
        )
        return cls(joints, columns, up, uprights, _leans(base, trunks, up, uprights))

    def at(self, frames: IntArray) -> "TrunkLean":
        """Return the `TrunkLean` of a base that consists of the given frames of this base."""
        return replace(self, base_leans=self.base_leans[frames])

    def upright_tracks(self, clip: Motion, block: slice = slice(None)) -> FloatArray:
        """Return the rotations of the group's joints in a clip, shape (n_frames, n_joints, 4).

        Rotations of the trunk joints in `columns` are relative to the heading of the parent, so
        they include the lean of the parent; the others are local. `block` selects some of the
        joints. The array of all joints is cached for the clip and read-only.
        """
        columns = range(len(self.joints))[block]
        if len(columns) < len(self.joints):
            return self._remove(clip, columns)
        key = ("tracks", self.joints.tobytes(), *self.columns, self.uprights.tobytes())
        return remember(clip, key, lambda: self._remove(clip, columns))

    def _remove(self, clip: Motion, columns: range) -> FloatArray:
        tracks = clip.rotations.take(self.joints[columns.start : columns.stop], axis=1)
        trunk = [index for index, column in enumerate(self.columns) if column in columns]
        if trunk:
            trunks = self.joints[list(self.columns)]
            leans = _leans(clip, trunks, self.up, self.uprights)[:, trunk]
            own = [self.columns[index] - columns.start for index in trunk]
            tracks[:, own] = rotations.multiply(leans, tracks[:, own])
        make_read_only(tracks)
        return tracks

    def restore(self, base: Motion, quats: FloatArray) -> None:
        """Convert trunk rotations to local ones, relative to the parents in the base, in place.

        R_i⁻¹ Y_i is applied. A rotation that gives that of the base is replaced by it, bit for bit.
        """
        if not self.columns:
            return
        leans, upright = self.base_leans, quats[:, self.columns]
        given = base.rotations[:, self.joints[list(self.columns)]]
        is_same = (upright == rotations.multiply(leans, given)).all(axis=2)
        leaning = rotations.multiply(rotations.inverse(leans), upright)
        leaning /= np.linalg.norm(leaning, axis=-1, keepdims=True)
        quats[:, self.columns] = np.where(is_same[..., None], given, leaning)


def _leans(clip: Motion, trunks: IntArray, up: int, uprights: FloatArray) -> FloatArray:
    """Return the lean of the parent of each trunk joint: its world rotation without heading, Y⁻¹ R.

    The shape is (n_frames, n_trunks, 4). The array is cached for the clip.
    """

    def compute() -> FloatArray:
        world = _world_rotations(clip, clip.skeleton.parents[trunks])
        yaws = rotations.twist(rotations.multiply(world, uprights), up)
        angles = np.unwrap(2.0 * np.arctan2(yaws[..., up], yaws[..., 3]), axis=0)
        is_robot = clip.skeleton.hinges is not None
        sigma = (ROBOT_HEADING_SMOOTHING if is_robot else HEADING_SMOOTHING) * clip.rate
        smooth = gaussian_filter_columns(angles, sigma)
        to_heading = rotations.inverse(rotations.from_axis_angle(np.eye(3)[up], smooth))
        return rotations.multiply(to_heading, world)

    return remember(clip, ("leans", trunks.tobytes(), up, uprights.tobytes()), compute)


def _world_rotations(clip: Motion, joints: IntArray) -> FloatArray:
    """Return the world rotations of a few joints, (n_frames, len(joints), 4)."""
    return np.stack([joint_track(clip, joint)[0] for joint in joints.tolist()], axis=1)


def _uprights(world: FloatArray, up: int) -> FloatArray:
    """Return for each joint the rotation from the up axis to its local axis that points up most.

    `world`, shape (n_frames, n_joints, 4), are the world rotations. The axis is that which points
    up most on average. Without the result, a lean would change the computed heading of a joint
    whose vertical local axis is not the axis `up`.
    """
    axis = np.eye(3)[up]
    local = rotations.rotate(rotations.inverse(world), np.broadcast_to(axis, (*world.shape[:2], 3)))
    mean = local.mean(axis=0)
    main = np.abs(mean).argmax(axis=1)
    signs = np.sign(mean[np.arange(len(mean)), main])
    return rotations.shortest_arc(axis, np.eye(3)[main] * signs[:, None])
