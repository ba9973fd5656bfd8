"""``mograft graft``: new motions on the legs of a captured one."""

import argparse
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mograft._util.registry import CONFIG_OPTIONS
from mograft.cli._common import (
    ENDS,
    PRESETS,
    above_zero,
    add_making,
    at_least_one,
    check_free,
    expanded,
    given,
    library_folder,
    print_json,
    progress,
    say,
    write,
    write_report,
)
from mograft.cli._constraints import add_constraints, constraints
from mograft.errors import join_names

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mograft._util.arrays import IntArray
    from mograft.body.groups import JointGroups
    from mograft.config import Config
    from mograft.library.library import Library
    from mograft.motion.motion import Motion
    from mograft.scenario.walks import Scenario
    from mograft.synthesis.graft import Graft

UNMET = 4
"""Exit code: no choice of donors meets the constraints."""

_REPORTED = 20
"""Grafts that a report tells of: they are made anew for it and held together."""

_WIDEST = 4.0
"""Clusters of four times the spread of all segments hold them all: more changes nothing."""


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    graft = commands.add_parser("graft", help="make new motions on the legs of a captured one")
    graft.add_argument(
        "files",
        nargs="+",
        metavar="LIB|FILE",
        help="a library, or BVH files: where donors come from",
    )
    graft.add_argument(
        "--base", metavar="CLIP|FILE", help="whose base group is kept; default: the first"
    )
    graft.add_argument("--groups", metavar="NAME|FILE", help="default: lower_upper")
    graft.add_argument("--swap", metavar="GROUP,...", help="groups to graft; default: all others")
    graft.add_argument(
        "-n", "--count", type=at_least_one, default=1, help="how many motions (default 1)"
    )
    graft.add_argument("-o", "--output", type=Path, required=True, help="folder, or a .bvh file")
    graft.add_argument("--preset", choices=("default", "paper"))
    graft.add_argument(
        "--mirror", action="store_true", help="donors are also the mirror images of all clips"
    )
    graft.add_argument(
        "--sigma-scale",
        type=above_zero,
        metavar="X",
        help="how unlike the legs may be whose upper bodies are exchanged: smaller is more "
        "natural, larger more varied. Default: 0.75, and as much more as COUNT motions need",
    )
    graft.add_argument(
        "--choice",
        choices=CONFIG_OPTIONS["choice"].names,
        help="how donors are chosen: those of least cost in all (of several motions each keeps "
        "away from the others), the several of least cost, drawn by their cost (default), those "
        "of most similar legs, or by chance as in the paper",
    )
    graft.add_argument(
        "--temperature",
        type=above_zero,
        metavar="X",
        help="with --choice sample: how much dearer than the cheapest a draw may be (default 1)",
    )
    graft.add_argument(
        "--scenario",
        default="original",
        metavar="original|graph|N,...",
        help="what the base group does: a clip as it is (default), a random walk from segment "
        "to segment, or the segments of these numbers one after the other",
    )
    graft.add_argument(
        "--duration", type=float, metavar="S", help="seconds of --scenario graph (default 60)"
    )
    graft.add_argument(
        "--frames", type=int, metavar="N", help="of --scenario graph: exactly so many frames"
    )
    graft.add_argument(
        "--path",
        metavar="X,Z:X,Z:...",
        help="of --scenario graph: along these corners on the floor, in the file's unit (X,Y "
        "where z points up)",
    )
    graft.add_argument(
        "--beats",
        type=float,
        metavar="BPM",
        help="of --scenario graph: come to rest on every beat, so many a minute",
    )
    graft.add_argument(
        "--among", metavar="CLIP,...", help="clips that --scenario graph walks through; globs do"
    )
    graft.add_argument(
        "--seam",
        choices=CONFIG_OPTIONS["seam"].names,
        help="how motions that meet at a seam are made one; default: offset, or the preset's",
    )
    graft.add_argument(
        "--alignment",
        choices=CONFIG_OPTIONS["alignment"].names,
        help="how a donor gets its length: stretched evenly (default), or bent in time so that "
        "its base part does what the segment's does",
    )
    graft.add_argument(
        "--torso",
        choices=CONFIG_OPTIONS["torso"].names,
        help="what a grafted trunk keeps: its angle to the pelvis (default), or how it leans",
    )
    graft.add_argument(
        "--feet",
        choices=CONFIG_OPTIONS["feet"].names,
        help="make feet stand still: auto where the base group does not keep legs and root",
    )
    graft.add_argument("--report", action="store_true", help="also write a page that shows them")
    graft.add_argument("--json", action="store_true", help="the reports as one JSON document")
    add_making(graft)
    told = add_constraints(graft)
    told.add_argument(
        "--repair",
        action="store_true",
        help="keep the captured motion but where it does not meet the constraints",
    )
    told.add_argument(
        "--best-effort",
        action="store_true",
        help="write the best that was found even where constraints are not met, and end with 0",
    )
    graft.set_defaults(run=run, usage=graft.error)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from mograft.library.library import Library
    from mograft.synthesis.graft import graft_many, repair

    folder = library_folder(options)
    files = expanded(options.files) if folder is None else []
    single = options.output.suffix.lower() == ".bvh"
    if single and options.count != 1:
        options.usage("-o must be a folder where -n is not 1")
    library = None if folder is None else opened(folder, options)
    first = files[0] if library is None else library.entries[0].name
    stem = Path(options.base or first).stem
    paths = (
        [options.output]
        if single
        else [options.output / f"{stem}_graft{i}.bvh" for i in range(options.count)]
    )
    _check_scenario(options)
    page = options.output.with_suffix(".html") if single else options.output / "index.html"
    pages = [page] if options.report else []
    check_free([*(p.with_suffix(e) for p in paths for e in ENDS), *pages], force=options.force)
    if options.repair and options.count != 1:
        options.usage("--repair makes one motion: -n must be 1")
    wanted = constraints(options)
    swap = None if options.swap is None else options.swap.split(",")
    if library is None:
        options.groups = options.groups or "lower_upper"
        with progress() as tell:
            library = Library.build(
                files, chosen_groups(options), chosen_config(options), progress=tell
            )
    if given(options, "temperature") and library.config.choice != "sample":
        options.usage(f"--temperature is for --choice sample, got {library.config.choice}")
    if options.mirror:
        library = library.mirrored()
    base = _base(library, options.base, folder)
    many: dict[str, Any] = {"constraints": wanted, "swap": swap, "seed": options.seed}
    many["scenario"] = _scenario(library, options)
    grafts: Sequence[Graft]
    if options.repair:
        grafts = [repair(library, base, constraints=wanted, swap=swap)]
    else:
        grafts = graft_many(library, base, options.count, **many)
    while len(grafts) < options.count and options.sigma_scale is None:
        wider = library.config.sigma_scale * 4 / 3
        if wider > _WIDEST or library.config.sigma not in ("rms", "literal"):
            break
        say(
            f"only {len(grafts)} different motions at sigma_scale "
            f"{library.config.sigma_scale:.3g}: trying {wider:.3g}, which is less strict"
        )
        library = library.relabelled(replace(library.config, sigma_scale=wider))
        grafts = graft_many(library, base, options.count, **many)
    if wanted:
        grafts = list(grafts)
        missed = [graft for graft in grafts if graft.violations]
        for graft in missed:
            for violation in graft.violations:
                say(f"{graft.motion.name}: {violation.message}")
        if missed and not options.best_effort:
            say(
                f"error: no choice of donors meets the constraints in {len(missed)} of "
                f"{len(grafts)} motions; nothing is written without --best-effort"
            )
            return UNMET
    paths[0].parent.mkdir(parents=True, exist_ok=True)
    documents = []
    for path, graft in zip(paths, grafts, strict=False):
        write(graft, path)
        documents.append({"file": str(path), **graft.as_dict()})
        say(graft.report())
        if not options.json:
            print(path)
    if len(documents) < options.count:
        say(
            f"warning: the donors allow only {len(documents)} different motions, "
            f"not {options.count}; more clips or a larger --sigma-scale give more"
        )
    if options.report:
        shown = [grafts[at] for at in range(min(len(grafts), _REPORTED))]
        write_report(shown, paths[: len(shown)], page, show=False)
        if not options.json:
            print(page)
    if options.json:
        told = {"schema": "mograft.grafts/1", "grafts": documents}
        print_json(told | ({"report": str(page)} if options.report else {}))
    return 0


def opened(folder: Path, options: argparse.Namespace) -> "Library":
    """Open a library; what it was made by is settled, but for how it is used."""
    from mograft.library.library import Library

    for name in given(options, "groups", "preset"):
        options.usage(f"--{name} is settled when a library is made: mograft index --{name}")
    library = Library.open(folder)
    return library.relabelled(_changed(library.config, options))


def _base(library: "Library", name: str | None, folder: Path | None) -> "Motion | str | None":
    """Return the clip that was read from a file or has a name, else the file's motion."""
    if name is None:
        return None
    from mograft.io.bvh import read_bvh

    names = [entry.name for entry in library.entries]
    if folder is not None and name in names:
        return name
    there = os.path.realpath(name)
    for entry in library.entries:
        if entry.source_file is not None and os.path.realpath(entry.source_file.path) == there:
            return entry.name
    if not Path(name).exists():
        files = [
            Path(entry.source_file.path).name for entry in library.entries if entry.source_file
        ]
        if len(files) == len(names) and files.count(name) == 1:
            return names[files.index(name)]
        if name in names:
            return name
        where = "" if folder is None else f" of {folder}"
        raise ValueError(
            f"--base must be a clip{where}, one of {join_names(names)}, or a file; got {name!r}"
        )
    return read_bvh(name)


def _check_scenario(options: argparse.Namespace) -> None:
    scenario: str = options.scenario
    numbers = [word.strip() for word in scenario.split(",")]
    if scenario not in ("original", "graph") and not all(word.isdecimal() for word in numbers):
        options.usage(f"--scenario must be original, graph or numbers of segments; got {scenario}")
    if scenario != "original" and options.base is not None:
        options.usage("--base must not be given with --scenario, which is the base itself")
    given = [name for name in _WALKS if getattr(options, name) is not None]
    if scenario != "graph" and given:
        options.usage(f"--{given[0]} is for --scenario graph")
    lengths = [name for name in given if name in ("duration", "frames", "path")]
    if len(lengths) > 1 or ("beats" in given and lengths not in ([], ["duration"])):
        options.usage(f"--{lengths[-1]} must not be given with --{lengths[0]} or --beats")
    for name, unit in (("duration", "seconds"), ("beats", "a minute")):
        value = getattr(options, name)
        if value is not None and not 0 < value < float("inf"):
            options.usage(f"--{name} must be above 0 {unit}; got {value:g}")
    if options.frames is not None and options.frames < 2:
        options.usage(f"--frames must be at least 2; got {options.frames}")
    if options.path is not None:
        _corners(options)


_WALKS = ("duration", "frames", "path", "beats", "among")


def _corners(options: argparse.Namespace) -> list[list[float]]:
    try:
        corners = [[float(word) for word in own.split(",")] for own in options.path.split(":")]
    except ValueError:
        corners = []
    if len(corners) < 2 or any(len(own) != 2 for own in corners):
        options.usage(f"--path must be two corners or more, as 0,0:300,0; got {options.path}")
    return corners


def _scenario(
    library: "Library", options: argparse.Namespace
) -> "Sequence[int] | IntArray | Scenario | None":
    if options.scenario == "original":
        return None
    if options.scenario != "graph":
        return [int(word) for word in options.scenario.split(",")]
    import numpy as np

    from mograft.scenario.walks import fill, follow, to_beats, transitions, walk

    seed, duration = options.seed, options.duration or 60.0
    graph = transitions(library, options.among and options.among.split(","))
    if options.frames is not None:
        return fill(library, options.frames, seed, graph=graph)
    if options.path is not None:
        return follow(library, _corners(options), graph=graph)
    if options.beats is not None:
        beats = np.arange(int(duration * options.beats / 60.0) + 1) * (60.0 / options.beats)
        return to_beats(library, beats, seed, graph=graph)
    return walk(library, duration, seed, graph=graph)


def chosen_groups(options: argparse.Namespace) -> "JointGroups | str":
    """Return the groups that ``--groups`` means."""
    name: str = options.groups
    if name in PRESETS:
        return name
    if Path(name).suffix.lower() != ".toml" and not Path(name).exists():
        options.usage(f"--groups must be a TOML file or one of {', '.join(PRESETS)}; got {name}")
    from mograft.body.groups import JointGroups

    return JointGroups.from_toml(Path(name))


def chosen_config(options: argparse.Namespace) -> "Config":
    """Return the configuration that ``--preset`` and the options of single fields mean."""
    from mograft.config import Config

    return _changed(Config.paper() if options.preset == "paper" else Config(), options)


def _changed(config: "Config", options: argparse.Namespace) -> "Config":
    """Return the configuration with those fields changed for which there are options."""
    names = ("sigma_scale", "choice", "temperature", "seam", "alignment", "torso", "feet")
    given = {name: getattr(options, name, None) for name in names}
    return replace(config, **{name: value for name, value in given.items() if value is not None})
