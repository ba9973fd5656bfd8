"""Other programs that read our files, or the reason why they are not there."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

FETCHED = Path(__file__).parents[1] / ".clients"
"""Where `tests.fetch` puts what it fetches."""

NODE_MODULES = Path(os.environ.get("MOGRAFT_NODE_MODULES") or FETCHED / "node_modules").resolve()

_VALIDATE = """
const validator = require("gltf-validator");
const data = require("fs").readFileSync(process.argv[2]);
validator.validateBytes(new Uint8Array(data), {maxIssues: 20})
  .then((report) => console.log(JSON.stringify(report.issues)));
"""

_LOOK = """
import bpy, json, sys
path, frames, rate = json.loads(sys.argv[1])
bpy.ops.wm.read_factory_settings(use_empty=True)
if path.endswith(".bvh"):
    bpy.ops.import_anim.bvh(filepath=path, axis_forward="-Z", axis_up="Y",
                            update_scene_fps=True, update_scene_duration=True)
    first, step = bpy.context.scene.frame_start, 1.0
elif path.endswith(".usdc"):
    bpy.ops.wm.usd_import(filepath=path)
    first, step = 0, 1.0
else:
    bpy.ops.import_scene.gltf(filepath=path)
    scene = bpy.context.scene
    first, step = 0, scene.render.fps / scene.render.fps_base / rate
scene = bpy.context.scene
figure = next(o for o in bpy.data.objects if o.type == "ARMATURE")
heads = []
for frame in frames:
    at = first + frame * step
    scene.frame_set(int(at), subframe=at - int(at))
    bpy.context.view_layer.update()
    heads.append({b.name: list(figure.matrix_world @ b.head) for b in figure.pose.bones})
print("RESULT" + json.dumps({"heads": heads, "actions": [a.name for a in bpy.data.actions]}))
"""


def gltf_validator():
    """Return a function that gives what the Khronos validator says of a GLB file."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node, which runs the glTF validator")
    if not (NODE_MODULES / "gltf-validator").is_dir():
        pytest.skip("no glTF validator: python -m tests fetches it where there is npm")

    def validate(path):
        with tempfile.TemporaryDirectory() as scratch:
            script = Path(scratch) / "validate.js"
            script.write_text(_VALIDATE)
            told = subprocess.run(
                [node, script, path],
                capture_output=True,
                text=True,
                check=True,
                env={**os.environ, "NODE_PATH": str(NODE_MODULES)},
            )
        issues = json.loads(told.stdout)
        assert issues["numErrors"] + issues["numWarnings"] == len(
            [m for m in issues["messages"] if m["severity"] < 2]
        )
        return issues["messages"]

    return validate


def blender():
    """Return a function that gives where Blender sees the bones of a file begin."""
    python = os.environ.get("MOGRAFT_BPY_PYTHON")
    if python is None:
        pytest.skip(
            "no Blender: pip install bpy in an environment of its own, and set "
            "MOGRAFT_BPY_PYTHON to its python"
        )

    def look(path, frames, rate):
        # Blender's own numpy and ours differ: a process for each.
        told = subprocess.run(
            [python, "-c", _LOOK, json.dumps([str(path), frames, rate])],
            capture_output=True,
            text=True,
            check=False,
        )
        lines = [line for line in told.stdout.splitlines() if line.startswith("RESULT")]
        if not lines:
            print(told.stdout, told.stderr, file=sys.stderr)
            raise AssertionError("Blender did not finish; see what it said")
        return json.loads(lines[0][6:])

    return look
