"""``mograft candidates``: who may lend a segment its part, and why the rest may not."""

import argparse
import math
from typing import Any

from mograft.cli._common import expanded, given, library_folder, print_json, progress, whole
from mograft.cli._constraints import add_constraints, constraints
from mograft.cli.graft import chosen_groups
from mograft.errors import join_names


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    parser = commands.add_parser(
        "candidates", help="who may lend a segment its part, and why the rest may not"
    )
    parser.add_argument("files", nargs="+", metavar="FILE", help="BVH files, or a library")
    parser.add_argument("--clip", metavar="NAME", help="the segment's clip; default: the first")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--segment", type=whole, metavar="N", help="its number in the clip, from 0")
    where.add_argument("--frame", type=whole, metavar="N", help="or a frame that it holds")
    parser.add_argument("--groups", metavar="NAME|FILE", help="default: lower_upper")
    parser.add_argument("--group", metavar="GROUP", help="the group to graft; default: the first")
    parser.add_argument("--json", action="store_true", help="all of it as a JSON document")
    add_constraints(parser)
    parser.set_defaults(run=run, usage=parser.error)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dataclasses import asdict

    from mograft.library.library import Library

    wanted = constraints(options)
    folder = library_folder(options)
    if folder is not None:
        if given(options, "groups"):
            options.usage("--groups is settled when a library is made")
        library = Library.open(folder)
    else:
        options.groups = options.groups or "lower_upper"
        with progress() as tell:
            files = expanded(options.files)
            library = Library.build(files, chosen_groups(options), progress=tell)
    names = [entry.name for entry in library.entries]
    if options.clip is not None and options.clip not in names:
        raise ValueError(f"--clip must be one of {join_names(names)}; got {options.clip!r}")
    _, clip = library.resolve_base(options.clip)
    own = library.segments.of_clip(clip)
    if options.segment is not None:
        if options.segment >= len(own):
            raise ValueError(f"--segment must be 0 to {len(own) - 1}, got {options.segment}")
        segment = int(own[options.segment])
    else:
        stops = library.segments.stop[own]
        if options.frame > stops[-1]:
            raise ValueError(f"--frame must be 0 to {stops[-1]}, got {options.frame}")
        segment = int(own[(stops < options.frame).sum()])
    others = [name for name in library.groups.names if name != library.groups.base]
    group = options.group or others[0]
    found = library.candidates(segment, group, wanted)
    start, stop = int(library.segments.start[segment]), int(library.segments.stop[segment])

    def row(candidate: Any) -> dict[str, Any]:  # noqa: ANN401 - a Candidate
        plain = asdict(candidate)
        plain["clip"] = names[candidate.clip]
        return {
            name: None if isinstance(value, float) and math.isnan(value) else value
            for name, value in plain.items()
        }

    if options.json:
        print_json(
            {
                "schema": "mograft.candidates/1",
                "clip": names[clip],
                "segment": segment - int(own[0]),
                "frames": [start, stop],
                "group": group,
                "allowed": [row(c) for c in found.allowed],
                "refused": [row(c) for c in found.refused],
                "of_other_clusters": found.elsewhere,
            }
        )
        return 0
    print(f"{names[clip]}, frames {start} to {stop}: {group} of {len(found)} donors")
    shown = (*found.allowed, *found.refused)
    width = max((len(names[candidate.clip]) for candidate in shown), default=0)
    for candidate in shown:
        place = f"{names[candidate.clip]:{width}} {candidate.start:6}-{candidate.stop:<6}"
        seams = "/".join(
            f"{math.degrees(gap):.0f}°" for gap in (candidate.gap_before, candidate.gap_after)
        )
        mark = "-" if candidate.refused else "+"
        print(
            f" {mark} {place} cost {candidate.cost:7.2f}  stretch {candidate.stretch:.2f}  "
            f"seams {seams:8} {candidate.refused}".rstrip()
        )
    print(f"   {found.elsewhere} segments are of other clusters")
    return 0
