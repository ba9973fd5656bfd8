"""Measures of one graft in the world: jerk of head, chest and hands, feet, and balance.

Joint rotations do not show how the head moves if the spine of the donor compensates for the
movement of another pelvis. These measures therefore use the world positions of body parts.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.body.contacts import Ground, find_legs, skating_share
from mograft.body.support_polygon import Support, support_polygons
from mograft.errors import InsufficientDataError
from mograft.evaluation.balance import Balance, dynamic_balance
from mograft.evaluation.body_tracks import (
    FrameBlocks,
    Origin,
    bone_ends,
    driving_group,
    jerk,
    landmarks,
    sample_stride,
)
from mograft.evaluation.estimate import Record
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.synthesis.graft_result import Graft

UNDER_FLOOR = 0.012  # depth below its floor, in heights, from which a heel or toe is counted


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
    """

    head_jerk: float
    chest_jerk: float
    hands_jerk: float
    floor_depth: float
    under_floor: float
    skate: float
    balance: float
    frames: int

    def columns(self) -> dict[str, str]:
        """Return the measures as text, by title."""
        jerks = {
            f"{name} jerk, ratio": (getattr(self, f"{name}_jerk"), ".2f", "")
            for name in ("head", "chest", "hands")
        }
        added = {
            "floor depth": (100 * self.floor_depth, "+.2f", " %"),
            "foot skate": (100 * self.skate, "+.1f", " points"),
            "out of balance": (100 * self.balance, "+.1f", " points"),
        }
        return {
            title: f"{value:{digits}}{suffix}" if math.isfinite(value) else "none"
            for title, (value, digits, suffix) in (jerks | added).items()
        }


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


@dataclass(frozen=True, eq=False)
class WorldReference:
    """The recordings that grafts of one library are compared with.

    The jerks of a clip are computed once. The measures of a base are kept until a graft on another
    base is measured.
    """

    library: Library
    _jerks: dict[int, dict[str, FloatArray]] = field(default_factory=dict)
    _bases: list["_Base"] = field(default_factory=list)

    def measure(self, graft: Graft) -> WorldMeasures:
        """Return the measures of one graft; see `world_measures`."""
        blocks = FrameBlocks.of(self.library)
        origins = {group: Origin.of(graft, group, blocks) for group in graft.alternatives}
        is_exchanged = np.any([origin.is_exchanged for origin in origins.values()], axis=0)
        base = self._base(graft.base)
        feet = _Feet.of(graft.motion, base.ground)
        return WorldMeasures(
            **self._jerk_ratios(graft, origins, blocks),
            floor_depth=feet.depth - base.feet.depth,
            under_floor=feet.under - base.feet.under,
            skate=feet.skate - base.feet.skate,
            balance=base.added_imbalance(graft, is_exchanged),
            frames=int(is_exchanged.sum()),
        )

    def _base(self, motion: Motion) -> "_Base":
        if not self._bases or self._bases[0].motion is not motion:
            self._bases[:] = [_Base(motion)]
        return self._bases[0]

    def _jerk_ratios(
        self, graft: Graft, origins: Mapping[str, Origin], blocks: FrameBlocks
    ) -> dict[str, float]:
        """Return the fields `head_jerk`, `chest_jerk` and `hands_jerk` of `WorldMeasures`."""
        new, base = _landmark_jerks(graft.motion), self._base(graft.base).jerks
        margin = 2 * sample_stride(graft.motion.rate)
        inner = np.zeros(graft.motion.n_frames, bool)
        inner[margin : len(inner) - margin] = True
        ratios = {f"{name}_jerk": math.nan for name in ("head", "chest", "hands")}
        for name, joints in landmarks(graft.motion.skeleton).items():
            group = driving_group(graft, joints)
            used = inner if group is None else inner & origins[group].is_exchanged
            frames = np.flatnonzero(used if used.any() else inner)
            if not len(frames):
                continue
            donors = base[name][frames]
            if group is not None:
                donors = self._donor_jerks(name, origins[group].frames[frames], blocks)
            medians = [float(np.median(j)) for j in (new[name][frames], base[name][frames], donors)]
            reference = math.sqrt(medians[1] * medians[2])
            if reference > 0:
                ratios[f"{name}_jerk"] = medians[0] / reference
        return ratios

    def _donor_jerks(self, name: str, frames: IntArray, blocks: FrameBlocks) -> FloatArray:
        """Return the jerk of the landmark `name` at frames that are numbered over all clips."""
        clip, frame = blocks.clip_of(frames)
        found = np.empty((len(frames), *self._clip_jerks(int(clip[0]))[name].shape[1:]))
        for index in np.unique(clip).tolist():
            found[clip == index] = self._clip_jerks(index)[name][frame[clip == index]]
        return found

    def _clip_jerks(self, clip: int) -> dict[str, FloatArray]:
        if clip not in self._jerks:
            self._jerks[clip] = _landmark_jerks(self.library.clips[clip])
        return self._jerks[clip]


@dataclass(frozen=True, eq=False)
class _Base:
    """A base, with the measures that its grafts are compared with."""

    motion: Motion

    @cached_property
    def ground(self) -> Ground:
        return Ground.of(self.motion)

    @cached_property
    def jerks(self) -> dict[str, FloatArray]:
        return _landmark_jerks(self.motion)

    @cached_property
    def feet(self) -> "_Feet":
        return _Feet.of(self.motion, self.ground)

    @cached_property
    def support(self) -> Support:
        return support_polygons(self.motion)

    @cached_property
    def balance(self) -> Balance:
        return dynamic_balance(self.motion, support=self.support)

    def added_imbalance(self, graft: Graft, is_exchanged: BoolArray) -> float:
        """Return `WorldMeasures.balance`; NaN without known legs or frames to compare."""
        try:
            before = self.balance
        except InsufficientDataError:  # no known leg, or too few frames
            return math.nan
        support = self.support if has_base_legs(graft) else None
        new = dynamic_balance(graft.motion, support=support, floor_reference=self.motion)
        both = before.grounded & new.grounded
        used = both & is_exchanged if is_exchanged.any() else both
        if not used.any():
            return math.nan
        return float((new.distance[used] > 0).mean() - (before.distance[used] > 0).mean())


@dataclass(frozen=True)
class _Feet:
    """Measures of the feet of a motion relative to a given floor; NaN without a known leg."""

    depth: float  # largest depth of a heel or toe below its floor, in heights; 0 above the floor
    under: float  # share of heels and toes deeper than UNDER_FLOOR below their floor
    skate: float

    @classmethod
    def of(cls, motion: Motion, ground: Ground) -> "_Feet":
        if not ground.limbs:
            return cls(math.nan, math.nan, math.nan)
        depths = -ground.above(ground.points(motion)) / ground.height
        return cls(
            depth=max(float(depths.max()), 0.0),
            under=float((depths > UNDER_FLOOR).mean()),
            skate=skating_share(motion, ground),
        )


def has_base_legs(graft: Graft) -> bool:
    """Return whether all joints of the legs and their ancestors move as in the base."""
    ends = [leg.ankle if leg.toe is None else leg.toe for leg in find_legs(graft.base.skeleton)]
    joints = sorted({j for end in ends for j in (end, *graft.base.skeleton.ancestors(end))})
    new, base = graft.motion, graft.base
    return np.array_equal(new.rotations[:, joints], base.rotations[:, joints]) and np.array_equal(
        new.positions[:, joints], base.positions[:, joints]
    )


def _landmark_jerks(motion: Motion) -> dict[str, FloatArray]:
    """Return the jerk of each landmark in skeleton heights/s³, shape (n_frames, n_joints)."""
    found = landmarks(motion.skeleton)
    joints = [joint for several in found.values() for joint in several]
    jerks = jerk(bone_ends(motion, joints), motion.rate)
    tracks, first = {}, 0
    for name, several in found.items():
        tracks[name] = jerks[:, first : first + len(several)]
        first += len(several)
    return tracks
