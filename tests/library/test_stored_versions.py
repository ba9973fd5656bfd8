"""What earlier versions stored opens, verifies, grows and gives the same grafts."""

import json
import shutil
import sqlite3

import numpy as np
import pytest

import mograft as mg
from mograft.cli import main
from mograft.dancer import dance
from mograft.synthesis import replay as replay_module
from tests.library.make_stored_library import (
    DATA,
    N_FRAMES,
    describe_numbers,
    graft,
    is_released,
    write_clips,
    write_grafts,
)

VERSIONS = sorted(path.stem for path in DATA.glob("library-*.npz"))
GRAFTS = sorted(path.name.removesuffix(".tar.xz") for path in DATA.glob("grafts-*.tar.xz"))
KINDS = ("constraints", "edit", "groups", "library", "plain", "walk")

TOLERANCE = 1e-4
"""Of quaternions, and of positions in cm: the stored graft has single precision."""
TEXT_TOLERANCE = 2e-6
"""Of degrees and centimetres in BVH files, which hold six decimals."""


@pytest.fixture(params=VERSIONS)
def version(request):
    """The name of a stored library, such as ``library-0.1``."""
    return request.param


@pytest.fixture
def folder(version, tmp_path):
    """An unpacked copy of a stored library."""
    shutil.unpack_archive(DATA / f"{version}.tar.xz", tmp_path / version, filter="data")
    return tmp_path / version


@pytest.fixture(scope="module", params=GRAFTS)
def grafts(request, tmp_path_factory):
    """A folder with stored clips and grafts, beside the stored library."""
    folder = tmp_path_factory.mktemp("stored") / "grafts"
    shutil.unpack_archive(DATA / f"{request.param}.tar.xz", folder, filter="data")
    name = request.param.replace("grafts", "library")
    shutil.unpack_archive(DATA / f"{name}.tar.xz", folder.parent / name, filter="data")
    return folder


def has_same_numbers(grafts):
    """Return whether this machine rounds as the one that stored the grafts."""
    return json.loads((grafts / "numbers.txt").read_text()) == describe_numbers()


def numbers_of(path):
    """Return the numbers in the frames of a BVH file."""
    frames = path.read_text(encoding="utf-8").partition("Frame Time:")[2]
    return np.array(frames.split(), dtype=float)


def test_files_of_first_version_are_stored():
    assert "library-0.1" in VERSIONS
    assert "grafts-0.1" in GRAFTS


def test_stored_library_verifies(folder, capsys):
    assert main(["lib", "verify", str(folder)]) == 0, capsys.readouterr().err


def test_stored_library_gives_stored_graft(version, folder):
    new = graft(mg.Library.open(folder))
    with np.load(DATA / f"{version}.npz") as stored:
        donors = [[own.donor_start, own.donor_stop] for own in new.substitutions]
        assert donors == stored["donors"].tolist()
        assert len(donors) >= 2
        for name in ("rotations", "positions"):
            values = getattr(new.motion, name)
            np.testing.assert_allclose(values, stored[name], rtol=0, atol=TOLERANCE)


def test_stored_library_takes_new_clips(folder):
    library = mg.Library.open(folder)
    added = dance(seed=0, strides=1).motion[200:260]
    mg.write_bvh(added, folder.parent / "new.bvh")
    grown = library.add(folder.parent / "new.bvh")
    assert len(grown.clips) == len(library.clips) + 1
    np.testing.assert_array_equal(
        grown.segments.start[: len(library.segments)], library.segments.start
    )


@pytest.mark.parametrize("kind", KINDS)
def test_stored_provenance_replays(grafts, tmp_path, monkeypatch, kind):
    source, again = grafts / f"new_{kind}.json", tmp_path / "again.bvh"
    document = json.loads(source.read_text(encoding="utf-8"))
    is_same = has_same_numbers(grafts)
    if not is_same:  # replay compares the last bits, too
        monkeypatch.setattr(replay_module, "hash_poses", lambda _: document["poses_sha256"])
    assert main(["graft", "--from", str(source), "-o", str(again)]) == 0
    stored = source.with_suffix(".bvh")
    if is_same:
        assert again.read_bytes() == stored.read_bytes()
    np.testing.assert_allclose(numbers_of(again), numbers_of(stored), rtol=0, atol=TEXT_TOLERANCE)
    assert any(own["exchanged"] for own in document["substitutions"])


@pytest.fixture(scope="module")
def new_grafts(grafts, tmp_path_factory):
    """The folder of the stored grafts, made again from the clips and seeds."""
    parent = tmp_path_factory.mktemp("computed")
    name = grafts.parent / next(grafts.parent.glob("library-*"))
    shutil.copytree(name, parent / name.name)
    folder = parent / "grafts"
    folder.mkdir()
    for path in grafts.glob("[0-9].bvh"):
        shutil.copyfile(path, folder / path.name)
    write_grafts(folder, mg.Library.open(parent / name.name), read_config(grafts))
    return folder


def read_config(grafts):
    """Return the configuration to compute grafts with: None, the defaults, of a released version.

    Before the release of their version, defaults may change.
    """
    (name,) = (path.name for path in grafts.parent.glob("library-*"))
    if is_released(name.removeprefix("library-")):
        return None
    document = json.loads((grafts / "new_plain.json").read_text(encoding="utf-8"))
    return mg.Config.from_dict(document["config"])


@pytest.mark.parametrize("kind", KINDS)
def test_same_seed_gives_stored_graft(grafts, new_grafts, kind):
    name = f"new_{kind}"
    documents = [
        json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
        for folder in (new_grafts, grafts)
    ]
    donors = [
        [(own["group"], own["frames"], own["clip"], own["clip_frames"]) for own in document]
        for document in (own["substitutions"] for own in documents)
    ]
    assert donors[0] == donors[1]
    assert documents[1].keys() <= documents[0].keys()
    paths = [folder / f"{name}.bvh" for folder in (new_grafts, grafts)]
    if has_same_numbers(grafts):
        assert paths[0].read_bytes() == paths[1].read_bytes()
    numbers = [numbers_of(path) for path in paths]
    np.testing.assert_allclose(*numbers, rtol=0, atol=TEXT_TOLERANCE)


def describe_layout(folder):
    """Return files, keys, types and tables of a library, without values that clips decide."""
    (manifest,) = folder.glob("manifest.json")
    document = json.loads(manifest.read_text(encoding="utf-8"))
    layout = {"manifest": {key: type(value).__name__ for key, value in document.items()}}
    layout["version"] = document["version"]
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        name = path.relative_to(folder).as_posix()
        if path.suffix == ".npy":
            array = np.load(path, mmap_mode="r")
            layout[name] = (array.dtype.str, array.shape)
        elif path.suffix == ".sqlite":
            database = sqlite3.connect(path)
            layout[name] = sorted(map(str, database.execute("SELECT sql FROM sqlite_master")))
            database.close()
        else:
            layout[name] = "file"
    return layout


def test_present_layout_of_libraries_is_stored(tmp_path):
    # If this fails, libraries have another layout: raise FORMAT_VERSION in `library/storage.py`,
    # and run `python -m tests.library.make_stored_library`.
    newest = max(VERSIONS, key=lambda name: [int(n) for n in name.split("-")[1].split(".")])
    shutil.unpack_archive(DATA / f"{newest}.tar.xz", tmp_path / newest, filter="data")
    (tmp_path / "clips").mkdir()
    write_clips(tmp_path / "clips", N_FRAMES)
    library = mg.Library.index(tmp_path / "clips", tmp_path / "new")
    assert describe_layout(library.folder) == describe_layout(tmp_path / newest)
    if is_released(newest.removeprefix("library-")):
        stored = mg.Library.open(tmp_path / newest)
        assert library.config.as_dict() == stored.config.as_dict()
