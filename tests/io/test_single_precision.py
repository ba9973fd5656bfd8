"""Formats of single precision refuse values that would become infinite, and leave no file."""

import dataclasses

import pytest

from mograft import formats
from mograft.dancer import dance

MOTION = dance(strides=1).motion[:4]


def with_position(motion, frame, joint, value):
    positions = motion.positions.copy()
    positions[frame, joint, 1] = value
    return dataclasses.replace(motion, positions=positions)


def with_offset(motion, joint, value):
    offsets = motion.skeleton.offsets.copy()
    offsets[joint, 1] = value
    skeleton = motion.skeleton
    return dataclasses.replace(motion, skeleton=dataclasses.replace(skeleton, offsets=offsets))


WRITERS = {
    "glb": lambda motion, path: formats.write_glb(motion, path, scale=1.0),
    "usda": lambda motion, path: formats.write_usd(motion, path, scale=1.0),
    "npz": formats.write_npz,
}


@pytest.mark.parametrize("suffix", WRITERS)
def test_write_position_beyond_single_precision_names_joint_and_frame(tmp_path, suffix):
    if suffix == "usda":
        pytest.importorskip("pxr", reason="usd-core is not installed")
    name = MOTION.skeleton.names[3]
    with pytest.raises(ValueError, match=rf"position of {name} in frame 2 .* got 1e\+39"):
        WRITERS[suffix](with_position(MOTION, 2, 3, 1e39), tmp_path / f"a.{suffix}")
    assert list(tmp_path.iterdir()) == []
    WRITERS[suffix](with_position(MOTION, 2, 3, 1e30), tmp_path / f"a.{suffix}")


@pytest.mark.parametrize("suffix", ["glb", "usda"])
def test_write_rest_position_beyond_single_precision_names_joint(tmp_path, suffix):
    if suffix == "usda":
        pytest.importorskip("pxr", reason="usd-core is not installed")
    name = MOTION.skeleton.names[3]
    with pytest.raises(ValueError, match=rf"rest position of {name} must"):
        WRITERS[suffix](with_offset(MOTION, 3, 1e39), tmp_path / f"a.{suffix}")
    assert list(tmp_path.iterdir()) == []


def test_write_glb_scale_beyond_single_precision_is_refused(tmp_path):
    with pytest.raises(ValueError, match="rest position of"):
        formats.write_glb(MOTION, tmp_path / "a.glb", scale=1e39)
