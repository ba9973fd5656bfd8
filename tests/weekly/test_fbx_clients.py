"""World positions of recorded FBX files agree with those of Blender's own FBX importer.

Blender's importer does not read text files, versions before 7100, animation layers and
interpolation other than linear. The files in which these occur are compared otherwise or at keys
only, in `test_fbx`.
"""

from pathlib import Path

import numpy as np
import pytest

import mograft as mg
from mograft.io.fbx import load_scene
from tests.clients import blender_fbx, run_with_blender
from tests.io.recorded_files import DATA, require

FOLDER = DATA / "fbx"
EXAMPLE = Path(__file__).parents[2] / "examples" / "blender" / "grafts_to_fbx.py"
FIGURES = (
    "Geno_bind",
    "Geno_stance",
    "quaternius_Horse",
    "quaternius_Male_Casual",
    "quaternius_Smooth_Male_Suit",
    "quaternius_Velociraptor",
    "ufbx_blender_279_sausage_7400_binary",
)
KEYED_FRAMES = np.array([1, 11, 21, 36, 46, 53, 63, 73, 80, 89, 96, 120]) - 1
"""Frames with keys in the file of interpolation modes."""


@pytest.fixture(autouse=True)
def _extension():
    reason = "mograft-fbx is not installed: pip install ./python-fbx"
    pytest.importorskip("mograft_fbx", reason=reason)


def read_recorded(name):
    """Return the clips of a file, and Blender's positions of the joints of each clip, in metres."""
    path = require(FOLDER / f"{name}.fbx")
    clips, times = mg.read(path), {}
    takes = load_scene(path, path.read_bytes()).takes
    for (name, span, key_span, _), motion in zip(takes, clips, strict=True):
        begin = (span if span[1] > span[0] else key_span)[0]
        times[name] = (begin + np.arange(motion.n_frames) * motion.frame_time).tolist()
    places = blender_fbx()(path, times)["places"]
    positions = [
        np.array([[heads[joint] for joint in motion.skeleton.names] for heads in places[name]])
        for name, motion in zip(times, clips, strict=True)
    ]
    return clips, positions


def metres(clips):
    """Return the metres in the unit of the file."""
    return float(clips.notes[0].removeprefix("lengths are in units of ").removesuffix(" m"))


def in_blender(motion, clips):
    """Return world positions in metres with z up."""
    x, y, z = np.moveaxis(motion.world_positions() * metres(clips), -1, 0)
    return np.stack([x, -z, y], axis=-1)


@pytest.mark.client
@pytest.mark.parametrize("name", FIGURES)
def test_fbx_world_positions_match_blender(name):
    clips, positions = read_recorded(name)
    for motion, expected in zip(clips, positions, strict=True):
        height = metres(clips) * np.ptp(motion.skeleton.rest_positions(), axis=0).max()
        np.testing.assert_allclose(in_blender(motion, clips), expected, atol=1e-4 * height, rtol=0)


@pytest.mark.client
def test_fbx_interpolation_modes_match_blender_at_keys():
    clips, (expected,) = read_recorded("ufbx_maya_interpolation_modes_7500_binary")
    places = in_blender(clips[0], clips)[KEYED_FRAMES]
    extent = np.ptp(expected)
    np.testing.assert_allclose(places, expected[KEYED_FRAMES], atol=1e-4 * extent, rtol=0)


@pytest.mark.client
@pytest.mark.parametrize("name", ["quaternius_Male_Casual", "Geno_stance"])
def test_fbx_written_by_example_script_has_world_positions_of_grafts(name, tmp_path):
    source = require(FOLDER / f"{name}.fbx")
    clips = mg.read(source)
    motions = {"first": clips[0][:12], "last": clips[-1][:8]}
    for stem, motion in motions.items():
        mg.write_bvh(motion, tmp_path / f"{stem}.bvh")
    target = tmp_path / "out.fbx"
    paths = [str(tmp_path / f"{stem}.bvh") for stem in motions]
    run_with_blender(EXAMPLE, str(source), str(target), str(metres(clips)), *paths)
    written = mg.read(target)
    assert [name.rpartition("|")[2] for name in written.names] == sorted(motions)
    for motion, expected in zip(written, motions.values(), strict=True):
        joints = [motion.skeleton.names.index(name) for name in expected.skeleton.names]
        places = motion.world_positions()[:, joints] * metres(written)
        wanted = expected.world_positions() * metres(clips)
        np.testing.assert_allclose(places, wanted, atol=1e-4 * np.ptp(wanted), rtol=0)
