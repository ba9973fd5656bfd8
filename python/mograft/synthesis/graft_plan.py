"""The plan that all grafts on one base share: choose donors, repair them, build the motion."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain, repeat

import numpy as np

from mograft._util.arrays import IntArray, as_indices
from mograft._util.memory import return_free_memory, reuse_freed_arrays
from mograft.blend.foot_planting import FeetReport, plant_feet
from mograft.blend.reach_completion import measure_completions
from mograft.body.contacts import detect_contacts, find_legs
from mograft.config import Config
from mograft.errors import suggest_name
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.scenario import Scenario
from mograft.scenario.realize import donor_contacts, realize_scenario
from mograft.search.candidates import SegmentPool
from mograft.search.constraints import Constraint, Violation, find_violations
from mograft.search.donor_choice import DONOR_CHOICES, unique_sequences
from mograft.search.donor_constraints import find_seam_violations
from mograft.search.pose_constraints import Reach
from mograft.search.trellis import DonorSequences, DonorTrellis
from mograft.search.viterbi import viterbi
from mograft.solve.assembly import Assembly
from mograft.solve.donor_repair import repair_donors
from mograft.solve.donor_trellis import build_trellis, candidate_violations
from mograft.solve.donor_violations import find_donor_violations
from mograft.solve.reach_finish import active_reaches, finish_reaches
from mograft.solve.root_tabu_search import tabu_search
from mograft.solve.search_problem import SearchProblem
from mograft.solve.self_repair import RepairedWindow, self_repair
from mograft.synthesis.graft_request import GraftRequest
from mograft.synthesis.graft_result import Graft
from mograft.synthesis.substitution import Seam, Substitution


@dataclass(frozen=True, eq=False)
class GraftPlan:
    """The search problem of one base motion and its trellises. Made by `GraftPlan.build`."""

    problem: SearchProblem
    request: GraftRequest = field(default_factory=GraftRequest)

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
        if scenario is None:
            if isinstance(base, int):
                clip = base
            else:
                library, clip = library.resolve_base(base)
            indices = library.segments.of_clip(clip)
            motion, segments = library.clips[clip], library.segments[indices]
        elif base is not None:
            raise ValueError("`base` must not be given together with `scenario`, which replaces it")
        else:
            scenario = _as_scenario(scenario, library)
            indices = scenario.segments
            motion, segments = realize_scenario(library, scenario)
        problem = SearchProblem.build(library, motion, indices, segments, groups, constraints)
        request = GraftRequest(
            base=None if base is None else motion.name,
            swap=None if swap is None else tuple(swap),
            constraints=problem.constraints,
            scenario=scenario,
        )
        return cls(problem, request)

    @property
    def config(self) -> Config:
        """The library's configuration, with the limits that the constraints set."""
        return self.problem.config

    @property
    def pools(self) -> Mapping[str, SegmentPool]:
        """The pool of segments from which the donors of each grafted group are chosen."""
        return self.problem.pools

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
        choice = DONOR_CHOICES.get(self.config.choice)
        drawn = choice.draw(self, count, np.random.default_rng(seed))
        return unique_sequences([self.repair(donors) for donors in drawn])

    def repair(self, donors: DonorSequences) -> DonorSequences:
        """Change donors until the hard constraints hold, if possible; return the new sequences."""
        if not any(constraint.is_hard for constraint in self.problem.constraints):
            return donors
        donors = repair_donors(self.problem, donors, self.trellises)
        return tabu_search(self.problem, donors, self.trellises, self._finish)

    def build_graft(
        self, donors: DonorSequences, seed: int, index: int, *, is_last: bool = False
    ) -> Graft:
        """Return the graft of donor sequences, after self-repair.

        If `is_last` is true, the trellises are released before the graft is finished.
        """
        n_bytes = 4 * self.problem.base.rotations.nbytes
        return_free_memory(n_bytes)
        assembly, repairs = self.assemble(donors, f"{self.problem.base.name}_graft{index}")
        if is_last:
            self.__dict__.pop("trellises", None)
        return_free_memory(n_bytes)
        return replace(self.finish(assembly, seed, index), repairs=tuple(repairs))

    def assemble(self, donors: DonorSequences, name: str) -> tuple[Assembly, list[RepairedWindow]]:
        """Return the assembly of donor sequences after self-repair, and the frames searched."""
        assembly = Assembly(self.problem, donors, name)
        if self.config.self_repair and DONOR_CHOICES.get(self.config.choice).allows_self_repair:
            return self_repair(assembly, lambda: self.trellises, self._assembly_violations)
        return assembly, []

    def finish(
        self,
        assembly: Assembly,
        seed: int,
        index: int,
        adjust: Callable[[Motion], Motion] = lambda motion: motion,
        reaches: Sequence[Reach] | None = None,
    ) -> Graft:
        """Return the graft of an assembly, with planted feet and limbs at the targets of `reaches`.

        By default `reaches` are those among the constraints. `adjust` changes the motion last.
        """
        problem, donors = self.problem, assembly.donors
        substitutions: list[Substitution] = []
        seams: list[Seam] = []
        for group, frames in assembly.seams.items():
            substitutions += _substitutions(problem, group, donors[group])
            seams += _seams(problem, group, donors[group], frames)
        planted, feet = self._plant_feet(assembly.motion, donors)
        wanted = active_reaches(problem.constraints) if reaches is None else reaches
        completed, completions = finish_reaches(problem, planted, wanted)
        motion = adjust(completed)
        return Graft(
            motion=motion,
            base=problem.base,
            library=problem.library,
            substitutions=tuple(substitutions),
            seams=tuple(seams),
            alternatives={group: problem.count_alternatives(group) for group in donors},
            seed=seed,
            index=index,
            violations=tuple(self._violations(motion, donors)),
            feet=feet,
            reach_completions=measure_completions(completions, motion),
            request=self.request,
        )

    def _assembly_violations(self, assembly: Assembly) -> list[Violation]:
        motion = self._finish(assembly.motion, assembly.donors)
        return self._violations(motion, assembly.donors)

    def _violations(self, motion: Motion, donors: DonorSequences) -> list[Violation]:
        """Return the violations of hard constraints by a finished motion and its donors."""
        problem = self.problem
        if not problem.constraints:
            return []
        found = find_violations(problem.constraints, problem.poses_of(motion))
        found += find_donor_violations(problem, donors)
        seam_frames = problem.base_segments.stop[:-1].tolist()
        for constraint in problem.constraints:
            for group, sequence in donors.items():
                angles = problem.pools[group].seam_angles_along(sequence).tolist()
                found += find_seam_violations([constraint], group, seam_frames, angles)
        return found

    def _finish(self, motion: Motion, donors: DonorSequences) -> Motion:
        planted, _ = self._plant_feet(motion, donors)
        return finish_reaches(self.problem, planted, active_reaches(self.problem.constraints))[0]

    def _plant_feet(
        self, motion: Motion, donors: DonorSequences
    ) -> tuple[Motion, FeetReport | None]:
        """Plant each foot in its contacts of the new motion and in those of its donors' clips.

        A foot is planted in every frame in which it touches the floor in the new motion or touched
        it in its donor's clip. The motion is not changed if `Config.feet` is "never" or if no
        exchanged group drives the feet.
        """
        problem, library = self.problem, self.problem.library
        if library.config.feet == "never":
            return motion, None
        legs = find_legs(motion.skeleton)
        donors_of = {
            int(joint): sequence
            for group, sequence in donors.items()
            for joint in library.joints(group)
            if joint not in problem.divided_channels[group]
        }
        exchanged = {
            joint for joint, sequence in donors_of.items() if (sequence != problem.scenario).any()
        }
        driving = chain.from_iterable(
            _chain_to_root(motion.skeleton, leg.ankle, library.root) for leg in legs
        )
        if exchanged.isdisjoint(driving):
            return motion, None
        sources = [donors_of.get(leg.ankle, problem.scenario) for leg in legs]
        contacts, heights = donor_contacts(library, problem.base_segments, sources)
        return plant_feet(
            motion,
            # Contacts of the donors' feet, and contacts detected in the new motion.
            contacts | detect_contacts(motion),
            movable_legs=problem.movable_legs,
            move_root=library.root in donors_of,
            floor_reference=problem.base,
            min_heights=heights,
        )


def grafted_groups(library: Library, swap: Sequence[str] | None) -> list[str]:
    """Return the groups to graft, in the library's order; None means all but the base group."""
    base = library.groups.base
    others = [name for name in library.groups.names if name != base]
    if isinstance(swap, str):
        raise TypeError(f"`swap` must be a list of groups, got {swap!r}")
    wanted = others if swap is None else list(swap)
    for name in wanted:
        if name not in others:
            raise ValueError(
                f"`swap` must name groups other than the base group {base!r}, got {name!r}: "
                f"choose from {', '.join(others)}{suggest_name(name, others)}"
            )
    if not wanted:
        raise ValueError(f"`swap` must name at least one of {', '.join(others)}; got none")
    return [name for name in others if name in wanted]


def _seams(
    problem: SearchProblem, group: str, donors: IntArray, frames: IntArray
) -> Iterator[Seam]:
    """Return the seams of a group, given their frames, with the gaps that `max_angle` limits."""
    gaps = problem.pools[group].seam_angles_along(donors)
    is_seam = np.isin(problem.base_segments.stop[:-1], frames)
    for frame, gap in zip(frames.tolist(), gaps[is_seam].tolist(), strict=True):
        yield Seam(group, frame, gap)


def _substitutions(problem: SearchProblem, group: str, donors: IntArray) -> Iterator[Substitution]:
    pool, frames = problem.pools[group], problem.base_segments
    origins, clips = problem.library.segments[donors], problem.library.entries
    costs = pool.unary_costs(problem.scenario, donors, problem.cost_models[group])
    gaps = [0.0, *pool.seam_angles_along(donors).tolist(), 0.0]
    names = [clips[clip].name for clip in origins.clip.tolist()]
    stretches = frames.lengths / origins.lengths - 1.0
    return map(
        Substitution,
        repeat(group),
        frames.start.tolist(),
        frames.stop.tolist(),
        problem.scenario.tolist(),
        donors.tolist(),
        names,
        origins.start.tolist(),
        origins.stop.tolist(),
        stretches.tolist(),
        costs.tolist(),
        gaps[:-1],
        gaps[1:],
    )


def _as_scenario(scenario: Sequence[int] | IntArray | Scenario, library: Library) -> Scenario:
    """Convert a sequence of segments to a `Scenario`, and check that all segments exist."""
    if not isinstance(scenario, Scenario):
        indices = as_indices("scenario", scenario, ("n",))
        if not len(indices):
            raise ValueError("`scenario` must contain at least one segment, got none")
        scenario = Scenario(indices)
    n = len(library.segments)
    wrong = scenario.segments[(scenario.segments < 0) | (scenario.segments >= n)]
    if len(wrong):
        raise ValueError(f"`scenario` must contain only segments 0 to {n - 1}, got {wrong[0]}")
    return scenario


def _chain_to_root(skeleton: Skeleton, joint: int, root: int) -> list[int]:
    """Return a joint and its ancestors up to the root."""
    joints = [joint]
    while joints[-1] != root and skeleton.parents[joints[-1]] >= 0:
        joints.append(int(skeleton.parents[joints[-1]]))
    return joints
