"""Edits of a graft: other donors at some base segments, everything else unchanged."""

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import BoolArray
from mograft._util.runs import find_runs
from mograft._util.validate import as_integer
from mograft.blend.splice import splice
from mograft.errors import join_names
from mograft.library.origin import is_partial
from mograft.motion.motion import Motion
from mograft.provenance.edit_positions import (
    Edit,
    GroupPositions,
    check_edits,
    remaining_constraints,
    segment_span,
)
from mograft.search.constraint_records import UnrestoredConstraint
from mograft.search.constraints import Constraint, Span
from mograft.search.donor_constraints import Ban, DonorReference
from mograft.search.trellis import DonorSequences
from mograft.solve.plan import GraftPlan
from mograft.solve.search_problem import SearchProblem, check_constraints, resolve_segments
from mograft.synthesis.graft_building import finish_graft
from mograft.synthesis.graft_result import Graft

_MAX_CHANGES = 20
"""Replaced donors that `describe_changes` lists."""


def edit(
    graft: Graft,
    *edits: Constraint,
    reroll: Sequence[int | tuple[int, int]] = (),
    seed: int | None = None,
) -> Graft:
    """Return the graft with other donors at some segments; all other segments keep theirs.

    Parameters
    ----------
    graft : Graft
        The graft, which does not change.
    *edits : Use, Ban or KeepOriginal
        `Use` sets the donor of a segment, `KeepOriginal` restores the captured motion. `Ban`
        excludes a donor, by default the present one, and the segment gets another. At its
        segments an edit replaces the constraints `Use` and `KeepOriginal` of the graft and of
        earlier edits, and `Use` and `KeepOriginal` also replace earlier bans. Other bans remain
        in force: no ban and no reroll brings an excluded donor back.
    reroll : sequence of int or tuple of int
        Segments to draw again, by their numbers or by ranges of frames. Each gets another donor
        than the present one if it has another candidate.
    seed : int, optional
        Seed of the choice. Default: that of the graft.

    Returns
    -------
    Graft
        Other segments have the same donors. The frames near the changed segments are new. A
        range of new frames ends at least `Config.seam_blend` seconds outside these segments, at
        a frame at which no joint differs by more than 0.0001 radians from the present motion.
        All other frames are the same, bit for bit. If an exchanged group contains the root, the
        later frames of the root are moved rigidly.
        `violations` lists edits and constraints that contradict each other.

    Raises
    ------
    TypeError
        If an edit is of another class.
    ValueError
        If neither an edit nor `reroll` is given; if an edit has a weight; if a segment, donor,
        group or frame does not exist; if the library has only the clips of the graft, because
        `replay` read their files.

    Examples
    --------
    >>> import mograft as mg
    >>> from mograft.dancer import dance
    >>> new = mg.graft(mg.Library.build(dance(strides=1).motion), seed=7)
    >>> edited = mg.edit(new, mg.constraints.KeepOriginal(frames=(60, 90)), reroll=[40])
    >>> (edited.motion.rotations[400:] == new.motion.rotations[400:]).all()
    np.True_
    """
    if is_partial(graft.library):
        raise ValueError("the whole library is needed to replace donors: use replay(path, library)")
    checked = check_edits(edits)
    if not checked and not reroll:
        raise ValueError("an edit or `reroll` must be given, got neither")
    seed = graft.seed if seed is None else as_integer("seed", seed)
    problem = _plan(graft, ()).problem
    groups = list(problem.pools)
    spans = [segment_span("reroll", value, problem.base_segments) for value in reroll]
    rules = _resolve_edits(graft, checked, problem)
    old = list(graft.request.constraints)
    for constraint in old:
        if isinstance(constraint, UnrestoredConstraint):
            warnings.warn(
                f"the constraint {constraint.name!r} is Python code, which the provenance does not "
                "contain: the new donors need not satisfy it",
                stacklevel=2,
            )
    bans = [Ban(frames=span) for span in spans]
    kept = remaining_constraints(old, [*rules, *bans], groups, problem.base_segments)
    plan = _plan(graft, [*kept, *rules])
    rerolled = _reroll_bans(graft, plan.problem, spans)
    n_selected = sum(
        len(list(GroupPositions.of(own, groups, problem.base_segments).items())) for own in bans
    )
    if len(rerolled) < n_selected:
        warnings.warn(
            f"{n_selected - len(rerolled)} of {n_selected} segments of `reroll` have no other "
            "candidate and keep their donors",
            stacklevel=2,
        )
    if rerolled:
        plan = _plan(graft, [*kept, *rules, *rerolled])
    is_open = GroupPositions({group: np.zeros(len(problem.scenario), bool) for group in groups})
    for rule in (*rules, *bans):
        is_open |= GroupPositions.of(rule, groups, problem.base_segments)
    return _choose(graft, plan, is_open, seed)


def describe_changes(graft: Graft, edited: Graft) -> list[str]:
    """Return a line for each donor that `edit` replaced, and one with the changed frames."""
    lines = []
    for group in graft.alternatives:
        pairs = zip(graft.substitutions, edited.substitutions, strict=True)
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
    is_new = (graft.motion.rotations != edited.motion.rotations).any(axis=(1, 2))
    is_new |= (graft.motion.positions != edited.motion.positions).any(axis=(1, 2))
    ranges = [f"{start}-{stop - 1}" for start, stop in find_runs(is_new).tolist()]
    return [*lines, f"new frames: {join_names(ranges) or 'none'}; all others are unchanged"]


def _plan(graft: Graft, constraints: Sequence[Constraint]) -> GraftPlan:
    """Return the plan of a graft with other constraints."""
    library, scenario = graft.library, graft.request.scenario
    groups = list(graft.alternatives)
    if scenario is not None:
        return GraftPlan.build(library, None, groups, constraints, scenario)
    clip = int(library.segments.clip[graft.substitutions[0].segment])
    return GraftPlan.build(library, clip, groups, constraints)


def _resolve_edits(graft: Graft, edits: Sequence[Edit], problem: SearchProblem) -> list[Edit]:
    """Return the edits with frames instead of segment numbers.

    A `Ban` without a donor becomes a ban of the present donor of each of its segments.
    """
    groups = list(problem.pools)
    check_constraints(edits, problem.base_poses)
    rules: list[Edit] = []
    for edit in resolve_segments(edits, groups, problem.base_segments, graft.library):
        assert isinstance(edit, Edit)
        if edit.frames is not None:
            segment_span("frames", edit.frames, problem.base_segments)
        if isinstance(edit, Ban) and edit.donor is None:
            positions = GroupPositions.of(edit, groups, problem.base_segments)
            rules += [_ban_present(graft, problem, *own) for own in positions.items()]
        else:
            rules.append(edit)
    return rules


def _ban_present(graft: Graft, problem: SearchProblem, group: str, position: int) -> Ban:
    """Return the constraint that excludes the present donor of a segment."""
    cut, library = problem.base_segments, graft.library
    span = (int(cut.start[position]), int(cut.stop[position]))
    donor = int(graft.donors[group][position])
    reference: DonorReference | None = None
    if donor != problem.scenario[position]:
        segments = library.segments
        clip = library.entries[segments.clip[donor]].name
        reference = (clip, int(segments.start[donor]), int(segments.stop[donor]))
    return Ban(frames=span, donor=reference, group=group)


def _reroll_bans(graft: Graft, problem: SearchProblem, spans: Sequence[Span]) -> list[Ban]:
    """Return bans of the present donors of the segments in `spans` that have other candidates."""
    donors, bans = graft.donors, {}
    for span in spans:
        selected = GroupPositions.of(Ban(frames=span), list(problem.pools), problem.base_segments)
        for group, position in selected.items():
            candidates = problem.candidates[group][position]
            if (candidates != donors[group][position]).any():
                bans[group, position] = _ban_present(graft, problem, group, position)
    return list(bans.values())


def _choose(graft: Graft, plan: GraftPlan, is_open: GroupPositions, seed: int) -> Graft:
    """Return the graft with donors chosen again at the positions of `is_open` only."""
    before = graft.donors
    candidates = {
        group: [
            own if is_free else np.array([donor])
            for own, is_free, donor in zip(
                lists, is_open.masks[group].tolist(), before[group].tolist(), strict=True
            )
        ]
        for group, lists in plan.problem.candidates.items()
    }
    restricted = replace(plan, problem=replace(plan.problem, candidates=candidates))
    (chosen,) = restricted.choose_donors(1, seed)
    assembly, repairs = restricted.assemble(chosen, graft.motion.name)
    steps = (before, assembly.donors)

    def adjust(motion: Motion) -> Motion:
        return splice_versions(plan.problem, graft.motion, motion, *steps)

    edited = finish_graft(plan.problem, assembly, seed, graft.index, adjust)
    cut, changed = plan.problem.base_segments, changed_positions(*steps)
    frames = [(int(cut.start[p]), int(cut.stop[p])) for p in np.flatnonzero(changed).tolist()]
    old = [own for own in graft.self_repairs if not _touches(own.start, own.stop, frames)]
    new = [own for own in repairs if _touches(own.start, own.stop, frames)]
    return replace(
        edited,
        self_repairs=tuple(sorted([*old, *new], key=lambda own: (own.group, own.start))),
        request=replace(
            graft.request,
            constraints=plan.problem.constraints,
            edit_commands=(*graft.request.edit_commands, None),
        ),
        history=(*graft.history, before),
        completion_history=(*graft.completion_history, graft.reach_completions),
    )


def splice_versions(
    problem: SearchProblem, before: Motion, after: Motion, old: DonorSequences, new: DonorSequences
) -> Motion:
    """Return `before` with frames of `after` near the positions at which `old` and `new` differ.

    `before` and `after` are the motions of the donors `old` and `new`. All other frames are those
    of `before`, bit for bit, except for a root whose donors changed; see `splice`.
    """
    cut, is_new = problem.base_segments, np.zeros(before.n_frames, bool)
    blend = int(np.ceil(problem.config.seam_blend * problem.base.rate))
    for position in np.flatnonzero(changed_positions(old, new)).tolist():
        is_new[max(cut.start[position] - blend, 0) : cut.stop[position] + blend + 1] = True
    root = problem.root_group
    moves = root is not None and (old[root] != new[root]).any()
    moving = [problem.library.root] if moves else []
    return splice(before, after, is_new, problem.base_poses.height, moving)


def changed_positions(old: DonorSequences, new: DonorSequences) -> BoolArray:
    """Return a mask of the positions at which the donor of any group differs."""
    return np.any([own != new[group] for group, own in old.items()], axis=0)


def _touches(start: int, stop: int, frames: Sequence[Span]) -> bool:
    return any(first < stop and last > start for first, last in frames)
