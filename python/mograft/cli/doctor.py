"""``mograft doctor``: what is installed, and what would not work here."""

import argparse
import os
import platform
import sys
import tempfile
from pathlib import Path
from typing import Any

from mograft import __version__
from mograft.cli._common import print_json

NEEDED = ("numpy",)
EXTRAS = {
    "matplotlib": "mograft plot",
    "pillow": "films, mograft export -o x.gif",
    "imageio-ffmpeg": "films, mograft export -o x.mp4, unless ffmpeg is there",
    "usd-core": "mograft export -o x.usd",
    "pyarrow": "mograft lib export --parquet",
    "shtab": "mograft completion",
    "pybvh": "mograft.to_pybvh, mograft.from_pybvh",
    "scikit-learn": "mograft evaluate",
    "scipy": "mograft evaluate",
}


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    doctor = commands.add_parser("doctor", help="what is installed, and what would not work here")
    doctor.add_argument("--json", action="store_true", help="as one JSON document")
    doctor.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command; the exit code is 1 if something that is needed does not work."""
    checks = [*_versions(), _kernels(), _folder("temporary files", Path(tempfile.gettempdir()))]
    checks += [_folder("this folder", Path.cwd()), _browser()]
    failed = [check for check in checks if check["state"] == "broken"]
    if options.json:
        print_json({"schema": "mograft.doctor/1", "ok": not failed, "checks": checks})
    else:
        for check in checks:
            print(f"{check['state']:7} {check['what']}: {check['detail']}")
    return 1 if failed else 0


def _check(what: str, state: str, detail: str) -> dict[str, str]:
    return {"what": what, "state": state, "detail": detail}


def _versions() -> list[dict[str, str]]:
    from importlib import metadata

    system = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    found = [
        _check("mograft", "ok", __version__),
        _check("python", "ok", f"{platform.python_version()} on {system}"),
    ]
    for name in (*NEEDED, *EXTRAS):
        try:
            found.append(_check(name, "ok", metadata.version(name)))
        except metadata.PackageNotFoundError:
            state = "broken" if name in NEEDED else "absent"
            use = "everything" if name in NEEDED else EXTRAS[name]
            found.append(_check(name, state, f"needed for {use}: pip install {name}"))
    return found


def _kernels() -> dict[str, str]:
    """Run the whole way once on a small dance."""
    try:
        from mograft.dancer import dance
        from mograft.library.library import Library
        from mograft.synthesis.graft import graft

        new = graft(Library.build(dance(strides=1).motion[:300]))
    except Exception as error:
        # Whatever goes wrong is what is asked for here.
        return _check("a graft", "broken", f"{type(error).__name__}: {error}")
    return _check("a graft", "ok", f"{new.motion.n_frames} frames made")


def _folder(what: str, path: Path) -> dict[str, str]:
    try:
        with tempfile.TemporaryFile(dir=path):
            return _check(what, "ok", f"{path} can be written")
    except OSError as error:
        return _check(what, "broken", f"{path} cannot be written: {error.strerror}")


def _browser() -> dict[str, str]:
    import webbrowser

    try:
        name = webbrowser.get().__class__.__name__
    except webbrowser.Error:
        return _check("browser", "absent", "none found: pages are written, but not opened")
    shown = getattr(webbrowser.get(), "name", name)
    headless = sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
    return _check("browser", "ok", f"{shown}{', though there is no screen' if headless else ''}")
