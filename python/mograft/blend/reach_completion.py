"""Inverse kinematics that completes a `Reach`: it moves hands and feet to nearby targets."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.runs import dilate, find_runs
from mograft.blend.recombine import Part, recombine
from mograft.blend.two_bone_ik import bend_axes, bend_limb, flexion_angles, mean_bend_axis
from mograft.body.anatomy import TwoBoneLimb, find_limb
from mograft.body.capsules import Poses
from mograft.body.mass import mass_model
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.search.constraints import Span
from mograft.search.pose_constraints import Reach

_MIN_DISTANCE = 1e-4  # skeleton heights; a nearer joint is at its target
_STRAIGHT_MARGIN = 0.1  # radians of flexion below which a limb is straightened more slowly
_N_HINGE_PASSES = 6  # of a robot: what hinges cannot follow is corrected again
_MAX_EXTENSION = 1.0 - 1e-4  # distance of the ends, as a share of the limb's length


@dataclass(frozen=True, kw_only=True)
class ReachCompletion:
    """The effect of inverse kinematics for one `Reach`.

    Attributes
    ----------
    reach : Reach
        The constraint.
    frames : tuple of int
        Its first and last frame.
    before, after : float
        Maximum distance of the joint from the target in these frames, in skeleton heights, before
        and after inverse kinematics.
    reason : str
        Why the limb was not moved; empty if it was moved.
    """

    reach: Reach
    frames: Span
    before: float
    after: float
    reason: str = ""

    @property
    def is_moved(self) -> bool:
        """Whether the limb was moved."""
        return not self.reason


@dataclass(frozen=True, kw_only=True)
class ReachLimits:
    """Which limbs `complete_reaches` may move, how far, and in which frames.

    `distance` is the maximum distance from the target, as a fraction of the length of the limb;
    a joint farther away is not moved. `n_blend` is the number of frames before and after a `Reach`
    in which its correction fades. `is_movable`, shape (n_joints,), marks the joints that may be
    rotated. `is_kept`, shape (n_frames,), marks the frames of `KeepOriginal`: a `Reach` with such a
    frame is not completed.
    """

    distance: float
    n_blend: int
    is_movable: BoolArray
    is_kept: BoolArray


@dataclass(frozen=True, eq=False)
class _Task:
    """A limb and the frames in which its end is moved to a target."""

    limb: TwoBoneLimb
    frames: Span
    targets: FloatArray  # in each of the frames, (n, 3)

    def touches(self, other: "_Task", n_blend: int) -> bool:
        """Return whether this task and `other` move the same limb at times whose blends meet.

        If both move the same joint, the frames with targets must not overlap. If they move two
        joints of the limb, the `n_blend` frames before and after must not overlap either.
        """
        if self.limb.start != other.limb.start:
            return False
        margin = 0 if self.limb.end == other.limb.end else 2 * n_blend
        (first, last), (other_first, other_last) = self.frames, other.frames
        return first <= other_last + margin and other_first <= last + margin


def complete_reaches(
    motion: Motion, reaches: Sequence[Reach], limits: ReachLimits, reference: Poses
) -> tuple[Motion, tuple[ReachCompletion, ...]]:
    """Move hands and feet to the targets of `reaches` that are near enough, by two-bone IK.

    For a hand, the elbow is bent until the hand is as far from the shoulder as the target is. The
    shoulder is then rotated until the hand is at the target, without a twist of the arm about the
    line from shoulder to hand. Knee and hip move a foot in the same way. The correction in a frame
    is an angle at the elbow or knee and a rotation vector at the shoulder or hip. Before and after
    the frames of a `Reach` both corrections fall to 0 along cubic curves of continuous slope. All
    other frames are returned bit for bit. `reference` holds poses of the same skeleton. Nearly
    straight limbs bend about the mean of their bend axes in `reference`.
    """
    height = mass_model(motion.skeleton).height
    tasks: list[_Task] = []
    found: list[ReachCompletion] = []
    for reach in reaches:
        task, completion = _plan_task(motion, reach, limits, tasks, height)
        found.append(completion)
        tasks += [task] if task else []
    if not tasks:
        return motion, tuple(found)
    limbs: dict[int, list[_Task]] = {}
    for task in tasks:
        limbs.setdefault(task.limb.start, []).append(task)
    result = motion
    for _ in range(1 if motion.skeleton.hinges is None else _N_HINGE_PASSES):
        parts = [_corrected_limb(result, own, limits.n_blend, reference) for own in limbs.values()]
        result = recombine(result, parts, motion.name, spreads=True)
    return result, measure_completions(found, result)


def measure_completions(
    completions: Sequence[ReachCompletion], motion: Motion
) -> tuple[ReachCompletion, ...]:
    """Return the completions with `after` replaced by the maximum distance in `motion`."""
    height = mass_model(motion.skeleton).height
    return tuple(
        replace(own, after=_greatest_distance(motion, own.reach) / height) for own in completions
    )


def _plan_task(
    motion: Motion, reach: Reach, limits: ReachLimits, tasks: Sequence[_Task], height: float
) -> tuple[_Task | None, ReachCompletion]:
    """Return the task of a `Reach`, or None and the reason why its limb is not moved."""
    end = motion.skeleton.index(reach.joint)
    first, last = _frames_of(reach, motion)
    limb = find_limb(motion.skeleton, end)
    distance = _greatest_distance(motion, reach)
    task, reason = None, ""
    if distance <= _MIN_DISTANCE * height:
        reason = "the donors reach the target"
    elif limb is None:
        reason = "the joint is not part of a hand or foot"
    elif not limits.is_movable[[limb.start, limb.middle]].all():
        reason = "the limb is not exchanged"
    elif limits.is_kept[first : last + 1].any():
        reason = "KeepOriginal keeps these frames"
    else:
        task = _Task(limb, (first, last), reach.targets(motion))
        _, positions = motion[first : first + 1].world_transforms()
        upper, middle, lower = positions[0, [limb.start, limb.middle, limb.end]]
        length = float(np.linalg.norm(upper - middle) + np.linalg.norm(lower - middle))
        limit = limits.distance * length
        if distance > limit:
            reason = f"the limit is {limit / height:.3f} heights"
        elif any(task.touches(other, limits.n_blend) for other in tasks):
            reason = "another Reach moves the limb"
    ratio = distance / height
    completion = ReachCompletion(
        reach=reach, frames=(first, last), before=ratio, after=ratio, reason=reason
    )
    return (None if reason else task), completion


def _frames_of(reach: Reach, motion: Motion) -> Span:
    """Return the first and last frame of a `Reach` in a motion."""
    first, last = reach.frames or (0, motion.n_frames - 1)
    return first, min(last, motion.n_frames - 1)


def _greatest_distance(motion: Motion, reach: Reach) -> float:
    """Return the maximum distance of the joint from the target in the frames of a `Reach`."""
    first, last = _frames_of(reach, motion)
    _, positions = motion[first : last + 1].world_transforms()
    own = positions[:, motion.skeleton.index(reach.joint)]
    return float(np.linalg.norm(own - reach.targets(motion), axis=1).max())


def _corrected_limb(motion: Motion, tasks: Sequence[_Task], n_blend: int, reference: Poses) -> Part:
    """Return the motion of a limb whose end is moved to the targets of `tasks`."""
    limb = tasks[0].limb
    joints = np.array([limb.start, limb.middle])
    quats = motion.rotations[:, joints].copy()
    for end in dict.fromkeys(task.limb.end for task in tasks):
        targets = np.full((motion.n_frames, 3), np.nan)
        for task in tasks:
            if task.limb.end == end:
                targets[task.frames[0] : task.frames[1] + 1] = task.targets
        points = (reference.positions[:, joint] for joint in (*joints, end))
        usual = mean_bend_axis(reference.rotations[:, limb.start], *points)
        is_changed = dilate(~np.isnan(targets[:, 0]), n_blend - 1)
        for first, stop in find_runs(is_changed).tolist():
            own = replace(limb, end=end)
            quats[first:stop] = _correct(
                motion[first:stop], own, targets[first:stop], n_blend, usual
            )
    return Part(joints, quats, motion.positions[:, joints])


def _correct(
    motion: Motion, limb: TwoBoneLimb, targets: FloatArray, n_blend: int, usual: FloatArray
) -> FloatArray:
    """Return the local rotations of a limb's first and middle joint, corrected, (n, 2, 4).

    `targets`, shape (n, 3), is NaN in frames in which the correction fades. `usual` is the mean
    bend axis of the limb, in the local axes of its first joint.
    """
    world_rotations, positions = motion.world_transforms()
    joints = [limb.start, limb.middle]
    above = motion.skeleton.parents[joints]
    parents = np.where((above < 0)[:, None], rotations.IDENTITY, world_rotations[:, above])
    start, middle, end = (positions[:, joint] for joint in (*joints, limb.end))
    axes = bend_axes(world_rotations[:, limb.start], start, middle, end, usual)
    flexions = flexion_angles(start, middle, end, axes)
    # Per frame: `added` of `_add_flexion` at the middle joint, and the rotation vector at the first
    # joint, in the axes of its parent. Targets out of reach are first moved within reach.
    frames = np.flatnonzero(~np.isnan(targets[:, 0]))
    own, axis = (start[frames], middle[frames], end[frames]), axes[frames]
    at_start, at_middle = bend_limb(*own, _within_reach(*own, targets[frames]), axis)
    bends = 2.0 * np.arctan2((at_middle[:, :3] * axis).sum(axis=1), at_middle[:, 3])
    bends = np.remainder(bends + np.pi, 2.0 * np.pi) - np.pi
    added = _subtract_flexion(flexions[frames] - bends, flexions[frames])
    vectors = rotations.log(_in_axes(parents[frames, 0], at_start))
    known = np.concatenate([added[:, None], vectors], axis=1)
    corrections = fade_corrections(frames, known, len(targets), n_blend)
    half = 0.5 * (flexions - _add_flexion(flexions, corrections[:, 0]))[:, None]
    at_middle = np.concatenate([np.sin(half) * axes, np.cos(half)], axis=1)
    changes = [rotations.exp(corrections[:, 1:]), _in_axes(parents[:, 1], at_middle)]
    quats = rotations.multiply(np.stack(changes, axis=1), motion.rotations[:, joints])
    return quats / np.linalg.norm(quats, axis=-1, keepdims=True)


def _within_reach(
    start: FloatArray, middle: FloatArray, end: FloatArray, targets: FloatArray
) -> FloatArray:
    """Return `targets`; those out of reach are moved towards `start`, to the maximum extension.

    The maximum extension is 0.9999 of the limb's length, or the distance from `start` to `end` if
    this is larger. If a limb is nearly straight, a small change of its extension requires a large
    change of the angle at the middle joint.
    """
    length = np.linalg.norm(start - middle, axis=1) + np.linalg.norm(end - middle, axis=1)
    reach = np.maximum(_MAX_EXTENSION * length, np.linalg.norm(end - start, axis=1))
    away = targets - start
    distance = np.linalg.norm(away, axis=1)
    share = np.minimum(1.0, reach / np.where(distance > 0.0, distance, 1.0))
    is_near = (share == 1.0)[:, None]
    return np.where(is_near, targets, start + share[:, None] * away)


def _in_axes(axes: FloatArray, quats: FloatArray) -> FloatArray:
    """Express world rotations in the local axes of joints, given by world rotations `axes`."""
    return rotations.multiply(rotations.multiply(rotations.inverse(axes), quats), axes)


def _add_flexion(flexions: FloatArray, added: FloatArray) -> FloatArray:
    """Return flexion angles plus `added`, in radians; angles near 0 change by less than `added`.

    The result is a smooth function of both arguments. For every value of `added`, a straight limb
    is bent backwards by less than `_STRAIGHT_MARGIN` / 2. The inverse function is
    `_subtract_flexion`.
    """
    return flexions + _smooth_ramp(flexions + added) - _smooth_ramp(flexions)


def _subtract_flexion(results: FloatArray, flexions: FloatArray) -> FloatArray:
    """Return the values `added` for which `_add_flexion(flexions, added)` gives `results`.

    `results` are at least 0.
    """
    ramp = results - flexions + _smooth_ramp(flexions)
    return ramp - _STRAIGHT_MARGIN**2 / (4.0 * ramp) - flexions


def _smooth_ramp(values: FloatArray) -> FloatArray:
    """Return a smooth approximation of max(0, value) for each value; the results are above 0."""
    return 0.5 * (values + np.hypot(values, _STRAIGHT_MARGIN))


def fade_corrections(
    frames: IntArray, corrections: FloatArray, n_frames: int, n_blend: int
) -> FloatArray:
    """Extend corrections in some frames to all `n_frames` frames, with continuous slopes.

    `corrections`, shape (n, d), are those in the ascending frames `frames`. Before and after these
    frames they fall to 0 within `n_blend` frames, as cubic curves of continuous slope. Such a curve
    also fills the frames between them.
    """
    frames = np.concatenate([[frames[0] - n_blend], frames, [frames[-1] + n_blend]])
    values = np.pad(corrections, ((1, 1), (0, 0)))
    # A curve continues the slope of the frames before it and of those after it, if they are known.
    steps = np.diff(frames)
    slopes = np.where((steps == 1)[:, None], np.diff(values, axis=0), 0.0)
    slopes[[0, -1]] = 0.0
    slopes = np.pad(slopes, ((1, 1), (0, 0)))
    filled = np.zeros((n_frames, values.shape[1]))
    filled[frames[1:-1]] = corrections
    for left in np.flatnonzero(steps > 1).tolist():
        ends = values[left], slopes[left], values[left + 1], slopes[left + 2]
        between = np.arange(frames[left] + 1, frames[left + 1])
        is_inside = (between >= 0) & (between < n_frames)
        filled[between[is_inside]] = _cubic(*ends, int(steps[left]))[is_inside]
    return filled


def _cubic(
    start: FloatArray, leaving: FloatArray, end: FloatArray, reaching: FloatArray, n: int
) -> FloatArray:
    """Return the cubic curve between two values that are `n` frames apart, (n - 1, d).

    `start` and `end` are the values, which the result omits. `leaving` and `reaching` are the
    slopes at these values, per frame.
    """
    t = (np.arange(1, n) / n)[:, None]
    weight = t * t * (3.0 - 2.0 * t)
    bends = n * t * (1.0 - t) * ((1.0 - t) * leaving - t * reaching)
    return (1.0 - weight) * start + weight * end + bends
