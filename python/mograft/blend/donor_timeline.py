"""Donor segments stretched to replace base segments: their values at any time, and their seams."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import BoolArray, FloatArray, IntArray, Item
from mograft.blend.rigid_alignment import AlignmentTransform
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.seams import (
    ROTATIONS,
    TRANSLATIONS,
    ClosedFrames,
    PieceTimes,
    SeamBoundaries,
    ValueSpace,
    restrict_to_pieces,
)
from mograft.blend.time_warp import TimeWarp
from mograft.config import Config
from mograft.motion import rotations
from mograft.motion.resample import clip_states, sample_clips
from mograft.motion.segments import Segments

_FRAMES_PER_BLOCK = 8192


@dataclass(frozen=True, eq=False)
class SegmentTimes:
    """n points in time, each given as a base segment and the time since its start."""

    segment: IntArray  # (n,): index of the segment
    frames: FloatArray  # (n,): frames since the segment's start; fractions are allowed


@dataclass(frozen=True, eq=False)
class RootAlignment:
    """The alignment transform of the root for every donor segment.

    The columns are the indices of the root among the joints of rotation and translation tracks.
    """

    transforms: AlignmentTransform
    rotation_column: int
    position_column: int

    def apply(
        self,
        space: ValueSpace,
        values: FloatArray,
        segment: IntArray,
        velocities: FloatArray | None = None,
    ) -> None:
        """Apply the alignment transforms to the root's values and velocities, in place.

        `values`, shape (n, n_joints, 4 or 3), are rotations or translations, `segment`, shape (n,),
        the segments they belong to. An identity transform changes no bit of them.
        """
        transforms = self.transforms[segment]
        moves = (transforms.yaws != rotations.IDENTITY).any(axis=1)
        moves |= (transforms.translations != 0.0).any(axis=1)
        transforms = transforms[moves]
        if space is ROTATIONS:  # angular velocities are in local axes: no change
            column = self.rotation_column
            values[moves, column] = rotations.multiply(transforms.yaws, values[moves, column])
            return
        column = self.position_column
        rotated = rotations.rotate(transforms.yaws, values[moves, column])
        values[moves, column] = rotated + transforms.translations
        if velocities is not None:
            velocities[moves, column] = rotations.rotate(transforms.yaws, velocities[moves, column])


@dataclass(frozen=True, eq=False)
class DonorTimeline:
    """The donor of every base segment, stretched to the length of that base segment."""

    cut: Segments  # the base segments, in order of time
    donors: Segments  # the donor of each base segment
    rate: float  # frames per second
    warp: TimeWarp | None = None  # None: donors are stretched at a constant rate
    alignment: RootAlignment | None = None  # None: values are used as captured

    def frame_times(self) -> SegmentTimes:
        """Return the times of all frames; a frame shared by two base segments occurs twice."""
        counts = self.cut.lengths + 1
        segment = np.repeat(np.arange(len(counts)), counts)
        frames = np.arange(len(segment)) - (np.cumsum(counts) - counts)[segment]
        return SegmentTimes(segment, frames.astype(np.float64))

    def merge_frames(self, values: npt.NDArray[Item]) -> npt.NDArray[Item]:
        """Return one value per frame, given `values` at the times of `frame_times`.

        A frame that two segments share has two values; that of the later segment is returned.
        """
        return values.take(self.kept_rows, axis=0)

    @cached_property
    def kept_rows(self) -> IntArray:
        """Indices in `frame_times` of all frames once: of two equal frames, the later entry."""
        last = np.cumsum(self.cut.lengths + 1) - 1
        is_shared = self.cut.stop[:-1] == self.cut.start[1:]
        return np.delete(np.arange(last[-1] + 1), last[:-1][is_shared])

    def sample(
        self, space: ValueSpace, tracks: Sequence[FloatArray], times: SegmentTimes
    ) -> FloatArray:
        """Return the donors' values at n points in time, shape (n, n_joints, 4 or 3).

        `tracks` are the values of each clip, shape (n_frames, n_joints, 4 or 3). At a frame of the
        donor the result equals the value of that frame, bit for bit. Between frames the values are
        interpolated by cubics, which also depend on the clip's frames just outside the donor.
        """
        donors, segment = self.donors, times.segment
        # In this order divisions without remainder are exact.
        elapsed = times.frames * donors.lengths[segment] / self.cut.lengths[segment]
        if self.warp is not None:
            share = self.warp.donor_share(segment, times.frames / self.cut.lengths[segment])
            is_warped = self.warp.is_warped[segment]
            elapsed = np.where(is_warped, share * donors.lengths[segment], elapsed)
        values = sample_clips(tracks, donors.clip[segment], donors.start[segment] + elapsed)
        if self.alignment is not None:
            self.alignment.apply(space, values, segment)
        return values

    def boundaries(
        self, space: ValueSpace, tracks: Sequence[FloatArray], seams: IntArray
    ) -> SeamBoundaries:
        """Return the donors' values and velocities on both sides of seams.

        `seams` are the indices of the segments that end with a seam.
        """
        ending, starting = self.donors[seams], self.donors[seams + 1]
        speed = np.tile((self.rate * self.donors.lengths / self.cut.lengths)[:, None], (1, 2))
        if self.warp is not None:
            speed *= np.where(self.warp.is_warped[:, None], self.warp.slopes[:, [0, -1]], 1.0)
        speed = speed[..., None, None]
        before, velocity_before, ending_acceleration = clip_states(tracks, ending.clip, ending.stop)
        after, velocity_after, starting_acceleration = clip_states(
            tracks, starting.clip, starting.start
        )
        if self.alignment is not None:
            self.alignment.apply(space, before, seams, velocity_before)
            self.alignment.apply(space, after, seams + 1, velocity_after)
        velocity_before *= speed[seams, 1]
        velocity_after *= speed[seams + 1, 0]
        squared = (self.donors.lengths / self.cut.lengths)[:, None, None] ** 2
        ending_acceleration *= squared[seams]
        starting_acceleration *= squared[seams + 1]
        if self.warp is not None:
            last_three = self.cut.lengths[seams] - 2
            self._replace_warped(ending_acceleration, space, tracks, seams, last_three)
            first_three = np.zeros_like(last_three)
            self._replace_warped(starting_acceleration, space, tracks, seams + 1, first_three)
        accelerations = ending_acceleration + starting_acceleration
        return SeamBoundaries(
            space, before, after, velocity_before, velocity_after, 0.5 * accelerations
        )

    def _replace_warped(
        self,
        accelerations: FloatArray,
        space: ValueSpace,
        tracks: Sequence[FloatArray],
        segments: IntArray,
        first: IntArray,
    ) -> None:
        """Replace the accelerations of warped donors, per frame², in place.

        Each becomes the second difference of three frames of the segment, from frame `first` on.
        A warp ends with its donor: there are no warped frames beyond the seam.
        """
        assert self.warp is not None
        rows = np.flatnonzero(self.warp.is_warped[segments])
        captured = replace(self, alignment=None)
        a, b, c = (
            captured.sample(
                space, tracks, SegmentTimes(segments[rows], (first[rows] + k).astype(np.float64))
            )
            for k in range(3)
        )
        accelerations[rows] = space.delta(b, c) - space.delta(a, b)

    def piece_times(self, seams: IntArray, times: SegmentTimes, blend: float) -> PieceTimes:
        """Convert times since the start of a segment to times since the start of a piece.

        A piece is the motion between two successive seams. `seams` are the indices of the segments
        that end with a seam; `blend` is `Config.seam_blend` in seconds.
        """
        first = np.concatenate([[0], seams + 1])
        last = np.append(seams, len(self.cut) - 1)
        piece = np.searchsorted(seams, times.segment)
        frames = self.cut.start[times.segment] - self.cut.start[first[piece]] + times.frames
        durations = (self.cut.stop[last] - self.cut.start[first]) / self.rate
        return PieceTimes(piece, frames / self.rate, durations, blend)

    def find_seams(self, tracks: Sequence[FloatArray], joints: IntArray | None = None) -> BoolArray:
        """Return whether there is a seam after each segment but the last, shape (n_segments - 1,).

        Two donors continue each other without a seam if neither is stretched or warped, and the
        last frame of the first donor and its two neighbours in the clip equal, bit for bit, the
        first frame of the second donor and its neighbours. The donors may be in two copies of a
        clip.
        `joints` are the columns of `tracks` that are compared, by default all.
        """
        donors = self.donors
        if joints is None:
            joints = np.arange(tracks[0].shape[1])
        is_stretched = donors.lengths != self.cut.lengths
        if self.warp is not None:
            is_stretched |= self.warp.is_warped
        seams: BoolArray = is_stretched[1:] | is_stretched[:-1]
        follows = donors.clip[1:] == donors.clip[:-1]
        follows &= donors.start[1:] == donors.stop[:-1]
        others = np.flatnonzero(~seams & ~follows)
        ends = _three_frames(tracks, joints, donors.clip[others], donors.stop[others])
        starts = _three_frames(tracks, joints, donors.clip[others + 1], donors.start[others + 1])
        seams[others] = (ends != starts).any(axis=tuple(range(1, ends.ndim)))
        return seams


@dataclass(frozen=True, eq=False)
class DonorLayout:
    """A joint group's motion in the donors' clips, the donor of each segment, and the seams."""

    timeline: DonorTimeline
    rotations: Sequence[FloatArray]  # of each clip, (n_frames, n_joints, 4)
    positions: Sequence[FloatArray]  # of the joints that translate, (n_frames, n_moving, 3)
    seams: BoolArray  # (n_segments - 1,): whether a segment ends with a seam
    config: Config  # gives `seam`, `seam_window` and `seam_blend`

    def close(self) -> tuple[FloatArray, FloatArray]:
        """Return the rotations and translations in all frames, with the gaps at seams closed."""
        quats, positions = (
            self._close_frames(space, rows)
            for space, rows in zip((ROTATIONS, TRANSLATIONS), self._rows, strict=True)
        )
        return quats, positions

    def _close_frames(self, space: ValueSpace, rows: FloatArray) -> FloatArray:
        """Return the values in all frames with the gaps at seams closed.

        `rows` are the values at the times of `frame_times`.
        """
        times, kept = self.timeline.frame_times(), self.timeline.kept_rows
        pieces = self._piece_times(SegmentTimes(times.segment[kept], times.frames[kept]))
        closed = np.empty((len(kept), *rows.shape[1:]))
        # In blocks, so that no second array has all frames.
        for start in range(0, len(kept), _FRAMES_PER_BLOCK):
            block = slice(start, start + _FRAMES_PER_BLOCK)
            closed[block] = self._close(space, pieces[block], rows[kept[block]])
        return closed

    @cached_property
    def _rows(self) -> tuple[FloatArray, FloatArray]:
        """Rotations and translations at the times of `frame_times`, before gaps are closed."""
        times = self.timeline.frame_times()
        return (
            self.timeline.sample(ROTATIONS, self.rotations, times),
            self.timeline.sample(TRANSLATIONS, self.positions, times),
        )

    def _piece_times(self, times: SegmentTimes) -> PieceTimes:
        return self.timeline.piece_times(self._closed_seams, times, self.config.seam_blend)

    def _close(self, space: ValueSpace, times: PieceTimes, values: FloatArray) -> FloatArray:
        near = restrict_to_pieces(times, self._boundaries[space is TRANSLATIONS])
        return SEAM_TREATMENTS[self.config.seam].close(values, *near)

    @cached_property
    def _closed_seams(self) -> IntArray:
        """Indices of the segments whose end the treatment closes as a seam."""
        if SEAM_TREATMENTS[self.config.seam].spans_segments:
            return np.arange(len(self.seams))
        return np.flatnonzero(self.seams)

    @cached_property
    def _boundaries(self) -> tuple[SeamBoundaries, SeamBoundaries]:
        """The boundaries of rotations and of translations."""
        return (
            self.timeline.boundaries(ROTATIONS, self.rotations, self._closed_seams),
            self.timeline.boundaries(TRANSLATIONS, self.positions, self._closed_seams),
        )

    def smooth(self, quats: FloatArray, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Apply `SeamTreatment.smooth` to the rotations and translations of all frames."""
        rotations = self._smooth(ROTATIONS, quats)
        return rotations, self._smooth(TRANSLATIONS, positions)

    def _smooth(self, space: ValueSpace, values: FloatArray) -> FloatArray:
        timeline, config = self.timeline, self.config
        seams = np.flatnonzero(self.seams)
        closed = ClosedFrames(
            space=space,
            values=values,
            cut=timeline.cut,
            seams=seams,
            window=round(config.seam_window * timeline.rate),
            blend=config.seam_blend * timeline.rate,
            rate=timeline.rate,
            donor_rows=self._rows[space is TRANSLATIONS],
            seam_accelerations=self._boundaries[space is TRANSLATIONS].accelerations,
        )
        return SEAM_TREATMENTS[config.seam].smooth(closed)


def _three_frames(
    tracks: Sequence[FloatArray], joints: IntArray, clips: IntArray, frames: IntArray
) -> FloatArray:
    """Return the values in each given frame and its two neighbours; NaN outside the clip."""
    near = np.empty((len(frames), 3, len(joints), tracks[0].shape[2]))
    for clip in np.unique(clips):
        rows = np.flatnonzero(clips == clip)
        wanted, last = frames[rows][:, None] + [-1, 0, 1], len(tracks[clip]) - 1
        values = tracks[clip][wanted.clip(0, last)[..., None], joints]
        values[(wanted < 0) | (wanted > last)] = np.nan
        near[rows] = values
    return near
