"""Laws of the library: clips in, segments with labels out."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mograft import Config, JointGroups, Library, Motion, SkeletonMismatchError, write_bvh
from mograft.dancer import dance
from mograft.motion import rotations
from tests.oracles import pipeline as plain
from tests.strategies import motions


@pytest.fixture(scope="module")
def motion():
    return dance(seed=3, strides=1).motion


@pytest.fixture(scope="module")
def library(motion):
    return Library.build(motion)


def test_every_segment_has_a_label_and_every_cluster_keeps_its_diameter(library):
    for group, own in library.embedding.items():
        labels = library.labels[group]
        assert len(labels) == len(own.points) == len(library.segments)
        for cluster in range(labels.max() + 1):
            points = own.points[labels == cluster]
            apart = np.linalg.norm(points[:, None] - points, axis=-1)
            assert apart.max() <= library.sigma[group]


def test_labels_are_those_of_the_plain_version(motion, library):
    bounds = np.array([0, *library.segments.stop])
    for group, own in library.embedding.items():
        root = 0 if own.has_root else None
        matrix = plain.features(
            motion.rotations,
            motion.positions[:, 0],
            bounds,
            own.joints,
            root,
            library.up,
            1.0,
            motion.frame_time,
            library.config,
        )
        n_rotations = 30 * len(own.joints)
        matrix[:, n_rotations:-1] /= heights(motion)
        points = plain.embed(matrix, n_rotations, library.config)
        # Samples are stored in single precision, and loadings are rounded to about 1e-6.
        np.testing.assert_allclose(own.points, points, atol=3e-5)
        sigma = plain.sigma(points, library.config)
        assert library.sigma[group] == pytest.approx(sigma, rel=1e-6)
        same = plain.cluster(points, sigma)
        pairs = {*zip(same.tolist(), library.labels[group].tolist(), strict=True)}
        assert len(pairs) == same.max() == library.labels[group].max() + 1


def heights(motion):
    from mograft.body.mass import mass_model

    return mass_model(motion.skeleton).height


def test_clips_are_cut_each_by_itself(motion):
    whole = Library.build([motion[:300], motion[300:700]])
    for index, clip in enumerate(whole.clips):
        own = whole.segments.of_clip(index)
        assert whole.segments.start[own[0]] == 0
        assert whole.segments.stop[own[-1]] == clip.n_frames - 1
    assert [clip.name for clip in whole.clips] == ["dance", "dance~2"]


def test_offsets_may_differ_and_sizes_do_not_count(motion):
    skeleton = motion.skeleton
    sites = [replace(site, offset=site.offset * 2.5) for site in skeleton.end_sites]
    grown = replace(
        motion,
        skeleton=replace(skeleton, offsets=skeleton.offsets * 2.5, end_sites=sites),
        positions=motion.positions * 2.5,
        channel_values=None,
    )
    pair = Library.build([motion, grown])
    half = len(pair.segments) // 2
    for own in pair.embedding.values():
        np.testing.assert_allclose(own.points[:half], own.points[half:], atol=1e-5)


def test_other_hierarchies_are_refused_by_joint(motion):
    names = list(motion.skeleton.names)
    names[3] = "Hoof"
    other = replace(motion, skeleton=replace(motion.skeleton, names=names), name="goat")
    with pytest.raises(SkeletonMismatchError, match=r"goat lacks LeftFoot and has also Hoof"):
        Library.build([motion, other])


def test_a_clip_of_one_frame_is_refused(motion):
    with pytest.raises(ValueError, match="still must have at least 2 frames, got 1"):
        Library.build([motion, replace(motion[:1], name="still")])
    with pytest.raises(ValueError, match="sources must hold at least one clip"):
        Library.build([])


def test_files_and_globs_are_read_in_order_of_name(motion, tmp_path):
    for name in ("b", "a", "c"):
        write_bvh(motion[:200], tmp_path / f"{name}.bvh")
    found = Library.build(str(tmp_path / "*.bvh"))
    assert [clip.name for clip in found.clips] == ["a", "b", "c"]
    assert len(Library.build(tmp_path / "a.bvh").clips) == 1
    with pytest.raises(FileNotFoundError, match="no file matches"):
        Library.build(str(tmp_path / "*.fbx"))
    with pytest.raises(FileNotFoundError, match="No such file"):
        Library.index([tmp_path / "a.bvh", tmp_path / "missing.bvh"], tmp_path / "library")


def test_other_rates_are_resampled_to_the_commonest_and_said(motion):
    fast = replace(motion[:400].resample(60.0), name="fast")
    with pytest.warns(UserWarning, match="resampled to 30 fps, the rate of most frames: fast"):
        mixed = Library.build([motion, fast])
    assert mixed.clips[1].rate == pytest.approx(30.0)


def test_a_constant_pose_is_a_library_with_a_warning(motion):
    still = replace(
        motion[:200],
        rotations=np.tile(motion.rotations[:1], (200, 1, 1)),
        positions=np.tile(motion.positions[:1], (200, 1, 1)),
        channel_values=None,
    )
    with pytest.warns(UserWarning, match="alike|too few"):
        library = Library.build(still)
    assert all(own is None for own in library.embedding.values())
    np.testing.assert_array_equal(library.labels["lower"], np.arange(len(library.segments)))


def test_a_lone_segment_is_a_library_with_a_warning(motion):
    with pytest.warns(UserWarning, match="1 segment is too few to compare"):
        library = Library.build(motion[:4])
    assert len(library.segments) == 1


def test_groups_must_fit(motion):
    groups = JointGroups({"lower": ["Hips"], "upper": ["Spine"]}, base="lower")
    with pytest.raises(ValueError, match="LeftUpLeg"):
        Library.build(motion, groups)
    with pytest.raises(ValueError, match="wings"):
        Library.build(motion, "wings")


def test_a_motion_put_among_its_own_segments_falls_into_their_clusters(motion, library):
    """The same motion, moved and turned, is found again by what it does."""
    turn = rotations.from_axis_angle([0, 1, 0], 1.0)
    quats, places = motion.rotations.copy(), motion.positions.copy()
    quats[:, 0] = rotations.multiply(turn, quats[:, 0])
    places[:, 0] = rotations.rotate(turn, places[:, 0]) + np.array([5.0, 0.0, 9.0])
    moved = replace(motion, rotations=quats, positions=places, name="moved", channel_values=None)
    longer, at = library.resolve_base(moved)
    assert at == 1
    own = longer.segments.of_clip(1)
    np.testing.assert_array_equal(longer.labels["lower"][own], library.labels["lower"])
    assert not longer.is_donor[own].any()
    assert library.resolve_base(motion)[1] == 0
    assert library.resolve_base("dance")[1] == 0
    with pytest.raises(ValueError, match="base must be a clip, one of dance; got 'walk'"):
        library.resolve_base("walk")


def test_a_motion_from_outside_stretches_no_cluster(motion, library):
    other = dance(seed=8, strides=1).motion
    longer, at = library.resolve_base(other)
    new = longer.segments.of_clip(at)
    config = library.config
    both = Library.build([motion, other], config=config)
    assert len(both.segments) == len(longer.segments)
    own = library.embedding["lower"]
    points = project(library, other)
    labels = longer.labels["lower"]
    assert (labels[new] <= library.labels["lower"].max()).any()
    for point, label in zip(points, labels[new], strict=True):
        members = own.points[library.labels["lower"] == label]
        if len(members):
            assert np.linalg.norm(members - point, axis=1).max() <= library.sigma["lower"]


def project(library, motion):
    from mograft import segment
    from mograft.analysis.embedding import features, normalise

    own = library.embedding["lower"]
    samples = normalise(
        [motion],
        segment(motion),
        library.config,
        root=library.root,
        up=library.up,
        heights=[heights(motion)],
    )
    return own.project(features(samples, own.joints, own.reference, has_root=True))


def test_labels_follow_sigma_and_nothing_else_changes(library):
    wider = library.relabelled(replace(library.config, sigma_scale=1.5))
    assert wider.labels["lower"].max() < library.labels["lower"].max()
    assert wider.segments is library.segments
    back = wider.relabelled(library.config)
    np.testing.assert_array_equal(back.labels["lower"], library.labels["lower"])
    with pytest.raises(ValueError, match=r"samples must be 10, .* the library was built; got 5"):
        library.relabelled(replace(library.config, samples=5))


def test_candidates_are_listed_with_reasons(library):
    for segment in (0, 5, len(library.segments) - 1):
        found = library.candidates(segment, "upper")
        assert found.allowed[0].segment == segment
        assert all(candidate.refused for candidate in found.refused)
    with pytest.raises(ValueError, match="group must not be the base group, 'lower'"):
        library.candidates(0, "lower")
    with pytest.raises(ValueError, match="group must be one of lower, upper, got 'tail'"):
        library.candidates(0, "tail")
    with pytest.raises(ValueError, match="segment must be 0 to"):
        library.candidates(99_999, "upper")


@pytest.mark.filterwarnings("ignore::UserWarning")  # of leaps and the like, which are random here
@settings(max_examples=20)
@given(motions(min_frames=60, min_joints=3), st.integers(0, 1))
def test_any_skeleton_goes_with_groups_of_its_own(motion, paper):
    names = list(motion.skeleton.names)
    groups = JointGroups({"base": names[:2], "rest": names[2:]}, base="base")
    library = Library.build(motion, groups, Config.paper() if paper else Config())
    assert isinstance(library.clips[0], Motion)
    assert len(library.labels["rest"]) == len(library.segments)
