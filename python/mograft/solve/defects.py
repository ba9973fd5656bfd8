"""How far assembled motions exceed the recordings: acceleration, jerk, and depth below the floor.

A defect is a measure above its limit. `mograft.solve.self_repair` replaces the donors there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.containers import remember
from mograft._util.runs import dilate
from mograft.body.anatomy import anatomy, feature_joints
from mograft.body.contacts import Ground
from mograft.body.derivatives import greatest_derivatives, world_jerk
from mograft.body.mass import mass_model
from mograft.body.size import figure_size, resize
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.motion.skeleton import Skeleton
from mograft.solve.assembly import Excerpt
from mograft.solve.search_problem import SearchProblem

MEASURES = ("seam acceleration", "seam jerk", "world jerk", "floor depth")
"""The measures, in the order of the columns of amounts."""

MAX_SEAM_RATIO = 2.0
"""Greatest angular acceleration and jerk of a joint near a seam, relative to the recordings.

The recordings are the base at the same frames and both donors at theirs.
"""

MAX_JERK_RATIO = 2.0
"""Greatest world jerk of a joint, as a multiple of the percentile of its jerk in the recordings.

The recordings are the base and the clips of the donors in the segment and in those next to it,
without the frames of these donors, so that the error of a donor does not excuse itself.
"""

MAX_ADDED_DEPTH = 0.01
"""Greatest depth of a heel, toe or hand below the floor, in heights more than its percentile."""

_PERCENTILE = 99.9  # of world jerk and of floor depth in a recording
_SEAM_SECONDS = 4.0 / 30.0  # on either side of a seam
_SHORT_SECONDS = 10.0
"""Duration below which the percentile of a base is not reliable, and that of the library counts."""

_COMPARED_CLIPS = 64  # of the library, whose jerk is compared
_STEP_SECONDS = 1.0 / 30.0
"""Time between the frames of differences.

Between the frames of recordings at higher rates, jerk is too small to be visible.
"""

_LEAST = 1e-6  # smallest reference: rad/step², rad/step³, heights/step³


@dataclass(frozen=True, eq=False)
class DefectMeasure:
    """Compares a grafted group with the base and the donors by the `MEASURES`.

    An amount is a measure of the new motion, divided by its limit; an amount above 1 is a defect.
    The limit of the floor depth is the depth in the recordings plus `MAX_ADDED_DEPTH`. The limits
    of the others are the values in the recordings times `MAX_SEAM_RATIO` or `MAX_JERK_RATIO`.
    Derivatives are differences between frames that are about 1/30 s apart.
    """

    problem: SearchProblem
    group: str

    def amounts(self, motion: Motion, excerpts: Sequence[Excerpt]) -> list[FloatArray]:
        """Return the amounts at each position of each excerpt, shape (n_positions, 4).

        `motion` is the result of `assemble_excerpts`; the columns are `MEASURES`. The amounts at a
        seam count for the positions on both sides. The others are 0 unless the position or one next
        to it has a substitution.
        """
        derivatives = greatest_derivatives(motion, self._joints, self._step)
        depths, found, n_frames = self._floor_points.depths(motion), [], 0
        for excerpt in excerpts:
            positions = slice(excerpt.first, excerpt.stop)
            cut, donors = self.problem.base_segments[positions], excerpt.donors_of(self.group)
            first, last = int(cut.start[0]), int(cut.stop[-1])
            # Frame f of the base is frame f + shift of `motion`.
            shift, n_frames = n_frames - first, n_frames + last - first + 1
            frames = slice(first + shift, last + 1 + shift)
            is_changed = donors != self.problem.scenario[positions]
            is_near = dilate(is_changed)
            peaks = self._peaks_nearby([own[frames] for own in derivatives])
            seams = self._seam_amounts(cut, donors, is_changed, peaks)
            jerks = self._jerk_amounts(motion, cut, donors, is_near, shift)
            ratios = depths[frames] / self._depth_limits(first, last + 1)
            deepest = np.maximum.reduceat(ratios.max(axis=1, initial=0.0), cut.start - first)
            found.append(np.column_stack([*seams, jerks, np.where(is_near, deepest, 0.0)]))
        return found

    def _seam_amounts(
        self, cut: Segments, donors: IntArray, is_changed: BoolArray, peaks: FloatArray
    ) -> FloatArray:
        """Return acceleration and jerk at seams, divided by their limits, (2, n_positions).

        `peaks` are the `_peaks_nearby` of the new motion from the first frame of `cut`. A seam is
        where a donor before or after it is not the base segment.
        """
        before = np.flatnonzero(is_changed[:-1] | is_changed[1:])
        frames = cut.stop[before]
        peak = peaks[:, frames - cut.start[0]]
        reference = self._clip_peaks(self.problem.base)[:, frames]
        # Most seams are within the limit by the base alone.
        above = (peak > MAX_SEAM_RATIO * reference).any(axis=0)
        known = self._donor_peaks(donors[before[above]], donors[before[above] + 1])
        reference[:, above] = np.maximum(reference[:, above], known)
        ratios = peak / np.maximum(reference, _LEAST) / MAX_SEAM_RATIO
        amounts = np.zeros((2, len(cut)))
        amounts[:, before] = ratios
        amounts[:, before + 1] = np.maximum(amounts[:, before + 1], ratios)
        return amounts

    def _peaks_nearby(self, derivatives: Sequence[FloatArray]) -> FloatArray:
        """Return the greatest acceleration and jerk within `_SEAM_SECONDS` of each frame, (2, n).

        Only differences between the n frames of `derivatives` count.
        """
        own = np.zeros((2, len(derivatives[0])))
        # A second difference reaches one step to both sides, a third one step further.
        for row, values, reach in zip(own, derivatives, (1, 2), strict=True):
            inner = slice(self._step, max(len(row) - reach * self._step, 0))
            row[inner] = values[inner]
        peaks = own.copy()
        for distance in range(1, self._half_width + 1):
            np.maximum(peaks[:, distance:], own[:, :-distance], out=peaks[:, distance:])
            np.maximum(peaks[:, :-distance], own[:, distance:], out=peaks[:, :-distance])
        return peaks

    def _clip_peaks(self, clip: Motion) -> FloatArray:
        """Return the `_peaks_nearby` of a recording."""
        joints, step = self._joints, self._step
        key = ("peaks", joints.tobytes(), step, self._half_width)
        return remember(
            clip, key, lambda: self._peaks_nearby(greatest_derivatives(clip, joints, step))
        )

    def _donor_peaks(self, left: IntArray, right: IntArray) -> FloatArray:
        """Return the greatest acceleration and jerk near seams in the clips of both donors, (2, n).

        `left` are the donors before the seams, `right` those after them.
        """
        library, segments = self.problem.library, self.problem.library.segments
        clips = segments.clip[np.concatenate([left, right])]
        frames = np.concatenate([segments.stop[left], segments.start[right]])
        peaks = np.zeros((2, len(frames)))
        for clip in np.unique(clips).tolist():
            is_own = clips == clip
            peaks[:, is_own] = self._clip_peaks(library.clips[clip])[:, frames[is_own]]
        return np.maximum(*np.split(peaks, 2, axis=1))

    def _jerk_amounts(
        self, motion: Motion, cut: Segments, donors: IntArray, is_near: BoolArray, shift: int
    ) -> FloatArray:
        """Return the greatest ratio of world jerk to its limit at each position."""
        begin, stop, step = int(cut.start[0]), int(cut.stop[-1]) + 1, self._step
        low = max(begin + shift - step, 0)
        read = slice(low, stop + shift + 2 * step)
        jerk = world_jerk(motion, self._driven_joints, step, read)
        jerk = jerk[begin + shift - low : stop + shift - low]
        # A third difference reaches from one step before to two behind.
        jerk[:step] = 0.0
        jerk[max(len(jerk) - 2 * step, step) :] = 0.0
        captured = self._clip_jerk(self.problem.base)[begin:stop]
        limits, starts = np.maximum(self._least_jerk_limits, captured), cut.start - begin
        amounts = _greatest_ratios(jerk, limits, starts) * is_near
        # Most positions are within the limits by the base alone.
        above = np.flatnonzero(amounts > 1.0).tolist()
        for position in above:
            frames = slice(int(cut.start[position]) - begin, int(cut.stop[position]) - begin)
            joints = np.flatnonzero((jerk[frames] > limits[frames]).any(axis=0))
            near = donors[max(position - 1, 0) : position + 2]
            known = self._donor_jerk_limits(near, joints)
            limits[frames, joints] = np.maximum(limits[frames, joints], known)
        return _greatest_ratios(jerk, limits, starts) * is_near if above else amounts

    def _donor_jerk_limits(self, donors: IntArray, joints: IntArray) -> FloatArray:
        """Return the limits of world jerk that follow from the clips of some donors.

        `joints` are indices into the joints whose jerk is measured; the result has one limit for
        each.
        """
        library, step = self.problem.library, self._step
        limits = np.zeros(len(joints))
        for donor in np.unique(donors).tolist():
            segment = library.segments[donor : donor + 1]
            jerk = self._clip_jerk(self.problem.sized_clip(int(segment.clip[0])))[:, joints]
            # A third difference reaches from one step before to two behind.
            first, last = int(segment.start[0]) - 2 * step, int(segment.stop[0]) + step
            others = np.delete(jerk, slice(max(first, 0), last + 1), axis=0)
            if len(others):
                percentiles = np.percentile(others, _PERCENTILE, axis=0)
                limits = np.maximum(limits, MAX_JERK_RATIO * percentiles)
        return limits

    def _clip_jerk(self, clip: Motion) -> FloatArray:
        """Return the world jerk of the measured joints in a recording, (n_frames, n_joints)."""
        joints, step = self._driven_joints, self._step
        key = ("jerk", joints.tobytes(), step)
        return remember(clip, key, lambda: world_jerk(clip, joints, step))

    @cached_property
    def _step(self) -> int:
        """The distance in frames of the values whose differences are the derivatives."""
        return max(round(_STEP_SECONDS * self.problem.base.rate), 1)

    @cached_property
    def _half_width(self) -> int:
        """`_SEAM_SECONDS` in frames."""
        return max(round(_SEAM_SECONDS * self.problem.base.rate), 1)

    @cached_property
    def _joints(self) -> IntArray:
        """The joints whose rotations are measured."""
        return feature_joints(
            self.problem.base.skeleton, self.problem.group_specs[self.group].joints
        )

    @cached_property
    def _driven_joints(self) -> IntArray:
        """The joints whose world jerk is measured."""
        driven = np.flatnonzero(self.problem.driven_joints[self.group])
        return feature_joints(self.problem.base.skeleton, driven)

    @cached_property
    def _floor_points(self) -> "FloorPoints":
        """The points whose depth is measured."""
        return FloorPoints.of_group(self.problem, self.group)

    @cached_property
    def _least_jerk_limits(self) -> FloatArray:
        """The limit of world jerk of each joint in all frames, shape (n_joints,)."""
        base = self.problem.base
        jerk = self._clip_jerk(base)
        key = ("jerk percentiles", self._driven_joints.tobytes(), self._step)
        percentiles = remember(base, key, lambda: np.percentile(jerk, _PERCENTILE, axis=0))
        if base.duration < _SHORT_SECONDS:
            own = (*key, figure_size(base.skeleton))
            known = remember(self.problem.library, own, self._library_jerk)
            percentiles = np.maximum(percentiles, known)
        return np.maximum(MAX_JERK_RATIO * percentiles, _LEAST * mass_model(base.skeleton).height)

    def _library_jerk(self) -> FloatArray:
        """Return the world jerk of each joint that a tenth of the library's clips reach."""
        library, joints, step = self.problem.library, self._driven_joints, self._step
        last = len(library.clips) - 1
        chosen = np.unique(np.linspace(0, last, _COMPARED_CLIPS).round().astype(int)).tolist()
        frames = int(_SHORT_SECONDS * self.problem.base.rate)
        skeleton = self.problem.base.skeleton
        clips = (resize(library.clips[index][:frames], skeleton) for index in chosen)
        peaks = [np.percentile(world_jerk(own, joints, step), _PERCENTILE, axis=0) for own in clips]
        found: FloatArray = np.percentile(peaks, 90.0, axis=0)
        return found

    def _depth_limits(self, start: int, stop: int) -> FloatArray:
        """Return the limits of depth that follow from the base, shape (n_frames, n_points).

        The limit in a frame is the depth in the base, or the limit of the point if that is greater.
        """
        base, points = self.problem.base, self._floor_points
        key = ("depth", points.joints.tobytes(), points.offsets.tobytes())

        def compute() -> tuple[FloatArray, FloatArray]:
            depths = points.depths(base)
            return depths, np.percentile(depths, _PERCENTILE, axis=0)

        depths, percentiles = remember(base, key, compute)
        added = MAX_ADDED_DEPTH * mass_model(base.skeleton).height
        limits: FloatArray = np.maximum(percentiles, 0.0) + added
        return np.maximum(limits, depths[start:stop])


def _greatest_ratios(values: FloatArray, limits: FloatArray, starts: IntArray) -> FloatArray:
    """Return the greatest ratio of values to their limits from each of `starts` to the next."""
    return np.maximum.reduceat((values / limits).max(axis=1, initial=0.0), starts)


@dataclass(frozen=True, eq=False)
class FloorPoints:
    """Heels, toes, wrists and ends of hands, each with the height of the floor below it."""

    joints: IntArray  # the joint to which each point is fixed, shape (n_points,)
    offsets: FloatArray  # from that joint, in its local axes, (n_points, 3)
    floors: FloatArray  # along `up`, (n_points,)
    up: FloatArray  # unit vector

    @classmethod
    def of_group(cls, problem: SearchProblem, group: str) -> "FloorPoints":
        """Return the points that the group moves; empty if the skeleton has no known leg.

        Feet that `plant_feet` raises above the floor afterwards are not among them. The floors are
        those of `Ground`; below a hand, the lowest of them.
        """
        base = problem.base
        skeleton, ground = base.skeleton, remember(base, "ground", lambda: Ground.of(base))
        points: list[tuple[int, tuple[float, ...], float]] = []  # joint, offset, floor
        legs = zip(ground.limbs, problem.movable_legs, ground.floors.tolist(), strict=True)
        for leg, is_movable, (heel, tip) in legs:
            if problem.config.feet == "never" or not is_movable:
                toe = leg.ankle if leg.toe is None else leg.toe
                points += [(leg.ankle, (0.0, 0.0, 0.0), heel), (toe, leg.tip, tip)]
        for hand in _hands(skeleton, ground) if ground.limbs else []:
            for offset in ((0.0, 0.0, 0.0), tuple(mass_model(skeleton).bone[hand].tolist())):
                points.append((hand, offset, float(ground.floors.min())))
        members = set(problem.library.joints(group).tolist())
        points = [
            own for own in points if not members.isdisjoint([own[0], *skeleton.ancestors(own[0])])
        ]
        return cls(
            np.array([joint for joint, _, _ in points], np.int64),
            np.array([offset for _, offset, _ in points]).reshape(-1, 3),
            np.array([floor for _, _, floor in points]),
            ground.up,
        )

    def depths(self, motion: Motion) -> FloatArray:
        """Return the depth of each point below the floor, shape (n_frames, n_points).

        It is in the unit of the file, and negative above the floor.
        """
        if not len(self.joints):
            return np.zeros((motion.n_frames, 0))
        depths = np.empty((motion.n_frames, len(self.joints)))
        for frames, quats, positions in motion.world_blocks():
            arms = rotations.rotate(quats[:, self.joints], self.offsets)
            depths[frames] = self.floors - (positions[:, self.joints] + arms) @ self.up
        return depths


def _hands(skeleton: Skeleton, ground: Ground) -> list[int]:
    """Return the first joint of each hand that is not the foot of a foreleg."""
    known, feet = anatomy(skeleton), {leg.ankle for leg in ground.limbs}
    return [
        joint
        for joint in known.joints("hand")
        if joint not in known.details
        and joint not in feet
        and known.parts[skeleton.parents[joint]] != "hand"
    ]
