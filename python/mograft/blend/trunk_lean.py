"""`Config.torso`: how a grafted trunk leans if it hangs on a joint of another group."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.blend.donor_timeline import DonorLayout
from mograft.body.anatomy import anatomy
from mograft.config import Config
from mograft.motion import rotations
from mograft.motion.motion import Motion


@dataclass(frozen=True, eq=False)
class TrunkLean:
    """The trunk joints of a group whose lean in the world is kept.

    A rotation is q_k in a donor's clip k and R_i⁻¹ Y_i Y_k⁻¹ R_k q_k on the base i. R is the world
    rotation of the joint on which the trunk hangs, Y its twist about the up axis. `remove` applies
    Y_k⁻¹ R_k, `restore` R_i⁻¹ Y_i. After Heck, Kovar and Gleicher (2006).
    """

    joints: IntArray  # the group's joints
    columns: Sequence[int]  # of `joints` that are trunk joints and hang on another group
    up: int  # the axis that points up

    @classmethod
    def from_config(cls, base: Motion, joints: IntArray, up: int, config: Config) -> "TrunkLean":
        """Return the trunk joints that hang on another group; none for ``torso="pelvis"``."""
        if config.torso == "pelvis":
            return cls(joints, [], up)
        parts, parents = anatomy(base.skeleton).parts, base.skeleton.parents
        columns = [
            column
            for column, joint in enumerate(joints.tolist())
            if parts[joint] == "trunk" and parents[joint] >= 0 and parents[joint] not in joints
        ]
        return cls(joints, columns, up)

    def remove_from(self, layout: DonorLayout, clips: Sequence[Motion]) -> DonorLayout:
        """Return a layout of clips with the lean removed from its rotations."""
        quats = [
            self.remove(clip, track) for clip, track in zip(clips, layout.rotations, strict=True)
        ]
        return replace(layout, rotations=quats)

    def remove(self, clip: Motion, quats: FloatArray) -> FloatArray:
        """Return rotations as seen from a parent that does not lean, only faces as in the clip."""
        if not self.columns:
            return quats
        upright = quats.copy()
        upright[:, self.columns] = rotations.multiply(self._leans(clip), quats[:, self.columns])
        return upright

    def restore(self, base: Motion, quats: FloatArray) -> FloatArray:
        """Undo `remove` by the base's lean; rotations equal to the base's stay bit for bit."""
        if not self.columns:
            return quats
        given = base.rotations[:, self.joints]
        is_same = (quats == self.remove(base, given)).all(axis=2)[:, self.columns]
        inverse = rotations.inverse(self._leans(base))
        leaning = rotations.multiply(inverse, quats[:, self.columns])
        leaning /= np.linalg.norm(leaning, axis=-1, keepdims=True)
        local = quats.copy()
        local[:, self.columns] = np.where(is_same[..., None], given[:, self.columns], leaning)
        return local

    def _leans(self, clip: Motion) -> FloatArray:
        """Return the world rotations of the trunk's parents without their yaw."""
        parents = clip.skeleton.parents[self.joints[list(self.columns)]]
        world = clip.world_transforms()[0][:, parents]
        return rotations.multiply(rotations.inverse(rotations.twist(world, self.up)), world)
