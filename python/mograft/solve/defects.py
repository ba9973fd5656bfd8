"""How far assembled motions exceed the recordings: acceleration, jerk, and depth below the floor.

A defect is a measure above its limit. `mograft.solve.self_repair` replaces the donors there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.high_percentile import HighPercentile
from mograft._util.memo import remember
from mograft._util.runs import dilate
from mograft.body.anatomy import feature_joints
from mograft.body.derivatives import greatest_derivatives, world_jerk
from mograft.body.mass import mass_model
from mograft.motion.motion import Motion
from mograft.solve.assembly import Excerpt
from mograft.solve.floor_points import FloorPoints
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

_POSITIONS_PER_BLOCK = 1024  # whose limits of jerk are in memory together
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
        seam count for the positions on both sides.
        """
        segments = self.problem.base_segments
        begins = [int(segments.start[own.first]) for own in excerpts]
        lengths = [
            int(segments.stop[own.stop - 1]) + 1 - begin
            for own, begin in zip(excerpts, begins, strict=True)
        ]
        shifts = np.cumsum([0, *lengths[:-1]]) - begins
        seams = self._seam_amounts(motion, excerpts, shifts.tolist())
        jerks = self._jerk_amounts(motion, excerpts, shifts.tolist())
        depths = self._depth_amounts(motion, excerpts, shifts.tolist())
        return [
            np.column_stack([*own[0], *own[1:]]) for own in zip(seams, jerks, depths, strict=True)
        ]

    def _seam_amounts(
        self, motion: Motion, excerpts: Sequence[Excerpt], shifts: Sequence[int]
    ) -> list[FloatArray]:
        """Return the measures at seams, divided by their limits, (2, n_positions) for each excerpt.

        The rows are acceleration and jerk. Each seam counts for the positions on both sides.
        `shifts` has one entry for each excerpt: frame f of the base is frame f + shift of `motion`.
        """
        cut, base = self.problem.base_segments, self.problem.base
        peaks = greatest_derivatives(motion, self._joints, self._step)
        amounts = []
        for excerpt, shift in zip(excerpts, shifts, strict=True):
            positions = self._seams(excerpt)
            frames = cut.stop[positions]
            first, last = int(cut.start[excerpt.first]), int(cut.stop[excerpt.stop - 1])
            peak = self._peaks_about(frames + shift, peaks, first + shift, last + shift)
            reference = self._clip_peaks(base, frames)
            # Most seams are within the limit by the base alone.
            above = (peak > MAX_SEAM_RATIO * reference).any(axis=0)
            known = self._donor_peaks(excerpt.donors[self.group], positions[above])
            reference[:, above] = np.maximum(reference[:, above], known)
            ratios = peak / np.maximum(reference, _LEAST) / MAX_SEAM_RATIO
            own, before = np.zeros((2, excerpt.stop - excerpt.first)), positions - excerpt.first
            own[:, before] = ratios
            own[:, before + 1] = np.maximum(own[:, before + 1], ratios)
            amounts.append(own)
        return amounts

    def _seams(self, excerpt: Excerpt) -> IntArray:
        """Return the positions before seams: at p or p + 1 the donor is not the base segment."""
        is_changed = self._is_changed(excerpt)
        return excerpt.first + np.flatnonzero(is_changed[:-1] | is_changed[1:])

    def _is_changed(self, excerpt: Excerpt) -> BoolArray:
        captured = self.problem.scenario[excerpt.first : excerpt.stop]
        return excerpt.donors_of(self.group) != captured

    def _peaks_about(
        self, frames: IntArray, derivatives: tuple[FloatArray, FloatArray], first: int, last: int
    ) -> FloatArray:
        """Return the greatest acceleration and jerk within `_SEAM_SECONDS` of each frame, (2, n).

        Only frames from `first` to `last` count.
        """
        around = frames[:, None] + np.arange(-self._half_width, self._half_width + 1)
        found = []
        # A second difference reaches one step to both sides, a third one step further.
        for values, reach in zip(derivatives, (1, 2), strict=True):
            is_inside = (around >= first + self._step) & (around <= last - reach * self._step)
            own = values[around.clip(0, len(values) - 1)] * is_inside
            found.append(own.max(axis=1, initial=0.0))
        return np.stack(found)

    def _clip_peaks(self, clip: Motion, frames: IntArray) -> FloatArray:
        """Return the greatest acceleration and jerk of a recording near each frame, (2, n).

        Near means within `_SEAM_SECONDS`.
        """
        joints, step = self._joints, self._step
        derivatives = remember(
            clip,
            ("derivatives", joints.tobytes(), step),
            lambda: greatest_derivatives(clip, joints, step),
        )
        return self._peaks_about(frames, derivatives, 0, clip.n_frames - 1)

    def _donor_peaks(self, donors: IntArray, positions: IntArray) -> FloatArray:
        """Return the greatest acceleration and jerk near seams in the clips of both donors, (2, n).

        `positions` are those before the seams.
        """
        library, segments = self.problem.library, self.problem.library.segments
        left, right = donors[positions], donors[positions + 1]
        clips = segments.clip[np.concatenate([left, right])]
        frames = np.concatenate([segments.stop[left], segments.start[right]])
        peaks = np.zeros((2, len(frames)))
        for clip in np.unique(clips).tolist():
            is_own = clips == clip
            peaks[:, is_own] = self._clip_peaks(library.clips[clip], frames[is_own])
        return np.maximum(*np.split(peaks, 2, axis=1))

    def _jerk_amounts(
        self, motion: Motion, excerpts: Sequence[Excerpt], shifts: Sequence[int]
    ) -> list[FloatArray]:
        """Return, for each excerpt, the greatest ratio of world jerk to its limit in each segment.

        The ratio is 0 in segments that are neither exchanged nor next to an exchanged segment.
        """
        cut, step = self.problem.base_segments, self._step
        found = []
        for excerpt, shift in zip(excerpts, shifts, strict=True):
            begin, stop = int(cut.start[excerpt.first]), int(cut.stop[excerpt.stop - 1]) + 1
            bounds = np.append(cut.start[excerpt.first : excerpt.stop], stop)
            is_near = dilate(self._is_changed(excerpt))
            amounts = np.zeros(len(is_near))
            # In blocks, because the jerk and the limits of all frames take much memory.
            for first in range(0, len(is_near), _POSITIONS_PER_BLOCK):
                block = slice(first, first + _POSITIONS_PER_BLOCK)
                own = bounds[first : first + _POSITIONS_PER_BLOCK + 1]
                jerk = self._jerk_between(motion, int(own[0]) + shift, int(own[-1]) + shift)
                # A third difference reaches from one step before to two behind.
                jerk[: max(begin + step - int(own[0]), 0)] = 0.0
                jerk[max(max(stop - 2 * step, begin + step) - int(own[0]), 0) :] = 0.0
                amounts[block] = self._jerk_ratios(jerk, own, is_near[block], excerpt)
            found.append(amounts)
        return found

    def _jerk_between(self, motion: Motion, start: int, stop: int) -> FloatArray:
        """Return the world jerk of the measured joints in some frames of a motion."""
        first = max(start - self._step, 0)
        near = motion[first : stop + 2 * self._step]
        return world_jerk(near, self._driven_joints, self._step)[start - first : stop - first]

    def _jerk_ratios(
        self, jerk: FloatArray, bounds: IntArray, is_near: BoolArray, excerpt: Excerpt
    ) -> FloatArray:
        """Return the greatest ratio of world jerk to its limit at successive positions.

        `bounds` has the first frames of the positions in the base, and the frame after the last
        position; `jerk` is the world jerk in these frames. The result is 0 unless `is_near`.
        """
        cut, begin = self.problem.base_segments, int(bounds[0])
        limits = self._jerk_limits(slice(begin, int(bounds[-1])))

        def greatest() -> FloatArray:
            ratios = (jerk / limits).max(axis=1, initial=0.0)
            return np.where(is_near, np.maximum.reduceat(ratios, bounds[:-1] - begin), 0.0)

        # Most positions are within the limits by the base alone.
        for start in bounds[:-1][greatest() > 1.0].tolist():
            position = int(np.searchsorted(cut.start, start))
            frames = slice(start - begin, int(cut.stop[position]) - begin)
            joints = np.flatnonzero((jerk[frames] > limits[frames]).any(axis=0))
            known = self._donor_jerk_limits(excerpt, position, joints)
            limits[frames, joints] = np.maximum(limits[frames, joints], known)
        return greatest()

    def _donor_jerk_limits(self, excerpt: Excerpt, position: int, joints: IntArray) -> FloatArray:
        """Return the limits of world jerk that follow from the donors at and next to a position.

        They are those of the donors' clips. `joints` are indices into the joints whose jerk is
        measured; the result has one limit for each.
        """
        library, step = self.problem.library, self._step
        about = slice(max(position - 1, excerpt.first), min(position + 2, excerpt.stop))
        limits = np.zeros(len(joints))
        for donor in np.unique(excerpt.donors[self.group][about]).tolist():
            segment = library.segments[donor : donor + 1]
            percentile = self._jerk_percentile(library.clips[int(segment.clip[0])])
            # A third difference reaches from one step before to two behind.
            first, last = int(segment.start[0]) - 2 * step, int(segment.stop[0]) + step
            percentiles = percentile.without(first, last + 1, joints)
            if percentiles is not None:
                limits = np.maximum(limits, MAX_JERK_RATIO * percentiles)
        return limits

    def _clip_jerk(self, clip: Motion) -> FloatArray:
        """Return the world jerk of the measured joints in a recording, (n_frames, n_joints)."""
        joints, step = self._driven_joints, self._step
        key = ("jerk", joints.tobytes(), step)
        return remember(clip, key, lambda: world_jerk(clip, joints, step))

    def _jerk_percentile(self, clip: Motion) -> HighPercentile:
        """Return the `_PERCENTILE` of world jerk in a recording."""
        key = ("high jerk", self._driven_joints.tobytes(), self._step)
        return remember(clip, key, lambda: HighPercentile(self._clip_jerk(clip), _PERCENTILE))

    def _depth_amounts(
        self, motion: Motion, excerpts: Sequence[Excerpt], shifts: Sequence[int]
    ) -> list[FloatArray]:
        """Return the amounts of floor depth by excerpt; 0 unless at or next to a substitution."""
        if not len(self._floor_points.joints):
            return [np.zeros(own.stop - own.first) for own in excerpts]
        cut, depths = self.problem.base_segments, self._floor_points.depths(motion)
        found = []
        for excerpt, shift in zip(excerpts, shifts, strict=True):
            begin, end = int(cut.start[excerpt.first]), int(cut.stop[excerpt.stop - 1]) + 1
            ratios = depths[begin + shift : end + shift] / self._depth_limits(slice(begin, end))
            amounts = ratios.max(axis=1).clip(min=0.0)
            found.append(self._greatest_at_positions(amounts, excerpt))
        return found

    def _greatest_at_positions(self, amounts: FloatArray, excerpt: Excerpt) -> FloatArray:
        """Return for each position the greatest of `amounts`, one per frame of the excerpt.

        The result is 0 unless the position or one next to it has a substitution.
        """
        starts = self.problem.base_segments.start[excerpt.first : excerpt.stop]
        greatest = np.maximum.reduceat(amounts, starts - starts[0])
        return np.where(dilate(self._is_changed(excerpt)), greatest, 0.0)

    @cached_property
    def _step(self) -> int:
        """The distance in frames of the values whose differences are the derivatives."""
        return max(round(_STEP_SECONDS * self.problem.base.rate), 1)

    @cached_property
    def _half_width(self) -> int:
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

    def _jerk_limits(self, frames: slice) -> FloatArray:
        """Return the limits of world jerk that follow from the base, shape (n_frames, n_joints).

        The limit in a frame is the world jerk of the base, or the limit of the joint if that is
        greater.
        """
        base = self.problem.base
        jerk = self._clip_jerk(base)
        key = ("jerk percentiles", self._driven_joints.tobytes(), self._step)
        percentiles = remember(base, key, lambda: np.percentile(jerk, _PERCENTILE, axis=0))
        if base.duration < _SHORT_SECONDS:
            key = ("library jerk", self._driven_joints.tobytes(), self._step)
            percentiles = np.maximum(percentiles, remember(base, key, self._library_jerk))
        least = _LEAST * mass_model(base.skeleton).height
        limits: FloatArray = np.maximum(MAX_JERK_RATIO * percentiles, least)
        return np.maximum(limits, jerk[frames])

    def _library_jerk(self) -> FloatArray:
        """Return the world jerk of each joint that a tenth of the library's clips reach."""
        clips = self.problem.library.clips
        chosen = np.unique(np.linspace(0, len(clips) - 1, _COMPARED_CLIPS).round().astype(int))
        frames = int(_SHORT_SECONDS * self.problem.base.rate)
        peaks = [
            np.percentile(
                world_jerk(clips[index][:frames], self._driven_joints, self._step),
                _PERCENTILE,
                axis=0,
            )
            for index in chosen.tolist()
        ]
        found: FloatArray = np.percentile(peaks, 90.0, axis=0)
        return found

    @cached_property
    def _floor_points(self) -> FloorPoints:
        """The points whose depth is measured."""
        return FloorPoints.of_group(self.problem, self.group)

    def _depth_limits(self, frames: slice) -> FloatArray:
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
        return np.maximum(limits, depths[frames])
