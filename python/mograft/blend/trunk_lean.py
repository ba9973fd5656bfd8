"""`Config.torso`: the lean of a grafted trunk whose parent joint belongs to another group."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.gaussian import gaussian_filter
from mograft.blend.donor_timeline import DonorLayout
from mograft.body.anatomy import anatomy
from mograft.config import Config
from mograft.motion import rotations
from mograft.motion.motion import Motion

HEADING_SMOOTHING = 0.2
"""Standard deviation, in seconds, of the Gaussian that smooths headings.

Chosen from 0 to 0.4 s on the clips `dance_*`, `basket` and `bandai` by the detectability of seams.
"""


@dataclass(frozen=True, eq=False)
class TrunkLean:
    """The trunk joints of a group that keep the lean that they have in the donor's clip.

    The lean is relative to the vertical. The local rotation q_k in a donor's clip k becomes
    R_i⁻¹ Y_i Y_k⁻¹ R_k q_k on the base i. R is the world rotation of the parent joint, and Y the
    part of R about the up axis, its heading. Y is smoothed over `HEADING_SMOOTHING` seconds,
    because the pelvis swings about the up axis with every step and the trunk compensates for that.
    `remove` applies Y_k⁻¹ R_k, `restore` R_i⁻¹ Y_i. After Heck, Kovar and Gleicher (2006).
    """

    joints: IntArray  # the group's joints
    columns: Sequence[int]  # of `joints`: trunk joints whose parent is in another group
    up: int  # the axis that points up
    uprights: FloatArray  # for each column, rotation to the axis of its parent that points up most
    _known: dict[Motion, FloatArray] = field(default_factory=dict)  # results of `leans`

    @classmethod
    def from_config(cls, base: Motion, joints: IntArray, up: int, config: Config) -> "TrunkLean":
        """Find the trunk joints with a parent in another group; none if ``torso="pelvis"``."""
        parents, columns = base.skeleton.parents, []
        if config.torso == "world":
            parts = anatomy(base.skeleton).parts
            columns = [
                column
                for column, joint in enumerate(joints.tolist())
                if parts[joint] == "trunk" and parents[joint] >= 0 and parents[joint] not in joints
            ]
        if not columns:
            return cls(joints, [], up, np.empty((0, 4)))
        world = _world_rotations(base, parents[joints[columns]])
        return cls(joints, columns, up, _uprights(world, up))

    def remove_from(self, layout: DonorLayout, clips: Sequence[Motion]) -> DonorLayout:
        """Return the layout with `remove` applied to the rotations of every clip."""
        quats = [
            self.remove(clip, track) for clip, track in zip(clips, layout.rotations, strict=True)
        ]
        return replace(layout, rotations=quats)

    def remove(self, clip: Motion, quats: FloatArray) -> FloatArray:
        """Return `quats` with the trunk joints relative to the heading of their parents only."""
        if not self.columns:
            return quats
        upright = quats.copy()
        upright[:, self.columns] = rotations.multiply(self.leans(clip), quats[:, self.columns])
        return upright

    def restore(self, base: Motion, quats: FloatArray) -> FloatArray:
        """Make the trunk joints relative to their parents in the base: the inverse of `remove`.

        Rotations that equal those of the base are kept bit for bit.
        """
        if not self.columns:
            return quats
        leans, upright = self.leans(base), quats[:, self.columns]
        given = base.rotations[:, self.joints[list(self.columns)]]
        is_same = (upright == rotations.multiply(leans, given)).all(axis=2)
        leaning = rotations.multiply(rotations.inverse(leans), upright)
        leaning /= np.linalg.norm(leaning, axis=-1, keepdims=True)
        local = quats.copy()
        local[:, self.columns] = np.where(is_same[..., None], given, leaning)
        return local

    def leans(self, clip: Motion) -> FloatArray:
        """Return the parents' world rotations without their heading, (n_frames, n_columns, 4)."""
        if clip not in self._known:
            self._known[clip] = self._find_leans(clip)
        return self._known[clip]

    def _find_leans(self, clip: Motion) -> FloatArray:
        world = _world_rotations(clip, clip.skeleton.parents[self.joints[list(self.columns)]])
        yaws = rotations.twist(rotations.multiply(world, self.uprights), self.up)
        angles = np.unwrap(2.0 * np.arctan2(yaws[..., self.up], yaws[..., 3]), axis=0)
        sigma = HEADING_SMOOTHING * clip.rate
        smooth = np.stack([gaussian_filter(np.ascontiguousarray(a), sigma) for a in angles.T], 1)
        heading = rotations.from_axis_angle(np.eye(3)[self.up], smooth)
        return rotations.multiply(rotations.inverse(heading), world)


def _world_rotations(clip: Motion, joints: IntArray) -> FloatArray:
    """Return the world rotations of a few joints, (n_frames, len(joints), 4)."""
    world = [clip.rotations[:, joint] for joint in joints]
    for column, joint in enumerate(joints.tolist()):
        for ancestor in clip.skeleton.ancestors(joint):
            world[column] = rotations.multiply(clip.rotations[:, ancestor], world[column])
    return np.stack(world, axis=1)


def _uprights(world: FloatArray, up: int) -> FloatArray:
    """Return for each joint the rotation from the up axis to its local axis that points up most.

    `world`, shape (n_frames, n_joints, 4), are world rotations, of which the mean is used. Without
    the result, a lean would change the heading of joints with another vertical axis.
    """
    axis = np.eye(3)[up]
    local = rotations.rotate(rotations.inverse(world), np.broadcast_to(axis, (*world.shape[:2], 3)))
    mean = local.mean(axis=0)
    main = np.abs(mean).argmax(axis=1)
    signs = np.sign(mean[np.arange(len(mean)), main])
    return rotations.shortest_arc(axis, np.eye(3)[main] * signs[:, None])
