"""Numbers with how sure they are: intervals that respect what hangs together in time."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.segmentation import Segments

__all__ = ["BLOCK", "Estimate", "blocks", "bootstrap", "mean", "rogan_gladen", "share"]

BLOCK = 10
"""Neighbouring segments that are drawn together: a few seconds, beyond which motions forget."""
CLIPS = 10
"""With so many clips, clips are drawn instead: nothing hangs together across them."""
FEWEST = 5
"""Blocks below which no interval is given: a resampling of two or three tells nothing."""
_DRAWS = 2000
_Z = 1.959963984540054


@dataclass(frozen=True)
class Estimate:
    """A number, its 95 % interval and what it was computed from.

    Attributes
    ----------
    value : float
        The number.
    low, high : float
        Ends of the interval; NaN where the sample is too small for one.
    n : int
        Size of the sample.
    of : str
        What was counted.
    interval : str
        How the interval was found.
    """

    value: float
    low: float
    high: float
    n: int
    of: str
    interval: str

    def __str__(self) -> str:
        return self.text()

    def text(self, digits: int = 3, scale: float = 1.0, unit: str = "") -> str:
        """Return the number and its interval in words.

        Parameters
        ----------
        digits : int
            Digits behind the point.
        scale : float
            What to multiply by, as 100 for percent.
        unit : str
            What to put behind the number.
        """
        if not math.isfinite(self.value):
            return "none"
        told = f"{self.value * scale:.{digits}f}{unit}"
        if not (math.isfinite(self.low) and math.isfinite(self.high)):
            return f"{told} (no interval)"
        return f"{told} ({self.low * scale:.{digits}f} to {self.high * scale:.{digits}f})"

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it: what is not finite is None."""
        low, high, value = (
            x if math.isfinite(x) else None for x in (self.low, self.high, self.value)
        )
        return {
            "value": value,
            "interval": None if low is None or high is None else [low, high],
            "n": self.n,
            "of": self.of,
            "method": self.interval,
        }


def share(hits: int, n: int, of: str) -> Estimate:
    """Return which share of independent trials succeeded, with Wilson's interval.

    Parameters
    ----------
    hits, n : int
        Successes and trials.
    of : str
        What the trials are.

    Returns
    -------
    Estimate
        NaN where there is no trial.

    Notes
    -----
    Wilson, Journal of the American Statistical Association 22 (1927).

    Examples
    --------
    >>> print(share(9, 10, "labels"))
    0.900 (0.596 to 0.982)
    """
    if n == 0:
        return Estimate(math.nan, math.nan, math.nan, 0, of, "Wilson")
    p, z = hits / n, _Z
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    # At the ends rounding may leave the interval a hair short of the share itself.
    return Estimate(
        p, min(max(middle - half, 0.0), p), max(min(middle + half, 1.0), p), n, of, "Wilson"
    )


def blocks(cut: Segments, size: int = BLOCK) -> IntArray:
    """Return which segments hang together: clips of many, else neighbours within a clip.

    Parameters
    ----------
    cut : Segments
        Clip by clip in order of time.
    size : int
        Neighbours in a block.

    Returns
    -------
    ndarray of int, shape (n_segments,)
        Numbers from 0.
    """
    clips, clip = np.unique(cut.clip, return_inverse=True)
    if len(clips) >= CLIPS:
        return clip.astype(np.int64)
    place = np.concatenate([np.arange(n) for n in np.bincount(clip)]) if len(cut) else clip
    pairs = np.stack([clip, place // size], axis=1)
    return np.unique(pairs, axis=0, return_inverse=True)[1].astype(np.int64).reshape(-1)


def bootstrap(
    statistic: Callable[[FloatArray], FloatArray], n_blocks: int, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Return the 95 % percentile interval of a statistic under resampling of blocks.

    Parameters
    ----------
    statistic : callable
        Takes how often each block is drawn, shape (n_draws, n_blocks), and returns one value
        or row of values per draw; what is not finite is left out.
    n_blocks : int
        How many blocks there are.
    seed : int
        Of the draws.

    Returns
    -------
    low, high : ndarray
        NaN where there are fewer than five blocks, or too few draws gave a value.

    Notes
    -----
    Künsch, Annals of Statistics 17 (1989): what hangs together is drawn together.
    """
    rng = np.random.default_rng(seed)
    n = max(n_blocks, 1)
    drawn = rng.multinomial(n, np.full(n, 1.0 / n), size=_DRAWS).astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.asarray(statistic(drawn), np.float64)
    values = values.reshape(_DRAWS, -1)
    values[~np.isfinite(values)] = np.nan
    enough = (np.isfinite(values).mean(axis=0) > 0.9) & (n_blocks >= FEWEST)
    ends = np.full((2, values.shape[1]), np.nan)
    if enough.any():
        ends[:, enough] = np.nanpercentile(values[:, enough], [2.5, 97.5], axis=0)
    return ends[0], ends[1]


def mean(values: npt.ArrayLike, block: npt.ArrayLike, of: str, seed: int = 0) -> Estimate:
    """Return a mean with an interval that resamples blocks.

    Parameters
    ----------
    values : array_like, shape (n,)
        What is averaged; NaN is left out.
    block : array_like of int, shape (n,)
        Which values hang together.
    of : str
        What the values belong to.
    seed : int
        Of the resampling.

    Returns
    -------
    Estimate
        Its `n` counts values, not blocks.
    """
    given = np.asarray(values, np.float64)
    kept = np.isfinite(given)
    given, members = given[kept], np.asarray(block)[kept]
    if not len(given):
        return Estimate(math.nan, math.nan, math.nan, 0, of, "block bootstrap")
    own, index = np.unique(members, return_inverse=True)
    sums = np.bincount(index, given)
    counts = np.bincount(index).astype(np.float64)
    low, high = bootstrap(lambda drawn: (drawn @ sums) / (drawn @ counts), len(own), seed)
    how = f"bootstrap of {len(own)} blocks"
    return Estimate(float(given.mean()), float(low[0]), float(high[0]), len(given), of, how)


def rogan_gladen(positive: float, sensitivity: float, specificity: float) -> float:
    """Return the true share of positives behind the share that a fallible test finds.

    Parameters
    ----------
    positive : float
        Share that the test calls positive.
    sensitivity, specificity : float
        Shares of true positives and of true negatives that it calls rightly.

    Returns
    -------
    float
        May lie outside of 0 to 1, which says that the errors were not what they are taken
        for. NaN where the test is no better than chance.

    Notes
    -----
    Rogan and Gladen, American Journal of Epidemiology 107 (1978).

    Examples
    --------
    The paper's 823 of 906 with an accuracy of 0.77 on both sides:

    >>> round(rogan_gladen(823 / 906, 0.77, 0.77), 2)
    1.26
    """
    gain = sensitivity + specificity - 1.0
    return (positive + specificity - 1.0) / gain if gain > 0 else math.nan
