"""The features of HumanML3D agree with a transcription of their formulas."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import datasets
from mograft.datasets.humanml import humanml3d, humanml_joints
from tests.io.npz_files import dance_arrays, write_arrays
from tests.oracles import humanml as oracle
from tests.strategies import few_examples


@pytest.fixture(scope="module")
def amass(tmp_path_factory):
    path = tmp_path_factory.mktemp("amass") / "walk_poses.npz"
    write_arrays(path, dance_arrays(0))
    return mg.read(path)[0]


def test_features_of_amass_match_the_oracle(amass):
    joints = humanml_joints(amass.resample(20.0))[:40]
    found = humanml3d(joints)
    assert found.shape == (39, 263)
    assert np.abs(found - oracle.humanml3d(joints)).max() < 1e-9


@few_examples(10)
@given(seed=st.integers(0, 1000), n=st.integers(2, 6))
def test_features_of_random_joints_match_the_oracle(seed, n):
    joints = np.random.default_rng(seed).normal(size=(n, 22, 3))
    assert np.abs(humanml3d(joints) - oracle.humanml3d(joints)).max() < 1e-7


@few_examples(10)
@given(angle=st.floats(-3.0, 3.0), shift=st.tuples(*[st.floats(-9, 9)] * 3))
def test_features_do_not_depend_on_place_and_heading(amass, angle, shift):
    joints = humanml_joints(amass)[:10]
    c, s = np.cos(angle), np.sin(angle)
    moved = joints @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T + shift
    assert np.abs(humanml3d(moved) - humanml3d(joints)).max() < 1e-6


def test_windows_have_the_features(amass):
    library = mg.Library.build(amass)
    windows = datasets.augment(library, seconds=2.0, features=["humanml3d"])
    row, seconds = windows[0], (windows.n_frames - 1) / library.rate
    assert row["humanml3d"].shape == (round(20 * seconds), 263)
    assert np.isfinite(row["humanml3d"]).all()


@pytest.mark.parametrize("shape", [(5, 21, 3), (1, 22, 3), (22, 3)])
def test_wrong_joints_are_refused(shape):
    with pytest.raises(ValueError, match="`joints`"):
        humanml3d(np.zeros(shape))
