"""Classifier two-sample test of windows of grafts against captured windows."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.evaluation import estimate
from mograft.evaluation.body_tracks import FrameBlocks
from mograft.evaluation.estimate import Estimate, Record, import_extra
from mograft.evaluation.windows import Pairs, Windows

N_FOLDS = 3
MIN_TRAIN, MIN_TEST = 25, 8  # windows of grafts in a fold
_N_COMPONENTS = 25  # of positions, of velocities and of accelerations
_MIN_RELATIVE_SCALE = 0.1  # of a feature, relative to the scale of all features of its kind


@dataclass(frozen=True)
class Detection(Record):
    """ROC AUC of two classifiers of windows; 0.5 is chance, 1 is certainty.

    Attributes
    ----------
    gross : Estimate
        AUC of gradient-boosted trees on positions, velocities and accelerations of bone ends.
    fine : Estimate
        AUC of a logistic regression on the same features, on the logarithms of the magnitudes of
        velocity, acceleration and jerk of every bone end, and on the root velocity.
    """

    gross: Estimate
    fine: Estimate


def assign_folds(groups: IntArray, n_folds: int, seed: int | tuple[int, ...]) -> IntArray:
    """Assign groups of samples at random to folds of similar size; return each sample's fold.

    `groups` has the group of each sample; all samples of a group are in one fold. The number of
    folds is `n_folds`, or the number of groups if that is smaller.
    """
    sizes = np.bincount(groups)
    shuffled = np.random.default_rng(seed).permutation(len(sizes))
    descending = shuffled[np.argsort(-sizes[shuffled], kind="stable")]
    load = np.zeros(min(n_folds, int((sizes > 0).sum())))
    folds = np.zeros(len(sizes), np.int64)
    for group in descending.tolist():
        folds[group] = int(load.argmin())
        load[folds[group]] += sizes[group]
    return folds[groups]


def block_folds(frames: FrameBlocks, seed: tuple[int, ...]) -> IntArray:
    """Return the fold of each block of frames."""
    firsts = np.unique(frames.block, return_index=True)[1]
    return assign_folds(frames.block, N_FOLDS, seed)[firsts]


@dataclass(frozen=True, eq=False)
class TestedFold:
    """Scores of the test windows of one fold: those of grafts, followed by the captured ones."""

    scores: tuple[FloatArray, FloatArray]  # of the gross and of the fine classifier
    is_new: FloatArray  # 1 for windows of grafts, 0 for captured windows
    weight: FloatArray
    block: IntArray  # block of the base frame
    rows: IntArray  # indices of the windows of grafts in their `Pairs`


def detect(pairs_of_split: Sequence[Pairs], folds: Sequence[IntArray], seed: int) -> Detection:
    """Return the AUC of both classifiers on test windows, averaged over all folds and splits.

    For each split, `pairs_of_split` has the windows and `folds` the fold of each block.
    """
    tested = [
        found
        for pairs, fold_of_block in zip(pairs_of_split, folds, strict=True)
        for fold in range(N_FOLDS)
        if (found := score_fold(pairs, fold_of_block, fold)) is not None
    ]
    if not tested:
        return empty_detection()
    blocks = np.unique(np.concatenate([found.block for found in tested]))
    n = len(np.unique(np.concatenate([found.rows for found in tested])))
    sizes = np.array([len(found.rows) for found in tested], np.float64)

    def mean_auc(multiplicities: FloatArray, which: int) -> FloatArray:
        """Return the mean AUC over the folds for each bootstrap sample, shape (n,).

        `multiplicities`, shape (n, n_blocks), is the number of times that each sample contains each
        block. Folds are weighted by their number of windows. `which` is 0 for the gross classifier,
        1 for the fine one.
        """
        values = np.stack(
            [
                weighted_auc(
                    found.scores[which],
                    found.is_new,
                    found.weight * multiplicities[:, np.searchsorted(blocks, found.block)],
                )
                for found in tested
            ],
            axis=1,
        )
        shares = np.where(np.isfinite(values), sizes, 0.0)
        return (np.nan_to_num(values) * shares).sum(axis=1) / shares.sum(axis=1)

    def to_estimate(which: int) -> Estimate:
        return estimate.bootstrap_estimate(
            float(mean_auc(np.ones((1, len(blocks))), which)[0]),
            lambda multiplicities: mean_auc(multiplicities, which),
            len(blocks),
            n=n,
            unit="windows",
            seed=seed,
        )

    return Detection(gross=to_estimate(0), fine=to_estimate(1))


def empty_detection() -> Detection:
    """Return a detection without values."""
    none = Estimate.without_value(0, "windows", "block bootstrap")
    return Detection(gross=none, fine=none)


def score_fold(pairs: Pairs, fold_of_block: IntArray, fold: int) -> TestedFold | None:
    """Train on the windows with no block in `fold`, and test on those with all blocks in it.

    The blocks of a window are those of its base and of its donors. Returns None if there are too
    few windows for training or for the test.
    """
    is_inside = np.array([(fold_of_block[used] == fold).all() for used in pairs.blocks_used], bool)
    is_outside = np.array([(fold_of_block[used] != fold).all() for used in pairs.blocks_used], bool)
    train, test = np.flatnonzero(is_outside), np.flatnonzero(is_inside)
    if len(train) < MIN_TRAIN or len(test) < MIN_TEST:
        return None
    base, row, counts = np.unique(pairs.row[test], return_inverse=True, return_counts=True)
    tested = Windows.concatenate([pairs.new[test], pairs.base[base]])
    learned = Windows.concatenate([pairs.new[train], pairs.base[pairs.row[train]]])
    labels = np.repeat([1, 0], len(train))
    return TestedFold(
        scores=train_and_score(learned, labels, tested),
        is_new=np.repeat([1.0, 0.0], [len(test), len(base)]),
        weight=np.concatenate([1.0 / counts[row.reshape(-1)], np.ones(len(base))]),
        block=pairs.block[np.concatenate([pairs.row[test], base])],
        rows=test,
    )


def train_and_score(
    learned: Windows, labels: IntArray, tested: Windows
) -> tuple[FloatArray, FloatArray]:
    """Train both classifiers on the windows `learned`; return their scores for `tested`.

    `labels` has 1 for each training window of a graft and 0 for each captured one. The scores are
    those of the gross, then of the fine classifier; see `Detection`.
    """
    reduced = [_reduce(own, new) for own, new in zip(learned.blocks, tested.blocks, strict=True)]
    train, test = (np.concatenate(columns, axis=1) for columns in zip(*reduced, strict=True))
    trees = import_extra("sklearn.ensemble").HistGradientBoostingClassifier(
        max_iter=60,
        learning_rate=0.12,
        max_leaf_nodes=8,
        min_samples_leaf=12,
        l2_regularization=1.0,
        early_stopping=False,
        random_state=0,
    )
    regression: Any = import_extra("sklearn.pipeline").make_pipeline(
        import_extra("sklearn.preprocessing").StandardScaler(),
        import_extra("sklearn.linear_model").LogisticRegression(C=0.02, max_iter=500),
    )
    gross: FloatArray = trees.fit(train, labels).decision_function(test)
    train = np.concatenate([train, learned.magnitudes], axis=1)
    test = np.concatenate([test, tested.magnitudes], axis=1)
    fine: FloatArray = regression.fit(train, labels).decision_function(test)
    return gross, fine


def _reduce(learned: FloatArray, tested: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the principal components of the features of training and tested windows.

    Scale and axes are computed from the training windows, `learned`, alone.
    """
    scale = learned.std(axis=0)
    scale = np.maximum(scale, _MIN_RELATIVE_SCALE * learned.std())
    mean, scale = learned.mean(axis=0), np.where(scale > 0, scale, 1.0)
    n = min(_N_COMPONENTS, learned.shape[1], len(learned) - 1)
    analysis = import_extra("sklearn.decomposition").PCA(n, svd_solver="covariance_eigh")
    train: FloatArray = analysis.fit_transform((learned - mean) / scale)
    test: FloatArray = analysis.transform((tested - mean) / scale)
    return train, test


def weighted_auc(scores: FloatArray, is_positive: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the ROC AUC for several weightings of the same scores.

    Parameters
    ----------
    scores, is_positive : ndarray, shape (n,)
        Score of each sample, and 1 for positive and 0 for negative samples. Pairs of equal scores
        count half.
    weights : ndarray, shape (n_weightings, n)
        Weights of the samples.

    Returns
    -------
    ndarray, shape (n_weightings,)
        The AUC for each row of `weights`; NaN if one of the classes has no weight.
    """
    order = np.argsort(scores, kind="stable")
    ascending = scores[order]
    starts = np.flatnonzero(np.concatenate([[True], ascending[1:] != ascending[:-1]]))
    ordered, positive = weights[:, order], is_positive[order]
    ones, zeros = (
        np.add.reduceat(ordered * share, starts, axis=1) for share in (positive, 1.0 - positive)
    )
    below = np.cumsum(zeros, axis=1) - zeros / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        auc: FloatArray = (below * ones).sum(axis=1) / (ones.sum(axis=1) * zeros.sum(axis=1))
    return auc
