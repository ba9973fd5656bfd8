"""``mograft demo``: all stages on the built-in dancer."""

from mograft.cli.files import check_suffix, check_writable
from mograft.cli.graft_files import graft_files, open_page, with_command, write_report
from mograft.cli.output import print_result, show_progress
from mograft.cli.syntax.commands import DemoOptions
from mograft.dancer import dance
from mograft.io.bvh.writer import write_bvh
from mograft.library.library import Library
from mograft.provenance.writing import write_graft
from mograft.search.candidates import count_combinations
from mograft.synthesis.graft import graft_many

_N_GRAFTS = 3


def run(options: DemoOptions) -> int:
    """Run the command."""
    check_suffix(options.output, is_folder=True)
    folder = options.output
    sample = folder / "dance.bvh"
    page = folder / "index.html"
    paths = [folder / f"dance_graft{i}.bvh" for i in range(_N_GRAFTS)]
    files = graft_files(paths)
    check_writable([sample, page, *files], force=options.force)

    def describe(text: str) -> None:
        if not options.json:
            print(text, flush=True)

    motion = dance(seed=options.seed or 0).motion
    folder.mkdir(parents=True, exist_ok=True)
    write_bvh(motion, sample)
    describe(
        f"sample      {sample}: a procedural dancer, {motion.n_joints} joints, "
        f"{motion.n_frames} frames, {motion.duration:.0f} s"
    )
    with show_progress() as progress:
        library = Library.build(sample, progress=progress)
    n = len(library.segments)
    clusters = {group: int(labels.max()) + 1 for group, labels in library.labels.items()}
    total = count_combinations(library.labels[library.groups.base], len(library.groups.names))
    describe(f"segments    {n}, bounded by the extrema of kinetic energy")
    counts = ", ".join(f"{count} of {group}" for group, count in clusters.items())
    describe(f"clusters    {counts}: segments in which these joints move alike")
    describe(
        f"combinations {total} of legs and upper bodies, {total / n:.1f} times the {n} captured"
    )
    grafts = list(graft_many(library, count=_N_GRAFTS, seed=options.seed or 0))
    paths = paths[: len(grafts)]
    for graft, path in zip(grafts, paths, strict=True):
        write_graft(with_command(graft, options, [str(sample)]), path)
        new = sum(not s.is_own for s in graft.substitutions)
        describe(f"graft       {path}: {new} of {len(graft.substitutions)} upper bodies are new")
    write_report(grafts, paths, page)
    if options.open:
        open_page(page)
    document = {
        "sample": str(sample),
        "frames": motion.n_frames,
        "segments": n,
        "clusters": clusters,
        "combinations": int(total),
        "grafts": [str(path) for path in paths],
        "page": str(page),
    }
    closing_lines = [
        f"page        {page}: the motions and how they were made",
        "next:       mograft graft your.bvh -o out/ -n 5",
    ]
    print_result(options, "demo", document, closing_lines)
    return 0
