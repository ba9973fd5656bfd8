"""Detectability of grafts: whether a classifier distinguishes their windows from captured ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.validate import as_integer
from mograft.errors import InsufficientDataError
from mograft.evaluation.estimate import Record, import_extra
from mograft.evaluation.two_sample import (
    MIN_TEST,
    MIN_TRAIN,
    N_FOLDS,
    Detection,
    block_folds,
    detect,
)
from mograft.evaluation.windows import GraftWindows, Pairs
from mograft.synthesis.graft_result import Graft

MIN_WINDOWS = 60
_MAX_WINDOWS = 1600  # limits the run time


@dataclass(frozen=True)
class Detectability(Record):
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

    method: str
    runs: int
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
    import_extra("sklearn")
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
