"""Commands in a limited address space: one line of error, no abort, no draft."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mograft import write_bvh
from mograft.dancer import dance

resource = pytest.importorskip("resource", reason="the platform has no limits of processes")

COMMANDS = {
    "view": ["view", "long.bvh", "-o", "view.html"],
    "graft": ["graft", "long.bvh", "-o", "graft.bvh"],
    "index": ["index", "long.bvh", "-o", "library"],
    "export": ["export", "long.bvh", "-o", "arrays.npz"],
    "csv": ["export", "long.bvh", "-o", "table.csv"],
    "check": ["check", "long.bvh"],
}


@pytest.fixture(scope="module")
def long_clip(tmp_path_factory):
    """A BVH file whose numbers take 27 MB in memory."""
    path = tmp_path_factory.mktemp("long") / "long.bvh"
    write_bvh(dance(seed=1, strides=1).motion, path)
    hierarchy, _, motion = path.read_text().partition("Frames:")
    n, frame_time, frames = motion.split("\n", 2)
    repeats = -(-60_000 // int(n))
    path.write_text(f"{hierarchy}Frames: {repeats * int(n)}\n{frame_time}\n{frames * repeats}")
    return path


def run_limited(words, megabytes):
    """Run a command whose address space is limited."""
    limit = (megabytes << 20, megabytes << 20)
    return subprocess.run(
        [sys.executable, "-m", "mograft", *words],
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},  # each thread takes address space
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, limit),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


# Python, NumPy and the package take about 200 MB of the address space.
CASES = [(name, megabytes) for name in COMMANDS for megabytes in range(230, 800, 30)]
QUICK = [("view", 260), ("graft", 350), ("index", 290)]
MARKED = [
    pytest.param(*case, marks=() if case in QUICK else pytest.mark.thorough) for case in CASES
]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the limit is that of Linux")
@pytest.mark.parametrize(("name", "megabytes"), MARKED)
def test_command_without_memory_ends_with_one_line_and_no_file(
    long_clip, working_folder, name, megabytes
):
    Path("long.bvh").symlink_to(long_clip)
    child = run_limited(COMMANDS[name], megabytes)
    assert child.returncode in (0, 1), child.stderr
    assert child.returncode == 1 or (name, megabytes) not in QUICK
    if child.returncode == 1:
        assert child.stderr.splitlines()[-1].startswith("error: out of memory")
        assert {path.name for path in working_folder.iterdir()} == {"long.bvh"}
