"""NPZ and CSV files."""

import csv
import io

import numpy as np
import pytest
from hypothesis import given

from mograft import write_bvh
from mograft.formats import read_npz, write_csv, write_npz
from tests import strategies


@given(strategies.motions(max_frames=20))
def test_npz_round_trip_has_precision_of_float32(tmp_path_factory, motion):
    path = tmp_path_factory.mktemp("npz") / "m.npz"
    write_npz(motion, path)
    again = read_npz(path)
    strategies.assert_same_rotations(again.rotations, motion.rotations, atol=1e-6)
    np.testing.assert_allclose(again.positions, motion.positions, rtol=1e-6, atol=1e-30)
    assert again.frame_time == motion.frame_time
    assert again.skeleton.names == motion.skeleton.names
    np.testing.assert_array_equal(again.skeleton.offsets, motion.skeleton.offsets)
    with np.load(path, allow_pickle=False) as data:
        np.testing.assert_array_equal(
            data["world_positions"], motion.world_positions().astype(np.float32)
        )


def test_npz_keeps_channels_and_end_sites_and_is_deterministic(motion, tmp_path):
    for name in ("a", "b"):
        write_npz(motion, tmp_path / f"{name}.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    again = read_npz(tmp_path / "a.npz")
    assert again.skeleton.channels == motion.skeleton.channels
    assert again.name == "dance"
    for actual, expected in zip(again.skeleton.end_sites, motion.skeleton.end_sites, strict=True):
        assert (actual.parent, actual.before, actual.name) == (
            expected.parent,
            expected.before,
            expected.name,
        )
        np.testing.assert_array_equal(actual.offset, expected.offset)
    write_bvh(again, tmp_path / "again.bvh")


@pytest.mark.parametrize("content", [b"", b"PK\3\4broken", b"no archive", None])
def test_read_npz_invalid_file_raises_value_error_naming_it(tmp_path, content):
    path = tmp_path / "m.npz"
    if content is None:
        np.savez(path, x=np.zeros(3))
    else:
        path.write_bytes(content)
    with pytest.raises(ValueError, match=r"m\.npz"):
        read_npz(path)
    with pytest.raises(FileNotFoundError):
        read_npz(tmp_path / "none.npz")


def test_write_csv_holds_world_positions(motion, tmp_path):
    write_csv(motion, tmp_path / "m.csv")
    rows = list(csv.reader(io.StringIO((tmp_path / "m.csv").read_text())))
    assert rows[0][:5] == ["frame", "time", "Hips.x", "Hips.y", "Hips.z"]
    table = np.array(rows[1:], float)
    np.testing.assert_array_equal(table[:, 0], np.arange(motion.n_frames))
    np.testing.assert_allclose(table[:, 1], np.arange(motion.n_frames) / 30, rtol=1e-8)
    world = motion.world_positions().reshape(motion.n_frames, -1)
    np.testing.assert_allclose(table[:, 2:], world, rtol=1e-8, atol=1e-8)
