"""Search over chains of choices: what each costs alone, and what it costs after another.

A choice is made at every position of a row. Costs add up: one for each choice, and one for
each pair of neighbours. All searches are exact, for any costs, and walk the row once: from
its end to its start with the least cost, or the weight, of all ways from each choice to the
end, and then forwards along the way wanted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mograft._util.arrays import FloatArray, IntArray

__all__ = ["Trellis", "diverse", "k_best", "sample", "viterbi"]


@dataclass(frozen=True, eq=False)
class Trellis:
    """Costs of the choices at every position of a row.

    Attributes
    ----------
    alone : tuple of ndarray, each of shape (n_choices,)
        Cost of each choice by itself; infinite where it must not be made.
    after : tuple of ndarray, each of shape (n_choices, n_choices of the next position)
        For every position but the last, cost of each pair of neighbours.
    """

    unary: tuple[FloatArray, ...]
    pairwise: tuple[FloatArray, ...]

    def __len__(self) -> int:
        return len(self.unary)

    def cost(self, choices: IntArray) -> float:
        """Return what a row of choices costs.

        Parameters
        ----------
        choices : ndarray of int, shape (n_positions,)
            Which choice is made at each position.

        Returns
        -------
        float
            The sum of all costs.
        """
        at = choices.tolist()
        own = sum(float(costs[i]) for costs, i in zip(self.unary, at, strict=True))
        pairs = zip(self.pairwise, at[:-1], at[1:], strict=True)
        return own + sum(float(costs[i, j]) for costs, i, j in pairs)

    def add_unary(self, more: Sequence[FloatArray]) -> "Trellis":
        """Return the trellis with further costs of each choice by itself."""
        return replace(
            self, unary=tuple(own + other for own, other in zip(self.unary, more, strict=True))
        )


def viterbi(trellis: Trellis) -> IntArray:
    """Return the choices of least cost.

    Parameters
    ----------
    trellis : Trellis
        The costs.

    Returns
    -------
    ndarray of int, shape (n_positions,)
        Of equally cheap rows the one whose first choice has the lowest index, then its
        second, and so on.

    Notes
    -----
    Viterbi, IEEE Trans. Information Theory 13 (1967), backwards. Takes O(Σ n_p n_{p+1}).

    Examples
    --------
    >>> step = np.array([[0.0, 2.0], [2.0, 0.0]])
    >>> viterbi(Trellis((np.array([0.0, 1.0]), np.array([3.0, 0.0])), (step,)))
    array([1, 1])
    """
    if not len(trellis):
        return np.zeros(0, np.int64)
    to_end = [trellis.unary[-1]]
    for alone, after in zip(trellis.unary[-2::-1], trellis.pairwise[::-1], strict=True):
        to_end.append(alone + (after + to_end[-1]).min(axis=1))
    to_end.reverse()
    chosen = [int(to_end[0].argmin())]
    for after, onward in zip(trellis.pairwise, to_end[1:], strict=True):
        chosen.append(int((after[chosen[-1]] + onward).argmin()))
    return np.array(chosen, np.int64)


def k_best(trellis: Trellis, count: int) -> list[IntArray]:
    """Return the rows of choices of least cost, the cheapest first.

    Parameters
    ----------
    trellis : Trellis
        The costs.
    count : int
        How many are wanted.

    Returns
    -------
    list of ndarray of int, each of shape (n_positions,)
        All different; fewer where there are no more of finite cost. Equally cheap ones as in
        `viterbi`.

    Notes
    -----
    List Viterbi: every choice keeps its `count` cheapest ways to the end (Seshadri and
    Sundberg, IEEE Trans. Communications 42, 1994).

    Examples
    --------
    >>> trellis = Trellis((np.array([0.0, 1.0]), np.array([0.0, 5.0])), (np.zeros((2, 2)),))
    >>> [choices.tolist() for choices in k_best(trellis, 3)]
    [[0, 0], [1, 0], [0, 1]]
    """
    if not len(trellis):
        return [np.zeros(0, np.int64)] if count else []
    # Row i of `to_end` holds the cheapest ways on from choice i, ascending.
    to_end = trellis.unary[-1][:, None]
    nexts: list[tuple[IntArray, IntArray]] = []
    for alone, after in zip(trellis.unary[-2::-1], trellis.pairwise[::-1], strict=True):
        width = to_end.shape[1]
        through = (after[:, :, None] + to_end).reshape(len(alone), -1)
        order = np.argsort(through, axis=1, kind="stable")[:, :count]
        nexts.append((order // width, order % width))
        to_end = alone[:, None] + np.take_along_axis(through, order, axis=1)
    width = to_end.shape[1]
    order = np.argsort(to_end.ravel(), kind="stable")[:count]
    rows = []
    for start in order[np.isfinite(to_end.ravel()[order])].tolist():
        choice, rank = divmod(start, width)
        row = [choice]
        for onward, ranks in reversed(nexts):
            choice, rank = int(onward[choice, rank]), int(ranks[choice, rank])
            row.append(choice)
        rows.append(np.array(row, np.int64))
    return rows


def sample(trellis: Trellis, temperature: float, rng: np.random.Generator) -> IntArray:
    """Draw a row of choices with probability proportional to exp(-cost / temperature).

    Parameters
    ----------
    trellis : Trellis
        The costs.
    temperature : float
        In units of cost, above 0.
    rng : numpy.random.Generator
        Where the chance comes from: one number per position.

    Returns
    -------
    ndarray of int, shape (n_positions,)
        An exact draw, independent of all others.

    Notes
    -----
    Filtering one way and sampling the other (FFBS: Carter and Kohn, Biometrika 81, 1994),
    here backwards and forwards, in logarithms.
    """
    if not len(trellis):
        return np.zeros(0, np.int64)
    weights = [-trellis.unary[-1] / temperature]
    with np.errstate(divide="ignore"):  # no way on at all: log 0
        for alone, after in zip(trellis.unary[-2::-1], trellis.pairwise[::-1], strict=True):
            onward = weights[-1] - after / temperature
            top = onward.max(axis=1, initial=-np.inf)
            top[~np.isfinite(top)] = 0.0
            total = top + np.log(np.exp(onward - top[:, None]).sum(axis=1))
            weights.append(total - alone / temperature)
    chosen: list[int] = []
    for position, own in enumerate(reversed(weights)):
        before = trellis.pairwise[position - 1][chosen[-1]] / temperature if position else 0.0
        chosen.append(_draw(own - before, rng))
    return np.array(chosen, np.int64)


def diverse(trellis: Trellis, count: int, penalty: float) -> list[IntArray]:
    """Return rows of choices, each the cheapest where earlier ones' choices cost more.

    Parameters
    ----------
    trellis : Trellis
        The costs.
    count : int
        How many are wanted.
    penalty : float
        What a choice costs more for every earlier row that has made it.

    Returns
    -------
    list of ndarray of int, each of shape (n_positions,)
        All different, the first that of `viterbi`. Fewer where there are no more: where the
        penalty does not lead away from those that are there, the cheapest that is none of
        them is taken.

    Examples
    --------
    >>> trellis = Trellis((np.array([0.0, 1.0]), np.array([0.0, 5.0])), (np.zeros((2, 2)),))
    >>> [choices.tolist() for choices in diverse(trellis, 2, penalty=9.0)]
    [[0, 0], [1, 1]]
    """
    uses = [np.zeros(len(costs)) for costs in trellis.unary]
    rows: list[IntArray] = []
    seen: set[bytes] = set()
    while len(rows) < count:
        dearer = trellis.add_unary([penalty * used for used in uses])
        found = viterbi(dearer)
        if found.tobytes() in seen:
            # Among one more than there are, one is new, if there is any.
            others = (row for row in k_best(dearer, len(rows) + 1) if row.tobytes() not in seen)
            fresh = next(others, None)
            if fresh is None:
                break
            found = fresh
        rows.append(found)
        seen.add(found.tobytes())
        for used, choice in zip(uses, found.tolist(), strict=True):
            used[choice] += 1
    return rows


def _draw(weights: FloatArray, rng: np.random.Generator) -> int:
    """Draw an index by logarithmic weights."""
    shares = np.exp(weights - weights.max())
    ends = shares.cumsum()
    # The last end itself is never drawn; a choice of weight 0 has no room.
    return int(np.searchsorted(ends, rng.random() * ends[-1], side="right"))
