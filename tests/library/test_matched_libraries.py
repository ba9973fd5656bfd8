"""Motions converted to another hierarchy, and libraries whose clips are matched by anatomy."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Library, SkeletonMismatchError, graft, replay, write_bvh, write_graft
from mograft.body.joint_matching import match_joints
from mograft.body.mass import mass_model, up_axis
from mograft.dancer import dance
from mograft.io.smpl.body_models import SMPL, SMPL_H, stand_in
from mograft.library.origin import hash_library
from mograft.library.spec import conform
from mograft.motion import rotations
from tests.hierarchies import with_joint_above_root
from tests.library.checks import DANCE, assert_same_libraries
from tests.library.other_figures import as_other_figure, other_names, with_other_rest_pose
from tests.strategies import (
    SEEDS,
    assert_same_rotations,
    few_examples,
    transform_motion,
    turn_motion,
)

pytestmark = pytest.mark.filterwarnings("ignore:joints matched by anatomy")

NAMES = ("a", "b", "c")
PARTS = {name: DANCE[90 * i : 90 * i + 200] for i, name in enumerate(NAMES)}
PARTS = {name: replace(part, name=name) for name, part in PARTS.items()}
OTHER = {name: as_other_figure(part, seed) for seed, (name, part) in enumerate(PARTS.items())}


build = partial(Library.build, match="anatomy")


def test_library_matched_by_anatomy_equals_that_of_one_figure():
    expected = Library.build(list(PARTS.values()))
    mixed = build([PARTS["a"], OTHER["b"], OTHER["c"]], hierarchy=DANCE.skeleton)
    assert mixed.skeleton.names == DANCE.skeleton.names
    assert mixed.up == expected.up
    np.testing.assert_array_equal(mixed.segments.start, expected.segments.start)
    for group, labels in expected.labels.items():
        np.testing.assert_array_equal(mixed.labels[group], labels)
        np.testing.assert_allclose(mixed.sigma[group], expected.sigma[group], rtol=1e-3)
    for own, other in zip(mixed.clips, expected.clips, strict=True):
        assert_same_rotations(own.rotations, other.rotations, atol=1e-5)
        np.testing.assert_allclose(own.world_positions(), other.world_positions(), atol=0.05)


def test_library_of_names_refuses_other_hierarchy_and_names_the_remedy():
    with pytest.raises(SkeletonMismatchError, match="unless joints are matched by anatomy"):
        Library.build([PARTS["a"], OTHER["b"]])


def test_library_matched_by_anatomy_warns_of_joints_without_counterpart():
    body = conform(PARTS["b"], stand_in(SMPL_H), up=2, root=0)
    with pytest.warns(UserWarning, match="joints matched by anatomy, b: .*dropped: .*left_index1"):
        library = Library.build([PARTS["a"], body], match="anatomy")
    assert library.skeleton.names == PARTS["a"].skeleton.names
    with pytest.warns(UserWarning, match="joints matched by anatomy, a: kept at rest: .*left_foot"):
        library = Library.build([PARTS["a"], body], match="anatomy", hierarchy=body.skeleton)
    assert library.skeleton.names == SMPL_H.joints


def test_graft_of_other_figure_is_on_the_hierarchy_of_the_library():
    library = build([PARTS["a"], OTHER["b"]])
    base = OTHER["c"]
    result = graft(library, base, seed=1)
    assert result.motion.skeleton.names == DANCE.skeleton.names
    expected = graft(build([PARTS["a"], OTHER["b"]]), library.spec.fit(base, "c"), seed=1)
    np.testing.assert_array_equal(result.motion.rotations, expected.motion.rotations)
    # A clip of the library is found, although its motion has another hierarchy.
    assert library.resolve_base(OTHER["b"])[1] == 1


@pytest.fixture
def files(tmp_path):
    """Two clips of one hierarchy and one of another one."""
    folder = tmp_path / "clips"
    folder.mkdir()
    write_bvh(PARTS["a"], folder / "a.bvh")
    write_bvh(PARTS["c"], folder / "c.bvh")
    write_bvh(OTHER["b"], folder / "b.bvh")
    return folder


def test_index_matched_by_anatomy_equals_build_and_is_kept(files, tmp_path):
    stored = Library.index(files, tmp_path / "l", match="anatomy")
    built = Library.build([files / name for name in ("a.bvh", "b.bvh", "c.bvh")], match="anatomy")
    assert_same_libraries(stored, built)
    again = Library.open(tmp_path / "l")
    assert again.spec.match == "anatomy"
    assert again.refused == {}
    again.save(tmp_path / "copy")
    assert_same_libraries(Library.open(tmp_path / "copy"), stored)
    with pytest.raises(TypeError, match="`match` is fixed"):
        again.add(files, match="names")


def test_hash_of_library_depends_on_the_hierarchy_and_the_rest_pose(files):
    skeleton = PARTS["a"].skeleton
    larger = skeleton.with_offsets(1.5 * skeleton.offsets)
    hashes = [
        hash_library(Library.build(files, match="anatomy", hierarchy=own, skeleton=rest))
        for own, rest in ((skeleton, None), (larger, None), (skeleton, skeleton))
    ]
    assert len(set(hashes)) == 3


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("is_stored", [False, True])
def test_replay_of_matched_clips_gives_the_same_bytes(files, tmp_path, is_stored):
    names = [files / name for name in ("b.bvh", "a.bvh", "c.bvh")]
    if is_stored:
        library = Library.index(files, tmp_path / "l", match="anatomy")
    else:
        library = Library.build(names, match="anatomy", hierarchy=OTHER["a"].skeleton)
    made = graft(library, library.names[1], seed=2)
    write_graft(made, tmp_path / "g.bvh")
    again = replay(tmp_path / "g.json")
    np.testing.assert_array_equal(again.motion.rotations, made.motion.rotations)
    np.testing.assert_array_equal(again.motion.positions, made.motion.positions)


TAKE = dance(strides=1).motion[::20]
SCALES = [1.0, 0.01, 1 / 2.54]  # to centimetres, metres and inches


@few_examples(30)
@given(SEEDS, st.sampled_from(SCALES), st.integers(0, 2))
def test_conform_undoes_names_units_axes_and_rest_pose(seed, scale, up):
    rng = np.random.default_rng(seed)
    turn = rotations.shortest_arc(np.eye(3)[1], np.eye(3)[up])
    posed = with_other_rest_pose(turn_motion(transform_motion(TAKE, scale), turn), rng)
    skeleton = posed.skeleton
    posed = replace(posed, skeleton=replace(skeleton, names=tuple(other_names(skeleton))))
    assert not {*posed.skeleton.names} & {*TAKE.skeleton.names}
    assert up_axis(posed) == up
    result = conform(posed, TAKE.skeleton, up=1, root=0)
    size = mass_model(TAKE.skeleton).height
    np.testing.assert_allclose(result.world_positions(), TAKE.world_positions(), atol=1e-4 * size)
    assert_same_rotations(result.rotations, TAKE.rotations, atol=1e-6)
    assert result.skeleton.names == TAKE.skeleton.names
    offsets = result.skeleton.offsets[1:]
    np.testing.assert_allclose(offsets, TAKE.skeleton.offsets[1:], atol=1e-6 * size)


def test_conform_same_hierarchy_is_the_motion_itself():
    larger = TAKE.skeleton.with_offsets(2 * TAKE.skeleton.offsets)
    assert conform(TAKE, larger, up=2, root=0) is TAKE


def test_conform_absent_joints_rest_and_limbs_bend_and_are_as_long_as_in_the_clip():
    target = stand_in(SMPL)
    match = match_joints(target, TAKE.skeleton)
    assert match.absent
    result = conform(TAKE, target, up=2, root=0)
    for joint, source in enumerate(match.sources.tolist()):
        if source < 0:
            assert_same_rotations(result.rotations[:, joint], rotations.IDENTITY, atol=1e-12)
    own, theirs = result.world_transforms(), TAKE.world_transforms()
    turn = rotations.shortest_arc(np.eye(3)[1], np.eye(3)[2])
    expected = 0.01 * rotations.rotate(turn, theirs[1][:, 0])
    np.testing.assert_allclose(own[1][:, 0], expected, atol=1e-9)
    # The knees bend as they do in the clip: the turn between thigh and shank is the same.
    for upper, lower in (("left_hip", "left_knee"), ("right_shoulder", "right_elbow")):
        joints = [target.names.index(name) for name in (upper, lower)]
        sources = match.sources[joints]
        bends = [
            rotations.angle(world[:, pair[0]], world[:, pair[1]])
            for world, pair in ((own[0], joints), (theirs[0], sources))
        ]
        # The rest poses bend differently by less than 0.1 rad.
        np.testing.assert_allclose(*bends, atol=0.1)
        lengths = [
            np.linalg.norm(skeleton.offsets[pair[1]])
            for skeleton, pair in ((result.skeleton, joints), (TAKE.skeleton, sources))
        ]
        assert lengths[0] == pytest.approx(0.01 * lengths[1])
    height = 0.01 * mass_model(TAKE.skeleton).height
    assert mass_model(result.skeleton).height == pytest.approx(height, rel=0.05)


@pytest.mark.parametrize("root", [0, 1])
def test_conform_root_carrier_without_counterpart_moves_only_if_it_is_the_root(root):
    target = with_joint_above_root(TAKE, 0.0).skeleton
    result = conform(TAKE, target, up=1, root=root)
    np.testing.assert_allclose(result.world_positions()[:, 1:], TAKE.world_positions(), atol=1e-9)
    assert result.is_translated[:2].tolist() == [root == 0, root == 1]
    assert_same_rotations(result.rotations[:, 0], rotations.IDENTITY, atol=1e-12)


def test_conform_translated_joint_keeps_positions_and_gets_channels():
    positions = TAKE.positions.copy()
    joint = TAKE.skeleton.names.index("LeftForeArm")
    positions[:, joint] += np.linspace(0, 3, TAKE.n_frames)[:, None]
    moved = replace(TAKE, positions=positions, channel_values=None)
    names = tuple(other_names(moved.skeleton))
    renamed = replace(moved, skeleton=replace(moved.skeleton, names=names))
    result = conform(renamed, TAKE.skeleton, up=1, root=0)
    np.testing.assert_allclose(result.world_positions(), moved.world_positions(), atol=1e-6)
    assert result.skeleton.channels[joint][:3] == ("Xposition", "Yposition", "Zposition")
