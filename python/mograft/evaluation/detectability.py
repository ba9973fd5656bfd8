"""Detectability of grafts: whether a classifier distinguishes their windows from captured ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.validate import as_integer
from mograft.errors import InsufficientDataError
from mograft.evaluation import estimate
from mograft.evaluation.body_tracks import FrameBlocks
from mograft.evaluation.estimate import Estimate, MethodRecord, Record, import_measure
from mograft.evaluation.windows import GraftWindows, Pairs, Windows
from mograft.synthesis.graft_result import Graft

MIN_WINDOWS = 60
_MAX_WINDOWS = 1600  # limits the run time
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


@dataclass(frozen=True)
class Detectability(MethodRecord):
    """How well classifiers distinguish the grafts of one method from captured motion.

    Two null comparisons state what the classifiers reach on captured motion alone.

    Attributes
    ----------
    method : str
        Name of the method that selected the donors.
    runs : int
        Number of grafts for each base.
    seams : Detection
        Windows of 0.5 s of grafts, centred at seams, against the captured windows at the same
        frames of the base.
    between_seams : Detection
        As `seams`, for windows of 0.3 s in the middle between two seams, in exchanged segments.
    other_moments : Detection
        Null comparison for the windows at seams: each window of a graft is replaced by the captured
        window of the base at another seam in the same block of five seconds.
    donor_windows : Detection
        Null comparison for the windows at seams: each window of a graft is replaced by a captured
        window of a donor, around the donor frame at the centre of the graft's window. The donor is
        that of the first group that is exchanged at this centre.
    """

    seams: Detection
    between_seams: Detection
    other_moments: Detection
    donor_windows: Detection


def detectability(
    method: str, grafts: Sequence[Sequence[Graft]], seed: int = 0, *, splits: int = 3
) -> Detectability:
    """Measure whether classifiers distinguish grafts from captured motion.

    Parameters
    ----------
    method : str
        Name of the method that selected the donors.
    grafts : sequence of sequence of Graft
        For each base, its grafts; all from one library, whose clips are the bases.
    seed : int
        Seed of the folds, of the resampling and, if there are more than 1600 windows, of the
        random choice of 1600 windows.
    splits : int
        Number of random assignments of the blocks to folds.

    Returns
    -------
    Detectability
        A value is NaN if there are too few windows for it. The intervals resample blocks of five
        seconds of the bases. They account neither for the choice of the recordings nor for that
        of the training windows.

    Raises
    ------
    ImportError
        If scikit-learn is not installed.
    InsufficientDataError
        If there are fewer than 60 windows at seams, or if no fold has 25 training windows and 8
        test windows.
    ValueError
        If a base is not a clip of the library, or `splits` is not an integer of at least 1.

    Notes
    -----
    This is a classifier two-sample test (Lopez-Paz and Oquab, ICLR 2017). The clips are divided
    into blocks of five seconds, and the blocks are assigned at random to three folds; this is
    repeated `splits` times. The classifiers of a fold are tested on the windows whose base and
    donors are all in blocks of this fold, and trained on the windows whose base and donors are all
    outside of it. The windows of grafts at one frame of a base together weigh as much as the
    captured window there. The features are those of `mograft.evaluation.windows`: bone ends
    relative to the hips and to the heading at the centre, reduced to principal components of the
    training windows.
    """
    splits = as_integer("splits", splits, 1)
    flat = [graft for several in grafts for graft in several]
    if not flat:
        raise InsufficientDataError("detectability needs at least one graft")
    names = {entry.name for entry in flat[0].library.entries}
    for graft in flat:
        if graft.scenario or graft.base.name not in names:
            raise ValueError(f"`grafts` must have clips of the library as bases, got {graft!r}")
    import_measure("sklearn")
    rng = np.random.default_rng(seed)
    at_seams = GraftWindows.of(flat, "seams", _MAX_WINDOWS, rng)
    if len(at_seams) < MIN_WINDOWS:
        raise InsufficientDataError(
            f"detectability needs {MIN_WINDOWS} windows at seams, but there are {len(at_seams)}"
        )
    folds = [block_folds(at_seams.frames, (seed, split)) for split in range(splits)]
    pairs = at_seams.pairs()
    seams = detect([pairs] * splits, folds, seed)
    if not np.isfinite(seams.gross.value):
        raise InsufficientDataError(
            f"detectability needs a fold with {MIN_TEST} test windows and {MIN_TRAIN} training "
            f"windows at seams, but none of the {N_FOLDS} folds has that many"
        )
    between = GraftWindows.of(flat, "between seams", _MAX_WINDOWS, rng)
    others = [pair_other_moments(pairs, rng) for _ in folds]
    return Detectability(
        method=method,
        runs=len(grafts[0]),
        seams=seams,
        between_seams=detect([between.pairs()] * splits, folds, seed),
        other_moments=detect(others, folds, seed),
        donor_windows=detect([at_seams.donor_pairs()] * splits, folds, seed),
    )


def pair_other_moments(pairs: Pairs, rng: np.random.Generator) -> Pairs:
    """Return random pairs of two captured windows of the same block, for a null comparison.

    The windows are those of `pairs.base`; each is in one pair at most. The second window of a pair
    is in `new` of the result, in place of a window of a graft.
    """
    order = rng.permutation(len(pairs.base))
    order = order[np.argsort(pairs.block[order], kind="stable")]
    first, second = order[:-1], order[1:]
    is_paired = np.zeros(len(first), bool)
    for k in np.flatnonzero(pairs.block[first] == pairs.block[second]).tolist():
        is_paired[k] = k == 0 or not is_paired[k - 1]
    base, new = first[is_paired], second[is_paired]
    block = pairs.block[base]
    row = np.arange(len(base))
    return Pairs(pairs.base[base], pairs.base[new], row, block, tuple(block[:, None]))


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

    def to_estimate(which: int) -> Estimate:
        """Return the AUC of the gross classifier for 0, or of the fine one for 1."""

        def mean_auc(multiplicities: FloatArray) -> FloatArray:
            """Return the mean AUC over the folds for each bootstrap sample, shape (n,).

            `multiplicities`, shape (n, n_blocks), is the number of times that each sample contains
            each block. Folds are weighted by their number of windows.
            """
            columns = []
            for own in tested:
                weights = own.weight * multiplicities[:, np.searchsorted(blocks, own.block)]
                columns.append(weighted_auc(own.scores[which], own.is_new, weights))
            values = np.stack(columns, axis=1)
            shares = np.where(np.isfinite(values), sizes, 0.0)
            return (np.nan_to_num(values) * shares).sum(axis=1) / shares.sum(axis=1)

        value, unit = float(mean_auc(np.ones((1, len(blocks))))[0]), "windows"
        return estimate.bootstrap_estimate(value, mean_auc, len(blocks), n=n, unit=unit, seed=seed)

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
    limits = {"max_iter": 60, "max_leaf_nodes": 8, "min_samples_leaf": 12, "early_stopping": False}
    trees = import_measure("sklearn.ensemble").HistGradientBoostingClassifier(
        learning_rate=0.12, l2_regularization=1.0, random_state=0, **limits
    )
    regression: Any = import_measure("sklearn.pipeline").make_pipeline(
        import_measure("sklearn.preprocessing").StandardScaler(),
        import_measure("sklearn.linear_model").LogisticRegression(C=0.02, max_iter=500),
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
    scale = np.maximum(learned.std(axis=0), _MIN_RELATIVE_SCALE * learned.std())
    mean, scale = learned.mean(axis=0), np.where(scale > 0, scale, 1.0)
    n = min(_N_COMPONENTS, learned.shape[1], len(learned) - 1)
    analysis = import_measure("sklearn.decomposition").PCA(n, svd_solver="covariance_eigh")
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
