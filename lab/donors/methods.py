"""Rules of donor selection: the rule of the paper, and those that it is compared with."""

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby

import numpy as np

from lab.donors.part_features import equidistant_instants
from mograft import InsufficientDataError
from mograft.body.contacts import detect_contacts, find_legs
from mograft.evaluation import Method, RandomLength, grafts_by


@dataclass(frozen=True)
class Analogy(Method):
    """Method of the paper: donors of similar length in the same cluster of the base group."""

    name: str = "analogy"

    def candidates(self, library, scenario):
        """Return the candidates for base segments; see `Method.candidates`."""
        return cluster_candidates(library, scenario)


@dataclass(frozen=True)
class ByCost(Analogy):
    """Method whose donors `Config.choice` selects by cost, from `Config.neighbourhood`."""

    name: str = "analogy, by cost"
    uses_cost: bool = True

    def candidates(self, library, scenario):
        """Return the candidates for base segments; see `Method.candidates`."""
        return library.pool(grafted_group(library)).candidate_lists(scenario, library.config)


@dataclass(frozen=True)
class Ball(Method):
    """Method with the donors of similar length in the ball of `Config.neighbourhood` "ball"."""

    name: str = "ball"

    def candidates(self, library, scenario):
        """Return the candidates for base segments; see `Method.candidates`."""
        config = replace(library.config, neighbourhood="ball")
        return library.pool(grafted_group(library)).candidate_lists(scenario, config)


@dataclass(frozen=True)
class Captured(Method):
    """Method whose only donor is the base segment itself, so that grafts equal the recording."""

    name: str = "captured"

    def candidates(self, library, scenario):  # noqa: ARG002
        """Return the candidates for base segments; see `Method.candidates`."""
        return [np.array([segment]) for segment in scenario.tolist()]


@dataclass(frozen=True)
class Random(Method):
    """Method that draws donors of any length and with any seam angle at random."""

    name: str = "random"
    has_seam_limit: bool = False

    def candidates(self, library, scenario):
        """Return the candidates for base segments; see `Method.candidates`."""
        donors = np.flatnonzero(library.is_donor)
        return [np.union1d(donors, [segment]) for segment in scenario.tolist()]


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

    def candidates(self, library, scenario):
        """Return the candidates for base segments; see `Method.candidates`."""
        candidates = []
        sequences = np.array(contact_sequences(library) if self.is_exact else [])
        states = contact_patterns(library)
        fitting = RandomLength().candidates(library, scenario)
        for segment, several in zip(scenario.tolist(), fitting, strict=True):
            if self.is_exact:
                is_similar = sequences == sequences[segment]
            else:
                differences = (states != states[segment]).reshape(len(states), -1).sum(axis=1)
                is_similar = differences <= self.tolerance
            is_similar[segment] = True
            candidates.append(several[is_similar[several]])
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

    def candidates(self, library, scenario):
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
        fitting = RandomLength().candidates(library, scenario)
        for segment, count, several in zip(scenario.tolist(), counts, fitting, strict=True):
            others = several[several != segment]
            distances = np.linalg.norm(embedding.points[others] - embedding.points[segment], axis=1)
            nearest = others[np.argsort(distances, kind="stable")[:count]]
            candidates.append(np.sort(np.append(nearest, segment)))
        return candidates


def cluster_candidates(library, scenario, labels=None):
    """Return the donors of similar length in the cluster of each base segment, as in the paper.

    The lists are ascending and contain the base segment; `Config.neighbourhood` has no effect.
    `labels` has the cluster of each segment, by default that of the library's base group.
    """
    pool = library.pool(grafted_group(library))
    if labels is not None:
        pool = replace(pool, labels=labels)
    return pool.candidate_lists(scenario, replace(library.config, neighbourhood="cluster"))


def default_methods(library):
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
    methods = [Random(), RandomLength()]
    if find_legs(library.skeleton):
        methods.append(ContactPattern())
    if library.embedding[library.groups.base] is not None:
        methods.append(Nearest())
    methods += [Analogy(), ByCost()]
    # The trunk keeps its angle to the pelvis, as in the paper.
    tilted = ByCost(f"{ByCost.name}, trunk on pelvis", config_changes=(("torso", "pelvis"),))
    return (*methods, tilted)


def contact_patterns(library):
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


def contact_sequences(library):
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
def _foot_contacts(library):
    """Return for each clip which feet are on the floor, bool arrays of shape (n_frames, n_legs)."""
    if not find_legs(library.skeleton):
        raise InsufficientDataError("contact patterns need legs, but the skeleton has no known leg")
    return [np.asarray(detect_contacts(clip).any(axis=2), bool) for clip in library.clips]


def grafted_group(library, group=None):
    """Return `group`, or the first group that is not the base group if `group` is None.

    Raise ValueError if `group` is the base group or is unknown.
    """
    others = [name for name in library.groups.names if name != library.groups.base]
    if group is not None and group not in others:
        raise ValueError(f"`group` must be one of {', '.join(others)}, got {group!r}")
    return others[0] if group is None else group


def makers(methods):
    """Return the methods as `mograft.evaluation.evaluate` takes them."""

    def maker(method):
        return lambda library, base, runs, seed: grafts_by(method, library, base, runs, seed=seed)

    return {method.name: maker(method) for method in methods}
