"""What a search needs to know about the balance of a library's segments."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.embedding import CHUNK, Samples
from mograft.analysis.segmentation import Segments
from mograft.analysis.zero_moment import N_DIRECTIONS, mass_offsets, support_margins
from mograft.body.contacts import Ground
from mograft.config import Config
from mograft.library.spec import LibrarySpec
from mograft.library.stored_clips import ExtendedSamples, StoredSamples
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class LibraryBalance:
    """Mass offsets and support margins of segments, computed when they are needed.

    The functions of `mograft.analysis.zero_moment` with these names define them.
    """

    clips: Sequence[Motion]
    segments: Segments
    samples: Samples | StoredSamples | ExtendedSamples
    skeleton: Skeleton
    spec: LibrarySpec
    config: Config
    # Offsets by the joints of a group, shape (n_segments, n_samples, 2); NaN if not yet computed.
    _offsets: dict[bytes, FloatArray] = field(default_factory=dict)
    _margins: dict[int, FloatArray] = field(default_factory=dict)  # of all segments, by clip

    def mass_offsets(self, joints: IntArray, segments: IntArray) -> FloatArray:
        """Return the mass offsets of a joint group in some segments, shape (n, n_samples, 2)."""
        shape = (len(self.segments), self.config.samples, 2)
        group = joints.tobytes()
        if group not in self._offsets:
            self._offsets[group] = np.full(shape, np.nan)
        known = self._offsets[group]
        missing = np.unique(segments[np.isnan(known[segments, 0, 0])])
        root, up = self.spec.root, self.spec.up
        for start in range(0, len(missing), CHUNK):
            batch = missing[start : start + CHUNK]
            samples = self.samples.select(batch)
            known[batch] = mass_offsets(samples, self.skeleton, joints, root, up)
        found: FloatArray = known[segments]
        return found

    def support_margins(self, segments: IntArray) -> FloatArray:
        """Return the support margins of some segments, shape (n, n_samples, N_DIRECTIONS)."""
        found = np.empty((len(segments), self.config.samples, N_DIRECTIONS))
        clips = self.segments.clip[segments]
        for clip in np.unique(clips).tolist():
            members = self.segments.of_clip(clip)
            if clip not in self._margins:
                self._margins[clip] = self._margins_of_clip(self.clips[clip], members)
            rows = np.searchsorted(members, segments[clips == clip])
            found[clips == clip] = self._margins[clip][rows]
        return found

    def _margins_of_clip(self, motion: Motion, members: IntArray) -> FloatArray:
        cut, ground = self.segments[members], Ground.of(motion)
        root, up = self.spec.root, self.spec.up
        return support_margins(motion, cut, ground, self.config, root=root, up=up)
