"""Normalised compatibility κ of methods, with intervals on common resamples."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mograft.evaluation.estimate import Estimate, Record, bootstrap_estimate

_BlockSums = tuple[np.ndarray, np.ndarray]  # sums and counts, each (n_splits, n_blocks)


@dataclass(frozen=True)
class Difference(Record):
    """Difference between two methods, on the segments for which both have a donor.

    Attributes
    ----------
    first, second : str
        Names of the methods.
    kappa : Estimate
        κ of the first method minus κ of the second; the rates of captured and random parts are
        from the same segments.
    accepted : Estimate
        Acceptance rate of the first method minus that of the second.
    """

    first: str
    second: str
    kappa: Estimate
    accepted: Estimate

    @property
    def verdict(self):
        """The interval of κ relative to 0: "undecided" if it contains 0 or is NaN."""
        if not math.isfinite(self.kappa.low):
            return "undecided"
        if self.kappa.low > 0:
            return "above"
        return "below" if self.kappa.high < 0 else "undecided"

    def as_dict(self):
        """Return a dict for JSON."""
        return {**super().as_dict(), "verdict": self.verdict}


@dataclass(frozen=True, eq=False)
class Kappas:
    """Acceptance rates of pairs (base segment, donor), from which κ is computed.

    κ = (a_method - a_random) / (a_captured - a_random), where a is the acceptance rate of the
    donors that a method selects, of random donors, or of base segments as their own donors. The
    rates have shape (n_splits, n_segments), with NaN for segments without a score or without a
    donor. The intervals resample blocks and splits.
    """

    captured: np.ndarray
    random: np.ndarray
    accepted: Mapping[str, np.ndarray]  # by method
    blocks: np.ndarray  # shape (n_segments,); see `segment_blocks`
    seed: int

    def mean(self, values, unit):
        """Return the mean of `values`, shape (n_splits, n_segments), as an `Estimate` in `unit`."""
        terms = [self._block_sums(values, values)]
        return self._estimate(terms, lambda means: means[0], values, unit)

    def kappa(self, method, *, is_matched=False):
        """Return κ of a method; its `Estimate.n` is the number of segments with a donor.

        If `is_matched`, a_captured and a_random are computed from the segments with a donor only,
        instead of from all segments.
        """
        terms = self._kappa_terms(method, is_matched=is_matched)
        return self._estimate(terms, _kappa, self.accepted[method], "segments with a donor")

    def difference(self, first, second):
        """Return the difference of two methods on the segments for which both have a donor."""
        common = self.accepted[first] + self.accepted[second]
        rates = [
            self._block_sums(values, common)
            for values in (self.accepted[first], self.accepted[second], self.random, self.captured)
        ]
        unit = "segments with a donor by both methods"
        return Difference(
            first=first,
            second=second,
            kappa=self._estimate(rates, _kappa_difference, common, unit),
            accepted=self._estimate(rates[:2], lambda means: means[0] - means[1], common, unit),
        )

    def _block_sums(self, values, where):
        distinct, index = np.unique(self.blocks, return_inverse=True)
        is_used = np.isfinite(values) & np.isfinite(where)
        per_split = [
            (
                np.bincount(index[used], row[used], minlength=len(distinct)),
                np.bincount(index[used], minlength=len(distinct)),
            )
            for row, used in zip(values, is_used, strict=True)
        ]
        sums, counts = (np.array(rows, np.float64) for rows in zip(*per_split, strict=True))
        return sums, counts

    def _kappa_terms(self, method, *, is_matched=False):
        accepted = self.accepted[method]
        where = accepted if is_matched else self.captured
        return [
            self._block_sums(accepted, accepted),
            self._block_sums(self.random, where),
            self._block_sums(self.captured, where),
        ]

    def _estimate(self, terms, combine, values, unit):
        n_splits, n_blocks = terms[0][0].shape
        interval_method = f"bootstrap of {n_blocks} blocks and {n_splits} splits"
        n = int(np.isfinite(values).any(axis=0).sum())
        if min(float(counts.sum()) for _, counts in terms) == 0:
            return Estimate.without_value(n, unit, interval_method)
        value = combine([np.array(sums.sum() / counts.sum()) for sums, counts in terms])
        rng = np.random.default_rng(self.seed)

        def statistic(multiplicities):
            equal = np.full(n_splits, 1.0 / n_splits)
            splits = rng.multinomial(n_splits, equal, len(multiplicities))
            means = []
            for sums, counts in terms:
                total, number = (
                    (splits * (multiplicities @ term.T)).sum(axis=1) for term in (sums, counts)
                )
                means.append(total / number)
            return combine(means)

        found = bootstrap_estimate(
            float(value), statistic, n_blocks, n=n, unit=unit, seed=self.seed
        )
        return replace(found, interval_method=interval_method)


def _kappa(means):
    accepted, random, captured = means
    return (accepted - random) / (captured - random)


def _kappa_difference(means):
    first, second, random, captured = means
    return (first - second) / (captured - random)
