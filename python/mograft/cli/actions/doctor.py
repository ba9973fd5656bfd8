"""``mograft doctor``: whether the installation works, and which extras are absent."""

import argparse
import os
import platform
import sys
import tempfile
import webbrowser
from importlib import metadata
from pathlib import Path

from mograft import __version__
from mograft.cli.output import print_result

_REQUIRED = "numpy"
_USES_OF_PACKAGES = {
    _REQUIRED: "everything",
    "matplotlib": "mograft plot",
    "pillow": "films, mograft export -o x.gif",
    "imageio-ffmpeg": "films, mograft export -o x.mp4, unless ffmpeg is installed",
    "usd-core": "mograft export -o x.usd",
    "mograft-fbx": "FBX files",
    "pyarrow": "mograft lib export --parquet",
    "shtab": "mograft completion",
    "pybvh": "mograft.formats.to_pybvh, mograft.formats.from_pybvh",
    "scikit-learn": "mograft evaluate",
    "scipy": "mograft evaluate",
}


def run(options: argparse.Namespace) -> int:
    """Print the result of each check; return exit code 1 if a check found a defect, else 0."""
    checks = [
        *_check_packages(),
        _check_graft(),
        _check_folder("temporary files", Path(tempfile.gettempdir())),
        _check_folder("this folder", Path.cwd()),
        _check_browser(),
    ]
    is_ok = all(check["state"] != "broken" for check in checks)
    lines = [f"{check['state']:7} {check['what']}: {check['detail']}" for check in checks]
    print_result(options, "doctor", {"ok": is_ok, "checks": checks}, lines)
    return 0 if is_ok else 1


def _result(what: str, state: str, detail: str) -> dict[str, str]:
    return {"what": what, "state": state, "detail": detail}


def _check_packages() -> list[dict[str, str]]:
    system = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    results = [
        _result("mograft", "ok", __version__),
        _result("python", "ok", f"{platform.python_version()} on {system}"),
    ]
    for name, use in _USES_OF_PACKAGES.items():
        try:
            results.append(_result(name, "ok", metadata.version(name)))
        except metadata.PackageNotFoundError:
            state = "broken" if name == _REQUIRED else "absent"
            results.append(_result(name, state, f"needed for {use}: pip install {name}"))
    return results


def _check_graft() -> dict[str, str]:
    """Run all stages on a short dance."""
    try:
        from mograft.dancer import dance
        from mograft.library.library import Library
        from mograft.synthesis.graft import graft

        new = graft(Library.build(dance(strides=1).motion[:300]))
    except Exception as error:
        # Any failure, whatever its type, is the finding of this check.
        return _result("a graft", "broken", f"{type(error).__name__}: {error}")
    return _result("a graft", "ok", f"{new.motion.n_frames} frames created")


def _check_folder(what: str, path: Path) -> dict[str, str]:
    try:
        with tempfile.TemporaryFile(dir=path):
            return _result(what, "ok", f"{path} is writable")
    except OSError as error:
        return _result(what, "broken", f"{path} is not writable: {error.strerror}")


def _check_browser() -> dict[str, str]:
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        return _result(
            "browser", "absent", "none found: open the pages that mograft writes yourself"
        )
    name = getattr(browser, "name", browser.__class__.__name__)
    is_headless = sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
    return _result("browser", "ok", f"{name}{', but no display' if is_headless else ''}")
