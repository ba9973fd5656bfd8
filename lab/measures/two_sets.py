"""Classifier two-sample test of two sets of motions whose frames do not correspond."""

from dataclasses import dataclass

import numpy as np

from lab.measures.distributions import pairwise
from mograft.evaluation.body_tracks import BodyTracks
from mograft.evaluation.detectability import N_FOLDS, assign_folds, train_and_score, weighted_auc
from mograft.evaluation.windows import Windows, extract_windows, window_reach

STEP = 5  # frames between windows
MIN_TRAIN, MIN_TEST = 25, 8  # windows of each set
_CHUNK = 400


@dataclass(frozen=True, eq=False)
class WindowSet:
    """Windows of motions, and two blocks of captured motion for each.

    `unit` is the block that the motion was generated for: the bootstrap resamples it. `block` is
    the block of the most similar captured window: it decides the fold. For captured windows both
    are the block of the window.
    """

    windows: Windows
    unit: np.ndarray  # (n,)
    block: np.ndarray  # (n,)

    @classmethod
    def concatenate(cls, sets):
        """Concatenate several sets, in their order."""
        return cls(
            Windows.concatenate([own.windows for own in sets]),
            np.concatenate([own.unit for own in sets]),
            np.concatenate([own.block for own in sets]),
        )

    def __getitem__(self, rows):
        return WindowSet(self.windows[rows], self.unit[rows], self.block[rows])


@dataclass(frozen=True, eq=False)
class TestedWindows:
    """Scores of the test windows of both sets."""

    scores: tuple[np.ndarray, np.ndarray]  # of the gross and of the fine classifier
    is_new: np.ndarray
    unit: np.ndarray
    fold: np.ndarray

    def auc(self, which, weights):
        """Return the mean AUC over folds for each row of `weights`, shape (n, n_units).

        `which` is 0 for the gross classifier, 1 for the fine one. Folds in which all windows of
        one of the sets have weight 0 are left out.
        """
        values = []
        for fold in np.unique(self.fold):
            rows = self.fold == fold
            weight = weights[:, self.unit[rows]]
            values.append(weighted_auc(self.scores[which][rows], self.is_new[rows], weight))
        is_known = np.isfinite(values)
        with np.errstate(invalid="ignore"):
            return np.where(is_known, values, 0.0).sum(axis=0) / is_known.sum(axis=0)


def read_windows(motions, blocks, chosen=None):
    """Return the windows of motions and their blocks, or None if there are none.

    `blocks` has the blocks of the frames of each motion, an array of shape (n_frames,). `chosen`
    tells whether each frame may be the centre of a window, by default all.
    """
    parts, units = [], []
    for index, (motion, own) in enumerate(zip(motions, blocks, strict=True)):
        reach = window_reach("seams", motion.rate)
        centers = np.arange(reach, motion.n_frames - reach, STEP)
        if chosen is not None:
            centers = centers[chosen[index][centers]]
        if len(centers):
            parts.append(extract_windows(BodyTracks.of(motion), centers, "seams"))
            units.append(own[centers])
    if not parts:
        return None
    unit = np.concatenate(units)
    return WindowSet(Windows.concatenate(parts), unit, unit)


def assign_blocks(generated, captured):
    """Return `generated` with the block of the nearest captured window for every window.

    A window that copies a recording is then never tested with classifiers that saw the original.
    """
    own, others = generated.windows.blocks[0], captured.windows.blocks[0]
    nearest = [
        pairwise(own[start : start + _CHUNK], others).argmin(axis=1)
        for start in range(0, len(own), _CHUNK)
    ]
    block = captured.block[np.concatenate(nearest)]
    return WindowSet(generated.windows, generated.unit, block)


def split_at_random(captured, seed):
    """Return two random halves of the captured windows of every block: a null comparison."""
    rng = np.random.default_rng(seed)
    is_first = np.zeros(len(captured.block), bool)
    for block in np.unique(captured.block):
        rows = rng.permutation(np.flatnonzero(captured.block == block))
        is_first[rows[: len(rows) // 2]] = True
    return captured[np.flatnonzero(is_first)], captured[np.flatnonzero(~is_first)]


def compare_sets(captured, generated, seed=0):
    """Train on two thirds of the blocks, test on the others; return the scores of test windows.

    In training both sets have as many windows as the smaller one. Returns None if no fold has 25
    windows of each set to train and 8 to test on.
    """
    fold_of_block = _folds(captured.block, seed)
    rng = np.random.default_rng(seed)
    parts = []
    for fold in range(N_FOLDS):
        sets = []
        for own in (captured, generated):
            is_tested = fold_of_block[own.block] == fold
            sets.append((np.flatnonzero(~is_tested), np.flatnonzero(is_tested)))
        n = min(len(train) for train, _ in sets)
        if n < MIN_TRAIN or min(len(test) for _, test in sets) < MIN_TEST:
            continue
        first, second = (rng.permutation(train)[:n] for train, _ in sets)
        learned = Windows.concatenate([captured.windows[first], generated.windows[second]])
        first, second = (test for _, test in sets)
        tested = Windows.concatenate([captured.windows[first], generated.windows[second]])
        parts.append(
            TestedWindows(
                scores=train_and_score(learned, np.repeat([0, 1], n), tested),
                is_new=np.repeat([0.0, 1.0], [len(first), len(second)]),
                unit=np.concatenate([captured.unit[first], generated.unit[second]]),
                fold=np.full(len(tested), fold),
            )
        )
    if not parts:
        return None
    return TestedWindows(
        scores=tuple(np.concatenate([part.scores[k] for part in parts]) for k in (0, 1)),
        is_new=np.concatenate([part.is_new for part in parts]),
        unit=np.concatenate([part.unit for part in parts]),
        fold=np.concatenate([part.fold for part in parts]),
    )


def _folds(block, seed):
    """Return the fold of each block; a block without a window has fold -1."""
    folds = np.full(block.max() + 1, -1)
    index = np.searchsorted(np.unique(block), block)
    folds[block] = assign_folds(index, N_FOLDS, seed)
    return folds
