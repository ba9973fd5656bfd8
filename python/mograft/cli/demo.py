"""``mograft demo``: the whole story on the built-in dancer."""

import argparse
from pathlib import Path
from typing import Any

from mograft.cli._common import ENDS, add_making, check_free, progress, write, write_report


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    demo = commands.add_parser("demo", help="the whole story on the built-in dancer")
    demo.add_argument("-o", "--output", type=Path, default=Path("demo"), help="folder to fill")
    demo.add_argument("--open", action="store_true", help="show the page at the end")
    add_making(demo)
    demo.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from mograft.bvh import write_bvh
    from mograft.dancer import dance
    from mograft.grafting import graft_many
    from mograft.library import Library
    from mograft.substitution import combinations

    folder: Path = options.output
    sample = folder / "dance.bvh"
    page = folder / "index.html"
    names = [sample, page, *(folder / f"dance_graft{i}{end}" for i in range(3) for end in ENDS)]
    check_free(names, force=options.force)
    motion = dance(seed=options.seed).motion
    folder.mkdir(parents=True, exist_ok=True)
    write_bvh(motion, sample)
    print(
        f"sample      {sample}: a procedural dancer, {motion.n_joints} joints, "
        f"{motion.n_frames} frames, {motion.duration:.0f} s"
    )
    with progress() as tell:
        library = Library.build(motion, progress=tell)
    print(f"segments    {len(library.segments)}, cut at the extrema of kinetic energy")
    clusters = ", ".join(f"{labels.max() + 1} of {g}" for g, labels in library.labels.items())
    print(f"clusters    {clusters}: segments whose legs move alike")
    whole = combinations(library.labels[library.groups.base], len(library.groups.names))
    n = len(library.segments)
    print(f"combinations {whole} of legs and upper bodies, {whole / n:.1f} times the {n} captured")
    grafts = list(graft_many(library, count=3, seed=options.seed))
    paths = []
    for graft in grafts:
        path = write(graft, folder / f"{graft.motion.name}.bvh")
        paths.append(path)
        exchanged = sum(not s.is_own for s in graft.substitutions)
        print(f"graft       {path}: {exchanged} of {len(graft.substitutions)} upper bodies are new")
    print(
        f"page        {write_report(grafts, paths, page, show=options.open)}: all of it to look at"
    )
    print("next:       mograft graft your.bvh -o out/ -n 5")
    return 0
