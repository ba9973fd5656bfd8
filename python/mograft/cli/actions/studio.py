"""``mograft studio``, the editor of grafts in the browser, and ``mograft graft --project``."""

import sys
import webbrowser
from pathlib import Path
from typing import Any

import mograft as mg
from mograft._util.extras import import_extra
from mograft._util.signals import clean_up_by
from mograft.cli.files import check_suffix, check_writable
from mograft.cli.output import print_remark, print_result
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.commands import StudioOptions
from mograft.cli.syntax.options import GraftOptions
from mograft.io.formats import recognize_format, split_address
from mograft.studio.export import replay_project, write_motions
from mograft.studio.opening import kind_of
from mograft.studio.session import Session

_FOLDER = Path("studio")
_ALLOWED = ("project", "output", "force", "json", "quiet", "verbose")
"""Options that may be given with ``--project``; the project sets all others."""


def run_studio(options: StudioOptions) -> int:
    """Run the command until it is interrupted."""
    if options.output is not None:
        check_suffix(options.output, is_folder=True)
        check_writable([options.output / "project.json"], force=True)
    for name in options.files:
        path = Path(split_address(name)[0])
        if not path.exists():
            raise FileNotFoundError(2, "No such file or directory", str(path))
        if path.is_file() and path.suffix.lower() != ".json" and not recognize_format(path):
            raise UsageError(f"{name} is neither a motion file, nor a project.json or a library")
    projects = [name for name in options.files if kind_of(name) == "project"]
    if projects and len(options.files) > 1:
        raise UsageError(f"a project is opened alone, got {len(options.files)} files")
    project = Path(projects[0]) if projects else None
    folder = options.output or (_FOLDER if project is None else project.parent)
    sources = [] if projects else [Path(name) for name in options.files]
    for module in ("starlette", "uvicorn"):
        import_extra(module, "the studio needs starlette and uvicorn", "studio")
    from mograft.studio.server import StudioServer

    # `print_remark` does not know in the threads of the server whether --quiet is given.
    report = (lambda _: None) if options.quiet else print_remark
    folder.mkdir(parents=True, exist_ok=True)
    session = Session(folder, project)
    with clean_up_by(session.close):
        if sources:
            session.open(sources)
        with StudioServer(session, folder, sources, options.port, report=report) as server:
            document = {"url": server.url, "folder": str(folder)}
            lines = [f"mograft studio at {server.url}", f"writes to {folder}; Ctrl-C ends it"]
            print_result(options, "studio/1", document, lines)
            sys.stdout.flush()
            if options.open and not webbrowser.open(server.url):
                print_remark("no browser found: open the address yourself")
            server.wait()
    return 0


def run_project(options: GraftOptions) -> int:
    """Write the kept motions of a project as the studio exports them; return the exit code."""
    for field, name in options.changed().items():
        if field not in _ALLOWED:
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
        {"file": str(file), **mg.graft_record(graft, file.parent)} for file, graft in pairs
    ]
    print_result(options, "grafts/1", {"grafts": documents}, files)
    return 0
