"""Data sets in folders: the same bytes for any number of workers, also after kills."""

import contextlib
import csv
import hashlib
import itertools
import json
import os
import pickle
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import mograft as mg
from mograft import datasets
from mograft._util.workers import worker_processes
from mograft.dancer import dance
from mograft.datasets import measuring, shards, writing
from mograft.datasets.augmentation import PROVENANCE


def contents(folder):
    """The hash of every file of a folder, by name."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def provenance(folder):
    """The rows of the provenance of a data set."""
    with (folder / "provenance.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope="module")
def windows(stored):
    return replace(datasets.augment(stored, seconds=2.0, split="auto:clip", seed=4), variants=2)


@pytest.fixture(autouse=True)
def small_shards(monkeypatch):
    monkeypatch.setattr(writing, "SHARD_SIZE", 5)


@pytest.mark.parametrize("format_", list(shards.FORMATS))
def test_executors_give_the_same_bytes(windows, tmp_path, format_):
    if format_ in ("parquet", "lerobot"):
        parquet()
    sets = []
    with worker_processes(2) as processes, ThreadPoolExecutor(3) as threads:
        for number, executor in enumerate((processes, threads, None)):
            target = tmp_path / str(number)
            manifest = datasets.write(windows, target, 12, format=format_, executor=executor)
            sets.append(contents(target))
    found = sets[0]
    assert sets == [found] * 3
    files = [own for shard in manifest["shards"] for own in shard["files"]]
    files += manifest.get("files", [])
    listed = {own["file"]: own["sha256"] for own in files}
    others = ("manifest.json", "provenance.csv", ".lock")
    assert listed == {k: v for k, v in found.items() if k not in others}
    assert sum(shard["windows"] for shard in manifest["shards"]) == 12


def read_rows(folder, format_):
    """The windows of a data set, each a dict of arrays, which may be flat."""
    if format_ == "npz":
        return list(pickle.loads(pickle.dumps(datasets.read_set(folder))))
    if format_ == "parquet":
        paths = sorted(folder.glob("*.parquet"))
        return [row for path in paths for row in parquet().read_table(path).to_pylist()]
    with pytest.raises(ValueError, match=f"format npz, got {format_}"):
        datasets.read_set(folder)
    paths = sorted(folder.rglob(f"*.{format_}"))
    return [{"rotations": mg.read(path)[0].rotations} for path in paths]


def parquet():
    return pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")


@pytest.mark.parametrize(("format_", "atol"), [("npz", 0), ("parquet", 0), ("bvh", 1e-5)])
def test_rows_are_those_of_the_jobs(windows, tmp_path, format_, atol):
    expected = [window for job in range(9) for window in windows.run_job(job)[0]][:12]
    report = datasets.write(windows, tmp_path / "set", 12, format=format_)["report"]
    found = read_rows(tmp_path / "set", format_)
    for index, (row, window) in enumerate(zip(found, expected, strict=True)):
        assert row.pop("index", index) == row.pop("window", index) == index
        assert atol or row.keys() == window.features.keys()
        for name, own in row.items():
            array = window.features[name]
            np.testing.assert_allclose(np.reshape(own, array.shape), array, rtol=0, atol=atol)
    rows = provenance(tmp_path / "set")
    counts = [len(window.provenance) for window in expected]
    assert [int(row["window"]) for row in rows] == np.repeat(np.arange(12), counts).tolist()
    assert report["bases"] == len({row["base"] for row in rows})
    assert report["new_frames"] >= windows.min_new
    library, cut = windows.library, windows.library.segments
    usable = np.flatnonzero(library.is_donor & windows.part.clips[cut.clip])
    for group, labels in library.labels.items():
        columns = ("base", "start") if group == library.groups.base else ("clip", "clip_start")
        places = {tuple(row[name] for name in columns) for row in rows}
        used = [
            (library.names[clip], str(start)) in places
            for clip, start in zip(cut.clip, cut.start, strict=True)
        ]
        share = np.isin(labels[usable], labels[used]).mean()
        assert 0 < share < 1
        assert report["coverage"][group] == pytest.approx(share)


def count_windows(windows):
    """The number of windows of passes over all bases, until one gives nothing."""
    counts = (len(windows.run_job(job)[0]) for job in itertools.count())
    return sum(iter(lambda: sum(itertools.islice(counts, len(windows.bases))), 0))


def test_fewer_windows_are_written_if_no_more_exist(takes, tmp_path):
    library = mg.Library.build(
        [take[:130] for take in takes[:2]], config=mg.Config(max_stretch=0.02)
    )
    numbers = []
    for min_new in (0.0, 0.3, 1.0):
        windows = datasets.augment(library, seconds=2.0, min_new=min_new)
        windows = replace(windows, variants=8)
        folder = tmp_path / f"{min_new}"
        manifest = datasets.write(windows, folder, 100_000)
        numbers.append(manifest["report"]["windows"])
        assert numbers[-1] == count_windows(windows)
        assert datasets.write(windows, folder, 100_000, resume=True) == manifest
    assert 0 < numbers[0] < 100_000
    assert numbers == sorted(numbers, reverse=True)
    # No two windows of a base have the same donors.
    donors = {}
    for row in provenance(tmp_path / "0.3"):
        cells = [row[name] for name in PROVENANCE if name not in ("window", "draw")]
        donors.setdefault(row["window"], []).append(tuple(cells))
    assert len(set(map(tuple, donors.values()))) == len(donors) == numbers[1]


class _Ended(BaseException):
    pass


@pytest.mark.parametrize(("format_", "stops"), [("npz", range(1, 30)), ("lerobot", (1, 9, 20))])
def test_interrupted_calls_are_continued_with_the_same_bytes(
    windows, tmp_path, monkeypatch, format_, stops
):
    """The call ends at any write, or while the parts of the provenance are removed."""
    if format_ == "lerobot":
        parquet()
    datasets.write(windows, tmp_path / "whole", 23, format=format_)
    expected, n_ended = contents(tmp_path / "whole"), 0
    for stop in stops:
        steps = itertools.count()

        def end(function, steps=steps, stop=stop):
            def call(*arguments, **options):
                if next(steps) == stop:
                    raise _Ended
                return function(*arguments, **options)

            return call

        with monkeypatch.context() as patch:
            for module, name in (
                *((writing, "write_bytes"), (shards, "write_bytes"), (writing, "write_text")),
                *((os, "unlink"), (os, "rmdir")),
            ):
                patch.setattr(module, name, end(getattr(module, name)))
            with contextlib.suppress(_Ended):
                datasets.write(windows, tmp_path / "cut", 23, format=format_)
        n_ended += next(steps) == stop + 1
        datasets.write(windows, tmp_path / "cut", 23, format=format_, resume=True)
        assert contents(tmp_path / "cut") == expected, stop
        assert not (tmp_path / "cut" / ".provenance").exists()
        shutil.rmtree(tmp_path / "cut")
    assert n_ended > 2 * len(stops) / 3


def test_folder_of_other_options_is_refused(windows, stored, tmp_path):
    datasets.write(windows, tmp_path / "set", 5)
    before = contents(tmp_path / "set")
    with pytest.raises(FileExistsError, match="exists"):
        datasets.write(windows, tmp_path / "set", 5)
    own = {"seconds": 2.0, "split": "auto:clip", "seed": 4}
    others = {
        "`seed` 4, not 5": ({"seed": 5}, 5),
        "`seconds` 2, not 1.5": ({"seconds": 1.5, "stride": 2.0}, 5),
        "`stride` 2, not 0.5": ({"stride": 0.5}, 5),
        "`count` 5, not 6": ({}, 6),
        "another `features`": ({"features": ("root",)}, 5),
    }
    for message, (changed, count) in others.items():
        other = replace(datasets.augment(stored, **own | changed), variants=2)
        with pytest.raises(ValueError, match=f"holds a data set with {message}; use the options"):
            datasets.write(other, tmp_path / "set", count, resume=True)
    assert contents(tmp_path / "set") == before
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes/a.txt").write_text("mine")
    with pytest.raises(FileExistsError, match="other files"):
        datasets.write(windows, tmp_path / "notes", 5, resume=True)


def test_damaged_shard_is_named(windows, tmp_path):
    datasets.write(windows, tmp_path / "set", 5)
    path = tmp_path / "set/shard-00000.npz"
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(mg.MograftError, match=r"shard-00000.npz has changed"):
        datasets.write(windows, tmp_path / "set", 5, resume=True)
    with pytest.raises(mg.MograftError, match=r"shard-00000.npz is missing or has changed"):
        _ = datasets.read_set(tmp_path / "set")[0]


def test_library_that_changes_meanwhile_is_an_error(clip_folder, tmp_path):
    for path in clip_folder.glob("p0/*.bvh"):
        shutil.copy(path, tmp_path)
    windows = datasets.augment(mg.Library.index(tmp_path, tmp_path / "lib"), seconds=2.0)
    shutil.copy(next(clip_folder.glob("p1/*.bvh")), tmp_path)
    mg.Library.open(tmp_path / "lib").add(tmp_path)
    with worker_processes(2) as executor, pytest.raises(mg.LibraryError, match="changed"):
        datasets.write(windows, tmp_path / "set", 5, executor=executor)


def test_library_in_memory_needs_no_executor(takes, clip_folder, tmp_path, succeed):
    windows = datasets.augment(mg.Library.build(takes[:2]), seconds=2.0)
    with ThreadPoolExecutor(1) as executor, pytest.raises(ValueError, match="`executor`"):
        datasets.write(windows, tmp_path / "set", 5, executor=executor)
    assert not (tmp_path / "set").exists()
    assert datasets.write(windows, tmp_path / "set", 5)["report"]["windows"] == 5
    succeed("augment", clip_folder / "p0", "-o", tmp_path / "a", "-n", 3)


def test_command_and_python_give_the_same_bytes(stored, tmp_path, succeed):
    words = f"augment {stored.folder} -o {tmp_path}/cli -n 9 --seconds 1.5 --split auto:tag:p* "
    words += "--part train --features root,contacts --min-new 0.4 --seed 7 --json "
    words += "--bases p* --variety 0.8 --stride 0.5"
    out, err = succeed(*words.split())
    library = stored.relabelled(mg.Config.with_variety(0.8))
    windows = datasets.augment(
        library,
        seconds=1.5,
        stride=0.5,
        split="auto:tag:p*",
        features=["root", "contacts"],
        min_new=0.4,
        seed=7,
    )
    manifest = datasets.write(windows, tmp_path / "python", 9)
    assert contents(tmp_path / "cli") == contents(tmp_path / "python")
    assert json.loads(out) == {"schema": manifest["schema"], **manifest}
    assert "9 windows, 13.5 s" in err
    assert "clips; " in err


def test_measure_compares_grafts_of_the_set(windows, stored, tmp_path, monkeypatch, succeed):
    pytest.importorskip("sklearn", reason="scikit-learn is not installed")
    datasets.write(windows, tmp_path / "set", 12)
    built, compare = [], measuring.detectability
    monkeypatch.setattr(measuring, "detectability", lambda *arguments: built.append(arguments))
    rows = {int(own["window"]): own for own in provenance(tmp_path / "set")}
    shown = list(dict.fromkeys((own["base"], own["draw"]) for own in rows.values()))
    assert {draw for _, draw in shown} == {"0", "1"}
    found = datasets.read_set(tmp_path / "set")
    for limit, expected in ((2, [shown[0], shown[-1]]), (64, shown)):
        monkeypatch.setattr(measuring, "_MAX_GRAFTS", limit)
        datasets.measure(windows, tmp_path / "set")
        _, grafts, seed = built.pop()
        assert seed == windows.seed
        grafts = [own for several in grafts for own in several]
        for graft, (base, draw) in zip(grafts, expected, strict=True):
            assert graft.base.name == base
            for index, row in rows.items():
                if (row["base"], row["draw"]) == (base, draw):
                    own = graft.motion.rotations[int(row["base_start"]) : int(row["base_stop"]) + 1]
                    assert np.array_equal(own.astype(np.float32), found[index]["rotations"])
    monkeypatch.setattr(measuring, "detectability", compare)
    words = f"augment {stored.folder} -o {tmp_path}/cli -n 3 --seconds 2 --measure --json"
    out, err = succeed(*words.split())
    assert json.loads(out)["detectability"] is None
    assert "warning: detectability needs 60 windows at seams" in err


@pytest.mark.thorough
def test_measure_states_intervals(tmp_path, succeed):
    for seed in range(4):
        mg.write_bvh(dance(seed=seed, strides=2).motion, tmp_path / f"clips{seed}.bvh")
    mg.Library.index(tmp_path, tmp_path / "lib")
    words = f"augment {tmp_path}/lib -o {tmp_path}/set -n 60 --seconds 2 --measure --json"
    out, err = succeed(*words.split())
    found = json.loads(out)["detectability"]["seams"]["gross"]
    low, high = found["interval"]
    assert 0 <= low <= found["value"] <= high <= 1
    assert "AUC of classifiers, seams: 0." in err
