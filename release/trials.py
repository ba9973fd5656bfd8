"""Trials of finished distributions in fresh environments."""

import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import time
from pathlib import Path

from release import suite
from release.distributions import DIST, DISTRIBUTIONS, ROOT, WORK
from release.tools import bin_of, run_tool

_KEPT_VARIABLES = ("LANG", "SSL_CERT_FILE", "SYSTEMROOT", "TEMP", "TMP", "TMPDIR")
_SYSTEM_FOLDERS = ("/usr/bin", "/bin")

_FOREIGN_PROJECT = '''\
"""A project of somebody else, which type checkers examine in strict mode."""

import mograft as mg
import mograft_linkage
import numpy as np
from mograft.dancer import dance


def frames(path: str, seed: int) -> int:
    library = mg.Library.build(mg.read_bvh(path))
    new: mg.Graft = mg.graft(library, seed=seed)
    return new.motion.n_frames


def labels(n_points: int) -> list[int]:
    points = np.random.default_rng(0).normal(size=(n_points, 3))
    tree = mograft_linkage.linkage(points)
    return [int(label) for label in mograft_linkage.cut(tree, 2)]


print(frames("dance.bvh", 7) + dance(strides=1).motion.n_frames, labels(9))
'''
_WRONG_LINE = 'mg.graft("dance.bvh", seed="seven")\n'


def make_fresh_environment(name: str, python: str = sys.executable) -> Path:
    """Create an empty virtual environment below the folder of releases; return its folder."""
    folder = WORK / name
    shutil.rmtree(folder, ignore_errors=True)
    subprocess.run([python, "-m", "venv", str(folder / "venv")], check=True)
    (folder / "home").mkdir()
    return folder


def run_fresh(
    folder: Path,
    program: str,
    *words: str | Path,
    rust: dict[str, str] | None = None,
    cwd: Path | None = None,
) -> str:
    """Run a program of a fresh environment in its folder, or in `cwd`; return what it printed.

    The environment has no variables of this process except those of pip and of the system. Its
    PATH holds no cargo and no rustc, unless `rust` gives the variables of cargo.
    """
    path = os.pathsep.join([str(bin_of(folder / "venv")), *_SYSTEM_FOLDERS])
    if rust is not None:
        path = f"{bin_of(folder / 'venv')}{os.pathsep}{os.environ['PATH']}"
    elif found := shutil.which("cargo", path=path) or shutil.which("rustc", path=path):
        raise ValueError(f"the environment without Rust contains {found}")
    kept = {k: v for k, v in os.environ.items() if k in _KEPT_VARIABLES or k.startswith("PIP_")}
    environment = kept | {"PATH": path, "HOME": str(folder / "home"), "PYTHONNOUSERSITE": "1"}
    environment |= rust or {}
    command = [str(bin_of(folder / "venv") / program), *map(str, words)]
    print(f"$ {program} {' '.join(map(str, words))}", flush=True)
    process = subprocess.run(
        command, cwd=cwd or folder, env=environment, check=False, capture_output=True, text=True
    )
    if process.returncode:
        raise ValueError(f"{program} failed:\n{process.stdout[-2000:]}{process.stderr[-4000:]}")
    return process.stdout


def try_wheels(python: str = sys.executable) -> None:
    """Install the wheels of this machine without Rust, and run mograft from them.

    Prints the time from the start of the installation of mograft to the page of the demo.
    """
    folder = make_fresh_environment("wheel", python)
    start = time.perf_counter()
    for distribution in DISTRIBUTIONS:
        words = ["-m", "pip", "install", "--quiet", "--only-binary", ":all:", "--find-links"]
        run_fresh(folder, "python", *words, DIST, f"{distribution.name}=={distribution.version}")
        run_fresh(folder, "python", "-c", f"import {distribution.extension}")
    run_demo(folder)
    print(f"{time.perf_counter() - start:.0f} s from pip install to the page", flush=True)


def run_demo(folder: Path) -> None:
    """Run ``mograft doctor`` and ``mograft demo``, and print the hash of a graft."""
    print(run_fresh(folder, "mograft", "doctor"), end="", flush=True)
    run_fresh(folder, "mograft", "demo", "-o", "demo")
    if not (folder / "demo" / "index.html").exists():
        raise ValueError("mograft demo wrote no page demo/index.html")
    digest = hashlib.sha256((folder / "demo" / "dance_graft0.bvh").read_bytes()).hexdigest()
    print(f"SHA-256 of demo/dance_graft0.bvh: {digest}", flush=True)


_ORIGIN = """
import sys, mograft
print(mograft.__file__)
print(getattr(sys, "_is_gil_enabled", lambda: True)())
"""


def try_tests() -> None:
    """Run the tests of `release.suite` in the environment of the step `try-wheel`.

    Raises ValueError if a test fails, if mograft does not come from the wheel, or if importing it
    enables the GIL of a free-threaded Python.
    """
    folder = WORK / "wheel"
    words = ["-m", "pip", "install", "--quiet", "--only-binary", ":all:"]
    run_fresh(folder, "python", *words, *suite.list_requirements())
    path, has_gil = run_fresh(folder, "python", "-c", _ORIGIN, cwd=ROOT).split("\n")[:2]
    if not Path(path).is_relative_to(folder):
        raise ValueError(f"the environment of the wheels imports mograft from {path}")
    is_free = "import sysconfig; print(sysconfig.get_config_var('Py_GIL_DISABLED') or 0)"
    if run_fresh(folder, "python", "-c", is_free).strip() == "1" and has_gil == "True":
        raise ValueError("importing mograft enables the GIL")
    report = run_fresh(folder, "python", *suite.list_words(), cwd=ROOT)
    print(report.strip().splitlines()[-1], flush=True)


def try_types() -> None:
    """Check a project that uses the installed wheels with mypy and pyright in strict mode."""
    folder = WORK / "wheel"
    python = bin_of(folder / "venv") / "python"
    for name, text in (("good", _FOREIGN_PROJECT), ("wrong", _FOREIGN_PROJECT + _WRONG_LINE)):
        project = folder / name
        project.mkdir(exist_ok=True)
        (project / "main.py").write_text(text, encoding="utf-8")
        (project / "pyrightconfig.json").write_text('{"typeCheckingMode": "strict"}\n')
        for words in (
            ("mypy", "--strict", "--python-executable", python, "main.py"),
            ("pyright", "--pythonpath", python, "--project", project),
        ):
            try:
                run_tool(*words, cwd=project)
            except subprocess.CalledProcessError:
                if name == "good":
                    raise
            else:
                if name == "wrong":
                    raise ValueError(f"{words[0]} accepts a path in place of a library")


def try_sdists() -> None:
    """Install the source distributions with cargo but without a network, and run mograft.

    The crates of each one are vendored first, and cargo has an empty home.
    """
    # Files of source distributions have a fixed date, so cargo would keep crates of earlier runs.
    target = WORK / "target-sdist"
    shutil.rmtree(target, ignore_errors=True)
    folder = make_fresh_environment("sdist")
    run_fresh(folder, "python", "-m", "pip", "install", "--quiet", "maturin>=1.13,<2", "numpy")
    for distribution in DISTRIBUTIONS:
        (sdist,) = distribution.find_artifacts(DIST, ".tar.gz")
        with tarfile.open(sdist) as archive:
            archive.extractall(folder, filter="data")
        source = folder / sdist.name.removesuffix(".tar.gz")
        _vendor_crates(source)
        offline = {
            "CARGO_HOME": str(folder / "empty"),
            "CARGO_NET_OFFLINE": "true",
            "CARGO_TARGET_DIR": str(target),
            "RUSTUP_HOME": os.environ.get("RUSTUP_HOME") or str(Path.home() / ".rustup"),
        }
        words = ["-m", "pip", "install", "--quiet", "--no-index", "--no-build-isolation"]
        run_fresh(folder, "python", *words, source, rust=offline)
        run_fresh(folder, "python", "-c", f"import {distribution.extension}")
    run_demo(folder)


def _vendor_crates(source: Path) -> None:
    """Copy the crates of a source distribution into it, in the versions of its lock file.

    Without ``--locked``: the lock file lists crates of the whole workspace, of which the source
    distribution contains a part, and cargo removes the others.
    """
    process = subprocess.run(
        ["cargo", "vendor", "vendor"], cwd=source, check=True, capture_output=True, text=True
    )
    (source / ".cargo").mkdir()
    (source / ".cargo" / "config.toml").write_text(process.stdout, encoding="utf-8")
