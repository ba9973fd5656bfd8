"""Run every check of the project: ``python -m tests [--thorough]``.

`tests.fetch` first downloads the programs that read files of mograft, if there is a network, and
installs the extension that reads FBX, if there is a C compiler. Checks of Rust follow, then style
and types, then the tests. Every check runs even if an earlier one failed; the exit code is 1 if any
failed.

pytest uses one process per processor, at most `MAX_PROCESSES`. All tests of a file run in the same
process, because they share fixtures. ``-n 0`` runs all tests in one process. So does
``--thorough``: its largest inputs would not fit into memory several times. So does an environment
without pytest-xdist.
"""

import importlib.util
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from tests.fetch import fetch, has_c_compiler

PYTHON = sys.executable
MAX_PROCESSES = 4
_PARALLEL = [
    *("-n", "auto", "--maxprocesses", str(MAX_PROCESSES)),
    *("--dist", "loadfile", "--no-loadscope-reorder"),  # the shortest files, doctests, come last
]
_IN_FBX = ["--manifest-path", "python-fbx/Cargo.toml"]
_FBX_CHECKS = (
    ("rust format of FBX", ["cargo", "fmt", "--all", *_IN_FBX, "--check"]),
    (
        "clippy of FBX",
        ["cargo", "clippy", *_IN_FBX, "--workspace", "--all-targets", "--", "-D", "warnings"],
    ),
    ("rust tests of FBX", ["cargo", "test", *_IN_FBX, "--workspace", "--quiet"]),
)
CHECKS = (
    ("rust format", ["cargo", "fmt", "--check"]),
    ("clippy", ["cargo", "clippy", "--workspace", "--all-targets", "--", "-D", "warnings"]),
    ("rust tests", ["cargo", "test", "--workspace", "--quiet"]),
    *(_FBX_CHECKS if has_c_compiler() else ()),
    ("ruff format", [PYTHON, "-m", "ruff", "format", "--check"]),
    ("ruff", [PYTHON, "-m", "ruff", "check"]),
    ("layers", [str(Path(PYTHON).with_name("lint-imports"))]),
    ("mypy", [PYTHON, "-m", "mypy"]),
    ("stubtest", [PYTHON, "-m", "mypy.stubtest", "mograft._core"]),
    ("pytest", [PYTHON, "-m", "pytest"]),
)
_LINKAGE = ["-p", "mograft-linkage"]
THOROUGH_CHECKS = (
    ("large trees", ["cargo", "test", "--release", *_LINKAGE, "--", "--ignored"]),
    ("documentation of linkage", ["cargo", "rustdoc", *_LINKAGE, "--", "-D", "warnings"]),
    ("package of linkage", ["cargo", "publish", "--dry-run", "--allow-dirty", *_LINKAGE]),
    ("release", [PYTHON, "-m", "release", "--dry-run"]),
)


def main(arguments):
    if shutil.which("cargo") is None:
        print("cargo is needed: see https://rustup.rs", file=sys.stderr)
        return 1
    # The bindings are compiled for the Python that runs this script.
    print(f"Python {sysconfig.get_python_version()} at {PYTHON}", flush=True)
    print("\n== programs that read files of mograft", flush=True)
    fetch()
    failed = []
    for name, command in CHECKS + (THOROUGH_CHECKS if "--thorough" in arguments else ()):
        extra = _pytest_arguments(arguments) if name == "pytest" else []
        print(f"\n== {name}: {' '.join([*command, *extra])}", flush=True)
        if subprocess.run([*command, *extra], check=False).returncode:
            failed.append(name)
    print(f"\n{'failed: ' + ', '.join(failed) if failed else 'all checks passed'}", flush=True)
    return 1 if failed else 0


def _pytest_arguments(arguments):
    is_parallel = "--thorough" not in arguments and importlib.util.find_spec("xdist") is not None
    folders = ["tests", "python", "tests/weekly"] if "--thorough" in arguments else []
    return [*(_PARALLEL if is_parallel else ()), *arguments, *folders]


sys.exit(main(sys.argv[1:]))
