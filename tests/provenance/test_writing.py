"""`mograft.write` chooses the writer by the ending and never replaces a file unasked."""

import pytest

import mograft as mg
from mograft import formats
from mograft.dancer import dance
from mograft.provenance.writing import WRITERS

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


def test_write_wrong_ending_or_type_raises(tmp_path):
    with pytest.raises(ValueError, match=r"must end with .*got a\.bvhh; did you mean"):
        mg.write(MOTION, tmp_path / "a.bvhh")
    with pytest.raises(TypeError, match="`item` must be a Motion or a Graft, got str"):
        mg.write("a.bvh", tmp_path / "a.bvh")
    assert set(WRITERS) >= {".bvh", ".csv", ".glb", ".npz", ".usda"}
    assert list(tmp_path.iterdir()) == []
