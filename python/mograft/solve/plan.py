"""The plan that all grafts on one base share: choose donors, repair and assemble them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mograft._util.arrays import IntArray
from mograft._util.memory import reuse_freed_arrays
from mograft.body.groups import OTHER_BASE, suggest_groups
from mograft.config import Config
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.scenario import Scenario
from mograft.scenario.scenario import as_scenario, realize_scenario
from mograft.search.constraints import Constraint, Violation
from mograft.search.donor_choice import DONOR_CHOICES, unique_sequences
from mograft.search.segment_pool import SegmentPool
from mograft.search.trellis import DonorSequences, DonorTrellis, viterbi
from mograft.solve.assembly import Assembly
from mograft.solve.donor_repair import repair_donors, tabu_search
from mograft.solve.donor_trellis import build_trellis, candidate_violations
from mograft.solve.finish import find_motion_violations, finish_motion
from mograft.solve.search_problem import SearchProblem
from mograft.solve.self_repair import RepairedWindow, self_repair


@dataclass(frozen=True, eq=False)
class GraftPlan:
    """The search problem of one base motion and its trellises. Made by `GraftPlan.build`."""

    problem: SearchProblem
    scenario: Scenario | None = None  # the base, if it is composed of segments

    @classmethod
    def build(
        cls,
        library: Library,
        base: Motion | str | int | None,
        swap: Sequence[str] | None,
        constraints: Sequence[Constraint],
        scenario: Sequence[int] | IntArray | Scenario | None = None,
    ) -> "GraftPlan":
        """Return the plan; the arguments are those of `mograft.graft`.

        `base` may also be the index of a clip.
        """
        reuse_freed_arrays()
        groups = grafted_groups(library, swap)
        own = None if scenario is None else as_scenario(scenario, library)
        if own is not None:
            if base is not None:
                raise ValueError(
                    "`base` must not be given together with `scenario`, which replaces it"
                )
            indices, (motion, segments) = own.segments, realize_scenario(library, own)
        else:
            library, clip = (library, base) if isinstance(base, int) else library.resolve_base(base)
            indices = library.segments.of_clip(clip)
            motion, segments = library.clips[clip], library.segments[indices]
        problem = SearchProblem.build(library, motion, indices, segments, groups, constraints)
        return cls(problem, own)

    @property
    def config(self) -> Config:
        """The library's configuration, with the limits that the constraints set."""
        return self.problem.config

    @property
    def pools(self) -> Mapping[str, SegmentPool]:
        """The pool of segments from which the donors of each grafted group are chosen."""
        return self.problem.pools

    @property
    def n_combinations(self) -> int:
        """The number of different donor sequences that the candidates allow, at most."""
        lists = self.problem.candidates.values()
        return math.prod(len(own) for positions in lists for own in positions)

    @cached_property
    def trellises(self) -> dict[str, DonorTrellis]:
        """The candidates of each grafted group and their costs.

        Constraints on a group are evaluated with the cheapest donors of the groups before it.
        """
        trellises: dict[str, DonorTrellis] = {}
        chosen: DonorSequences = {}
        for group in self.pools:
            trellis = build_trellis(self.problem, group, chosen)
            trellises[group] = trellis
            if self.problem.constraints:
                chosen[group] = trellis.donor_sequence(viterbi(trellis.costs))
        return trellises

    def feasible_candidates(self, group: str) -> Sequence[IntArray]:
        """Return for each position the candidates that satisfy all hard constraints.

        If none does, all candidates of the position are returned. If any grafted group contains
        the root, all candidates of all positions are returned: the root transform at a position
        depends on the donors before it.
        """
        candidates = self.problem.candidates[group]
        if self.problem.root_group is not None:
            return candidates
        found = candidate_violations(self.problem, group, {})
        return [
            segments[own.is_feasible] if own.is_feasible.any() else segments
            for segments, own in zip(candidates, found, strict=True)
        ]

    def choose_donors(self, count: int, seed: int) -> list[DonorSequences]:
        """Choose at most `count` different donor sequences by `Config.choice`, and repair them."""
        choice = DONOR_CHOICES[self.config.choice]
        drawn = choice.draw(self, count, np.random.default_rng(seed))
        return unique_sequences([self.repair(donors) for donors in drawn])

    def repair(self, donors: DonorSequences) -> DonorSequences:
        """Change donors until the hard constraints hold, if possible; return the new sequences."""
        if not any(constraint.is_hard for constraint in self.problem.constraints):
            return donors
        donors = repair_donors(self.problem, donors, self.trellises)
        return tabu_search(self.problem, donors, self.trellises, self._finish)

    def assemble(self, donors: DonorSequences, name: str) -> tuple[Assembly, list[RepairedWindow]]:
        """Return the assembly of donor sequences after self-repair, and the frames searched."""
        assembly = Assembly.build(self.problem, donors, name)
        if self.config.self_repair and DONOR_CHOICES[self.config.choice].depends_on_costs:
            return self_repair(assembly, self.trellises, self._violations)
        return assembly, []

    def _finish(self, motion: Motion, donors: DonorSequences) -> Motion:
        return finish_motion(self.problem, motion, donors)[0]

    def _violations(self, assembly: Assembly) -> list[Violation]:
        motion = self._finish(assembly.motion, assembly.donors)
        return find_motion_violations(self.problem, motion, assembly.donors)


def grafted_groups(library: Library, swap: Sequence[str] | None) -> list[str]:
    """Return the groups to graft, in hierarchical order; None means all but the base group."""
    base = library.groups.base
    others = [name for name in library.groups.names if name != base]
    if isinstance(swap, str):
        raise TypeError(f"`swap` must be a list of groups, got {swap!r}")
    wanted = others if swap is None else list(swap)
    for name in wanted:
        if name == base:
            raise ValueError(
                f"`swap` must not have the base group {base!r}, which keeps its motion; "
                f"{OTHER_BASE}"
            )
        if name not in others:
            raise ValueError(
                f"`swap` must name groups other than the base group {base!r}, got {name!r}: "
                f"choose from {', '.join(others)}{suggest_groups(name, [base, *others])}"
            )
    if not wanted:
        raise ValueError(f"`swap` must name at least one of {', '.join(others)}; got none")
    chosen = [name for name in others if name in wanted]
    return sorted(chosen, key=lambda name: int(library.joints(name).min()))
