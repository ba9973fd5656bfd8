"""What grafts are like beside the recording: seams, smoothness, feet, variety, coordination.

None of these says whether a motion is natural. Each says how far grafts depart from the
recording in one respect, and which way.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.body.anatomy import anatomy, feature_joints
from mograft.body.contacts import Ground, find_legs, skating_share
from mograft.body.mass import up_axis
from mograft.errors import InsufficientDataError
from mograft.evaluation import estimate
from mograft.evaluation.estimate import Estimate
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.synthesis.graft_result import Graft

__all__ = [
    "Quality",
    "angular_derivatives",
    "coordination",
    "diversity",
    "nearest_windows",
    "quality",
]

_COARSE = 10.0
"""Frames a second at which windows are compared: poses change little in a tenth of one."""
_COVER, _LOCAL = 1.0, 0.5
"""Seconds of the windows of coverage and of local diversity: 30 and 15 frames at 30 fps."""
_COVERED = 2.0
_MOST = 20_000
"""Coarse frames of the library that are looked at, half an hour; of more every so manieth."""
_LAG = 0.5


@dataclass(frozen=True)
class Quality:
    """Measures of grafts of one base, made one way.

    Attributes
    ----------
    new_segments : Estimate
        Share of the parts that come from another segment.
    seam_gap, seam_gap_p90 : Estimate
        Mean and 90th percentile of the gaps that seams had to close, in degrees.
    acceleration, jerk : Estimate
        Mean angular acceleration and jerk of the grafted joints over the recording's own.
    foot_skate : Estimate
        Share of feet and frames that slide; the recording's own subtracted.
    coverage : Estimate
        Share of the library's windows of a second that some window of the graft is near to.
    local_diversity : Estimate
        Mean distance of the graft's windows of half a second to the library's nearest, as
        root mean square of 6D rotations per joint; 0 for a copy.
    diversity : Estimate
        Mean joint angle between two grafts at the same time, in degrees.
    coordination, lag : Estimate
        By how much the correlation of arm and opposite leg differs from the recording's, and
        by how many seconds its peak lag does.
    method : str
        How the grafts were made.
    runs : int
        How many there are on each base.
    """

    method: str
    runs: int
    new_segments: Estimate
    seam_gap: Estimate
    seam_gap_p90: Estimate
    acceleration: Estimate
    jerk: Estimate
    foot_skate: Estimate
    coverage: Estimate
    local_diversity: Estimate
    diversity: Estimate
    coordination: Estimate
    lag: Estimate

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        return {
            name: value.as_dict() if isinstance(value, Estimate) else value
            for name, value in vars(self).items()
        }


def angular_derivatives(quats: FloatArray, rate: float) -> tuple[float, float]:
    """Return the mean angular acceleration and jerk of some joints.

    Parameters
    ----------
    quats : ndarray, shape (n_frames, n_joints, 4)
        Local rotations, of at least four frames.
    rate : float
        Frames per second.

    Returns
    -------
    acceleration, jerk : float
        Mean magnitudes over joints and frames, in rad/s² and rad/s³.
    """
    ways = rotations.multiply(rotations.inverse(quats[:-1]), quats[1:])
    bends = np.diff(rotations.log(ways) * rate, axis=0) * rate
    jerks = np.diff(bends, axis=0) * rate
    acceleration, jerk = (float(np.linalg.norm(v, axis=-1).mean()) for v in (bends, jerks))
    return acceleration, jerk


def quality(method: str, grafts: Sequence[Sequence[Graft]], seed: int = 0) -> Quality:
    """Measure grafts.

    Parameters
    ----------
    method : str
        How they were made.
    grafts : sequence of sequence of Graft
        Of one library: for each base those made on it.
    seed : int
        Of the resampling behind the intervals.

    Returns
    -------
    Quality
        What a skeleton cannot tell, as coordination without known arms, is NaN of 0 samples.

    Raises
    ------
    InsufficientDataError
        If there is no graft or a base has fewer than four frames.

    Notes
    -----
    Coverage and local diversity are those of GANimator (Li et al., ACM Transactions on
    Graphics 41, 2022) over the grafted joints at 10 frames a second, with a window near to
    another where the mean L2 distance of 6D rotations is below 2. Acceleration and jerk of
    stretched donors change with the stretch. All is relative to the library: whatever is
    wrong with the recording is right here.
    """
    if not grafts or not all(grafts):
        raise InsufficientDataError("quality needs at least one graft on every base")
    library = grafts[0][0].library
    skeleton = library.skeleton
    joints = _grafted(grafts[0][0])
    source = [_coarse(clip, joints) for clip in library.clips]
    step = math.ceil(sum(map(len, source)) / _MOST)
    rows: dict[str, list[float]] = {name: [] for name in Quality.__dataclass_fields__}
    new: list[float] = []
    gaps: list[float] = []
    clip_of: list[int] = []
    block_of: list[int] = []
    for index, own in enumerate(grafts):
        base = own[0].base
        if base.n_frames < 4:
            raise InsufficientDataError(
                f"quality needs 4 frames to differentiate, {base.name} has {base.n_frames}"
            )
        track = base.rotations[:, joints]
        before = angular_derivatives(track, base.rate)
        ground = Ground.of(base)
        skates = skating_share(base, ground)
        swings = coordination(base)
        rows["diversity"].append(diversity([graft.motion for graft in own], joints))
        for graft in own:
            new += [float(not s.is_own) for s in graft.substitutions]
            block_of += [100_000 * index + s.segment // estimate.BLOCK for s in graft.substitutions]
            gaps += [math.degrees(seam.gap) for seam in graft.seams]
            clip_of += [100_000 * index + seam.frame // 75 for seam in graft.seams]
            after = angular_derivatives(graft.motion.rotations[:, joints], base.rate)
            for name, a, b in zip(("acceleration", "jerk"), after, before, strict=True):
                rows[name].append(a / b if b > 0 else math.nan)
            if find_legs(skeleton):
                rows["foot_skate"].append(skating_share(graft.motion, ground) - skates)
            covered, local = nearest_windows(source, _coarse(graft.motion, joints), step)
            rows["coverage"].append(covered)
            rows["local_diversity"].append(local)
            now = coordination(graft.motion)
            rows["coordination"].append(now[0] - swings[0])
            rows["lag"].append(now[1] - swings[1])

    def over_grafts(name: str) -> Estimate:
        return estimate.mean(rows[name], np.arange(len(rows[name])), "grafts", seed)

    wide = np.array(gaps)
    p90 = float(np.percentile(wide, 90)) if len(wide) else math.nan
    return Quality(
        method=method,
        runs=len(grafts[0]),
        new_segments=estimate.mean(new, block_of, "parts", seed),
        seam_gap=estimate.mean(gaps, clip_of, "seams", seed),
        seam_gap_p90=_percentile(wide, np.array(clip_of), p90, seed),
        acceleration=over_grafts("acceleration"),
        jerk=over_grafts("jerk"),
        foot_skate=over_grafts("foot_skate"),
        coverage=over_grafts("coverage"),
        local_diversity=over_grafts("local_diversity"),
        diversity=estimate.mean(
            rows["diversity"], np.arange(len(rows["diversity"])), "bases", seed
        ),
        coordination=over_grafts("coordination"),
        lag=over_grafts("lag"),
    )


def _percentile(values: FloatArray, block: IntArray, whole: float, seed: int) -> Estimate:
    """Return the 90th percentile with an interval that resamples blocks."""
    own, index = np.unique(block, return_inverse=True)
    order = np.argsort(values, kind="stable")

    def weighted(drawn: FloatArray) -> FloatArray:
        found = np.empty(len(drawn))
        for at, row in enumerate(drawn):
            weight = np.cumsum(row[index[order]])
            found[at] = values[order][np.searchsorted(weight, 0.9 * weight[-1])]
        return found

    how = f"bootstrap of {len(own)} blocks"
    if len(own) < estimate.FEWEST:
        return Estimate(whole, math.nan, math.nan, len(values), "seams", how)
    low, high = estimate.bootstrap(weighted, len(own), seed)
    return Estimate(whole, float(low[0]), float(high[0]), len(values), "seams", how)


def _grafted(graft: Graft) -> IntArray:
    library = graft.library
    skeleton = library.skeleton
    every = [feature_joints(skeleton, library.joints(group)) for group in graft.alternatives]
    return np.unique(np.concatenate(every))


def _coarse(motion: Motion, joints: IntArray) -> FloatArray:
    """Return 6D rotations at some ten frames a second, shape (n_frames, 6 · n_joints).

    Two columns of the rotation matrix (Zhou et al., CVPR 2019).
    """
    frames = np.arange(0, motion.n_frames, max(round(motion.rate / _COARSE), 1))
    x, y, z, w = np.moveaxis(motion.rotations[frames][:, joints], -1, 0)
    first = [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)]
    second = [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)]
    return np.stack([*first, *second], axis=-1).reshape(len(frames), -1)


def nearest_windows(
    source: Sequence[FloatArray], made: FloatArray, step: int = 1
) -> tuple[float, float]:
    """Return how much of a source a motion covers, and how far it is from it.

    Parameters
    ----------
    source : sequence of ndarray, each of shape (n_frames, n_features)
        6D rotations of every clip at 10 frames a second.
    made : ndarray, shape (n_made, n_features)
        Those of the motion.
    step : int
        Every so manieth window of the source is looked at.

    Returns
    -------
    coverage : float
        Share of the source's windows of one second that some window of the motion is nearer
        to than 2, in mean L2 distance per frame; NaN where none is as long.
    local : float
        Mean distance of the motion's windows of half a second to the source's nearest, as
        root mean square per joint.
    """
    cover, local = round(_COVER * _COARSE), round(_LOCAL * _COARSE)
    if len(made) < cover:
        return math.nan, math.nan
    covered: list[FloatArray] = []
    nearest = np.full(len(made) - local + 1, np.inf)
    norms = (made**2).sum(axis=1)
    for own in source:
        if len(own) < cover:
            continue
        squared = (own**2).sum(axis=1)[:, None] + norms - 2.0 * own @ made.T
        apart = np.sqrt(np.maximum(squared, 0.0))
        covered.append(_along(apart, cover, step).min(axis=1))
        nearest = np.minimum(nearest, _along(apart, local, step).min(axis=0))
    if not covered:
        return math.nan, math.nan
    n_joints = made.shape[1] / 6
    near = np.concatenate(covered) < _COVERED
    return float(near.mean()), float(nearest.mean() / math.sqrt(n_joints))


def _along(apart: FloatArray, length: int, step: int) -> FloatArray:
    """Return mean distances of windows from those of frames, by sums along diagonals."""
    rows, columns = apart.shape[0] - length + 1, apart.shape[1] - length + 1
    total = np.zeros((len(range(0, rows, step)), columns))
    for offset in range(length):
        total += apart[offset : offset + rows : step, offset : offset + columns]
    return total / length


def diversity(motions: Sequence[Motion], joints: IntArray) -> float:
    """Return the mean joint angle between motions at the same time.

    Parameters
    ----------
    motions : sequence of Motion
        Of one length.
    joints : ndarray of int
        The joints.

    Returns
    -------
    float
        In degrees, over all pairs; NaN of a single motion.
    """
    if len(motions) < 2:
        return math.nan
    apart = [
        rotations.angle(a.rotations[:, joints], b.rotations[:, joints]).mean()
        for i, a in enumerate(motions)
        for b in motions[:i]
    ]
    return float(np.degrees(np.mean(apart)))


def coordination(motion: Motion) -> tuple[float, float]:
    """Return how the arms swing with the opposite legs.

    Parameters
    ----------
    motion : Motion
        The motion.

    Returns
    -------
    correlation : float
        Magnitude of the correlation of how fast an upper arm and the opposite thigh swing
        forwards, seen from the hips, mean of both pairs; NaN where they are not known or do
        not move.
    lag : float
        Seconds, up to 0.5 either way, by which the leg's swing is to be shifted for the
        correlation to be the strongest, mean magnitude of both pairs.
    """
    pairs = _limbs(motion.skeleton)
    if not pairs or motion.n_frames < 8:
        return math.nan, math.nan
    places = motion.world_positions()
    up = np.eye(3)[up_axis(motion)]
    (_, (right, _)), (_, (left, _)) = pairs
    ahead = _direction(np.cross(places[:, left] - places[:, right], up))
    found = []
    most = max(round(_LAG * motion.rate), 1)
    for pair in pairs:
        # The part of a limb's direction that points ahead needs no angle that could wrap.
        a, b = (
            np.gradient((_direction(places[:, end] - places[:, top]) * ahead).sum(axis=1))
            for top, end in pair
        )
        if a.std() < 1e-9 or b.std() < 1e-9 or len(a) < 2 * most + 4:
            return math.nan, math.nan
        lags = np.arange(-most, most + 1)
        strength = np.abs([_correlation(a, b, int(lag)) for lag in lags])
        found.append((strength[most], abs(int(lags[strength.argmax()])) * motion.frame_time))
    correlation, lag = np.mean(found, axis=0)
    return float(correlation), float(lag)


def _correlation(a: FloatArray, b: FloatArray, lag: int) -> float:
    x, y = (a[lag:], b[: len(b) - lag]) if lag >= 0 else (a[:lag], b[-lag:])
    spread = x.std() * y.std()
    return float(((x - x.mean()) * (y - y.mean())).mean() / spread) if spread > 0 else 0.0


def _limbs(skeleton: Skeleton) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return arms with the opposite legs, each as the joints at both ends of its upper bone."""
    known = anatomy(skeleton)
    if not known.human:
        return []
    pairs = []
    for arm_side, leg_side in (("left", "right"), ("right", "left")):
        ends = [
            known.joints(part, side=side)
            for part, side in (
                ("upper_arm", arm_side),
                ("forearm", arm_side),
                ("thigh", leg_side),
                ("shank", leg_side),
            )
        ]
        if not all(ends):
            return []
        upper, fore, thigh, shank = (int(own[0]) for own in ends)
        pairs.append(((upper, fore), (thigh, shank)))
    return pairs


def _direction(vectors: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    units: FloatArray = vectors / np.maximum(lengths, 1e-12)
    return units
