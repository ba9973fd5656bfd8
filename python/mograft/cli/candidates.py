"""``mograft candidates``: the donors of a segment, and why other segments are refused."""

import argparse
import math
from dataclasses import asdict
from typing import Any

from mograft.cli.configuration import load_library
from mograft.cli.constraints import read_constraints
from mograft.cli.output import print_result
from mograft.errors import join_names
from mograft.library.library import Library
from mograft.search.candidates import Candidate, Candidates
from mograft.search.neighbourhoods import NEIGHBOURHOODS


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    constraints = read_constraints(options)
    library = load_library(options)
    clip, number, segment = _find_segment(library, options)
    others = [name for name in library.groups.names if name != library.groups.base]
    group = options.group or others[0]
    found = library.candidates(segment, group, constraints)
    name = library.entries[clip].name
    frames = [int(library.segments.start[segment]), int(library.segments.stop[segment])]
    document = {
        "clip": name,
        "segment": number,
        "frames": frames,
        "group": group,
        "allowed": [_as_dict(library, candidate) for candidate in found.allowed],
        "refused": [_as_dict(library, candidate) for candidate in found.refused],
        "of_other_clusters": found.elsewhere,
    }
    title = f"{name}, frames {frames[0]} to {frames[1]}: {group} of {len(found)} donors"
    print_result(options, "candidates", document, [title, *_table(library, found)])
    return 0


def _find_segment(library: Library, options: argparse.Namespace) -> tuple[int, int, int]:
    """Return the segment that ``--clip``, ``--segment`` and ``--frame`` select.

    The result holds the index of the clip, the index of the segment within the clip, and the
    index of the segment in the library. Raise ValueError if there is no such segment.
    """
    names = library.names
    if options.clip is not None and options.clip not in names:
        raise ValueError(f"--clip must be one of {join_names(names)}; got {options.clip!r}")
    _, clip = library.resolve_base(options.clip)
    segments = library.segments.of_clip(clip)
    number = options.segment
    if number is None:
        stops = library.segments.stop[segments]
        if options.frame > stops[-1]:
            raise ValueError(
                f"--frame must be 0 to {stops[-1]} in clip {names[clip]}, got {options.frame}"
            )
        number = int((stops < options.frame).sum())
    if number >= len(segments):
        raise ValueError(
            f"--segment must be 0 to {len(segments) - 1} in clip {names[clip]}, got {number}"
        )
    return clip, number, int(segments[number])


def _as_dict(library: Library, candidate: Candidate) -> dict[str, Any]:
    """Return the fields of a candidate as a dict for JSON; NaN becomes None."""
    values = asdict(candidate) | {"clip": library.entries[candidate.clip].name}
    return {
        name: None if isinstance(value, float) and math.isnan(value) else value
        for name, value in values.items()
    }


def _table(library: Library, found: Candidates) -> list[str]:
    candidates = (*found.allowed, *found.refused)
    names = [library.entries[candidate.clip].name for candidate in candidates]
    width = max((len(name) for name in names), default=0)
    lines = []
    for name, candidate in zip(names, candidates, strict=True):
        before, after = math.degrees(candidate.gap_before), math.degrees(candidate.gap_after)
        seams = f"{before:.0f}°/{after:.0f}°"
        mark = "-" if candidate.refused else "+"
        lines.append(
            f" {mark} {name:{width}} {candidate.start:6}-{candidate.stop:<6} "
            f"cost {candidate.cost:7.2f}  stretch {candidate.stretch:.2f}  "
            f"seams {seams:8} {candidate.refused}".rstrip()
        )
    outside = NEIGHBOURHOODS.get(library.config.neighbourhood).outside
    return [*lines, f"   {found.elsewhere} segments are {outside}"]
