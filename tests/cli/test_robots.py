"""Commands on the tables of a robot."""

import pytest

import mograft as mg
from tests.io.robot_files import write_walks

pytestmark = pytest.mark.filterwarnings("ignore:frames per second of robot tables")


@pytest.fixture(scope="module")
def walks(tmp_path_factory):
    folder = tmp_path_factory.mktemp("walks")
    return write_walks(folder)


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
    words = ("-o", tmp_path / "lib", "--tags", tmp_path / "walks" / "tags.csv")
    succeed("index", tmp_path / "walks", "--model", path, *words)
    assert mg.Library.open(tmp_path / "lib").names == ("walk0", "walk1")


def test_info_robot_states_the_evidence(succeed, walks):
    path, files = walks
    out = succeed("info", files[0], "--model", path)[0]
    for note in (
        "quaternion: wxyz, implausibility 0.",
        "units: m and rad",
        "frames per second: 30",
    ):
        assert f"note: {note}" in out


def test_export_robot_writes_the_files_of_trackers(succeed, walks, tmp_path):
    path, files = walks
    words = ("export", files[0], "--model", path, "--rate", 50, "-o", tmp_path / "a.npz")
    succeed(*words, "--tracker", "beyondmimic")
    motion = mg.read(files[0], skeleton=mg.formats.read_model(path))[0].resample(50)
    mg.formats.write_tracker(motion, tmp_path / "b.npz", tracker="beyondmimic")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_robot_table_without_model_is_an_invalid_file(fail, walks):
    assert "expected the model of the robot, got none: give --model" in fail(3, "info", walks[1][0])
