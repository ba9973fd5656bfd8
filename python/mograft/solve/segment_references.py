"""Base segments and donors that constraints give by number, or by their first and last frame."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import IntArray
from mograft.errors import join_names, suggest_name
from mograft.library.library import Library
from mograft.motion.segments import Segments
from mograft.search.constraints import Constraint, Span, overlaps
from mograft.search.donor_constraints import Ban, DonorReference, Use

_N_NEAREST = 3  # segments that a message suggests


def check_groups(constraints: Sequence[Constraint], groups: Sequence[str]) -> None:
    """Raise ValueError if a constraint names a joint group that is not exchanged."""
    for constraint in constraints:
        group = getattr(constraint, "group", None)
        if group is not None and group not in groups:
            raise ValueError(
                f"`group` of {type(constraint).__name__} must be an exchanged group, one of "
                f"{join_names(groups)}; got {group!r}{suggest_name(group, groups)}"
            )


def resolve_segments(
    constraints: Sequence[Constraint], base_segments: Segments, library: Library
) -> list[Constraint]:
    """Replace the segment numbers in `Use` and `Ban` constraints by frames.

    Raise ValueError for a segment or a clip that does not exist.
    """
    return [
        replace(
            constraint,
            segment=None,
            frames=_base_frames(constraint, base_segments),
            donor=_donor_frames(constraint, library),
        )
        if isinstance(constraint, Use | Ban)
        else constraint
        for constraint in constraints
    ]


def used_donors(
    constraints: Sequence[Constraint], base_segments: Segments, library: Library
) -> list[IntArray]:
    """Return for each position the donors that `Use` constraints name, ascending.

    The constraints are results of `resolve_segments`.
    """
    lists = [np.zeros(0, np.int64)] * len(base_segments)
    for constraint in constraints:
        if isinstance(constraint, Use):
            errors = constraint.donor_errors(library.segments, library.segments, library.entries)
            for position in np.flatnonzero(overlaps(base_segments, constraint.frames)).tolist():
                lists[position] = np.union1d(lists[position], np.flatnonzero(errors == 0.0))
    return lists


def _base_frames(constraint: Use | Ban, segments: Segments) -> Span:
    """Return the first and last frame of the base segments to which a constraint applies."""
    name, number = type(constraint).__name__, constraint.segment
    if number is not None:
        if number >= len(segments):
            raise ValueError(f"`segment` of {name} must be 0 to {len(segments) - 1}, got {number}")
        return int(segments.start[number]), int(segments.stop[number])
    assert constraint.frames is not None
    if isinstance(constraint, Use):
        _check_segment(f"`frames` of {name}", "the base", constraint.frames, segments)
    return constraint.frames


def _donor_frames(constraint: Use | Ban, library: Library) -> DonorReference | None:
    """Return the donor as clip, first and last frame; a clip name alone or None is unchanged."""
    name, donor, segments = type(constraint).__name__, constraint.donor, library.segments
    clips = library.names
    if donor is None:
        return None
    if isinstance(donor, int):
        if donor >= len(segments):
            raise ValueError(f"`donor` of {name} must be 0 to {len(segments) - 1}, got {donor}")
        clip = clips[segments.clip[donor]]
        return clip, int(segments.start[donor]), int(segments.stop[donor])
    clip = donor if isinstance(donor, str) else donor[0]
    if clip not in clips:
        raise ValueError(
            f"`donor` of {name} must be from a clip among {join_names(clips)}; "
            f"got {clip!r}{suggest_name(clip, clips)}"
        )
    if isinstance(donor, tuple):
        own = segments[segments.of_clip(clips.index(clip))]
        span = donor[1:]
        if isinstance(constraint, Use) or not overlaps(own, span).any():
            _check_segment(f"`donor` of {name}", clip, span, own)
    return donor


def _check_segment(subject: str, clip: str, frames: Span, segments: Segments) -> None:
    """Raise ValueError unless `frames` are the first and last frame of one of `segments`."""
    distances = np.abs(segments.start - frames[0]) + np.abs(segments.stop - frames[1])
    if not (distances == 0).any():
        nearest = np.argsort(distances, kind="stable")[:_N_NEAREST].tolist()
        listed = ", ".join(f"{segments.start[i]}-{segments.stop[i]} (segment {i})" for i in nearest)
        raise ValueError(
            f"{subject} must be a segment of {clip}, got {frames[0]}-{frames[1]}; "
            f"the nearest {'are' if len(nearest) > 1 else 'is'} {listed}"
        )
