"""A classifier that is trained on the labels of a person and applied to methods (paper, 5.3).

Unlike the paper, the parameters are selected on the training labels, not on the test labels, and
the shares are corrected for the errors of the classifier.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.errors import InsufficientDataError
from mograft.evaluation import estimate
from mograft.evaluation._extra import import_extra
from mograft.evaluation.baselines import Method, default_methods
from mograft.evaluation.classifier import (
    N_INNER_FOLDS,
    PairFeatures,
    assign_folds,
    build_classifier,
    select_parameters,
)
from mograft.evaluation.donor_pairs import (
    donors_in_fold,
    mean_by_segment,
    sample_pairs,
    selected_donors,
)
from mograft.evaluation.estimate import Estimate, rogan_gladen
from mograft.evaluation.label_table import Labels
from mograft.evaluation.part_features import part_features
from mograft.library.library import Library

MIN_LABELS, MIN_LABELS_OF_EACH_KIND = 100, 20
_TRAIN_SHARE = 0.6


@dataclass(frozen=True)
class Verdict:
    """Shares of the exchanged parts of one method that a classifier calls natural.

    `corrected` is `called` corrected for the errors of the classifier on the test labels
    (Rogan-Gladen). It may be outside of 0 to 1, and is NaN if the classifier is no better than
    chance.
    """

    method: str
    called: Estimate
    corrected: Estimate

    def as_dict(self) -> dict[str, Any]:
        """Return a dict for JSON."""
        return {
            "method": self.method,
            "called_natural": self.called.as_dict(),
            "corrected": self.corrected.as_dict(),
        }


@dataclass(frozen=True)
class Judgement:
    """Results of a classifier that was trained on labels."""

    group: str
    learned: int  # number of training labels
    tested: int  # number of test labels
    natural: Estimate  # share of pieces with random donors that the person labelled natural
    captured: Estimate  # that of captured pieces: the upper limit for every method
    accuracy: Estimate
    sensitivity: Estimate
    specificity: Estimate
    verdicts: tuple[Verdict, ...]
    parameters: dict[str, float]  # of the classifier

    def as_dict(self) -> dict[str, Any]:
        """Return a dict for JSON."""
        values = {
            name: value.as_dict() if isinstance(value, Estimate) else value
            for name, value in vars(self).items()
            if name != "verdicts"
        }
        return {**values, "verdicts": [verdict.as_dict() for verdict in self.verdicts]}


@dataclass(frozen=True)
class _TestCounts:
    """Classification of the test labels."""

    true_positives: int
    positives: int
    true_negatives: int
    negatives: int

    def sensitivity(self) -> Estimate:
        return estimate.proportion(self.true_positives, self.positives, "test labels")

    def specificity(self) -> Estimate:
        return estimate.proportion(self.true_negatives, self.negatives, "test labels")

    def accuracy(self) -> Estimate:
        n_correct = self.true_positives + self.true_negatives
        return estimate.proportion(n_correct, self.positives + self.negatives, "test labels")


def judgement(
    library: Library, labels: Labels, methods: Sequence[Method] | None = None, *, seed: int = 0
) -> Judgement:
    """Train a classifier on labels and apply it to the donors of methods.

    Parameters
    ----------
    library : Library
        Library with the segments.
    labels : Labels
        Labels given by a person.
    methods : sequence of Method, optional
        Methods that select donors. Default: `default_methods` of the library.
    seed : int
        Seed of the split, of the donors and of the resampling.

    Returns
    -------
    Judgement
        The intervals of corrected shares cover the choice of segments and the choice of test
        labels.

    Raises
    ------
    ImportError
        If scikit-learn is not installed.
    InsufficientDataError
        If there are fewer than 100 labels of pieces with exchanged parts, fewer than 20 of
        either kind, or only one kind among the training labels or among the test labels.

    Notes
    -----
    Three fifths of the labels are training labels, as 300 of the 500 labels of the paper.
    Neighbouring segments are on the same side. The classifier is a support vector machine on
    principal components of the `part_features` of both parts. Its parameters are selected by
    cross-validation on the training labels. The features do not contain seams.
    """
    methods = default_methods(library) if methods is None else methods
    is_exchanged = labels.segment != labels.donor
    natural = labels.natural[is_exchanged]
    _check_labels(natural)
    import_extra("sklearn")
    pairs = np.stack([labels.segment[is_exchanged], labels.donor[is_exchanged]], axis=1)
    blocks = estimate.segment_blocks(library.segments)
    is_train = _split_labels(blocks[pairs[:, 0]], seed)
    if len(np.unique(natural[is_train])) < 2 or len(np.unique(natural[~is_train])) < 2:
        raise InsufficientDataError(
            "the training labels and the test labels must both contain both kinds of labels"
        )
    segments = np.arange(len(library.segments))
    base, grafted = (part_features(library, g) for g in (library.groups.base, labels.group))
    features = PairFeatures.reduce(base, grafted, segments)
    train_blocks = np.unique(blocks[pairs[is_train, 0]], return_inverse=True)[1]
    folds = assign_folds(train_blocks, N_INNER_FOLDS, seed)
    train_features, classes = features.join(pairs[is_train]), natural.astype(np.int64)[is_train]
    parameters = select_parameters(train_features, classes, folds)
    classifier = build_classifier(parameters).fit(train_features, classes)
    predicted = classifier.predict(features.join(pairs[~is_train])).astype(bool)
    truth = natural[~is_train]
    counts = _TestCounts(
        true_positives=int((predicted & truth).sum()),
        positives=int(truth.sum()),
        true_negatives=int((~predicted & ~truth).sum()),
        negatives=int((~truth).sum()),
    )
    captured = labels.natural[~is_exchanged]
    rng = np.random.default_rng(seed)
    selected = selected_donors(library, labels.group, methods, seed)
    donors = donors_in_fold(library, methods, np.zeros_like(segments), selected)
    verdicts = []
    for name, several in donors.items():
        sample = sample_pairs(several, segments, rng)
        rates = np.full(len(segments), np.nan)
        if len(sample):
            predictions = classifier.predict(features.join(sample)).astype(np.float64)
            rates = mean_by_segment(predictions, sample, len(segments))
        verdicts.append(_verdict(name, rates, blocks, counts, seed))
    return Judgement(
        group=labels.group,
        learned=int(is_train.sum()),
        tested=len(truth),
        natural=estimate.proportion(int(natural.sum()), len(natural), "exchanged pieces"),
        captured=estimate.proportion(int(captured.sum()), len(captured), "captured pieces"),
        accuracy=counts.accuracy(),
        sensitivity=counts.sensitivity(),
        specificity=counts.specificity(),
        verdicts=tuple(verdicts),
        parameters=parameters,
    )


def _check_labels(natural: BoolArray) -> None:
    n_natural = int(natural.sum())
    n_unnatural = len(natural) - n_natural
    if len(natural) < MIN_LABELS or min(n_natural, n_unnatural) < MIN_LABELS_OF_EACH_KIND:
        raise InsufficientDataError(
            f"labels of {MIN_LABELS} exchanged parts are needed, {MIN_LABELS_OF_EACH_KIND} of each "
            f"kind; there are {len(natural)}: {n_natural} natural, {n_unnatural} unnatural"
        )


def _split_labels(blocks: IntArray, seed: int) -> BoolArray:
    """Select random whole blocks for training that together have at least 3/5 of the labels."""
    distinct, index = np.unique(blocks, return_inverse=True)
    order = np.random.default_rng(seed).permutation(len(distinct))
    sizes = np.bincount(index)[order]
    n_train = int(np.searchsorted(np.cumsum(sizes), _TRAIN_SHARE * len(blocks))) + 1
    is_train: BoolArray = np.isin(index, order[:n_train])
    return is_train


def _verdict(
    method: str, rates: FloatArray, blocks: IntArray, counts: _TestCounts, seed: int
) -> Verdict:
    """Return the share of natural parts of a method, as called and as corrected."""
    called = estimate.block_mean(rates, blocks, "segments with a donor", seed)
    n_true_positive, n_positive = counts.true_positives, counts.positives
    n_true_negative, n_negative = counts.true_negatives, counts.negatives
    corrected = rogan_gladen(
        called.value, n_true_positive / n_positive, n_true_negative / n_negative
    )
    interval_method = f"{called.interval_method}, and of the test labels"
    # The correction divides by the gain over chance, which must differ from 0 significantly.
    low_gain = counts.sensitivity().low + counts.specificity().low - 1.0
    if not math.isfinite(corrected) or low_gain <= 0:
        undefined = Estimate.without_value(called.n, called.unit, interval_method)
        return Verdict(method, called, undefined)
    has_rate = np.isfinite(rates)
    distinct, index = np.unique(blocks[has_rate], return_inverse=True)
    sums = np.bincount(index, rates[has_rate])
    sizes = np.bincount(index).astype(np.float64)
    rng = np.random.default_rng(seed)

    def statistic(multiplicities: FloatArray) -> FloatArray:
        means = (multiplicities @ sums) / (multiplicities @ sizes)
        n = len(multiplicities)
        sensitivity = rng.binomial(n_positive, n_true_positive / n_positive, n) / n_positive
        specificity = rng.binomial(n_negative, n_true_negative / n_negative, n) / n_negative
        gain = sensitivity + specificity - 1.0
        values: FloatArray = np.where(gain > 0, (means + specificity - 1.0) / gain, np.nan)
        return values

    low, high = estimate.block_bootstrap(statistic, len(distinct), seed)
    interval = Estimate(
        value=corrected,
        low=float(low[0]),
        high=float(high[0]),
        n=called.n,
        unit=called.unit,
        interval_method=interval_method,
    )
    return Verdict(method, called, interval)
