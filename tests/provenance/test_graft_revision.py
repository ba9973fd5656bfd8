"""Revisions of a graft: `regenerate` and `constrain`."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
import mograft.constraints as mc
from mograft._util.cancel import CancelledError, cancellable, check_cancelled
from mograft.dancer import dance
from mograft.library.origin import hash_poses
from mograft.provenance import graft_revision
from mograft.provenance.graft_change import plan_of
from mograft.provenance.graft_revision import constrain, regenerate, select_positions
from tests.provenance.checks import assert_replays

N_FRAMES = 240
spans = st.tuples(st.integers(0, N_FRAMES - 2), st.integers(1, 60)).map(
    lambda own: (own[0], min(own[0] + own[1], N_FRAMES - 1))
)
ranges = st.lists(st.tuples(st.just("upper"), spans), max_size=2)


@pytest.fixture(scope="module")
def library():
    clips = [
        replace(dance(seed=seed, strides=2).motion[:N_FRAMES], name=f"clip{seed}")
        for seed in (0, 1)
    ]
    return mg.Library.build(clips)


@pytest.fixture(scope="module")
def graft(library):
    return mg.graft(library, seed=5)


def selected(graft, ranges):
    return select_positions(plan_of(graft, ()).problem, ranges)[0]


def hand_at(graft, frame, shift=(0.0, 0.0, 0.0)):
    hand = graft.motion.skeleton.index("LeftHand")
    return tuple((graft.motion.world_positions()[frame, hand] + shift).tolist())


@settings(max_examples=15)
@given(opened=ranges, locked=ranges, seed=st.integers(0, 5))
def test_regenerate_changes_the_open_segments_only(graft, opened, locked, seed):
    new = regenerate(graft, opened, seed, locked=locked)
    is_open = selected(graft, opened) & ~selected(graft, locked)
    is_new = graft.donors["upper"] != new.donors["upper"]
    assert not (is_new & ~is_open).any()
    assert (is_new | ~is_open | (graft.alternatives["upper"] == 0)).all()
    assert_replays(new)


def test_regenerate_ends_the_rules_of_its_segments(graft):
    kept = mg.edit(graft, mc.KeepOriginal(frames=(60, 120)))
    new = regenerate(kept, [("upper", (0, N_FRAMES - 1))], 1)
    assert new.request.constraints == ()
    is_kept = selected(graft, [("upper", (60, 120))])
    own = np.array([each.segment for each in new.substitutions])
    assert (new.donors["upper"] != own)[is_kept].any()


def test_regenerate_keeps_changes_elsewhere(graft):
    changed = mg.change(graft, "larm", (100, 130), ("clip1", 20, 50))
    far = regenerate(changed, [("upper", (0, 40))], 1)
    near = regenerate(changed, [("upper", (90, 140))], 1)
    assert (len(far.changes), len(near.changes)) == (1, 0)
    assert_replays(far)


@settings(max_examples=8)
@given(
    frame=st.integers(20, N_FRAMES - 20),
    shift=st.tuples(*[st.floats(-25, 25)] * 3),
    locked=ranges,
    is_quick=st.booleans(),
)
def test_constrain_keeps_locked_segments_and_is_replayed(graft, frame, shift, locked, is_quick):
    avoid = mc.Avoid(mc.Sphere(hand_at(graft, frame, shift), 6.0))
    new = constrain(graft, [avoid], locked=locked, is_quick=is_quick)
    is_locked = selected(graft, locked)
    assert (new.donors["upper"] == graft.donors["upper"])[is_locked].all()
    assert_replays(new)
    if not new.violations:
        violating = mc.Avoid(avoid.obstacle)
        assert not constrain(new, [violating]).violations


def test_constrain_without_violations_changes_no_frame(graft):
    far = mc.Avoid(mc.Sphere((0.0, 900.0, 0.0), 5.0))
    new = constrain(graft, [far])
    assert hash_poses(new.motion) == hash_poses(graft.motion)
    assert new.request.constraints == (far,)
    assert constrain(new, []).request.constraints == ()


def test_constrain_quickly_violates_no_less_than_a_search_of_all(graft):
    avoid = mc.Avoid(mc.Sphere(hand_at(graft, 100, (3.0, 0.0, 0.0)), 12.0), frames=(60, 140))

    def excess(found):
        return sum(own.error for own in found.violations)

    before = constrain(graft, [avoid], locked=[("upper", (0, N_FRAMES - 1))])
    quick, full = constrain(graft, [avoid], is_quick=True), constrain(graft, [avoid])
    assert excess(before) > excess(quick) >= excess(full)


def test_removed_target_is_replayed_with_all_versions(graft):
    reach = mc.Reach("LeftHand", hand_at(graft, 120, (0.0, 2.0, 1.0)), frame=120)
    moved = constrain(graft, [reach])
    assert moved.reach_completions[0].is_moved
    other = mc.Reach("LeftHand", hand_at(graft, 60, (0.0, 2.0, 1.0)), frame=60)
    new = constrain(moved, [other])
    kinds = [(own.frames, own.weight) for own in new.request.constraints]
    assert kinds == [((60, 60), None), ((120, 120), 0.0)]
    np.testing.assert_allclose(
        new.motion.rotations[115:126], graft.motion.rotations[115:126], atol=2e-4
    )
    for version in (moved, new, constrain(new, list(new.request.constraints[1:]))):
        assert_replays(version)


def test_cancelled_search_returns_the_nearest_candidates(graft):
    avoid = mc.Avoid(mc.Sphere(hand_at(graft, 100), 30.0))
    quick = constrain(graft, [avoid], is_quick=True)
    assert quick.violations
    n_checks = 0

    def is_cancelled():
        nonlocal n_checks
        n_checks += 1
        return n_checks > 4

    with cancellable(is_cancelled):
        found = constrain(graft, [avoid])
    assert hash_poses(found.motion) == hash_poses(quick.motion)
    check_cancelled()  # nothing outside of the block


def test_cancelled_search_for_spans_raises_error(graft):
    with cancellable(lambda: True), pytest.raises(CancelledError):
        mg.change(graft, "upper", (50, 80))


def test_violations_by_captured_joints_are_not_searched_for(graft, monkeypatch):
    hips = tuple(graft.base.world_positions()[100, 0].tolist())
    foot = mc.KeepOut("LeftFoot", mc.Sphere(hips, 500.0), frames=(90, 110))
    calls, choose = [], graft_revision.choose_again

    def count_choices(*given):
        calls.append(given)
        return choose(*given)

    monkeypatch.setattr(graft_revision, "choose_again", count_choices)
    new = constrain(graft, [foot])
    assert {own.joint for own in new.violations} == {"LeftFoot"}
    assert len(calls) == 1
    constrain(graft, [mc.KeepOut("LeftHand", mc.Sphere(hips, 500.0), frames=(90, 110))])
    assert len(calls) == 3
