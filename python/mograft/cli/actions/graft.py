"""``mograft graft`` and ``demo``: new motions on the base group of a captured one."""

import os
import re
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import mograft as mg
from mograft._util.extras import import_extra
from mograft.cli import configuration, files, graft_files
from mograft.cli.output import print_error, print_remark, print_result, show_progress, with_flags
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.commands import DemoOptions
from mograft.cli.syntax.options import GraftOptions
from mograft.cli.syntax.values import resolve_frames
from mograft.config_text import parse_fields
from mograft.dancer import dance
from mograft.io.formats import find_addresses, read_clip, split_address
from mograft.provenance.graft_edit import describe_changes
from mograft.provenance.graft_record import find_whole_library, read_record
from mograft.search.pose_constraints import anchor_reaches
from mograft.solve.candidates import count_combinations
from mograft.synthesis.advice import find_remedies
from mograft.synthesis.graft import kept_violations

_MAX_REPORTED = 20
"""Maximum number of grafts on a report page, and of earlier motions with which one is compared.

All of them are in memory at the same time.
"""

_N_DEMO_GRAFTS = 3
_NEAR_DEGREES = 1.0  # mean angle below which a motion counts as an earlier one again
_DONORS = ("only_from", "not_from", "only_tagged", "not_tagged")
_EDITS = (*("change", "take", "ban", "keep", "reach", "avoid", "avoid_self", "face"), *_DONORS)
_OUTPUTS = ("output", "into", "as_", "report", "measure", "digits", "json", "force", "quiet")
_ALLOWED = (*_EDITS, *_OUTPUTS, "verbose", "files", "from_")
"""Arguments that may be given with ``--from``; the provenance sets all others."""

_KEPT_VIOLATIONS = (
    "joints that are not exchanged violate constraints, which no donor can remove; no motion was "
    "written; place the obstacle or target elsewhere, choose another --base, or exchange these "
    "joints by a --groups file with another base group; --best-effort writes the violation"
)
_WAY_ROUND = "; mograft export BASE -o new.bvh --avoid ... leads a walk round an obstacle"


def run(options: GraftOptions) -> int:
    """Run the command."""
    options = graft_files.with_target(options)
    if options.project is not None:
        from mograft.cli.actions.studio import run_project  # takes long to import

        return run_project(options)
    if options.from_ is not None:
        return _run_replay(options)
    configuration.check_combinations(options)
    if options.measure:
        import_extra("scipy", "--measure needs SciPy", "evaluate")
    folder = files.library_folder(options.files)
    if folder is None:
        found = files.expand_folders(options.files, include_grafts=options.include_grafts)
        place = (".csv" if options.model else ".bvh", "index.html", found)
        paths, page = graft_files.new_paths(options, found[0], *place)
        strict = not files.has_folder(options.files)
        library = configuration.load_library(replace(options, files=tuple(found)), strict=strict)
        if options.model and library.skeleton.hinges is None:
            raise UsageError(f"--model requires motions of a robot, such as .csv; got {found[0]}")
    else:
        library = configuration.load_library(options)
        # The recordings of the library must not be overwritten.
        found = [own.source_file.path for own in library.entries if own.source_file]
        place = (".bvh" if library.skeleton.hinges is None else ".csv", "index.html", found)
    if folder is not None or library.refused:  # the first file may be one of them
        paths, page = graft_files.new_paths(options, library.names[0], *place)
    constraints = configuration.read_constraints(options, library.rate)
    if options.change:
        constraints.append(mg.constraints.KeepOriginal())
    if options.mirror:
        library = library.with_mirror_images()
    base = _find_base(library, options.base, folder)
    if options.scenario == "original":
        whole, clip = library.resolve_base(base)
        constraints = anchor_reaches(constraints, whole.clips[clip])
    # The base motion of a scenario does not exist yet.
    if options.scenario == "original" and not options.best_effort:
        kept = kept_violations(library, base, constraints=constraints, swap=options.swap)
        if kept:
            is_later = min(violation.frames[0] for violation in kept) > 0  # else no way leads there
            hint = _WAY_ROUND * (bool(options.avoid) and is_later)
            print_error(_KEPT_VIOLATIONS + hint, [violation.message for violation in kept])
            return 4
    grafts = _make_grafts(library, base, constraints, options)
    if options.change:
        grafts = _change(grafts[0], options)
    if constraints:
        grafts = list(grafts)
        if _are_refused(grafts, options):
            return 4  # No donor sequence satisfies the constraints.
    if options.only_feasible:
        if not (feasible := graft_files.find_feasible(grafts, library)):
            return 4
        grafts, paths = [grafts[k] for k in feasible], [paths[k] for k in feasible]
    _write_results(grafts, paths, page, options)
    return 0


def _run_replay(options: GraftOptions) -> int:
    """Write the graft of ``--from``, edited if options require it; return the exit code."""
    is_edit = any(getattr(options, name) for name in _EDITS)
    allowed = (*_ALLOWED, "seed", "best_effort") if is_edit else _ALLOWED
    allowed = (*allowed, "set", *(("count",) if options.change else ()))
    for field, name in options.changed().items():
        if field not in allowed:
            raise UsageError(
                f"--{name} cannot be combined with --from, which repeats a graft; --change, "
                "--take, --ban and --keep change parts of it; new motions from the same files: "
                f"{graft_files.new_command(options)}"
            )
    source = options.from_ or ""
    if os.path.isdir(source):
        raise UsageError(f"--from must be .json or FILE.glb#NAME of a graft, got folder {source}")
    record = read_record(source)
    ends = [f"_{k}" for k in range(options.count)] if options.count > 1 else [""]
    rest = record.library.rest
    suffix = ".bvh" if rest is None or rest.hinges is None else ".csv"
    paths, page = graft_files.output_paths(options, [record.name + end for end in ends], suffix)
    folder = files.library_folder(options.files)
    library = None if folder is None else mg.Library.open(folder)
    sources = options.files if library is None else ()
    if is_edit and library is None:
        library = find_whole_library(record, sources)
    config = None
    if options.set:
        config = mg.Config.from_dict(record.config.as_dict() | parse_fields(options.set))
        fixed = set(dict(options.set)) - set(mg.Config.fields_of("blend"))
        if fixed:
            raise UsageError(f"--set {min(fixed)} cannot be combined with --from, which gives it")
    grafts = [mg.replay(source, library, sources=sources, config=config)]
    if is_edit:
        grafts = _edit(grafts[0], options)
        if _are_refused(grafts, options):
            return 4  # The edits contradict each other or the constraints of the graft.
    if not options.given("digits"):
        options = replace(options, digits=record.digits)
    _write_results(grafts, paths, page, options)
    return 0


def _edit(graft: mg.Graft, options: GraftOptions) -> list[mg.Graft]:
    """Return the versions of a graft with the edits and changes that the options describe."""
    rate = graft.base.rate
    edits = anchor_reaches(configuration.read_constraints(options, rate), graft.motion)
    edited = graft
    if edits:
        edited = mg.edit(graft, *edits, seed=options.seed)
        command = shlex.join(options.words)
        commands = (*graft.request.edit_commands, command)
        edited = replace(edited, request=replace(edited.request, edit_commands=commands))
    versions = _change(edited, options)
    print_remark("\n".join(describe_changes(graft, versions[0])))
    return versions


def _change(graft: mg.Graft, options: GraftOptions) -> list[mg.Graft]:
    """Return ``-n`` versions of a graft with the changes of ``--change``, fewer if donors lack.

    Version k has in each range the part of the k-th lowest cost, or the last one that there is.
    """
    if not options.change:
        return [graft]
    changes = resolve_frames(options.change, graft.base.rate)
    versions, best, command = list[mg.Graft](), [0] * len(changes), shlex.join(options.words)
    for rank in range(options.count):
        changed, is_new = graft, rank == 0
        for index, (group, (first, last), donor) in enumerate(changes):
            end = max(graft.motion.n_frames - 1, first + 1)  # a range that begins later is refused
            frames = first, end if last is None else last
            try:
                changed = mg.change(changed, group, frames, donor, rank=rank)
                best[index], is_new = rank, is_new or not isinstance(donor, tuple)
            except ValueError as error:
                if not versions:
                    message = re.sub(r"`(group|frames|donor)`", r"the \1 of --change", str(error))
                    raise ValueError(message) from None
                changed = mg.change(changed, group, frames, donor, rank=best[index])
        if not is_new:
            print_remark(
                f"warning: {rank} of {options.count} motions are written: there are no other parts "
                "of the clips for the ranges of --change"
            )
            break
        made = [own if own.command else replace(own, command=command) for own in changed.changes]
        name = f"{graft.motion.name}_{rank}" if options.count > 1 else None
        versions.append(graft_files.renamed(replace(changed, changes=tuple(made)), name))
    return versions


def _find_base(
    library: mg.Library, name: str | None, folder: Path | None
) -> mg.Motion | str | None:
    """Return the base motion that ``--base`` selects.

    The result is the name of a clip of the library, a motion read from the file `name`, or None
    if `name` is None. `folder` is the folder of a stored library, or None.
    """
    names = library.names
    name = name and name.removeprefix("#")  # as `mograft info` prints the clips of a file
    if name is None or (folder is not None and name in names):
        return name
    sources = [entry.source_file for entry in library.entries]
    if Path(split_address(name)[0]).exists():
        addresses = find_addresses(name)
        path, clip = split_address(addresses[0])
        for own, source in zip(names, sources, strict=True):
            if len(addresses) > 1 or source is None or source.clip != clip:
                continue
            if os.path.realpath(source.path) == os.path.realpath(path):
                return own
        return read_clip(name, skeleton=library.spec.rest)
    file_names = [Path(source.path).name for source in sources if source is not None]
    is_unique = len(file_names) == len(names) and file_names.count(name) == 1
    return names[file_names.index(name)] if is_unique else name  # An unknown name is refused later.


def _make_grafts(
    library: mg.Library,
    base: mg.Motion | str | None,
    constraints: Sequence[mg.constraints.Constraint],
    options: GraftOptions,
) -> Sequence[mg.Graft]:
    """Return the requested grafts."""
    scenario = configuration.read_scenario(library, options)
    if options.only_violations:
        return [mg.repair(library, base, constraints=constraints, swap=options.swap)]
    is_fixed = options.variety is not None or any(
        name == "sigma_scale" for name, _ in (*options.set, *options.configured)
    )
    grafts = mg.graft_many(
        library,
        base,
        1 if options.change else options.count,
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


def _are_refused(grafts: Sequence[mg.Graft], options: GraftOptions) -> bool:
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
        bend = ["`reach_ik=1` bends an arm or leg farther"] * bool(options.reach)
        place = ["`change=GROUP@FIRST-LAST=CLIP` puts a part of a clip there, whatever its legs"]
        remedies = bend if options.from_ else find_remedies(violating[0])
        cause = f"{counts} violate the constraints, because no donor sequence satisfies them"
        ways = [*remedies, *place * bool(options.only_from), "`best_effort` writes all"]
        text = "; ".join([f"{cause}; no motion was written", *ways])
        print_error(with_flags(text, options, is_advice=True), messages)
    return bool(violating) and not options.best_effort


def _write_results(
    grafts: Sequence[mg.Graft], paths: Sequence[Path], page: Path, options: GraftOptions
) -> None:
    """Write grafts and the page that describes them, and print their paths and remarks."""
    paths[0].parent.mkdir(parents=True, exist_ok=True)
    is_together = paths[0].suffix.lower() not in (".bvh", ".csv")
    reference, motions, kept = None, list[mg.Motion](), list[mg.Graft]()
    substitutions, sections, columns, documents = [], [], [], []
    n_near = 0
    if options.measure:
        from mograft.evaluation.world_measures import WorldReference  # takes long to import

        reference = WorldReference(grafts[0].library)
    # Each access to `grafts` builds the graft anew.
    for path, graft in zip(paths, grafts, strict=False):
        own = graft if options.from_ else graft_files.with_command(graft, options, options.files)
        own = graft_files.renamed(own, options.as_)
        new, section = mg.newness(own, motions), dict[str, Any]()
        n_near += new.apart is not None and np.degrees(new.apart) < _NEAR_DEGREES
        motions = [*motions, own.motion][-_MAX_REPORTED:] if len(paths) > 1 else []
        if reference is not None:
            measures = reference.measure(own)
            section = {"quality": measures.as_dict()}
            columns.append(measures.columns())
        if not is_together:
            mg.write_graft(own, path, [section], digits=options.digits)
        if options.json:
            record = {**mg.graft_record(own, path.parent), "digits": options.digits}
            documents.append({"file": str(path), **record, **section, "newness": new.as_dict()})
        print_remark(f"{own.report(each=options.verbose)}\n  {new}")
        if reference is not None:
            text = ", ".join(f"{name} {value}" for name, value in columns[-1].items())
            print_remark(f"  {text}; ranges: parts of the base", is_result=True)
        if not options.json and not is_together:
            print(path)
        substitutions.append(own.substitutions)
        sections.append(section)
        if is_together or (options.report and len(kept) < _MAX_REPORTED):
            kept.append(own)
    if is_together:
        update = options.into is not None
        names = mg.write_graft(kept, paths[0], sections, update=update, force=options.force)
        kept = list(map(graft_files.renamed, kept, names))
        if not options.json:
            print(paths[0])
    _print_remarks(own, substitutions, n_near, options)
    result: dict[str, Any] = {"grafts": documents}
    if options.report:
        shown = kept[:_MAX_REPORTED]
        graft_files.write_report(shown, paths[: len(shown)], page, columns[: len(shown)])
        result["report"] = str(page)
    print_result(options, "grafts/1", result, [page] if options.report else [])


def _print_remarks(
    last: mg.Graft,
    substitutions: Sequence[Sequence[mg.Substitution]],
    n_near: int,
    options: GraftOptions,
) -> None:
    """Print how many motions are missing or near to others, and what was not exchanged.

    `last` is one of the grafts, and `n_near` the number of those that are near to an earlier one.
    """
    n, remarks = len(substitutions), list[str]()
    if n < options.count and not options.change and not options.only_feasible:
        apart = f" that are {options.distinct:g}° apart" if options.distinct else ""
        smaller = "a smaller --distinct, " if options.distinct else ""
        wider = "" if options.variety is None else "--variety or "
        remarks.append(
            f"warning: the donors allow only {n} different motion{'s' * (n > 1)}{apart}, not "
            f"{options.count}; {smaller}a larger {wider}--max-stretch or more clips allow more"
        )
    if n_near and not options.change:
        remarks.append(
            f"warning: {n_near} of {n} motions differ from an earlier one by less than "
            f"{_NEAR_DEGREES:g}°; --distinct {2 * _NEAR_DEGREES:g} replaces them"
        )
    advice = [] if options.change else mg.advise(last, substitutions)
    for remark in [*remarks, *advice]:
        print_remark(with_flags(remark, options, is_advice=True))


def run_demo(options: DemoOptions) -> int:
    """Run all stages on the built-in dancer."""
    files.check_suffix(options.output, is_folder=True)
    folder = options.output
    sample, page = folder / "dance.bvh", folder / "index.html"
    paths = [folder / f"dance_graft{i}.bvh" for i in range(_N_DEMO_GRAFTS)]
    written = [sample, page, *graft_files.files_of_grafts(paths)]
    files.check_writable(written, force=options.force)

    def describe(text: str) -> None:
        if not options.json:
            print(text, flush=True)

    motion = dance(seed=options.seed or 0).motion
    folder.mkdir(parents=True, exist_ok=True)
    mg.write_bvh(motion, sample)
    describe(
        f"sample      {sample}: a procedural dancer, {motion.n_joints} joints, "
        f"{motion.n_frames} frames, {motion.duration:.0f} s"
    )
    with show_progress() as progress:
        library = mg.Library.build(sample, progress=progress)
    n = len(library.segments)
    clusters = {group: int(labels.max()) + 1 for group, labels in library.labels.items()}
    total = count_combinations(library.labels[library.groups.base], len(library.groups.names))
    describe(f"segments    {n}, bounded by the extrema of kinetic energy")
    counts = ", ".join(f"{count} of {group}" for group, count in clusters.items())
    describe(f"clusters    {counts}: segments in which these joints move alike")
    describe(
        f"combinations {total} of legs and upper bodies, {total / n:.1f} times the {n} captured"
    )
    grafts = list(mg.graft_many(library, count=_N_DEMO_GRAFTS, seed=options.seed or 0))
    paths = paths[: len(grafts)]
    for graft, path in zip(grafts, paths, strict=True):
        mg.write_graft(graft_files.with_command(graft, options, [str(sample)]), path)
        new = sum(not s.is_own for s in graft.substitutions)
        describe(f"graft       {path}: {new} of {len(graft.substitutions)} upper bodies are new")
    graft_files.write_report(grafts, paths, page)
    if options.open:
        graft_files.open_page(page)
    document = {"sample": str(sample), "frames": motion.n_frames, "segments": n}
    document |= {"clusters": clusters, "combinations": int(total)}
    document |= {"grafts": [str(path) for path in paths], "page": str(page)}
    last = f"page        {page}: the motions and how they were made"
    next_step = "next:       mograft graft your.bvh -o out/ -n 5"
    print_result(options, "demo/1", document, [last, next_step])
    return 0
