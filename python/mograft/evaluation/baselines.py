"""Ways to choose donors, the method among them, behind one interface.

What a way is judged by is the set of donors that it lets into a segment's place. Drawn at
random from these, all ways differ in nothing but the rule.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby
from typing import Any

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.body.contacts import detect_contacts, find_legs
from mograft.errors import InsufficientDataError
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.search.candidates import SegmentPool
from mograft.search.costs import length_fits
from mograft.search.trellis import DonorSequences
from mograft.synthesis.graft import Grafts
from mograft.synthesis.graft_plan import GraftPlan
from mograft.synthesis.graft_result import Graft

__all__ = [
    "Analogy",
    "ByCost",
    "Captured",
    "ContactPattern",
    "Method",
    "Nearest",
    "Random",
    "RandomLength",
    "contact_patterns",
    "contact_words",
    "donors_by",
    "grafts_by",
    "methods",
]

_SAMPLES = 10


@dataclass(frozen=True)
class Method:
    """A way to choose donors.

    Attributes
    ----------
    name : str
        What to call it.
    limits_seams : bool
        Whether a donor is drawn among those within `Config.max_angle` of the one before.
    by_cost : bool
        Whether donors are chosen by `Config.choice` instead of drawn.
    changes : tuple of (str, value)
        Fields of the library's configuration that differ, as ``(("seam", "paper"),)``: any
        but those that its segments and embedding are built by.
    """

    name: str = ""
    limits_seams: bool = True
    by_cost: bool = False
    changes: tuple[tuple[str, Any], ...] = ()

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return who may take the places of some segments.

        Parameters
        ----------
        library : Library
            The segments.
        scenario : ndarray of int, shape (n_positions,)
            The base segments.

        Returns
        -------
        list of ndarray of int
            For each the donors, ascending, itself among them.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class Analogy(Method):
    """The paper's rule: donors whose base part is in the same cluster and fits in length."""

    name: str = "analogy"

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return who may take the places of some segments; see `Method.candidates`."""
        return _pool(library).candidate_lists(scenario, library.config)


@dataclass(frozen=True)
class ByCost(Analogy):
    """The same donors, chosen as the library's configuration says: by default by their cost."""

    name: str = "analogy, by cost"
    by_cost: bool = True


@dataclass(frozen=True)
class Captured(Method):
    """Nothing but its own part: the recording once more."""

    name: str = "captured"

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:  # noqa: ARG002
        """Return who may take the places of some segments; see `Method.candidates`."""
        return [np.array([own]) for own in scenario.tolist()]


@dataclass(frozen=True)
class Random(Method):
    """Any donor at all, whatever its length and whatever the seam."""

    name: str = "random"
    limits_seams: bool = False

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return who may take the places of some segments; see `Method.candidates`."""
        everyone = np.ones(len(library.segments), bool)
        return [_listed(library, own, everyone) for own in scenario.tolist()]


@dataclass(frozen=True)
class RandomLength(Method):
    """Any donor of fitting length: what the clusters must be better than."""

    name: str = "random, length limit"

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return who may take the places of some segments; see `Method.candidates`."""
        return [_listed(library, own, _fits(library, own)) for own in scenario.tolist()]


@dataclass(frozen=True)
class ContactPattern(Method):
    """Donors whose feet touch the ground alike, and that fit in length.

    After Ikemoto and Forsyth (Symposium on Computer Animation 2004) as the paper describes
    their best rule; their own list of rules was not at hand.

    Attributes
    ----------
    tolerance : int
        Of ten instants and each foot, in how many the contact may differ for two feet.
    exact : bool
        Whether instead the order of contact states must be the same, however long each
        lasts, states of a single frame aside.
    """

    name: str = "contact pattern"
    tolerance: int = 2
    exact: bool = False

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return who may take the places of some segments; see `Method.candidates`."""
        lists = []
        words = np.array(contact_words(library) if self.exact else [])
        states = contact_patterns(library)
        for own in scenario.tolist():
            if self.exact:
                alike = words == words[own]
            else:
                differ = (states != states[own]).reshape(len(states), -1).sum(axis=1)
                alike = differ <= self.tolerance
            lists.append(_listed(library, own, alike & _fits(library, own)))
        return lists


@dataclass(frozen=True)
class Nearest(Method):
    """The donors whose base parts are nearest, without clusters.

    Attributes
    ----------
    count : int
        How many of fitting length.
    """

    name: str = "nearest neighbours"
    count: int = 6

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return who may take the places of some segments; see `Method.candidates`."""
        embedding = library.embedding[library.groups.base]
        if embedding is None:
            raise InsufficientDataError("nearest neighbours need base parts that differ")
        lists = []
        for own in scenario.tolist():
            fits = _fits(library, own) & library.is_donor
            fits[own] = False
            others = np.flatnonzero(fits)
            apart = np.linalg.norm(embedding.points[others] - embedding.points[own], axis=1)
            nearest = others[np.argsort(apart, kind="stable")[: self.count]]
            lists.append(np.sort(np.append(nearest, own)))
        return lists


def methods(library: Library) -> tuple[Method, ...]:
    """Return the ways that the experiments compare, for a library.

    Parameters
    ----------
    library : Library
        Contact patterns need legs in its skeleton; nearest neighbours something to compare.

    Returns
    -------
    tuple of Method
        From chance to choice.
    """
    ways: list[Method] = [Random(), RandomLength()]
    if find_legs(library.skeleton):
        ways.append(ContactPattern())
    if library.embedding[library.groups.base] is not None:
        ways.append(Nearest())
    ways += [Analogy(), ByCost()]
    # Posture alignment is that of Heck et al. 2006.
    aligned = ByCost(f"{ByCost.name}, posture aligned", changes=(("torso", "world"),))
    return (*ways, aligned)


def contact_patterns(library: Library) -> BoolArray:
    """Return how the feet touch the ground in every segment.

    Parameters
    ----------
    library : Library
        The segments.

    Returns
    -------
    ndarray of bool, shape (n_segments, 10, n_legs)
        Whether a foot stands, as `mograft.body.contacts.contacts` tells, at ten equal times.

    Raises
    ------
    InsufficientDataError
        If the skeleton has no legs.
    """
    touching, cut = _touching(library), library.segments
    states = np.empty((len(cut), _SAMPLES, touching[0].shape[1]), bool)
    steps = np.linspace(0.0, 1.0, _SAMPLES)
    for index, own in enumerate(touching):
        mine = cut.of_clip(index)
        frames = cut.start[mine][:, None] + steps * cut.lengths[mine][:, None]
        states[mine] = own[frames.round().astype(np.int64)]
    return states


def contact_words(library: Library) -> list[str]:
    """Return in which order the feet touch the ground in every segment.

    Parameters
    ----------
    library : Library
        The segments.

    Returns
    -------
    list of str
        As "10>11>01" with a digit for each leg: states in their order, those of a single
        frame left out.

    Raises
    ------
    InsufficientDataError
        If the skeleton has no legs.
    """
    touching, cut = _touching(library), library.segments
    words = []
    for start, stop, clip in zip(cut.start, cut.stop, cut.clip, strict=True):
        rows = touching[clip][start : stop + 1].astype(np.int64).tolist()
        codes = ["".join(map(str, row)) for row in rows]
        lasting = [code for code, run in groupby(codes) if sum(1 for _ in run) > 1] or codes[:1]
        words.append(">".join(code for code, _ in groupby(lasting)))
    return words


@lru_cache(maxsize=1)
def _touching(library: Library) -> list[BoolArray]:
    if not find_legs(library.skeleton):
        raise InsufficientDataError("contact patterns need legs: none is known in the skeleton")
    return [np.asarray(detect_contacts(clip).any(axis=2), bool) for clip in library.clips]


def grafts_by(
    method: Method,
    library: Library,
    base: Motion | str | None = None,
    count: int = 1,
    *,
    swap: Sequence[str] | None = None,
    seed: int = 0,
) -> Sequence[Graft]:
    """Make motions whose donors one way has chosen; all else is as `mograft.graft_many` does.

    Parameters
    ----------
    method : Method
        The way.
    library, base, count, swap, seed
        As for `mograft.graft_many`.

    Returns
    -------
    sequence of Graft
        Each made when it is asked for.

    Raises
    ------
    InsufficientDataError
        If the way cannot be gone with this library.
    ValueError
        As for `mograft.graft_many`.

    Notes
    -----
    Where nothing is by cost, each donor is drawn uniformly among those whose seam with the one
    before is within `Config.max_angle`, else the nearest is taken (paper, 4.4).

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> new = grafts_by(Random(), library, seed=1)[0]
    >>> new.motion.n_frames == new.base.n_frames
    True
    """
    plan, draws = _planned(method, library, base, count, swap, seed)
    return Grafts(plan, tuple(draws), seed)


def donors_by(
    method: Method,
    library: Library,
    base: Motion | str | None = None,
    count: int = 1,
    *,
    swap: Sequence[str] | None = None,
    seed: int = 0,
) -> tuple[IntArray, list[DonorSequences]]:
    """Choose donors as `grafts_by` does, without making the motions.

    Parameters
    ----------
    method, library, base, count, swap, seed
        As for `grafts_by`.

    Returns
    -------
    scenario : ndarray of int, shape (n_positions,)
        The base segments.
    draws : list of dict of str to ndarray of int
        For each motion and grafted group the donors.
    """
    plan, draws = _planned(method, library, base, count, swap, seed)
    return plan.problem.scenario, draws


def _planned(
    method: Method,
    library: Library,
    base: Motion | str | None,
    count: int,
    swap: Sequence[str] | None,
    seed: int,
) -> tuple[GraftPlan, list[DonorSequences]]:
    if method.changes:
        library = library.relabelled(replace(library.config, **dict(method.changes)))
    plan = GraftPlan.build(library, base, swap, ())
    problem = plan.problem
    allowed = method.candidates(problem.library, problem.scenario)
    plan = replace(plan, problem=replace(problem, candidates=dict.fromkeys(problem.pools, allowed)))
    if method.by_cost:
        return plan, plan.choose_donors(count, seed)
    rng = np.random.default_rng(seed)
    limit = problem.config.max_angle if method.limits_seams else np.pi
    return plan, [
        {group: _drawn(pool, allowed, limit, rng) for group, pool in problem.pools.items()}
        for _ in range(count)
    ]


def _drawn(
    pool: SegmentPool, allowed: Sequence[IntArray], limit: float, rng: np.random.Generator
) -> IntArray:
    """Draw donors one after the other, as the paper does."""
    chosen: list[int] = []
    for own in allowed:
        passing = own
        if chosen and limit < np.pi:
            gaps: FloatArray = pool.seam_angles(np.array(chosen[-1:]), own)[0]
            passing = own[gaps <= limit] if (gaps <= limit).any() else own[[int(gaps.argmin())]]
        chosen.append(int(rng.choice(passing)))
    return np.array(chosen, np.int64)


def _pool(library: Library) -> SegmentPool:
    grafted = next(name for name in library.groups.names if name != library.groups.base)
    return library.pool(grafted)


def _fits(library: Library, own: int) -> BoolArray:
    lengths = library.segments.lengths
    return length_fits(lengths[[own]], lengths, library.rate, library.config)


def _listed(library: Library, own: int, passes: BoolArray) -> IntArray:
    passes = passes & library.is_donor
    passes[own] = True
    return np.flatnonzero(passes)
