"""Data sets of LeRobot v3.0 hold the windows of the other formats, and state where they are."""

import json
from dataclasses import replace

import numpy as np
import pytest

from mograft import datasets
from mograft.datasets import writing
from mograft.io import lerobot

parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")

N, SHARD, FEATURES = 12, 5, ("positions", "contacts", "rotations_6d")


@pytest.fixture(scope="module")
def folder(stored, tmp_path_factory):
    """A data set of three files in folders of two, and the same windows as NPZ."""
    target = tmp_path_factory.mktemp("sets")
    windows = datasets.augment(stored, seconds=1.5, features=FEATURES)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writing, "SHARD_SIZE", SHARD)
        patch.setattr(lerobot, "_CHUNK", 2)
        for format_ in ("npz", "lerobot"):
            datasets.write(windows, target / format_, N, format=format_)
    return target


def frames(folder):
    """All rows of the data, in the order of their files."""
    paths = sorted((folder / "lerobot/data").rglob("*.parquet"))
    assert [path.parts[-2:] for path in paths] == [
        ("chunk-000", "file-000.parquet"),
        ("chunk-000", "file-001.parquet"),
        ("chunk-001", "file-000.parquet"),
    ]
    rows = [row for path in paths for row in parquet.read_table(path).to_pylist()]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def test_states_are_the_features_and_actions_the_next_states(folder):
    rows, expected, actions = frames(folder), [], []
    for window in datasets.read_set(folder / "npz"):
        parts = [window[name].reshape(len(window[name]), -1) for name in FEATURES]
        states = np.concatenate(parts, axis=1).astype(np.float32)
        expected.append(states[:-1])
        actions.append(states[1:])
    np.testing.assert_array_equal(rows["observation.state"], np.concatenate(expected))
    np.testing.assert_array_equal(rows["action"], np.concatenate(actions))


def test_indices_and_offsets_agree(folder):
    rows, meta = frames(folder), folder / "lerobot/meta"
    info = json.loads((meta / "info.json").read_text())
    episodes = parquet.read_table(meta / "episodes/chunk-000/file-000.parquet").to_pylist()
    assert info["codebase_version"] == "v3.0"
    assert info["total_episodes"] == len(episodes) == N
    assert info["total_frames"] == len(rows["index"]) == sum(own["length"] for own in episodes)
    np.testing.assert_array_equal(rows["index"], np.arange(len(rows["index"])))
    np.testing.assert_allclose(rows["timestamp"], rows["frame_index"] / info["fps"], atol=1e-6)
    stop = 0
    for number, own in enumerate(episodes):
        assert (own["episode_index"], own["dataset_from_index"]) == (number, stop)
        stop = own["dataset_to_index"]
        span = slice(own["dataset_from_index"], stop)
        assert stop - span.start == own["length"]
        assert set(rows["episode_index"][span]) == {number}
        assert rows["frame_index"][span].tolist() == list(range(own["length"]))
        places = {"chunk_index": own["data/chunk_index"], "file_index": own["data/file_index"]}
        path = folder / "lerobot" / info["data_path"].format(**places)
        assert number in parquet.read_table(path)["episode_index"].to_pylist()
        assert own["tasks"] == parquet.read_table(meta / "tasks.parquet")["task"].to_pylist()
    for name, kind in info["features"].items():
        assert [rows[name].size // len(rows[name])] == kind["shape"]
        assert kind["names"] is None or len(set(kind["names"])) == kind["shape"][0]
        assert str(rows[name].dtype).startswith(kind["dtype"][:3])


def test_statistics_are_those_of_all_frames(folder):
    stats = json.loads((folder / "lerobot/meta/stats.json").read_text())
    rows = frames(folder)
    assert set(stats) == set(rows)
    for name, own in rows.items():
        own = own.reshape(len(own), -1).astype(float)
        for label in ("min", "max", "mean", "std"):
            expected = getattr(own, label)(axis=0)
            np.testing.assert_allclose(stats[name][label], expected, rtol=1e-9, atol=1e-9)
        assert stats[name]["count"] == [len(own)]


def test_pandas_reads_tasks_by_their_names(folder):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    tasks = pandas.read_parquet(folder / "lerobot/meta/tasks.parquet")
    assert tasks.index.tolist() == ["graft"]
    assert tasks.task_index.tolist() == [0]


def test_set_without_windows_is_whole(stored, tmp_path):
    windows = replace(datasets.augment(stored), min_new=2.0)
    manifest = datasets.write(windows, tmp_path / "set", 3, format="lerobot")
    assert manifest["report"]["windows"] == 0
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    assert info["total_frames"] == info["total_episodes"] == 0


def test_features_of_another_rate_are_refused(tmp_path, stored):
    windows = datasets.augment(stored, seconds=1.5)
    object.__setattr__(windows, "features", ("root", "humanml3d"))
    with pytest.raises(ValueError, match="`format` lerobot needs a row for each frame"):
        datasets.write(windows, tmp_path / "set", 2, format="lerobot")
    assert not list(tmp_path.iterdir())
