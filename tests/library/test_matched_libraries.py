"""Libraries whose clips have different hierarchies, matched by anatomy."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from mograft import Library, SkeletonMismatchError, graft, replay, write_bvh, write_graft
from mograft.io.smpl.body_models import SMPL_H, stand_in
from mograft.library.origin import hash_library
from mograft.library.spec import conform
from tests.library.checks import DANCE, assert_same_libraries
from tests.library.other_figures import as_other_figure
from tests.strategies import assert_same_rotations

NAMES = ("a", "b", "c")
PARTS = {name: DANCE[90 * i : 90 * i + 200] for i, name in enumerate(NAMES)}
PARTS = {name: replace(part, name=name) for name, part in PARTS.items()}
OTHER = {name: as_other_figure(part, seed) for seed, (name, part) in enumerate(PARTS.items())}


def build(clips, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return Library.build(clips, match="anatomy", **options)


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


@pytest.mark.filterwarnings("ignore:joints matched by anatomy")
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


@pytest.mark.filterwarnings("ignore:joints matched by anatomy")
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
