"""Recorded BVH files, and unusual ones from other programs."""

import re

import numpy as np
import pytest

import mograft as mg
from mograft import formats
from tests.io.bvh_helpers import assert_same_numbers, assert_same_skeleton, round_trip
from tests.io.recorded_files import DATA, ODD, ODD_FILES, RECORDINGS, file_id, require


@pytest.mark.parametrize("path", RECORDINGS, ids=file_id)
def test_bvh_recording_round_trips(path):
    motion = mg.read_bvh(require(path, DATA))
    again = round_trip(motion)
    assert_same_skeleton(again.skeleton, motion.skeleton)
    assert_same_numbers(again.channel_values, motion.channel_values)
    assert_same_numbers(again.rotations, motion.rotations)
    assert again.frame_time == motion.frame_time
    assert formats.scan_bvh(path).counts_agree


def expected_behaviours():
    """The behaviour that the list of unusual files states, by file name."""
    table = ODD / "README.md"
    if not table.exists():
        return {}
    rows = re.findall(
        r"^\| (\w+) \| [^\n]*?\| ((?:accept|clear reject|reject)[^|]*)\|", table.read_text(), re.M
    )
    return dict(rows)


EXPECTED_BEHAVIOURS = expected_behaviours()


@pytest.mark.parametrize("path", ODD_FILES, ids=file_id)
def test_read_bvh_unusual_file_behaves_as_listed(path):
    expected = EXPECTED_BEHAVIOURS[require(path, ODD).stem]
    if not re.search("accept|or ", expected):
        with pytest.raises(mg.BvhError, match=rf"{path.name}:\d+:\d+: expected .*, got "):
            mg.read_bvh(path)
        return
    try:
        motion = mg.read_bvh(path)
    except mg.BvhError:
        if "reject" in expected:
            return
        raise
    if counts := re.search(
        r"\((\d+) joints?, (?:\d+ channels, )?(\d+)(?: or (\d+))? frames?", expected
    ):
        joints, *frames = (int(count) for count in counts.groups() if count)
        assert motion.n_joints == joints
        assert motion.n_frames in frames
    assert np.isfinite(motion.channel_values).all()
    again = round_trip(motion)
    assert_same_skeleton(again.skeleton, motion.skeleton)
    assert_same_numbers(again.channel_values, motion.channel_values)


def test_unusual_files_are_all_listed():
    require(ODD_FILES[0], ODD)
    assert {path.stem for path in ODD_FILES} == set(EXPECTED_BEHAVIOURS)
