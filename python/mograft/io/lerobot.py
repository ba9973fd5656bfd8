"""Files of LeRobot v3.0, from arrays; the action of a frame is the state of the next one."""

import io
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray
from mograft._util.extras import import_extra

Array = npt.NDArray[Any]

_TASK = "graft"
_CHUNK = 1000  # files in a folder
_PATH = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_COUNTERS = ("timestamp", "frame_index", "episode_index", "index", "task_index")
_STATES = ("observation.state", "action")


def to_parquet(columns: dict[str, Any], index: str | None = None) -> bytes:
    """Return a Parquet file of columns; two axes give a list in each row.

    `index` names the column that is the index of a DataFrame of pandas.
    """
    arrow = import_extra("pyarrow", "Parquet needs pyarrow", "parquet")
    parquet = import_extra("pyarrow.parquet", "Parquet needs pyarrow", "parquet")
    for name, own in columns.items():
        if isinstance(own, np.ndarray) and own.ndim == 2:
            flat = arrow.array(own.reshape(-1))
            columns[name] = arrow.FixedSizeListArray.from_arrays(flat, own.shape[1])
    table, buffer = arrow.table(columns), io.BytesIO()
    if index is not None:
        kinds: dict[str, Any] = {"name": index, "field_name": index, "pandas_type": "unicode"}
        kinds |= {"numpy_type": "object", "metadata": None}
        note = {"index_columns": [index], "columns": [kinds], "column_indexes": []}
        table = table.replace_schema_metadata({"pandas": json.dumps(note)})
    parquet.write_table(table, buffer)
    return buffer.getvalue()


def episode_file(states: Array, number: int, first: int, rate: float) -> tuple[str, bytes]:
    """Return file `number` of the data: its path, and its contents.

    `states`, shape (n_episodes, n_frames, n_values), are those of the episodes from `first` on,
    which have the same number of frames at `rate` per second. The last frame is only an action.
    """
    n, length = len(states), states.shape[1] - 1
    episode, frame = np.divmod(np.arange(n * length), length)
    columns = [own.reshape(n * length, -1) for own in (states[:, :-1], states[:, 1:])]
    columns += [(frame / rate).astype(np.float32), frame, first + episode]
    columns += [first * length + np.arange(n * length), np.zeros(n * length, np.int64)]
    names = _STATES + _COUNTERS
    return _data_path(number), to_parquet(dict(zip(names, columns, strict=True)))


def meta_files(
    folder: Path, counts: Sequence[int], n_frames: int, rate: float, names: Sequence[str]
) -> list[tuple[str, bytes]]:
    """Return the paths and contents of the files that describe a data set in a folder.

    `counts` has the number of episodes in each file of the data, `names` those of the values.
    """
    n, length, rate = sum(counts), n_frames - 1, round(rate, 3)
    state: dict[str, Any] = {"dtype": "float32", "shape": [len(names)], "names": list(names)}
    features = dict.fromkeys(_STATES, state)
    for name in _COUNTERS:
        kind = "float32" if name == "timestamp" else "int64"
        features[name] = {"dtype": kind, "shape": [1], "names": None}
    info: dict[str, Any] = {"codebase_version": "v3.0", "robot_type": None, "total_episodes": n}
    info |= {"total_frames": n * length, "total_tasks": 1, "chunks_size": _CHUNK}
    info |= {"data_files_size_in_mb": 100, "video_files_size_in_mb": 200}
    info |= {"fps": int(rate) if rate.is_integer() else rate, "splits": {"train": f"0:{n}"}}
    info |= {"data_path": f"data/{_PATH}", "video_path": None, "features": features}
    starts = np.arange(n) * length
    shard = np.repeat(np.arange(len(counts)), np.array(counts, np.int64))
    episodes: dict[str, Any] = {"episode_index": np.arange(n), "tasks": [[_TASK]] * n}
    episodes |= {"length": np.full(n, length), "dataset_from_index": starts}
    episodes |= {"dataset_to_index": starts + length, "data/chunk_index": shard // _CHUNK}
    episodes |= {"data/file_index": shard % _CHUNK}
    episodes |= dict.fromkeys(("meta/episodes/chunk_index", "meta/episodes/file_index"), 0 * shard)
    stats = _statistics(folder / _data_path(number) for number in range(len(counts)))
    tasks = {"task_index": np.zeros(1, np.int64), "task": [_TASK]}
    return [
        ("meta/info.json", json.dumps(info, indent=1).encode()),
        ("meta/stats.json", json.dumps(stats, indent=1).encode()),
        ("meta/tasks.parquet", to_parquet(tasks, "task")),
        ("meta/episodes/" + _PATH.format(chunk_index=0, file_index=0), to_parquet(episodes)),
    ]


def _data_path(number: int) -> str:
    chunk, file = divmod(number, _CHUNK)
    return "data/" + _PATH.format(chunk_index=chunk, file_index=file)


def _statistics(paths: Iterable[Path]) -> dict[str, dict[str, list[float]]]:
    """Return the least, greatest and mean values of all columns, and their standard deviations."""
    parquet = import_extra("pyarrow.parquet", "Parquet needs pyarrow", "parquet")
    parts: dict[str, list[FloatArray]] = {}
    for path in paths:
        table = parquet.read_table(path)
        for name in table.column_names:
            column = table[name].combine_chunks()
            flat = column.flatten() if name in _STATES else column
            rows = flat.to_numpy().astype(float).reshape(len(table), -1)
            n, mean = np.full(rows.shape[1], len(rows)), rows.mean(axis=0)
            own = (rows.min(axis=0), rows.max(axis=0), mean, rows.var(axis=0), n)
            parts.setdefault(name, []).append(np.stack(own))
    found = {}
    for name, several in parts.items():
        low, high, means, variances, n = np.stack(several, axis=1)
        total = n.sum(axis=0)
        mean = (n * means).sum(axis=0) / total
        spread = np.sqrt((n * (variances + (means - mean) ** 2)).sum(axis=0) / total)
        values = (low.min(axis=0), high.max(axis=0), mean, spread, total[:1].astype(int))
        labels = ("min", "max", "mean", "std", "count")
        found[name] = {k: own.tolist() for k, own in zip(labels, values, strict=True)}
    return found
