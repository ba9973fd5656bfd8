"""The base segments that edits of a graft select, and what remains of earlier constraints there."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mograft._util.arrays import BoolArray
from mograft._util.runs import find_runs
from mograft._util.validate import as_integer, is_integer
from mograft.motion.segments import Segments
from mograft.search.constraints import Constraint, Span, as_span, overlaps
from mograft.search.donor_constraints import Ban, KeepOriginal, Use

Edit = Use | Ban | KeepOriginal


def check_edits(edits: Sequence[object]) -> list[Edit]:
    """Return edits after checking their types."""
    checked: list[Edit] = []
    for edit in edits:
        if not isinstance(edit, Use | Ban | KeepOriginal):
            raise TypeError(f"edits must be Use, Ban or KeepOriginal, got {edit!r}")
        if not edit.is_hard:
            raise ValueError(f"edits must be hard constraints, got weight {edit.weight}")
        checked.append(edit)
    return checked


def segment_span(name: str, value: object, segments: Segments) -> Span:
    """Return the frames of the base segment with the number `value`; a range is returned as it is.

    Raise ValueError if there is no such segment, or if no segment overlaps the range.
    """
    if is_integer(value):
        number = as_integer(name, value)
        if number >= len(segments):
            raise ValueError(
                f"`{name}` must be a segment number from 0 to {len(segments) - 1}, got {number}"
            )
        return int(segments.start[number]), int(segments.stop[number])
    span = as_span(name, value)
    if not overlaps(segments, span).any():
        raise ValueError(
            f"`{name}` must select a segment in frames 0 to {segments.stop[-1]}, "
            f"got {span[0]}-{span[1]}"
        )
    return span


@dataclass(frozen=True, eq=False)
class GroupPositions:
    """The positions of base segments that a constraint selects, by joint group."""

    masks: Mapping[str, BoolArray]

    @classmethod
    def of(
        cls, constraint: Constraint, groups: Sequence[str], segments: Segments
    ) -> "GroupPositions":
        """Return the positions in the frames of a constraint."""
        selected = overlaps(segments, constraint.frames)
        none = np.zeros(len(segments), bool)
        return cls(
            {
                group: selected.copy() if constraint.applies_to_group(group) else none.copy()
                for group in groups
            }
        )

    def __or__(self, other: "GroupPositions") -> "GroupPositions":
        return GroupPositions(
            {group: own | other.masks[group] for group, own in self.masks.items()}
        )

    def items(self) -> Iterator[tuple[str, int]]:
        """Iterate over groups and positions."""
        for group, mask in self.masks.items():
            yield from ((group, position) for position in np.flatnonzero(mask).tolist())


def remaining_constraints(
    constraints: Sequence[Constraint],
    edits: Sequence[Edit],
    groups: Sequence[str],
    segments: Segments,
) -> list[Constraint]:
    """Return the constraints that remain after edits.

    At the segments of an edit, earlier hard `Use` and `KeepOriginal` no longer apply; at those of
    a `Use` or `KeepOriginal` edit, earlier hard `Ban` no longer apply either.
    """
    nothing = GroupPositions({group: np.zeros(len(segments), bool) for group in groups})
    fixing, all_edits = nothing, nothing
    for edit in edits:
        own = GroupPositions.of(edit, groups, segments)
        all_edits |= own
        if not isinstance(edit, Ban):
            fixing |= own
    kept: list[Constraint] = []
    for constraint in constraints:
        if isinstance(constraint, Use | Ban | KeepOriginal) and constraint.is_hard:
            removed = fixing if isinstance(constraint, Ban) else all_edits
            kept += _without(constraint, removed, groups, segments)
        else:
            kept.append(constraint)
    return kept


def _without(
    constraint: Edit, removed: GroupPositions, groups: Sequence[str], segments: Segments
) -> list[Constraint]:
    """Return a constraint except at the positions `removed`, split into several if necessary."""
    selected = GroupPositions.of(constraint, groups, segments)
    masks = {group: own & ~removed.masks[group] for group, own in selected.masks.items()}
    if all((masks[group] == own).all() for group, own in selected.masks.items()):
        return [constraint]
    parts: list[Constraint] = []
    for group, mask in masks.items():
        for start, stop in find_runs(mask).tolist():
            span = (int(segments.start[start]), int(segments.stop[stop - 1]))
            parts.append(replace(constraint, frames=span, group=group))
    return parts
