"""Generative motion matching, a baseline: patches of examples, from coarse to fine, from noise.

Own implementation of Li, Chen, Li, Sorkine-Hornung and Chen, "Example-based Motion Synthesis via
Generative Motion Matching", ACM Transactions on Graphics 42 (2023), without the parts that are
specific to one skeleton: skeleton-aware patches, contact labels and the repair of feet by inverse
kinematics. The constants are those of the authors' settings.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Settings:
    """Constants of the method.

    Attributes
    ----------
    patch : int
        Frames of a patch.
    alpha : float
        Weight of completeness: with small values every example patch is used.
    steps : int
        Times that all patches are replaced at one scale.
    factor : float
        Ratio of the numbers of frames at one scale and at the next finer one.
    coarsest : float
        Smallest share of the frames that the coarsest scale has; 1 for one scale.
    noise : float
        Standard deviation of the features from which the coarsest scale starts.
    """

    patch: int = 11
    alpha: float = 0.01
    steps: int = 3
    factor: float = 0.75
    coarsest: float = 0.2
    noise: float = 10.0

    def scales(self):
        """Return the shares of the frames at every scale, from the coarsest to 1."""
        shares = [1.0]
        while shares[-1] * self.factor >= self.coarsest:
            shares.append(shares[-1] * self.factor)
        return shares[::-1]


@dataclass(frozen=True, eq=False)
class Kept:
    """Features of the result that are given, such as those of the legs.

    Attributes
    ----------
    columns : ndarray of int
        The columns that are given.
    values : ndarray, shape (n_frames, n_columns)
        Their values.
    example, radius : int
        Patches of this example, less than `radius` frames from the same frame, are not used: the
        patches that the values were taken from would give the example itself. A radius of 0
        excludes nothing.
    """

    columns: np.ndarray
    values: np.ndarray
    example: int = 0
    radius: int = 0


def synthesize(examples, n_frames, rng, settings=None, kept=None, start=None):
    """Return the features of a new motion, shape (n_frames, n_features).

    `examples` are arrays of shape (n, n_features). `start`, shape (n_frames, n_features), replaces
    the zeros to which noise is added at the coarsest scale.
    """
    settings = settings or Settings()
    result = np.zeros((n_frames, examples[0].shape[1])) if start is None else start
    for number, share in enumerate(settings.scales()):
        length = _length(n_frames, share, settings)
        scaled = [resample(one, _length(len(one), share, settings)) for one in examples]
        result = resample(result, length)
        if number == 0:
            result = result + settings.noise * rng.standard_normal(result.shape)
        for _ in range(settings.steps):
            result = _apply(kept, result)
            result = _match(scaled, result, settings, _excluded(kept, scaled, length, n_frames))
    return _apply(kept, result)


def _length(n_frames, share, settings):
    return max(round(n_frames * share), min(settings.patch, n_frames))


def resample(features, n_frames):
    """Interpolate features linearly at `n_frames` equidistant instants."""
    if n_frames == len(features):
        return features
    times = np.linspace(0, len(features) - 1, n_frames)
    before = np.minimum(times.astype(np.int64), max(len(features) - 2, 0))
    weights = (times - before)[:, None]
    after = np.minimum(before + 1, len(features) - 1)
    return features[before] * (1 - weights) + features[after] * weights


def _apply(kept, result):
    if kept is None:
        return result
    result = result.copy()
    result[:, kept.columns] = resample(kept.values, len(result))
    return result


def _match(examples, result, settings, is_excluded):
    """Replace every patch by its most similar example patch, and average where patches overlap."""
    size = min(settings.patch, len(result), *(len(one) for one in examples))
    firsts = np.concatenate(
        [
            offset + np.arange(len(one) - size + 1)
            for offset, one in zip(_offsets(examples), examples, strict=True)
        ]
    )
    frames = np.concatenate(examples)
    distances = _patch_distances(result, frames, size)[:, firsts]
    # The bidirectional similarity: a patch that is near to no query becomes cheaper.
    if is_excluded is None:
        scores = distances / (settings.alpha + distances.min(axis=0))
    else:
        barred = is_excluded[: len(distances), firsts]
        barred &= ~barred.all(axis=1, keepdims=True)
        nearest = np.where(barred, np.inf, distances).min(axis=0)
        scores = np.where(barred, np.inf, distances / (settings.alpha + nearest))
    nearest = firsts[scores.argmin(axis=1)]
    total = np.zeros_like(result)
    counts = np.zeros((len(result), 1))
    for offset in range(size):
        total[offset : offset + len(nearest)] += frames[nearest + offset]
        counts[offset : offset + len(nearest)] += 1
    return total / counts


def _patch_distances(result, frames, size):
    """Return the mean squared differences of all pairs of patches, by their first frames."""
    squared = (result**2).sum(axis=1)[:, None] + (frames**2).sum(axis=1) - 2 * result @ frames.T
    n, m = len(result) - size + 1, len(frames) - size + 1
    total = np.zeros((n, m))
    for offset in range(size):
        total += squared[offset : offset + n, offset : offset + m]
    return np.maximum(total, 0.0) / (size * frames.shape[1])


def _offsets(examples):
    return np.cumsum([0, *(len(one) for one in examples[:-1])])


def _excluded(kept, examples, length, n_frames):
    """Return which example patches, by first frame, may not replace which patches; None for none.

    A patch for which no other is left may be replaced by any.
    """
    if kept is None or kept.radius == 0:
        return None
    radius = kept.radius * length / n_frames
    is_excluded = np.zeros((length, sum(map(len, examples))), bool)
    own, start = examples[kept.example], _offsets(examples)[kept.example]
    apart = np.abs(np.arange(length)[:, None] * (len(own) / length) - np.arange(len(own)))
    is_excluded[:, start : start + len(own)] = apart < radius
    return is_excluded
