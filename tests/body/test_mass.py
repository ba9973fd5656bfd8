"""Properties of the mass model: masses, moments of inertia, heights and the up axis."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mograft import EndSite, Motion, Skeleton
from mograft.body.anatomy import anatomy
from mograft.body.mass import (
    center_of_mass,
    mass_model,
    mean_world_positions,
    moments_of_inertia,
    up_axis,
)
from tests import hierarchies, strategies
from tests.strategies import few_examples, scale_skeleton

TOTAL = 0.99995  # of the means of the table; the female masses sum to 99.99 %
KINDS = ["own", "subtree", "unit"]


def rest_motion(skeleton, axes=(0, 1, 2)):
    """A motion of two frames in the rest pose, in a world whose axes are permuted."""
    permuted = Skeleton(skeleton.names, skeleton.parents, skeleton.offsets[:, axes])
    return strategies.still_motion(permuted, 2)


@few_examples(40)
@given(hierarchies.skeletons())
def test_mass_model_masses_and_moments_of_random_skeletons_are_valid(skeleton):
    found = mass_model(skeleton)
    assert math.isclose(found.mass.sum(), 1.0, rel_tol=1e-12)
    assert (found.mass >= 0).all()
    is_zero = ~found.bone.any(axis=1)
    assert not found.inertia[is_zero].any()
    assert not moments_of_inertia(found, skeleton, "unit")[is_zero].any()
    assert np.isfinite(found.inertia).all()
    assert (found.inertia >= 0).all()


def test_mass_model_human_has_de_leva_masses():
    """Also where a part has several joints: its mass is divided by the lengths of their bones."""
    skeleton = hierarchies.human()
    found, left, right = mass_model(skeleton), skeleton.index("LeftHip"), skeleton.index("RightHip")
    assert found.model == "de Leva"
    assert found.mass[left] == pytest.approx(0.1447 / TOTAL, rel=1e-9)
    assert found.center[left] == pytest.approx(0.3855)
    assert found.gyration[right] == pytest.approx(0.3465)
    assert found.gyration[skeleton.index("LeftKnee")] == pytest.approx(0.2545)
    neck, head = skeleton.index("Neck"), skeleton.index("Head")
    lengths = np.linalg.norm([(0, 9, 2), (0, 18, 0)], axis=1)
    expected = 0.0681 / TOTAL * lengths / lengths.sum()
    np.testing.assert_allclose(found.mass[[neck, head]], expected, rtol=1e-9)
    assert found.center[neck] == found.center[head] == 0.5
    assert found.gyration[neck] == 0.289
    bone = dict(zip(skeleton.names, found.bone.tolist(), strict=True))
    assert bone["Chest"] == [0, pytest.approx(64 / 3), pytest.approx(2 / 3)]
    assert bone["LeftHip"] == [0, -41, 0]
    assert bone["LeftWrist"] == [17, 0, 0]
    leg, upper = 9 + 41 + math.hypot(40, 2), 22 + 24 + math.hypot(9, 2)
    assert found.height == pytest.approx((leg + upper) / 0.87)
    assert (found.height_from, found.head) == ("legs and head", head)
    feet = [(foot.side, foot.ankle, foot.toe) for foot in found.feet]
    assert feet == [("left", 3, None), ("right", 6, None)]


def test_mass_model_missing_part_adds_to_proximal_part():
    skeleton, _ = hierarchies.skeleton_from_text(
        "Hips {LeftHip > LeftKnee > LeftAnkle | RightHip > RightKnee > RightAnkle"
        " | Chest {LeftShoulder > LeftElbow | RightArm}}"
    )
    mass = TOTAL * mass_model(skeleton.with_offsets(np.full((11, 3), 1.0))).mass
    assert mass[skeleton.index("LeftElbow")] == pytest.approx(0.015 + 0.00585)
    assert mass[skeleton.index("RightArm")] == pytest.approx(0.0263 + 0.015 + 0.00585)
    trunk = mass[[skeleton.index("Hips"), skeleton.index("Chest")]].sum()
    assert trunk == pytest.approx(0.43015 + 0.0681)


@few_examples(40)
@given(hierarchies.skeletons(), st.floats(1e-3, 1e3))
def test_mass_model_scale_changes_only_height(skeleton, factor):
    assume(skeleton.offsets[1:].any())
    small, large = mass_model(skeleton), mass_model(scale_skeleton(skeleton, factor))
    assume(small.height_from != "nothing")
    assert math.isclose(large.height, factor * small.height, rel_tol=1e-9)
    np.testing.assert_allclose(large.mass, small.mass, rtol=1e-9)
    for kind in KINDS:
        found = moments_of_inertia(large, scale_skeleton(skeleton, factor), kind)
        expected = moments_of_inertia(small, skeleton, kind)
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-12)


@given(st.data(), st.booleans())
def test_mass_model_ignores_joint_order(data, is_named):
    skeleton = hierarchies.human() if is_named else hierarchies.without_names(hierarchies.human())
    order = data.draw(hierarchies.orders(skeleton))
    shuffled = hierarchies.with_order(skeleton, order)
    before, after = mass_model(skeleton), mass_model(shuffled)
    assert math.isclose(after.height, before.height, rel_tol=1e-12)
    for name in ("mass", "bone", "center", "gyration", "inertia"):
        np.testing.assert_allclose(getattr(after, name), getattr(before, name)[order], atol=1e-12)
    assert [order[foot.ankle] for foot in after.feet] == [foot.ankle for foot in before.feet]
    found = moments_of_inertia(after, shuffled, "subtree")
    expected = moments_of_inertia(before, skeleton, "subtree")[order]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_mass_model_markers_face_and_joints_above_hips_have_no_mass():
    skeleton, _ = hierarchies.skeleton_from_text(
        "joint_Root > Hips {LeftHip {LeftKnee > LeftAnkle | L_Femur_RIGMESH}"
        " | RightHip > RightKnee | Chest > Head {Jaw | LeftEye}}"
    )
    skeleton = skeleton.with_offsets(np.arange(36.0).reshape(12, 3))
    light = [skeleton.index(name) for name in ("joint_Root", "L_Femur_RIGMESH", "Jaw", "LeftEye")]
    sites = tuple(EndSite(joint, (0, 3, 0)) for joint in light)
    found = mass_model(replace(skeleton, end_sites=sites))
    assert not found.mass[light].any()
    hip, knee = skeleton.index("LeftHip"), skeleton.index("LeftKnee")
    np.testing.assert_array_equal(found.bone[hip], skeleton.offsets[knee])


def test_moments_of_inertia_subtree_matches_point_masses():
    skeleton = hierarchies.human()
    found, places = mass_model(skeleton), skeleton.rest_positions()

    def moment(joint, about):
        offset = places[joint] + found.bone[joint] * found.center[joint] - places[about]
        radius_of_gyration = found.gyration[joint] * np.linalg.norm(found.bone[joint])
        return found.mass[joint] * (offset @ offset + radius_of_gyration**2) / found.height**2

    joints = range(skeleton.n_joints)
    below = [np.flatnonzero(skeleton.subtree_mask(np.array([joint]))) for joint in joints]
    expected = [sum(moment(own, joint) for own in below[joint]) for joint in joints]
    np.testing.assert_allclose(moments_of_inertia(found, skeleton, "subtree"), expected, rtol=1e-9)
    own = [moment(joint, joint) for joint in joints]
    np.testing.assert_allclose(moments_of_inertia(found, skeleton), own, rtol=1e-9)


@pytest.mark.parametrize(
    ("text", "offset", "height", "source"),
    [
        ("Hips > LeftHip > LeftKnee > LeftAnkle", (0, 2, 0), 6 / 0.525, "legs"),
        ("Hips > Chest > Head", (0, 2, 0), 4 / 0.345, "head"),
        ("a > b > c", (0, 2, 0), 4, "longest path"),
        ("a {b > c | d}", (0, 2, 0), 6, "longest path"),
        ("a > b > c", (0, 0, 0), 1, "nothing"),
        ("Hips > Head", (0, 0, 0), 1, "nothing"),
        ("Hips", (5, 0, 0), 1, "nothing"),
    ],
)
def test_mass_model_height_of_partial_skeletons(text, offset, height, source):
    skeleton, _ = hierarchies.skeleton_from_text(text)
    found = mass_model(skeleton.with_offsets([offset] * skeleton.n_joints))
    assert found.height == pytest.approx(height)
    assert found.height_from == source


def test_mass_model_unknown_names_use_rods():
    skeleton, _ = hierarchies.skeleton_from_text("a {b > c | d}")
    found = mass_model(skeleton.with_offsets([[0, 0, 0], [0, 3, 0], [0, 1, 0], [0, 0, 0]]))
    assert (found.model, found.unmatched) == ("rods", ("a", "b", "c", "d"))
    lengths = np.linalg.norm(found.bone, axis=1)
    np.testing.assert_allclose(found.mass, lengths / lengths.sum())
    assert ({*found.center}, {*found.gyration}) == ({0.5}, {0.289})


@pytest.mark.parametrize("axes", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
@pytest.mark.parametrize(
    "skeleton",
    [
        hierarchies.human(),
        hierarchies.without_names(hierarchies.human()),
        Skeleton(["Hips", "Chest", "Head"], [-1, 0, 1], [[0, 0, 0], [1, 30, 0], [5, 20, 3]]),
    ],
    ids=["human", "nameless", "without feet"],
)
def test_up_axis_is_direction_from_feet_to_hips(skeleton, axes):
    assert up_axis(rest_motion(skeleton, axes)) == axes.index(1)


def test_up_axis_of_special_figures_is_y():
    """Without feet or bones; in a split, by the head; of an animal, whose head is in front."""
    split = hierarchies.human().offsets.copy()
    for joint, name in enumerate(hierarchies.human().names):
        if name.endswith(("Knee", "Ankle")):
            split[joint] = [0, 0, 40 if name.startswith("Left") else -40]
    leg = [(0, -10, 3), (0, -10, -3), (0, -8, 0)]
    animal, _ = hierarchies.skeleton_from_text(
        "Pelvis {Femur_L > Tibia_L > Tarsus_L | Femur_R > Tibia_R > Tarsus_R | Spine > Head}"
    )
    for skeleton, offsets in (
        (hierarchies.skeleton_from_text("a > b")[0], np.zeros((2, 3))),
        (hierarchies.human(), 0.0 * split),
        (hierarchies.human(), split),
        (animal, [(0, 0, 0), *leg, *leg, (0, 2, 50), (0, 10, 30)]),
    ):
        assert up_axis(rest_motion(skeleton.with_offsets(offsets))) == 1


@hierarchies.each_recording()
def test_mass_model_recordings_have_plausible_values(path):
    skeleton = hierarchies.read_hierarchy(path)
    found = mass_model(skeleton)
    assert found.mass.sum() == pytest.approx(1)
    assert (found.model == "de Leva") == anatomy(skeleton).human
    if found.model == "de Leva":
        assert found.height_from in ("legs and head", "legs")
        assert [foot.side for foot in found.feet] == ["left", "right"]
        assert 0.002 < found.inertia.sum() < 0.02
    nameless = mass_model(hierarchies.without_names(skeleton))
    assert nameless.height == pytest.approx(found.height, rel=0.25) or skeleton.n_joints < 14


@given(st.integers(1, 40), st.integers(1, 41), st.integers(0, 2**32 - 1))
def test_world_blocks_any_length_gives_same_bits(n_frames, length, seed):
    rng = np.random.default_rng(seed)
    skeleton = strategies.skeletons(rng, 6)
    quats = strategies.smooth_rotations(rng, n_frames, 6)
    motion = Motion(skeleton, 0.1, quats, rng.normal(size=(n_frames, 6, 3)))
    world = motion.world_transforms()[1]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mograft.motion.motion._FRAMES_PER_BLOCK", length)
        blocks = list(motion.world_blocks())
        np.testing.assert_array_equal(np.concatenate([own for _, _, own in blocks]), world)
        np.testing.assert_array_equal(motion.world_positions(), world)
        np.testing.assert_array_equal(mean_world_positions(motion), world.mean(axis=0))
        centers = center_of_mass(motion)
    np.testing.assert_array_equal(centers, center_of_mass(motion))
