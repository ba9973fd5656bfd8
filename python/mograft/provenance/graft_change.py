"""Changes of a graft: another part of a clip for a group, from one frame to another."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import islice
from math import ceil

from mograft._util.names import find_matches
from mograft._util.validate import as_integer
from mograft.errors import suggest_frames
from mograft.library.library import Library
from mograft.library.origin import is_partial
from mograft.search.constraints import Constraint, Span, as_span, find_violations, overlaps
from mograft.solve.donor_spans import (
    MAX_RATIO,
    ChangedPart,
    DonorSpan,
    find_donor_spans,
    insert_span,
)
from mograft.solve.finish import find_motion_violations
from mograft.solve.plan import GraftPlan
from mograft.solve.search_problem import SearchProblem
from mograft.synthesis.graft_result import Change, Graft

_MAX_TRIALS = 32  # spans whose motions are tested for constraints on poses


def change(
    graft: Graft,
    group: str,
    frames: tuple[int, int],
    donor: str | tuple[str, int, int] | None = None,
    *,
    constraints: Sequence[Constraint] = (),
    rank: int = 0,
) -> Graft:
    """Return `graft` with the motion of a part of a clip for one group, in a range of frames.

    Range and part begin and end at any frame, also inside of segments. The part is stretched to
    the length of the range, and the seams at both ends are closed within the range. In a loop, a
    part of a named clip holds to the first and last frame, and the loop stays open if its ends then
    differ; without `donor`, or with ``Config(loop="on")``, the loop is closed.

    Parameters
    ----------
    graft : Graft
        The graft, which does not change.
    group : str
        The exchanged group that changes, or a body part within one: ``"torso"``, ``"head"``,
        ``"arms"``, ``"larm"``, ``"rarm"`` or another group of the presets of `JointGroups`.
    frames : tuple of int
        First and last frame of the range, both included.
    donor : str or tuple of (str, int, int), optional
        The clip of the donor, or a pattern such as ``"wave*"`` for several; or a clip with its
        first and last frame. Default: all clips, without parts in which the group moves as now;
        parts that differ by 15 degrees or more from the present one come first, and of these, the
        parts of clips that have no donor in the range.
    constraints : sequence of Constraint, optional
        Further constraints. Those on donors limit the parts that are compared. Of these parts, the
        first that satisfies all hard constraints on poses, of `graft` and here, is taken, or
        else the one with the smallest violation.
    rank : int
        0 for the part with the lowest cost, 1 for the next best, and so on. Without effect if
        `donor` has frames.

    Returns
    -------
    Graft
        Frames outside the range are the same, bit for bit. If the group contains the root, the
        later frames of the root are moved rigidly. `Graft.changes` lists the parts; `edit` keeps
        those at whose segments it changes nothing.

    Raises
    ------
    ValueError
        If a group, frame or clip does not exist, if a part is more than three times as long or as
        short as the range, or if no part of the clips satisfies the constraints on donors; if the
        library has only the clips of the graft, because `replay` read their files.

    Examples
    --------
    >>> import mograft as mg
    >>> from mograft.dancer import dance
    >>> new = mg.graft(mg.Library.build(dance(strides=2).motion), seed=7)
    >>> waved = mg.change(new, "upper", (100, 160), ("dance", 400, 455))
    >>> print(waved.changes[0])
    upper, frames 100-160: dance 400-455
    >>> (waved.motion.rotations[161:] == new.motion.rotations[161:]).all()
    np.True_
    """
    source, span = unchanged(graft), as_span("frames", frames)
    problem = plan_of(source, (*graft.request.constraints, *constraints)).problem
    part = ChangedPart.find(problem, group)
    if not span[0] < span[1] < graft.motion.n_frames:
        raise ValueError(
            f"`frames` must be at least two frames from 0 to {graft.motion.n_frames - 1}, "
            f"{suggest_frames(span, graft.motion.n_frames - 1, 1)}"
        )
    found = _choose(problem, graft, part, span, donor, as_integer("rank", rank))
    made = Change(
        group=part.group,
        part=None if part.group == group else group,
        frames=span,
        clip=problem.library.entries[found.clip].name,
        clip_frames=(found.start, found.stop),
        is_held=found.is_held,
    )
    source = replace(source, request=replace(graft.request, constraints=problem.constraints))
    return apply_changes(source, problem, (*graft.changes, made))


def is_among(own: Constraint, constraints: Iterable[Constraint]) -> bool:
    """Return whether a constraint is one of `constraints`, not only equal to one."""
    return any(own is each for each in constraints)


def unchanged(graft: Graft) -> Graft:
    """Return a graft without its changes, with the same request.

    Raise ValueError if the library has only the clips of the graft.
    """
    if is_partial(graft.library):
        raise ValueError("the whole library is needed to find donors: use replay(path, library)")
    return graft if graft.unchanged is None else replace(graft.unchanged, request=graft.request)


def apply_changes(graft: Graft, problem: SearchProblem, changes: Sequence[Change]) -> Graft:
    """Return a graft, which has no changes, with `changes`, one after the other."""
    if not changes:
        return graft
    motion, names = graft.motion, problem.library.names
    for own in changes:
        span = DonorSpan(names.index(own.clip), *own.clip_frames, is_held=own.is_held)
        part = ChangedPart.find(problem, own.part or own.group)
        motion = insert_span(problem, motion, part, own.frames, span)
    return replace(
        graft,
        motion=motion,
        violations=tuple(find_motion_violations(problem, motion, graft.donors)),
        changes=tuple(changes),
        unchanged=graft,
    )


def plan_of(graft: Graft, constraints: Sequence[Constraint]) -> GraftPlan:
    """Return the plan of a graft with other constraints."""
    library, scenario = graft.library, graft.request.scenario
    first = graft.substitutions[0].segment
    base = int(library.segments.clip[first]) if scenario is None else None
    return GraftPlan.build(library, base, list(graft.alternatives), constraints, scenario)


def _choose(
    problem: SearchProblem,
    graft: Graft,
    part: ChangedPart,
    frames: Span,
    donor: str | tuple[str, int, int] | None,
    rank: int,
) -> DonorSpan:
    """Return the span that `change` takes."""
    library, motion, within = problem.library, graft.motion, None
    if isinstance(donor, tuple):
        return _exact_span(library, frames, donor)
    if donor is not None:
        within = find_matches("donor", donor, library.names)
    present = _clips_in_use(graft, problem, part.group, frames) if donor is None else ()
    hard = [own for own in problem.pose_constraints if own.is_hard]
    found = find_donor_spans(problem, motion, part, frames, within, present)
    spans = list(islice(found, rank + (_MAX_TRIALS if hard else 1)))
    if len(spans) <= rank:
        n, what = frames[1] - frames[0], "all clips" if donor is None else repr(donor)
        others = f"only {len(spans)} parts" if spans else "no part"
        raise ValueError(
            f"{others} of {what} can replace {part.group} in frames {frames[0]}-{frames[1]}: "
            f"expected a part of {n / MAX_RATIO:.0f} to {n * MAX_RATIO:.0f} frames without "
            "recording faults that satisfies the constraints on donors"
        )
    if not hard:
        return spans[rank]
    errors: list[tuple[float, int]] = []
    for number, span in enumerate(spans):
        trial = insert_span(problem, motion, part, frames, span)
        violations = find_violations(hard, problem.poses_of(trial))
        errors.append((sum(own.error for own in violations), number))
        if sum(not error for error, _ in errors) > rank:
            break
    return spans[sorted(errors)[rank][1]]


def _clips_in_use(graft: Graft, problem: SearchProblem, group: str, frames: Span) -> set[int]:
    """Return the clips from which a graft has a group in a range of frames."""
    segments, names = problem.library.segments, problem.library.names
    own = [own for own in graft.changes if own.group == group]
    changed = [c for c in own if c.frames[0] < frames[1] and c.frames[1] > frames[0]]
    donors = graft.donors[group][overlaps(problem.base_segments, frames)]
    return {*segments.clip[donors].tolist(), *(names.index(own.clip) for own in changed)}


def _exact_span(library: Library, frames: Span, donor: tuple[str, int, int]) -> DonorSpan:
    """Return the span of `donor`, a clip with its first and last frame."""
    clip = find_matches("donor", donor[0], library.names)[0]
    first, last = as_span("donor", donor[1:])
    n_frames = library.clips[clip].n_frames
    if not first < last < n_frames:
        shortest = max(1, ceil((frames[1] - frames[0]) / MAX_RATIO))
        raise ValueError(
            f"`donor` must be at least two frames from 0 to {n_frames - 1} of {donor[0]}, "
            f"{suggest_frames((first, last), n_frames - 1, shortest)}"
        )
    ratio = (last - first) / (frames[1] - frames[0])
    if not 1 / MAX_RATIO <= ratio <= MAX_RATIO:
        raise ValueError(
            f"`donor` must be at most {MAX_RATIO:g} times as long or as short as the range "
            f"{frames[0]}-{frames[1]}, got {first}-{last}"
        )
    return DonorSpan(clip, first, last, is_held=True)
