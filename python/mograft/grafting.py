"""From a library and a base motion to new motions: choose, recombine, report."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice, product
from typing import Any, overload

import numpy as np

from mograft._arrays import IntArray
from mograft.library import Library
from mograft.motion import Motion
from mograft.search import best, diverse, sample
from mograft.segmentation import Segments
from mograft.substitution import Pool, Row, choose, reachable
from mograft.transplant import Part, recombine, transplant

__all__ = ["Graft", "Grafts", "Seam", "Substitution", "graft", "graft_many"]


@dataclass(frozen=True)
class Substitution:
    """One segment's part, taken from another segment.

    Attributes
    ----------
    group : str
        The joint group.
    start, stop : int
        First and last frame in the base, both included.
    segment, donor : int
        Indices of the base segment and of the donor in the library.
    clip : str
        Name of the donor's clip.
    donor_start, donor_stop : int
        First and last frame of the donor in its clip.
    stretch : float
        By which part of its own length the donor was made longer (above 0) or shorter.
    """

    group: str
    start: int
    stop: int
    segment: int
    donor: int
    clip: str
    donor_start: int
    donor_stop: int
    stretch: float

    @property
    def is_own(self) -> bool:
        """Whether the segment keeps its own part."""
        return self.segment == self.donor


@dataclass(frozen=True)
class Seam:
    """A frame where segments meet that did not meet in a clip.

    Attributes
    ----------
    group : str
        The joint group.
    frame : int
        The frame in the base.
    gap : float
        Mean angle between the poses that were brought together, in radians.
    """

    group: str
    frame: int
    gap: float


@dataclass(frozen=True, eq=False)
class Graft:
    """A new motion and where every part of it comes from.

    Attributes
    ----------
    motion : Motion
        The new motion, frame for frame as long as the base.
    base : Motion
        The motion that it was made on.
    library : Library
        Where the donors come from.
    substitutions : tuple of Substitution
        For every grafted group and base segment what took its place, itself perhaps.
    seams : tuple of Seam
        Where parts had to be joined.
    alternatives : dict of str to ndarray of int
        For every grafted group how many donors besides itself each base segment had.
    seed : int
        The seed that it was chosen by.
    index : int
        Its number among those of the same seed, from 0.
    """

    motion: Motion
    base: Motion
    library: Library
    substitutions: tuple[Substitution, ...]
    seams: tuple[Seam, ...]
    alternatives: dict[str, IntArray]
    seed: int
    index: int

    def __repr__(self) -> str:
        new = sum(not s.is_own for s in self.substitutions)
        return f"Graft({self.motion.name}: {new} of {len(self.substitutions)} parts exchanged)"

    def _repr_html_(self) -> str:
        # Pages stand at the end of the way of the data: only notebooks need them here.
        from mograft.viewing.page import embedded

        return embedded(self)

    def report(self) -> str:
        """Return in words what was exchanged, what was kept and why, and the seams."""
        lines = [f"{self.motion.name}: {self.base.n_frames} frames of {self.base.name}"]
        limit = self.library.config.max_angle
        for group, counts in self.alternatives.items():
            own = [s for s in self.substitutions if s.group == group]
            new = sum(not s.is_own for s in own)
            gaps = np.degrees([seam.gap for seam in self.seams if seam.group == group])
            wide = int((gaps > np.degrees(limit) + 1e-6).sum())
            without = int((counts == 0).sum())
            lines.append(f"  {group}: {new} of {len(own)} segments exchanged")
            if without:
                lines.append(f"    {without} had no candidate and were kept")
            if len(gaps):
                lines.append(
                    f"    {len(gaps)} seams, mean gap {gaps.mean():.1f}°, largest {gaps.max():.1f}°"
                )
            if wide:
                lines.append(f"    {wide} seams are wider than {np.degrees(limit):.0f}°")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Return how the motion was made, as a JSON document: its provenance."""
        library = self.library
        clips = [
            {"name": entry.name, "file": library.file_name(index)}
            for index, entry in enumerate(library.entries)
        ]
        return {
            "schema": "mograft.graft/1",
            "name": self.motion.name,
            "base": self.base.name,
            "seed": self.seed,
            "index": self.index,
            "frames": self.motion.n_frames,
            "frame_time": self.motion.frame_time,
            "config": library.config.as_dict(),
            "groups": {
                name: [library.skeleton.names[j] for j in library.joints(name)]
                for name in library.groups.names
            },
            "base_group": library.groups.base,
            "clips": clips,
            "substitutions": [
                {
                    "group": s.group,
                    "frames": [s.start, s.stop],
                    "clip": s.clip,
                    "clip_frames": [s.donor_start, s.donor_stop],
                    "exchanged": not s.is_own,
                    "stretch": round(s.stretch, 6),
                }
                for s in self.substitutions
            ],
            "seams": [
                {"group": s.group, "frame": s.frame, "gap_degrees": round(np.degrees(s.gap), 4)}
                for s in self.seams
            ],
            "kept_without_candidate": {
                name: int((counts == 0).sum()) for name, counts in self.alternatives.items()
            },
        }


@dataclass(frozen=True, eq=False)
class Grafts(Sequence[Graft]):
    """Several grafts on one base; each is made when it is asked for, and not kept."""

    _plan: "_Plan"
    _draws: tuple[dict[str, IntArray], ...]
    _seed: int

    def __len__(self) -> int:
        return len(self._draws)

    def __repr__(self) -> str:
        return f"Grafts({len(self)} on {self._plan.base.name}, seed {self._seed})"

    @overload
    def __getitem__(self, index: int) -> Graft: ...
    @overload
    def __getitem__(self, index: slice) -> list[Graft]: ...
    def __getitem__(self, index: int | slice) -> Graft | list[Graft]:
        if isinstance(index, slice):
            return [self[at] for at in range(*index.indices(len(self)))]
        at = range(len(self))[index]
        return self._plan.build(self._draws[at], self._seed, at)


@dataclass(frozen=True, eq=False)
class _Plan:
    """What all grafts on one base have in common."""

    library: Library
    base: Motion
    scenario: IntArray
    pools: dict[str, Pool]
    candidates: dict[str, list[IntArray]]

    @classmethod
    def make(
        cls, library: Library, base: Motion | str | None, swap: Sequence[str] | None
    ) -> "_Plan":
        groups = _swapped(library, swap)
        library, at = library.holding(base)
        scenario = library.segments.of_clip(at)
        pools = {group: library.pool(group) for group in groups}
        candidates = {
            group: pool.candidate_lists(scenario, library.config) for group, pool in pools.items()
        }
        return cls(library, library.clips[at], scenario, pools, candidates)

    def draws(self, count: int, seed: int) -> list[dict[str, IntArray]]:
        """Choose donors for several motions, each different from the others."""
        config = self.library.config
        rng = np.random.default_rng(seed)
        if config.choice == "random":
            ways = {
                group: reachable(pool, self.candidates[group], config)
                for group, pool in self.pools.items()
            }
            return _different(
                lambda: {group: choose(*way, config, rng) for group, way in ways.items()}, count
            )
        rows = {
            group: Row.of(pool, self.scenario, self.candidates[group], config)
            for group, pool in self.pools.items()
        }
        if config.choice == "sample":

            def draw() -> dict[str, IntArray]:
                return {
                    group: row.donors(sample(row.chain, config.temperature, rng))
                    for group, row in rows.items()
                }

            return _different(draw, count)
        if config.choice == "best":
            lists = [best(row.chain, count) for row in rows.values()]
            costs = [
                [row.chain.cost(choices) for choices in own]
                for row, own in zip(rows.values(), lists, strict=True)
            ]
            combined = _cheapest_sums(costs, count)
        else:
            lists = [diverse(row.chain, count, config.diversity) for row in rows.values()]
            combined = _side_by_side([len(own) for own in lists], count)
        return [
            {
                group: row.donors(own[at])
                for (group, row), own, at in zip(rows.items(), lists, places, strict=True)
            }
            for places in combined
        ]

    def build(self, chosen: dict[str, IntArray], seed: int, index: int) -> Graft:
        library, segments = self.library, self.library.segments
        own = _take(segments, self.scenario)
        parts: list[Part] = []
        substitutions: list[Substitution] = []
        seams: list[Seam] = []
        for group, donors in chosen.items():
            taken = _take(segments, donors)
            # Only the clips that lend something: of a stored library, each has to be read.
            used, clip = np.unique(taken.clip, return_inverse=True)
            clips = [library.clips[index] for index in used]
            joints = library.joints(group)
            part = transplant(
                self.base, own, replace(taken, clip=clip), clips, joints, library.config
            )
            parts.append(part)
            substitutions += _substitutions(library, group, self.scenario, donors)
            seams += _seams(group, part)
        name = f"{self.base.name}_graft{index}"
        return Graft(
            recombine(self.base, parts, name),
            self.base,
            library,
            tuple(substitutions),
            tuple(seams),
            {group: np.array([len(own) - 1 for own in self.candidates[group]]) for group in chosen},
            seed,
            index,
        )


def graft(
    library: Library,
    base: Motion | str | None = None,
    *,
    swap: Sequence[str] | None = None,
    seed: int = 0,
) -> Graft:
    """Make one new motion.

    Parameters
    ----------
    library : Library
        Where the donors come from.
    base : Motion or str, optional
        The motion whose base group is kept, or its name in the library; one that is not in
        the library is cut and compared by the library's measures. Default: the first clip.
    swap : sequence of str, optional
        The groups to graft. Default: all but the base group.
    seed : int
        Of what is left to chance, with ``Config(choice="sample")`` and "random": another
        seed, another motion. The same seed gives the same numbers.

    Returns
    -------
    Graft
        The motion and where every part of it comes from. Where no donor passes the limits
        the original is kept and the report says so.

    Raises
    ------
    SkeletonMismatchError
        If the base has another hierarchy than the library.
    ValueError
        If a group is none, or is the base group.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> new = graft(library, seed=7)
    >>> new.motion.n_frames == library.clips[0].n_frames
    True
    """
    return graft_many(library, base, 1, swap=swap, seed=seed)[0]


def graft_many(
    library: Library,
    base: Motion | str | None = None,
    count: int = 1,
    *,
    swap: Sequence[str] | None = None,
    seed: int = 0,
) -> "Grafts":
    """Make several new motions, each different from the others.

    Parameters
    ----------
    library, base, swap, seed
        As for `graft`, which makes the first of them.
    count : int
        How many motions are wanted.

    Returns
    -------
    Grafts
        The motions, each made when it is asked for. With the default choice the first is the
        cheapest, and each pays for what the ones before it took. Fewer than wanted where the
        donors allow no more different ones (a hundred draws in a row give none).

    Raises
    ------
    ValueError
        As for `graft`, and if `count` is below 1 or the seed is no whole number from 0.
    """
    if isinstance(count, bool) or not isinstance(count, int) or count < 1:
        raise ValueError(f"count must be a whole number from 1, got {count!r}")
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise ValueError(f"seed must be a whole number from 0, got {seed!r}")
    plan = _Plan.make(library, base, swap)
    return Grafts(plan, tuple(plan.draws(count, seed)), seed)


def _different(draw: Callable[[], dict[str, IntArray]], count: int) -> list[dict[str, IntArray]]:
    """Draw until there are as many different ones, or a hundred draws in a row give none."""
    draws: dict[bytes, dict[str, IntArray]] = {}
    while len(draws) < count:
        for _ in range(100):
            chosen = draw()
            key = b"".join(donors.tobytes() for donors in chosen.values())
            if key not in draws:
                break
        else:
            break
        draws[key] = chosen
    return list(draws.values())


def _cheapest_sums(costs: Sequence[Sequence[float]], count: int) -> list[tuple[int, ...]]:
    """Return the places, one in each list of ascending costs, whose costs sum to the least."""
    sums: list[tuple[float, tuple[int, ...]]] = [(0.0, ())]
    for own in costs:
        longer = [
            (total + cost, (*places, at)) for total, places in sums for at, cost in enumerate(own)
        ]
        sums = sorted(longer)[:count]
    return [places for _, places in sums]


def _side_by_side(lengths: Sequence[int], count: int) -> list[tuple[int, ...]]:
    """Return different places in lists of some lengths, each list's in turn."""
    turns = [tuple(turn % length for length in lengths) for turn in range(max(lengths))]
    others = product(*(range(length) for length in lengths))
    return list(islice(dict.fromkeys(chain(turns, others)), count))


def _swapped(library: Library, swap: Sequence[str] | None) -> list[str]:
    """Check and return the groups to graft, in the library's order."""
    base = library.groups.base
    others = [name for name in library.groups.names if name != base]
    wanted = others if swap is None else list(swap)
    for name in wanted:
        if name not in others:
            raise ValueError(
                f"swap must name groups other than the base {base!r}, of {', '.join(others)}; "
                f"got {name!r}"
            )
    if not wanted:
        raise ValueError(f"swap must name at least one group of {', '.join(others)}, got none")
    if library.root not in library.joints(base):
        carrier = library.skeleton.names[library.root]
        raise ValueError(
            f"the base group {base!r} must hold {carrier}, which carries the body through the world"
        )
    return [name for name in others if name in wanted]


def _take(segments: Segments, chosen: IntArray) -> Segments:
    return Segments(segments.start[chosen], segments.stop[chosen], segments.clip[chosen])


def _substitutions(
    library: Library, group: str, scenario: IntArray, donors: IntArray
) -> Iterator[Substitution]:
    segments = library.segments
    for own, donor in zip(scenario.tolist(), donors.tolist(), strict=True):
        length, taken = int(segments.lengths[own]), int(segments.lengths[donor])
        yield Substitution(
            group,
            int(segments.start[own]),
            int(segments.stop[own]),
            own,
            donor,
            library.entries[segments.clip[donor]].name,
            int(segments.start[donor]),
            int(segments.stop[donor]),
            length / taken - 1.0,
        )


def _seams(group: str, part: Part) -> Iterator[Seam]:
    for frame, gaps in zip(part.seams.tolist(), part.gaps, strict=True):
        yield Seam(group, frame, float(gaps.mean()))
