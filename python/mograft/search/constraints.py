"""What a new motion must do, or should: collision, targets, and where donors come from.

A constraint is a small frozen value. Its errors are counted in its own tolerance, so that 1
is the most that is met. Without a weight it is hard: a motion that does not meet it is told
as a violation. With one it is soft, and costs ``weight · error²``. Lengths of bodies and
tolerances are in skeleton heights, places and sizes of things in the file's unit, frames are
of the base motion, both ends included.
"""

import fnmatch
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray, as_floats
from mograft._util.validate import (
    as_integer,
    check_finite,
    check_not_negative,
    check_positive,
    coerce_vector,
)
from mograft.analysis.segmentation import Segments
from mograft.body.anatomy import anatomy
from mograft.body.capsules import Capsules, clearance
from mograft.body.mass import mass_model
from mograft.body.world_poses import Poses
from mograft.errors import join_names
from mograft.motion import rotations
from mograft.motion.skeleton import Skeleton
from mograft.search.obstacles import Obstacle, Vector

__all__ = [
    "Avoid",
    "AvoidSelf",
    "Constraint",
    "Custom",
    "Face",
    "KeepOriginal",
    "KeepOut",
    "MaxAngle",
    "MaxStretch",
    "NotFrom",
    "OnlyFrom",
    "Reach",
    "Violation",
    "violations",
]

Span = tuple[int, int]

Errors = tuple[FloatArray, IntArray]
"""For each pose the error, in tolerances, and the joint that has it; -1 where none has."""


class Clip(Protocol):
    """What constraints know of a clip that donors come from."""

    @property
    def name(self) -> str:
        """Its name."""
        ...

    @property
    def tags(self) -> Sequence[str]:
        """Words to choose it by."""
        ...


@dataclass(frozen=True, kw_only=True)
class Constraint:
    """What all constraints have.

    Parameters
    ----------
    weight : float, optional
        Cost of an error of one tolerance; it grows with the square. Default: hard.
    frames : tuple of int, optional
        First and last frame of the base motion in which it holds. Default: all.
    """

    weight: float | None = None
    frames: Span | None = None

    def __post_init__(self) -> None:
        if self.weight is not None:
            check_not_negative(self, "weight")
        if self.frames is not None:
            object.__setattr__(self, "frames", _span("frames", self.frames))

    @property
    def is_hard(self) -> bool:
        """Whether it must be met."""
        return self.weight is None

    def applies(self, frames: IntArray) -> BoolArray:
        """Tell in which frames it holds."""
        if self.frames is None:
            return np.ones(len(frames), bool)
        return (frames >= self.frames[0]) & (frames <= self.frames[1])

    def errors(self, poses: Poses, joints: BoolArray | None = None) -> Errors:  # noqa: ARG002
        """Return the error of each pose, in tolerances.

        Parameters
        ----------
        poses : Poses
            The poses.
        joints : ndarray of bool, shape (J,), optional
            The joints whose errors count. Default: all.

        Returns
        -------
        error : ndarray, shape (n,)
            At most 1 where it is met; 0 where it does not hold.
        joint : ndarray of int, shape (n,)
            The joint that is to blame, or -1.
        """
        return np.zeros(len(poses)), np.full(len(poses), -1)

    def misses(self, own: Segments, donors: Segments, clips: Sequence[Clip]) -> FloatArray:
        """Return by how much donors miss it, whatever their poses.

        Parameters
        ----------
        own, donors : Segments
            Base segments and donors for them, one for each, in their own clips.
        clips : sequence
            Name and tags of the clips that `donors.clip` counts, as `Library.entries` has them;
            the base's segments are donors too.

        Returns
        -------
        ndarray, shape (n,)
            0 where it is met; more than 1 where it is not.
        """
        del clips
        return np.zeros(len(own) if len(own) == len(donors) else 0)

    def tell(self, error: float, height: float) -> str:
        """Say in words what an error is."""
        del height
        return f"{error:.3g} tolerances"


@dataclass(frozen=True)
class Avoid(Constraint):
    """Keep all of the body out of something.

    Parameters
    ----------
    obstacle : Obstacle
        A `Sphere`, `Capsule`, `Box`, `HalfSpace` or `Character`.
    tolerance : float
        How deep it may be touched, in skeleton heights.
    margin : float
        How far it must be kept away from besides, in skeleton heights.

    Examples
    --------
    >>> from mograft.search.obstacles import HalfSpace
    >>> floor = HalfSpace((0, 0, 0), (0, 1, 0))
    >>> Avoid(floor, tolerance=0.02).is_hard
    True
    >>> Avoid(floor, weight=2.0, frames=(0, 60)).is_hard  # a wish, for two seconds at 30 fps
    False
    """

    obstacle: Obstacle
    tolerance: float = 0.005
    margin: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_obstacle("obstacle", self.obstacle)
        check_finite(self, "margin")
        check_positive(self, "tolerance")

    def errors(self, poses: Poses, joints: BoolArray | None = None) -> Errors:
        """As `Constraint.errors`."""
        return _where(self, poses, lambda some: self._errors(some, joints))

    def _errors(self, poses: Poses, joints: BoolArray | None) -> Errors:
        counted = _counted(poses.capsules, joints)
        distance, which = self.obstacle.distances(poses, counted)
        depth = self.margin * poses.height - distance
        error = np.maximum(depth, 0.0) / (self.tolerance * poses.height)
        return error, np.where(which >= 0, poses.capsules.joints[which], -1)

    def tell(self, error: float, height: float) -> str:
        """As `Constraint.tell`."""
        depth = error * self.tolerance
        return (
            f"touched {depth:.3f} heights ({depth * height:.3g}) deep, "
            f"{self.tolerance:.3f} are allowed"
        )


@dataclass(frozen=True)
class AvoidSelf(Constraint):
    """Keep hands and forearms out of the trunk, the head, the thighs and each other.

    Parameters
    ----------
    tolerance : float
        How much deeper they may touch than `captured`, in skeleton heights.
    captured : float
        How deep they touch in the captured motion, in skeleton heights: flesh gives way,
        and hands do lie on hips. `mograft.graft` sets it where it is 0.

    Examples
    --------
    >>> AvoidSelf().tell(4.0, height=180.0)
    'touches itself 0.020 heights deeper than captured, 0.005 are allowed'
    """

    tolerance: float = 0.005
    captured: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "tolerance")

    def errors(self, poses: Poses, joints: BoolArray | None = None) -> Errors:
        """As `Constraint.errors`."""
        return _where(self, poses, lambda some: self._errors(some, joints))

    def _errors(self, poses: Poses, joints: BoolArray | None) -> Errors:
        flesh = poses.capsules
        pairs = flesh.self_collision_pairs
        if joints is not None:
            pairs = pairs[joints[flesh.joints[pairs[:, 0]]]]
        distance, which = clearance(
            poses.ends, flesh.radii, poses.ends, flesh.radii, np.arange(len(poses)), pairs
        )
        depth = -distance - self.captured * poses.height
        error = np.maximum(depth, 0.0) / (self.tolerance * poses.height)
        return error, np.where(which[:, 0] >= 0, flesh.joints[which[:, 0]], -1)

    def depth(self, poses: Poses) -> float:
        """Return how deep the body touches itself at most, in skeleton heights."""
        error, _ = AvoidSelf(tolerance=1.0).errors(poses)
        return float(error.max(initial=0.0))

    def tell(self, error: float, height: float) -> str:
        """As `Constraint.tell`."""
        del height
        depth = error * self.tolerance
        return (
            f"touches itself {depth:.3f} heights deeper than captured, "
            f"{self.tolerance:.3f} are allowed"
        )


@dataclass(frozen=True)
class Reach(Constraint):
    """Have a joint in a place at a frame.

    Parameters
    ----------
    joint : str
        Name of the joint.
    target : tuple of float
        The place in the world, in the file's unit.
    frame : int
        The frame of the base motion.
    tolerance : float
        How far away it may be, in skeleton heights.

    Examples
    --------
    >>> Reach("LeftHand", (30, 140, 20), frame=120).tell(2.0, height=180.0)
    'LeftHand is 0.060 heights (10.8) away, 0.030 are allowed'
    """

    joint: str
    target: Vector
    frame: int
    tolerance: float = 0.03

    def __post_init__(self) -> None:
        super().__post_init__()
        coerce_vector(self, "target")
        check_positive(self, "tolerance")
        object.__setattr__(self, "frame", as_integer("frame", self.frame))
        object.__setattr__(self, "frames", (self.frame, self.frame))

    def errors(self, poses: Poses, joints: BoolArray | None = None) -> Errors:
        """As `Constraint.errors`."""
        return _where(self, poses, lambda some: self._errors(some, joints))

    def _errors(self, poses: Poses, joints: BoolArray | None) -> Errors:
        at = poses.skeleton.index(self.joint)
        if joints is not None and not joints[at]:
            return np.zeros(len(poses)), np.full(len(poses), -1)
        apart = np.linalg.norm(poses.positions[:, at] - np.array(self.target), axis=1)
        return apart / (self.tolerance * poses.height), np.full(len(poses), at)

    def tell(self, error: float, height: float) -> str:
        """As `Constraint.tell`."""
        apart = error * self.tolerance
        return (
            f"{self.joint} is {apart:.3f} heights ({apart * height:.3g}) away, "
            f"{self.tolerance:.3f} are allowed"
        )


@dataclass(frozen=True)
class Face(Constraint):
    """Have a joint look at a place.

    Parameters
    ----------
    target : tuple of float
        The place in the world, in the file's unit.
    joint : str, optional
        The joint that looks. Default: the head.
    tolerance : float
        By what angle it may look past it, in radians. Default: 20°.

    Examples
    --------
    >>> Face((0, 150, 300), frames=(30, 60)).tell(1.5, height=180.0)
    'looks 30.0° past it, 20.0° are allowed'
    """

    target: Vector
    joint: str | None = None
    tolerance: float = float(np.radians(20.0))

    def __post_init__(self) -> None:
        super().__post_init__()
        coerce_vector(self, "target")
        check_positive(self, "tolerance")

    def errors(self, poses: Poses, joints: BoolArray | None = None) -> Errors:
        """As `Constraint.errors`."""
        return _where(self, poses, lambda some: self._errors(some, joints))

    def _errors(self, poses: Poses, joints: BoolArray | None) -> Errors:
        at = mass_model(poses.skeleton).head
        if self.joint is not None:
            at = poses.skeleton.index(self.joint)
        if at is None:
            raise ValueError("joint must be given: the skeleton has no head")
        if joints is not None and not joints[at]:
            return np.zeros(len(poses)), np.full(len(poses), -1)
        ahead = np.broadcast_to(_forward(poses.skeleton, poses.up), (len(poses), 3))
        looks = rotations.rotate(poses.rotations[:, at], ahead)
        way = np.array(self.target) - poses.positions[:, at]
        across = np.linalg.norm(np.cross(looks, way), axis=1)
        angle = np.arctan2(across, (looks * way).sum(axis=1))
        return angle / self.tolerance, np.full(len(poses), at)

    def tell(self, error: float, height: float) -> str:
        """As `Constraint.tell`."""
        del height
        angle, limit = np.degrees([error * self.tolerance, self.tolerance])
        return f"looks {angle:.1f}° past it, {limit:.1f}° are allowed"


@dataclass(frozen=True)
class KeepOut(Constraint):
    """Keep one joint out of a region, or in it.

    Parameters
    ----------
    joint : str
        Name of the joint; it counts as a point.
    region : Obstacle
        A `Sphere`, `Capsule`, `Box` or `HalfSpace`.
    inside : bool
        Whether the joint must be in the region instead.
    tolerance : float
        How far it may be beyond the region's surface, in skeleton heights.

    Examples
    --------
    >>> from mograft.search.obstacles import Sphere
    >>> KeepOut("LeftHand", Sphere((0, 100, 0), 30)).tell(4.0, height=180.0)
    'LeftHand is 0.020 heights inside, 0.005 are allowed'
    """

    joint: str
    region: Obstacle
    inside: bool = False
    tolerance: float = 0.005

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_obstacle("region", self.region)
        check_positive(self, "tolerance")

    def errors(self, poses: Poses, joints: BoolArray | None = None) -> Errors:
        """As `Constraint.errors`."""
        return _where(self, poses, lambda some: self._errors(some, joints))

    def _errors(self, poses: Poses, joints: BoolArray | None) -> Errors:
        at = poses.skeleton.index(self.joint)
        if joints is not None and not joints[at]:
            return np.zeros(len(poses)), np.full(len(poses), -1)
        dot = Capsules(np.array([at]), ("",), ("",), np.zeros((1, 3)), np.zeros(1))
        point = Poses(
            poses.skeleton,
            poses.frames,
            poses.rotations,
            poses.positions,
            poses.frame_time,
            dot,
            poses.height,
            poses.up,
        )
        distance, _ = self.region.distances(point, np.array([0]))
        beyond = distance if self.inside else -distance
        error = np.maximum(beyond, 0.0) / (self.tolerance * poses.height)
        return error, np.full(len(poses), at)

    def tell(self, error: float, height: float) -> str:
        """As `Constraint.tell`."""
        del height
        where = "outside" if self.inside else "inside"
        return (
            f"{self.joint} is {error * self.tolerance:.3f} heights {where}, "
            f"{self.tolerance:.3f} are allowed"
        )


@dataclass(frozen=True)
class Custom(Constraint):
    """A constraint of one's own.

    Parameters
    ----------
    function : callable
        Takes `Poses` of n frames and returns n errors in tolerances: at most 1 where the pose
        is as it should be, and growing with what is wrong.
    name : str
        What to call it.
    joint : str, optional
        The joint that is to blame; its group is searched. Default: all are.

    Examples
    --------
    >>> low = Custom(lambda poses: poses.positions[:, 0, 1] / 60.0, "hips below 60")
    >>> low.is_hard
    True
    """

    function: Callable[[Poses], FloatArray]
    name: str = "custom"
    joint: str | None = None

    def errors(self, poses: Poses, joints: BoolArray | None = None) -> Errors:
        """As `Constraint.errors`."""
        at = -1 if self.joint is None else poses.skeleton.index(self.joint)
        if joints is not None and at >= 0 and not joints[at]:
            return np.zeros(len(poses)), np.full(len(poses), -1)

        def own(some: Poses) -> Errors:
            error = as_floats(f"what {self.name} returns", self.function(some), (len(some),))
            return error, np.full(len(some), at)

        return _where(self, poses, own)

    def tell(self, error: float, height: float) -> str:
        """As `Constraint.tell`."""
        del height
        return f"{self.name}: {error:.3g} tolerances"


@dataclass(frozen=True)
class KeepOriginal(Constraint):
    """Keep the captured parts: of every segment that has one of the `frames`.

    Examples
    --------
    >>> KeepOriginal(frames=(0, 60)).frames
    (0, 60)
    """

    def misses(self, own: Segments, donors: Segments, clips: Sequence[Clip]) -> FloatArray:
        """As `Constraint.misses`."""
        del clips
        return np.where(_is_own(own, donors), 0.0, 2.0)

    def tell(self, error: float, height: float) -> str:
        """As `Constraint.tell`."""
        del error, height
        return "the captured part is kept here"


@dataclass(frozen=True)
class OnlyFrom(Constraint):
    """Take donors only from some clips; the captured parts may stay.

    Parameters
    ----------
    clips : str or sequence of str
        Names of clips, or patterns such as ``"waltz*"``.
    tags : str or collection of str
        Tags of clips; those that have one of them count as well as those named.
    clip_frames : tuple of int, optional
        First and last frame of those clips that donors lie in. Default: all.

    Examples
    --------
    >>> OnlyFrom("waltz*", tags=["slow"]).tell(2.0, height=180.0)
    'not from waltz*, clips tagged slow'
    """

    clips: str | Sequence[str] = ()
    clip_frames: Span | None = None
    tags: str | Collection[str] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_origin(self)

    def misses(self, own: Segments, donors: Segments, clips: Sequence[Clip]) -> FloatArray:
        """As `Constraint.misses`."""
        within = _lies_in(donors, clips, self, whole=True)
        return np.where(within | _is_own(own, donors), 0.0, 2.0)

    def tell(self, error: float, height: float) -> str:
        """As `Constraint.tell`."""
        del error, height
        return f"not from {_listed(self)}"


@dataclass(frozen=True)
class NotFrom(Constraint):
    """Take no donors from some clips; the captured parts may stay.

    Parameters
    ----------
    clips : str or sequence of str
        Names of clips, or patterns such as ``"walk*"``.
    tags : str or collection of str
        Tags of clips; those that have one of them count as well as those named.
    clip_frames : tuple of int, optional
        First and last frame of those clips that no donor may have any of. Default: all.

    Examples
    --------
    >>> NotFrom(["walk1", "walk2"]).tell(2.0, height=180.0)
    'from walk1, walk2'
    """

    clips: str | Sequence[str] = ()
    clip_frames: Span | None = None
    tags: str | Collection[str] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_origin(self)

    def misses(self, own: Segments, donors: Segments, clips: Sequence[Clip]) -> FloatArray:
        """As `Constraint.misses`."""
        within = _lies_in(donors, clips, self, whole=False)
        return np.where(within & ~_is_own(own, donors), 2.0, 0.0)

    def tell(self, error: float, height: float) -> str:
        """As `Constraint.tell`."""
        del error, height
        return f"from {_listed(self)}"


@dataclass(frozen=True)
class MaxStretch(Constraint):
    """Let no donor be stretched or shrunk by more than a part of its length.

    Parameters
    ----------
    limit : float
        The greatest part of the base segment's length that a donor's may differ by.

    Examples
    --------
    >>> MaxStretch(0.1).tell(2.5, height=180.0)
    'stretched by 0.25, 0.10 is allowed'
    """

    limit: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_not_negative(self, "limit")

    def misses(self, own: Segments, donors: Segments, clips: Sequence[Clip]) -> FloatArray:
        """As `Constraint.misses`."""
        del clips
        stretch = np.abs(own.lengths - donors.lengths) / own.lengths
        over = stretch > self.limit * (1 + 1e-9)
        return np.where(over, stretch / max(self.limit, 1e-3), 0.0)

    def tell(self, error: float, height: float) -> str:
        """As `Constraint.tell`."""
        del height
        return f"stretched by {error * max(self.limit, 1e-3):.2f}, {self.limit:.2f} is allowed"


@dataclass(frozen=True)
class MaxAngle(Constraint):
    """Let no seam be wider than an angle; narrower than `Config.max_angle`, and hard.

    Parameters
    ----------
    limit : float
        Greatest mean joint angle between the poses that meet, in radians.

    Examples
    --------
    >>> import math
    >>> MaxAngle(math.radians(20)).violation("upper", 37, math.radians(25)).message
    'MaxAngle is not met at frame 37: the seam of upper is 25.0°, 20.0° are allowed'
    """

    limit: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "limit")
        if self.weight is not None or self.frames is not None:
            raise ValueError("MaxAngle takes neither weight nor frames: it holds at every seam")

    def violation(self, group: str, frame: int, angle: float) -> "Violation":
        """Return that a group's seam at a frame is too wide."""
        told = (
            f"MaxAngle is not met at frame {frame}: the seam of {group} is "
            f"{np.degrees(angle):.1f}°, {np.degrees(self.limit):.1f}° are allowed"
        )
        return Violation(self, (frame, frame), frame, angle / self.limit, "", told)


@dataclass(frozen=True)
class Violation:
    """Frames in which a hard constraint is not met.

    Attributes
    ----------
    constraint : Constraint
        Which one.
    frames : tuple of int
        The first and the last of them.
    worst : int
        The frame of the greatest error.
    error : float
        That error, in tolerances.
    joint : str
        The joint that has it; empty where none has.
    message : str
        All this in words, with how much is allowed.
    """

    constraint: Constraint
    frames: Span
    worst: int
    error: float
    joint: str
    message: str


def violations(
    constraints: Sequence[Constraint], poses: Poses, joints: BoolArray | None = None
) -> list[Violation]:
    """Return where poses in successive frames do not meet hard constraints.

    Parameters
    ----------
    constraints : sequence of Constraint
        The constraints; soft ones are passed over.
    poses : Poses
        Of successive frames.
    joints : ndarray of bool, shape (J,), optional
        The joints whose errors count. Default: all.

    Returns
    -------
    list of Violation
        One for each run of frames, by constraint and frame.
    """
    found = []
    for constraint in constraints:
        if not constraint.is_hard:
            continue
        error, blamed = constraint.errors(poses, joints)
        edges = np.flatnonzero(np.diff(error > 1.0, prepend=False, append=False))
        for start, stop in edges.reshape(-1, 2).tolist():
            worst = start + int(error[start:stop].argmax())
            joint = "" if blamed[worst] < 0 else poses.skeleton.names[blamed[worst]]
            frames = (int(poses.frames[start]), int(poses.frames[stop - 1]))
            at = int(poses.frames[worst])
            told = constraint.tell(float(error[worst]), poses.height)
            name = type(constraint).__name__
            where = (
                f"at frame {at}"
                if frames[0] == frames[1]
                else (f"in frames {frames[0]} to {frames[1]}, worst at {at}")
            )
            by = f" by {joint}" if joint and joint not in told else ""
            message = f"{name} is not met {where}{by}: {told}"
            found.append(Violation(constraint, frames, at, float(error[worst]), joint, message))
    return found


def _where(constraint: Constraint, poses: Poses, errors: Callable[[Poses], Errors]) -> Errors:
    """Ask for errors only in the frames where a constraint holds."""
    if constraint.frames is None:
        return errors(poses)
    holds = constraint.applies(poses.frames)
    if holds.all():
        return errors(poses)
    error, joint = np.zeros(len(poses)), np.full(len(poses), -1)
    if holds.any():
        some = poses.with_poses(poses.frames[holds], poses.rotations[holds], poses.positions[holds])
        error[holds], joint[holds] = errors(some)
    return error, joint


def _counted(flesh: Capsules, joints: BoolArray | None) -> IntArray:
    return np.arange(len(flesh)) if joints is None else np.flatnonzero(joints[flesh.joints])


def _forward(skeleton: Skeleton, up: int) -> FloatArray:
    """Return where the body faces at rest."""
    known, rest = anatomy(skeleton), skeleton.rest_positions()
    left, right = (known.joints("thigh", "upper_arm", side=side) for side in ("left", "right"))
    if not left or not right:
        raise ValueError("where the body faces is known only of left and right limbs; it has none")
    lateral = rest[left].mean(axis=0) - rest[right].mean(axis=0)
    head = mass_model(skeleton).head
    top = rest[known.hips] if head is None else rest[head]
    feet = [foot.ankle for foot in mass_model(skeleton).feet]
    upward = np.zeros(3)
    upward[up] = 1.0 if not feet or top[up] >= rest[feet].mean(axis=0)[up] else -1.0
    ahead = np.cross(lateral, upward)
    forward: FloatArray = ahead / np.linalg.norm(ahead)
    return forward


def _is_own(own: Segments, donors: Segments) -> BoolArray:
    same: BoolArray = (
        (own.clip == donors.clip) & (own.start == donors.start) & (own.stop == donors.stop)
    )
    return same


def _check_obstacle(name: str, value: object) -> None:
    if not callable(getattr(value, "distances", None)):
        raise TypeError(f"{name} must be a Sphere, Capsule, Box or the like, got {value!r}")


def _span(name: str, span: object) -> Span:
    ends = tuple(span) if isinstance(span, Sequence | np.ndarray) else ()
    try:
        first, last = (as_integer(name, end) for end in ends)
    except ValueError:
        first, last = 0, -1
    if first > last:
        raise ValueError(f"{name} must be first and last, ascending, got {span}")
    return first, last


def _check_origin(origin: "OnlyFrom | NotFrom") -> None:
    for name, words in (("clips", origin.clips), ("tags", origin.tags)):
        if not isinstance(words, Collection) or not all(isinstance(word, str) for word in words):
            raise TypeError(f"{name} must be names, got {words!r}")
    if not origin.clips and not origin.tags:
        raise ValueError("clips or tags must say which clips are meant, got neither")
    if origin.clip_frames is not None:
        object.__setattr__(origin, "clip_frames", _span("clip_frames", origin.clip_frames))


def _several(words: str | Collection[str]) -> list[str]:
    return [words] if isinstance(words, str) else sorted(words)


def _lies_in(
    donors: Segments, clips: Sequence[Clip], origin: "OnlyFrom | NotFrom", *, whole: bool
) -> BoolArray:
    names = [clip.name for clip in clips]
    meant = np.zeros(len(clips), bool)
    for pattern in _several(origin.clips):
        matches = [fnmatch.fnmatchcase(name, pattern) for name in names]
        if not any(matches):
            raise ValueError(f"clips must name clips of {join_names(names)}; got {pattern!r}")
        meant |= matches
    for tag in _several(origin.tags):
        tagged = [tag in clip.tags for clip in clips]
        if not any(tagged):
            known = sorted({own for clip in clips for own in clip.tags})
            there = f"must be of {join_names(known)}" if known else "are known of no clip"
            raise ValueError(f"tags {there}; got {tag!r}")
        meant |= tagged
    inside: BoolArray = meant[donors.clip]
    if origin.clip_frames is not None:
        first, last = origin.clip_frames
        if whole:
            inside = inside & (donors.start >= first) & (donors.stop <= last)
        else:
            inside = inside & (donors.start <= last) & (donors.stop >= first)
    return inside


def _listed(origin: "OnlyFrom | NotFrom") -> str:
    meant = [*_several(origin.clips), *(f"clips tagged {tag}" for tag in _several(origin.tags))]
    frames = origin.clip_frames
    span = "" if frames is None else f", frames {frames[0]} to {frames[1]}"
    return ", ".join(meant) + span
