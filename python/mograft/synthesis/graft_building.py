"""The `Graft` of donor sequences: the motion, where each part is from, and what was repaired."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import repeat

import numpy as np

from mograft._util.arrays import IntArray
from mograft.blend.reach_completion import measure_completions
from mograft.motion.motion import Motion
from mograft.search.pose_constraints import Reach
from mograft.search.trellis import DonorSequences
from mograft.solve.assembly import Assembly
from mograft.solve.finish import find_motion_violations, finish_motion
from mograft.solve.plan import GraftPlan
from mograft.solve.search_problem import SearchProblem
from mograft.synthesis.graft_result import Graft, GraftRequest, Seam, Substitution


def build_graft(
    plan: GraftPlan,
    donors: DonorSequences,
    seed: int,
    index: int,
    request: GraftRequest | None = None,
) -> Graft:
    """Return the graft of donor sequences, after self-repair."""
    assembly, repairs = plan.assemble(donors, f"{plan.problem.base.name}_graft{index}")
    graft = finish_graft(plan.problem, assembly, seed, index)
    return replace(graft, self_repairs=tuple(repairs), request=request or GraftRequest())


def finish_graft(
    problem: SearchProblem,
    assembly: Assembly,
    seed: int,
    index: int,
    adjust: Callable[[Motion], Motion] | None = None,
    reaches: Sequence[Reach] | None = None,
) -> Graft:
    """Return the graft of an assembly, with planted feet and limbs at the targets of `reaches`.

    By default `reaches` are those among the constraints. `adjust` changes the motion last. The
    problem of the assembly may have fewer candidates than `problem`, as in an edit.
    """
    donors = assembly.donors
    motion, feet, completions = finish_motion(problem, assembly.motion, donors, reaches)
    motion = motion if adjust is None else adjust(motion)
    return Graft(
        motion=motion,
        base=problem.base,
        library=problem.library,
        substitutions=tuple(
            own for group in donors for own in _substitutions(problem, group, donors[group])
        ),
        seams=tuple(
            own
            for group, frames in assembly.seams.items()
            for own in _seams(problem, group, donors[group], frames)
        ),
        alternatives={group: problem.count_alternatives(group) for group in donors},
        seed=seed,
        index=index,
        violations=tuple(find_motion_violations(problem, motion, donors)),
        feet=feet,
        reach_completions=measure_completions(completions, motion),
    )


def _seams(
    problem: SearchProblem, group: str, donors: IntArray, frames: IntArray
) -> Iterator[Seam]:
    """Return the seams of a group, given their frames, with the gaps that `max_angle` limits."""
    gaps = problem.pools[group].seam_angles_along(donors)
    gaps = gaps[np.isin(problem.base_segments.stop[:-1], frames)]
    yield from map(partial(Seam, group), frames.tolist(), gaps.tolist())


def _substitutions(problem: SearchProblem, group: str, donors: IntArray) -> Iterator[Substitution]:
    """Return the substitutions of a group, one for each base segment."""
    pool, frames, clips = problem.pools[group], problem.base_segments, problem.library.entries
    origins = problem.library.segments[donors]
    gaps = [0.0, *pool.seam_angles_along(donors).tolist(), 0.0]
    stretches = frames.lengths / origins.lengths - 1.0
    costs = pool.unary_costs(problem.scenario, donors, problem.cost_models[group])
    columns = frames.start, frames.stop, problem.scenario, donors, origins.start, origins.stop
    start, stop, segment, donor, *others = (own.tolist() for own in (*columns, stretches, costs))
    names = [clips[clip].name for clip in origins.clip.tolist()]
    before = repeat(group), start, stop, segment, donor, names
    return map(Substitution, *before, *others, gaps[:-1], gaps[1:])
