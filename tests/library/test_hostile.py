"""Libraries that somebody has changed on purpose, with a new checksum, raise LibraryError."""

import json
import os
import shutil
import sqlite3
import time
import warnings
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mograft import Library, LibraryError
from mograft.library.files import storage
from mograft.motion import limits
from tests.library.checks import list_files

ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x FROM n) SELECT {} FROM n"


def seal(folder, document):
    """Write a manifest with its checksum, and with the sizes and hashes of its files."""
    files = document.get("files")
    for name in files if isinstance(files, dict) else ():
        path = folder / name
        state = files[name]
        is_state = isinstance(state, dict) and isinstance(state.get("bytes"), int)
        if is_state and path.is_file() and path.stat().st_size < 1e7:
            files[name].update(storage.hash_files(folder, [name])[name])
    document["checksum"] = storage.manifest_checksum(document)
    (folder / "manifest.json").write_text(json.dumps(document))


def use(folder):
    """Open a library and read all that it holds."""
    storage.list_leftovers(folder)
    library = Library.open(folder)
    list(library.clips)
    for chunk in library.samples.chunks():
        assert np.ndim(chunk.rows) == 2
    library.pool("upper")
    library.to_dataframe()


@pytest.fixture
def copied_library(small_library, tmp_path):
    shutil.copytree(small_library, tmp_path / "l")
    return tmp_path / "l"


def put_value(*path, value):
    """Return a change of one entry of the manifest."""

    def change(folder, document):  # noqa: ARG001 - all changes have these arguments
        *parents, last = path
        for name in parents:
            document = document[name]
        document[last] = value

    return change


def rename_file(name, new):
    def change(folder, document):  # noqa: ARG001 - all changes have these arguments
        document["files"][new] = document["files"].pop(name)

    return change


def sql(script):
    def change(folder, document):  # noqa: ARG001 - all changes have these arguments
        database = sqlite3.connect(folder / "0001/catalog.sqlite")
        database.executescript("PRAGMA writable_schema=ON;" + script)
        database.close()

    return change


def replace_by_pipe(name):
    def change(folder, document):  # noqa: ARG001 - all changes have these arguments
        (folder / name).unlink()
        os.mkfifo(folder / name)

    return change


def replace_by_link(name, target):
    def change(folder, document):  # noqa: ARG001 - all changes have these arguments
        (folder / name).rename(folder.parent / "moved")
        (folder / name).symlink_to(target)

    return change


def array(name, values):
    def change(folder, document):  # noqa: ARG001 - all changes have these arguments
        stored = np.asarray(values)
        original = np.load(folder / "0001" / name)
        np.save(folder / "0001" / name, np.broadcast_to(stored, original.shape).copy())

    return change


def view(table, columns):
    names = ", ".join(f"1 AS {column}" for column in columns)
    return sql(f"DROP TABLE {table}; CREATE VIEW {table} AS {ENDLESS.format(names)};")


HOSTILE = {
    "no generation": lambda _, document: document.pop("generation"),
    "absolute generation": put_value("generation", value="/tmp"),
    "generation of another library": put_value("generation", value="../l/0001"),
    "generation with line break": put_value("generation", value="0001\n"),
    "short generation": put_value("generation", value="1"),
    "generation of another type": put_value("generation", value=1),
    "foreign shard": put_value("shards", value=["../0001"]),
    "unlisted shard": put_value("shards", value=["0002"]),
    "shard of another type": put_value("shards", value=[["0001"]]),
    "shards of another type": put_value("shards", value=None),
    "absolute file": rename_file("0001/starts.npy", "/etc/hostname"),
    "file of another folder": rename_file("0001/starts.npy", "0001/../../l/0001/starts.npy"),
    "file without folder": rename_file("0001/starts.npy", "starts.npy"),
    "file of another suffix": rename_file("0001/starts.npy", "0001/starts.pkl"),
    "file with NUL": rename_file("0001/starts.npy", "0001/starts\0.npy"),
    "files as list": put_value("files", value=[]),
    "no files": put_value("files", value={}),
    "size of another type": put_value(
        "files", "0001/starts.npy", value={"bytes": "1", "sha256": "0"}
    ),
    "state of another type": put_value("files", "0001/starts.npy", value=[]),
    "negative version": put_value("version", value=-1),
    "version of another type": put_value("version", value=True),
    "rate of zero": put_value("rate", value=0),
    "rate NaN": put_value("rate", value=float("nan")),
    "rate above all": put_value("rate", value=1e8),
    "rate as text": put_value("rate", value="30"),
    "root without joint": put_value("root", value=99),
    "no axis": put_value("up", value=3),
    "huge number of samples": put_value("config", "samples", value=10**15),
    "samples as text": put_value("config", "samples", value="ten"),
    "config as list": put_value("config", value=[1]),
    "field of another type": put_value("config", "sigma", value=[]),
    "groups in a file": put_value("groups", value="/dev/zero"),
    "groups without table": put_value("groups", value="\n"),
    "group without folder": put_value("group", "upper", value={}),
    "group in another folder": put_value("group", "upper", "folder", value="../0"),
    "group without arrays": put_value("group", "upper", "folder", value="7"),
    "group as list": put_value("group", value=[]),
    "no groups": put_value("group", value={}),
    "skeleton of another type": put_value("skeleton", value=3),
    "skeleton without joints": put_value("skeleton", "names", value=[]),
    "skeleton with a cycle": put_value("skeleton", "parents", value=[-1, *[17] * 17]),
    "end sites of another type": put_value("skeleton", "end_sites", value=[3]),
    "argument of the skeleton": put_value("skeleton", "other", value=3),
    "deep skeleton": put_value("rest", value={"names": ["a"], "parents": 1}),
    "endless view of clips": view("clip", ["id", "name"]),
    "endless view of skeletons": view("skeleton", ["id", "json"]),
    "endless view of refused files": view("refused", ["path", "reason"]),
    "no table of clips": sql("DROP TABLE clip;"),
    "no column": sql("ALTER TABLE clip DROP COLUMN frame_time;"),
    "generated column": sql(
        "ALTER TABLE refused DROP COLUMN reason;"
        "ALTER TABLE refused ADD COLUMN reason AS (hex(zeroblob(500000000)));"
    ),
    "invalid schema": sql("UPDATE sqlite_master SET sql = 'CREATE TABLE clip (' WHERE name='clip'"),
    "name of another type": sql("UPDATE clip SET name = x'00ff';"),
    "rate of a clip as text": sql("UPDATE clip SET rate = 'fast';"),
    "rate of a clip above all": sql("UPDATE clip SET rate = 1e9;"),
    "frame time of a clip above all": sql("UPDATE clip SET frame_time = 1e9;"),
    "frames of a clip as text": sql("UPDATE clip SET n_frames = 'many';"),
    "huge number of frames": sql("UPDATE clip SET own_frames = 1 << 60;"),
    "faults not JSON": sql("UPDATE clip SET faults = '[';"),
    "faults of another type": sql("UPDATE clip SET faults = '[1]';"),
    "deep faults": sql(f"UPDATE clip SET faults = '{'[' * 100_000}';"),
    "unknown shard of a clip": sql("UPDATE clip SET shard = 7;"),
    "negative shard of a clip": sql("UPDATE clip SET shard = -1;"),
    "clip behind its file": sql("UPDATE clip SET first_number = 9223372036854775000;"),
    "long clip": sql("UPDATE clip SET n_numbers = n_numbers + 1;"),
    "rows behind the file": sql("UPDATE clip SET first_row = 1;"),
    "unknown content": sql("UPDATE clip SET kind = 'pickle';"),
    "unknown skeleton": sql("UPDATE clip SET skeleton = 1;"),
    "skeleton not JSON": sql("UPDATE skeleton SET json = '';"),
    "skeleton of a clip as list": sql("UPDATE skeleton SET json = '[]';"),
    "path as number": sql("UPDATE clip SET path = x'01';"),
    "segments of unknown clips": array("clips.npy", 10**15),
    "segments of negative clips": array("clips.npy", -1),
    "clusters beyond the segments": array("0/labels.npy", 10**15),
    "segments behind the clip": array("stops.npy", 10**15),
    "segments before the clip": array("starts.npy", -5),
    "segments as floats": array("starts.npy", 0.5),
    "clusters as floats": array("1/labels.npy", 0.5),
    "manifest is a pipe": replace_by_pipe("manifest.json"),
    "array is a pipe": replace_by_pipe("0001/starts.npy"),
    "samples are a pipe": replace_by_pipe("0001/samples-0001.npy"),
    "database is a pipe": replace_by_pipe("0001/catalog.sqlite"),
    "array is a device": replace_by_link("0001/starts.npy", "/dev/zero"),
    "array outside": replace_by_link("0001/starts.npy", "../../moved"),
    "manifest outside": replace_by_link("manifest.json", "../moved"),
    "array links to itself": replace_by_link("0001/starts.npy", "starts.npy"),
    "generation outside": replace_by_link("0001", "../moved"),
    "group outside": replace_by_link("0001/0", "../../moved"),
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the platform has no pipes in folders")
@pytest.mark.parametrize("name", HOSTILE)
def test_open_hostile_library_raises_library_error_soon(copied_library, name):
    document = json.loads((copied_library / "manifest.json").read_text())
    HOSTILE[name](copied_library, document)
    path = copied_library / "manifest.json"
    if path.is_file() and not path.is_symlink():
        seal(copied_library, document)
    start = time.process_time()
    with pytest.raises(LibraryError):
        use(copied_library)
    assert time.process_time() - start < 2  # also if other processes are busy


def test_open_sealed_library_without_changes_is_accepted(copied_library):
    """Neither the seal of these tests nor a link to the library is a reason to refuse it."""
    seal(copied_library, json.loads((copied_library / "manifest.json").read_text()))
    link = copied_library.with_name("link")
    link.symlink_to(copied_library)
    (copied_library / "0001/starts.npy").rename(copied_library / "0001/same")
    (copied_library / "0001/starts.npy").symlink_to("same")
    use(link)
    assert storage.verify(link) == []


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=6,
)


def find_paths(value, path=()):
    """Yield the path of each entry of a JSON document."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for name, inner in items:
        yield (*path, name)
        if isinstance(inner, dict | list):
            yield from find_paths(inner, (*path, name))


@settings(max_examples=150, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_open_any_sealed_manifest_raises_only_library_error(small_library, data):
    """Any change of one entry of the manifest is harmless or raises LibraryError."""
    path = small_library / "manifest.json"
    content = path.read_bytes()
    document = json.loads(content)
    top = data.draw(st.sampled_from(sorted(set(document) - {"checksum", "mograft"})), label="top")
    inner = document[top]
    paths = list(find_paths(inner, (top,))) if isinstance(inner, dict | list) else []
    *parents, last = data.draw(st.sampled_from([(top,), *paths]), label="entry")
    target = document
    for name in parents:
        target = target[name]
    if data.draw(st.booleans(), label="remove"):
        target.pop(last)
    else:
        target[last] = data.draw(json_values, label="value")
    document["checksum"] = storage.manifest_checksum(document)
    try:
        path.write_text(json.dumps(document))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            use(small_library)
    except LibraryError:
        pass
    finally:
        path.write_bytes(content)


def test_verify_hostile_path_reads_no_other_file(copied_library, tmp_path):
    document = json.loads((copied_library / "manifest.json").read_text())
    rename_file("0001/starts.npy", "../secret.npy")(copied_library, document)
    (tmp_path / "secret.npy").write_bytes(b"secret")
    seal(copied_library, document)
    with pytest.raises(LibraryError, match="no file of its generation"):
        storage.verify(copied_library)


def test_write_lock_that_is_a_link_raises_library_error(copied_library, tmp_path):
    (copied_library / ".lock").unlink(missing_ok=True)
    (copied_library / ".lock").symlink_to(tmp_path / "created")
    with pytest.raises(LibraryError, match="not a regular file"):
        Library.open(copied_library).add(str(tmp_path))
    assert not (tmp_path / "created").exists()
    assert list_files(copied_library)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("MAX_JOINTS", 3, "expected at most 3 joints, got"),
        ("MAX_LEVELS", 2, "expected at most 2 levels of joints, got"),
        ("MAX_NAME_CHARACTERS", 2, "names of at most 2 characters, got one of"),
        ("MAX_FRAMES", 9, "expected at most 9 frames, got"),
    ],
)
def test_library_beyond_limits_raises_library_error(small_library, name, value, message):
    with patch.object(limits, name, value), pytest.raises(LibraryError, match=message) as caught:
        Library.open(small_library)
    assert str(caught.value).startswith(f"{small_library} is damaged: ")
