"""Pairs of base segments and donors, as classifiers score them."""

import numpy as np

from mograft.evaluation import draw_donors

_MAX_DONORS = 20  # donors of one segment that are scored, at most
_MAX_PAIRS = 10_000  # pairs in one fold that are scored; more if two donors per segment need them
_N_SEQUENCES = 20  # donor sequences that are drawn for each clip from a method that selects by cost
_CHUNK = 500  # segments whose candidates are in memory at the same time


def selected_donors(library, group, methods, seed, segments=None):
    """Return the donors of each segment in 20 donor sequences per clip, by name of the method.

    A donor may occur several times. Methods whose `uses_cost` is False are omitted. If `segments`
    is given, sequences are drawn only for the clips of these segments.
    """
    clips = np.unique(library.segments.clip[slice(None) if segments is None else segments])
    selected = {}
    for method in methods:
        if not method.uses_cost:
            continue
        donors = [[] for _ in range(len(library.segments))]
        for clip in clips.tolist():
            plan, sequences = draw_donors(
                method, library, library.names[clip], _N_SEQUENCES, swap=[group], seed=seed
            )
            scenario = plan.problem.scenario.tolist()
            for sequence in sequences:
                for segment, donor in zip(scenario, sequence[group].tolist(), strict=True):
                    donors[segment].append(donor)
        selected[method.name] = [np.array(several, np.int64) for several in donors]
    return selected


def list_donors(library, methods, segments, selected):
    """Return, for each method, the donors of each of `segments`, without the segment itself.

    The donors are those in `selected`, the result of `selected_donors`; for methods that are not
    in it, all candidates. Raises ValueError if a method selects an excluded donor, such as a
    segment that is held out.
    """
    found = {}
    for method in methods:
        donors = []
        for start in range(0, len(segments), _CHUNK):
            part = segments[start : start + _CHUNK]
            if method.name in selected:
                candidates = [selected[method.name][segment] for segment in part.tolist()]
            else:
                candidates = method.candidates(library, part)
            others = [
                several[several != segment]
                for segment, several in zip(part.tolist(), candidates, strict=True)
            ]
            if not all(library.is_donor[own].all() for own in others):
                raise ValueError(f"the method {method.name!r} selects held-out segments as donors")
            donors += others
        found[method.name] = donors
    return found


def sample_pairs(donors, segments, rng):
    """Return pairs of segments and their donors, shape (n_pairs, 2).

    `donors` has the donors of each of `segments`. Of each segment, at most 20 donors are drawn at
    random. This limit is lower, but at least 2, if it would allow more than 10,000 pairs.
    """
    n = _max_donors(len(segments))
    chosen = [
        several if len(several) <= n else rng.choice(several, n, replace=False)
        for several in donors
    ]
    return _pair(segments, chosen)


def random_pairs(segments, donors, rng):
    """Return pairs of each of `segments` with random ones of `donors`, shape (n_pairs, 2).

    The number of pairs of each segment is the limit that `sample_pairs` describes.
    """
    count = min(_max_donors(len(segments)), len(donors))
    chosen = [rng.choice(donors, count, replace=False) for _ in segments]
    return _pair(segments, chosen)


def _pair(segments, donors):
    """Return the pairs of each segment with each of its donors, shape (n_pairs, 2)."""
    repeated = np.repeat(segments, [len(several) for several in donors])
    return np.stack([repeated, np.concatenate(donors)], axis=1).astype(np.int64)


def _max_donors(n_segments):
    return min(max(_MAX_PAIRS // n_segments, 2), _MAX_DONORS)


def mean_by_segment(values, pairs, n):
    """Return, for each of `n` segments, the mean of `values` over the pairs of the segment.

    `values` has one value for each pair; `pairs` has the segment in its first column. The mean is
    NaN for a segment without a pair.
    """
    counts = np.bincount(pairs[:, 0], minlength=n)
    sums = np.bincount(pairs[:, 0], values, minlength=n)
    return np.divide(sums, counts, out=np.full(n, np.nan), where=counts > 0)
