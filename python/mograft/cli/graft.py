"""``mograft graft``: new motions on the base group of a captured one."""

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mograft.cli.arguments import Command, option, switch
from mograft.cli.configuration import load_library, options_given
from mograft.cli.constraints import constraint_options, read_constraints
from mograft.cli.files import GRAFT_ENDINGS, check_writable, expand_folders, library_folder
from mograft.cli.options import FORCE, GROUPS, LIBRARY_OR_FILES, PRESET, SEED, config_option
from mograft.cli.output import print_json, print_remark, write_graft, write_report
from mograft.cli.scenario import SCENARIO_OPTIONS, check_scenario, read_scenario
from mograft.cli.values import positive_integer, positive_number
from mograft.errors import join_names

if TYPE_CHECKING:
    from mograft.library.library import Library
    from mograft.motion.motion import Motion
    from mograft.search.constraints import Constraint
    from mograft.synthesis.graft_result import Graft

EXIT_UNSATISFIED = 4
"""Exit code if no donor sequence satisfies the constraints."""

_MAX_REPORTED = 20
"""Grafts in a report page, which holds all of them in memory at once."""

_MAX_SIGMA_SCALE = 4.0
"""At four times the spread of all segments one cluster contains them all."""


@dataclass(frozen=True)
class _Outputs:
    """The files that the command writes."""

    motions: list[Path]
    page: Path

    @classmethod
    def of(cls, options: argparse.Namespace, stem: str) -> "_Outputs":
        """Return one file, or numbered files in a folder, named after the base."""
        folder: Path = options.output
        if _is_single(options):
            return cls([folder], folder.with_suffix(".html"))
        motions = [folder / f"{stem}_graft{i}.bvh" for i in range(options.count)]
        return cls(motions, folder / "index.html")

    def check(self, options: argparse.Namespace) -> None:
        """Raise an OSError if one of the files cannot be written."""
        files = [path.with_suffix(ending) for path in self.motions for ending in GRAFT_ENDINGS]
        pages = [self.page] if options.report else []
        check_writable([*files, *pages], force=options.force)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    _check_usage(options)
    folder = library_folder(options)
    library = None if folder is None else load_library(options)
    first = expand_folders(options.files)[0] if library is None else library.entries[0].name
    outputs = _Outputs.of(options, Path(options.base or first).stem)
    outputs.check(options)
    constraints = read_constraints(options)
    if library is None:
        library = load_library(options)
    if options_given(options, "temperature") and library.config.choice != "sample":
        options.usage_error(f"--temperature requires --choice sample, got {library.config.choice}")
    if options.mirror:
        library = library.mirrored()
    base = _find_base(library, options.base, folder)
    grafts = _make_grafts(library, base, constraints, options)
    if constraints:
        grafts = list(grafts)
        best_effort = options.best_effort
        if _print_violations(grafts, best_effort=best_effort) and not best_effort:
            return EXIT_UNSATISFIED
    documents = _write_grafts(grafts, outputs, options)
    if options.json:
        report = {"report": str(outputs.page)} if options.report else {}
        print_json({"schema": "mograft.grafts/1", "grafts": documents} | report)
    return 0


def _is_single(options: argparse.Namespace) -> bool:
    is_file: bool = options.output.suffix.lower() == ".bvh"
    return is_file


def _check_usage(options: argparse.Namespace) -> None:
    if _is_single(options) and options.count != 1:
        options.usage_error(f"-o must be a folder if -n is above 1, got {options.output}")
    if options.repair and options.count != 1:
        options.usage_error(f"-n must be 1 with --repair, got {options.count}")
    check_scenario(options)


def _find_base(library: "Library", name: str | None, folder: Path | None) -> "Motion | str | None":
    """Return the name of the clip that ``--base`` selects, or the motion of its file."""
    if name is None:
        return None
    from mograft.io.bvh import read_bvh

    names = [entry.name for entry in library.entries]
    if folder is not None and name in names:
        return name
    path = os.path.realpath(name)
    for entry in library.entries:
        if entry.source_file is not None and os.path.realpath(entry.source_file.path) == path:
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


def _make_grafts(
    library: "Library",
    base: "Motion | str | None",
    constraints: "Sequence[Constraint]",
    options: argparse.Namespace,
) -> "Sequence[Graft]":
    """Return the grafts; larger clusters are used if the donors allow fewer than requested."""
    from mograft.synthesis.graft import graft_many, repair

    swap = None if options.swap is None else options.swap.split(",")
    scenario = read_scenario(library, options)
    if options.repair:
        return [repair(library, base, constraints=constraints, swap=swap)]
    keywords: dict[str, Any] = {"constraints": constraints, "swap": swap, "seed": options.seed}
    keywords["scenario"] = scenario
    grafts = graft_many(library, base, options.count, **keywords)
    while len(grafts) < options.count and options.sigma_scale is None:
        scale = library.config.sigma_scale * 4 / 3
        if scale > _MAX_SIGMA_SCALE or library.config.sigma not in ("rms", "literal"):
            break
        print_remark(
            f"only {len(grafts)} different motions with sigma_scale "
            f"{library.config.sigma_scale:.3g}; trying {scale:.3g}, "
            "which allows less similar donors"
        )
        library = library.relabelled(replace(library.config, sigma_scale=scale))
        grafts = graft_many(library, base, options.count, **keywords)
    return grafts


def _print_violations(grafts: "Sequence[Graft]", *, best_effort: bool) -> bool:
    """Print the violations of the constraints; return whether there are any."""
    violating = [graft for graft in grafts if graft.violations]
    for graft in violating:
        for violation in graft.violations:
            print_remark(f"{graft.motion.name}: {violation.message}")
    counts = f"{len(violating)} of {len(grafts)} motions"
    if violating and best_effort:
        print_remark(f"warning: {counts} violate the constraints; all {len(grafts)} are written")
    elif violating:
        print_remark(
            f"error: {counts} violate the constraints, because no donor sequence satisfies them; "
            "no motion was written; --best-effort writes all"
        )
    return bool(violating)


def _write_grafts(
    grafts: "Sequence[Graft]", outputs: _Outputs, options: argparse.Namespace
) -> list[dict[str, Any]]:
    """Write grafts, and their report if requested; return what ``--json`` prints of each."""
    outputs.motions[0].parent.mkdir(parents=True, exist_ok=True)
    documents = []
    for path, graft in zip(outputs.motions, grafts, strict=False):
        write_graft(graft, path)
        documents.append({"file": str(path), **graft.as_dict()})
        print_remark(graft.report())
        if not options.json:
            print(path)
    if len(documents) < options.count:
        print_remark(
            f"warning: the donors allow only {len(documents)} different motions, "
            f"not {options.count}; more clips or a larger --sigma-scale allow more"
        )
    if options.report:
        reported = [grafts[index] for index in range(min(len(grafts), _MAX_REPORTED))]
        write_report(reported, outputs.motions[: len(reported)], outputs.page, show=False)
        if not options.json:
            print(outputs.page)
    return documents


_CONFIG_OPTIONS = (
    switch("--mirror", help="use the mirror images of all clips as additional donors"),
    option(
        "--sigma-scale",
        type=positive_number,
        metavar="X",
        help="cluster diameter threshold, as a multiple of sigma; a larger value gives more "
        "variety, a smaller one more similarity (default: that of the configuration, usually "
        "0.75; if fewer than COUNT different motions exist, it is multiplied by 4/3 repeatedly, "
        "up to 4)",
    ),
    config_option("choice", "selection of donors", "sample, with --preset paper random"),
    option(
        "--temperature",
        type=positive_number,
        metavar="X",
        help="cost difference that makes a draw of --choice sample less likely by the factor e "
        "(default: 1)",
    ),
)
_BLEND_OPTIONS = (
    config_option("seam", "seam treatment", "offset, with --preset paper paper"),
    config_option("alignment", "time alignment of donors", "uniform"),
    config_option("torso", "orientation that an exchanged trunk keeps", "pelvis"),
    config_option("feet", "foot planting", "auto, with --preset paper never"),
)

COMMAND = Command(
    name="graft",
    help="create motions on the base group of a captured one",
    description="Create motions that keep the base group of a captured motion, by default legs "
    "and root, and exchange the other joint groups for those of similar segments.",
    run=run,
    arguments=(
        LIBRARY_OR_FILES,
        option(
            "--base",
            is_setting=False,
            is_path=True,
            metavar="CLIP|FILE",
            help="motion that provides the base group (default: the first clip)",
        ),
        GROUPS,
        option(
            "--swap",
            metavar="GROUP,...",
            help="groups to exchange (default: all except the base group)",
        ),
        option(
            "-n",
            "--count",
            is_setting=False,
            type=positive_integer,
            default=1,
            help="number of motions (default: 1)",
        ),
        option(
            "-o",
            "--output",
            is_setting=False,
            is_path=True,
            type=Path,
            required=True,
            help="folder for the motions, or for one motion a .bvh file",
        ),
        PRESET,
        *_CONFIG_OPTIONS,
        *SCENARIO_OPTIONS,
        *_BLEND_OPTIONS,
        switch("--report", help="also write an HTML page that describes the motions"),
        switch("--json", is_setting=False, help="print the provenance as one JSON document"),
        SEED,
        FORCE,
        constraint_options(
            switch(
                "--repair",
                is_setting=False,
                help="exchange only the segments that violate the constraints",
            ),
            switch(
                "--best-effort",
                help="write the motions with the smallest violation and return exit code 0 even "
                "if no donor sequence satisfies the constraints",
            ),
        ),
    ),
)
