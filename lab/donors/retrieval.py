"""Retrieval: whether a rule finds, for a held-out base part, the part that it was captured with."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lab.donors import held_out
from lab.donors.methods import grafted_group
from lab.donors.retrieval_trials import BEST, RULES, PartErrors, Trials, make_queries
from mograft import InsufficientDataError
from mograft.evaluation import estimate
from mograft.evaluation.estimate import Estimate, Record

MIN_SEGMENTS = 60
_N_SHUFFLES = 40
_MAX_SEGMENTS = 2500  # limits memory and run time, which grow with the square


@dataclass(frozen=True)
class RuleScore(Record):
    """How near the donors of one rule are to the part that was captured with the base part.

    A null is the result if the parts of the segments are shuffled: the mean over the shuffles, with
    the range of 95 % of them as interval.

    Attributes
    ----------
    rule : str
        One of `RULES`, or "best possible": the allowed donors whose parts are nearest.
    donors : Estimate
        Number of donors that the rule selects.
    angle : Estimate
        Mean joint angle, in radians, between the parts of these donors and the captured part.
    distance : Estimate
        Mean distance of their bone ends from those of the captured part, in skeleton heights, with
        both parts attached to the captured base part.
    angle_gain, distance_gain : Estimate
        Mean distance of the parts of these donors from the parts of all segments, minus their
        distance from the captured part. A donor whose part is near to all others does not gain.
    angle_null, distance_null : Estimate
        The gains if the parts of all segments are shuffled.
    rank : Estimate
        Relative rank, in the order of the rule, of the allowed donor with the nearest part: 0 is
        the first place, 0.5 is chance.
    """

    rule: str
    donors: Estimate
    angle: Estimate
    distance: Estimate
    angle_gain: Estimate
    angle_null: Estimate
    distance_gain: Estimate
    distance_null: Estimate
    rank: Estimate


@dataclass(frozen=True)
class Advantage(Record):
    """Gain of "analogy" minus that of another rule, on the same segments, with null results.

    Positive values are in favour of "analogy". For `angle_null_within`, parts are shuffled within
    each clip or block; for the other nulls, among all segments. The interval of a null is the range
    of 95 % of the shuffles.
    """

    rule: str
    angle: Estimate  # radians
    angle_null: Estimate
    angle_null_within: Estimate
    distance: Estimate  # skeleton heights
    distance_null: Estimate


@dataclass(frozen=True)
class Retrieval(Record):
    """Result of `retrieval`.

    Attributes
    ----------
    group : str
        Grafted group.
    segments : int
        Number of held-out segments for which "analogy" has a donor; only these are measured.
    held_out : int
        Number of held-out segments with an allowed donor.
    groups : int
        Number of clips or blocks of segments, which are resampled for the intervals.
    scores : tuple of RuleScore
        Scores of each rule and of "best possible".
    advantages : tuple of Advantage
        Comparison of each other rule with "analogy".
    """

    group: str
    segments: int
    held_out: int
    groups: int
    scores: tuple[RuleScore, ...]
    advantages: tuple[Advantage, ...]

    def advantage(self, rule):
        """Return the comparison with a rule; raise KeyError if it was not measured."""
        for advantage in self.advantages:
            if advantage.rule == rule:
                return advantage
        raise KeyError(f"the rule {rule!r} was not measured")


def retrieval(library, group=None, *, seed=0):
    """Test whether similar base parts have similar other parts, without a classifier.

    The grafted part of every segment is removed. Each rule then selects, for the base part that
    remains, parts of other folds of the library (see Notes). The errors are the distances of the
    selected parts from the removed one.

    Parameters
    ----------
    library : Library
        Library to measure. Segments with recording faults are not used.
    group : str, optional
        Grafted group. Default: the first group that is not the base group.
    seed : int
        Seed of the folds, of the shuffles and of the resampling.

    Returns
    -------
    Retrieval
        Scores of the rules, and their comparison with the rule of the paper on the same segments
        with as many donors. The intervals resample clips, or blocks of 20 segments if there are
        fewer than ten clips. They do not account for the choice of the recordings.

    Raises
    ------
    InsufficientDataError
        If fewer than 60 segments have no faults, if they are all in one clip or block, if a group
        has no embedding, or if no held-out segment has a donor.
    ValueError
        If `group` is the base group or unknown.

    Notes
    -----
    The clips or blocks are assigned to five folds. For each fold, mean rotations, principal
    components, cluster diameter threshold and clusters are computed from the other folds, and all
    donors are in the other folds. Allowed donors have a similar length (eq. 19). "analogy" selects
    those in the cluster that the held-out base part joins. Every other rule except "ball" selects
    as many allowed donors as "analogy" has. "random" draws them at random; its errors are the means
    over all allowed donors, which is the expected value. "contact pattern" selects the donors whose
    foot contacts differ least at ten instants; "nearest neighbours" those with the nearest base
    parts in the embedding; "linear regression" those whose part is nearest to the part that a ridge
    regression predicts from the base part (both embedded). "ball" selects the donors in the ball of
    `Config.neighbourhood`, and is compared on segments for which it has a donor. Errors are
    computed from joint rotations and bone ends of the recordings, not from the embeddings.
    """
    group = grafted_group(library, group)
    groups = held_out.fold_groups(library)
    library = _limit_segments(library, groups, seed)
    segments = np.flatnonzero(library.is_donor)
    if len(segments) < MIN_SEGMENTS:
        raise InsufficientDataError(
            f"retrieval needs {MIN_SEGMENTS} segments without faults, there are {len(segments)}"
        )
    if len(np.unique(groups[segments])) < 2:
        raise InsufficientDataError("retrieval needs at least two clips or blocks of segments")
    queries = make_queries(library, group, groups, seed)
    measured = [query for query in queries if query.n_donors]
    if not measured:
        raise InsufficientDataError("no held-out segment joins the cluster of a donor")
    trials = Trials.of(measured)
    errors = PartErrors.of(library, group)
    rng = np.random.default_rng(seed)
    captured = trials.measure(errors, np.arange(len(groups)), has_best=True)
    nulls = [
        [
            trials.measure(errors, held_out.shuffle_parts(library.is_donor, rng, within))
            for _ in range(_N_SHUFFLES)
        ]
        for within in (None, groups)
    ]
    summary = _Summary(groups[trials.segment], seed, captured, *nulls)
    return Retrieval(
        group=group,
        segments=len(measured),
        held_out=len(queries),
        groups=len(np.unique(groups[segments])),
        scores=tuple(summary.score(rule, trials.n_donors(rule)) for rule in captured),
        advantages=tuple(summary.advantage(rule) for rule in RULES[:-1] if rule in captured),
    )


def _limit_segments(library, groups, seed):
    """Return the library with at most 2,500 donors, all from random clips or blocks."""
    order = np.random.default_rng(seed).permutation(int(groups.max()) + 1)
    sizes = np.bincount(groups[library.is_donor], minlength=len(order))[order]
    kept = order[np.cumsum(sizes) <= _MAX_SEGMENTS]
    return replace(library, is_donor=library.is_donor & np.isin(groups, kept))


@dataclass(frozen=True, eq=False)
class _Summary:
    """Means of the results of `Trials.measure`, with intervals that resample blocks."""

    blocks: np.ndarray  # of each query
    seed: int
    captured: Mapping[str, np.ndarray]
    shuffled: Sequence[Mapping[str, np.ndarray]]
    shuffled_within: Sequence[Mapping[str, np.ndarray]]

    def _mean(self, values):
        return estimate.block_mean(values, self.blocks, "segments", self.seed)

    def score(self, rule, n_donors):
        """Return the means of one rule."""
        angle, distance, angle_gain, distance_gain, rank = (
            self._mean(column) for column in self.captured[rule].T
        )
        # The choice of "best possible" depends on the parts, so its gains are not 0 by chance.
        null = np.full((1, 5), np.nan)
        if rule != BEST:
            null = np.array([np.nanmean(own[rule], axis=0) for own in self.shuffled])
        return RuleScore(
            rule=rule,
            donors=self._mean(n_donors),
            angle=angle,
            distance=distance,
            angle_gain=angle_gain,
            angle_null=_range(null[:, 2]),
            distance_gain=distance_gain,
            distance_null=_range(null[:, 3]),
            rank=rank,
        )

    def advantage(self, rule):
        """Return the differences between the gains of "analogy" and those of another rule."""

        def difference(own):
            return (own["analogy"] - own[rule])[:, 2:4]

        angle, distance = (self._mean(column) for column in difference(self.captured).T)
        null, within = (
            np.array([np.nanmean(difference(own), axis=0) for own in several])
            for several in (self.shuffled, self.shuffled_within)
        )
        return Advantage(
            rule=rule,
            angle=angle,
            angle_null=_range(null[:, 0]),
            angle_null_within=_range(within[:, 0]),
            distance=distance,
            distance_null=_range(null[:, 1]),
        )


def _range(values):
    """Return the mean of the results of shuffles with the range of 95 % of them as interval.

    The estimate has no value if a result is not finite.
    """
    if not np.isfinite(values).all():
        return Estimate.without_value(0, "shuffles", "range of 95 % of the shuffles")
    low, high = np.percentile(values, [2.5, 97.5])
    return Estimate(
        value=float(values.mean()),
        low=float(low),
        high=float(high),
        n=len(values),
        unit="shuffles",
        interval_method="range of 95 % of the shuffles",
    )
