"""How well donors' parts go with the parts they join: what can be said without people (5.3).

A classifier learns to tell parts that were captured together from parts that were not. What it
says of an exchanged part is its compatibility with the base: whether such a combination occurs
in the database. It is no judgement of naturalness: it sees no seams and no physics, and a good
combination that was never captured scores low.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.body.anatomy import feature_joints
from mograft.body.mass import mass_model
from mograft.errors import InsufficientDataError
from mograft.evaluation import estimate
from mograft.evaluation._extra import needed
from mograft.evaluation.baselines import Method, donors_by, methods
from mograft.evaluation.estimate import Estimate
from mograft.library.library import Library
from mograft.motion import rotations

__all__ = [
    "Compatibility",
    "Difference",
    "Score",
    "compatibility",
    "fold_groups",
    "part_features",
]

FEWEST = 60
"""Segments below which nothing is learned."""
APART = 0.1
"""Least difference between captured and random parts in the share that is accepted."""
_BLOCK = 40
_FOLDS, _INNER = 5, 3
_COMPONENTS = 20
_SAMPLES = 10
_MOST = 600
"""Captured pairs that a classifier learns from, at most: its cost grows with their square."""
_PARTNERS, _PAIRS = 20, 10_000
"""Donors that are looked at for one segment, and pairs in one fold, at most."""
_DRAWS = 20
_GRID = {"C": (0.3, 1.0, 3.0, 10.0, 30.0), "gamma": (0.003, 0.01, 0.03, 0.1)}


@dataclass(frozen=True)
class Score:
    """How compatible the donors are that one way lets into segments' places.

    Attributes
    ----------
    method : str
        The way.
    accepted : Estimate
        Share of the exchanged parts that the classifier takes for captured ones.
    kappa : Estimate
        Normalised compatibility: 0 as random parts, 1 as captured ones, over all segments.
    matched : Estimate
        The same with random and captured parts of only those segments that have a donor:
        free of the gain from exchanging none but easy segments.
    exchangeable : float
        Share of the segments with a donor besides themselves among the held out.
    """

    method: str
    accepted: Estimate
    kappa: Estimate
    matched: Estimate
    exchangeable: float

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        return {
            "method": self.method,
            "accepted": self.accepted.as_dict(),
            "kappa": self.kappa.as_dict(),
            "kappa_matched": self.matched.as_dict(),
            "exchangeable": self.exchangeable,
        }


@dataclass(frozen=True)
class Difference:
    """By how much one way's kappa is above another's, both on the same resamplings.

    Attributes
    ----------
    first, second : str
        The two ways.
    kappa : Estimate
        First less second; outside of chance where its interval does not hold 0.
    """

    first: str
    second: str
    kappa: Estimate

    @property
    def verdict(self) -> str:
        """What the interval says: "above", "below" or "undecided"."""
        if not math.isfinite(self.kappa.low):
            return "undecided"
        if self.kappa.low > 0:
            return "above"
        return "below" if self.kappa.high < 0 else "undecided"

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        return {
            "first": self.first,
            "second": self.second,
            "kappa": self.kappa.as_dict(),
            "verdict": self.verdict,
        }


@dataclass(frozen=True)
class Compatibility:
    """What weak labels say of the parts of one joint group.

    Attributes
    ----------
    group : str
        The grafted group.
    segments, splits, folds, fold_groups : int
        How many segments, times that they were dealt into folds, folds of each, and clips or
        blocks that these are made of.
    auc : Estimate
        How often a captured part scores above a random one in the same place; 0.5 is chance.
    real, random : Estimate
        Shares of held-out captured and random parts that are accepted.
    scores : tuple of Score
        For each way to choose donors.
    differences : tuple of Difference
        Between them.
    parameters : tuple of dict
        The classifier's, chosen within each fold.
    """

    group: str
    segments: int
    splits: int
    folds: int
    fold_groups: int
    auc: Estimate
    real: Estimate
    random: Estimate
    scores: tuple[Score, ...]
    differences: tuple[Difference, ...]
    parameters: tuple[dict[str, float], ...]

    def difference(self, first: str, second: str) -> Difference:
        """Return the difference of two ways by name.

        Raises
        ------
        KeyError
            If one was not compared.
        """
        for own in self.differences:
            if (own.first, own.second) == (first, second):
                return own
        raise KeyError(f"{first} and {second} were not compared")

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        return {
            "group": self.group,
            "segments": self.segments,
            "splits": self.splits,
            "folds": self.folds,
            "fold_groups": self.fold_groups,
            "auc": self.auc.as_dict(),
            "accepted_captured": self.real.as_dict(),
            "accepted_random": self.random.as_dict(),
            "scores": [own.as_dict() for own in self.scores],
            "differences": [own.as_dict() for own in self.differences],
            "classifier": list(self.parameters),
        }


def fold_groups(library: Library) -> IntArray:
    """Return which segments must stay together in cross-validation.

    Parameters
    ----------
    library : Library
        Its segments.

    Returns
    -------
    ndarray of int, shape (n_segments,)
        Clips where there are ten or more, else blocks of 40 neighbours.
    """
    return estimate.blocks(library.segments, _BLOCK)


def part_features(library: Library, group: str) -> FloatArray:
    """Return what a joint group does in every segment, apart from how the library sees it.

    Parameters
    ----------
    library : Library
        The segments.
    group : str
        The joint group.

    Returns
    -------
    ndarray, shape (n_segments, n_features)
        At ten equal times the ends of the group's bones in heights and their velocities in
        heights per second: for the base group seen from the root with the heading of the
        segment's start, with the root's own way; for others from the joint that they hang on,
        as a graft takes them along. So no turn or place of the root is in both.
    """
    skeleton, cut = library.skeleton, library.segments
    joints = library.joints(group)
    counted = feature_joints(skeleton, joints)
    is_base = group == library.groups.base
    tops = [int(j) for j in joints if int(skeleton.parents[j]) not in set(joints.tolist())]
    hangs_on = max(int(skeleton.parents[tops[0]]), 0)
    rows: list[FloatArray] = []
    for index, clip in enumerate(library.clips):
        known = mass_model(clip.skeleton)
        turns, places = clip.world_transforms()
        ends = places[:, counted] + rotations.rotate(turns[:, counted], known.bone[counted])
        root = library.root if is_base else hangs_on
        local = (ends - places[:, root, None]) / known.height
        if is_base:
            way = places[:, root, None] / known.height
            local = np.concatenate([local, way], axis=1)
        else:
            local = rotations.rotate(rotations.inverse(turns[:, root, None]), local)
        speed = np.gradient(local, axis=0) * clip.rate
        own = cut.of_clip(index)
        times = cut.start[own, None] + np.linspace(0.0, 1.0, _SAMPLES) * cut.lengths[own, None]
        parts = [_at(track, times) for track in (local, speed)]
        if is_base:
            parts[0][:, :, -1] -= parts[0][:, :1, -1]
            back = rotations.inverse(rotations.twist(turns[cut.start[own], root], library.up))
            parts = [rotations.rotate(back[:, None, None], part) for part in parts]
        rows.append(np.concatenate([part.reshape(len(own), -1) for part in parts], axis=1))
    return np.concatenate(rows)


def _at(track: FloatArray, times: FloatArray) -> FloatArray:
    """Return a track between its frames."""
    before = np.minimum(times.astype(np.int64), len(track) - 2)
    share = (times - before)[..., None, None]
    values: FloatArray = track[before] * (1.0 - share) + track[before + 1] * share
    return values


def compatibility(
    library: Library,
    group: str | None = None,
    ways: Sequence[Method] | None = None,
    *,
    seed: int = 0,
    splits: int = 4,
    progress: Callable[[str, int, int], None] | None = None,
) -> Compatibility:
    """Score how well donors' parts go with the base parts that they join.

    Parameters
    ----------
    library : Library
        The segments; those with faults are left out.
    group : str, optional
        The grafted group. Default: the first that is not the base.
    ways : sequence of Method, optional
        Ways to choose donors. Default: `methods` of the library.
    seed : int
        Of the random pairs, the donors looked at and the resampling.
    splits : int
        How many times the groups are dealt into folds, at random; each has classifiers and
        random pairs of its own.
    progress : callable, optional
        Called with a stage's name, what is done of it and the whole.

    Returns
    -------
    Compatibility
        Its intervals resample blocks of segments or clips, and splits: they hold the choice
        of both, and not that of the recordings.

    Raises
    ------
    InsufficientDataError
        If there are fewer than 60 sound segments or two blocks of 40, or the classifier
        accepts captured parts hardly more often than random ones.
    ImportError
        If scikit-learn is not installed.

    Notes
    -----
    A classifier two-sample test (Lopez-Paz and Oquab, ICLR 2017) of whether the parts depend
    on each other. Positive are captured pairs, negative pairs of parts from one fold, each
    part once. A support vector machine on 20 principal components of `part_features` of each
    part learns on some clips or blocks and judges others; its parameters are chosen by
    cross-validation among the former alone. With a the share of pairs with a score above 0,
    κ = (a_way - a_random) / (a_captured - a_random).
    """
    base = library.groups.base
    group = next(g for g in library.groups.names if g != base) if group is None else group
    if group == base:
        raise ValueError(f"group must not be the base group, {group!r}, which is kept")
    ways = methods(library) if ways is None else ways
    sound = np.flatnonzero(library.is_donor)
    if len(sound) < FEWEST:
        raise InsufficientDataError(
            f"compatibility needs {FEWEST} segments to learn from, there are {len(sound)}"
        )
    together = fold_groups(library)
    n_groups = len(np.unique(together[sound]))
    if n_groups < 2:
        raise InsufficientDataError(
            f"compatibility needs two clips or blocks of {_BLOCK} segments, there is one"
        )
    needed("sklearn")
    lower, upper = (part_features(library, g) for g in (base, group))
    drawn = {way.name: _donors_drawn(library, group, way, seed) for way in ways if way.by_cost}
    n = len(library.segments)
    real, random, wins = (np.full((splits, n), np.nan) for _ in range(3))
    accepted = {way.name: np.full((splits, n), np.nan) for way in ways}
    parameters = []
    for split in range(splits):
        rng = np.random.default_rng((seed, split))
        folds = _split(together, _FOLDS, (seed, split))
        n_folds = int(folds.max()) + 1
        partners = _partners(library, ways, folds, drawn)
        for fold in range(n_folds):
            if progress is not None:
                progress("judging", split * n_folds + fold, splits * n_folds)
            train = sound[folds[sound] != fold]
            test = sound[folds[sound] == fold]
            if len(test) < 2 or len(train) < 10:
                continue
            machine, chosen = _trained(lower, upper, train, together, rng, seed)
            parameters.append(chosen)
            chance = _chance(test, rng)
            scores, against = machine(np.stack([test, test], axis=1)), machine(chance)
            real[split, test] = scores > 0
            random[split, test] = _by_segment(against > 0, chance, n)[test]
            of_real = np.full(n, np.nan)
            of_real[test] = scores
            better = against < of_real[chance[:, 0]]
            wins[split, test] = _by_segment(better, chance, n)[test]
            for way in ways:
                several = _within(partners[way.name], test, rng)
                calls = machine(several) > 0
                accepted[way.name][split, test] = _by_segment(calls, several, n)[test]
    judged = np.isfinite(real).any(axis=0)
    a_real, a_random = float(np.nanmean(real)), float(np.nanmean(random))
    if a_real - a_random < APART:
        raise InsufficientDataError(
            f"a classifier accepts {a_real:.0%} of held-out captured parts and {a_random:.0%} of "
            f"random ones: with less than {APART:.0%} between them compatibility has no meaning"
        )
    kappas = _Kappas(real, random, accepted, estimate.blocks(library.segments), seed)
    scores_of = tuple(
        Score(
            way.name,
            kappas.mean(accepted[way.name], "segments with a donor"),
            kappas.of(way.name),
            kappas.of(way.name, matched=True),
            float(np.isfinite(accepted[way.name])[:, judged].mean()),
        )
        for way in ways
    )
    names = [way.name for way in ways][::-1]
    return Compatibility(
        group,
        int(judged.sum()),
        splits,
        len(parameters) // splits,
        n_groups,
        kappas.mean(wins, "segments"),
        kappas.mean(real, "segments"),
        kappas.mean(random, "segments"),
        scores_of,
        tuple(kappas.difference(a, b) for i, a in enumerate(names) for b in names[i + 1 :]),
        tuple(parameters),
    )


def _split(together: IntArray, n_folds: int, seed: int | tuple[int, ...]) -> IntArray:
    """Deal groups of segments into folds of about equal size."""
    sizes = np.bincount(together)
    shuffled = np.random.default_rng(seed).permutation(len(sizes))
    order = shuffled[np.argsort(-sizes[shuffled], kind="stable")]
    n_folds = min(n_folds, int((sizes > 0).sum()))
    load = np.zeros(n_folds)
    fold = np.zeros(len(sizes), np.int64)
    for own in order.tolist():
        fold[own] = int(load.argmin())
        load[fold[own]] += sizes[own]
    return fold[together]


def _donors_drawn(library: Library, group: str, way: Method, seed: int) -> list[IntArray]:
    """Return for each segment the donors that a way by cost has chosen, as often as it did."""
    lists: list[list[int]] = [[] for _ in range(len(library.segments))]
    for entry in library.entries:
        scenario, draws = donors_by(way, library, entry.name, _DRAWS, swap=[group], seed=seed)
        for chosen in draws:
            for own, donor in zip(scenario.tolist(), chosen[group].tolist(), strict=True):
                lists[own].append(donor)
    return [np.array(own, np.int64) for own in lists]


def _partners(
    library: Library,
    ways: Sequence[Method],
    folds: IntArray,
    drawn: Mapping[str, list[IntArray]],
) -> dict[str, list[IntArray]]:
    """Return for each way and segment the donors of its own fold."""
    found: dict[str, list[IntArray]] = {}
    n = len(library.segments)
    for way in ways:
        lists: list[IntArray] = []
        for start in range(0, n, 500):  # the lists of all at once may not fit in memory
            some = np.arange(start, min(start + 500, n))
            several = (
                drawn[way.name][start : start + 500]
                if way.name in drawn
                else way.candidates(library, some)
            )
            for own, mates in zip(some.tolist(), several, strict=True):
                lists.append(mates[(folds[mates] == folds[own]) & (mates != own)])
        found[way.name] = lists
    return found


def _within(partners: Sequence[IntArray], test: IntArray, rng: np.random.Generator) -> IntArray:
    """Return pairs of test segments and some of their donors, shape (n_pairs, 2)."""
    pairs = []
    most = _most(len(test))
    for own in test.tolist():
        mates = partners[own]
        if len(mates) > most:
            mates = rng.choice(mates, most, replace=False)
        pairs.append(np.stack([np.full(len(mates), own), mates], axis=1))
    return np.concatenate(pairs).astype(np.int64)


def _most(n: int) -> int:
    return min(max(_PAIRS // n, 2), _PARTNERS)


def _chance(test: IntArray, rng: np.random.Generator) -> IntArray:
    """Return pairs of each test segment with random others."""
    count = min(_most(len(test)), len(test) - 1)
    pairs = []
    for place, own in enumerate(test.tolist()):
        others = np.delete(test, place)
        mates = rng.choice(others, count, replace=False)
        pairs.append(np.stack([np.full(count, own), mates], axis=1))
    return np.concatenate(pairs).astype(np.int64)


def _by_segment(values: FloatArray | BoolArray, pairs: IntArray, n: int) -> FloatArray:
    """Return the mean over each segment's pairs; NaN where it has none."""
    counts = np.bincount(pairs[:, 0], minlength=n)
    sums = np.bincount(pairs[:, 0], values, minlength=n)
    means: FloatArray = np.divide(sums, counts, out=np.full(n, np.nan), where=counts > 0)
    return means


def _trained(
    lower: FloatArray,
    upper: FloatArray,
    train: IntArray,
    together: IntArray,
    rng: np.random.Generator,
    seed: int,
) -> tuple[Callable[[IntArray], FloatArray], dict[str, float]]:
    """Return what scores pairs, and the parameters chosen for it."""
    halves = [_reduced(part, train) for part in (lower, upper)]
    inner = _split(np.unique(together[train], return_inverse=True)[1], _INNER, seed)
    some = rng.permutation(len(train))[:_MOST]
    some.sort()
    train, inner = train[some], inner[some]

    def joined(pairs: IntArray) -> FloatArray:
        return np.concatenate([halves[0][pairs[:, 0]], halves[1][pairs[:, 1]]], axis=1)

    # Captured pairs and pairs of parts from one inner fold, every part once.
    strangers = train.copy()
    for fold in np.unique(inner):
        own = rng.permutation(np.flatnonzero(inner == fold))
        strangers[own] = train[np.roll(own, 1)]
    pairs = np.concatenate([np.stack([train, train], axis=1), np.stack([train, strangers], axis=1)])
    keep = np.arange(len(pairs)) < len(train)
    keep |= pairs[:, 0] != pairs[:, 1]
    labels, folds = np.repeat([1, 0], len(train))[keep], np.tile(inner, 2)[keep]
    features = joined(pairs[keep])
    chosen = _searched(features, labels, folds)
    machine = _classifier(chosen).fit(features, labels)

    def scores(pairs: IntArray) -> FloatArray:
        if not len(pairs):
            return np.zeros(0)
        found: FloatArray = machine.decision_function(joined(pairs))
        return found

    return scores, chosen


def _reduced(part: FloatArray, train: IntArray) -> FloatArray:
    """Return all segments on the principal components of some."""
    count = min(_COMPONENTS, part.shape[1], len(train) - 1)
    steps = needed("sklearn.pipeline").make_pipeline(
        needed("sklearn.preprocessing").StandardScaler(),
        needed("sklearn.decomposition").PCA(count, svd_solver="full"),
    )
    reduced: FloatArray = steps.fit(part[train]).transform(part)
    return reduced


def _classifier(chosen: Mapping[str, float]) -> Any:  # noqa: ANN401 - scikit-learn's
    svm = needed("sklearn.svm").SVC(kernel="rbf", class_weight="balanced", **chosen)
    scaler = needed("sklearn.preprocessing").StandardScaler()
    return needed("sklearn.pipeline").make_pipeline(scaler, svm)


def _searched(features: FloatArray, labels: IntArray, fold: IntArray) -> dict[str, float]:
    """Return the parameters that do best when each fold is judged by the others."""
    whole = [own for own in np.unique(fold) if len(np.unique(labels[fold == own])) > 1]
    if len(whole) < 2:
        return {"C": 1.0, "gamma": 0.03}
    selection = needed("sklearn.model_selection")
    # A fold of one kind alone is learned from and not judged.
    judged = np.where(np.isin(fold, whole), fold, -1)
    search = selection.GridSearchCV(
        _classifier({}),
        {f"svc__{name}": values for name, values in _GRID.items()},
        scoring="roc_auc",
        cv=selection.PredefinedSplit(judged),
        refit=False,
    ).fit(features, labels)
    return {name: float(search.best_params_[f"svc__{name}"]) for name in _GRID}


Sums = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class _Kappas:
    """Normalised compatibilities and their intervals, all on the same resamplings.

    Values are of shape (n_splits, n_segments).
    """

    real: FloatArray
    random: FloatArray
    accepted: Mapping[str, FloatArray]
    block: IntArray
    seed: int

    def mean(self, values: FloatArray, of: str) -> Estimate:
        """Return the mean over splits and segments."""
        sums = self._sums(values, values)
        return self._estimate([sums], lambda means: means[0], values, of)

    def of(self, name: str, *, matched: bool = False) -> Estimate:
        """Return the kappa of a way."""
        terms = self._terms(name, matched=matched)
        return self._estimate(terms, _kappa, self.accepted[name], "segments with a donor")

    def difference(self, first: str, second: str) -> Difference:
        """Return the difference of two ways' kappas."""
        terms = [*self._terms(first), *self._terms(second)]
        both = self.accepted[first] + self.accepted[second]
        gap = self._estimate(
            terms,
            lambda means: _kappa(means[:3]) - _kappa(means[3:]),
            both,
            "segments with a donor of both",
        )
        return Difference(first, second, gap)

    def _sums(self, values: FloatArray, where: FloatArray) -> Sums:
        """Return sums and counts of each block, both of shape (n_splits, n_blocks)."""
        own, index = np.unique(self.block, return_inverse=True)
        kept = np.isfinite(values) & np.isfinite(where)
        each = [
            (
                np.bincount(index[row], value[row], minlength=len(own)),
                np.bincount(index[row], minlength=len(own)),
            )
            for value, row in zip(values, kept, strict=True)
        ]
        sums, counts = (np.array(rows, np.float64) for rows in zip(*each, strict=True))
        return sums, counts

    def _terms(self, name: str, *, matched: bool = False) -> list[Sums]:
        own = self.accepted[name]
        where = own if matched else self.real
        return [self._sums(own, own), self._sums(self.random, where), self._sums(self.real, where)]

    def _estimate(
        self,
        terms: Sequence[Sums],
        combine: Callable[[list[FloatArray]], FloatArray],
        values: FloatArray,
        of: str,
    ) -> Estimate:
        n_splits, n_blocks = terms[0][0].shape
        how = f"bootstrap of {n_blocks} blocks and {n_splits} splits"
        n = int(np.isfinite(values).any(axis=0).sum())
        if min(float(counts.sum()) for _, counts in terms) == 0:
            return Estimate(math.nan, math.nan, math.nan, n, of, how)
        whole = combine([np.array(sums.sum() / counts.sum()) for sums, counts in terms])

        rng = np.random.default_rng(self.seed)

        def statistic(drawn: FloatArray) -> FloatArray:
            splits = rng.multinomial(n_splits, np.full(n_splits, 1.0 / n_splits), len(drawn))
            means = []
            for sums, counts in terms:
                total, n = ((splits * (drawn @ own.T)).sum(axis=1) for own in (sums, counts))
                means.append(total / n)
            return combine(means)

        low, high = estimate.bootstrap(statistic, n_blocks, self.seed)
        return Estimate(float(whole), float(low[0]), float(high[0]), n, of, how)


def _kappa(means: Sequence[FloatArray]) -> FloatArray:
    way, chance, real = means
    kappa: FloatArray = (way - chance) / (real - chance)
    return kappa
