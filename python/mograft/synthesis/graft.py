"""From a library and a base motion to new motions: choose, recombine, report."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain, islice, product
from typing import Any, overload

import numpy as np

from mograft._util.arrays import IntArray, as_indices
from mograft._util.validate import as_integer, check_type
from mograft.blend.foot_planting import FeetReport, plant_feet
from mograft.blend.recombine import Part, recombine
from mograft.blend.transplant import transplant
from mograft.body.contacts import detect_contacts, find_legs
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.scenario import Scenario
from mograft.scenario.realize import donor_contacts, realize_scenario
from mograft.search.candidates import DonorTrellis, choose, reachable
from mograft.search.constraints import Constraint, Violation, find_violations
from mograft.search.donor_constraints import MaxAngle
from mograft.search.viterbi import diverse, k_best, sample, viterbi
from mograft.synthesis.root_tabu_search import tabu_search
from mograft.synthesis.search_problem import DonorSequences, SearchProblem

__all__ = ["Graft", "Grafts", "Seam", "Substitution", "graft", "graft_many", "repair"]


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
    cost : float
        What the donor costs by itself, seams and constraints apart; see `Config`.
    gap_before, gap_after : float
        Mean joint angle, in radians, between the poses that meet at its seams; 0 where the
        donors are neighbours in a clip too, or there is none.
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
    cost: float = 0.0
    gap_before: float = 0.0
    gap_after: float = 0.0

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
    violations : tuple of Violation
        Where hard constraints are not met; empty where all are.
    feet : FeetReport or None
        What was done to make feet stand still; None where the base group keeps them, and where
        nothing that carries them was exchanged.
    scenario : tuple of int
        The segments that the base was put together from; none where it is a clip.
    """

    motion: Motion
    base: Motion
    library: Library
    substitutions: tuple[Substitution, ...]
    seams: tuple[Seam, ...]
    alternatives: dict[str, IntArray]
    seed: int
    index: int
    violations: tuple[Violation, ...] = ()
    feet: FeetReport | None = None
    scenario: tuple[int, ...] = ()

    def __repr__(self) -> str:
        new = sum(not s.is_own for s in self.substitutions)
        return f"Graft({self.motion.name}: {new} of {len(self.substitutions)} parts exchanged)"

    def _repr_html_(self) -> str:
        # Pages stand at the end of the way of the data: only notebooks need them here.
        from mograft.viewing.page import notebook_view  # layer exception: notebooks show a page

        return notebook_view(self)

    def report(self, *, each: bool = False) -> str:
        """Return in words what was exchanged, what was kept and why, and the seams.

        Parameters
        ----------
        each : bool
            Whether to list every exchange: the donor, its frames, its cost and its seams.
        """
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
            if each:
                lines += [
                    f"    {s.start}-{s.stop} from {s.clip} {s.donor_start}-{s.donor_stop}: "
                    f"cost {s.cost:.2f}, stretch {s.stretch:+.2f}, seams "
                    f"{np.degrees(s.gap_before):.1f}° and {np.degrees(s.gap_after):.1f}°"
                    for s in own
                    if not s.is_own
                ]
        lines += [f"  {violation.message}" for violation in self.violations]
        if self.feet is not None:
            feet = self.feet
            lines.append(
                f"  feet: {feet.plants} plants; {feet.skate_before:.1%} of frames skated, "
                f"{feet.skate_after:.1%} do now"
            )
            if feet.unreached_frames:
                lines.append(
                    f"    out of reach in {feet.unreached_frames} frames, "
                    f"by up to {feet.unreached:.4f} heights"
                )
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Return how the motion was made, as a JSON document: its provenance."""
        library = self.library
        clips = [
            {
                "name": entry.name,
                "file": library.file_name(index),
                "sha256": None if entry.source_file is None else entry.source_file.sha256,
            }
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
            "scenario": [
                {
                    "clip": library.entries[library.segments.clip[own]].name,
                    "clip_frames": [
                        int(library.segments.start[own]),
                        int(library.segments.stop[own]),
                    ],
                }
                for own in self.scenario
            ],
            "substitutions": [
                {
                    "group": s.group,
                    "frames": [s.start, s.stop],
                    "clip": s.clip,
                    "clip_frames": [s.donor_start, s.donor_stop],
                    "exchanged": not s.is_own,
                    "stretch": round(s.stretch, 6),
                    "cost": round(s.cost, 6),
                    "gaps_degrees": [
                        round(float(np.degrees(gap)), 4) for gap in (s.gap_before, s.gap_after)
                    ],
                }
                for s in self.substitutions
            ],
            "seams": [
                {"group": s.group, "frame": s.frame, "gap_degrees": round(np.degrees(s.gap), 4)}
                for s in self.seams
            ],
            "violations": [
                {
                    "constraint": type(v.constraint).__name__,
                    "frames": list(v.frames),
                    "worst_frame": v.worst,
                    "joint": v.joint,
                    "tolerances": round(v.error, 4),
                    "message": v.message,
                }
                for v in self.violations
            ],
            "feet": None if self.feet is None else asdict(self.feet),
            "kept_without_candidate": {
                name: int((counts == 0).sum()) for name, counts in self.alternatives.items()
            },
        }


@dataclass(frozen=True, eq=False)
class Grafts(Sequence[Graft]):
    """Several grafts on one base; each is made when it is asked for, and not kept."""

    _plan: "GraftPlan"
    _draws: tuple[DonorSequences, ...]
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
        return self._plan.make_graft(self._draws[at], self._seed, at)


@dataclass(frozen=True, eq=False)
class GraftPlan:
    """What all grafts on one base have in common."""

    problem: SearchProblem
    order: tuple[int, ...] = ()

    @property
    def base(self) -> Motion:
        return self.problem.base

    @classmethod
    def build(
        cls,
        library: Library,
        base: Motion | str | None,
        swap: Sequence[str] | None,
        constraints: Sequence[Constraint],
        order: Sequence[int] | IntArray | Scenario | None = None,
    ) -> "GraftPlan":
        groups = grafted_groups(library, swap)
        if order is None:
            library, at = library.resolve_base(base)
            scenario = library.segments.of_clip(at)
            motion, cut = library.clips[at], library.segments[scenario]
        elif base is not None:
            raise ValueError("base must not be given with a scenario, which is the base itself")
        else:
            wanted = order if isinstance(order, Scenario) else Scenario(_checked(order))
            scenario = _within(wanted.segments, library)
            motion, cut = realize_scenario(library, wanted)
        own_order = () if order is None else tuple(scenario.tolist())
        problem = SearchProblem.build(library, motion, scenario, cut, groups, constraints)
        return cls(problem, own_order)

    def rows(self) -> dict[str, DonorTrellis]:
        """Return what donors cost, group by group: each as the ones before it are cheapest."""
        problem = self.problem
        rows: dict[str, DonorTrellis] = {}
        chosen: DonorSequences = {}
        for group in problem.pools:
            rows[group] = row = problem.row(group, chosen)
            if problem.constraints:
                chosen[group] = row.donor_sequence(viterbi(row.costs))
        return rows

    def settled_draws(self, count: int, seed: int) -> list[DonorSequences]:
        """Choose donors for several motions, and change what does not meet the constraints."""
        chance = self.problem.config.choice == "random"
        rows = {} if chance and not self.problem.constraints else self.rows()
        return _distinct([self.settled(own, rows) for own in self.draws(rows, count, seed)])

    def settled(self, donors: DonorSequences, rows: dict[str, DonorTrellis]) -> DonorSequences:
        """Change what does not meet the constraints."""
        donors = self.problem.settled(donors, rows)
        return tabu_search(self.problem, donors, rows, self.finish)

    def draws(self, rows: dict[str, DonorTrellis], count: int, seed: int) -> list[DonorSequences]:
        """Choose donors for several motions, each different from the others."""
        problem = self.problem
        config = problem.config
        rng = np.random.default_rng(seed)
        if config.choice == "random":
            ways = {
                group: reachable(pool, problem.passing(group), config)
                for group, pool in problem.pools.items()
            }
            return _different(
                lambda: {group: choose(*way, config, rng) for group, way in ways.items()}, count
            )
        if config.choice == "sample":

            def draw() -> DonorSequences:
                return {
                    group: row.donor_sequence(sample(row.costs, config.temperature, rng))
                    for group, row in rows.items()
                }

            return _different(draw, count)
        if config.choice == "best":
            lists = [k_best(row.costs, count) for row in rows.values()]
            costs = [
                [row.costs.cost(choices) for choices in own]
                for row, own in zip(rows.values(), lists, strict=True)
            ]
            combined = _cheapest_sums(costs, count)
        else:
            lists = [diverse(row.costs, count, config.diversity) for row in rows.values()]
            combined = _side_by_side([len(own) for own in lists], count)
        return [
            {
                group: row.donor_sequence(own[at])
                for (group, row), own, at in zip(rows.items(), lists, places, strict=True)
            }
            for places in combined
        ]

    def make_graft(self, chosen: DonorSequences, seed: int, index: int) -> Graft:
        problem = self.problem
        library = problem.library
        parts: list[Part] = []
        substitutions: list[Substitution] = []
        seams: list[Seam] = []
        for group, donors in chosen.items():
            taken = library.segments[donors]
            part = transplant(
                self.base,
                problem.base_segments,
                taken,
                library.clips,
                problem.grafted_group(group),
                library.config,
            )
            parts.append(part)
            substitutions += _substitutions(problem, group, donors)
            seams += _seams(group, part)
        motion = recombine(self.base, parts, f"{self.base.name}_graft{index}")
        motion, feet = self.on_its_feet(motion, chosen)
        return Graft(
            motion,
            self.base,
            library,
            tuple(substitutions),
            tuple(seams),
            {
                group: np.array([len(own) - 1 for own in problem.candidates[group]])
                for group in chosen
            },
            seed,
            index,
            tuple(self.violated(motion, chosen)),
            feet,
            self.order,
        )

    def violated(self, motion: Motion, chosen: DonorSequences) -> list[Violation]:
        """Return which hard constraints the finished motion does not meet."""
        problem = self.problem
        if not problem.constraints:
            return []
        poses = problem.poses.with_poses(np.arange(motion.n_frames), *motion.world_transforms())
        found = find_violations(problem.constraints, poses)
        for constraint in problem.constraints:
            if not isinstance(constraint, MaxAngle):
                continue
            for group, donors in chosen.items():
                for at, angle in enumerate(problem.pools[group].seam_angles_along(donors).tolist()):
                    if angle > constraint.limit:
                        frame = int(problem.base_segments.stop[at])
                        found.append(constraint.violation(group, frame, angle))
        return found

    def finish(self, new: Motion, chosen: DonorSequences) -> Motion:
        """Return a motion of some donors as it is given back."""
        return self.on_its_feet(new, chosen)[0]

    def on_its_feet(self, new: Motion, chosen: DonorSequences) -> tuple[Motion, FeetReport | None]:
        """Make feet stand where they do in the clips that their legs come from."""
        library, skeleton = self.problem.library, new.skeleton
        limbs = find_legs(skeleton)
        held = self.problem.held
        donors = {
            int(j): own
            for group, own in chosen.items()
            for j in library.joints(group)
            if j not in held[group]
        }
        grafted = [
            [j for j in _above(skeleton, limb.ankle, library.root) if j in donors] for limb in limbs
        ]
        exchanged = {j for j, own in donors.items() if (own != self.problem.scenario).any()}
        if library.config.feet == "never" or exchanged.isdisjoint(chain.from_iterable(grafted)):
            return new, None
        sources = [donors.get(limb.ankle, self.problem.scenario) for limb in limbs]
        stood, heights = donor_contacts(library, self.problem.base_segments, sources)
        return plant_feet(
            new,
            # And where the new motion happens to let them stand.
            stood | detect_contacts(new),
            movable_legs=[{limb.hip, limb.knee, limb.ankle} <= donors.keys() for limb in limbs],
            move_root=library.root in donors,
            min_heights=heights,
        )


def _checked(order: Sequence[int] | IntArray) -> IntArray:
    scenario = as_indices("scenario", order, ("n",))
    if not len(scenario):
        raise ValueError("scenario must hold at least one segment, got none")
    return scenario


def _within(scenario: IntArray, library: Library) -> IntArray:
    """Return a scenario, each of which must be a segment."""
    n = len(library.segments)
    wrong = scenario[(scenario < 0) | (scenario >= n)]
    if len(wrong):
        raise ValueError(f"scenario must be of segments 0 to {n - 1}, got {wrong[0]}")
    return scenario


def _above(skeleton: Skeleton, joint: int, root: int) -> list[int]:
    """Return a joint and those above it up to the root, which carry it."""
    chain = [joint]
    while chain[-1] != root and skeleton.parents[chain[-1]] >= 0:
        chain.append(int(skeleton.parents[chain[-1]]))
    return chain


def graft(
    library: Library,
    base: Motion | str | None = None,
    *,
    constraints: Sequence[Constraint] = (),
    swap: Sequence[str] | None = None,
    seed: int = 0,
    scenario: Sequence[int] | IntArray | Scenario | None = None,
) -> Graft:
    """Make one new motion.

    Parameters
    ----------
    library : Library
        Where the donors come from.
    base : Motion or str, optional
        The motion whose base group is kept, or its name in the library; one that is not in
        the library is cut and compared by the library's measures. Default: the first clip.
    constraints : sequence of Constraint, optional
        What the motion must do, or should: see `mograft.search.constraints`.
    swap : sequence of str, optional
        The groups to graft. Default: all but the base group.
    seed : int
        Of what is left to chance, with ``Config(choice="sample")`` and "random": another
        seed, another motion. The same seed gives the same numbers.
    scenario : sequence of int or Scenario, optional
        Segments of the library, one after the other, to be the base instead of a clip: any
        order that is wanted, or one of `mograft.scenario`. Each goes on from where the one
        before has come to.

    Returns
    -------
    Graft
        The motion and where every part of it comes from. Where no donor passes the limits
        the original is kept and the report says so. Hard constraints that cannot be met are
        told in its `violations`: it is the best that was found.

    Raises
    ------
    SkeletonMismatchError
        If the base has another hierarchy than the library.
    TypeError
        If something is no constraint.
    ValueError
        If a group is none, or is the base group, or a constraint names what is not there; if
        a segment of the scenario is none, or there is a base besides.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> new = graft(library, seed=7)
    >>> new.motion.n_frames == library.clips[0].n_frames
    True
    """
    return graft_many(
        library, base, 1, constraints=constraints, swap=swap, seed=seed, scenario=scenario
    )[0]


def graft_many(
    library: Library,
    base: Motion | str | None = None,
    count: int = 1,
    *,
    constraints: Sequence[Constraint] = (),
    swap: Sequence[str] | None = None,
    seed: int = 0,
    scenario: Sequence[int] | IntArray | Scenario | None = None,
) -> "Grafts":
    """Make several new motions, each different from the others.

    Parameters
    ----------
    library, base, constraints, swap, seed, scenario
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

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> grafts = graft_many(library, count=3, seed=7)
    >>> len(grafts), [graft.motion.name for graft in grafts]
    (3, ['dance_graft0', 'dance_graft1', 'dance_graft2'])
    """
    count, seed = as_integer("count", count, 1), as_integer("seed", seed)
    check_type("library", library, Library)
    plan = GraftPlan.build(library, base, swap, constraints, scenario)
    return Grafts(plan, tuple(plan.settled_draws(count, seed)), seed)


def repair(
    library: Library,
    base: Motion | str | None = None,
    *,
    constraints: Sequence[Constraint],
    swap: Sequence[str] | None = None,
    widest: float = 4.0,
) -> Graft:
    """Change a captured motion only where it does not meet constraints (paper, 5.2).

    Parameters
    ----------
    library, base, constraints, swap
        As for `graft`.
    widest : float
        Where no donor of the clusters helps, larger clusters are tried, up to this
        `Config.sigma_scale`; it is in the graft's library which.

    Returns
    -------
    Graft
        The motion with other donors in those segments of the violating group in which a hard
        constraint is not met, and in their neighbours where that is cheaper. Seams reach
        `Config.seam_blend` seconds further; everything else is as captured, bit for bit. (Where
        the group holds the root, all that follows is led elsewhere.) What cannot be met is told
        in its `violations`.

    Raises
    ------
    SkeletonMismatchError, TypeError, ValueError
        As for `graft`.

    Examples
    --------
    >>> from mograft.search.pose_constraints import Avoid
    >>> from mograft.dancer import dance
    >>> from mograft.search.obstacles import Sphere
    >>> motion = dance(strides=1).motion
    >>> far = Avoid(Sphere((0.0, 900.0, 0.0), 5.0))
    >>> any(not s.is_own for s in repair(Library.build(motion), constraints=[far]).substitutions)
    False
    """
    # The captured parts are what is wanted: an exchange gains nothing.
    careful = replace(library, config=replace(library.config, novelty=0.0, choice="viterbi"))
    best: Graft | None = None
    chosen: DonorSequences | None = None
    while True:
        plan = GraftPlan.build(careful, base, swap, constraints)
        # What has been put right stays as it is when the clusters grow.
        chosen = plan.problem.captured_donors if chosen is None else chosen
        plan = replace(plan, problem=plan.problem.narrowed(chosen))
        chosen = plan.settled(chosen, plan.rows())
        graft = plan.make_graft(chosen, 0, 0)
        if best is None or _missed_by(graft) < _missed_by(best):
            best = graft
        config = careful.config
        wider = config.sigma_scale * 4 / 3
        if not best.violations or wider > widest or not isinstance(config.sigma, str):
            return best
        careful = careful.relabelled(replace(config, sigma_scale=wider))


def _missed_by(graft: Graft) -> float:
    return sum(violation.error - 1.0 for violation in graft.violations)


def _key(donors: DonorSequences) -> bytes:
    return b"".join(own.tobytes() for own in donors.values())


def _distinct(several: Sequence[DonorSequences]) -> list[DonorSequences]:
    return list({_key(donors): donors for donors in several}.values())


def _different(draw: Callable[[], DonorSequences], count: int) -> list[DonorSequences]:
    """Draw until there are as many different ones, or a hundred draws in a row give none."""
    draws: dict[bytes, DonorSequences] = {}
    while len(draws) < count:
        for _ in range(100):
            chosen = draw()
            if _key(chosen) not in draws:
                break
        else:
            break
        draws[_key(chosen)] = chosen
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


def grafted_groups(library: Library, swap: Sequence[str] | None) -> list[str]:
    """Check and return the groups to graft, in the library's order."""
    base = library.groups.base
    others = [name for name in library.groups.names if name != base]
    if isinstance(swap, str):
        raise TypeError(f"swap must be a list of groups, got {swap!r}")
    wanted = others if swap is None else list(swap)
    for name in wanted:
        if name not in others:
            raise ValueError(
                f"swap must name groups other than the base {base!r}, of {', '.join(others)}; "
                f"got {name!r}"
            )
    if not wanted:
        raise ValueError(f"swap must name at least one group of {', '.join(others)}, got none")
    return [name for name in others if name in wanted]


def _substitutions(problem: SearchProblem, group: str, donors: IntArray) -> Iterator[Substitution]:
    library, pool, cut = problem.library, problem.pools[group], problem.base_segments
    segments = library.segments
    costs = pool.costs(problem.scenario, donors, problem.config)
    gaps = [0.0, *pool.seam_angles_along(donors).tolist(), 0.0]
    for at, (own, donor) in enumerate(zip(problem.scenario.tolist(), donors.tolist(), strict=True)):
        length, taken = int(cut.lengths[at]), int(segments.lengths[donor])
        yield Substitution(
            group,
            int(cut.start[at]),
            int(cut.stop[at]),
            own,
            donor,
            library.entries[segments.clip[donor]].name,
            int(segments.start[donor]),
            int(segments.stop[donor]),
            length / taken - 1.0,
            float(costs[at]),
            gaps[at],
            gaps[at + 1],
        )


def _seams(group: str, part: Part) -> Iterator[Seam]:
    for frame, gaps in zip(part.seams.tolist(), part.gaps, strict=True):
        yield Seam(group, frame, float(gaps.mean()))
