"""Violations by joints that no donor moves."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
import mograft.constraints as mc
from mograft.dancer import dance
from mograft.search.obstacles import Sphere
from mograft.solve.finish import find_kept_violations


@pytest.fixture(scope="module")
def library():
    return mg.Library.build(dance(seed=1, strides=1).motion[:400])


@settings(max_examples=7, deadline=None)
@given(
    joint=st.sampled_from(["LeftFoot", "RightLeg", "LeftHand", "Head", "Hips"]),
    frame=st.integers(0, 399),
    radius=st.floats(1, 40),
    seed=st.integers(0, 3),
)
def test_kept_violations_remain_in_every_graft(library, joint, frame, radius, seed):
    """Any donors leave them as they are; and all other violations are by exchanged joints."""
    clip = library.clips[0]
    _, positions = clip.world_transforms()
    avoid = mc.Avoid(Sphere(tuple(positions[frame, clip.skeleton.index(joint)]), radius))
    kept = find_kept_violations(library, clip, ["upper"], [avoid])
    motion = mg.graft(library, seed=seed).motion
    again = find_kept_violations(library, motion, ["upper"], [avoid])
    assert [(own.frames, own.joint) for own in kept] == [(own.frames, own.joint) for own in again]
    legs = {clip.skeleton.names[index] for index in library.joints("lower")}
    assert {own.joint for own in kept} <= legs
    if joint in legs:
        assert any(own.frames[0] <= frame <= own.frames[1] for own in kept)


def test_kept_violations_are_none_if_donors_hold_the_root(library):
    groups = mg.JointGroups(library.groups.groups, base="upper")
    other = mg.Library.build(library.clips[0], groups)
    everywhere = mc.Avoid(Sphere((0.0, 0.0, 0.0), 9999.0))
    assert find_kept_violations(other, library.clips[0], ["lower"], [everywhere]) == []
    assert find_kept_violations(library, library.clips[0], ["upper"], [everywhere]) != []
    soft = mc.Avoid(Sphere((0.0, 0.0, 0.0), 9999.0), weight=1.0)
    assert find_kept_violations(library, library.clips[0], ["upper"], [soft]) == []
