"""Commands as processes: exit codes, JSON output, and Ctrl-C."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from mograft import read_bvh
from mograft.cli import COMMANDS, main
from mograft.cli.syntax.parser import build_parsers

ARGUMENTS = {
    ("demo",): ["-o", "demo"],
    ("info",): ["CLIP"],
    ("check",): ["CLIP"],
    ("groups",): ["CLIP"],
    ("index",): ["CLIP", "-o", "new"],
    ("lib", "info"): ["LIB"],
    ("lib", "verify"): ["LIB"],
    ("lib", "export"): ["LIB", "--format", "csv", "-o", "tables"],
    ("candidates",): ["CLIP", "--segment", "3"],
    ("graft",): ["CLIP", "-o", "new.bvh"],
    ("view",): ["CLIP", "-o", "page.html"],
    ("plot",): ["energy", "CLIP", "-o", "x.png"],
    ("export",): ["CLIP", "-o", "x.npz"],
    ("doctor",): [],
    ("config", "show"): [],
}
"""Arguments of every command that prints results, except those in `TESTED_ELSEWHERE`."""

# completion prints a script, tests/evaluation covers evaluate, which takes long, and
# tests/synthesis/test_stream_server.py covers stream, which does not end.
TESTED_ELSEWHERE = {("completion",), ("evaluate",), ("stream",)}


def test_json_arguments_cover_every_command():
    words = set(build_parsers(COMMANDS))
    leaves = {each for each in words if not any(other[:-1] == each for other in words if other)}
    assert set(ARGUMENTS) == leaves - TESTED_ELSEWHERE


@pytest.mark.parametrize("words", sorted(ARGUMENTS), ids="-".join)
def test_json_every_command_prints_one_document(run, capsys, clip, words):
    if words == ("plot",):
        pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    main(["index", str(clip), "-o", "lib"])
    capsys.readouterr()
    places = {"CLIP": str(clip), "LIB": "lib"}
    code, out, _ = run(*words, *(places.get(w, w) for w in ARGUMENTS[words]), "--json")
    assert code == 0
    kind, version = json.loads(out)["schema"].split("/")
    assert kind.startswith("mograft.")
    assert version.isdecimal()


def start(*words, stdout=subprocess.PIPE):
    """Start a command as a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-u", "-m", "mograft", *map(str, words)],
        stdin=subprocess.DEVNULL,
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


@contextmanager
def running(*words, **options):
    """Start a command; at the end of the block, kill what is left of it."""
    child = start(*words, **options)
    try:
        yield child
    finally:
        with suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
        child.communicate()


def wait_until(condition, child):
    """Wait until the condition holds; fail if the process ends before."""
    for _ in range(30_000):
        if condition():
            return
        assert child.poll() is None, f"the process ended early: {child.communicate()}"
        time.sleep(0.002)
    raise AssertionError("the condition never held")


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["info", "CLIP"], 0),
        (["info", "none.bvh"], 1),
        (["graft", "CLIP"], 2),
        (["info", "BAD"], 3),
        (["graft", "CLIP", "-o", "x.bvh", "--reach", "5:LeftHand:0,9999,0"], 4),
    ],
)
def test_process_exit_codes(clip, working_folder, words, code):
    (working_folder / "bad.bvh").write_text("HIERARCHY\nnonsense\n")
    places = {"CLIP": clip, "BAD": working_folder / "bad.bvh"}
    child = start(*(places.get(word, word) for word in words))
    out, err = child.communicate()
    assert child.returncode == code
    assert (code == 0) == (err == "")
    assert (code == 0) == (out != "")
    assert "Traceback" not in err
    if code == 3:
        assert err.startswith(f"error: {working_folder / 'bad.bvh'}:2:")


def assert_complete(folder):
    """Assert that a folder contains only complete files; return the motions."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert [path for path in files if path.name.startswith(".")] == []
    motions = [path for path in files if path.suffix == ".bvh"]
    for path in motions:
        read_bvh(path, strict=True)
    for path in files:
        if path.suffix == ".json":
            json.loads(path.read_text())
    return motions


posix_only = pytest.mark.skipif(os.name != "posix", reason="Ctrl-C is a signal here")


def interrupt(child):
    """Send Ctrl-C to all processes of a command, as a terminal does."""
    os.killpg(child.pid, signal.SIGINT)
    _, err = child.communicate(timeout=60)
    assert child.returncode == 130
    assert err.splitlines()[-1] == "interrupted"
    assert "Traceback" not in err


@pytest.fixture
def one_line_pipe():
    """The writing end of a pipe that has room for one line of at most 200 bytes."""
    fcntl = pytest.importorskip("fcntl", reason="the platform has no such pipes")
    if not hasattr(fcntl, "F_SETPIPE_SZ"):
        pytest.skip("the platform has pipes of one size only")
    read_end, write_end = os.pipe()
    capacity = fcntl.fcntl(write_end, fcntl.F_SETPIPE_SZ, 4096)
    os.write(write_end, bytes(capacity - 200))
    yield write_end
    os.close(read_end)
    os.close(write_end)


@posix_only
def test_demo_interrupted_leaves_complete_files(working_folder, one_line_pipe):
    # The command writes the sample, prints a line, builds the library, and then waits in its next
    # line, as nobody reads the pipe.
    with running("demo", "-o", "demo", stdout=one_line_pipe) as child:
        wait_until((working_folder / "demo" / "dance.bvh").exists, child)
        interrupt(child)
    assert {path.name for path in assert_complete(working_folder)} == {"dance.bvh"}


@posix_only
def test_graft_interrupted_motions_have_provenance(working_folder, clip):
    with running("graft", clip, "-o", "out", "-n", "3000") as child:
        wait_until((working_folder / "out" / "a_graft1.bvh").exists, child)
        interrupt(child)
    motions = assert_complete(working_folder / "out")
    assert len(motions) >= 2
    for path in motions:
        assert path.with_suffix(".json").exists()


@posix_only
@pytest.mark.parametrize("jobs", [1, 2])
def test_index_interrupted_keeps_old_library(folder_of_many_clips, clip, jobs):
    assert main(["index", str(clip), "-o", "lib"]) == 0
    before = Path("lib/manifest.json").read_bytes()
    seen = set(Path("lib").rglob("*"))
    with running("index", folder_of_many_clips, "-o", "lib", "--add", "-j", jobs) as child:
        below = Path(f"/proc/{child.pid}/task/{child.pid}/children")
        if jobs > 1 and below.exists():
            # The workers have started: a traceback of theirs would appear on stderr.
            wait_until(lambda: len(below.read_text().split()) > jobs, child)
        else:
            wait_until(lambda: set(Path("lib").rglob("*")) - seen, child)
        interrupt(child)
    assert Path("lib/manifest.json").read_bytes() == before
    assert main(["lib", "verify", "lib"]) == 0


@posix_only
@pytest.mark.parametrize("ending", ["gif", "mp4"])
def test_export_interrupted_film_leaves_no_file(working_folder, slow_clip, ending):
    pytest.importorskip("PIL", reason="Pillow is not installed")
    if ending == "mp4":
        pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    # Pillow keeps all pictures of a GIF in memory: small ones suffice.
    options = ["--rate", "50", "--size", "64x64" if ending == "gif" else "1920x1080"]
    with running("export", slow_clip, "-o", f"x.{ending}", *options) as child:
        wait_until(lambda: any(path.suffix == ".part" for path in working_folder.iterdir()), child)
        interrupt(child)
    assert list(working_folder.iterdir()) == []
