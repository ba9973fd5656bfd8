"""Donor segments stretched to replace base segments: their values at any time, and their seams."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.blend.rigid_alignment import AlignmentTransform
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.seams import ROTATIONS, ClosedFrames, PieceTimes, SeamBoundaries, ValueSpace
from mograft.config import FRAME, Config
from mograft.motion import rotations
from mograft.motion.resample import clip_states, sample_clips
from mograft.motion.segments import Segments


@dataclass(frozen=True, eq=False)
class DonorTimeline:
    """The donor of every base segment, stretched to the length of that base segment."""

    cut: Segments  # the base segments, in order of time
    donors: Segments  # the donor of each base segment
    rate: float  # frames per second
    config: Config  # gives `seam`, `seam_window` and `seam_blend`
    # Whether a segment ends with a seam, (n_segments - 1,); see `find_seams`.
    seams: BoolArray = field(default_factory=lambda: np.zeros(0, bool))
    alignment: AlignmentTransform | None = None  # of each donor of a root; None: as captured

    def frame_times(self) -> tuple[IntArray, FloatArray]:
        """Return the base segment of each frame, and the number of frames since its start.

        A frame that is shared by two base segments occurs twice.
        """
        counts = self.cut.lengths + 1
        segment = np.repeat(np.arange(len(counts)), counts)
        frames = np.arange(len(segment)) - (np.cumsum(counts) - counts)[segment]
        return segment, frames.astype(np.float64)

    @cached_property
    def kept_rows(self) -> IntArray:
        """Indices in `frame_times` of all frames once: of two equal frames, the later entry."""
        last = np.cumsum(self.cut.lengths + 1) - 1
        is_shared = self.cut.stop[:-1] == self.cut.start[1:]
        return np.delete(np.arange(last[-1] + 1), last[:-1][is_shared])

    def sample(
        self, space: ValueSpace, tracks: Sequence[FloatArray], segment: IntArray, frames: FloatArray
    ) -> FloatArray:
        """Return the donors' values at n points in time, shape (n, n_joints, 4 or 3).

        The points are given as by `frame_times`; fractions of frames are allowed. `tracks` are the
        values of each clip, shape (n_frames, n_joints, 4 or 3). At a frame of the donor the result
        equals the value of that frame, bit for bit. Between frames the values are interpolated by
        cubics, which also depend on the clip's frames just outside the donor.
        """
        donors = self.donors
        # In this order divisions without remainder are exact.
        elapsed = frames * donors.lengths[segment] / self.cut.lengths[segment]
        values = sample_clips(tracks, donors.clip[segment], donors.start[segment] + elapsed)
        if self.alignment is not None:
            _align(self.alignment[segment], space, values)
        return values

    @property
    def _closed_seams(self) -> IntArray:
        """Indices of the segments whose end the treatment closes as a seam."""
        spans_segments = SEAM_TREATMENTS[self.config.seam].spans_segments
        return np.arange(len(self.seams)) if spans_segments else np.flatnonzero(self.seams)

    def boundaries(self, space: ValueSpace, tracks: Sequence[FloatArray]) -> SeamBoundaries:
        """Return the donors' values and velocities on both sides of the seams that are closed."""
        sides, seams = [], self._closed_seams
        for segments, frames in ((seams, self.donors.stop), (seams + 1, self.donors.start)):
            donors = self.donors[segments]
            values, velocities, accelerations = clip_states(tracks, donors.clip, frames[segments])
            self._smooth_accelerations(accelerations, tracks, donors.clip, frames[segments])
            if self.alignment is not None:
                _align(self.alignment[segments], space, values, velocities)
            lengths = self.cut.lengths[segments]
            velocities *= (self.rate * donors.lengths / lengths)[:, None, None]
            accelerations *= (donors.lengths / lengths)[:, None, None] ** 2
            sides.append((values, velocities, accelerations))
        (before, velocity_before, ending), (after, velocity_after, starting) = sides
        both = np.stack([ending, starting])
        return SeamBoundaries(space, before, after, velocity_before, velocity_after, both)

    def _smooth_accelerations(
        self,
        accelerations: FloatArray,
        tracks: Sequence[FloatArray],
        clips: IntArray,
        frames: IntArray,
    ) -> None:
        """Convert second differences at frames of clips to those over about 1/30 s, in place.

        At a high frame rate, those of successive frames would mostly be noise.
        """
        step, last = max(1, round(FRAME * self.rate)), np.array([len(own) - 1 for own in tracks])
        accelerations /= step
        for distance in range(1, step):
            for at in frames - distance, frames + distance:
                own = clip_states(tracks, clips, at.clip(0, last[clips]))[2]
                accelerations += own * ((step - distance) / step**2)

    def piece_times(self, segment: IntArray, frames: FloatArray) -> PieceTimes:
        """Convert times since the start of a segment to times since the start of a piece.

        A piece is the motion between two successive seams that are closed.
        """
        seams = self._closed_seams
        first = np.concatenate([[0], seams + 1])
        last = np.append(seams, len(self.cut) - 1)
        piece = np.searchsorted(seams, segment)
        frames = self.cut.start[segment] - self.cut.start[first[piece]] + frames
        durations = (self.cut.stop[last] - self.cut.start[first]) / self.rate
        return PieceTimes(piece, frames / self.rate, durations, self.config.seam_blend)

    def close(self, space: ValueSpace, tracks: Sequence[FloatArray]) -> FloatArray:
        """Return the values of all frames with closed gaps, after `SeamTreatment.smooth`."""
        config, treatment, kept = self.config, SEAM_TREATMENTS[self.config.seam], self.kept_rows
        if not tracks[0].shape[1]:
            return np.empty((len(kept), *tracks[0].shape[1:]))
        segment, frames = self.frame_times()
        rows = self.sample(space, tracks, segment, frames)
        times = self.piece_times(segment[kept], frames[kept])
        boundaries = self.boundaries(space, tracks)
        closed = ClosedFrames(
            space=space,
            values=treatment.close(rows[kept], times, boundaries),
            cut=self.cut,
            seams=np.flatnonzero(self.seams),
            window=round(min(config.seam_window * self.rate, self.cut.stop[-1])),
            blend=config.seam_blend * self.rate,
            rate=self.rate,
            donor_rows=rows,
            seam_accelerations=boundaries.accelerations,
        )
        return treatment.smooth(closed)

    def find_seams(self, tracks: Sequence[FloatArray], joints: IntArray | None = None) -> BoolArray:
        """Return whether there is a seam after each segment but the last, shape (n_segments - 1,).

        Two donors continue each other without a seam if neither is stretched, and the last frame of
        the first donor and its two neighbours in the clip equal, bit for bit, the first frame of
        the second donor and its neighbours. The donors may be in two copies of a clip.
        `joints` are the columns of `tracks` that are compared, by default all.
        """
        donors = self.donors
        if joints is None:
            joints = np.arange(tracks[0].shape[1])
        is_stretched = donors.lengths != self.cut.lengths
        seams: BoolArray = is_stretched[1:] | is_stretched[:-1]
        follows = donors.clip[1:] == donors.clip[:-1]
        follows &= donors.start[1:] == donors.stop[:-1]
        others = np.flatnonzero(~seams & ~follows)
        # Almost all differ in the first joint.
        for columns, offset in ((joints[:1], 0), (joints, 0), (joints, -1), (joints, 1)):
            if not len(others):
                break
            clips = donors.clip[np.concatenate([others, others + 1])]
            frames = np.concatenate([donors.stop[others], donors.start[others + 1]]) + offset
            ends, starts = np.split(_frames(tracks, columns, clips, frames), 2)
            differs = (ends != starts).any(axis=(1, 2))
            seams[others[differs]] = True
            others = others[~differs]
        return seams


def _align(
    transforms: AlignmentTransform,
    space: ValueSpace,
    values: FloatArray,
    velocities: FloatArray | None = None,
) -> None:
    """Apply an alignment transform to each of n values and velocities of a root, in place.

    `values`, shape (n, 1, 4 or 3), are rotations or translations. An identity transform changes no
    bit of them.
    """
    moves = (transforms.yaws != rotations.IDENTITY).any(axis=1)
    moves |= (transforms.translations != 0.0).any(axis=1)
    transforms = transforms[moves]
    if space is ROTATIONS:  # angular velocities are in local axes: no change
        values[moves, 0] = rotations.multiply(transforms.yaws, values[moves, 0])
        return
    rotated = rotations.rotate(transforms.yaws, values[moves, 0])
    values[moves, 0] = rotated + transforms.translations
    if velocities is not None:
        velocities[moves, 0] = rotations.rotate(transforms.yaws, velocities[moves, 0])


def _frames(
    tracks: Sequence[FloatArray], joints: IntArray, clips: IntArray, frames: IntArray
) -> FloatArray:
    """Return the values of joints in frames, (n, n_joints, 4 or 3); NaN outside the clip."""
    found = np.full((len(frames), len(joints), tracks[0].shape[2]), np.nan)
    for clip in np.unique(clips).tolist():
        rows = np.flatnonzero((clips == clip) & (frames >= 0) & (frames < len(tracks[clip])))
        found[rows] = tracks[clip][frames[rows][:, None], joints]
    return found
