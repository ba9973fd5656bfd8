"""Commands as processes: exit codes, JSON output, and Ctrl-C."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress

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
    ("augment",): ["CLIP", "-o", "set", "-n", "3", "--seconds", "1"],
    ("find",): ["CLIP", "LIB", "--frames", "10-30"],
    ("curate",): ["LIB"],
    ("view",): ["CLIP", "-o", "page.html"],
    ("plot",): ["energy", "CLIP", "-o", "x.png"],
    ("export",): ["CLIP", "-o", "x.npz"],
    ("doctor",): [],
    ("config", "show"): [],
}
"""Arguments of every command that prints results, except those in `TESTED_ELSEWHERE`."""

# completion prints a script, tests/evaluation covers evaluate, which takes long;
# tests/stream and tests/studio cover play, stream and studio, which send or do not end.
TESTED_ELSEWHERE = {("completion",), ("evaluate",), ("play",), ("stream",), ("studio",)}


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
    ("words", "code"), [(["info", "CLIP"], 0), (["graft", "CLIP"], 2), (["info", "BAD"], 3)]
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
