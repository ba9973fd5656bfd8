"""`mograft.write` chooses the writer by the ending and never replaces a file unasked."""

import hashlib
import json
import os
import signal
import warnings
from pathlib import Path

import pytest

import mograft as mg
from mograft import formats
from mograft.dancer import dance
from mograft.library.discover import find_clips
from mograft.provenance.graft_record import read_record
from mograft.viewing.scene import Scene

MOTION = dance(strides=1).motion[:40]


@pytest.fixture(scope="module")
def new():
    """A graft whose base came from no file."""
    return mg.graft(mg.Library.build(dance(strides=1).motion), seed=1)


@pytest.mark.parametrize("ending", [".bvh", ".csv", ".glb", ".npz"])
def test_write_motion_equals_writer_of_format(tmp_path, ending):
    mg.write(MOTION, tmp_path / f"a{ending.upper()}")
    getattr(formats, f"write_{ending[1:]}")(MOTION, tmp_path / f"b{ending}")
    assert (tmp_path / f"a{ending.upper()}").read_bytes() == (tmp_path / f"b{ending}").read_bytes()


def test_write_graft_writes_motion_and_provenance(tmp_path, new):
    mg.write(new, tmp_path / "new.bvh")
    again = mg.replay(tmp_path / "new.json", new.library)
    assert (again.motion.rotations == new.motion.rotations).all()
    mg.write(new, tmp_path / "table.csv")
    mg.write(new, tmp_path / "figure.glb")  # the base has no glTF file to which it is added
    assert not list(tmp_path.glob("[tf]*.json"))


@pytest.mark.parametrize("taken", ["new.bvh", "new.json"])
def test_write_existing_file_is_kept_unless_forced(tmp_path, new, taken):
    (tmp_path / taken).write_text("mine")
    with pytest.raises(FileExistsError, match=f"{taken} exists"):
        mg.write(new, tmp_path / "new.bvh")
    assert [path.name for path in tmp_path.iterdir()] == [taken]
    assert (tmp_path / taken).read_text() == "mine"
    mg.write(new, tmp_path / "new.bvh", force=True)
    assert (tmp_path / taken).read_text() != "mine"


def test_write_wrong_ending_type_or_number_raises(tmp_path, new):
    with pytest.raises(ValueError, match=r"must end with .*got a\.bvhh; did you mean"):
        mg.write(MOTION, tmp_path / "a.bvhh")
    with pytest.raises(TypeError, match="`item` must be a Motion or a Graft, got str"):
        mg.write("a.bvh", tmp_path / "a.bvh")
    for name in ("new.json", "new.fbx", "new"):
        with pytest.raises(ValueError, match=rf"`path` must end with \.bvh, .*, got {name}"):
            mg.write_graft(new, tmp_path / name)
    for grafts in ([], [new, new]):
        with pytest.raises(ValueError, match="`graft` must be one graft"):
            mg.write_graft(grafts, tmp_path / "new.bvh")
    assert list(tmp_path.iterdir()) == []


def test_write_interrupted_between_the_files_is_reported_by_every_reader(
    tmp_path, new, monkeypatch
):
    target = tmp_path / "new.bvh"
    mg.write(new, target)
    old = target.read_bytes()
    other = mg.graft(new.library, seed=2)
    with monkeypatch.context() as patch:
        replace = Path.replace
        patch.setattr(Path, "replace", lambda path, to: None if to == target else replace(path, to))
        mg.write(other, target, force=True)
    assert target.read_bytes() == old
    message = "new.json belongs to another motion than the file beside it"
    with pytest.warns(UserWarning, match=message):
        assert read_record(tmp_path / "new.json").name == other.motion.name
    with pytest.warns(UserWarning, match=message):
        (figure,) = Scene.of([target]).figures
    assert [row.group for row in figure.rows] == ["segments"]  # as of a captured motion
    with pytest.warns(UserWarning, match=message):
        assert [clip.is_graft for clip in find_clips(tmp_path)] == [True]
    mg.write(other, target, force=True)
    mg.write(other, target.with_suffix(".glb"))  # an export beside the graft
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_record(tmp_path / "new.json")
        Scene.of([target, target.with_suffix(".glb")])
        find_clips(tmp_path)


def test_write_graft_replaces_both_files_without_an_interruption_by_signals(tmp_path, new):
    target, state = tmp_path / "new.bvh", []
    mg.write(new, target)
    previous = signal.signal(signal.SIGTERM, lambda *_: state.append(_pair(target)))
    replace = Path.replace

    def send(path, to):
        replace(path, to)
        if to.parent == tmp_path:
            os.kill(os.getpid(), signal.SIGTERM)

    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Path, "replace", send)
            mg.write(mg.graft(new.library, seed=2), target, force=True)
    finally:
        signal.signal(signal.SIGTERM, previous)
    assert state == [True, True]


def _pair(target):
    """Return whether a motion has the SHA-256 in its provenance."""
    document = json.loads(target.with_suffix(".json").read_text())
    return document["motion_sha256"] == hashlib.sha256(target.read_bytes()).hexdigest()
