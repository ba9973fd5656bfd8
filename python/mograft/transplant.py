"""Recombination and seams: from chosen segments to one motion (paper, 4.5)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mograft import rotations
from mograft._arrays import BoolArray, FloatArray, IntArray
from mograft.config import Config
from mograft.motion import Motion
from mograft.resample import segments, segments_positions
from mograft.segmentation import Segments

__all__ = ["Part", "recombine", "transplant"]


@dataclass(frozen=True, eq=False)
class Part:
    """What one joint group does in the new motion.

    Attributes
    ----------
    joints : ndarray of int
        The group's joints.
    rotations : ndarray, shape (n_frames, len(joints), 4)
        Their local rotations.
    positions : ndarray, shape (n_frames, len(joints), 3)
        Their local translations.
    seams : ndarray of int
        Frames where segments meet that did not meet in a clip.
    gaps : ndarray, shape (len(seams), len(joints))
        By what angle each joint had to be brought together there, in radians.
    """

    joints: IntArray
    rotations: FloatArray
    positions: FloatArray
    seams: IntArray
    gaps: FloatArray


def transplant(
    base: Motion,
    cut: Segments,
    donors: Segments,
    clips: Sequence[Motion],
    joints: IntArray,
    config: Config,
) -> Part:
    """Let a joint group do what it does in other segments, and join these smoothly.

    Parameters
    ----------
    base : Motion
        The motion whose other joints stay as they are.
    cut : Segments
        Its segments, in order of time, covering it.
    donors : Segments
        For each segment of `cut` the one to take its place, itself perhaps.
    clips : sequence of Motion
        What `donors.clip` counts; of the base's hierarchy.
    joints : ndarray of int
        The joints of the group.
    config : Config
        Gives `seam` and `seam_window`.

    Returns
    -------
    Part
        The group's motion, as long as the base. Where segments follow one another as they
        do in their clip, unstretched, it is that clip bit for bit.

    Notes
    -----
    Every donor is resampled to the length of the segment whose place it takes. At a seam
    both poses are moved to the one half way between them, and the change spread over the
    segments (displacement map); with ``seam="paper"`` the frames about the seam are then
    laid anew on a cubic that meets the velocities at its ends. A joint's translation goes
    with it only where it moves in some donor's clip: else the base keeps its own bones.
    """
    packed = _Packed.of(cut)
    tracks = [clip.rotations[:, joints] for clip in clips]
    turns = _gather(cut, donors, tracks, segments)
    seams = _true_seams(cut, donors, tracks)

    before, after = turns[packed.last[:-1]], turns[packed.first[1:]]
    ways = rotations.log(rotations.multiply(rotations.inverse(before), after))
    ways[(before == after).all(axis=-1)] = 0.0  # a pose shared to the bit is not moved at all
    turned = rotations.multiply(turns, rotations.exp(packed.spread(ways)))
    moved = packed.touched(seams)
    quats = packed.unpack(np.where(moved[:, None, None], turned, turns))

    places = np.ascontiguousarray(base.positions[:, joints])
    travels = _travels(clips, np.unique(donors.clip), joints)
    if travels.any():
        own = [clip.positions[:, joints[travels]] for clip in clips]
        shifts = _gather(cut, donors, own, segments_positions)
        steps = shifts[packed.first[1:]] - shifts[packed.last[:-1]]
        shifted = shifts + packed.spread(steps)
        places[:, travels] = packed.unpack(np.where(moved[:, None, None], shifted, shifts))

    if config.seam == "paper":
        window = round(config.seam_window * base.rate)
        left, right = _windows(cut, np.flatnonzero(seams), window)
        quats = _smooth_rotations(quats, left, right)
        places[:, travels] = _smooth_positions(places[:, travels], left, right)
    gaps = np.linalg.norm(ways[seams], axis=-1)
    return Part(joints, quats, places, cut.stop[:-1][seams], gaps)


def recombine(base: Motion, parts: Sequence[Part], name: str) -> Motion:
    """Put new parts into a motion; all else stays as it is, number for number (eq. 20).

    Parameters
    ----------
    base : Motion
        The motion to change.
    parts : sequence of Part
        Parts of different joints.
    name : str
        The new motion's name.

    Returns
    -------
    Motion
        With the base's channel values wherever neither rotation nor translation has changed.
    """
    skeleton = base.skeleton
    quats, places = base.rotations.copy(), base.positions.copy()
    values = None if base.channel_values is None else base.channel_values.copy()
    for part in parts:
        turned = (part.rotations != base.rotations[:, part.joints]).any(axis=-1)
        moved = (part.positions != base.positions[:, part.joints]).any(axis=-1)
        for column, joint in enumerate(part.joints):
            if turned[:, column].any():
                quats[:, joint] = rotations.continuous(part.rotations[:, column])
            if moved[:, column].any():
                places[:, joint] = part.positions[:, column]
            if values is None:
                continue
            changed = {"rotation": turned[:, column], "position": moved[:, column]}
            for at, channel in zip(
                skeleton.channel_columns[joint], skeleton.channels[joint], strict=True
            ):
                values[changed[channel[1:]], at] = np.nan
    return replace(
        base,
        rotations=quats,
        positions=places,
        channel_values=values,
        name=name,
        path=None,
        repairs=(),
    )


@dataclass(frozen=True, eq=False)
class _Packed:
    """Segments laid one after the other, the frames where they meet counted twice.

    `first` and `last` are the rows of each segment's ends, `segment` and `share` each row's
    segment and how far through it the row is, 0 to 1; `frame` is the row's frame.
    """

    first: IntArray
    last: IntArray
    segment: IntArray
    share: FloatArray
    frame: IntArray

    @classmethod
    def of(cls, cut: Segments) -> "_Packed":
        counts = cut.lengths + 1
        last = np.cumsum(counts) - 1
        first = last - cut.lengths
        segment = np.repeat(np.arange(len(cut)), counts)
        step = np.arange(len(segment)) - first[segment]
        return cls(first, last, segment, step / cut.lengths[segment], cut.start[segment] + step)

    def spread(self, ways: FloatArray) -> FloatArray:
        """Spread half of each seam's way over the segment before it and half over the one after.

        From (n_segments - 1, n_joints, 3) to (n_rows, n_joints, 3).
        """
        still = np.zeros((1, *ways.shape[1:]))
        at_start, at_end = np.concatenate([still, -0.5 * ways]), np.concatenate([0.5 * ways, still])
        share = self.share[:, None, None]
        spread: FloatArray = (1.0 - share) * at_start[self.segment] + share * at_end[self.segment]
        return spread

    def touched(self, seams: BoolArray) -> np.ndarray:
        """Tell which rows are of a segment with a seam at either end."""
        beside = np.concatenate([[False], seams]) | np.concatenate([seams, [False]])
        touched: BoolArray = beside[self.segment]
        return touched

    def unpack(self, rows: FloatArray) -> FloatArray:
        """Return one row per frame; where segments meet, the later one's."""
        frames = np.empty((self.frame[-1] + 1, *rows.shape[1:]))
        frames[self.frame] = rows
        return frames


def _gather(
    cut: Segments,
    donors: Segments,
    tracks: Sequence[FloatArray],
    resample: Callable[[FloatArray, IntArray, IntArray, IntArray], FloatArray],
) -> FloatArray:
    """Resample every donor to its place's length; rows as `_Packed` lays them."""
    counts = cut.lengths + 1
    order = np.argsort(donors.clip, kind="stable")
    rows = [
        resample(tracks[clip], donors.start[own], donors.stop[own], counts[own])
        for clip in np.unique(donors.clip)
        for own in [order[donors.clip[order] == clip]]
    ]
    starts = np.cumsum(counts) - counts
    places = np.concatenate([np.arange(starts[i], starts[i] + counts[i]) for i in order])
    gathered = np.empty((counts.sum(), *rows[0].shape[1:]))
    gathered[places] = np.concatenate(rows)
    return gathered


def _true_seams(cut: Segments, donors: Segments, tracks: Sequence[FloatArray]) -> BoolArray:
    """Tell where neighbours did not meet in a clip, or were stretched.

    They did meet where the one's clip goes on as the other's does, to the bit, in the frames
    before, at and after the seam: so a clip's copy is as good as the clip.
    """

    def around(clips: IntArray, frames: IntArray) -> FloatArray:
        near = np.full((len(frames), 3, *tracks[0].shape[1:]), np.nan)
        for clip in np.unique(clips):
            own = np.flatnonzero(clips == clip)
            at = frames[own][:, None] + [-1, 0, 1]
            inside = (at >= 0) & (at < len(tracks[clip]))
            near[own[:, None], [0, 1, 2]] = np.where(
                inside[..., None, None], tracks[clip][at.clip(0, len(tracks[clip]) - 1)], np.nan
            )
        return near

    as_long = donors.lengths == cut.lengths
    ends = around(donors.clip[:-1], donors.stop[:-1])
    starts = around(donors.clip[1:], donors.start[1:])
    follows: BoolArray = (ends == starts).all(axis=(1, 2, 3)) & as_long[1:] & as_long[:-1]
    return ~follows


def _travels(clips: Sequence[Motion], used: IntArray, joints: IntArray) -> BoolArray:
    """Tell which joints' translations move in one of the clips used."""
    spreads = [np.ptp(clips[clip].positions[:, joints], axis=0).max(axis=-1) for clip in used]
    travels: BoolArray = np.max(spreads, axis=0) > 0
    return travels


def _windows(cut: Segments, seams: IntArray, most: int) -> tuple[IntArray, IntArray]:
    """Return the knots left and right of each seam between which the curve is laid anew.

    No window leaves the nearer half of a segment, so that two never overlap; segments of a
    single interval have none.
    """
    reach = np.minimum(np.minimum(cut.lengths[seams], cut.lengths[seams + 1]) // 2 - 1, most)
    at = cut.stop[seams][reach >= 0]
    reach = reach[reach >= 0]
    return at - (reach + 1), at + (reach + 1)


def _between(left: IntArray, right: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the frames inside windows, each one's window and how far through it it is."""
    inside = right - left - 1
    window = np.repeat(np.arange(len(left)), inside)
    step = np.arange(len(window)) - np.repeat(np.cumsum(inside) - inside, inside) + 1
    return left[window] + step, window, step / (right - left)[window]


def _smooth_rotations(quats: FloatArray, left: IntArray, right: IntArray) -> FloatArray:
    """Lay rotations anew between knots, meeting poses and velocities there."""
    if not len(left):
        return quats
    frames, window, t = _between(left, right)

    def velocity(knots: IntArray) -> FloatArray:
        across = rotations.multiply(rotations.inverse(quats[knots - 1]), quats[knots + 1])
        per_window: FloatArray = 0.5 * rotations.log(across) * (right - left)[:, None, None]
        return per_window

    n_joints = quats.shape[1]
    ends = (quats[left], quats[right], velocity(left), velocity(right))
    start, end, leaving, reaching = (v[window].reshape(-1, v.shape[-1]) for v in ends)
    curve = rotations.hermite(start, end, leaving, reaching, np.repeat(t, n_joints))
    smooth = quats.copy()
    smooth[frames] = curve.reshape(-1, n_joints, 4)
    return smooth


def _smooth_positions(places: FloatArray, left: IntArray, right: IntArray) -> FloatArray:
    """Lay positions anew between knots, as `_smooth_rotations` does rotations."""
    if not len(left) or not places.shape[1]:
        return places
    frames, window, t = _between(left, right)
    t = t[:, None, None]
    s = 1.0 - t
    width = (right - left)[window, None, None]
    a, b = left[window], right[window]
    leaving = 0.5 * (places[a + 1] - places[a - 1]) * width
    reaching = 0.5 * (places[b + 1] - places[b - 1]) * width
    smooth = places.copy()
    smooth[frames] = (
        places[a] * (s * s * (1.0 + 2.0 * t))
        + places[b] * (t * t * (1.0 + 2.0 * s))
        + leaving * (t * s * s)
        - reaching * (t * t * s)
    )
    return smooth
