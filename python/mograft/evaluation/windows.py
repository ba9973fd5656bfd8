"""Windows of grafts and of captured motion, as features of the classifiers of `detectability`."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from math import prod
from typing import Literal

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.evaluation import body_tracks
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.synthesis.graft_result import Graft

Place = Literal["seams", "between seams"]
HALF_WINDOW: dict[Place, int] = {"seams": 8, "between seams": 4}  # samples before and after
_POSITIONS = 9  # instants at which a window has positions
_NEAR = 4  # samples before and after the centre with velocities and accelerations
_PEAK = 2  # samples before and after the centre whose largest magnitudes are features
_MARGIN = 3  # samples that derivatives need beyond a window
_LOG_OFFSET = 0.05  # added to magnitudes before the logarithm, heights per unit of time


@dataclass(frozen=True, eq=False)
class Windows:
    """Features of windows, one row for each."""

    blocks: tuple[FloatArray, ...]  # positions, velocities, accelerations: (n, n_features) each
    magnitudes: FloatArray  # log magnitudes of velocity, acceleration and jerk, and root velocity

    def __len__(self) -> int:
        return len(self.magnitudes)

    def __getitem__(self, rows: IntArray) -> "Windows":
        return Windows(tuple(block[rows] for block in self.blocks), self.magnitudes[rows])

    @classmethod
    def concatenate(cls, parts: Sequence["Windows"]) -> "Windows":
        """Concatenate one or more collections of windows, in their order."""
        columns = zip(*(part.blocks for part in parts), strict=True)
        blocks = tuple(np.concatenate(column) for column in columns)
        return cls(blocks, np.concatenate([part.magnitudes for part in parts]))


def window_reach(place: Place, rate: float) -> int:
    """Return the number of frames that a window needs on each side of its centre.

    They include the frames for derivatives. Windows of the `place` "between seams" are shorter than
    those at "seams". `rate` is in frames per second.
    """
    return (HALF_WINDOW[place] + _MARGIN) * body_tracks.sample_stride(rate)


def extract_windows(tracks: body_tracks.BodyTracks, centers: IntArray, place: Place) -> Windows:
    """Return the features of windows around the frames `centers`, relative to the heading there.

    Samples are about 1/30 s apart; see `sample_stride`. Positions are those at nine instants of the
    window. Velocities and accelerations are those of the nine samples around the centre. For each
    point, the magnitudes of velocity, acceleration and jerk are the maximum within two samples of
    the centre, and the root mean square over these nine samples.
    """
    half, stride = HALF_WINDOW[place], tracks.stride
    wide = np.linspace(-half, half, _POSITIONS).round().astype(np.int64)
    offsets = (wide, *(np.arange(-n, n + 1) for n in (_NEAR, _PEAK)))
    at_wide, at_near, at_peak = (centers[:, None] + own * stride for own in offsets)

    def flat(track: FloatArray, frames: IntArray) -> FloatArray:
        turned = tracks.facing_forward(track[frames], centers)
        return turned.reshape(len(centers), prod(turned.shape[1:]))

    orders, magnitudes = (1, 2, 3), []
    derivatives = [body_tracks.derivative(tracks.points, tracks.rate, order) for order in orders]
    for track in derivatives:
        sizes = np.linalg.norm(track, axis=-1)
        mean_squares = (sizes[at_near] ** 2).mean(axis=1)
        magnitudes += [sizes[at_peak].max(axis=1), np.sqrt(mean_squares)]
    root = tracks.root_velocity[centers]
    level = tracks.facing_forward(root[:, :3], centers)
    blocks = (flat(tracks.points, at_wide), *(flat(own, at_near) for own in derivatives[:2]))
    logs = np.log(np.concatenate(magnitudes, axis=1) + _LOG_OFFSET)
    return Windows(blocks, np.concatenate([logs, level, root[:, 3:]], axis=1))


@dataclass(frozen=True, eq=False)
class Pairs:
    """Windows of grafts, each with the captured window at the same frame of its base."""

    base: Windows  # the captured windows, one row for each distinct base frame
    new: Windows  # the windows of grafts
    row: IntArray  # for each window in `new`, the row of its captured window in `base`
    block: IntArray  # block of the base frame of each row of `base`
    blocks_used: tuple[IntArray, ...]  # for each window in `new`, the blocks of base and donors


@dataclass(frozen=True, eq=False)
class GraftWindows:
    """The windows of several grafts at their seams, or between the seams.

    `origins` has, for each graft and each of its grafted groups, the captured frames that the group
    comes from.
    """

    frames: body_tracks.FrameBlocks
    grafts: Sequence[Graft]
    place: Place
    graft: IntArray  # index of the graft of each window
    center: IntArray  # frame of each window
    origins: tuple[tuple[body_tracks.Origin, ...], ...]  # by graft, then by grafted group

    @classmethod
    def of(
        cls, grafts: Sequence[Graft], place: Place, max_count: int, rng: np.random.Generator
    ) -> "GraftWindows":
        """Return at most `max_count` windows of grafts at `place`, drawn at random if necessary."""
        frames = body_tracks.FrameBlocks.of(grafts[0].library)
        origins = tuple(
            tuple(body_tracks.Origin.of(graft, group, frames) for group in graft.alternatives)
            for graft in grafts
        )
        centers = list(map(_centers, grafts, origins, repeat(place)))
        index = np.repeat(np.arange(len(grafts)), [len(several) for several in centers])
        center = np.concatenate(centers)
        if len(center) > max_count:
            chosen = np.sort(rng.choice(len(center), max_count, replace=False))
            index, center = index[chosen], center[chosen]
        return cls(frames, grafts, place, index, center, origins)

    @property
    def library(self) -> Library:
        """The library of the grafts."""
        return self.grafts[0].library

    def __len__(self) -> int:
        return len(self.center)

    def pairs(self) -> Pairs:
        """Return the windows of the grafts, each with the captured window at the same frame."""
        half = HALF_WINDOW[self.place] * body_tracks.sample_stride(self.library.rate)
        donor_blocks = []
        for graft, center in zip(self.graft.tolist(), self.center.tolist(), strict=True):
            window = slice(center - half, center + half + 1)
            frames = np.concatenate([origin.frames[window] for origin in self.origins[graft]])
            donor_blocks.append(np.unique(self.frames.block[frames]))
        motions = [graft.motion for graft in self.grafts]
        return self._pair(self._extract(motions, self.graft, self.center), donor_blocks)

    def donor_pairs(self) -> Pairs:
        """Return the result of `pairs` with captured windows of donors in place of those of grafts.

        Each is centred at the donor frame from which the first exchanged group takes the centre of
        the graft's window, or next to it at the ends of a clip. If no group is exchanged there, it
        is the window of the base. Windows of donors in clips that are too short are left out; the
        result is empty if no window remains.
        """
        source = np.empty(len(self), np.int64)
        for row, (graft, center) in enumerate(zip(self.graft, self.center, strict=True)):
            origins = self.origins[graft]
            used = next((o for o in origins if o.is_exchanged[center]), origins[0])
            source[row] = used.frames[center]
        clip, frame = self.frames.clip_of(source)
        lengths = np.array([entry.n_frames for entry in self.library.entries])
        reach = window_reach(self.place, self.library.rate)
        frame = np.clip(frame, reach, np.maximum(lengths[clip] - reach - 1, reach))
        # A clip shorter than a window has none.
        kept = np.flatnonzero(lengths[clip] > 2 * reach)
        clip, frame = clip[kept], frame[kept]
        part = replace(self, graft=self.graft[kept], center=self.center[kept])
        blocks = self.frames.block[self.frames.offsets[clip] + frame]
        new = self._extract(self.library.clips, clip, frame)
        return part._pair(new, tuple(blocks[:, None]))

    def _pair(self, new: Windows, donor_blocks: Sequence[IntArray]) -> Pairs:
        clips = body_tracks.clip_indices(self.library)
        base_clips = np.array([clips[graft.base.name] for graft in self.grafts])[self.graft]
        places = np.stack([base_clips, self.center], axis=1)
        base, row = np.unique(places, axis=0, return_inverse=True)
        (clip, frame), row = base.T, row.reshape(-1)
        block = self.frames.block[self.frames.offsets[clip] + frame]
        pairs = zip(donor_blocks, block[row].tolist(), strict=True)
        used = tuple(np.union1d(several, own) for several, own in pairs)
        captured = self._extract(self.library.clips, clip, frame)
        return Pairs(captured, new, row, block, used)

    def _extract(self, motions: Sequence[Motion], index: IntArray, frame: IntArray) -> Windows:
        """Return the windows around the frames `frame` of the motions that have the given indices.

        Without an index, the arrays have no rows, but as many columns as with rows.
        """
        parts, rows = [], []
        for each in np.unique(index).tolist() or [0]:
            rows.append(np.flatnonzero(index == each))
            tracks = body_tracks.BodyTracks.of(motions[each])
            parts.append(extract_windows(tracks, frame[rows[-1]], self.place))
        return Windows.concatenate(parts)[np.argsort(np.concatenate(rows), kind="stable")]


def _centers(graft: Graft, origins: Sequence[body_tracks.Origin], place: Place) -> IntArray:
    """Return the centres of the windows of a graft: its seams, or the middles between seams.

    Middles are returned only in exchanged segments and if the window fits between the seams.
    """
    n, stride = graft.motion.n_frames, body_tracks.sample_stride(graft.motion.rate)
    seams = np.unique([seam.frame for seam in graft.seams]).astype(np.int64)
    if place == "between seams":
        edges = np.unique(np.concatenate([[0], seams, [n - 1]]))
        middles = (edges[1:] + edges[:-1]) // 2
        is_wide = np.diff(edges) > 2 * HALF_WINDOW[place] * stride
        is_exchanged = np.any([origin.is_exchanged for origin in origins], axis=0)
        seams = middles[is_wide & is_exchanged[middles]]
    reach = window_reach(place, graft.motion.rate)
    return seams[(seams >= reach) & (seams < n - reach)]
