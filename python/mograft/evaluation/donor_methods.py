"""Rules of donor selection with one interface, and grafts whose donors a rule selects.

A rule defines the candidates for each base segment. By default, one candidate is drawn at random
for each segment; rules with `Method.uses_cost` select by cost instead. `RandomLength` is the rule
to compare with: what a similar base part is worth.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mograft._util.arrays import IntArray
from mograft.config import Config
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.search.costs import length_fits
from mograft.search.donor_choice import draw_uniform, prune_dead_ends
from mograft.search.segment_pool import SegmentPool
from mograft.search.trellis import DonorSequences
from mograft.solve.plan import GraftPlan
from mograft.synthesis.graft import Grafts

_MAX_DRAWN = 100  # candidates of a position among which seams are compared, at most


@dataclass(frozen=True)
class Method:
    """Base class of the methods that select donors.

    Attributes
    ----------
    name : str
        Name in reports.
    has_seam_limit : bool
        Whether a donor is drawn only from the candidates whose seam angle with the previous
        donor is at most `Config.max_angle`.
    uses_cost : bool
        Whether `Config.choice` selects the donors. If not, they are drawn at random.
    config_changes : tuple of (str, value)
        Fields that replace those of the configuration of the library, such as
        ``(("seam", "paper"),)``. Fields that determine the segments or the embedding are not
        allowed.
    """

    name: str = ""
    has_seam_limit: bool = True
    uses_cost: bool = False
    config_changes: tuple[tuple[str, Any], ...] = ()

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return the candidates for base segments.

        Parameters
        ----------
        library : Library
            Library with the segments.
        scenario : ndarray of int, shape (n_positions,)
            Base segments.

        Returns
        -------
        list of ndarray of int
            Candidates of each base segment in ascending order, including the segment itself.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class RandomLength(Method):
    """Method that draws donors of similar length at random, without a comparison of motions."""

    name: str = "random, length limit"

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return the candidates for base segments; see `Method.candidates`."""
        lengths = library.segments.lengths
        found: list[IntArray] = []
        for segment in scenario.tolist():
            fits = length_fits(lengths[[segment]], lengths, library.rate, library.config)
            fits = fits & library.is_donor
            fits[segment] = True
            found.append(np.flatnonzero(fits))
        return found


def grafts_by(
    method: Method,
    library: Library,
    base: Motion | str | int | None = None,
    count: int = 1,
    *,
    swap: Sequence[str] | None = None,
    seed: int = 0,
) -> Grafts:
    """Return grafts as `mograft.graft_many` does, but with donors that `method` selects.

    Parameters
    ----------
    method : Method
        Method that selects the donors.
    library, base, count, swap, seed
        As for `mograft.graft_many`.

    Returns
    -------
    sequence of Graft
        Each graft is computed when it is accessed.

    Raises
    ------
    InsufficientDataError
        If the library lacks something that the method needs, such as known legs.
    ValueError
        As for `mograft.graft_many`.

    Notes
    -----
    If `Method.uses_cost` is False, each donor is drawn uniformly from the candidates. With
    `Method.has_seam_limit`, the sequences are those of `Config.choice` "random" (paper, 4.4): each
    donor is drawn from the candidates whose seam angle with the previous donor is at most
    `Config.max_angle`. Candidates from which no such sequence reaches the last position are removed
    first. Self-repair is off.

    Examples
    --------
    >>> import mograft as mg
    >>> from mograft.dancer import dance
    >>> library = mg.Library.build(dance(strides=1).motion)
    >>> new = grafts_by(RandomLength(), library, seed=1)[0]
    >>> new.motion.n_frames == new.base.n_frames
    True
    """
    plan, donors = draw_donors(method, library, base, count, swap=swap, seed=seed)
    return Grafts(plan, tuple(donors), seed)


def draw_donors(
    method: Method,
    library: Library,
    base: Motion | str | int | None = None,
    count: int = 1,
    *,
    swap: Sequence[str] | None = None,
    seed: int = 0,
) -> tuple[GraftPlan, list[DonorSequences]]:
    """Select donors as `grafts_by` does, without computing the motions.

    Return the plan of the grafts and, for each graft, the donor sequence of each grafted group.
    Self-repair is off in the plan, so that no donor that a method selected is replaced.
    """
    if method.config_changes:
        library = library.relabelled(replace(library.config, **dict(method.config_changes)))
    plan = GraftPlan.build(library, base, swap, ())
    problem = plan.problem
    candidates = method.candidates(problem.library, problem.scenario)
    found, config = dict.fromkeys(problem.pools, candidates), problem.config
    problem = replace(problem, candidates=found, config=replace(config, self_repair=False))
    plan = replace(plan, problem=problem)
    if method.uses_cost:
        return plan, plan.choose_donors(count, seed)
    rng = np.random.default_rng(seed)
    drawn = {
        group: _draw_sequences(method, pool, candidates, problem.config, count, rng)
        for group, pool in problem.pools.items()
    }
    return plan, [{group: own[index] for group, own in drawn.items()} for index in range(count)]


def _draw_sequences(
    method: Method,
    pool: SegmentPool,
    candidates: list[IntArray],
    config: Config,
    count: int,
    rng: np.random.Generator,
) -> list[IntArray]:
    """Draw donors for each position as `Config.choice` "random" does (paper, 4.4).

    Without `Method.has_seam_limit`, the draws are independent. Otherwise, if a position has more
    than 100 candidates, each sequence is drawn from 100 random ones of them.
    """
    if not method.has_seam_limit:
        return [np.array(list(map(rng.choice, candidates)), np.int64) for _ in range(count)]
    if max(map(len, candidates), default=0) <= _MAX_DRAWN:
        pruned = prune_dead_ends(pool, candidates, config)
        return [draw_uniform(*pruned, config, rng) for _ in range(count)]

    def limit(segments: IntArray) -> IntArray:
        is_short = len(segments) <= _MAX_DRAWN
        return segments if is_short else np.sort(rng.choice(segments, _MAX_DRAWN, replace=False))

    def draw() -> IntArray:
        pruned = prune_dead_ends(pool, list(map(limit, candidates)), config)
        return draw_uniform(*pruned, config, rng)

    return [draw() for _ in range(count)]
