"""Numbers with confidence intervals, and the bootstrap of blocks that computes the intervals.

Neighbouring segments of a motion are correlated. The bootstrap therefore draws blocks of
neighbours, or whole clips, instead of single segments.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.extras import import_extra

BLOCK_SEGMENTS = 10  # neighbouring segments in one block: a few seconds of motion
MIN_CLIPS_AS_BLOCKS = 10  # from this number of clips on, each clip is one block
MIN_BLOCKS = 10  # number of blocks below which no interval is computed
_N_RESAMPLES = 2000
_MIN_FINITE_SHARE = 0.9  # share of the resamples that must have a finite value for an interval


class Record:
    """Base class of result dataclasses that become JSON objects."""

    def as_dict(self) -> dict[str, Any]:
        """Return a dict for JSON, with the fields in their order."""
        return {name: as_json(value) for name, value in vars(self).items()}


def as_json(value: object) -> object:
    """Convert records to dicts, tuples to lists, and floats that are not finite to None."""
    if isinstance(value, Record):
        return value.as_dict()
    if isinstance(value, tuple):
        return [as_json(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclass(frozen=True)
class Estimate(Record):
    """A number, its 95 % interval and the sample that it was computed from.

    Attributes
    ----------
    value : float
        The number; NaN if the sample is empty.
    low, high : float
        Ends of the interval; NaN if the sample is too small for an interval.
    n : int
        Sample size.
    unit : str
        What one element of the sample is, in the plural: "segments", "seams".
    interval_method : str
        Method of the interval, such as "bootstrap of 23 blocks".
    """

    value: float
    low: float
    high: float
    n: int
    unit: str
    interval_method: str

    @classmethod
    def without_value(cls, n: int, unit: str, interval_method: str) -> Self:
        """Return the estimate of a measure that could not be computed: no value, no interval."""
        return cls(math.nan, math.nan, math.nan, n, unit, interval_method)

    def text(self, digits: int = 3, scale: float = 1.0, suffix: str = "") -> str:
        """Format the number and its interval, as in "0.5 (0.2 to 0.8)".

        The text is "none" without a value, and "0.5 (no interval)" without an interval.

        Parameters
        ----------
        digits : int
            Digits after the decimal point.
        scale : float
            Factor on the number and on the interval, such as 100 for percent.
        suffix : str
            Text after the number, such as a unit.
        """
        if not math.isfinite(self.value):
            return "none"
        number = f"{self.value * scale:.{digits}f}{suffix}"
        if not (math.isfinite(self.low) and math.isfinite(self.high)):
            return f"{number} (no interval)"
        return f"{number} ({self.low * scale:.{digits}f} to {self.high * scale:.{digits}f})"

    def as_dict(self) -> dict[str, Any]:
        """Return a dict for JSON; values that are not finite become None."""
        interval = [self.low, self.high]
        return {
            "value": as_json(self.value),
            "interval": interval if np.isfinite(interval).all() else None,
            "n": self.n,
            "of": self.unit,
            "method": self.interval_method,
        }


@dataclass(frozen=True)
class MethodRecord(Record):
    """Base class of the measures of the grafts of one method.

    Attributes
    ----------
    method : str
        Name of the method that selected the donors.
    runs : int
        Number of grafts for each base.
    """

    method: str
    runs: int


def segment_blocks(clip: IntArray, size: int = BLOCK_SEGMENTS) -> IntArray:
    """Return the block of each segment; the bootstrap resamples whole blocks.

    A block has at most `size` neighbouring segments of one clip; with 10 clips or more, each clip
    is one block. Blocks are numbered from 0. `clip` has the clip of each segment; the segments must
    be ordered by clip and time.
    """
    clips, first, index = np.unique(clip, return_index=True, return_inverse=True)
    if len(clips) >= MIN_CLIPS_AS_BLOCKS:
        return index.astype(np.int64)
    pairs = np.stack([index, (np.arange(len(clip)) - first[index]) // size], axis=1)
    return np.unique(pairs, axis=0, return_inverse=True)[1].astype(np.int64).reshape(-1)


def bootstrap_estimate(
    value: float,
    statistic: Callable[[FloatArray], FloatArray],
    n_blocks: int,
    *,
    n: int,
    unit: str,
    seed: int,
) -> Estimate:
    """Return an estimate with a value and a 95 % bootstrap interval (percentile method).

    `statistic` maps the number of times that each block is drawn, shape (n_resamples, n_blocks),
    to one value per resample. Values that are not finite are ignored. The ends of the interval are
    NaN with fewer than 10 blocks, or if 10 % of the values or more are not finite.
    Source: Künsch, Annals of Statistics 17 (1989).
    """
    low = high = math.nan
    if n_blocks >= MIN_BLOCKS:
        equal = np.full(n_blocks, 1.0 / n_blocks)
        draws = np.random.default_rng(seed).multinomial(n_blocks, equal, size=_N_RESAMPLES)
        with np.errstate(divide="ignore", invalid="ignore"):
            values = statistic(draws.astype(np.float64))
        is_finite = np.isfinite(values)
        if is_finite.mean() > _MIN_FINITE_SHARE:
            low, high = np.percentile(values[is_finite], [2.5, 97.5]).tolist()
    method = f"bootstrap of {n_blocks} blocks"
    return Estimate(value=value, low=low, high=high, n=n, unit=unit, interval_method=method)


def block_mean(values: npt.ArrayLike, blocks: npt.ArrayLike, unit: str, seed: int = 0) -> Estimate:
    """Return the mean of `values` with a bootstrap interval that resamples blocks.

    NaN values are ignored. `blocks` has the block of each value, `unit` names the values.
    `Estimate.n` is the number of values, not of blocks.
    """
    array = np.asarray(values, np.float64)
    is_finite = np.isfinite(array)
    finite = array[is_finite]
    if not len(finite):
        return Estimate.without_value(0, unit, "block bootstrap")
    _, index = np.unique(np.asarray(blocks)[is_finite], return_inverse=True)
    sums, counts = np.bincount(index, finite), np.bincount(index).astype(np.float64)

    def mean(draws: FloatArray) -> FloatArray:
        return np.asarray((draws @ sums) / (draws @ counts), np.float64)

    value, n = float(finite.mean()), len(finite)
    return bootstrap_estimate(value, mean, len(sums), n=n, unit=unit, seed=seed)


def import_measure(name: str) -> Any:  # noqa: ANN401 - a module of another package
    """Import a module of a package that the extra `evaluate` installs; see `import_extra`."""
    package = "scikit-learn" if name.startswith("sklearn") else "SciPy"
    return import_extra(name, f"this measure needs {package}", "evaluate")
