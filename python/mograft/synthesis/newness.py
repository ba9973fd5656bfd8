"""How new a graft is: its poses compared with those of its base and of other grafts."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.containers import remember
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.synthesis.graft_result import Graft

NEW_ANGLE = np.radians(5.0)
"""Angle of a joint to that of the base from which a frame counts as new."""


_FRAMES_PER_BLOCK = 4096


@dataclass(frozen=True)
class Newness:
    """How much a graft differs from its base and from the nearest of other grafts.

    Attributes
    ----------
    new : float
        Share of frames in which an exchanged joint differs from the base by more than 5 degrees.
    changed : float
        Mean angle between the exchanged joints of graft and base, in radians.
    apart : float or None
        Mean angle to the exchanged joints of the nearest other graft of as many frames, in
        radians; None if there is none.
    nearest : str
        Name of that graft; empty if there is none.
    """

    new: float
    changed: float
    apart: float | None = None
    nearest: str = ""

    def __str__(self) -> str:
        nearest = (
            "" if self.apart is None else f", {np.degrees(self.apart):.1f}° from {self.nearest}"
        )
        changed = np.degrees(self.changed)
        return f"{self.new:.0%} of the frames are new; {changed:.1f}° from the base{nearest}"

    def as_dict(self) -> dict[str, float | str | None]:
        """Return the attributes by name."""
        return {**asdict(self), "nearest": self.nearest or None}


def newness(graft: Graft, others: Sequence[Motion] = ()) -> Newness:
    """Measure how new a graft is.

    Parameters
    ----------
    graft : Graft
        The graft. All joints of its exchanged groups are compared, by their local rotations.
    others : sequence of Motion, optional
        Motions of other grafts on the same base; those with another number of frames are ignored.

    Returns
    -------
    Newness
        The measures.

    Examples
    --------
    >>> import mograft as mg
    >>> from mograft.dancer import dance
    >>> library = mg.Library.build(dance(strides=1).motion)
    >>> one, two = mg.graft_many(library, count=2)
    >>> newness(two, [one.motion]).nearest == one.motion.name
    True
    """
    joints, (is_new, _) = grafted_joints(graft), frame_newness(graft)
    gaps = [
        (mean_angle(other, graft.motion, joints), other.name)
        for other in others
        if other.n_frames == graft.motion.n_frames
    ]
    apart, nearest = min(gaps, default=(None, ""))
    changed = mean_angle(graft.base, graft.motion, joints)
    return Newness(float(is_new.mean()), changed, apart, nearest)


def frame_newness(graft: Graft) -> tuple[BoolArray, FloatArray]:
    """Return whether each frame is new, and the mean angle of its exchanged joints to the base.

    The angles are in radians; both arrays have shape (n_frames,). They are kept with the graft.
    """

    def compute() -> tuple[BoolArray, FloatArray]:
        blocks = list(_joint_angles(graft.base, graft.motion, grafted_joints(graft)))
        angles = np.concatenate([own.mean(axis=1) for own in blocks])
        return np.concatenate([(own > NEW_ANGLE).any(axis=1) for own in blocks]), angles

    return remember(graft, "frame newness", compute)


def grafted_joints(graft: Graft) -> IntArray:
    """Return the joints of the exchanged groups."""
    return np.concatenate([graft.library.joints(group) for group in graft.alternatives])


def mean_angle(first: Motion, second: Motion, joints: IntArray) -> float:
    """Return the mean angle between joints of two motions of as many frames, in radians."""
    total = sum(float(own.sum()) for own in _joint_angles(first, second, joints))
    return total / max(first.n_frames * len(joints), 1)


def _joint_angles(first: Motion, second: Motion, joints: IntArray) -> Iterator[FloatArray]:
    """Yield the angles between joints of two motions, in radians, (n_frames, n_joints).

    A block of frames at a time, because long motions fill the memory.
    """
    for start in range(0, first.n_frames, _FRAMES_PER_BLOCK):
        block = slice(start, start + _FRAMES_PER_BLOCK)
        turns = rotations.multiply(
            rotations.inverse(first.rotations[block][:, joints]), second.rotations[block][:, joints]
        )
        yield np.linalg.norm(rotations.log(turns), axis=-1)
