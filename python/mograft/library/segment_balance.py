"""The balance of a library's segments, as far as a donor search needs it."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.containers import SizedCache
from mograft.analysis import zero_moment
from mograft.analysis.embedding import CHUNK, Samples
from mograft.analysis.zero_moment import ZeroMomentTrack
from mograft.body.contacts import Ground
from mograft.config import Config
from mograft.library.files.stored_clips import JoinedSamples
from mograft.library.spec import LibrarySpec
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments

_MAX_MARGIN_BYTES = 1 << 27
"""Bytes of support margins that are kept."""


@dataclass(frozen=True, eq=False)
class LibraryBalance:
    """Mass offsets and support margins of segments, computed when they are needed.

    `mass_offsets` and `support_margins` of `mograft.analysis.zero_moment` define them.
    """

    clips: Sequence[Motion]
    segments: Segments
    samples: Samples | JoinedSamples
    spec: LibrarySpec
    config: Config
    # By the joints of a group: offsets, shape (n_segments, n_samples, 2), and which are computed.
    # Zeros that nothing has written take no memory.
    _offsets: dict[bytes, tuple[FloatArray, BoolArray]] = field(default_factory=dict)
    _tracks: dict[int, ZeroMomentTrack] = field(default_factory=dict)  # of the last clip
    # Margins by clip and block of segments.
    _margins: SizedCache[tuple[int, int], FloatArray] = field(
        default_factory=lambda: SizedCache(_MAX_MARGIN_BYTES)
    )

    def mass_offsets(self, joints: IntArray, segments: IntArray) -> FloatArray:
        """Return the mass offsets of a joint group in some segments, shape (n, n_samples, 2)."""
        shape = (len(self.segments), self.config.samples, 2)
        group = joints.tobytes()
        if group not in self._offsets:
            self._offsets[group] = np.zeros(shape), np.zeros(len(self.segments), bool)
        known, is_known = self._offsets[group]
        missing = np.unique(segments[~is_known[segments]])
        root, up = self.spec.root, self.spec.up
        for start in range(0, len(missing), CHUNK):
            batch = missing[start : start + CHUNK]
            samples = self.samples.select(batch)
            known[batch] = zero_moment.mass_offsets(samples, self.spec.skeleton, joints, root, up)
            is_known[batch] = True
        return known[segments]

    def support_margins(self, segments: IntArray) -> FloatArray:
        """Return the support margins of some segments, shape (n, n_samples, N_DIRECTIONS)."""
        found = np.empty((len(segments), self.config.samples, zero_moment.N_DIRECTIONS))
        clips = self.segments.clip[segments]
        for clip in np.unique(clips).tolist():
            members, of_clip = self.segments.of_clip(clip), np.flatnonzero(clips == clip)
            blocks, rows = np.divmod(np.searchsorted(members, segments[of_clip]), CHUNK)
            for block in np.unique(blocks).tolist():
                own = blocks == block
                found[of_clip[own]] = self._margins_of_block(clip, block, members)[rows[own]]
        return found

    def _margins_of_block(self, clip: int, block: int, members: IntArray) -> FloatArray:
        """Return the support margins of a block of at most `CHUNK` segments of a clip.

        `members` are all segments of the clip.
        """
        known = self._margins.get((clip, block))
        if known is None:
            motion, cut, up = self.clips[clip], self.segments[members], self.spec.up
            track = self._tracks.get(clip)
            if track is None:
                ground, root = Ground.of(motion), self.spec.root
                track = ZeroMomentTrack.of(motion, cut, ground, self.config, root=root, up=up)
                self._tracks.clear()
                self._tracks[clip] = track
            chosen = slice(block * CHUNK, (block + 1) * CHUNK)
            known = zero_moment.support_margins(
                motion, cut, track, self.config, up=up, chosen=chosen
            )
            self._margins.put((clip, block), known, known.nbytes)
        return known
