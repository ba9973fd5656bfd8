"""Libraries that earlier versions stored open, verify, grow and give the same grafts."""

import shutil

import numpy as np
import pytest

import mograft as mg
from mograft.cli import main
from mograft.dancer import dance
from tests.library.make_stored_library import DATA, graft

VERSIONS = sorted(path.stem for path in DATA.glob("library-*.npz"))

TOLERANCE = 1e-4
"""Of quaternions, and of positions in cm: the stored graft has single precision."""


@pytest.fixture(params=VERSIONS)
def version(request):
    """The name of a stored library, such as ``library-0.1``."""
    return request.param


@pytest.fixture
def folder(version, tmp_path):
    """An unpacked copy of a stored library."""
    shutil.unpack_archive(DATA / f"{version}.tar.xz", tmp_path / version, filter="data")
    return tmp_path / version


def test_stored_library_of_first_version_exists():
    assert "library-0.1" in VERSIONS


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
