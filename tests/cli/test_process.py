"""Commands as processes: exit codes, JSON output, and Ctrl-C."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from dataclasses import replace

import pytest

from mograft import read_bvh
from mograft.cli.syntax.parser import build_parsers
from mograft.dancer import dance
from mograft.formats import write_glb

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
    words = set(build_parsers())
    leaves = {each for each in words if not any(other[:-1] == each for other in words if other)}
    assert set(ARGUMENTS) == leaves - TESTED_ELSEWHERE


@pytest.mark.parametrize("words", sorted(ARGUMENTS), ids="-".join)
def test_json_every_command_accepts_addresses_and_prints_one_document(succeed, words):
    if words == ("plot",):
        pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    motion = dance(seed=1, strides=1).motion
    write_glb([replace(motion[:400], name="Rig|walk"), replace(motion[:90], name="x")], "pack.glb")
    places = {"CLIP": "pack.glb#walk", "LIB": "lib"}
    succeed("index", places["CLIP"], "-o", "lib")
    out, _ = succeed(*words, *(places.get(w, w) for w in ARGUMENTS[words]), "--json")
    kind, version = json.loads(out)["schema"].split("/")
    assert kind.startswith("mograft.")
    assert version.isdecimal()


@contextmanager
def running(*words):
    """Start a command as a process of its own; at the end of the block, kill what is left of it."""
    words = [sys.executable, "-u", "-m", "mograft", *map(str, words)]
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    child = subprocess.Popen(words, text=True, start_new_session=True, **pipes)
    try:
        yield child
    finally:
        with suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
        child.communicate()


def wait_until(condition, child=None):
    """Wait until the condition holds; fail if the process `child` ends before."""
    for _ in range(30_000):
        if condition():
            return
        assert not child or child.poll() is None, f"the process ended: {child.communicate()}"
        time.sleep(0.002)
    raise AssertionError("the condition never held")


def test_process_exit_codes(working_folder):
    path = working_folder / "bad.bvh"
    path.write_text("HIERARCHY\nnonsense\n")
    for words, code in ((["--version"], 0), (["graft", "a.bvh"], 2), (["info", path], 3)):
        with running(*words) as child:
            out, err = child.communicate()
        assert (child.returncode, bool(out), bool(err)) == (code, code == 0, code != 0)
    assert err.startswith(f"error: {path}:2:")


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
