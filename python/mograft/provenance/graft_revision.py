"""Revisions of a graft: donors chosen again in ranges, and other constraints."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from mograft._util.arrays import BoolArray, IntArray
from mograft._util.cancel import CancelledError
from mograft.blend.reach_completion import ReachCompletion
from mograft.provenance.graft_change import apply_changes, is_among, plan_of, unchanged
from mograft.provenance.graft_edit import (
    choose_again,
    position_masks,
    remaining_changes,
    remaining_constraints,
    replace_candidates,
    violating_positions,
)
from mograft.search.constraints import Constraint, Span
from mograft.search.donor_constraints import KeepOriginal
from mograft.search.pose_constraints import Reach
from mograft.search.segment_pool import list_pairs
from mograft.search.trellis import DonorSequences, viterbi
from mograft.solve.donor_repair import repair_near
from mograft.solve.finish import find_motion_violations
from mograft.solve.plan import GraftPlan
from mograft.solve.search_problem import SearchProblem
from mograft.synthesis.graft import can_be_removed, total_excess
from mograft.synthesis.graft_result import Graft

_NEAREST_FACTOR = 2
"""Candidates of a position that are tried first, as a multiple of `Config.max_candidates`."""

Ranges = Sequence[tuple[str, Span]]  # groups, each with a first and a last frame


def regenerate(graft: Graft, ranges: Ranges, seed: int, *, locked: Ranges = ()) -> Graft:
    """Return the graft with donors chosen again in ranges of frames.

    Each segment of `ranges` that has another candidate gets another donor; those of `locked` keep
    theirs. The constraints `Use` and `KeepOriginal` no longer apply to these segments. Raise
    ValueError if the library has only the clips of the graft.
    """
    changes, graft = graft.changes, unchanged(graft)
    problem = plan_of(graft, ()).problem
    is_open = select_positions(problem, ranges) & ~select_positions(problem, locked)
    old, is_fixed = graft.request.constraints, np.zeros_like(is_open)
    plan = plan_of(graft, remaining_constraints(old, is_open, is_fixed, problem))
    is_free = dict(zip(problem.pools, is_open, strict=True))

    def without_present(group: str, position: int, candidates: IntArray) -> IntArray:
        others = candidates[candidates != graft.donors[group][position]]
        return others if is_free[group][position] and len(others) else candidates

    plan = replace_candidates(plan, without_present)
    new = choose_again(graft, plan, is_open, seed)
    return apply_changes(new, plan.problem, remaining_changes(changes, plan.problem, is_open))


def select_positions(problem: SearchProblem, ranges: Ranges) -> BoolArray:
    """Return the positions that ranges of frames of groups select, (n_groups, n_segments)."""
    rules = [KeepOriginal(frames=frames, group=group) for group, frames in ranges]
    return position_masks(rules, problem)


def constrain(
    graft: Graft, constraints: Sequence[Constraint], *, locked: Ranges = (), is_quick: bool = False
) -> Graft:
    """Return the graft with other constraints.

    The segments that violate those that are not constraints of the graft, the same objects, and
    those beside them get other donors, unless they are `locked`. All others keep theirs. A `Reach`
    that is left out stays with weight 0 as the last constraint if inverse kinematics has moved a
    limb to its target, because earlier versions of the graft have the limb there. Unless
    `is_quick`, all candidates are searched if the nearest ones leave violations, and the better of
    the two results is returned; if this is cancelled (`mograft._util.cancel`), the first. Raise
    ValueError if the library has only the clips of the graft.
    """
    changes, graft = graft.changes, unchanged(graft)
    old = graft.request.constraints
    graft, retired = _retire(graft, constraints)
    plan = plan_of(graft, [*constraints, *retired])
    problem = plan.problem
    is_open: BoolArray = np.zeros((len(problem.pools), len(problem.base_segments)), bool)
    pairs = zip(constraints, problem.constraints, strict=False)
    known = [own for given, own in pairs if is_among(given, old)]
    if len(known) < len(constraints):
        is_open = violating_positions(graft, problem, [*known, *retired])
        is_open &= ~select_positions(problem, locked)
    is_reaching = any(type(own) is Reach for own in constraints if not is_among(own, old))
    if is_open.any() or is_reaching or retired:
        if problem.root_group is not None:
            new = choose_again(graft, plan, is_open, graft.seed)
        else:
            near = partial(_choose_near, is_open=is_open)
            new = choose_again(graft, _with_nearest(plan, is_open), is_open, graft.seed, near)
            if not is_quick and is_open.any() and can_be_removed(new, problem):
                with suppress(CancelledError):
                    other = choose_again(graft, plan, is_open, graft.seed)
                    new = min(new, other, key=total_excess)
    else:
        violations = find_motion_violations(problem, graft.motion, graft.donors)
        request = replace(graft.request, constraints=problem.constraints)
        new = replace(graft, violations=tuple(violations), request=request)
    return apply_changes(new, problem, changes)


def _with_nearest(plan: GraftPlan, is_open: BoolArray) -> GraftPlan:
    """Return a plan with fewer candidates at some positions: those most like the base segment."""
    problem, nearest = plan.problem, dict[tuple[str, int], IntArray]()
    for group, free in zip(problem.pools, is_open, strict=True):
        positions = np.flatnonzero(free)
        if len(positions):
            base, model = problem.scenario[positions], problem.cost_models[group]
            chosen = [problem.candidates[group][at] for at in positions.tolist()]
            costs = problem.pools[group].preselection_costs(*list_pairs(base, chosen), model)
            kept, _ = model.keep_cheapest_of_each(base, chosen, costs, _NEAREST_FACTOR)
            nearest |= {(group, at): own for at, own in zip(positions.tolist(), kept, strict=True)}
    return replace_candidates(plan, lambda group, at, own: nearest.get((group, at), own))


def _choose_near(plan: GraftPlan, *, is_open: BoolArray) -> DonorSequences:
    """Return the cheapest donors, changed until the constraints hold near some positions."""
    trellises = plan.trellises
    paths = {group: viterbi(trellis.costs) for group, trellis in trellises.items()}
    donors = {group: trellises[group].donor_sequence(path) for group, path in paths.items()}
    positions = np.flatnonzero(is_open.any(axis=0))
    if not len(positions) or not any(own.is_hard for own in plan.problem.pose_constraints):
        return donors
    first, stop = max(int(positions[0]) - 1, 0), int(positions[-1]) + 2
    stop = min(stop, len(plan.problem.base_segments))
    return repair_near(plan.problem, donors, trellises, first, stop)


def _retire(graft: Graft, constraints: Sequence[Constraint]) -> tuple[Graft, list[Constraint]]:
    """Return a graft in which the targets left out have weight 0, and these targets."""
    history = (*graft.completion_history, graft.reach_completions)
    used = [own.reach for version in history for own in version]
    removed = [
        own
        for own in graft.request.constraints
        if isinstance(own, Reach) and is_among(own, used) and not is_among(own, constraints)
    ]
    others = {id(own): replace(own, frame=None, weight=0.0) for own in removed}
    if not others:
        return graft, []

    def renew(version: tuple[ReachCompletion, ...]) -> tuple[ReachCompletion, ...]:
        return tuple(replace(own, reach=others.get(id(own.reach), own.reach)) for own in version)

    kept = tuple(others.get(id(own), own) for own in graft.request.constraints)
    return (
        replace(
            graft,
            request=replace(graft.request, constraints=kept),
            completion_history=tuple(map(renew, graft.completion_history)),
            reach_completions=renew(graft.reach_completions),
        ),
        [others[id(own)] for own in removed],
    )
