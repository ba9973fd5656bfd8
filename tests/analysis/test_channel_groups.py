"""Joints divided between groups: a graft exchanges only the channels of the grafted group."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mograft import Config, JointGroups, Library, Skeleton, graft
from mograft.analysis.channel_groups import euler_angles, restrict_rotations, restrict_samples
from mograft.analysis.embedding import Samples
from mograft.blend.donor_timeline import DonorTimeline
from mograft.blend.recombine import recombine
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.seams import TRANSLATIONS
from mograft.blend.transplant import GraftedGroup, transplant
from mograft.dancer import dance
from mograft.motion import rotations
from mograft.motion.skeleton import CHANNELS
from tests.strategies import (
    SEEDS,
    SEGMENT_LENGTHS,
    assert_same_rotations,
    random_star_clip,
    smooth_rotations,
    tile_segments,
)

AXES = st.sampled_from(["X", "Y", "Z", "ZX", "XY", "ZY"])


@given(SEGMENT_LENGTHS, SEEDS, AXES, st.sampled_from(tuple(SEAM_TREATMENTS)))
def test_transplant_divided_joint_changes_only_channels_of_group(lengths, seed, axes, seam):
    rng = np.random.default_rng(seed)
    cut = tile_segments(lengths)
    base = random_star_clip(rng, cut)
    donors = cut[rng.integers(0, len(cut), len(cut))]
    group = GraftedGroup(np.array([1, 3]), held={3: axes})
    part = transplant(base, cut, donors, [base], group, Config(seam=seam))
    new = recombine(base, [part], "new")
    columns = base.skeleton.channel_columns
    divided = zip(columns[3], base.skeleton.channels[3], strict=True)
    others = [*columns[0], *columns[2], *(own for own, name in divided if name[0] not in axes)]
    np.testing.assert_array_equal(new.channel_numbers()[:, others], base.channel_values[:, others])
    # The channel values agree with the rotations.
    order = base.skeleton.rotation_order(3)
    angles = np.radians(new.channel_numbers()[:, list(columns[3])])
    assert_same_rotations(rotations.from_euler(angles, order), new.rotations[:, 3], 1e-9)
    assert part.joints.tolist() == [1]
    # The segments of the base as donors keep every bit.
    same = recombine(base, [transplant(base, cut, cut, [base], group, Config(seam=seam))], "same")
    np.testing.assert_array_equal(same.rotations, base.rotations)
    np.testing.assert_array_equal(same.channel_numbers(), base.channel_values)


@given(SEGMENT_LENGTHS, SEEDS, st.sampled_from(["gradient", "offset"]))
def test_transplant_single_channel_equals_translation_blending(lengths, seed, seam):
    """Blending the angle as a number equals blending it as a translation, within a half turn."""
    rng = np.random.default_rng(seed)
    cut = tile_segments(lengths)
    base = random_star_clip(rng, cut)
    donors = cut[rng.integers(0, len(cut), len(cut))]
    order = base.skeleton.rotation_order(3)
    angle = euler_angles(base, 3)[:, order.index("Y")]
    assume(np.ptp(angle) < 3.0)
    # A strongly compressed donor may turn by more than half a turn between two frames.
    assume((donors.lengths <= 2 * cut.lengths).all() and np.abs(np.diff(angle)).max() < 0.5)
    group = GraftedGroup(np.array([3]), held={3: "Y"})
    part = transplant(base, cut, donors, [base], group, Config(seam=seam))
    track = np.zeros((len(angle), 1, 3))
    track[:, 0, 0] = angle
    timeline = DonorTimeline(cut, donors, base.rate, Config(seam=seam))
    timeline = replace(timeline, seams=timeline.find_seams([track]))
    expected = timeline.close(TRANSLATIONS, [track])[:, 0, 0]
    blended = part.angles[3, "Y"]
    blended = np.where(np.isnan(blended), angle, blended)
    np.testing.assert_allclose(np.sin((blended - expected) / 2), 0.0, atol=1e-6)


@given(SEEDS, AXES, st.booleans())
def test_restrict_samples_changes_only_divided_joint(seed, axes, is_single):
    rng = np.random.default_rng(seed)
    cut = tile_segments([3, 4])
    skeleton = random_star_clip(rng, cut).skeleton
    quats = smooth_rotations(rng, 9 * 2, skeleton.n_joints).reshape(9, 2, skeleton.n_joints, 4)
    rows = np.concatenate([quats.reshape(9, -1), rng.normal(size=(9, 7))], axis=1)
    whole = Samples(rows.astype(np.float32) if is_single else rows, 2, skeleton.n_joints)
    restricted = restrict_samples(whole, skeleton, {3: axes})
    np.testing.assert_array_equal(
        restricted.displacements_and_length, whole.displacements_and_length
    )
    others = np.delete(np.arange(skeleton.n_joints), 3)
    np.testing.assert_array_equal(restricted.rotations[:, :, others], whole.rotations[:, :, others])
    expected = restrict_rotations(
        whole.rotations[:, :, 3].astype(np.float64), skeleton.rotation_order(3), axes
    )
    np.testing.assert_array_equal(restricted.rotations[:, :, 3], expected)
    assert restrict_samples(whole, skeleton, {}) is whole


@given(SEEDS, st.sampled_from(["XYZ", "ZXY", "YZX", "ZYX", "XZY", "YXZ"]))
def test_restrict_rotations_product_of_axes_is_whole_rotation(seed, order):
    rng = np.random.default_rng(seed)
    wide = rng.uniform(-1, 1, (20, 3)) * [np.pi, 1.5, np.pi]
    quats = rotations.from_euler(wide, order)
    assert_same_rotations(restrict_rotations(quats, order, order), quats, 1e-9)
    assert_same_rotations(
        restrict_rotations(quats, order, ""), np.tile(rotations.IDENTITY, (20, 1)), 1e-12
    )
    parts = [restrict_rotations(quats, order, axis) for axis in order]
    whole = rotations.multiply(rotations.multiply(parts[0], parts[1]), parts[2])
    assert_same_rotations(whole, quats, 1e-9)
    assert_same_rotations(restrict_rotations(-quats, order, order[0]), parts[0], 1e-9)


@pytest.fixture(scope="module")
def motion():
    clip = dance(seed=1, strides=1).motion[:600]
    return replace(clip, channel_values=clip.channel_numbers())


def divide_joints(skeleton, axis="Y"):
    names = [n for n in skeleton.names if n not in ("LeftForeArm", "Spine")]
    rest = [f"{n}.{a}rotation" for n in ("LeftForeArm", "Spine") for a in "XYZ" if a != axis]
    roll = [f"{n}.{axis}rotation" for n in ("LeftForeArm", "Spine")]
    return JointGroups({"body": [*names, *rest], "roll": roll}, base="body")


@pytest.mark.filterwarnings("ignore:group")  # an angle exceeds a full turn
def test_graft_single_channel_group_changes_only_its_channels(motion):
    groups = divide_joints(motion.skeleton)
    library = Library.build(motion, groups)
    assert groups.divided_channels(motion.skeleton)["roll"] == {7: "Y", 12: "Y"}
    new = graft(library, seed=1)
    assert any(not s.is_own for s in new.substitutions)
    changed = (new.motion.channel_numbers() != motion.channel_values).any(axis=0)
    columns = motion.skeleton.channel_columns
    axis = motion.skeleton.rotation_order(7).index("Y") - 3
    assert changed.any()
    assert {*np.flatnonzero(changed).tolist()} <= {columns[7][axis], columns[12][axis]}
    restored = JointGroups.from_toml(groups.to_toml())
    assert restored.divided_channels(motion.skeleton) == groups.divided_channels(motion.skeleton)


@pytest.mark.filterwarnings("ignore:group")
def test_library_base_clusters_ignore_channels_of_other_groups(motion):
    """Changing the channels of the other group does not change the clusters of the base."""
    turned = motion.channel_values.copy()
    column = motion.skeleton.channel_columns[7][motion.skeleton.rotation_order(7).index("Y")]
    turned[:, column] += 30.0 * np.sin(np.arange(len(turned)) / 7.0)
    order, columns = motion.skeleton.rotation_order(7), list(motion.skeleton.channel_columns[7])
    quats = motion.rotations.copy()
    quats[:, 7] = rotations.continuous_signs(
        rotations.from_euler(np.radians(turned[:, columns]), order)
    )
    other = replace(motion, rotations=quats, channel_values=turned)
    config = Config(segmentation={motion.name: range(20, 580, 20)})
    a, b = (Library.build(m, divide_joints(m.skeleton), config) for m in (motion, other))
    np.testing.assert_array_equal(a.labels["body"], b.labels["body"])
    assert a.embedding["roll"] is not None


@given(st.tuples(st.booleans(), st.booleans(), st.booleans()))
def test_divided_channels_are_those_of_a_group_that_lacks_others(owners):
    skeleton = Skeleton(["a", "b", "c"], [-1, 0, 1], np.zeros((3, 3)))
    axes = ["", ""]
    for axis, owner in zip("ZXY", owners, strict=True):  # in the order of the file
        axes[owner] += axis
    own = [[f"b.{axis}rotation" for axis in group] for group in axes]
    groups = JointGroups({"one": ["a", *own[0]], "two": ["c", *own[1]]}, base="one")
    divided = groups.divided_channels(skeleton)
    expected = [{1: group} if 0 < len(group) < 3 else {} for group in axes]
    assert list(divided.values()) == expected
    assert {int(j) for joints in groups.resolve(skeleton).values() for j in joints} == {0, 1, 2}


def test_joint_groups_invalid_channels_raise_value_error():
    channels = [CHANNELS, CHANNELS[3:], ("Xrotation",)]
    skeleton = Skeleton(["Hips", "Arm", "Knee"], [-1, 0, 0], np.zeros((3, 3)), channels)
    for a, b, message in (
        (["Hips", "Arm"], ["Arm.Xrotation"], "joint Arm.Xrotation must be in one"),
        (["Hips", "Arm.Yrotation"], ["Arm.Xrotation", "Knee"], "got none for Arm.Zrotation"),
        (["Arm"], ["Hips.Xrotation"], "Hips must be in one group as a whole"),
        (["Hips"], ["Arm", "Arm.Xrotation"], "as a whole or by channels, got both"),
        (["Hips"], ["Leg.Xrotation"], "group 'b': no joint is named 'Leg'"),
        (["Hips"], ["Knee.Xrotation"], "Knee must have three rotation channels .*, got Xrot"),
    ):
        with pytest.raises(ValueError, match=message):
            JointGroups({"a": a, "b": b}, base="a").resolve(skeleton)
