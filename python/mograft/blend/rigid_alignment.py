"""Rigid alignment of roots: rotation about the up axis and translation over the floor."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.blend.recombine import Part
from mograft.body.capsules import Poses
from mograft.motion import rotations
from mograft.motion.motion import Motion


@dataclass(frozen=True, eq=False)
class RootTransforms:
    """World rotations and positions of a root joint in n frames."""

    rotations: FloatArray  # (n, 4)
    positions: FloatArray  # (n, 3)

    @classmethod
    def from_motion(cls, motion: Motion, joint: int) -> "RootTransforms":
        """Return the world transforms of a joint in all frames of a motion."""
        return cls(*motion.world_track(joint))

    def relative_to_parent(self, motion: Motion, frames: IntArray, joint: int) -> "RootTransforms":
        """Return these transforms of `joint` relative to its parent in the given frames."""
        parent = int(motion.skeleton.parents[joint])
        if parent < 0:
            return self
        above = RootTransforms.from_motion(motion, parent)[frames]
        inverse = rotations.inverse(above.rotations)
        return RootTransforms(
            rotations.multiply(inverse, self.rotations),
            rotations.rotate(inverse, self.positions - above.positions),
        )

    def __getitem__(self, index: npt.NDArray[np.bool_] | IntArray) -> "RootTransforms":
        return RootTransforms(self.rotations[index], self.positions[index])


@dataclass(frozen=True, eq=False)
class AlignmentTransform:
    """n rigid transforms: a rotation about the up axis, then a translation over the floor."""

    yaws: FloatArray  # (n, 4): rotations about the up axis through the world's origin
    translations: FloatArray  # (n, 3): 0 along the up axis

    @classmethod
    def from_roots(
        cls, source: RootTransforms, target: RootTransforms, up: int
    ) -> "AlignmentTransform":
        """Return transforms that move each source root to the floor position of its target.

        They also rotate it to the heading of the target: by the twist, about the axis `up`, of the
        rotation from source to target. They preserve the height and the lean of the source. If
        source and target are equal, the transform is exactly the identity.

        >>> source = RootTransforms(np.array([[0.0, 0, 0, 1]]), np.array([[1.0, 9, 2]]))
        >>> target = RootTransforms(np.array([[0.0, 1, 0, 0]]), np.array([[5.0, 8, 5]]))
        >>> AlignmentTransform.from_roots(source, target, up=1).apply(source).positions
        array([[5., 9., 5.]])
        """
        between = rotations.multiply(target.rotations, rotations.inverse(source.rotations))
        yaws = rotations.twist(between, up)
        level = np.arange(3) != up
        translations = level * (target.positions - rotations.rotate(yaws, source.positions))
        equal = (source.rotations == target.rotations).all(axis=1)
        equal &= (source.positions == target.positions).all(axis=1)
        yaws[equal], translations[equal] = rotations.IDENTITY, 0.0
        return cls(yaws, translations)

    def __getitem__(self, index: npt.NDArray[np.bool_] | IntArray) -> "AlignmentTransform":
        return AlignmentTransform(self.yaws[index], self.translations[index])

    def apply(self, roots: RootTransforms) -> RootTransforms:
        """Return the world transforms of n roots after applying one alignment transform to each."""
        return RootTransforms(
            rotations.multiply(self.yaws, roots.rotations),
            rotations.rotate(self.yaws, roots.positions) + self.translations,
        )

    def apply_to_poses(self, poses: Poses) -> Poses:
        """Return n poses of whole bodies after applying one alignment transform to each."""
        # As matrices, for all joints at once.
        left = rotations.multiply(self.yaws[:, None], np.eye(4))
        axes = rotations.rotate(self.yaws[:, None], np.eye(3))
        return poses.with_poses(
            poses.frames,
            poses.rotations @ left,
            poses.positions @ axes + self.translations[:, None],
        )


def root_part(motion: Motion, root: int, world: RootTransforms, is_kept: BoolArray) -> Part:
    """Return the part of a root with new world transforms; unchanged in the frames `is_kept`."""
    local = world.relative_to_parent(motion, np.arange(motion.n_frames), root)
    quats = np.where(is_kept[:, None], motion.rotations[:, root], local.rotations)
    places = np.where(is_kept[:, None], motion.positions[:, root], local.positions)
    return Part(np.array([root]), quats[:, None], places[:, None])


def joint_track(clip: Motion, joint: int) -> tuple[FloatArray, FloatArray]:
    """Return the world rotations, (n_frames, 4), and positions, (n_frames, 3), of a joint.

    They are computed upwards from the joint. `Motion.world_track` computes them downwards, and its
    results differ by rounding.
    """
    quats, positions = clip.rotations[:, joint], clip.positions[:, joint]
    for ancestor in clip.skeleton.ancestors(joint):
        above = clip.rotations[:, ancestor]
        positions = clip.positions[:, ancestor] + rotations.rotate(above, positions)
        quats = rotations.multiply(above, quats)
    return quats, positions
