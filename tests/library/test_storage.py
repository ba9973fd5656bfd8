"""Properties of stored libraries: reading returns what was written, and damage is reported."""

import contextlib
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft import (
    Config,
    InsufficientDataError,
    JointGroups,
    Library,
    LibraryError,
    MemoryBudgetError,
)
from mograft.analysis.embedding import Samples
from mograft.library.files import array_files, storage, stored_clips
from mograft.library.files.stored_clips import JoinedSamples
from mograft.motion import limits
from tests.fingerprint import fingerprint
from tests.hierarchies import DATA
from tests.library.checks import assert_same_libraries, list_files
from tests.strategies import few_examples, motions


@settings(max_examples=10, suppress_health_check=list(HealthCheck))
@given(motions(min_frames=60, min_joints=3), st.sampled_from((1.0, 2.0, 0.37)), st.booleans())
def test_save_and_open_restore_every_bit(tmp_path, motion, speed, paper):
    """For any skeleton, with several rates, with and without channels of a file."""
    names = list(motion.skeleton.names)
    groups = JointGroups({"base": names[:2], "rest": names[2:]}, base="base")
    other = replace(motion, frame_time=motion.frame_time * speed)
    numbers = motion.channel_numbers()
    numbers[: 2 * paper] = np.nan
    clips = [motion, other, replace(motion, channel_values=numbers)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        built = Library.build(clips, groups, Config.paper() if paper else Config())
    built.save(tmp_path / "l", force=True)
    assert_same_libraries(Library.open(tmp_path / "l"), built)
    assert storage.verify(tmp_path / "l") == []
    again = Library.open(tmp_path / "l")
    again.save(tmp_path / "copy", force=True)
    assert_same_libraries(Library.open(tmp_path / "copy"), built)


SCRIPT = """
import sys
from mograft import Library, graft, read_bvh, write_bvh
from mograft.dancer import dance
dances = [dance(seed=seed, strides=2).motion for seed in range(3)]
for name, clips in ("dances", dances), ("recordings", [*map(read_bvh, sys.argv[2:])]):
    if clips:
        library = Library.build(clips).with_mirror_images()
        library.save(f"{sys.argv[1]}/{name}")
        write_bvh(graft(library, seed=7).motion, f"{sys.argv[1]}/{name}.bvh")
"""


def test_library_and_graft_are_the_same_for_any_threads_and_kernel_of_the_blas(tmp_path):
    """The BLAS uses several threads for these matrices; mirrored axes have equal entries."""
    recordings, found = sorted((DATA / "dance_perfume_test").glob("*.bvh")), {}
    # Without a name OpenBLAS chooses the kernel of the processor; any x86-64 has the other one.
    for threads, kernel in ("1", ""), ("2", ""), ("3", ""), ("2", "Prescott"):
        folder = tmp_path / f"{threads}{kernel}"
        folder.mkdir()
        names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
        environment = {**os.environ, **dict.fromkeys(names, threads), "OPENBLAS_CORETYPE": kernel}
        command = [sys.executable, "-c", SCRIPT, str(folder), *map(str, recordings)]
        subprocess.run(command, env=environment, check=True)
        found[folder.name] = {
            own.relative_to(folder).as_posix(): own.read_bytes()
            for own in folder.rglob("*.*")
            if own.suffix in (".npy", ".bvh", ".sqlite")
        }
    first, second, third, other = found.values()
    assert first == second == third
    # The last bits of means and scales depend on the kernel.
    differing = {name for name in first if first[name] != other[name]}
    assert {Path(name).stem for name in differing} <= {"reference", "mean", "scale"}


@given(st.lists(st.integers(0, 35), max_size=9), st.booleans())
def test_joined_samples_are_rows_of_their_arrays_in_any_chunks(stored_library, indices, in_memory):
    whole = np.concatenate([chunk.rows for chunk in stored_library.samples.chunks()])
    ranges = np.array([(0, 5, 20), (0, 0, 3), (0, 40, 9)])
    known = replace(stored_library.samples, ranges=ranges)
    rows = np.concatenate([whole[first : first + n] for _, first, n in ranges])
    if in_memory:
        known = Samples(rows, known.n_samples, known.n_joints)
    samples = JoinedSamples.append(known, Samples(rows[:4] + 1, known.n_samples, known.n_joints))
    rows = np.concatenate([rows, rows[:4] + 1])
    with patch.object(stored_clips, "CHUNK", 7):
        chunks = [chunk.rows for chunk in samples.chunks()]
    assert [len(chunk) for chunk in chunks] == [7, 7, 7, 7, 7, 1]
    np.testing.assert_array_equal(np.concatenate(chunks), rows)
    indices = np.array(indices, int)
    np.testing.assert_array_equal(samples.select(indices).rows, rows[indices])


@pytest.mark.skipif(not os.path.exists("/proc/self/smaps"), reason="needs /proc/self/smaps")
@pytest.mark.parametrize("stem", ["frames", "samples"])
def test_clips_and_samples_that_were_read_leave_no_pages(stored_library, tmp_path, stem):
    # No other library has opened this copy.
    library = mg.Library.open(shutil.copytree(stored_library.folder, tmp_path / "own"))
    clips, samples = [own.rotations for own in library.clips], list(library.samples.chunks())
    (name,) = library.folder.rglob(f"{stem}-*.npy")
    with open("/proc/self/smaps") as stream:
        blocks = stream.read().split(f"{name}\n")[1:]
    sizes = [int(own.split("Rss:")[1].split()[0]) for own in blocks]
    assert sizes
    assert sum(sizes) == 0
    again = mg.Library.open(stored_library.folder)
    assert all(np.array_equal(own, again.clips[k].rotations) for k, own in enumerate(clips))
    assert fingerprint(samples) == fingerprint(list(again.samples.chunks()))


def test_arrays_are_valid_npy_files(small_library):
    for name, array in storage.read(small_library).arrays.items():
        loaded = np.load(small_library / "0001" / f"{name}.npy", allow_pickle=False)
        assert (loaded.dtype, loaded.shape) == (array.dtype, array.shape)
        assert loaded.tobytes() == array.tobytes()


@contextlib.contextmanager
def replaced(path, content):
    """Replace the content of a file, or remove it if `content` is None, and restore it."""
    before = path.read_bytes()
    path.unlink()
    try:
        if content is not None:
            path.write_bytes(content)
        yield
    finally:
        path.write_bytes(before)


@settings(max_examples=150)
@given(st.data(), st.sampled_from(["byte", "header", "truncated", "missing"]))
def test_damaged_file_is_reported_or_harmless(small_library, data, kind):
    """`open` compares sizes, not hashes; a damaged header must not map bytes beyond the file."""
    paths = list_files(small_library)
    if kind == "header":
        paths = [path for path in paths if path.suffix == ".npy"]
    path, intact = data.draw(st.sampled_from(paths), label="file"), Library.open(small_library)
    content = path.read_bytes()
    position = data.draw(st.integers(0, min(len(content), 128 if kind == "header" else 2**31) - 1))
    damaged = bytearray(content)
    damaged[position] = data.draw(st.integers(0, 255) | st.sampled_from(b"0123456789(),'"))
    contents = {"truncated": content[:position], "missing": None}
    with replaced(path, contents.get(kind, damaged)):
        if kind in contents:
            with pytest.raises(LibraryError, match=r"damaged|not a mograft library"):
                Library.open(small_library)
            return
        with contextlib.suppress(LibraryError):
            problems, arrays = storage.verify(small_library), storage.read(small_library).arrays
            for name, array in arrays.items():
                size = (small_library / "0001" / f"{name}.npy").stat().st_size
                assert array.nbytes == size - 128
            if not problems:
                assert_same_libraries(Library.open(small_library), intact)


@settings(max_examples=40)
@given(st.data())
def test_open_segment_outside_of_its_clip_raises_library_error(small_library, data):
    n_frames = np.array([entry.n_frames for entry in Library.open(small_library).entries])
    clips = np.load(small_library / "0001" / "clips.npy")
    row = data.draw(st.integers(0, len(clips) - 1), label="segment")
    name = data.draw(st.sampled_from(["starts", "stops"]))
    beyond = st.integers(int(n_frames[clips[row]]), 2**62)
    value = data.draw(beyond if name == "stops" else st.one_of(beyond, st.integers(-(2**62), -1)))
    path = small_library / "0001" / f"{name}.npy"
    array = np.load(path)
    array[row] = value
    header = path.read_bytes()[: -array.nbytes]
    with replaced(path, header + array.tobytes()), pytest.raises(LibraryError, match="damaged"):
        Library.open(small_library)


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ("DELETE FROM clip WHERE id = (SELECT MIN(id) FROM clip)", "catalog.sqlite: expected"),
        (f"UPDATE clip SET first_row = {2**63 - 1}", "manifest.json: samples end outside"),
    ],
)
def test_open_damaged_database_raises_library_error(small_library, change, place):
    path = small_library / "0001" / "catalog.sqlite"
    with replaced(path, path.read_bytes()):
        with contextlib.closing(sqlite3.connect(path)) as database, database:
            database.execute("PRAGMA foreign_keys = OFF")
            database.execute(change)
        with pytest.raises(LibraryError, match=f"is damaged: {place}"):
            Library.open(small_library)


def test_open_foreign_or_newer_library_raises_library_error(small_library, tmp_path):
    with pytest.raises(FileNotFoundError):
        Library.open(tmp_path / "nothing")
    with pytest.raises(LibraryError, match=r"not a mograft library: .* mograft index .* -o"):
        Library.open(tmp_path)
    (tmp_path / "a.bvh").write_text("HIERARCHY")
    with pytest.raises(LibraryError, match=r"a\.bvh is not a mograft library: it is a file"):
        Library.open(tmp_path / "a.bvh")
    shutil.copytree(small_library, tmp_path / "l")
    manifest = tmp_path / "l" / "manifest.json"
    document = json.loads(manifest.read_text())
    for change, message in (
        ({"version": 99, "mograft": "7.0"}, "format version 99, written by mograft 7.0"),
        ({"format": "other"}, "another format"),
        ({"rate": 31.0}, "damaged: .*checksum.*--force"),
    ):
        manifest.write_text(json.dumps({**document, **change}))
        with pytest.raises(LibraryError, match=message):
            Library.open(tmp_path / "l")
    manifest.write_text("{")
    with pytest.raises(LibraryError, match="not valid JSON"):
        storage.verify(tmp_path / "l")


def seal(folder, **changes):
    """Write the manifest of a library with changed entries and a new checksum."""
    document = json.loads((folder / "manifest.json").read_text()) | changes
    document["checksum"] = array_files.manifest_checksum(document)
    (folder / "manifest.json").write_text(json.dumps(document))


@pytest.mark.parametrize("name", ["/etc/hostname", "../secret.npy", "0001/../x.npy", "0001/a.pkl"])
def test_manifest_with_a_file_outside_the_generations_raises_library_error(
    small_library, tmp_path, name
):
    shutil.copytree(small_library, tmp_path / "l")
    seal(tmp_path / "l", files={name: {"bytes": 1, "sha256": ""}})
    for read in (storage.verify, Library.open):
        with pytest.raises(LibraryError, match="no file of a generation"):
            read(tmp_path / "l")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("MAX_JOINTS", 3, "expected at most 3 joints, got"),
        ("MAX_FRAMES", 9, "expected at most 9 frames, got"),
    ],
)
def test_library_beyond_limits_raises_library_error(small_library, name, value, message):
    with patch.object(limits, name, value), pytest.raises(LibraryError, match=message) as caught:
        list(Library.open(small_library).clips)
    assert str(caught.value).startswith(f"{small_library} is damaged: ")


HOSTILE = [None, -(10**20), 10**400, 1e300, "x", [], {}, True, [[1]], 2**63, {"": {}}]


@few_examples(60)
@given(st.data())
def test_sealed_manifest_with_any_value_grafts_or_raises_library_error(
    small_library, tmp_path_factory, data
):
    folder = tmp_path_factory.mktemp("sealed") / "l"
    shutil.copytree(small_library, folder)
    document = json.loads((folder / "manifest.json").read_text())
    container, key = document, data.draw(st.sampled_from(sorted(set(document) - {"checksum"})))
    while isinstance(container[key], dict) and container[key] and data.draw(st.booleans()):
        container = container[key]
        key = data.draw(st.sampled_from(sorted(container)))
    container[key] = data.draw(st.sampled_from(HOSTILE))
    seal(folder, **document)

    def use(folder):
        mg.graft(Library.open(folder))

    for read in (storage.verify, storage.list_leftovers, use):
        # A configuration can be valid and have no donors, or need more memory than there is.
        with contextlib.suppress(LibraryError, InsufficientDataError, MemoryBudgetError):
            read(folder)
