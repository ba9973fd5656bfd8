"""``mograft graft``: new motions on the base group of a captured one."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.arrays import IntArray
from mograft.cli.configuration import flags_in_errors, load_library, with_flags
from mograft.cli.constraints import FLAGS, read_constraints
from mograft.cli.files import check_writable, expand_folders, library_folder
from mograft.cli.graft_files import (
    check_graft_suffix,
    graft_files,
    output_paths,
    with_command,
    write_report,
)
from mograft.cli.output import print_error, print_remark, print_result
from mograft.cli.replay import is_edit, replay_graft
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.frames import Seconds, resolve_frame
from mograft.cli.syntax.options import DEFAULT_DURATION, GraftOptions
from mograft.errors import join_names, suggest_name
from mograft.io.addresses import find_addresses, read_clip, split_address
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.provenance.document import graft_record
from mograft.provenance.writing import write_graft
from mograft.scenario import Scenario, fill, follow, to_beats, transitions, walk
from mograft.scenario.walks import check_duration
from mograft.search.constraints import Constraint
from mograft.solve.plan import grafted_groups
from mograft.synthesis.advice import advise
from mograft.synthesis.graft import graft_many, kept_violations, repair
from mograft.synthesis.graft_result import Graft, Substitution
from mograft.synthesis.newness import newness

_MAX_REPORTED = 20
"""Maximum number of grafts on a report page, and of earlier motions with which one is compared.

All of them are in memory at the same time.
"""

_GRAPH_OPTIONS = ("duration", "frames", "path", "beats", "among")

_KEPT_VIOLATIONS = (
    "joints that are not exchanged violate constraints, and no donor can remove these violations; "
    "no motion was written; move the obstacle or target, limit its frames, or give --best-effort"
)
_ADVISED_OPTIONS = {
    "variety": "--variety",
    "sigma_scale": "--set sigma_scale",
    "max_stretch": "--max-stretch",
    "self_repair=False": "--set self_repair=false",
}
"""The options that set what `advise` names."""


def run(options: GraftOptions) -> int:
    """Run the command."""
    check_graft_suffix(options)
    if options.from_ is not None:
        return _run_replay(options)
    _check_options(options)
    folder = library_folder(options.files)
    library, files = None, options.files
    if folder is not None:
        library = load_library(options)
    else:
        files = tuple(expand_folders(files, include_grafts=options.include_grafts))
    paths, page = output_paths(options, files[0] if library is None else library.names[0])
    written = [*graft_files(paths), *([page] if options.report else [])]
    check_writable(written, force=options.force, inputs=files)
    if options.measure and find_spec("scipy") is None:
        raise ValueError("--measure needs SciPy: pip install 'mograft[evaluate]'")
    if library is None:
        library = load_library(replace(options, files=files))
    constraints = read_constraints(options, library)
    if options.mirror:
        library = library.with_mirror_images()
    base = _find_base(library, options.base, folder)
    with flags_in_errors(swap="--swap", scenario="--scenario", **FLAGS):
        grafted_groups(library, options.swap)
        # The base motion of a scenario does not exist yet.
        if options.scenario == "original" and not options.best_effort:
            kept = kept_violations(library, base, constraints=constraints, swap=options.swap)
            if kept:
                print_error(_KEPT_VIOLATIONS, [violation.message for violation in kept])
                return 4
        grafts = _make_grafts(library, base, constraints, options)
    if constraints:
        grafts = list(grafts)
        if _are_refused(grafts, options):
            return 4  # No donor sequence satisfies the constraints.
    _write_results(grafts, paths, page, options, options.digits)
    return 0


def _check_options(options: GraftOptions) -> None:
    """Raise a UsageError if options without ``--from`` contradict each other."""
    if not options.files:
        raise UsageError("expected LIB or FILE")
    if options.reroll:
        raise UsageError("--reroll requires --from")
    if options.output.suffix.lower() in (".bvh", ".npz") and options.count != 1:
        raise UsageError(f"-o must be a folder if -n is above 1, got {options.output}")
    if options.distinct > 180.0:
        raise UsageError(f"--distinct must be at most 180, got {options.distinct:g}")
    if options.repair and options.count != 1:
        raise UsageError(f"-n must be 1 with --repair, got {options.count}")
    _check_scenario(options)


def _run_replay(options: GraftOptions) -> int:
    """Write the graft of ``--from``, edited if options require it; return the exit code."""
    graft, path, digits = replay_graft(options)
    if is_edit(options) and _are_refused([graft], options):
        return 4  # The edits contradict each other or the constraints of the graft.
    _write_results([graft], [path], path.with_suffix(".html"), options, digits)
    return 0


def _find_base(library: Library, name: str | None, folder: Path | None) -> Motion | str | None:
    """Return the base motion that ``--base`` selects.

    The result is the name of a clip of the library, a motion read from the file `name`, or None
    if `name` is None. `folder` is the folder of a stored library, or None.
    """
    if name is None:
        return None
    names = library.names
    if folder is not None and name in names:
        return name
    if Path(split_address(name)[0]).exists():
        motion = _find_entry(library, name)
        rest = library.spec.rest
        return read_clip(name, skeleton=rest) if motion is None else motion
    files = [Path(entry.source_file.path).name for entry in library.entries if entry.source_file]
    if len(files) == len(names) and files.count(name) == 1:
        return names[files.index(name)]
    if name in names:
        return name
    where = "" if folder is None else f" of {folder}"
    raise ValueError(
        f"--base must be a clip{where}, one of {join_names(names)}, or a file; got {name!r}"
        f"{suggest_name(name, names)}"
    )


def _find_entry(library: Library, address: str) -> str | None:
    """Return the name of the library's clip that was read from `address`, or None."""
    addresses = find_addresses(address)
    if len(addresses) > 1:
        read_clip(address)  # raises an error that lists the clips
    path, clip = split_address(addresses[0])
    for entry in library.entries:
        file = entry.source_file
        if file is None or file.clip != clip:
            continue
        if os.path.realpath(file.path) == os.path.realpath(path):
            return entry.name
    return None


def _check_scenario(options: GraftOptions) -> None:
    """Raise a UsageError if the options of the scenario contradict each other."""
    scenario = options.scenario
    numbers = [word.strip() for word in scenario.split(",")]
    if scenario not in ("original", "graph") and not all(word.isdecimal() for word in numbers):
        raise UsageError(f"--scenario must be original, graph or segment numbers; got {scenario}")
    if scenario != "original" and options.base is not None:
        raise UsageError("--base cannot be combined with --scenario, which creates the base")
    given = [name for name in _GRAPH_OPTIONS if getattr(options, name) is not None]
    if scenario != "graph" and given:
        raise UsageError(f"--{given[0]} requires --scenario graph")
    lengths = [name for name in given if name in ("duration", "frames", "path")]
    if len(lengths) > 1:
        raise UsageError(f"--{lengths[1]} cannot be combined with --{lengths[0]}")
    if "beats" in given and lengths not in ([], ["duration"]):
        raise UsageError(f"--{lengths[0]} cannot be combined with --beats")


def _read_scenario(
    library: Library, options: GraftOptions
) -> Sequence[int] | IntArray | Scenario | None:
    """Return the base segments that ``--scenario`` selects, or None for a captured clip."""
    if options.scenario == "original":
        return None
    if options.scenario != "graph":
        return [int(word) for word in options.scenario.split(",")]
    with flags_in_errors(
        clips="--among", frames="--frames", path="--path", duration="--duration", beats="--beats"
    ):
        return _draw_scenario(library, options)


def _draw_scenario(library: Library, options: GraftOptions) -> Sequence[int] | IntArray | Scenario:
    """Return the base segments of ``--scenario graph``."""
    seed, duration = options.seed or 0, options.duration or DEFAULT_DURATION
    check_duration(duration)
    graph = transitions(library, options.among)
    if options.frames is not None:
        is_time = isinstance(options.frames, Seconds)
        n_frames = resolve_frame(options.frames, library.rate) + is_time
        return fill(library, n_frames, seed, graph=graph)
    if options.path is not None:
        return follow(library, options.path, graph=graph)
    if options.beats is not None:
        if options.beats > 60.0 * library.rate:
            raise ValueError(
                f"--beats must be at most {60.0 * library.rate:.6g} beats per minute, one per "
                f"frame, got {options.beats:g}"
            )
        beats = np.arange(int(duration * options.beats / 60.0) + 1) * (60.0 / options.beats)
        return to_beats(library, beats, seed, graph=graph)
    return walk(library, duration, seed, graph=graph)


def _make_grafts(
    library: Library,
    base: Motion | str | None,
    constraints: Sequence[Constraint],
    options: GraftOptions,
) -> Sequence[Graft]:
    """Return the requested grafts."""
    scenario = _read_scenario(library, options)
    if options.repair:
        return [repair(library, base, constraints=constraints, swap=options.swap)]
    is_fixed = options.variety is not None or any(
        name == "sigma_scale" for name, _ in (*options.set, *options.configured)
    )
    grafts = graft_many(
        library,
        base,
        options.count,
        constraints=constraints,
        swap=options.swap,
        seed=options.seed or 0,
        scenario=scenario,
        widen=not is_fixed,
        distinct=np.radians(options.distinct),
    )
    for note in grafts.notes:
        print_remark(note)
    # The candidates of all segments need not stay in memory for a single graft.
    return [grafts[0]] if len(grafts) == 1 else grafts


def _are_refused(grafts: Sequence[Graft], options: GraftOptions) -> bool:
    """Print the constraints that each graft violates; return whether grafts must not be written.

    They are written in spite of violations with ``--best-effort``.
    """
    violating = [graft for graft in grafts if graft.violations]
    messages = [
        f"{graft.motion.name}: {violation.message}"
        for graft in violating
        for violation in graft.violations
    ]
    counts = f"{len(violating)} of {len(grafts)} motions"
    if violating and options.best_effort:
        warning = f"warning: {counts} violate the constraints; all {len(grafts)} are written"
        print_remark("\n".join([*messages, warning]))
    elif violating:
        print_error(
            f"{counts} violate the constraints, because no donor sequence satisfies them; "
            "no motion was written; --best-effort writes all",
            messages,
        )
    return bool(violating) and not options.best_effort


@dataclass(frozen=True)
class _Output:
    """A graft that was written, or that is written together with others."""

    path: Path
    substitutions: Sequence[Substitution]
    document: dict[str, Any]  # What ``--json`` prints.
    sections: dict[str, Any]  # Additional entries of its .json file.
    columns: dict[str, str] = field(default_factory=dict)  # Measures as text, by name.
    graft: Graft | None = None  # The graft, if the page or a common file needs it later.


def _write_results(
    grafts: Sequence[Graft],
    paths: Sequence[Path],
    page: Path,
    options: GraftOptions,
    digits: int | None,
) -> None:
    """Write grafts and the page that describes them, and print their paths and remarks."""
    paths[0].parent.mkdir(parents=True, exist_ok=True)
    is_together = paths[0].suffix.lower() == ".glb"
    reference, outputs, motions = None, list[_Output](), list[Motion]()
    if options.measure:
        from mograft.evaluation.world_measures import WorldReference  # takes long to import

        reference = WorldReference(grafts[0].library)
    for path, graft in zip(paths, grafts, strict=False):
        new = newness(graft, motions)
        motions = [*motions, graft.motion][-_MAX_REPORTED:] if len(paths) > 1 else []
        lines, sections, columns = [graft.report(each=options.verbose), f"  {new}"], {}, {}
        if reference is not None:
            measures = reference.measure(graft)
            sections, columns = {"quality": measures.as_dict()}, measures.columns()
            lines.append("  " + ", ".join(f"{name} {text}" for name, text in columns.items()))
        own = graft if options.from_ else with_command(graft, options, options.files)
        if not is_together:
            write_graft(own, path, sections, digits=digits)
        document = graft_record(own, path.parent) if options.json else {}
        document = {
            **{"file": str(path), **document, "digits": digits, **sections},
            "newness": new.as_dict(),
        }
        print_remark("\n".join(lines))
        if not options.json and not is_together:
            print(path)
        # Each access to `grafts` builds the graft anew.
        is_shown = options.report and len(outputs) < _MAX_REPORTED
        kept = graft if is_shown or is_together else None
        outputs.append(_Output(path, own.substitutions, document, sections, columns, kept))
    if is_together:
        _write_together(outputs, options)
    _print_remarks(graft, outputs, options)
    result: dict[str, Any] = {"grafts": [output.document for output in outputs]}
    if options.report:
        shown = outputs[:_MAX_REPORTED]
        write_report(
            [output.graft for output in shown if output.graft is not None],
            [output.path for output in shown],
            page,
            [output.columns for output in shown] if options.measure else (),
        )
        result["report"] = str(page)
    print_result(options, "grafts", result, [page] if options.report else [])


def _write_together(outputs: Sequence[_Output], options: GraftOptions) -> None:
    """Write grafts to the .glb file that all of them have as path, and print the path."""
    grafts = [output.graft for output in outputs if output.graft is not None]
    if options.from_ is None:
        grafts = [with_command(graft, options, options.files) for graft in grafts]
    write_graft(grafts, outputs[0].path, [output.sections for output in outputs])
    if not options.json:
        print(outputs[0].path)


def _print_remarks(last: Graft, outputs: Sequence[_Output], options: GraftOptions) -> None:
    """Print how many motions are missing, and what was not exchanged; `last` is one graft."""
    if len(outputs) < options.count:
        apart = f" that are {options.distinct:g}° apart" if options.distinct else ""
        remedies = "more clips or a larger --variety allow more"
        if options.distinct:
            remedies = "a smaller --distinct, more clips or a larger --variety allow more"
        print_remark(
            f"warning: the donors allow only {len(outputs)} different "
            f"motion{'s' * (len(outputs) > 1)}{apart}, not {options.count}; {remedies}"
        )
    for remark in advise(last, [output.substitutions for output in outputs]):
        print_remark(with_flags(remark, _ADVISED_OPTIONS))
