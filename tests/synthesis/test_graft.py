"""Properties of grafts: kept and exchanged parts, provenance and errors."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import mograft as mg
import mograft.constraints as mc
from mograft import Config, JointGroups, Library, graft, graft_many, read_bvh, write_bvh
from mograft.dancer import dance
from mograft.motion import rotations
from tests.strategies import transform_motion, with_config


@pytest.fixture(scope="module")
def motion():
    return dance(seed=1, strides=1).motion


@pytest.fixture(scope="module")
def library(motion):
    return Library.build(motion, "lower_torso_larm_rarm")


def columns(motion, joints):
    return [c for j in joints for c in motion.skeleton.channel_columns[j]]


def test_graft_base_group_keeps_every_channel_value(library, motion):
    new = graft(library, seed=4)
    kept = columns(motion, library.joints("lower"))
    others = np.setdiff1d(np.arange(motion.skeleton.n_channels), kept)
    before, after = motion.channel_numbers(), new.motion.channel_numbers()
    assert_array_equal(after[:, kept], before[:, kept])
    assert (after[:, others] != before[:, others]).any()
    assert new.motion.n_frames == motion.n_frames


def test_graft_same_seed_gives_identical_files(library, motion, tmp_path):
    paths = [tmp_path / f"{i}.bvh" for i in range(3)]
    for choice in ("sample", "random"):
        random_library = with_config(library, choice=choice)
        for path, seed in zip(paths, (7, 7, 8), strict=True):
            write_bvh(graft(random_library, motion, seed=seed).motion, path)
        first, again, other = (path.read_bytes() for path in paths)
        assert first == again != other


@pytest.mark.filterwarnings("ignore:at most 1 different motion")
def test_graft_without_other_candidates_returns_the_file(motion, tmp_path):
    """With clusters of diameter 0 every segment is its own only candidate."""
    path = tmp_path / "dance.bvh"
    write_bvh(motion, path)
    read = read_bvh(path)
    library = Library.build(read, config=Config(sigma_scale=1e-9))
    new = graft(library)
    assert_array_equal(new.motion.channel_numbers(), read.channel_values)
    assert_array_equal(new.motion.rotations, read.rotations)
    assert "had no candidate and were kept" in new.report()
    write_bvh(new.motion, tmp_path / "same.bvh")
    assert (tmp_path / "same.bvh").read_bytes() == path.read_bytes()
    assert len(list(graft_many(library, count=3, widen=False))) == 1


@pytest.mark.parametrize("choice", ["sample", "viterbi", "random"])
@pytest.mark.parametrize("distinct", [0.0, 0.05])
def test_graft_many_motions_do_not_depend_on_the_count(library, choice, distinct):
    configured = with_config(library, choice=choice)
    few, many = (graft_many(configured, count=n, distinct=distinct) for n in (2, 5))
    assert len({own.motion.rotations.tobytes() for own in many}) == len(many) >= 4
    for own, other in zip(few, many, strict=False):
        np.testing.assert_array_equal(own.motion.rotations, other.motion.rotations)


def test_graft_without_novelty_is_the_captured_motion(library, motion):
    new = graft(with_config(library, choice="viterbi", novelty=0.0))
    assert_array_equal(new.motion.channel_numbers(), motion.channel_numbers())


@pytest.mark.parametrize(
    "changes",
    [{}, {"choice": "viterbi"}, {"seam": "paper"}, {"seam": "inertial"}],
    ids=lambda own: next(iter(own.values()), "default"),
)
def test_graft_quaternion_signs_change_no_choice_and_no_pose(motion, changes):
    motion = replace(motion[:1200], channel_values=None)
    signs = np.random.default_rng(7).choice([-1.0, 1.0], motion.rotations.shape[:2])
    flipped = replace(motion, rotations=motion.rotations * signs[..., None])
    config = Config(**changes)
    one, other = (graft(Library.build(own, config=config), seed=3) for own in (motion, flipped))
    assert [s.donor for s in one.substitutions] == [s.donor for s in other.substitutions]
    assert any(not s.is_own for s in one.substitutions)
    assert_allclose(other.motion.world_positions(), one.motion.world_positions(), atol=1e-9)


@pytest.mark.parametrize("choice", ["viterbi", "sample"])
def test_graft_order_of_group_names_changes_nothing(motion, choice):
    groups = JointGroups.preset("lower_torso_larm_rarm", motion.skeleton).groups
    grafts = [
        graft(Library.build(motion, JointGroups(own, base="lower"), Config(choice=choice)), seed=1)
        for own in (groups, dict(reversed(groups.items())))
    ]
    assert_array_equal(grafts[1].motion.rotations, grafts[0].motion.rotations)


def test_graft_base_outside_the_library_takes_donors_of_the_library(library):
    other = replace(dance(seed=9, strides=1).motion, name="other")
    new = graft(library, other, seed=1)
    assert new.base is other
    assert {s.clip for s in new.substitutions} <= {"dance", "other"}
    assert any(s.clip == "dance" for s in new.substitutions)
    kept = columns(other, library.joints("lower"))
    assert_array_equal(new.motion.channel_numbers()[:, kept], other.channel_numbers()[:, kept])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda lib: graft(lib, swap=["lower"]), "`swap` must not have the base group"),
        (lambda lib: graft(lib, swap=[]), "`swap` must name at least one of"),
        (lambda lib: graft(lib, seed=-1), "`seed` must be a whole number of at least 0, got -1"),
        (lambda lib: graft_many(lib, count=0), "`count` must be a whole number .* 1, got 0"),
    ],
)
def test_graft_bad_argument_raises_value_error(library, call, message):
    with pytest.raises(ValueError, match=message):
        call(library)


def test_graft_base_of_another_skeleton_raises_skeleton_mismatch_error(library, motion):
    names = ["Hip", *motion.skeleton.names[1:]]
    other = replace(motion, skeleton=replace(motion.skeleton, names=names), name="other")
    with pytest.raises(mg.SkeletonMismatchError, match="other lacks Hips and also has Hip"):
        graft(library, other)


def upper_based(motion):
    lower = motion.skeleton.names[:7]
    return JointGroups({"lower": lower, "upper": motion.skeleton.names[7:]}, base="upper")


def test_graft_upper_body_base_keeps_its_channels_and_plants_the_feet(motion):
    library = Library.build(motion, upper_based(motion))
    new = graft(library, seed=1)
    kept = columns(motion, library.joints("upper"))
    before, after = motion.channel_numbers(), new.motion.channel_numbers()
    assert_array_equal(after[:, kept], before[:, kept])
    assert (after != before).any()
    # The motion starts at the position of the base, up to the shift by foot planting.
    assert_allclose(after[0, [0, 2]], before[0, [0, 2]], atol=0.01)
    assert new.feet.skate_after <= mg.foot_skate(motion)
    assert new.feet.unreached_frames == 0
    assert "feet: " in new.report()
    assert mg.graft_record(new)["feet"]["plants"] == new.feet.plants


def test_graft_donors_at_another_position_and_heading_are_aligned(motion):
    """Legs of the same dance at another position and heading give the same dance."""
    away = transform_motion(motion, yaw=2.0, offset=(300.0, 0.0, -80.0))
    away = replace(away, name="away")
    config = Config(sigma_scale=1e-6, feet="never")
    library = Library.build([motion, away], upper_based(motion), config)
    n = len(library.segments.of_clip(0))
    new = graft(library, constraints=[mc.Use(own, own + n) for own in range(n)])
    assert {s.clip for s in new.substitutions} == {"away"}
    assert_allclose(new.motion.positions, motion.positions, atol=1e-6)
    assert rotations.angle(new.motion.rotations, motion.rotations).max() < 1e-6


def test_graft_feet_report_is_none_if_feet_are_kept_or_disabled(library, motion):
    assert graft(library, seed=1).feet is None
    loose = Library.build(motion, upper_based(motion), Config(feet="never"))
    assert graft(loose, seed=1).feet is None
    kept = mc.KeepOriginal(frames=(0, motion.n_frames - 1))
    assert graft(Library.build(motion, upper_based(motion)), constraints=[kept]).feet is None
