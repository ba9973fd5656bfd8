"""Laws of the FBX reader: world positions, rest poses, takes and damaged files."""

import sys

import numpy as np
import pytest

import mograft as mg
from tests.io.recorded_files import DATA

FOLDER = DATA / "fbx"
FILES = sorted(FOLDER.glob("*.fbx")) or [None]


@pytest.fixture(autouse=True)
def _extension():
    pytest.importorskip(
        "mograft_fbx", reason="mograft-fbx is not installed: pip install ./python-fbx"
    )


def recorded(name):
    path = FOLDER / name
    if not path.is_file():
        pytest.skip(f"{path} is absent")
    return path


@pytest.mark.parametrize("pose", ["bind", "stance"])
def test_fbx_recorded_pose_matches_bvh_of_same_figure(pose):
    clip = mg.read(recorded(f"Geno_{pose}.fbx"))[0]
    twin = mg.read_bvh(recorded(f"Geno_{pose}.bvh"))
    assert clip.skeleton.names == twin.skeleton.names
    np.testing.assert_array_equal(clip.skeleton.parents, twin.skeleton.parents)
    assert (clip.n_frames, round(clip.rate)) == (twin.n_frames, round(twin.rate))
    height = np.ptp(twin.world_positions()[0, :, 1])
    np.testing.assert_allclose(
        clip.world_positions(), twin.world_positions(), atol=1e-7 * height, rtol=0
    )


@pytest.mark.parametrize("path", FILES, ids=lambda path: path and path.stem)
def test_fbx_recorded_file_gives_finite_motions_of_stated_length(path):
    if path is None:
        pytest.skip(f"no files in {FOLDER}")
    clips = mg.read(path)
    for motion, length, name in zip(clips, clips.lengths, clips.names, strict=True):
        assert (motion.n_frames, motion.name) == (length.n_frames, name)
        assert motion.frame_time == pytest.approx(length.frame_time)
        assert np.isfinite(motion.world_positions()).all()
    assert len(clips) or "no clips" in clips.notes[-1]


def test_fbx_without_extension_error_names_installation(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "mograft_fbx", None)
    path = tmp_path / "walk.fbx"
    path.write_bytes(b"; FBX 7.4.0 project file\n")
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'mograft\[fbx\]'"):
        mg.read(path)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no FBX",
        b"Kaydara FBX Binary  \0\x1a\0",
        b"Kaydara FBX Binary  \0\x1a\0\xe8\x1c\0\0" + 99 * b"\xff",
    ],
)
def test_fbx_invalid_file_raises_format_error_with_path(tmp_path, content):
    path = tmp_path / "walk.fbx"
    path.write_bytes(content)
    with pytest.raises(mg.FormatError, match=r"walk\.fbx.*expected"):
        mg.read(path)
