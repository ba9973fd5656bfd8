"""The balance of a library's segments."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Library
from mograft.analysis.zero_moment import ZeroMomentTrack, support_margins
from mograft.body.contacts import Ground
from mograft.dancer import dance

CLIPS = [dance(seed=seed, strides=1).motion[:150] for seed in (1, 2)]


@pytest.fixture(scope="module")
def library():
    return Library.build(CLIPS)


def margins_of(library, clip, cut):
    config, up = library.config, library.up
    track = ZeroMomentTrack.of(clip, cut, Ground.of(clip), config, root=library.root, up=up)
    return support_margins(clip, cut, track, config, up=up)


@given(st.lists(st.floats(0.0, 1.0, exclude_max=True), max_size=8))
def test_support_margins_of_any_segments_are_those_of_their_clips(library, places):
    cut = library.segments
    parts = [cut[cut.of_clip(index)] for index in range(len(CLIPS))]
    margins = [margins_of(library, *own) for own in zip(library.clips, parts, strict=True)]
    expected = np.concatenate(margins)
    chosen = np.array([int(place * len(expected)) for place in places], int)
    found = library.pool("upper").balance.support_margins(chosen)
    np.testing.assert_array_equal(found, expected[chosen])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mograft.library.segment_balance.CHUNK", 7)
        patch.setattr("mograft.library.segment_balance._MAX_MARGIN_BYTES", 32_000)
        again = replace(library).pool("upper").balance.support_margins(chosen)
    np.testing.assert_array_equal(again, expected[chosen])


def test_support_margins_of_a_segment_are_computed_for_its_block_only(library, monkeypatch):
    sizes = []

    def record(*given, **options):
        found = support_margins(*given, **options)
        sizes.append(len(found))
        return found

    monkeypatch.setattr("mograft.library.segment_balance.CHUNK", 7)
    monkeypatch.setattr("mograft.analysis.zero_moment.support_margins", record)
    balance = replace(library).pool("upper").balance
    for segment in (8, 9, 13):
        balance.support_margins(np.array([segment]))
    assert sizes == [7]


@given(st.lists(st.lists(st.integers(0, 10), max_size=6), min_size=1, max_size=4))
def test_mass_offsets_do_not_depend_on_earlier_calls(library, calls):
    balance, joints = replace(library)._balance, library.joints("upper")
    every = balance.mass_offsets(joints, np.arange(len(library.segments)))
    balance = replace(library)._balance
    for own in calls:
        chosen = np.array(own, int)
        np.testing.assert_array_equal(balance.mass_offsets(joints, chosen), every[chosen])


def test_pool_has_a_balance_only_for_groups_without_root_and_feet(library):
    assert library.pool("upper").balance is not None
    assert library.pool("lower").balance is None


def test_extended_library_has_the_balance_of_the_appended_motion(library):
    base = dance(seed=3, strides=1).motion[:150]
    extended, alone = library.with_clip(base), Library.build([base])
    segments = extended.segments.of_clip(2)
    expected, found = alone.pool("upper").balance, extended.pool("upper").balance
    every = np.arange(len(alone.segments))
    for name, atol in (("support_margins", 1e-9), ("mass_offsets", 1e-6)):
        wanted, got = getattr(expected, name)(every), getattr(found, name)(segments)
        np.testing.assert_allclose(got, wanted, atol=atol)
