"""``mograft graft --project``: the kept motions of a project of the studio."""

from typing import Any

from mograft import graft_record
from mograft.cli.output import print_remark, print_result
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.options import GraftOptions
from mograft.studio.export import replay_project, write_motions

_ALLOWED = ("project", "output", "force", "json", "quiet", "verbose")
"""Options that may be given with ``--project``; the project sets all others."""


def run_project(options: GraftOptions) -> int:
    """Write the kept motions of a project as the studio exports them; return the exit code."""
    for field, name in options.changed().items():
        if field not in (*options.origins, *_ALLOWED):
            given = "LIB|FILE" if field == "files" else f"--{name}"
            raise UsageError(f"{given} cannot be combined with --project, which has its own inputs")
    path, target = options.project, options.output
    assert path is not None
    if target.suffix.lower() == ".bvh":
        raise UsageError(
            f"-o must be a folder, or a .glb or .npz file, with --project; got {target}"
        )
    grafts, character = replay_project(path)
    files = write_motions(grafts, target, ".bvh", character, force=options.force)
    for graft in grafts:
        print_remark(graft.report(each=options.verbose))
    pairs = zip(files if len(files) > 1 else files * len(grafts), grafts, strict=True)
    documents: list[dict[str, Any]] = [
        {"file": str(file), **graft_record(graft, file.parent)} for file, graft in pairs
    ]
    print_result(options, "grafts/1", {"grafts": documents}, files)
    return 0
