"""``mograft demo``: the whole story on the built-in dancer."""

import argparse
from pathlib import Path
from typing import Any

from mograft.cli._common import (
    ENDS,
    add_making,
    check_free,
    print_json,
    progress,
    write,
    write_report,
)


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    demo = commands.add_parser("demo", help="the whole story on the built-in dancer")
    demo.add_argument(
        "-o", "--output", type=Path, default=Path("demo"), help="folder to fill (default demo)"
    )
    demo.add_argument("--open", action="store_true", help="show the page at the end")
    demo.add_argument("--json", action="store_true", help="the story as one JSON document")
    add_making(demo)
    demo.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from mograft.dancer import dance
    from mograft.io.bvh import write_bvh
    from mograft.library.library import Library
    from mograft.search.candidates import count_combinations
    from mograft.synthesis.graft import graft_many

    folder: Path = options.output
    sample = folder / "dance.bvh"
    page = folder / "index.html"
    names = [sample, page, *(folder / f"dance_graft{i}{end}" for i in range(3) for end in ENDS)]
    check_free(names, force=options.force)

    def tell(text: str) -> None:
        if not options.json:
            print(text, flush=True)

    motion = dance(seed=options.seed).motion
    folder.mkdir(parents=True, exist_ok=True)
    write_bvh(motion, sample)
    tell(
        f"sample      {sample}: a procedural dancer, {motion.n_joints} joints, "
        f"{motion.n_frames} frames, {motion.duration:.0f} s"
    )
    with progress() as show:
        library = Library.build(motion, progress=show)
    n = len(library.segments)
    clusters = {group: int(labels.max()) + 1 for group, labels in library.labels.items()}
    whole = count_combinations(library.labels[library.groups.base], len(library.groups.names))
    tell(f"segments    {n}, cut at the extrema of kinetic energy")
    counts = ", ".join(f"{count} of {group}" for group, count in clusters.items())
    tell(f"clusters    {counts}: segments in which these move alike")
    tell(f"combinations {whole} of legs and upper bodies, {whole / n:.1f} times the {n} captured")
    grafts = list(graft_many(library, count=3, seed=options.seed))
    paths = []
    for graft in grafts:
        path = write(graft, folder / f"{graft.motion.name}.bvh")
        paths.append(path)
        exchanged = sum(not s.is_own for s in graft.substitutions)
        tell(f"graft       {path}: {exchanged} of {len(graft.substitutions)} upper bodies are new")
    write_report(grafts, paths, page, show=options.open)
    tell(f"page        {page}: all of it to look at")
    tell("next:       mograft graft your.bvh -o out/ -n 5")
    if options.json:
        print_json(
            {
                "schema": "mograft.demo/1",
                "sample": str(sample),
                "frames": motion.n_frames,
                "segments": n,
                "clusters": clusters,
                "combinations": int(whole),
                "grafts": [str(path) for path in paths],
                "page": str(page),
            }
        )
    return 0
