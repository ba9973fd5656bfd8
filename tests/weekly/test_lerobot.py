"""LeRobot opens the data sets that `mograft augment --format lerobot` writes."""

import numpy as np
import pytest

import mograft as mg
from mograft import datasets
from mograft.dancer import dance

N_WINDOWS = 70  # more than a file holds


def test_lerobot_opens_a_data_set(tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hub"))
    reason = "lerobot is not installed"
    lerobot = pytest.importorskip("lerobot.datasets.lerobot_dataset", reason=reason)
    library = mg.Library.build(dance(strides=2).motion)
    windows = datasets.augment(library, seconds=1.0, stride=0.1)
    datasets.write(windows, tmp_path / "set", N_WINDOWS, format="lerobot")
    datasets.write(windows, tmp_path / "npz", N_WINDOWS)
    shifts = {"observation.state": [0.0, 1.0 / 30.0]}
    found = lerobot.LeRobotDataset("local/grafts", tmp_path / "set", delta_timestamps=shifts)
    length, first = 29, datasets.read_set(tmp_path / "npz")[66]
    assert (found.num_episodes, found.num_frames, found.fps) == (70, 70 * length, 30)
    item = found[66 * length + 3]
    states = item["observation.state"].numpy()
    assert (int(item["episode_index"]), item["task"]) == (66, "graft")
    n = first["rotations"][0].size
    np.testing.assert_array_equal(states[:, :n], first["rotations"][3:5].reshape(2, -1))
    np.testing.assert_array_equal(states[1], item["action"].numpy())
    np.testing.assert_allclose(
        found.meta.stats["action"]["max"], found.hf_dataset.with_format("numpy")["action"][:].max(0)
    )
