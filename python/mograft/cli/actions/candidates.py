"""``mograft candidates``: the donors of a segment, and why other segments are refused."""

import math
from typing import Any

from mograft import Candidate, Candidates, Library, candidates
from mograft.cli.configuration import load_library, read_constraints
from mograft.cli.files import has_folder
from mograft.cli.output import print_result
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.options import CandidatesOptions
from mograft.cli.syntax.values import resolve_frames
from mograft.errors import suggest_frames
from mograft.search.donor_constraints import limit_config
from mograft.search.neighbourhoods import NEIGHBOURHOODS


def run(options: CandidatesOptions) -> int:
    """Run the command."""
    if (options.segment is None) == (options.frame is None):
        given = "none" if options.frame is None else "both"
        raise UsageError(f"one of --segment and --frame is required, got {given}")
    library = load_library(options, strict=not has_folder(options.files))
    constraints = read_constraints(options, library.rate)
    clip, number, segment = _find_segment(library, options)
    others = [name for name in library.groups.names if name != library.groups.base]
    group = options.group or others[0]
    found = candidates(library, segment, group, constraints)
    name = library.entries[clip].name
    frames = [int(library.segments.start[segment]), int(library.segments.stop[segment])]
    config = limit_config(library.config, constraints)
    document = {"clip": name, "segment": number, "index": segment, "frames": frames, "group": group}
    angle = math.degrees(config.max_angle)
    document |= {"max_angle_degrees": round(angle, 4), "max_stretch": config.max_stretch}
    for key in ("allowed", "refused"):
        document[key] = [_as_dict(library, candidate) for candidate in getattr(found, key)]
    document["of_other_clusters"] = found.elsewhere
    n_donors = sum(own.segment != segment for own in found.allowed)
    title = (
        f"{name}, segment {number}, frames {frames[0]} to {frames[1]}: {group} of "
        f"{n_donors} other {'segment' if n_donors == 1 else 'segments'}"
    )
    limits = f"   limits: stretch {config.max_stretch:.2f}, seam angle {angle:.0f}°"
    lines = [title, *_table(library, found, segment), limits]
    print_result(options, "candidates/2", document, lines)
    return 0


def _find_segment(library: Library, options: CandidatesOptions) -> tuple[int, int, int]:
    """Return the segment that ``--clip``, ``--segment`` and ``--frame`` select.

    The result holds the index of the clip, the index of the segment within the clip, and the
    index of the segment in the library. Raise ValueError if there is no such segment.
    """
    _, clip = library.resolve_base(options.clip)
    segments = library.segments.of_clip(clip)
    number = options.segment
    if number is None:
        assert options.frame is not None
        stops = library.segments.stop[segments]
        frame = resolve_frames(options.frame, library.rate)
        if frame > stops[-1]:
            where = f"{stops[-1]} ({stops[-1] / library.rate:.6g} s) in {library.names[clip]}"
            hint = suggest_frames((frame, frame), int(stops[-1]))
            raise ValueError(f"--frame must be 0 to {where}, {hint}")
        # Two segments share a frame; as on pages, it belongs to the later one.
        number = int((library.segments.start[segments] <= frame).sum()) - 1
    if number >= len(segments):
        name = library.names[clip]
        raise ValueError(f"--segment must be 0 to {len(segments) - 1} in clip {name}, got {number}")
    return clip, number, int(segments[number])


def _as_dict(library: Library, candidate: Candidate) -> dict[str, Any]:
    """Return a candidate as a dict for JSON."""
    gaps = (candidate.gap_before, candidate.gap_after)
    first = int(library.segments.of_clip(candidate.clip)[0])
    place = {"clip": library.entries[candidate.clip].name, "segment": candidate.segment - first}
    place |= {"index": candidate.segment, "frames": [candidate.start, candidate.stop]}
    costs: dict[str, Any] = {"cost": candidate.cost, "stretch": candidate.stretch}
    costs["gaps_degrees"] = [round(math.degrees(gap), 4) for gap in gaps]
    costs["distance"] = None if math.isnan(candidate.distance) else candidate.distance
    return {**place, **costs, "refused": candidate.refused, "is_forced": candidate.is_forced}


def _table(library: Library, found: Candidates, segment: int) -> list[str]:
    """Return one line for each candidate, and one with the number of all other segments.

    ``=`` marks the base segment itself, ``+`` an allowed, ``*`` a forced and ``-`` a refused
    candidate.
    """
    candidates = (*found.allowed, *found.refused)
    names = [library.entries[candidate.clip].name for candidate in candidates]
    width = max((len(name) for name in names), default=0)
    lines = []
    for name, candidate in zip(names, candidates, strict=True):
        before, after = math.degrees(candidate.gap_before), math.degrees(candidate.gap_after)
        seams = f"{before:.0f}°/{after:.0f}°"
        mark = "-" if candidate.refused else "=" if candidate.segment == segment else "+"
        note = candidate.refused
        if candidate.is_forced and not candidate.refused:
            mark, note = "*", "forced"
        lines.append(
            f" {mark} {name:{width}} {candidate.start:6}-{candidate.stop:<6} "
            f"cost {candidate.cost:7.2f}  stretch {candidate.stretch:.2f}  "
            f"seams {seams:8} {note}".rstrip()
        )
    outside = NEIGHBOURHOODS[library.config.neighbourhood].outside
    return [*lines, f"   {found.elsewhere} segments are {outside}"]
