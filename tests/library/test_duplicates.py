"""Spans of a library that occur twice."""

from dataclasses import replace

import numpy as np
import pytest

import mograft as mg
from mograft.dancer import dance
from mograft.library.duplicates import find_duplicates
from tests.strategies import transform_motion


@pytest.mark.parametrize(
    ("seed", "start", "length", "is_turned"), [(0, 100, 400, False), (5, 311, 300, True)]
)
def test_find_duplicates_planted_piece_is_found_and_spans_have_equal_poses(
    seed, start, length, is_turned
):
    take = dance(seed=seed, strides=1).motion
    piece = replace(take[start : start + length], name="piece")
    if is_turned:
        piece = transform_motion(piece, yaw=1.0, offset=(50.0, 0.0, 9.0))
    library = mg.Library.build([take, piece])
    clips = dict(zip(library.names, library.clips, strict=True))
    spans = find_duplicates(library)
    found = [own for own in spans if own.other == "piece" and own.clip == "dance"]
    shifts = [own.frames[0] - own.other_frames[0] for own in found]
    covered = np.zeros(length, bool)
    for own, shift in zip(found, shifts, strict=True):
        covered[own.other_frames[0] : own.other_frames[1] + 1] |= shift == start
    # Segments near the ends of the piece can have other boundaries than in the take.
    assert covered[60:-60].mean() > 0.5
    for own in spans:
        first, second = (
            clips[name].rotations[frames[0] : frames[1] + 1, 1:]
            for name, frames in ((own.clip, own.frames), (own.other, own.other_frames))
        )
        if len(first) == len(second):
            assert mg.rotations.angle(first, second).max() < np.radians(1.0)


def test_find_duplicates_without_any_returns_none():
    assert find_duplicates(mg.Library.build(dance(seed=1, strides=1).motion[:400])) == []


def test_find_duplicates_of_three_takes_lists_each_pair():
    take = dance(strides=1).motion[:300]
    library = mg.Library.build([replace(take, name=name) for name in "abc"])
    pairs = [(own.clip, own.other) for own in find_duplicates(library)]
    assert pairs == [("a", "b"), ("a", "c"), ("b", "c")]
