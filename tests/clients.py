"""Other programs that read files of mograft; the tests skip without them."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

FETCHED = Path(__file__).parents[1] / ".clients"
"""Folder of the programs that `tests.fetch` downloads."""

NODE_MODULES = Path(os.environ.get("MOGRAFT_NODE_MODULES") or FETCHED / "node_modules").resolve()

AXE = Path(os.environ.get("MOGRAFT_AXE") or FETCHED / "axe/node_modules/axe-core/axe.min.js")
"""The script of axe-core, which finds faults of accessibility in pages."""

_VALIDATE = """
const validator = require("gltf-validator");
const data = require("fs").readFileSync(process.argv[2]);
validator.validateBytes(new Uint8Array(data), {maxIssues: 20})
  .then((report) => console.log(JSON.stringify(report.issues)));
"""

_START = """
import bpy, json, sys, time

def poses(owner, moments):
    found = []
    for at in moments:
        bpy.context.scene.frame_set(int(at), subframe=at - int(at))
        bpy.context.view_layer.update()
        world = owner.matrix_world
        if owner.type == "ARMATURE":
            found.append({b.name: list(world @ b.head) for b in owner.pose.bones})
        else:
            found.append({owner.name: list(world.translation)})
    return found

def show(owner, action):
    owner.animation_data.action = action
    if hasattr(action, "slots"):  # older versions of Blender have none
        owner.animation_data.action_slot = action.slots[0]

def frame_rate():
    return bpy.context.scene.render.fps / bpy.context.scene.render.fps_base

words = json.loads(sys.argv[1])
bpy.ops.wm.read_factory_settings(use_empty=True)
"""
"""What the scripts share. Each computes `result`."""

_IMPORT = """
path, frames, rate = words
if path.endswith(".bvh"):
    bpy.ops.import_anim.bvh(filepath=path, axis_forward="-Z", axis_up="Y",
                            update_scene_fps=True, update_scene_duration=True)
    first, step = bpy.context.scene.frame_start, 1.0
elif path.endswith(".usdc"):
    bpy.ops.wm.usd_import(filepath=path)
    first, step = 0, 1.0
else:
    bpy.ops.import_scene.gltf(filepath=path)
    first, step = 0, frame_rate() / rate
figure = next(o for o in bpy.data.objects if o.type == "ARMATURE")
result = {"heads": poses(figure, [first + frame * step for frame in frames])}
"""

# The keys of a take are one frame later than their times.
_IMPORT_FBX = """
path, takes, n_runs, operator = words
group, name = operator.split(".")
result = {"places": {}, "seconds": [], "processor_seconds": []}
for run in range(n_runs):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    start, used = time.perf_counter(), time.process_time()
    getattr(getattr(bpy.ops, group), name)(filepath=path)
    result["seconds"].append(time.perf_counter() - start)
    result["processor_seconds"].append(time.process_time() - used)
used = time.process_time()
objects = sorted(bpy.data.objects, key=lambda o: (o.type != "ARMATURE", not o.animation_data))
figure = objects[0] if objects else None
for name, times in takes.items():
    actions = [a for a in bpy.data.actions if a.name.startswith(f"{figure.name}|{name}"[:63])]
    if actions:
        show(figure, actions[0])
    result["places"][name] = poses(figure, [1 + moment * frame_rate() for moment in times])
result["pose_seconds"] = time.process_time() - used
"""


def gltf_validator():
    """Return a function from a GLB file to the messages of the Khronos validator."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node, which runs the glTF validator, is not installed")
    if not (NODE_MODULES / "gltf-validator").is_dir():
        pytest.skip("the glTF validator is not installed: python -m tests fetches it by npm")

    def validate(path):
        with tempfile.TemporaryDirectory() as scratch:
            script = Path(scratch) / "validate.js"
            script.write_text(_VALIDATE)
            completed = subprocess.run(
                [node, script, path],
                capture_output=True,
                text=True,
                check=True,
                env={**os.environ, "NODE_PATH": str(NODE_MODULES)},
            )
        issues = json.loads(completed.stdout)
        assert issues["numErrors"] + issues["numWarnings"] == len(
            [m for m in issues["messages"] if m["severity"] < 2]
        )
        return issues["messages"]

    return validate


def blender():
    """Return a function from a file and frames to the bone heads that Blender imports."""
    python = _blender_python()
    return lambda path, frames, rate: _run_blender(python, _IMPORT, [str(path), frames, rate])


def blender_fbx():
    """Return a function from an FBX file, and times of its takes, to what Blender imports.

    The result has `places`, the heads of the bones by take, time and name, and for each of `n_runs`
    imports by `operator` its time, `seconds`, and that of the processor, `processor_seconds`.
    `pose_seconds` is the processor time for the places.
    """
    python = _blender_python()

    def import_file(path, takes, n_runs=1, operator="import_scene.fbx"):
        return _run_blender(python, _IMPORT_FBX, [str(path), takes, n_runs, operator])

    return import_file


def run_with_blender(script, *arguments):
    """Run a script of the examples with bpy."""
    words = [_blender_python(), script, "--", *arguments]
    completed = subprocess.run(words, capture_output=True, text=True, check=False)
    assert not completed.returncode, completed.stderr


def _blender_python():
    """Return the Python that has bpy; skip the test without it."""
    python = os.environ.get("MOGRAFT_BPY_PYTHON")
    if python is None:
        pytest.skip(
            "Blender is not installed: pip install bpy in a separate environment, and set "
            "MOGRAFT_BPY_PYTHON to its python"
        )
    return python


def _run_blender(python, script, arguments):
    """Run a script in a process of its own, as bpy needs another version of NumPy."""
    script = f"{_START}{script}print('RESULT' + json.dumps(result))"
    words = [python, "-c", script, json.dumps(arguments)]
    completed = subprocess.run(words, capture_output=True, text=True, check=False)
    lines = [line for line in completed.stdout.splitlines() if line.startswith("RESULT")]
    if not lines:
        print(completed.stdout, completed.stderr, file=sys.stderr)
        raise AssertionError("Blender failed; its output is on stderr")
    return json.loads(lines[0][6:])
