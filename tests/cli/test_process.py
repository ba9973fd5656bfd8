"""Commands as processes: exit codes, JSON output, and Ctrl-C."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mograft import read_bvh
from mograft.cli import COMMANDS, main
from mograft.cli.parser import build_parsers

ARGUMENTS = {
    ("demo",): ["-o", "demo"],
    ("info",): ["CLIP"],
    ("check",): ["CLIP"],
    ("groups",): ["CLIP"],
    ("index",): ["CLIP", "-o", "new"],
    ("lib", "info"): ["LIB"],
    ("lib", "verify"): ["LIB"],
    ("lib", "export"): ["LIB", "--csv", "-o", "tables"],
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


def start(*words):
    """Start a command as a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-u", "-m", "mograft", *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_until(condition, child):
    """Wait until the condition holds, or the process has ended."""
    for _ in range(30_000):
        if child.poll() is not None or condition():
            return
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
    try:
        _, err = child.communicate(timeout=60)
    finally:
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGKILL)
    assert child.returncode == 130
    assert err.splitlines()[-1] == "interrupted"
    assert "Traceback" not in err
    return err


@posix_only
def test_demo_interrupted_leaves_complete_files(working_folder):
    child = start("demo", "-o", "demo")
    # The command has written the sample and builds the library.
    assert child.stdout.readline().startswith("sample ")
    interrupt(child)
    assert {path.name for path in assert_complete(working_folder)} == {"dance.bvh"}


@posix_only
def test_graft_interrupted_motions_have_provenance(working_folder, clip):
    child = start("graft", clip, "-o", "out", "-n", "200")
    wait_until(lambda: (working_folder / "out" / "a_graft1.bvh").exists(), child)
    interrupt(child)
    motions = assert_complete(working_folder / "out")
    assert len(motions) >= 2
    for path in motions:
        assert path.with_suffix(".json").exists()


@posix_only
@pytest.mark.parametrize("jobs", [1, 2])
def test_index_interrupted_keeps_old_library(working_folder, clip, jobs):
    (working_folder / "clips").mkdir()
    shutil.copy(clip, working_folder / "clips" / "c0.bvh")
    assert main(["index", "clips", "-o", "lib"]) == 0
    before = (working_folder / "lib" / "manifest.json").read_bytes()
    for number in range(1, 40):
        shutil.copy(clip, working_folder / "clips" / f"c{number}.bvh")
    child = start("index", "clips", "-o", "lib", "--add", "-j", str(jobs))
    seen = set((working_folder / "lib").rglob("*"))
    below = Path(f"/proc/{child.pid}/task/{child.pid}/children")
    if jobs > 1 and below.exists():
        # The workers have started: a traceback of theirs would appear on stderr.
        wait_until(lambda: len(below.read_text().split()) > jobs, child)
    else:
        wait_until(lambda: set((working_folder / "lib").rglob("*")) - seen, child)
    interrupt(child)
    assert (working_folder / "lib" / "manifest.json").read_bytes() == before
    assert main(["lib", "verify", "lib"]) == 0


@posix_only
@pytest.mark.parametrize("ending", ["gif", "mp4"])
def test_export_interrupted_film_leaves_no_file(working_folder, clip, ending):
    pytest.importorskip("PIL", reason="Pillow is not installed")
    if ending == "mp4":
        pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    child = start("export", clip, "-o", f"x.{ending}", "--size", "1920x1080")
    wait_until(lambda: any(path.suffix == ".part" for path in working_folder.iterdir()), child)
    interrupt(child)
    assert list(working_folder.iterdir()) == []
