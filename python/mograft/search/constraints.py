"""Base class of constraints and their violations.

The error of a constraint is measured in multiples of its tolerance: a value up to 1 satisfies it.
A constraint without a weight is hard; a motion that does not satisfy it has a `Violation`. A
constraint with a weight is soft and costs ``weight · error²``. Body lengths and tolerances are in
skeleton heights, positions and sizes of objects in the unit of the file. Frames are those of the
base motion, both ends included.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.runs import find_runs
from mograft._util.validate import check_not_negative, is_integer
from mograft.body.capsules import Poses
from mograft.motion.segments import Segments

Span = tuple[int, int]

Errors = tuple[FloatArray, IntArray]  # error of each pose in tolerances, and its joint or -1


class Clip(Protocol):
    """Name and tags of a donor clip."""

    @property
    def name(self) -> str:
        """Name of the clip."""

    @property
    def tags(self) -> Sequence[str]:
        """Tags of the clip."""


@dataclass(frozen=True, kw_only=True)
class Constraint:
    """Base class of constraints.

    Parameters
    ----------
    weight : float, optional
        Makes the constraint soft: an error of e tolerances costs ``weight · e²``. Default: the
        constraint is hard.
    frames : tuple of int, optional
        First and last frame of the base motion in which the constraint applies. Default: all
        frames.
    """

    weight: float | None = None
    frames: Span | None = None

    def __post_init__(self) -> None:
        if self.weight is not None:
            check_not_negative(self, "weight")
        if self.frames is not None:
            object.__setattr__(self, "frames", as_span("frames", self.frames))

    @property
    def is_hard(self) -> bool:
        """Whether the constraint is hard."""
        return self.weight is None

    @property
    def is_on_poses(self) -> bool:
        """Whether the constraint depends on poses."""
        return type(self).errors is not Constraint.errors

    def applies_to_group(self, group: str) -> bool:
        """Return whether the constraint restricts the donors of a joint group."""
        return True

    def applies(self, frames: IntArray) -> BoolArray:
        """Return whether the constraint applies in each frame of the base motion."""
        if self.frames is None:
            return np.ones(len(frames), bool)
        return (frames >= self.frames[0]) & (frames <= self.frames[1])

    def errors(self, poses: Poses, joints: BoolArray | None = None) -> Errors:
        """Return the error of each pose, as a multiple of the tolerance.

        Parameters
        ----------
        poses : Poses
            The poses.
        joints : ndarray of bool, shape (n_joints,), optional
            The joints whose errors count. Default: all.

        Returns
        -------
        error : ndarray, shape (n,)
            At most 1 if the pose satisfies the constraint; 0 if the constraint does not apply.
        joint : ndarray of int, shape (n,)
            Index of the joint that has the error; -1 if no joint is responsible.
        """
        return no_errors(poses)

    def donor_errors(self, base: Segments, donors: Segments, clips: Sequence[Clip]) -> FloatArray:
        """Return the error that follows from the clip, frames and length of each donor.

        Parameters
        ----------
        base, donors : Segments
            n base segments and one donor for each.
        clips : sequence
            Objects with the name and the tags of each clip, such as `Library.entries`;
            `donors.clip` holds indices into it.

        Returns
        -------
        ndarray, shape (n,)
            0 for donors that satisfy the constraint, above 1 for others.
        """
        return np.zeros(len(donors))

    def describe_error(self, error: float, height: float) -> str:
        """Return a text for messages that describes an error, given in tolerances.

        `height` is the skeleton height in the unit of the file.
        """
        return f"{error:.3g} tolerances"


@dataclass(frozen=True)
class Violation:
    """A run of frames in which a hard constraint is violated.

    Attributes
    ----------
    constraint : Constraint
        The constraint.
    frames : tuple of int
        First and last frame of the violation.
    worst : int
        Frame of the largest error.
    error : float
        Largest error, as a multiple of the tolerance.
    joint : str
        Joint of the largest error; empty if no joint is responsible.
    message : str
        Description with the error and the tolerance.
    """

    constraint: Constraint
    frames: Span
    worst: int
    error: float
    joint: str
    message: str


def build_violation(
    constraint: Constraint,
    frames: Span,
    error: float,
    description: str,
    worst: int | None = None,
    joint: str = "",
) -> Violation:
    """Return a violation whose message names the class, the frames and the joint.

    `description` describes the error. `worst` is the frame of the greatest error; None if the error
    is that of all `frames`.
    """
    first, last = frames
    where = f"at frame {first}" if first == last else f"in frames {first} to {last}"
    where += "" if worst is None or first == last else f", worst at {worst}"
    by = f" by {joint}" if joint and joint not in description else ""
    return Violation(
        constraint=constraint,
        frames=frames,
        worst=first if worst is None else worst,
        error=error,
        joint=joint,
        message=f"{type(constraint).__name__} is violated {where}{by}: {description}",
    )


def find_violations(
    constraints: Sequence[Constraint], poses: Poses, joints: BoolArray | None = None
) -> list[Violation]:
    """Return the violations of hard constraints by poses in successive frames.

    Successive frames that violate a constraint are one violation. Violations are sorted by
    constraint, then by frame. `joints`, a mask of shape (n_joints,), selects the joints whose
    errors count; by default all do.
    """
    found = []
    for constraint in constraints:
        if not constraint.is_hard:
            continue
        errors, joint_of_error = constraint.errors(poses, joints)
        for start, stop in find_runs(errors > 1.0).tolist():
            at = start + int(errors[start:stop].argmax())
            error, index = float(errors[at]), int(joint_of_error[at])
            frames = (int(poses.frames[start]), int(poses.frames[stop - 1]))
            description = constraint.describe_error(error, poses.height)
            joint = "" if index < 0 else poses.skeleton.names[index]
            if joint:
                place = ",".join(f"{x:.4g}" for x in poses.positions[at, index])
                description += f"; the joint is at {place}"
            worst = int(poses.frames[at])
            found.append(build_violation(constraint, frames, error, description, worst, joint))
    return found


def overlaps(segments: Segments, frames: Span | None) -> BoolArray:
    """Return which segments a range of frames selects, shape (n_segments,); None selects all.

    Neighbouring segments share a frame. The range therefore selects a segment only if they have two
    successive frames in common: the first and last frame of a segment select only this segment. A
    range of a single frame selects all segments that contain the frame.
    """
    if frames is None:
        return np.ones(len(segments), bool)
    first, last = frames
    reach = int(first == last)
    return np.logical_and(segments.start < last + reach, segments.stop > first - reach)


def as_span(name: str, span: object) -> Span:
    """Return `span` as its first and its last frame, both included.

    They may be equal. Raises ValueError if it is no such pair, or if the last is before the first.
    `name` is the name of the argument in the error.
    """
    ends = tuple(span) if isinstance(span, Sequence | np.ndarray) else ()
    if len(ends) != 2 or not all(map(is_integer, ends)) or not 0 <= ends[0] <= ends[1]:
        raise ValueError(
            f"`{name}` must be a first and a last frame, ascending or equal, got {span}"
        )
    return int(ends[0]), int(ends[1])


def no_errors(poses: Poses) -> Errors:
    """Return error 0 and joint -1, which means no joint, for every pose."""
    return np.zeros(len(poses)), np.full(len(poses), -1)
