"""Edits of a graft: other donors at some base segments, everything else unchanged."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from mograft._util.arrays import BoolArray, IntArray
from mograft._util.runs import dilate, find_runs
from mograft._util.validate import as_integer
from mograft.blend.recombine import splice
from mograft.errors import join_names, suggest_frames
from mograft.motion.motion import Motion
from mograft.provenance.graft_change import apply_changes, is_among, plan_of, unchanged
from mograft.search.constraint_records import UnrestoredConstraint
from mograft.search.constraints import Constraint, overlaps
from mograft.search.donor_constraints import Ban, KeepOriginal, Use
from mograft.search.pose_constraints import Reach
from mograft.search.trellis import DonorSequences
from mograft.solve.assembly import Assembly
from mograft.solve.finish import find_motion_violations, finish_motion
from mograft.solve.plan import GraftPlan
from mograft.solve.search_problem import SearchProblem, check_constraints, resolve_segments
from mograft.synthesis.graft_building import finish_graft
from mograft.synthesis.graft_result import Change, Graft

_RULES = (Use, Ban, KeepOriginal)
"""Constraints that select segments, and replace earlier ones there."""

_MAX_CHANGES = 20
"""Replaced donors that `describe_changes` lists."""


def edit(graft: Graft, *edits: Constraint, seed: int | None = None) -> Graft:
    """Return the graft with other donors at some segments; all other segments keep theirs.

    Parameters
    ----------
    graft : Graft
        The graft, which does not change.
    *edits : Constraint
        `Use` sets the donor of a segment, `KeepOriginal` restores the captured motion. `Ban`
        excludes a donor, and the segment gets another. Without a donor it excludes the present
        one of each of its segments that has another candidate. At its segments an edit replaces
        the constraints `Use` and `KeepOriginal` of the graft and of earlier edits, and `Use` and
        `KeepOriginal` also replace earlier bans. Other bans remain in force: no ban brings an
        excluded donor back. Any other constraint is added to those of the graft; the segments
        that violate it, and those beside them, get other donors.
    seed : int, optional
        Seed of the choice. Default: that of the graft.

    Returns
    -------
    Graft
        Other segments have the same donors, and the changes of `change` remain, except those that
        an edit of their segments replaces. The frames near the changed segments are new. A
        range of new frames ends at least `Config.seam_blend` seconds outside these segments, at
        a frame at which no joint differs by more than 0.0001 radians from the present motion.
        All other frames are the same, bit for bit. If an exchanged group contains the root, the
        later frames of the root are moved rigidly.
        `violations` lists edits and constraints that contradict each other.

    Raises
    ------
    TypeError
        If an edit is not a constraint.
    ValueError
        If no edit is given; if an edit has a weight; if a segment, donor, group or frame does not
        exist; if the library has only the clips of the graft, because `replay` read their files.

    Examples
    --------
    >>> import mograft as mg
    >>> from mograft.dancer import dance
    >>> new = mg.graft(mg.Library.build(dance(strides=1).motion), seed=7)
    >>> mc = mg.constraints
    >>> edited = mg.edit(new, mc.KeepOriginal(frames=(60, 90)), mc.Ban(40))
    >>> (edited.motion.rotations[400:] == new.motion.rotations[400:]).all()
    np.True_
    """
    changes, graft = graft.changes, unchanged(graft)
    for own in edits:
        if not isinstance(own, Constraint):
            raise TypeError(f"edits must be constraints, got {own!r}")
        if not own.is_hard:
            raise ValueError(f"edits must be hard constraints, got weight {own.weight}")
    if not edits:
        raise ValueError("`edits` must be one constraint or more, got none")
    seed = graft.seed if seed is None else as_integer("seed", seed)
    problem = plan_of(graft, ()).problem
    rules = _resolve_edits(graft, [own for own in edits if isinstance(own, _RULES)], problem)
    added = [own for own in edits if not isinstance(own, _RULES)]
    old = list(graft.request.constraints)
    for constraint in old:
        if isinstance(constraint, UnrestoredConstraint):
            warnings.warn(
                f"the constraint {constraint.name!r} is Python code, which the provenance does not "
                "contain: the new donors need not satisfy it",
                stacklevel=2,
            )
    edited = position_masks(rules, problem)
    fixed = position_masks([own for own in rules if not isinstance(own, Ban)], problem)
    kept = [*remaining_constraints(old, edited, fixed, problem), *added]
    plan = plan_of(graft, [*kept, *(own for own in rules if not _bans_present(own))])
    if any(map(_bans_present, rules)):
        plan = plan_of(graft, [*kept, *_with_present_donors(graft, plan.problem, rules)])
    is_open = edited | (violating_positions(graft, plan.problem, old) if added else False)
    result = choose_again(graft, plan, is_open, seed)
    return apply_changes(result, plan.problem, remaining_changes(changes, plan.problem, edited))


def remaining_changes(
    changes: Sequence[Change], problem: SearchProblem, edited: BoolArray
) -> list[Change]:
    """Return the changes outside of the positions `edited`, shape (n_groups, n_segments)."""
    cut, rows = problem.base_segments, dict(zip(problem.pools, edited, strict=True))
    return [own for own in changes if not (rows[own.group] & overlaps(cut, own.frames)).any()]


def violating_positions(
    graft: Graft, problem: SearchProblem, old: Sequence[Constraint]
) -> BoolArray:
    """Return the positions at or beside which a graft violates constraints that are not `old`.

    The result has shape (n_groups, n_segments).
    """
    selected = np.zeros((len(problem.pools), len(problem.base_segments)), bool)
    # What inverse kinematics can satisfy with the present donors needs no others.
    assembly = Assembly.build(problem, graft.donors, graft.motion.name)
    motion = finish_motion(problem, assembly.motion, graft.donors)[0]
    for row, (group, donors) in enumerate(graft.donors.items()):
        for own in find_motion_violations(problem, motion, {group: donors}):
            if not is_among(own.constraint, old) and own.constraint.applies_to_group(group):
                selected[row] |= overlaps(problem.base_segments, own.frames)
        selected[row] = dilate(selected[row])
    return selected


def describe_changes(graft: Graft, edited: Graft) -> list[str]:
    """Return a line for each donor that `edit` replaced, and one with the changed frames."""
    lines = []
    pairs = list(zip(graft.substitutions, edited.substitutions, strict=True))
    for group in graft.alternatives:
        numbered = enumerate(pair for pair in pairs if pair[0].group == group)
        lines += [
            f"segment {number}, frames {old.start}-{old.stop}, {group}: "
            f"{new.clip} {new.donor_start}-{new.donor_stop} instead of "
            f"{old.clip} {old.donor_start}-{old.donor_stop}"
            for number, (old, new) in numbered
            if old.donor != new.donor
        ]
    if len(lines) > _MAX_CHANGES:
        lines = [*lines[:_MAX_CHANGES], f"and {len(lines) - _MAX_CHANGES} more segments"]
    lines += [f"removed: {own}" for own in graft.changes if own not in edited.changes]
    is_new = (graft.motion.rotations != edited.motion.rotations).any(axis=(1, 2))
    is_new |= (graft.motion.positions != edited.motion.positions).any(axis=(1, 2))
    ranges = [f"{start}-{stop - 1}" for start, stop in find_runs(is_new).tolist()]
    return [*lines, f"new frames: {join_names(ranges) or 'none'}; all others are unchanged"]


def _resolve_edits(
    graft: Graft, edits: Sequence[Constraint], problem: SearchProblem
) -> list[Constraint]:
    """Return the edits with frames instead of segment numbers."""
    cut = problem.base_segments
    check_constraints(edits, problem.base_poses)
    rules = resolve_segments(edits, list(problem.pools), cut, graft.library)
    for frames in (own.frames for own in rules if own.frames is not None):
        if not overlaps(cut, frames).any():
            last = cut.stop[-1]
            raise ValueError(f"`frames` must be within 0 to {last}, {suggest_frames(frames, last)}")
    return rules


def _bans_present(edit: Constraint) -> bool:
    """Return whether an edit excludes the present donors of its segments."""
    return isinstance(edit, Ban) and edit.donor is None


def _with_present_donors(
    graft: Graft, problem: SearchProblem, edits: Sequence[Constraint]
) -> list[Constraint]:
    """Return edits in which each ban without a donor is a ban of each present donor.

    Warn about the segments that have no other candidate in `problem`: they are not banned.
    """
    groups, rules = list(problem.pools), list[Constraint]()
    n_banned = n_alone = 0
    for edit in edits:
        if not _bans_present(edit):
            rules.append(edit)
            continue
        for row, position in np.argwhere(position_masks([edit], problem)).tolist():
            group, donor = groups[row], int(graft.donors[groups[row]][position])
            n_banned += 1
            if (problem.candidates[group][position] != donor).any():
                is_captured = donor == problem.scenario[position]
                rules.append(Ban(position, None if is_captured else donor, group=group))
            else:
                n_alone += 1
    if n_alone:
        warnings.warn(
            f"{n_alone} of {n_banned} banned segments have no other candidate and keep their "
            "donors",
            stacklevel=3,
        )
    return rules


def position_masks(constraints: Sequence[Constraint], problem: SearchProblem) -> BoolArray:
    """Return which base segments constraints select, shape (n_groups, n_segments)."""
    selected = np.zeros((len(problem.pools), len(problem.base_segments)), bool)
    for own in constraints:
        is_in_group = [own.applies_to_group(group) for group in problem.pools]
        selected[is_in_group] |= overlaps(problem.base_segments, own.frames)
    return selected


def remaining_constraints(
    constraints: Sequence[Constraint], edited: BoolArray, fixed: BoolArray, problem: SearchProblem
) -> list[Constraint]:
    """Return the constraints that remain after edits.

    At the positions `edited`, shape (n_groups, n_segments), earlier hard `Use` and `KeepOriginal`
    no longer apply; at those of `fixed`, of `Use` or `KeepOriginal` edits, earlier hard `Ban` no
    longer apply either.
    """
    segments, kept = problem.base_segments, list[Constraint]()
    for constraint in constraints:
        selected = position_masks([constraint], problem)
        removed = fixed if isinstance(constraint, Ban) else edited
        if not isinstance(constraint, _RULES) or not (
            constraint.is_hard and (selected & removed).any()
        ):
            kept.append(constraint)
            continue
        for group, mask in zip(problem.pools, selected & ~removed, strict=True):
            for start, stop in find_runs(mask).tolist():
                span = (int(segments.start[start]), int(segments.stop[stop - 1]))
                kept.append(replace(constraint, frames=span, group=group))
    return kept


def replace_candidates(
    plan: GraftPlan, choose: Callable[[str, int, IntArray], IntArray]
) -> GraftPlan:
    """Return a plan with `choose(group, position, candidates)` in place of all candidates."""
    candidates = {
        group: [choose(group, position, own) for position, own in enumerate(lists)]
        for group, lists in plan.problem.candidates.items()
    }
    return replace(plan, problem=replace(plan.problem, candidates=candidates))


def choose_again(
    graft: Graft,
    plan: GraftPlan,
    is_open: BoolArray,
    seed: int,
    choose: Callable[[GraftPlan], DonorSequences] | None = None,
) -> Graft:
    """Return the graft with donors chosen again at some positions only.

    They are those of `is_open`, shape (n_groups, n_segments). `choose` replaces the choice of the
    configuration and self-repair.
    """
    before, is_free = graft.donors, dict(zip(plan.pools, is_open, strict=True))
    restricted = replace_candidates(
        plan, lambda group, at, own: own if is_free[group][at] else before[group][[at]]
    )
    if choose is None:
        (chosen,) = restricted.choose_donors(1, seed)
        assembly, repairs = restricted.assemble(chosen, graft.motion.name)
    else:
        assembly = Assembly.build(plan.problem, choose(restricted), graft.motion.name)
        repairs = []
    steps = (before, assembly.donors)
    reaches = [
        own
        for own in plan.problem.constraints
        if type(own) is Reach and not is_among(own, graft.request.constraints)
    ]
    # Those without a weight any more were removed.
    reaches += [own.reach for own in graft.reach_completions if own.reach.weight == 0]
    adjust = partial(splice_versions, plan.problem, *steps, graft.motion, reaches=reaches)
    edited = finish_graft(plan.problem, assembly, seed, graft.index, adjust)
    cut, changed = plan.problem.base_segments, changed_positions(*steps)
    starts, stops = cut.start[changed], cut.stop[changed]
    # Other windows of self-repair keep their results.
    windows = [(own, False) for own in graft.self_repairs] + [(own, True) for own in repairs]
    found = [w for w, is_new in windows if ((starts < w.stop) & (stops > w.start)).any() == is_new]
    return replace(
        edited,
        self_repairs=tuple(sorted(found, key=lambda own: (own.group, own.start))),
        request=replace(
            graft.request,
            constraints=plan.problem.constraints,
            edit_commands=(*graft.request.edit_commands, None),
        ),
        history=(*graft.history, before),
        completion_history=(*graft.completion_history, graft.reach_completions),
    )


def splice_versions(
    problem: SearchProblem,
    old: DonorSequences,
    new: DonorSequences,
    before: Motion,
    after: Motion,
    *,
    reaches: Sequence[Reach] = (),
) -> Motion:
    """Return `before` with frames of `after` near the positions at which `old` and `new` differ.

    `before` and `after` are the motions of the donors `old` and `new`. Frames in which inverse
    kinematics may move limbs to the targets of `reaches`, those that only `after` has, are new,
    too. All other frames are those of `before`, bit for bit, except for a root whose donors
    changed; see `splice`.
    """
    cut, is_new = problem.base_segments, np.zeros(before.n_frames, bool)
    blend = int(np.ceil(problem.config.seam_blend * problem.base.rate))
    for own in reaches if problem.config.reach_ik else ():
        first, last = own.frames or (0, before.n_frames)
        is_new[max(first - 2 * blend, 0) : last + 2 * blend + 1] = True
    for position in np.flatnonzero(changed_positions(old, new)).tolist():
        is_new[max(cut.start[position] - blend, 0) : cut.stop[position] + blend + 1] = True
    root = problem.root_group
    moves = root is not None and (old[root] != new[root]).any()
    moving = [problem.library.root] if moves else []
    return splice(before, after, is_new, problem.base_poses.height, moving)


def changed_positions(old: DonorSequences, new: DonorSequences) -> BoolArray:
    """Return a mask of the positions at which the donor of any group differs."""
    return np.any([own != new[group] for group, own in old.items()], axis=0)
