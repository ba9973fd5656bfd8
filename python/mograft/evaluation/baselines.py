"""Methods of donor selection: the method of the paper and the baselines, with one interface.

A method defines the candidates for each base segment. By default, one candidate is drawn at
random for each segment; methods with `Method.uses_cost` select by cost instead.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby
from typing import Any

import numpy as np

from mograft._util.arrays import BoolArray, IntArray
from mograft.body.contacts import detect_contacts, find_legs
from mograft.config import Config
from mograft.errors import InsufficientDataError
from mograft.evaluation.part_features import equidistant_instants
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.search.candidates import SegmentPool
from mograft.search.costs import length_fits
from mograft.search.donor_choice import draw_uniform, prune_dead_ends
from mograft.search.trellis import DonorSequences
from mograft.synthesis.graft import Grafts
from mograft.synthesis.graft_plan import GraftPlan
from mograft.synthesis.graft_result import Graft

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
class Analogy(Method):
    """Method of the paper: donors of similar length in the same cluster of the base group."""

    name: str = "analogy"

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return the candidates for base segments; see `Method.candidates`."""
        return cluster_candidates(library, scenario)


@dataclass(frozen=True)
class ByCost(Analogy):
    """Method whose donors `Config.choice` selects by cost from the candidates of `Analogy`."""

    name: str = "analogy, by cost"
    uses_cost: bool = True


@dataclass(frozen=True)
class Ball(Method):
    """Method with the donors of similar length in the ball of `Config.neighbourhood` "ball"."""

    name: str = "ball"

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return the candidates for base segments; see `Method.candidates`."""
        config = replace(library.config, neighbourhood="ball")
        return library.pool(grafted_group(library)).candidate_lists(scenario, config)


@dataclass(frozen=True)
class Captured(Method):
    """Method whose only donor is the base segment itself, so that grafts equal the recording."""

    name: str = "captured"

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:  # noqa: ARG002
        """Return the candidates for base segments; see `Method.candidates`."""
        return [np.array([segment]) for segment in scenario.tolist()]


@dataclass(frozen=True)
class Random(Method):
    """Method that draws donors of any length and with any seam angle at random."""

    name: str = "random"
    has_seam_limit: bool = False

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return the candidates for base segments; see `Method.candidates`."""
        is_any = np.ones(len(library.segments), bool)
        return [_donor_indices(library, segment, is_any) for segment in scenario.tolist()]


@dataclass(frozen=True)
class RandomLength(Method):
    """Method that draws donors of similar length at random, without a comparison of motions."""

    name: str = "random, length limit"

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return the candidates for base segments; see `Method.candidates`."""
        return [
            _donor_indices(library, segment, _has_similar_length(library, segment))
            for segment in scenario.tolist()
        ]


@dataclass(frozen=True)
class ContactPattern(Method):
    """Method that draws donors of similar length with similar foot contacts.

    Jang, Lee and Lee describe it as the best rule of Ikemoto and Forsyth (Symposium on Computer
    Animation 2004). It follows this description, as the list of rules itself was not available.

    Attributes
    ----------
    tolerance : int
        Maximum number of differences between the contacts of the base segment and of a donor,
        compared for each foot at ten instants of the segment.
    is_exact : bool
        Whether both segments must have the same result of `contact_sequences`: the same contacts
        in the same order, of any duration. `tolerance` then has no effect.
    """

    name: str = "contact pattern"
    tolerance: int = 2
    is_exact: bool = False

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return the candidates for base segments; see `Method.candidates`."""
        candidates = []
        sequences = np.array(contact_sequences(library) if self.is_exact else [])
        states = contact_patterns(library)
        for segment in scenario.tolist():
            if self.is_exact:
                is_similar = sequences == sequences[segment]
            else:
                differences = (states != states[segment]).reshape(len(states), -1).sum(axis=1)
                is_similar = differences <= self.tolerance
            is_similar = is_similar & _has_similar_length(library, segment)
            candidates.append(_donor_indices(library, segment, is_similar))
        return candidates


@dataclass(frozen=True)
class Nearest(Method):
    """Method that draws from the donors of similar length whose base group moves most similarly.

    The distance is that of the base group's embedding; clusters have no effect.

    Attributes
    ----------
    count : int, optional
        Maximum number of donors of a base segment, besides that segment itself. Default: the
        number that `Analogy` has for this segment, so that both methods have equally many.
    """

    name: str = "nearest neighbours"
    count: int | None = None

    def candidates(self, library: Library, scenario: IntArray) -> list[IntArray]:
        """Return the candidates for base segments; see `Method.candidates`."""
        embedding = library.embedding[library.groups.base]
        if embedding is None:
            raise InsufficientDataError(
                "nearest neighbours need at least three segments whose base groups move differently"
            )
        counts = [self.count] * len(scenario)
        if self.count is None:
            counts = [len(several) - 1 for several in Analogy().candidates(library, scenario)]
        candidates = []
        for segment, count in zip(scenario.tolist(), counts, strict=True):
            is_allowed = _has_similar_length(library, segment) & library.is_donor
            is_allowed[segment] = False
            others = np.flatnonzero(is_allowed)
            distances = np.linalg.norm(embedding.points[others] - embedding.points[segment], axis=1)
            nearest = others[np.argsort(distances, kind="stable")[:count]]
            candidates.append(np.sort(np.append(nearest, segment)))
        return candidates


def cluster_candidates(
    library: Library, scenario: IntArray, labels: IntArray | None = None
) -> list[IntArray]:
    """Return the donors of similar length in the cluster of each base segment, as in the paper.

    The lists are ascending and contain the base segment; `Config.neighbourhood` has no effect.
    `labels` has the cluster of each segment, by default that of the library's base group.
    """
    pool = library.pool(grafted_group(library))
    if labels is not None:
        pool = replace(pool, labels=labels)
    return pool.candidate_lists(scenario, replace(library.config, neighbourhood="cluster"))


def default_methods(library: Library) -> tuple[Method, ...]:
    """Return the methods that the experiments compare.

    Parameters
    ----------
    library : Library
        Library to evaluate. `ContactPattern` is omitted if no leg is known in the skeleton, and
        `Nearest` if the base group has no embedding.

    Returns
    -------
    tuple of Method
        The methods, from random choice to choice by cost.
    """
    methods: list[Method] = [Random(), RandomLength()]
    if find_legs(library.skeleton):
        methods.append(ContactPattern())
    if library.embedding[library.groups.base] is not None:
        methods.append(Nearest())
    methods += [Analogy(), ByCost()]
    # The trunk keeps its angle to the pelvis, as in the paper.
    tilted = ByCost(f"{ByCost.name}, trunk on pelvis", config_changes=(("torso", "pelvis"),))
    return (*methods, tilted)


def contact_patterns(library: Library) -> BoolArray:
    """Return which feet are on the floor at ten equidistant instants of every segment.

    The shape is (n_segments, 10, n_legs); see `mograft.body.contacts`. Raises
    InsufficientDataError if no leg is known in the skeleton.
    """
    contacts, cut = _foot_contacts(library), library.segments
    instants = equidistant_instants(cut).round().astype(np.int64)
    states = np.empty((*instants.shape, contacts[0].shape[1]), bool)
    for clip, touching in enumerate(contacts):
        segments = cut.of_clip(clip)
        states[segments] = touching[instants[segments]]
    return states


def contact_sequences(library: Library) -> list[str]:
    """Return the foot contacts of every segment in temporal order, such as "10>11>01".

    Each term has one digit for each leg, 1 if its foot is on the floor. A term that lasts a single
    frame is omitted; if all terms of a segment do, the first one is kept. Raises
    InsufficientDataError if no leg is known in the skeleton.
    """
    contacts, cut = _foot_contacts(library), library.segments
    sequences = []
    for start, stop, clip in zip(cut.start, cut.stop, cut.clip, strict=True):
        rows = contacts[clip][start : stop + 1].astype(np.int64).tolist()
        states = ["".join(map(str, row)) for row in rows]
        lasting = [state for state, frames in groupby(states) if len(list(frames)) > 1]
        sequences.append(">".join(state for state, _ in groupby(lasting or states[:1])))
    return sequences


@lru_cache(maxsize=1)
def _foot_contacts(library: Library) -> list[BoolArray]:
    """Return for each clip which feet are on the floor, bool arrays of shape (n_frames, n_legs)."""
    if not find_legs(library.skeleton):
        raise InsufficientDataError("contact patterns need legs, but the skeleton has no known leg")
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
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> new = grafts_by(Random(), library, seed=1)[0]
    >>> new.motion.n_frames == new.base.n_frames
    True
    """
    plan, donors = draw_donors(method, library, base, count, swap=swap, seed=seed)
    return Grafts(plan, tuple(donors), seed)


def draw_donors(
    method: Method,
    library: Library,
    base: Motion | str | None = None,
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
    problem = replace(
        problem,
        candidates=dict.fromkeys(problem.pools, candidates),
        config=replace(problem.config, self_repair=False),
    )
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
    candidates: Sequence[IntArray],
    config: Config,
    count: int,
    rng: np.random.Generator,
) -> list[IntArray]:
    """Draw donors for each position as `Config.choice` "random" does (paper, 4.4).

    Without `Method.has_seam_limit`, the draws are independent. Otherwise, if a position has more
    than 100 candidates, each sequence is drawn from 100 random ones of them.
    """
    if not method.has_seam_limit:
        return [
            np.array([rng.choice(segments) for segments in candidates], np.int64)
            for _ in range(count)
        ]
    if max(map(len, candidates), default=0) <= _MAX_DRAWN:
        pruned = prune_dead_ends(pool, candidates, config)
        return [draw_uniform(*pruned, config, rng) for _ in range(count)]
    sequences = []
    for _ in range(count):
        limited = [
            segments
            if len(segments) <= _MAX_DRAWN
            else np.sort(rng.choice(segments, _MAX_DRAWN, replace=False))
            for segments in candidates
        ]
        sequences.append(draw_uniform(*prune_dead_ends(pool, limited, config), config, rng))
    return sequences


def grafted_group(library: Library, group: str | None = None) -> str:
    """Return `group`, or the first group that is not the base group if `group` is None.

    Raise ValueError if `group` is the base group or is unknown.
    """
    others = [name for name in library.groups.names if name != library.groups.base]
    if group is not None and group not in others:
        raise ValueError(f"`group` must be one of {', '.join(others)}, got {group!r}")
    return others[0] if group is None else group


def _has_similar_length(library: Library, segment: int) -> BoolArray:
    lengths = library.segments.lengths
    return length_fits(lengths[[segment]], lengths, library.rate, library.config)


def _donor_indices(library: Library, segment: int, is_allowed: BoolArray) -> IntArray:
    """Return the segments that are allowed and no excluded donors, and the base segment itself."""
    is_candidate = is_allowed & library.is_donor
    is_candidate[segment] = True
    return np.flatnonzero(is_candidate)
