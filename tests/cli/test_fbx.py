"""Commands on the takes of an FBX file."""

import json

import pytest

import mograft as mg
from mograft.dancer import dance
from tests.io import fbx_scenes as fbx


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """An FBX file with two takes, and the motion of the dancer of which they are parts."""
    reason = "mograft-fbx is not installed: pip install ./python-fbx"
    pytest.importorskip("mograft_fbx", reason=reason)
    motion = dance(seed=1, strides=1).motion[:600]
    path = tmp_path_factory.mktemp("rig") / "rig.fbx"
    scene = fbx.scene_of_motions([motion[:300], motion[300:]], ("Rig|walk", "Rig|turn"))
    path.write_bytes(fbx.to_binary(scene))
    return path, motion


def test_info_lists_takes_of_fbx(run, rig):
    code, out, _ = run("info", rig[0])
    assert code == 0
    assert "FBX, 2 clips, 18 joints" in out
    assert "#Rig|turn: 300 frames at 30 fps, 9.97 s" in out
    assert "note: lengths are in units of 0.01 m" in out


def test_graft_of_fbx_takes_exchanges_parts(run, rig, tmp_path):
    path, _ = rig
    out = tmp_path / "out"
    code, _, err = run("graft", path, "--base", f"{path}#walk", "--variety", "1", "-o", out)
    assert code == 0, err
    (written,) = out.glob("*.bvh")
    provenance = json.loads(written.with_suffix(".json").read_text())
    assert any(entry["exchanged"] for entry in provenance["substitutions"])
    assert mg.read_bvh(written).skeleton.names == mg.read(path)[0].skeleton.names
    again = tmp_path / "again.bvh"
    code, _, err = run("graft", "--from", written.with_suffix(".json"), "-o", again)
    assert code == 0, err
    assert again.read_bytes() == written.read_bytes()
