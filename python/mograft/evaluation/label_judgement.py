"""A classifier that is trained on the labels of a person and applied to methods (paper, 5.3).

Unlike the paper, the parameters are selected on the training labels, not on the test labels, and
the shares are corrected for the errors of the classifier.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.errors import InsufficientDataError
from mograft.evaluation import classifier, donor_pairs, estimate
from mograft.evaluation._extra import import_extra
from mograft.evaluation.baselines import Method, default_methods
from mograft.evaluation.classifier import PairFeatures
from mograft.evaluation.estimate import Estimate, Record, proportion, rogan_gladen
from mograft.evaluation.label_table import Labels
from mograft.evaluation.part_features import part_features
from mograft.library.library import Library

MIN_LABELS, MIN_LABELS_OF_EACH_KIND = 100, 20
_TRAIN_SHARE = 0.6


@dataclass(frozen=True)
class Verdict(Record):
    """Share of the exchanged parts of one method that a classifier predicts to be natural.

    `called` is this share. `corrected` is this share after a correction for the errors of the
    classifier on the test labels (`rogan_gladen`); it may be outside of 0 to 1, and is NaN if the
    classifier is not significantly better than chance.
    """

    method: str
    called: Estimate
    corrected: Estimate

    JSON_KEYS: ClassVar[Mapping[str, str]] = {"called": "called_natural"}


@dataclass(frozen=True)
class Judgement(Record):
    """Results of a classifier that was trained on labels "natural" and "unnatural"."""

    group: str
    learned: int  # number of training labels
    tested: int  # number of test labels
    natural: Estimate  # share of natural labels among the pieces with an exchanged part
    captured: Estimate  # share of natural labels among the captured pieces, for comparison
    accuracy: Estimate
    sensitivity: Estimate
    specificity: Estimate
    parameters: dict[str, float]  # of the classifier
    verdicts: tuple[Verdict, ...]


def judgement(
    library: Library, labels: Labels, methods: Sequence[Method] | None = None, *, seed: int = 0
) -> Judgement:
    """Train a classifier on labels and apply it to the donors that methods select.

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
        The results. The intervals of corrected shares account for the choice of segments and of
        test labels.

    Raises
    ------
    ImportError
        If scikit-learn is not installed.
    InsufficientDataError
        If there are fewer than 100 labels of pieces with an exchanged part, fewer than 20 natural
        or fewer than 20 unnatural ones among them, or if all training labels or all test labels are
        equal.

    Notes
    -----
    At least three fifths of the labels are training labels; in the paper it is 300 of 500. A block
    of neighbouring segments is used either for training or for the test. The classifier is a
    support vector machine on principal components of the `part_features` of both parts. Its
    parameters are selected by cross-validation on the training labels. The features do not
    contain seams.
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
            "both the training labels and the test labels must include natural and unnatural ones"
        )
    segments = np.arange(len(library.segments))
    base, grafted = (part_features(library, g) for g in (library.groups.base, labels.group))
    features = PairFeatures.reduce(base, grafted, segments)
    train_blocks = np.unique(blocks[pairs[is_train, 0]], return_inverse=True)[1]
    folds = classifier.assign_folds(train_blocks, classifier.N_INNER_FOLDS, seed)
    train_features, classes = features.join(pairs[is_train]), natural.astype(np.int64)[is_train]
    parameters = classifier.select_parameters(train_features, classes, folds)
    svm = classifier.build_classifier(parameters).fit(train_features, classes)
    predicted = svm.predict(features.join(pairs[~is_train])).astype(bool)
    truth = natural[~is_train]
    is_correct = predicted == truth
    sensitivity = _share(is_correct[truth], "test labels")
    specificity = _share(is_correct[~truth], "test labels")
    rng = np.random.default_rng(seed)
    selected = donor_pairs.selected_donors(library, labels.group, methods, seed)
    donors = donor_pairs.list_donors(library, methods, segments, selected)
    verdicts = []
    for name, several in donors.items():
        sample = donor_pairs.sample_pairs(several, segments, rng)
        rates = np.full(len(segments), np.nan)
        if len(sample):
            predictions = svm.predict(features.join(sample)).astype(np.float64)
            rates = donor_pairs.mean_by_segment(predictions, sample, len(segments))
        verdicts.append(_verdict(name, rates, blocks, (sensitivity, specificity), seed))
    return Judgement(
        group=labels.group,
        learned=int(is_train.sum()),
        tested=len(truth),
        natural=_share(natural, "exchanged pieces"),
        captured=_share(labels.natural[~is_exchanged], "captured pieces"),
        accuracy=_share(is_correct, "test labels"),
        sensitivity=sensitivity,
        specificity=specificity,
        parameters=parameters,
        verdicts=tuple(verdicts),
    )


def _share(is_hit: BoolArray, unit: str) -> Estimate:
    return proportion(int(is_hit.sum()), len(is_hit), unit)


def _check_labels(natural: BoolArray) -> None:
    n_natural = int(natural.sum())
    n_unnatural = len(natural) - n_natural
    if len(natural) < MIN_LABELS or min(n_natural, n_unnatural) < MIN_LABELS_OF_EACH_KIND:
        raise InsufficientDataError(
            f"{MIN_LABELS} labels of exchanged parts are needed, at least "
            f"{MIN_LABELS_OF_EACH_KIND} natural and {MIN_LABELS_OF_EACH_KIND} unnatural; there are "
            f"{n_natural} natural and {n_unnatural} unnatural ones"
        )


def _split_labels(blocks: IntArray, seed: int) -> BoolArray:
    """Return which labels are training labels: those of random blocks, at least 3/5 of the labels.

    `blocks` has the block of each label.
    """
    distinct, index = np.unique(blocks, return_inverse=True)
    order = np.random.default_rng(seed).permutation(len(distinct))
    sizes = np.bincount(index)[order]
    n_train = int(np.searchsorted(np.cumsum(sizes), _TRAIN_SHARE * len(blocks))) + 1
    is_train: BoolArray = np.isin(index, order[:n_train])
    return is_train


def _verdict(
    method: str, rates: FloatArray, blocks: IntArray, errors: tuple[Estimate, Estimate], seed: int
) -> Verdict:
    """Return the share of parts of a method that are predicted natural, also corrected for errors.

    `rates` has this share for each segment, NaN without a donor. `errors` holds the sensitivity
    and the specificity of the classifier.
    """
    called = estimate.block_mean(rates, blocks, "segments with a donor", seed)
    sensitivity, specificity = errors
    corrected = rogan_gladen(called.value, sensitivity.value, specificity.value)
    interval_method = f"{called.interval_method}, and of the test labels"
    # The correction divides by the gain over chance, which must differ from 0 significantly.
    low_gain = sensitivity.low + specificity.low - 1.0
    if not math.isfinite(corrected) or low_gain <= 0:
        undefined = Estimate.without_value(called.n, called.unit, interval_method)
        return Verdict(method, called, undefined)
    sums, sizes = estimate.block_sums(rates, blocks)
    rng = np.random.default_rng(seed)

    def statistic(multiplicities: FloatArray) -> FloatArray:
        means = (multiplicities @ sums) / (multiplicities @ sizes)
        true_positives, true_negatives = (
            rng.binomial(share.n, share.value, len(multiplicities)) / share.n for share in errors
        )
        gain = true_positives + true_negatives - 1.0
        values: FloatArray = np.where(gain > 0, (means + true_negatives - 1.0) / gain, np.nan)
        return values

    interval = estimate.bootstrap_estimate(
        corrected,
        statistic,
        len(sums),
        n=called.n,
        unit=called.unit,
        seed=seed,
        interval_method=interval_method,
    )
    return Verdict(method, called, interval)
