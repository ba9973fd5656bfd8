"""Strategies that choose donor sequences: the values of `Config.choice`."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, islice, product
from typing import ClassVar, Protocol

import numpy as np
from numpy.random import Generator

from mograft._util.arrays import FloatArray, IntArray, split_by_counts
from mograft.config import Config
from mograft.search.costs import INFEASIBLE_PENALTY, CostModel, SeamScales, is_infeasible
from mograft.search.segment_pool import SegmentPool
from mograft.search.trellis import DonorSequences, DonorTrellis, Trellis, diverse, sample, viterbi

_MAX_REPEATED_DRAWS = 100  # drawing ends after this many draws in a row without a new result


class DonorSource(Protocol):
    """Candidates and costs for each grafted group, from which a strategy chooses donors."""

    @property
    def config(self) -> Config:
        """The configuration."""

    @property
    def pools(self) -> Mapping[str, SegmentPool]:
        """The segments of the library for each grafted group, with the data for the search."""

    @property
    def trellises(self) -> Mapping[str, DonorTrellis]:
        """The candidates and their costs at each position, for each grafted group."""

    def feasible_candidates(self, group: str) -> Sequence[IntArray]:
        """Return the candidates of a group at each position that satisfy the hard constraints."""


class DonorChoice(ABC):
    """A strategy that chooses donor sequences."""

    # Whether only the `max_candidates` cheapest are considered, and self-repair may replace donors.
    depends_on_costs: ClassVar[bool] = True

    def cost_model(self, config: Config, scales: SeamScales) -> CostModel:
        """Return the model of the unary and pairwise costs."""
        return CostModel(config, scales)

    @abstractmethod
    def draw(self, source: DonorSource, count: int, rng: Generator) -> list[DonorSequences]:
        """Return different donor sequences for `count` motions; fewer if no others exist."""

    def choose_path(self, trellis: Trellis, config: Config, rng: Generator) -> IntArray:
        """Return a path, one donor per position, through a trellis: by default the cheapest.

        A `Stream` commits only the first donor of the path, and calls this again for the next
        segment.
        """
        return viterbi(trellis)


class Viterbi(DonorChoice):
    """Strategy that returns the cheapest sequence for each motion.

    After each motion, donors like its own become more expensive, so that later motions differ.
    """

    def draw(self, source: DonorSource, count: int, rng: Generator) -> list[DonorSequences]:
        """As `DonorChoice.draw`."""
        found = {}
        for group, trellis in source.trellises.items():
            charge = charges(source.pools[group], trellis, source.config)
            captured = trellis.path(trellis.scenario)
            search = partial(trellis.find_path, search=viterbi)
            paths = islice(diverse(trellis.costs, charge, captured, search), count)
            found[group] = list(map(trellis.donor_sequence, paths))
        ranks = interleaved_combinations([len(own) for own in found.values()], count)
        return [
            {group: own[index] for (group, own), index in zip(found.items(), indices, strict=True)}
            for indices in ranks
        ]


class Sample(DonorChoice):
    """Strategy that draws sequences with probability proportional to exp(-cost / temperature).

    After each motion, donors like its own become more expensive, as for `Viterbi`.
    """

    def draw(self, source: DonorSource, count: int, rng: Generator) -> list[DonorSequences]:
        """As `DonorChoice.draw`."""
        trellises, config = source.trellises, source.config
        costs = {group: trellis.costs for group, trellis in trellises.items()}
        charge_of = {
            group: charges(source.pools[group], own, config) for group, own in trellises.items()
        }
        draw_path = partial(self.choose_path, config=config, rng=rng)

        def draw_once() -> DonorSequences:
            return {
                group: trellis.donor_sequence(trellis.find_path(costs[group], draw_path))
                for group, trellis in trellises.items()
            }

        def charge(donors: DonorSequences) -> None:
            for group, trellis in trellises.items():
                added = charge_of[group](trellis.path(donors[group]))
                costs[group] = costs[group].add_unary(added)

        captured = {group: trellis.scenario for group, trellis in trellises.items()}
        return list(islice(_draw_different(draw_once, charge, captured), count))

    def choose_path(self, trellis: Trellis, config: Config, rng: Generator) -> IntArray:
        """As `DonorChoice.choose_path`."""
        return sample(trellis, config.temperature, rng)


class Nearest(Viterbi):
    """Strategy that returns the donors most similar to the base segments in the base group.

    Seams cost nothing if their angles are at most `max_angle`.
    """

    def cost_model(self, config: Config, scales: SeamScales) -> CostModel:
        """As `DonorChoice.cost_model`."""
        config = replace(
            config, length_weight=0.0, distance_weight=1.0, novelty=0.0, balance_weight=0.0
        )
        return CostModel(config, scales, base_cost=INFEASIBLE_PENALTY, seam_weight=0.0)


class Random(DonorChoice):
    """Strategy that draws uniformly from the donors within the limits (paper, 4.4)."""

    depends_on_costs = False  # a limited or repaired draw is not uniform

    def draw(self, source: DonorSource, count: int, rng: Generator) -> list[DonorSequences]:
        """As `DonorChoice.draw`."""
        config = source.config
        pruned = {
            group: prune_dead_ends(pool, source.feasible_candidates(group), config)
            for group, pool in source.pools.items()
        }

        def draw_once() -> DonorSequences:
            return {group: draw_uniform(*own, config, rng) for group, own in pruned.items()}

        return list(islice(_draw_different(draw_once), count))

    def choose_path(self, trellis: Trellis, config: Config, rng: Generator) -> IntArray:
        """As `DonorChoice.choose_path`: uniform over the paths without infeasible penalty."""
        unary = tuple(np.where(is_infeasible(own), own, 0.0) for own in trellis.unary)
        pairwise = tuple(
            np.where(is_infeasible(own), INFEASIBLE_PENALTY, 0.0) for own in trellis.pairwise
        )
        return sample(Trellis(unary, pairwise), 1.0, rng)


DONOR_CHOICES: dict[str, DonorChoice] = {
    "viterbi": Viterbi(),
    "sample": Sample(),
    "nearest": Nearest(),
    "random": Random(),
}
"""The strategies by their names in `Config.choice`."""


def cost_model(config: Config, pool: SegmentPool) -> CostModel:
    """Return the cost model of the strategy `Config.choice`, with the seam scales of a pool."""
    scales = SeamScales.from_typical_gaps(*pool.typical_gaps, config)
    return DONOR_CHOICES[config.choice].cost_model(config, scales)


def charges(
    pool: SegmentPool, trellis: DonorTrellis, config: Config
) -> Callable[[IntArray], list[FloatArray]]:
    """Return a function of a path that returns what it adds to the unary costs of later motions.

    A candidate costs `Config.diversity` if it has the poses of the donor on the path at its
    position, and less the more they differ; see `CostModel.diversity`. The base segment always
    costs `Config.diversity`: otherwise later motions would return to the captured motion.
    """
    model = cost_model(config, pool)
    counts = np.array([len(own) for own in trellis.candidates], np.int64)
    candidates = np.concatenate(trellis.candidates)
    is_base = candidates == np.repeat(trellis.scenario, counts)

    def charge(path: IntArray) -> list[FloatArray]:
        used = np.repeat(trellis.donor_sequence(path), counts)
        differences = np.where(is_base, 0.0, pool.pose_differences(used, candidates))
        return split_by_counts(model.diversity(differences), counts)

    return charge


def prune_dead_ends(
    pool: SegmentPool, candidates: Sequence[IntArray], config: Config
) -> tuple[list[IntArray], list[FloatArray]]:
    """Keep the candidates from which the last position can be reached within `max_angle`.

    The first result holds the kept candidates of each position: those with a seam of at most
    `max_angle` to a kept candidate of the next position, or all if there is no such seam. The
    second holds, for each position but the last, the seam angles in radians between kept candidates
    of the position (rows) and of the next (columns).
    """
    kept, kept_angles = list(candidates[-1:]), list[FloatArray]()
    for segments in reversed(candidates[:-1]):
        angles = pool.seam_angles(segments, kept[-1])
        passing = (angles <= config.max_angle).any(axis=1)
        passing |= not passing.any()
        kept.append(segments[passing])
        kept_angles.append(angles[passing])
    return kept[::-1], kept_angles[::-1]


def draw_uniform(
    candidates: Sequence[IntArray], angles: Sequence[FloatArray], config: Config, rng: Generator
) -> IntArray:
    """Draw a donor at every position; the arguments are those that `prune_dead_ends` returns.

    Each donor is drawn uniformly from the candidates whose seam with the previous donor is within
    `max_angle`. If there are none, the candidate with the smallest seam angle is taken.
    """
    index = int(rng.integers(len(candidates[0])))
    sequence = [candidates[0][index]]
    for segments, matrix in zip(candidates[1:], angles, strict=True):
        gaps = matrix[index]
        passing = np.flatnonzero(gaps <= config.max_angle)
        index = int(rng.choice(passing)) if len(passing) else int(np.argmin(gaps))
        sequence.append(segments[index])
    return np.array(sequence, np.int64)


def interleaved_combinations(lengths: Sequence[int], count: int) -> list[tuple[int, ...]]:
    """Return up to `count` different combinations of one item per list.

    A combination is a tuple with one index per list, whose length is in `lengths`. First, all
    indices advance together: (0, 0), (1, 1), ...; an index at the end of its list restarts at 0.
    All other combinations follow in lexicographic order.
    """
    together = [tuple(i % length for length in lengths) for i in range(max(lengths))]
    others = product(*(range(length) for length in lengths))
    return list(islice(dict.fromkeys(chain(together, others)), count))


def unique_sequences(sequences: Sequence[DonorSequences]) -> list[DonorSequences]:
    """Return donor sequences without repetitions, in order of first occurrence."""
    return list({_key(donors): donors for donors in sequences}.values())


def _draw_different(
    draw: Callable[[], DonorSequences],
    use: Callable[[DonorSequences], None] | None = None,
    captured: DonorSequences | None = None,
) -> Iterator[DonorSequences]:
    """Call `draw` again and again, and yield the different results.

    Drawing ends after `_MAX_REPEATED_DRAWS` draws in a row without a new result. `use` is called
    with each new result before the next draw. Only the first result may be `captured`.
    """
    known: set[bytes] = set()
    while True:
        draws = (draw() for _ in range(_MAX_REPEATED_DRAWS))
        donors = next((own for own in draws if _key(own) not in known), None)
        if donors is None:
            return
        yield donors
        known |= {_key(own) for own in (donors, captured) if own is not None}
        if use is not None:
            use(donors)


def _key(donors: DonorSequences) -> bytes:
    return b"".join(own.tobytes() for own in donors.values())
