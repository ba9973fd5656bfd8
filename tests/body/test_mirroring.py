"""Properties of mirror images of motions and of mirrored libraries."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings

from mograft import Config, JointGroups, Library, graft, mirror, read_bvh
from mograft.body.mass import mass_model
from mograft.body.mirroring import partners
from mograft.dancer import dance
from mograft.motion import rotations
from tests.hierarchies import each_recording, human, with_names
from tests.strategies import SEEDS, assert_same_rotations, person


def with_axes(motion, turn):
    """The motion of a skeleton with rotated joint axes, as tools that align bones write."""
    skeleton = motion.skeleton
    parent_turn = turn[np.maximum(skeleton.parents, 0)]
    parent_turn[0] = rotations.IDENTITY
    inverse = rotations.inverse(parent_turn)
    back, own = rotations.inverse(turn), skeleton.end_sites
    sites = [replace(s, offset=rotations.rotate(back[s.parent], s.offset)) for s in own]
    positions = rotations.rotate(inverse, motion.positions)
    offsets = rotations.rotate(inverse, skeleton.offsets)
    turned = replace(skeleton, offsets=offsets, end_sites=tuple(sites))
    quats = rotations.multiply(rotations.multiply(inverse, motion.rotations), turn)
    changes = {"rotations": quats, "positions": positions, "channel_values": None}
    return replace(motion, skeleton=turned, **changes)


@settings(deadline=None)
@given(SEEDS)
def test_mirror_reflects_world_positions(seed):
    """Each joint is at the reflected position of its partner; mirroring twice restores all."""
    motion = person(seed, 12)
    # Large rotations would hide the up axis.
    small_rotations = rotations.exp(0.2 * rotations.log(motion.rotations))
    motion = replace(motion, rotations=small_rotations)
    image, pair = mirror(motion), partners(motion.skeleton)
    expected = motion.world_positions() * [-1, 1, 1]  # left and right have opposite signs of x
    np.testing.assert_allclose(image.world_positions()[:, pair], expected, atol=1e-9)
    assert image.skeleton.names == motion.skeleton.names
    twice_mirrored = mirror(image)
    assert_same_rotations(twice_mirrored.rotations, motion.rotations, 1e-12)
    np.testing.assert_allclose(twice_mirrored.positions, motion.positions, atol=1e-12)
    np.testing.assert_allclose(twice_mirrored.skeleton.offsets, motion.skeleton.offsets, atol=1e-12)


@settings(deadline=None, max_examples=30)
@given(SEEDS)
@example(485600)  # a case in which the two mirror planes were different
def test_mirror_ignores_local_axes(seed):
    """Quarter turns of the joint axes do not change the image."""
    rng = np.random.default_rng(seed)
    motion = dance(seed=4, strides=1).motion[100:300]
    quarters = rotations.from_euler(rng.integers(0, 4, (motion.n_joints, 3)) * np.pi / 2, "ZYX")
    for joint, children in enumerate(motion.skeleton.children):
        if not children:  # a leaf has the axes of its parent
            quarters[joint] = quarters[motion.skeleton.parents[joint]]
    other = with_axes(motion, quarters)
    image, expected_image = mirror(other), with_axes(mirror(motion), quarters)
    assert_same_rotations(image.rotations[:, 1:], expected_image.rotations[:, 1:], 1e-9)
    np.testing.assert_allclose(image.positions[:, 1:], expected_image.positions[:, 1:], atol=1e-9)
    # The mirror plane may be another, so that the image has another heading.
    root_rotations = [one.world_transforms()[0][:, 0] for one in (image, expected_image)]
    yaw_offset = rotations.multiply(root_rotations[0], rotations.inverse(root_rotations[1]))
    assert_same_rotations(yaw_offset, np.tile(yaw_offset[:1], (len(yaw_offset), 1)), 1e-9)
    assert_same_rotations(yaw_offset[0], rotations.twist(yaw_offset[0], 1), 1e-9)
    assert_same_rotations(mirror(image).rotations, other.rotations, 1e-9)


# Recordings of a face, with joints that have no partner, or with an asymmetric rest pose.
ASYMMETRIC = ("face-poseunits", "rotation_first_root", "backflip")


@each_recording()
def test_mirror_recordings_succeed_or_name_the_joint(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        motion = read_bvh(path, strict=False)[:20]
    if path.stem in ASYMMETRIC:
        with pytest.raises(ValueError, match=r"^to mirror a skeleton|^bones must be sy"):
            mirror(motion)
        return
    image = mirror(motion)
    pair, height = partners(motion.skeleton), mass_model(motion.skeleton).height
    positions = image.world_positions()[:, pair]
    lengths = np.linalg.norm(positions[:, 1:] - positions[:, :1], axis=-1)
    world = motion.world_positions()
    expected = np.linalg.norm(world[:, 1:] - world[:, :1], axis=-1)
    np.testing.assert_allclose(lengths, expected, atol=1e-6 * height)
    # The step from frame to frame is no larger: no joint flips over.
    both = (one.rotations for one in (motion, image))
    before, after = (rotations.angle(own[1:], own[:-1]).max(initial=0) for own in both)
    assert after <= before + 1e-6


@pytest.fixture(scope="module")
def motion():
    return dance(seed=2, strides=1).motion


def test_mirrored_library_has_donors_of_both_and_keeps_base(motion):
    library = Library.build([motion[:300], motion[300:500]])
    doubled = library.with_mirror_images()
    n = len(library.segments)
    np.testing.assert_array_equal(doubled.segments.start[n:], library.segments.start)
    assert doubled.entries[2].name == f"{library.entries[0].name}_mirrored"
    assert_same_rotations(doubled.clips[3].rotations, mirror(library.clips[1]).rotations)
    grafted = graft(doubled, library.entries[0].name, seed=1)
    assert any(s.clip.endswith("_mirrored") for s in grafted.substitutions)
    assert grafted.base is library.clips[0]
    np.testing.assert_array_equal(grafted.motion.rotations[:, :7], motion[:300].rotations[:, :7])


def test_mirror_asymmetric_skeleton_raises_value_error():
    names = {"RightWrist": "RightThumb1"}
    skeleton = with_names(human(), lambda _, old: names.get(old, old))
    motion = replace(person(1), skeleton=skeleton)
    message = "must have a partner .*; LeftWrist or one of its siblings has none"
    with pytest.raises(ValueError, match=message):
        mirror(motion)
    groups = JointGroups.preset("lower_upper", skeleton)
    with pytest.raises(ValueError, match=message):
        Library.build(motion, groups, Config(), mirrored=True)
    for joint, change, message in (
        (2, [0.0, -40.0, 0.0], "offset of LeftKnee is not the mirror image of RightKnee"),
        (7, [5.0, 0.0, 0.0], "the offset of Chest is not in the mirror plane"),
    ):
        offsets = human().offsets.copy()
        offsets[joint] += change
        with pytest.raises(ValueError, match=message):
            mirror(replace(person(1), skeleton=human().with_offsets(offsets)))
