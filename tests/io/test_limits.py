"""The limits of skeletons and motions hold for every format; errors name file, value and limit."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

import mograft as mg
from mograft import formats
from mograft.motion import limits
from tests.hierarchies import human
from tests.io import bvh_helpers, fbx_scenes
from tests.io.npz_files import amass_arrays, kimodo_arrays
from tests.strategies import still_motion

N_FRAMES = 12
LIMITS = {
    "joints": ("MAX_JOINTS", "expected at most {} joints, got"),
    "levels": ("MAX_LEVELS", "expected at most {} levels of joints, got"),
    "frames": ("MAX_FRAMES", "expected at most {} frames, got 12"),
    "short frames": ("MIN_FRAME_TIME", "expected .*frame.time.* of {:g} to 1000 seconds, got"),
    "long frames": ("MAX_FRAME_TIME", "expected .*frame.time.* of 1e-05 to {:g} seconds, got"),
    "names": ("MAX_NAME_CHARACTERS", "expected names of at most {} characters, got"),
}


def make_motion():
    still = still_motion(human(), N_FRAMES)
    positions = still.positions.copy()
    positions[:, 0, 0] += np.linspace(0.0, 1.0, N_FRAMES)
    return replace(still, positions=positions, name="walk")


def write_fbx(motion, path):
    pytest.importorskip("mograft_fbx", reason="mograft-fbx is not installed")
    own = motion.skeleton
    columns = zip(own.names, own.parents.tolist(), own.offsets.tolist(), strict=True)
    nodes = tuple(fbx_scenes.Node(name, parent, T=offset) for name, parent, offset in columns)
    layer = fbx_scenes.Layer({(0, "T"): motion.positions[:, 0]})
    take = fbx_scenes.Take("walk", motion.n_frames, (layer,))
    path.write_bytes(fbx_scenes.to_binary(fbx_scenes.Scene(nodes, (take,))))


def write_usd(motion, path):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    formats.write_usd(motion, path)


WRITERS = {
    "walk.bvh": mg.write_bvh,
    "walk.glb": formats.write_glb,
    "walk.fbx": write_fbx,
    "walk.npz": formats.write_npz,
    "walk.usda": write_usd,
    "amass.npz": lambda _, path: np.savez(path, **amass_arrays(n_frames=N_FRAMES)),
    "kimodo.npz": lambda _, path: np.savez(path, **kimodo_arrays(n_frames=N_FRAMES)[0]),
}
"""Writers of a motion by the name of the file."""


def tightest(motion, name):
    """Return the value of a limit that a motion just fulfils, and one that it violates."""
    skeleton = motion.skeleton
    depths = [1 + len(skeleton.ancestors(joint)) for joint in range(skeleton.n_joints)]
    counts = {
        "MAX_JOINTS": skeleton.n_joints,
        "MAX_LEVELS": max(depths),
        "MAX_FRAMES": motion.n_frames,
        "MAX_NAME_CHARACTERS": max(map(len, skeleton.names)),
    }
    if name in counts:
        return counts[name], counts[name] - 1
    factor = 1.001 if name == "MIN_FRAME_TIME" else 1 / 1.001
    return motion.frame_time / factor, motion.frame_time * factor


# AMASS and Kimodo determine the skeleton, and files of Kimodo do not state the rate.
FIXED = {"amass.npz": ("joints", "levels", "names")}
FIXED["kimodo.npz"] = (*FIXED["amass.npz"], "short frames", "long frames")
CASES = [(file, own) for file in WRITERS for own in LIMITS if own not in FIXED.get(file, ())]


@pytest.mark.parametrize(("file", "limit"), CASES)
def test_file_beyond_limit_raises_error_with_file_value_and_limit(tmp_path, file, limit):
    path = tmp_path / file
    WRITERS[file](make_motion(), path)
    motion = mg.read(path)[0]
    name, message = LIMITS[limit]
    fulfilled, violated = tightest(motion, name)
    with patch.object(limits, name, fulfilled):
        assert mg.read(path)[0].n_frames == N_FRAMES
    bvh_helpers.read(bvh_helpers.TEXT)  # the reader remembers the hierarchy that it read last
    with patch.object(limits, name, violated):
        with pytest.raises(mg.FormatError, match=message.format(violated)) as caught:
            mg.read(path)[0]
        assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize("file", ["walk.bvh", "walk.npz"])
def test_name_of_end_site_beyond_limit_raises_error(tmp_path, file):
    motion, path = make_motion(), tmp_path / file
    n = max(map(len, motion.skeleton.names))
    site = mg.EndSite(motion.n_joints - 1, [0.0, 1.0, 0.0], name="x" * (n + 1))
    named = replace(motion, skeleton=replace(motion.skeleton, end_sites=(site,)))
    WRITERS[file](named, path)
    with patch.object(limits, "MAX_NAME_CHARACTERS", n):
        with pytest.raises(mg.FormatError, match=f"at most {n} characters, got") as caught:
            mg.read(path)[0]
        assert str(caught.value).startswith(str(path))


# The reader of FBX files has a lower limit, and deeper chains take seconds in GLB and USD files.
@pytest.mark.parametrize(
    ("file", "n"),
    [
        *((f"walk.{own}", limits.MAX_LEVELS) for own in ("bvh", "npz")),
        *((f"walk.{own}", 998) for own in ("glb", "fbx", "usda")),
    ],
)
def test_chain_of_the_greatest_depth_is_read(tmp_path, file, n):
    names = [f"j{joint}" for joint in range(n)]
    skeleton = mg.Skeleton(names, np.arange(-1, n - 1), np.eye(3)[[1] * n])
    WRITERS[file](still_motion(skeleton, 2), tmp_path / file)
    found = mg.read(tmp_path / file)[0]
    assert found.n_joints == n
    heights = found.world_positions()[0, :, 1]
    assert heights[-1] / heights[0] == pytest.approx(n, rel=1e-4)


def test_resample_beyond_limit_of_frames_raises_value_error():
    part = make_motion()[:11]
    with patch.object(limits, "MAX_FRAMES", 11):
        for rate in (60.0, 1e300, 10.6 / part.duration):  # the last one: 12 frames after rounding
            with pytest.raises(ValueError, match="`rate` must give at most 11 frames, got"):
                part.resample(rate)
        assert part.resample(10.4 / part.duration).n_frames == 11


@pytest.mark.parametrize("seconds", [0.0, -1.0, 9e-6, 1001.0])
def test_motion_of_other_frame_time_raises_value_error(seconds):
    with pytest.raises(ValueError, match=r"`frame_time` of 1e-05 to 1000 seconds, got"):
        replace(make_motion(), frame_time=seconds)
