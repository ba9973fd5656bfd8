"""Passages that clips have in common, by their content: copies, pieces and mirrored takes.

The poses at the ends of each segment of one set of clips are searched among all frames of the
other set. A passage is common if both ends are found at the distance of the segment's length.
Names, headings, positions and bone lengths are not compared.
"""

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.body.mirroring import mirror
from mograft.library.clusters import feature_joints_by_group
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.search.copies import COPY_ANGLE

_MIN_TURN = np.radians(2.0)
"""Rotation of some joint from the first to the last frame: poses that are held prove nothing."""

_MAX_TURN = np.radians(3.0)
"""Greatest tolerance of a joint; that of a fast joint contains its motion in half a frame."""

_N_AXES, _N_CHECKED = 4, 12
"""Principal components by which poses are found, and by which pairs are then excluded."""

_FEWEST_SEGMENTS = 1024  # of which the slower half is not selected

_PAIRS_PER_BATCH, _FRAMES_PER_BATCH = 1 << 14, 256
# Of a spatial hash: Teschner et al. (2003), and one more prime.
_PRIMES = np.array([73_856_093, 19_349_663, 83_492_791, 50_331_653])


def find_shared_clips(library: Library, ours: BoolArray, others: BoolArray) -> IntArray:
    """Return the clips among `ours`, ascending, with a passage in common with one of `others`.

    Both are masks of clips. A passage is a whole segment of one of `ours`, with some motion, that
    occurs among the frames of another clip or of its mirror image.
    """
    index = _SegmentIndex(library, np.flatnonzero(ours[library.segments.clip]))
    found = np.zeros(len(library.segments), bool)
    if len(index.segments):
        for quats in _poses(library, np.flatnonzero(others), index.joints):
            found[index.find(quats)] = True
    return np.unique(library.segments.clip[found])


def _poses(library: Library, clips: IntArray, joints: IntArray) -> Iterator[FloatArray]:
    """Yield the rotations of joints, (n_frames, n_joints, 4), in clips and their mirror images."""
    for clip in clips.tolist():
        motion = library.clips[clip]
        yield motion.rotations[:, joints]
        with suppress(ValueError):  # a skeleton that has no mirror image has no mirrored takes
            yield mirror(motion).rotations[:, joints]


class _SegmentIndex:
    """Those of some segments that move, and not too fast, found by the pose in their first frame.

    The fastest joints have wide tolerances; segments that begin slowly find copies as well.
    """

    def __init__(self, library: Library, segments: IntArray) -> None:
        members = feature_joints_by_group(library.groups, library.skeleton)
        # All joints whose rotations are features, but the root.
        self.joints = np.setdiff1d(np.concatenate(list(members.values())), [library.root])

        def states(key: str, size: int) -> FloatArray:
            found = np.zeros((len(segments), library.skeleton.n_joints, size))
            for group, own in members.items():
                found[:, own] = library.boundary_states[group][key][segments]
            return found[:, self.joints]

        ends = [states("first", 4), states("last", 4)]
        speeds = [np.linalg.norm(states(f"{end}_velocity", 3), axis=2) for end in ("first", "last")]
        limits = [np.minimum(COPY_ANGLE + own / (2.0 * library.rate), _MAX_TURN) for own in speeds]
        angles = rotations.angle(*ends) if len(segments) else np.zeros((0, len(self.joints)))
        moves = (angles > _MIN_TURN).any(axis=1)
        reaches = np.sqrt(2.0 * (limits[0] ** 2).sum(axis=1))
        known = np.sort(reaches[moves])
        reach = float(known[: max(len(known) // 2, _FEWEST_SEGMENTS)][-1]) if len(known) else 0.0
        # The slowest segment of each clip is among them: no clip is without one.
        slowest = np.full(len(library.entries), np.inf)
        np.minimum.at(slowest, library.segments.clip[segments[moves]], reaches[moves])
        # The greatest difference of two equal poses in a component.
        self.reach = max(reach, float(slowest[np.isfinite(slowest)].max(initial=0.0)))
        kept = np.flatnonzero(moves & (reaches <= self.reach))
        features = _features(ends[0][kept])
        self.mean = features.sum(axis=0) / max(len(kept), 1)
        centered = features - self.mean
        self.axes = np.linalg.eigh(centered.T @ centered)[1].T[::-1][:_N_CHECKED]
        points = centered @ self.axes.T
        keys = _hash(np.floor(points[:, :_N_AXES] / max(2.0 * self.reach, 1e-9)))
        order = np.argsort(keys, kind="stable")
        # The segments by the cell of their first pose, (n, _N_CHECKED); first and last poses, each
        # (n, n_joints, 4), and the tolerances of the angles in them, each (n, n_joints).
        self.points, self.keys, self.segments = points[order], keys[order], segments[kept[order]]
        self.lengths = library.segments.lengths[self.segments]
        self.ends, self.limits = ([own[kept[order]] for own in each] for each in (ends, limits))

    def find(self, quats: FloatArray) -> IntArray:
        """Return the segments that occur among poses, (n_frames, n_joints, 4), of one clip."""
        points = (_features(quats) - self.mean) @ self.axes.T
        corners = np.floor(points[:, :_N_AXES] / max(2.0 * self.reach, 1e-9) - 0.5)
        sides = np.array(list(np.ndindex(*(2,) * corners.shape[1])))
        found: list[IntArray] = []
        for low in range(0, len(quats), _FRAMES_PER_BATCH):
            batch = corners[low : low + _FRAMES_PER_BATCH]
            keys = _hash((batch[:, None] + sides).reshape(-1, batch.shape[1]))
            first = np.searchsorted(self.keys, keys, side="left")
            counts = np.searchsorted(self.keys, keys, side="right") - first
            frames = low + np.repeat(np.arange(len(keys)) // len(sides), counts)
            rows = np.arange(len(frames)) + np.repeat(first - (np.cumsum(counts) - counts), counts)
            fits = frames + self.lengths[rows] < len(quats)
            frames, rows = frames[fits], rows[fits]
            for axes in (slice(1), slice(1, _N_AXES), slice(_N_AXES, None)):
                gaps = np.abs(points[frames, axes] - self.points[rows, axes])
                near = (gaps <= self.reach).all(axis=1)
                frames, rows = frames[near], rows[near]
            for start in range(0, len(rows), _PAIRS_PER_BATCH):
                pairs = slice(start, start + _PAIRS_PER_BATCH)
                found.append(self._verify(quats, frames[pairs], rows[pairs]))
        return self.segments[np.concatenate(found)] if found else np.zeros(0, np.int64)

    def _verify(self, quats: FloatArray, frames: IntArray, rows: IntArray) -> IntArray:
        """Return the rows whose first and last poses are those of the clip from `frames` on."""
        for end, shift in ((0, np.zeros_like(self.lengths)), (1, self.lengths)):
            poses, limits = self.ends[end][rows], self.limits[end][rows]
            cosines = np.abs(np.einsum("...i,...i->...", poses, quats[frames + shift[rows]]))
            is_same = (cosines >= np.cos(limits / 2.0)).all(axis=1)
            frames, rows = frames[is_same], rows[is_same]
        return rows


def _features(quats: FloatArray) -> FloatArray:
    """Return two columns of each rotation matrix, which do not depend on signs, (n, n_features)."""
    axes = [rotations.rotate(quats, np.eye(3)[axis]) for axis in (0, 1)]
    return np.concatenate(axes, axis=2).reshape(len(quats), 6 * quats.shape[1])


def _hash(cells: FloatArray) -> IntArray:
    return np.bitwise_xor.reduce(cells.astype(np.int64) * _PRIMES[: cells.shape[1]], axis=1)
