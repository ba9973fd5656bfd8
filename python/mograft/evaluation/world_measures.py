"""Measures of grafts in the world: feet, balance, novelty, and the jerk of head, chest and hands.

The spine of a donor compensates for the movement of its own pelvis. On the pelvis of the base this
can make the head sway, which joint rotations do not show. These measures therefore use world
positions of body parts.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache
from itertools import pairwise, starmap

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft._util.verdict import compare
from mograft.body.contacts import Ground, skating_share
from mograft.body.support_polygon import Support, support_polygons
from mograft.errors import InsufficientDataError
from mograft.evaluation import body_tracks, estimate
from mograft.evaluation.balance import Balance, dynamic_balance, graft_balance
from mograft.evaluation.estimate import Estimate, MethodRecord, Record
from mograft.evaluation.novelty import Novelty, novelty
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.synthesis.graft_result import Graft

_LANDMARKS = ("head", "chest", "hands")
_MIN_PARTS = 4  # parts of a base from which a range is computed
UNDER_FLOOR = 0.012  # depth below its floor, in heights, from which a heel or toe is counted


_COLUMNS = {
    **{f"{name} jerk, ratio": (f"{name}_jerk", 1.0, ".2f", "") for name in _LANDMARKS},
    "floor depth": ("floor_depth", 100.0, "+z.2f", " %"),
    "foot skate": ("skate", 100.0, "+z.1f", " points"),
    "out of balance": ("balance", 100.0, "+z.1f", " points"),
}
"""Field, factor, format and unit of each column that `WorldMeasures.columns` returns."""


@dataclass(frozen=True)
class WorldMeasures(Record):
    """Measures of the world positions of one graft, relative to its base and its donors.

    A measure is NaN if the skeleton has no known joint for it. Lengths are in skeleton heights.

    Attributes
    ----------
    head_jerk, chest_jerk, hands_jerk : float
        Median jerk of the ends of the head, chest and hand bones over the exchanged frames,
        divided by the geometric mean of the medians of the base and of the donors. 1 if no
        frame is exchanged.
    floor_depth : float
        Largest depth of a heel or toe below its floor height, minus that of the base.
    under_floor : float
        Share of heels and toes, among those in all frames, more than 0.012 below their floor
        height, minus that of the base.
    skate : float
        Share of sliding feet among the feet in all frames, minus that of the base; see
        `mograft.foot_skate`.
    balance : float
        Share of the exchanged frames with the zero-moment point outside of the support polygon,
        minus that of the base. Only frames in which graft and base are both grounded count; see
        `Balance`.
    frames : int
        Number of exchanged frames.
    ranges : dict of str to tuple of float
        For each measure, the range of the middle half of the parts of the base, each compared with
        the whole base. There are at least four parts, of about five seconds in a long base.
    """

    head_jerk: float
    chest_jerk: float
    hands_jerk: float
    floor_depth: float
    under_floor: float
    skate: float
    balance: float
    frames: int
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def columns(self) -> dict[str, str]:
        """Return a text for each measure, its value and verdict, by the title of the measure."""
        found = {}
        for title, (name, factor, digits, suffix) in _COLUMNS.items():
            value = factor * getattr(self, name)
            found[title] = f"{value:{digits}}{suffix}" if math.isfinite(value) else "none"
            if math.isfinite(value) and name in self.ranges:
                low, high = (factor * end for end in self.ranges[name])
                found[title] += f" ({compare(value, low, high, digits)})"
        return found


def world_measures(graft: Graft) -> WorldMeasures:
    """Measure jerk, feet and balance of a graft by its world positions.

    Parameters
    ----------
    graft : Graft
        The graft to measure.

    Returns
    -------
    WorldMeasures
        Measures relative to those of the base and the donors.

    Raises
    ------
    ImportError
        If SciPy is not installed.

    Notes
    -----
    Jerk is the third difference of positions at about 30 samples per second. Computing the
    measures takes a similar time as computing the graft, so `mograft graft` does it only on
    request.

    Examples
    --------
    >>> from mograft import Library, graft
    >>> from mograft.dancer import dance
    >>> measures = world_measures(graft(Library.build(dance(strides=1).motion)))
    >>> measures.floor_depth, measures.skate  # The legs are in the base group.
    (0.0, 0.0)
    """
    return WorldReference(graft.library).measure(graft)


@dataclass(frozen=True)
class WorldQuality(MethodRecord):
    """World-space measures of the grafts of one method; see `WorldMeasures` for each.

    Attributes
    ----------
    method : str
        Name of the method that selected the donors.
    runs : int
        Number of grafts for each base.
    head_jerk, chest_jerk, hands_jerk : Estimate
        Mean over the grafts of the ratio of the jerk to that of base and donors.
    floor_depth, under_floor, skate, balance : Estimate
        Mean over the grafts of the difference from the base. `floor_depth` is in skeleton
        heights, the others are shares.
    novelty : Novelty
        Novelty, coverage and diversity.
    """

    head_jerk: Estimate
    chest_jerk: Estimate
    hands_jerk: Estimate
    floor_depth: Estimate
    under_floor: Estimate
    skate: Estimate
    balance: Estimate
    novelty: Novelty


def world_quality(method: str, grafts: Sequence[Sequence[Graft]], seed: int = 0) -> WorldQuality:
    """Measure the grafts of one method by their world positions.

    Parameters
    ----------
    method : str
        Name of the method that selected the donors.
    grafts : sequence of sequence of Graft
        For each base, its grafts; all from one library.
    seed : int
        Seed of the resampling.

    Returns
    -------
    WorldQuality
        Measures for which the skeleton has no known joints are NaN with a sample size of 0. The
        intervals resample grafts, and blocks of five seconds for `WorldQuality.novelty`.

    Raises
    ------
    ImportError
        If SciPy is not installed.
    InsufficientDataError
        If there is no graft, or the clips are too short for `novelty`.
    """
    if not grafts or not all(grafts):
        raise InsufficientDataError("world-space measures need at least one graft on every base")
    reference = WorldReference(grafts[0][0].library)
    measured = [vars(reference.measure(graft)) for several in grafts for graft in several]
    blocks = range(len(measured))
    means = {
        name: estimate.block_mean([own[name] for own in measured], blocks, "grafts", seed)
        for name in measured[0].keys() - {"frames", "ranges"}
    }
    variety = novelty(grafts, seed)
    return WorldQuality(method=method, runs=len(grafts[0]), novelty=variety, **means)


class WorldReference:
    """The recordings that grafts of one library are compared with.

    The jerks of a clip are computed once. The measures of a base are kept until a graft on another
    base is measured.
    """

    def __init__(self, library: Library) -> None:
        self.blocks = body_tracks.FrameBlocks.of(library)
        self._base = lru_cache(maxsize=1)(_Base)
        self._clip_jerks = cache(lambda clip: _landmark_jerks(library.clips[clip]))

    def measure(self, graft: Graft) -> WorldMeasures:
        """Return the measures of one graft; see `world_measures`."""
        groups, origin_of = graft.alternatives, body_tracks.Origin.of
        origins = {group: origin_of(graft, group, self.blocks) for group in groups}
        is_exchanged = np.any([origin.is_exchanged for origin in origins.values()], axis=0)
        base = self._base(graft.base)
        feet = _feet(graft.motion, base.ground)
        return WorldMeasures(
            **self._jerk_ratios(graft, base, origins),
            **{name: value - base.feet[name] for name, value in feet.items()},
            balance=base.added_imbalance(graft, is_exchanged),
            frames=int(is_exchanged.sum()),
            ranges=base.ranges,
        )

    def _jerk_ratios(
        self, graft: Graft, base: "_Base", origins: Mapping[str, body_tracks.Origin]
    ) -> dict[str, float]:
        """Return the fields `head_jerk`, `chest_jerk` and `hands_jerk` of `WorldMeasures`."""
        new = _landmark_jerks(graft.motion)
        margin = 2 * body_tracks.sample_stride(graft.motion.rate)
        inner = np.zeros(graft.motion.n_frames, bool)
        inner[margin : len(inner) - margin] = True
        ratios = {f"{name}_jerk": math.nan for name in _LANDMARKS}
        for name, joints in body_tracks.landmarks(graft.motion.skeleton).items():
            group = body_tracks.driving_group(graft, joints)
            used = inner if group is None else inner & origins[group].is_exchanged
            frames = np.flatnonzero(used if used.any() else inner)
            if not len(frames):
                continue
            captured = donors = base.jerks[name][frames]
            if group is not None:
                clip, frame = self.blocks.clip_of(origins[group].frames[frames])
                clips = np.unique(clip).tolist()
                jerks = [self._clip_jerks(own)[name][frame[clip == own]] for own in clips]
                donors = np.concatenate(jerks)
            medians = [float(np.median(j)) for j in (new[name][frames], captured, donors)]
            reference = math.sqrt(medians[1] * medians[2])
            if reference > 0:
                ratios[f"{name}_jerk"] = medians[0] / reference
        return ratios


class _Base:
    """A base motion and its own measures, with which those of its grafts are compared."""

    def __init__(self, motion: Motion) -> None:
        self.motion = motion
        self.ground, self.jerks = Ground.of(motion), _landmark_jerks(motion)
        self.feet = _feet(motion, self.ground)
        self.support: Support | None = None
        self.balance: Balance | None = None
        with suppress(InsufficientDataError):  # no known leg, or too few frames
            self.support = support_polygons(motion)
            self.balance = dynamic_balance(motion, support=self.support)

    def _measure(self, part: slice) -> dict[str, float]:
        """Return measures of some frames that are not compared with others; may have NaN."""
        found = {f"{name}_jerk": float(np.median(own[part])) for name, own in self.jerks.items()}
        found |= _feet(self.motion[part], self.ground)
        if self.balance is not None:
            is_out = self.balance.distance[part][self.balance.grounded[part]] > 0
            found["balance"] = float(is_out.mean()) if len(is_out) else math.nan
        return found

    @cached_property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """`WorldMeasures.ranges`; measures that the base does not have are left out."""
        n, whole = self.motion.n_frames, self._measure(slice(None))
        n_parts = round(self.motion.duration / body_tracks.BLOCK_SECONDS)
        edges = np.linspace(0, n, max(n_parts, min(_MIN_PARTS, n // 2)) + 1).astype(int).tolist()
        parts = [self._measure(part) for part in starmap(slice, pairwise(edges))]
        found = {}
        for name, own in whole.items():
            is_ratio, values = name.endswith("_jerk"), np.array([part[name] for part in parts])
            if not math.isfinite(own) or (is_ratio and own == 0.0):
                continue
            values = values / own if is_ratio else values - own
            # The whole base is within its range.
            ends = (*np.percentile(values[np.isfinite(values)], (25.0, 75.0)), float(is_ratio))
            found[name] = (float(min(ends)), float(max(ends)))
        return found

    def added_imbalance(self, graft: Graft, is_exchanged: BoolArray) -> float:
        """Return `WorldMeasures.balance`; NaN without known legs or frames to compare."""
        before = self.balance
        if before is None:
            return math.nan
        new = graft_balance("dynamic", graft, self.support)
        both = before.grounded & new.grounded
        used = both & is_exchanged if is_exchanged.any() else both
        if not used.any():
            return math.nan
        return float((new.distance[used] > 0).mean() - (before.distance[used] > 0).mean())


def _feet(motion: Motion, ground: Ground) -> dict[str, float]:
    """Return `WorldMeasures.floor_depth`, `under_floor` and `skate` without those of the base.

    The floor is that of `ground`. The values are NaN without a known leg.
    """
    if not ground.limbs:
        return dict.fromkeys(("floor_depth", "under_floor", "skate"), math.nan)
    depths = -ground.above(ground.points(motion)) / ground.height
    return {
        "floor_depth": max(float(depths.max()), 0.0),
        "under_floor": float((depths > UNDER_FLOOR).mean()),
        "skate": skating_share(motion, ground),
    }


def _landmark_jerks(motion: Motion) -> dict[str, FloatArray]:
    """Return the jerk of each landmark in skeleton heights/s³, shape (n_frames, n_joints)."""
    found = body_tracks.landmarks(motion.skeleton)
    joints = [joint for several in found.values() for joint in several]
    jerks = body_tracks.jerk(body_tracks.bone_ends(motion, joints), motion.rate)
    edges = np.cumsum([len(several) for several in found.values()])
    return dict(zip(found, np.split(jerks, edges[:-1], axis=1), strict=False))
