"""Commands on the tables of a robot."""

import json

import numpy as np
import pytest

import mograft as mg
from tests.io.robot_files import write_walks
from tests.motion.test_hinges import off_axis

pytestmark = pytest.mark.filterwarnings("ignore:frames per second of robot tables")


@pytest.fixture(scope="module")
def walks(tmp_path_factory):
    folder = tmp_path_factory.mktemp("walks")
    return write_walks(folder)


def legs_of(model):
    names = ("hip", "knee", "ankle", "toe", "pelvis")
    return [j for j, name in enumerate(model.names) if any(part in name for part in names)]


def test_graft_robot_writes_tables_with_the_legs_of_the_base(succeed, walks, tmp_path):
    path, files = walks
    words = ("--model", path, "-n", 3, "-o", tmp_path / "out")
    out = succeed("graft", *files, *words)[0].split()
    assert [name.rpartition("/")[2] for name in out] == [f"walk0_graft{k}.csv" for k in range(3)]
    model = mg.formats.read_model(path)
    hinges = model.hinges
    base = np.loadtxt(files[0], delimiter=",")
    moved = [k for k, joint in enumerate(hinges.joints) if joint not in legs_of(model)]
    kept = np.setdiff1d(np.arange(base.shape[1]), np.array(moved) + 7)
    for name in out:
        table = np.loadtxt(name, delimiter=",")
        np.testing.assert_array_equal(table[:, kept], base[:, kept])
        assert (table != base).any()
        motion = mg.read(name, skeleton=model)[0]
        assert off_axis(hinges, motion.rotations) <= 1e-9
        assert np.abs(hinges.excess(hinges.angles(motion.rotations))).max() <= 1e-9


def test_graft_robot_from_record_and_from_library_gives_the_same_bytes(succeed, walks, tmp_path):
    path, files = walks
    succeed("graft", *files, "--model", path, "-o", tmp_path / "out", "--fps", "50")
    first = (tmp_path / "out" / "walk0_graft0.csv").read_bytes()
    succeed("graft", "--from", tmp_path / "out" / "walk0_graft0.json", "-o", tmp_path / "again")
    (again,) = (tmp_path / "again").glob("*.csv")
    assert again.read_bytes() == first
    succeed("index", *files, "--model", path, "-o", tmp_path / "lib", "--fps", "50")
    succeed("graft", tmp_path / "lib", "-o", tmp_path / "new.csv")
    assert (tmp_path / "new.csv").read_bytes() == first
    assert mg.Library.open(tmp_path / "lib").rate == pytest.approx(50)


def test_folder_of_robot_tables_is_read_without_grafts_and_other_tables(succeed, tmp_path):
    path, files = write_walks(tmp_path / "walks")
    (tmp_path / "walks" / "tags.csv").write_text("clip,tag\nwalk0,slow\n")
    succeed("graft", *files, "--model", path, "-o", tmp_path / "walks")
    words = (tmp_path / "walks", "--model", path, "-o", tmp_path / "lib")
    succeed("index", *words, "--tags", tmp_path / "walks" / "tags.csv")
    library = mg.Library.open(tmp_path / "lib")
    assert library.names == ("walk0", "walk1")
    assert library.skeleton.hinges.names == mg.formats.read_model(path).hinges.names


def test_info_robot_states_the_evidence(succeed, walks):
    path, files = walks
    out = succeed("info", files[0], "--model", path)[0]
    assert "note: quaternion: wxyz, implausibility 0." in out
    assert "note: units: m and rad" in out
    notes = json.loads(succeed("info", files[0], "--model", path, "--json")[0])["files"][0]["notes"]
    assert notes[2].startswith("frames per second: 30 is assumed")


def test_export_robot_writes_the_files_of_trackers(succeed, walks, tmp_path):
    path, files = walks
    words = ("export", files[0], "--model", path, "--rate", 50, "-o", tmp_path / "a.npz")
    succeed(*words, "--tracker", "beyondmimic")
    arrays = np.load(tmp_path / "a.npz")
    assert arrays["fps"] == pytest.approx(50, rel=1e-2)
    motion = mg.read(files[0], skeleton=mg.formats.read_model(path), rate=50)[0]
    mg.formats.write_tracker(motion, tmp_path / "b.npz", tracker="beyondmimic")
    for name, own in np.load(tmp_path / "b.npz").items():
        np.testing.assert_array_equal(arrays[name], own)
    succeed("export", files[0], "--model", path, "-o", tmp_path / "copy.csv")
    copy, given = (np.loadtxt(own, delimiter=",") for own in (tmp_path / "copy.csv", files[0]))
    np.testing.assert_array_equal(copy, given)


def test_robot_table_without_model_is_an_invalid_file(fail, walks):
    assert "expected the model of the robot, got none: give --model" in fail(3, "info", walks[1][0])
