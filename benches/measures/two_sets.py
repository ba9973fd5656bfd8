"""Classifier two-sample test of two sets of motions whose frames do not correspond."""

from dataclasses import dataclass

import numpy as np

from benches.measures.distributions import pairwise
from mograft.evaluation.body_tracks import BodyTracks
from mograft.evaluation.classifier import assign_folds
from mograft.evaluation.two_sample import N_FOLDS, train_and_score, weighted_auc
from mograft.evaluation.windows import Windows, extract_windows, window_reach

STEP = 5  # frames between windows
BLOCK_FRAMES = 150  # of the captured blocks that are in one fold
_CHUNK = 400


@dataclass(frozen=True, eq=False)
class WindowSet:
    """The windows of several motions, the clip of each, and the block of captured motion."""

    windows: Windows
    clip: np.ndarray  # (n,)
    block: np.ndarray  # (n,)

    def __getitem__(self, rows):
        return WindowSet(self.windows[rows], self.clip[rows], self.block[rows])


@dataclass(frozen=True, eq=False)
class TestedWindows:
    """Scores of all test windows: those of both sets, and what they belong to."""

    scores: tuple[np.ndarray, np.ndarray]  # of the gross and of the fine classifier
    is_new: np.ndarray
    clip: np.ndarray
    fold: np.ndarray

    def auc(self, which, weights):
        """Return the mean AUC over folds for one weight per clip: `weights[clip]`."""
        found = []
        for fold in np.unique(self.fold):
            rows = self.fold == fold
            weight = weights[self.clip[rows]][None]
            value = weighted_auc(self.scores[which][rows], self.is_new[rows], weight)[0]
            found.append(value)
        found = np.array(found)
        return float(found[np.isfinite(found)].mean()) if np.isfinite(found).any() else np.nan


def captured_windows(motions):
    """Return the windows of recordings; blocks are about five seconds long."""
    parts, clip, block, first = [], [], [], 0
    for index, recording in enumerate(motions):
        windows, centers = _windows(recording)
        if not len(centers):
            continue
        n_blocks = max(round(recording.n_frames / BLOCK_FRAMES), 1)
        parts.append(windows)
        clip += [index] * len(centers)
        block += (first + centers * n_blocks // recording.n_frames).tolist()
        first += n_blocks
    return WindowSet(Windows.concatenate(parts), np.array(clip), np.array(block))


def generated_windows(motions, clips, captured):
    """Return the windows of generated motions, each in the block of the nearest captured window.

    `clips` has the index of the recording that each motion belongs to, for resampling by clip.

    The block of a window decides whether it is in training or test, so that a window that copies a
    recording is never tested against classifiers that saw the original.
    """
    parts, index = [], []
    for clip, generated in zip(clips, motions, strict=True):
        windows, centers = _windows(generated)
        if len(centers):
            parts.append(windows)
            index += [clip] * len(centers)
    windows = Windows.concatenate(parts)
    own, others = windows.blocks[0], captured.windows.blocks[0]
    nearest = [
        pairwise(own[start : start + _CHUNK], others).argmin(axis=1)
        for start in range(0, len(own), _CHUNK)
    ]
    return WindowSet(windows, np.array(index), captured.block[np.concatenate(nearest)])


def _windows(motion):
    reach = window_reach("seams", motion.rate)
    centers = np.arange(reach, motion.n_frames - reach, STEP)
    return extract_windows(BodyTracks.of(motion), centers, "seams"), centers


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
        if n < 25 or min(len(test) for _, test in sets) < 8:
            continue
        train = [rng.permutation(rows)[:n] for rows, _ in sets]
        learned = Windows.concatenate([captured.windows[train[0]], generated.windows[train[1]]])
        tested = Windows.concatenate([captured.windows[sets[0][1]], generated.windows[sets[1][1]]])
        scores = train_and_score(learned, np.repeat([0, 1], n), tested)
        counts = [len(test) for _, test in sets]
        clip = np.concatenate([captured.clip[sets[0][1]], generated.clip[sets[1][1]]])
        parts.append((scores, np.repeat([0.0, 1.0], counts), clip, np.full(sum(counts), fold)))
    if not parts:
        return None
    return TestedWindows(
        scores=tuple(np.concatenate([p[0][k] for p in parts]) for k in (0, 1)),
        is_new=np.concatenate([p[1] for p in parts]),
        clip=np.concatenate([p[2] for p in parts]),
        fold=np.concatenate([p[3] for p in parts]),
    )


def _folds(block, seed):
    """Return the fold of each block; a block without a window has fold -1."""
    folds = np.full(block.max() + 1, -1)
    present = np.unique(block)
    index = np.searchsorted(present, block)
    folds[block] = assign_folds(index, N_FOLDS, seed)
    return folds
