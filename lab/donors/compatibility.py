"""Compatibility of donor parts with base parts, measured without ratings by people (paper, 5.3).

A classifier learns to distinguish parts that were captured together from random pairs of parts.
Its score of an exchanged part measures how much the combination resembles captured ones. It
does not measure naturalness: the features do not contain seams or physics, and a plausible
combination that was never captured scores low.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lab.common import RenamedRecord
from lab.donors import classifier, donor_pairs
from lab.donors.classifier import PairFeatures
from lab.donors.held_out import GROUP_SEGMENTS, fit_on, fold_groups, shuffle_parts
from lab.donors.kappa import Difference, Kappas
from lab.donors.methods import default_methods, grafted_group
from lab.donors.part_features import part_features
from mograft import InsufficientDataError, Library
from mograft.evaluation import Method
from mograft.evaluation.detectability import assign_folds
from mograft.evaluation.estimate import Estimate

MIN_SEGMENTS = 60
MIN_RATE_DIFFERENCE = 0.1  # least difference of the acceptance rates of captured and random parts
_N_FOLDS = 5
_MIN_GROUPS = 3  # one for the bases, one for the library, one for the training
_MIN_TEST_SEGMENTS, _MIN_TRAIN_SEGMENTS = 2, 10
_MAX_TRAIN_SEGMENTS = 400  # limits the run time of the SVM, which grows with the square


@dataclass(frozen=True)
class Score(RenamedRecord):
    """Compatibility of base parts with the parts of the donors that one method selects."""

    method: str
    accepted: Estimate  # share of the exchanged parts that the classifier accepts as captured
    kappa: Estimate  # κ: 0 for random parts, 1 for captured parts; their rates from all segments
    matched: Estimate  # κ with the rates of random and captured parts of segments with a donor only
    exchangeable: float  # share of the segments that have a donor

    JSON_KEYS: ClassVar[Mapping[str, str]] = {"matched": "kappa_matched"}


@dataclass(frozen=True)
class Compatibility(RenamedRecord):
    """Compatibility of the parts of one grafted group with base parts; see `compatibility`.

    A captured part is that of the base segment itself, a random part that of another segment.

    Attributes
    ----------
    group : str
        Grafted group.
    segments : int
        Number of segments with a score.
    splits, folds, fold_groups : int
        Number of random assignments to folds, number of folds of each assignment, and number
        of the clips or blocks of segments that were assigned to folds.
    auc : Estimate
        ROC AUC: probability that a captured part scores higher than a random part; 0.5 is
        chance.
    captured, random : Estimate
        Shares of the captured and of the random parts that the classifiers accept as captured.
    scores : tuple of Score
        Scores of the methods.
    differences : tuple of Difference
        Differences of κ between each two methods.
    parameters : tuple of dict
        Parameters of the classifier, selected within each training set.
    """

    group: str
    segments: int
    splits: int
    folds: int
    fold_groups: int
    auc: Estimate
    captured: Estimate
    random: Estimate
    scores: tuple[Score, ...]
    differences: tuple[Difference, ...]
    parameters: tuple[dict[str, float], ...]

    JSON_KEYS: ClassVar[Mapping[str, str]] = {
        "captured": "accepted_captured",
        "random": "accepted_random",
        "parameters": "classifier",
    }

    def difference(self, first, second):
        """Return κ of `first` minus κ of `second`; raise KeyError if this difference is missing."""
        for difference in self.differences:
            if (difference.first, difference.second) == (first, second):
                return difference
        raise KeyError(f"the difference {first} minus {second} was not computed")


def compatibility(
    library, group=None, methods=None, *, seed=0, splits=4, is_null=False, progress=None
):
    """Score how closely combinations of base parts and donor parts resemble captured ones.

    Parameters
    ----------
    library : Library
        Library to measure. Segments with recording faults are not used.
    group : str, optional
        Grafted group. Default: the first group that is not the base group.
    methods : sequence of Method, optional
        Methods that select donors. Default: `default_methods` of the library.
    seed : int
        Seed of the folds, the random pairs, the donors that are scored and the resampling.
    splits : int
        Number of random assignments of segments to folds. Each has its own classifiers and
        random pairs.
    is_null : bool
        Whether to shuffle the grafted parts of all segments first. Base and grafted parts then are
        independent, and all differences of acceptance rates are 0 up to chance. κ then has no
        meaning, since its denominator is near 0.
    progress : callable, optional
        Called with the name of the stage, the number of finished steps and the number of steps.

    Returns
    -------
    Compatibility
        The results. The bootstrap of the intervals resamples splits and the clips or blocks of
        segments that folds do not divide. They do not account for the choice of the recordings.

    Raises
    ------
    ImportError
        If scikit-learn is not installed.
    InsufficientDataError
        If fewer than 60 segments have no faults, if they are in fewer than three clips or blocks
        (see Notes), or if the acceptance rate of captured parts is less than 0.1 above that of
        random parts and `is_null` is False.
    ValueError
        If `group` is the base group or unknown, or `splits` is not an integer of at least 1.

    Notes
    -----
    This is a classifier two-sample test (Lopez-Paz and Oquab, ICLR 2017) of the dependence between
    the base part and the grafted part of a segment. Positive samples pair the base part of a
    segment with the grafted part of the same segment (captured part), negative samples with that of
    another segment (random part). The classifier is a support vector machine on 20 principal
    components of the `part_features` of each part. A pair with a positive score is accepted. The
    result is κ = (a_method - a_random) / (a_captured - a_random), where a is an acceptance rate.

    Clips, or blocks of 20 segments if there are fewer than ten clips, are assigned to five folds.
    One fold has the base segments. Two folds are the library: embedding, cluster diameter threshold
    and clusters are computed from them (`fit_on` of `lab.donors.held_out`), and all donors
    are in them. The other two folds train the classifier, with parameters from cross-validation
    within them. Each fold has the base segments once.
    """
    group = grafted_group(library, group)
    methods = default_methods(library) if methods is None else methods
    segments = np.flatnonzero(library.is_donor)
    if len(segments) < MIN_SEGMENTS:
        raise InsufficientDataError(
            f"compatibility needs {MIN_SEGMENTS} segments without faults, there are {len(segments)}"
        )
    n_groups = len(np.unique(fold_groups(library)[segments]))
    if n_groups < _MIN_GROUPS:
        raise InsufficientDataError(
            f"compatibility needs at least {_MIN_GROUPS} clips or blocks of {GROUP_SEGMENTS} "
            f"segments, got {n_groups}"
        )
    shuffled = np.arange(len(library.segments))
    if is_null:
        shuffled = shuffle_parts(library.is_donor, np.random.default_rng(seed))
    validation = _CrossValidation(library, group, methods, seed, shuffled)
    rates, wins, parameters = validation.run(splits, progress)
    captured, random = float(np.nanmean(rates.captured)), float(np.nanmean(rates.random))
    if captured - random < MIN_RATE_DIFFERENCE and not is_null:
        raise InsufficientDataError(
            f"the classifiers accept {captured:.0%} of the captured test parts and {random:.0%} of "
            "the random ones: compatibility is defined only if the difference is at least "
            f"{100 * MIN_RATE_DIFFERENCE:.0f} percentage points"
        )
    has_score = np.asarray(np.isfinite(rates.captured).any(axis=0), bool)
    names = [method.name for method in methods]
    descending = names[::-1]
    return Compatibility(
        group=group,
        segments=int(has_score.sum()),
        splits=splits,
        folds=len(parameters) // splits,
        fold_groups=n_groups,
        auc=rates.mean(wins, "segments"),
        captured=rates.mean(rates.captured, "segments"),
        random=rates.mean(rates.random, "segments"),
        scores=tuple(
            Score(
                method=name,
                accepted=rates.mean(rates.accepted[name], "segments with a donor"),
                kappa=rates.kappa(name),
                matched=rates.kappa(name, is_matched=True),
                exchangeable=float(np.isfinite(rates.accepted[name])[:, has_score].mean()),
            )
            for name in names
        ),
        differences=tuple(
            rates.difference(first, second)
            for i, first in enumerate(descending)
            for second in descending[i + 1 :]
        ),
        parameters=tuple(parameters),
    )


@dataclass(frozen=True, eq=False)
class _CrossValidation:
    """Training and application of the classifiers of all folds and splits."""

    library: Library
    group: str
    methods: Sequence[Method]
    seed: int
    shuffled: np.ndarray  # for each segment, the segment whose grafted part replaces its own

    def run(self, splits, progress):
        """Score the segments of each fold with donors and with a classifier of other folds.

        Return the acceptance rates; for each split and segment, the share of its random parts with
        a lower score than its captured part; and the parameters of each classifier.
        """
        library, groups = self.library, fold_groups(self.library)
        base = part_features(library, library.groups.base)
        grafted = part_features(library, self.group)[self.shuffled]
        shape = (splits, len(library.segments))
        captured, random, wins = (np.full(shape, np.nan) for _ in range(3))
        accepted = {method.name: np.full(shape, np.nan) for method in self.methods}
        rates = Kappas(captured, random, accepted, groups, self.seed)
        all_parameters = []
        for split in range(splits):
            rng = np.random.default_rng((self.seed, split))
            folds = assign_folds(groups, _N_FOLDS, (self.seed, split))
            n_folds = int(folds.max()) + 1
            for fold in range(n_folds):
                if progress is not None:
                    progress("scoring", split * n_folds + fold, splits * n_folds)
                roles = _Roles.of(folds, fold, library.is_donor)
                if not roles.is_sufficient:
                    continue
                known = fit_on(library, roles.is_library)
                donors = self._list_donors(known, roles.bases)
                features = PairFeatures.reduce(base, grafted, roles.training)
                score_pairs, parameters = _train_classifier(
                    features, roles.training, groups, rng, self.seed
                )
                all_parameters.append(parameters)
                wins[split, roles.bases] = _score_fold(
                    rates, split, roles, score_pairs, donors, rng
                )
        return rates, wins, all_parameters

    def _list_donors(self, library, bases):
        selected = donor_pairs.selected_donors(library, self.group, self.methods, self.seed, bases)
        return donor_pairs.list_donors(library, self.methods, bases, selected)


@dataclass(frozen=True, eq=False)
class _Roles:
    """Segments by role in one round of cross-validation: bases, library, training."""

    bases: np.ndarray
    is_library: np.ndarray  # shape (n_segments,)
    training: np.ndarray

    @classmethod
    def of(cls, folds, fold, is_donor):
        """Take the bases from fold number `fold`, the library and the training from the others."""
        n_folds = int(folds.max()) + 1
        distance = (folds - fold) % n_folds
        n_library = n_folds // 2
        return cls(
            bases=np.flatnonzero((distance == 0) & is_donor),
            is_library=(distance > 0) & (distance <= n_library) & is_donor,
            training=np.flatnonzero((distance > n_library) & is_donor),
        )

    @property
    def is_sufficient(self):
        return (
            len(self.bases) >= _MIN_TEST_SEGMENTS
            and int(self.is_library.sum()) >= _MIN_TRAIN_SEGMENTS
            and len(self.training) >= _MIN_TRAIN_SEGMENTS
        )


def _score_fold(rates, split, roles, score_pairs, donors, rng):
    """Write the acceptance rates of the bases of one fold to `rates`.

    `donors` has the donors of each base by method. Return for each base the share of its random
    parts with a lower score than its captured part.
    """
    n, test = rates.captured.shape[1], roles.bases

    def by_segment(values, pairs):
        return donor_pairs.mean_by_segment(values, pairs, n)[test]

    chance = donor_pairs.random_pairs(test, np.flatnonzero(roles.is_library), rng)
    captured_scores = np.full(n, np.nan)
    captured_scores[test] = score_pairs(np.stack([test, test], axis=1))
    random_scores = score_pairs(chance)
    rates.captured[split, test] = captured_scores[test] > 0
    rates.random[split, test] = by_segment(random_scores > 0, chance)
    for method, several in donors.items():
        pairs = donor_pairs.sample_pairs(several, test, rng)
        rates.accepted[method][split, test] = by_segment(score_pairs(pairs) > 0, pairs)
    return by_segment(random_scores < captured_scores[chance[:, 0]], chance)


def _train_classifier(features, train, groups, rng, seed):
    """Train a classifier on the segments `train`; return its score function and its parameters.

    `groups` are the `fold_groups` of all segments.
    """
    train_groups = np.unique(groups[train], return_inverse=True)[1]
    inner = assign_folds(train_groups, classifier.N_INNER_FOLDS, seed)
    sample = np.sort(rng.permutation(len(train))[:_MAX_TRAIN_SEGMENTS])
    train, inner = train[sample], inner[sample]
    # Negative samples shuffle the grafted parts of one inner fold.
    others = train.copy()
    for fold in np.unique(inner):
        members = rng.permutation(np.flatnonzero(inner == fold))
        others[members] = train[np.roll(members, 1)]
    captured = np.stack([train, train], axis=1)
    pairs = np.concatenate([captured, np.stack([train, others], axis=1)])
    is_kept = (np.arange(len(pairs)) < len(train)) | (pairs[:, 0] != pairs[:, 1])
    labels, folds = np.repeat([1, 0], len(train))[is_kept], np.tile(inner, 2)[is_kept]
    joined = features.join(pairs[is_kept])
    parameters = classifier.select_parameters(joined, labels, folds)
    svm = classifier.build_classifier(parameters).fit(joined, labels)

    def score_pairs(pairs):
        if not len(pairs):
            return np.zeros(0)
        return svm.decision_function(features.join(pairs))

    return score_pairs, parameters
