"""``mograft graft``: new motions on the base group of a captured one."""

import argparse
import os
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from mograft.cli.configuration import flags_in_errors, load_library, options_given, with_flags
from mograft.cli.constraints import check_frames, read_constraints, read_obstacles
from mograft.cli.files import check_writable, expand_folders, library_folder
from mograft.cli.graft_outputs import check_graft_suffix, graft_files, output_paths
from mograft.cli.output import print_error, print_remark, print_result
from mograft.cli.replayed import is_edit, replay_graft
from mograft.cli.results import with_command, write_report
from mograft.cli.scenario import check_scenario, read_scenario
from mograft.config import Config
from mograft.errors import join_names, suggest_name
from mograft.io.addresses import find_addresses, read_clip, split_address
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.provenance.document import graft_record
from mograft.provenance.graft_files import write_graft
from mograft.search.constraints import Constraint
from mograft.synthesis.advice import advise
from mograft.synthesis.graft import graft_many, kept_violations, repair
from mograft.synthesis.graft_plan import grafted_groups
from mograft.synthesis.graft_result import Graft

_MAX_REPORTED = 20
"""Maximum number of grafts on a report page: all of them are in memory at the same time."""

_KEPT_VIOLATIONS = (
    "joints that are not exchanged violate constraints, and no donor can remove these violations; "
    "no motion was written; move the obstacle or target, limit its frames, or give --best-effort"
)
_ADVISED_OPTIONS = {
    "variety": "--variety",
    "sigma_scale": "--sigma-scale",
    "max_stretch": "--max-stretch",
    "self_repair=False": "--no-self-repair",
}
"""The options that set what `advise` names."""


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    check_graft_suffix(options)
    if getattr(options, "from") is not None:
        return _run_replay(options)
    if not options.files:
        options.usage_error("expected LIB or FILE")
    if options.reroll:
        options.usage_error("--reroll requires --from")
    options.sources = list(options.files)  # `options.files` is expanded below
    if options.output.suffix.lower() in (".bvh", ".npz") and options.count != 1:
        options.usage_error(f"-o must be a folder if -n is above 1, got {options.output}")
    if options.repair and options.count != 1:
        options.usage_error(f"-n must be 1 with --repair, got {options.count}")
    check_scenario(options)
    folder = library_folder(options)
    library = None if folder is None else load_library(options)
    if library is None:
        options.files = expand_folders(options.files, include_grafts=options.include_grafts)
    first = options.files[0] if library is None else library.entries[0].name
    paths, page = output_paths(options, first)
    files = graft_files(paths)
    written = [*files, page] if options.report else files
    check_writable(written, force=options.force, inputs=options.files)
    if options.measure and find_spec("scipy") is None:
        raise ValueError("--measure needs SciPy: pip install 'mograft[evaluate]'")
    obstacles = read_obstacles(options)
    if library is None:
        library = load_library(options)
    constraints = read_constraints(options, library, obstacles)
    if options_given(options, "temperature") and library.config.choice != "sample":
        options.usage_error(f"--temperature requires --choice sample, got {library.config.choice}")
    _check_diversity(options, library.config)
    if options.mirror:
        library = library.with_mirror_images()
    base, swap = _find_base(library, options.base, folder), _swapped_groups(library, options)
    if options.scenario == "original":
        check_frames(options, library.rate, _count_frames(library, base))
    # The base motion of a scenario does not exist yet.
    if not options.best_effort and options.scenario == "original":
        kept = kept_violations(library, base, constraints=constraints, swap=swap)
        if kept:
            print_error(_KEPT_VIOLATIONS, [violation.message for violation in kept])
            return 4
    grafts = _make_grafts(library, base, constraints, swap, options)
    if constraints:
        grafts = list(grafts)
        best_effort = options.best_effort
        if _print_violations(grafts, best_effort=best_effort) and not best_effort:
            return 4  # No donor sequence satisfies the constraints.
    _write_results(grafts, paths, page, options)
    return 0


def _check_diversity(options: argparse.Namespace, config: Config) -> None:
    """End with a usage error if ``--diversity`` on the command line has no effect."""
    if not options_given(options, "diversity"):
        return
    if options.count == 1:
        options.usage_error("--diversity requires -n above 1")
    if config.choice not in ("sample", "viterbi", "nearest"):
        options.usage_error(
            f"--diversity requires --choice sample, viterbi or nearest, got {config.choice}"
        )


def _run_replay(options: argparse.Namespace) -> int:
    """Write the graft of ``--from``, edited if options require it; return the exit code."""
    graft, path = replay_graft(options)
    if is_edit(options):
        best_effort = options.best_effort
        if _print_violations([graft], best_effort=best_effort) and not best_effort:
            return 4  # The edits contradict each other or the constraints of the graft.
    _write_results([graft], [path], path.with_suffix(".html"), options)
    return 0


def _write_results(
    grafts: Sequence[Graft], paths: Sequence[Path], page: Path, options: argparse.Namespace
) -> None:
    """Write grafts and the page that describes them, and print their paths."""
    documents, columns, reported = _write_grafts(grafts, paths, options)
    document: dict[str, Any] = {"grafts": documents}
    if options.report:
        write_report(reported, paths[: len(reported)], page, columns[: len(reported)])
        document["report"] = str(page)
    print_result(options, "grafts", document, [page] if options.report else [])


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


def _count_frames(library: Library, base: Motion | str | None) -> int:
    """Return the number of frames of a base motion at the rate of the library."""
    if isinstance(base, Motion):
        return round(base.duration * library.rate) + 1
    return library.entries[0 if base is None else library.names.index(base)].n_frames


def _swapped_groups(library: Library, options: argparse.Namespace) -> list[str] | None:
    """Return the groups that ``--swap`` names, or None; raise ValueError if one is unknown."""
    if options.swap is None:
        return None
    names: list[str] = options.swap.split(",")
    with flags_in_errors(swap="--swap"):
        grafted_groups(library, names)
    return names


def _make_grafts(
    library: Library,
    base: Motion | str | None,
    constraints: Sequence[Constraint],
    swap: list[str] | None,
    options: argparse.Namespace,
) -> Sequence[Graft]:
    """Return the requested grafts."""
    scenario = read_scenario(library, options)
    if options.repair:
        return [repair(library, base, constraints=constraints, swap=swap)]
    with flags_in_errors(scenario="--scenario"):
        grafts = graft_many(
            library,
            base,
            options.count,
            constraints=constraints,
            swap=swap,
            seed=options.seed or 0,
            scenario=scenario,
            widen=options.sigma_scale is None and options.variety is None,
        )
    for note in grafts.notes:
        print_remark(note)
    # The candidates of all segments need not stay in memory for a single graft.
    return [grafts[0]] if len(grafts) == 1 else grafts


def _print_violations(grafts: Sequence[Graft], *, best_effort: bool) -> bool:
    """Print the constraints that each graft violates; return whether there are any.

    The last line states whether the grafts are written. They are written if `best_effort` is true.
    """
    violating = [graft for graft in grafts if graft.violations]
    messages = [
        f"{graft.motion.name}: {violation.message}"
        for graft in violating
        for violation in graft.violations
    ]
    counts = f"{len(violating)} of {len(grafts)} motions"
    if violating and best_effort:
        warning = f"warning: {counts} violate the constraints; all {len(grafts)} are written"
        print_remark("\n".join([*messages, warning]))
    elif violating:
        print_error(
            f"{counts} violate the constraints, because no donor sequence satisfies them; "
            "no motion was written; --best-effort writes all",
            messages,
        )
    return bool(violating)


def _write_grafts(
    grafts: Sequence[Graft], paths: Sequence[Path], options: argparse.Namespace
) -> tuple[list[dict[str, Any]], list[dict[str, str]], list[Graft]]:
    """Write each graft to its path, and print the paths.

    Return two lists with one dict per graft: the values that ``--json`` prints, and the measures
    as text by name. The second list is empty without ``--measure``. The third list has the grafts
    for the report page; it is empty without ``--report``.
    """
    paths[0].parent.mkdir(parents=True, exist_ok=True)
    documents, columns = [], []
    reported: list[Graft] = []
    reference, motions = None, []
    if options.measure:
        from mograft.evaluation.world_measures import WorldReference  # takes long to import

        reference = WorldReference(grafts[0].library)
    together: list[tuple[Graft, dict[str, Any]]] = []  # grafts that are written to one file
    for path, graft in zip(paths, grafts, strict=False):
        sections: dict[str, Any] = {}
        if options.report and len(reported) < _MAX_REPORTED:
            reported.append(graft)  # each access to `grafts` builds the graft anew
        lines = [graft.report(each=options.verbose)]
        if reference is not None:
            measures = reference.measure(graft)
            sections["quality"] = measures.as_dict()
            columns.append(measures.columns())
            lines.append("  " + ", ".join(f"{name} {text}" for name, text in columns[-1].items()))
        if getattr(options, "from") is None:
            graft = with_command(graft, options, options.sources)
        if path.suffix.lower() == ".glb":
            together.append((graft, sections))
        else:
            write_graft(graft, path, sections, digits=options.digits)
        motions.append(graft.substitutions)
        provenance = graft_record(graft, path.parent) if options.json else {}
        documents.append({"file": str(path), **provenance, "digits": options.digits, **sections})
        print_remark("\n".join(lines))
        if not options.json and not together:
            print(path)
    if together:
        write_graft([graft for graft, _ in together], paths[0], [own for _, own in together])
        if not options.json:
            print(paths[0])
    if len(documents) < options.count:
        print_remark(
            f"warning: the donors allow only {len(documents)} different "
            f"motion{'s' * (len(documents) > 1)}, not {options.count}; more clips or a larger "
            "--variety allow more"
        )
    for remark in advise(graft, motions):
        print_remark(with_flags(remark, _ADVISED_OPTIONS))
    return documents, columns, reported
