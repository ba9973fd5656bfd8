"""Properties of libraries in memory: building, querying, deriving, pickling."""

import multiprocessing
import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft import Config, JointGroups, Library, LibraryError, graft, write_bvh
from mograft.body.mass import mass_model
from mograft.dancer import dance
from tests.hierarchies import with_joint_above_root
from tests.library.checks import DANCE, assert_same_libraries
from tests.oracles import analysis as oracle
from tests.strategies import transform_motion


@pytest.fixture(scope="module")
def motion():
    return dance(seed=3, strides=1).motion


@pytest.fixture(scope="module")
def library(motion):
    return Library.build(motion)


def test_build_labels_match_oracle(motion, library):
    bounds = np.array([0, *library.segments.stop])
    for group, embedding in library.embedding.items():
        root = 0 if embedding.has_root else None
        places, size, up = motion.positions[:, 0], mass_model(motion.skeleton).height, library.up
        how = (embedding.joints, root, up, size, motion.frame_time, library.config)
        matrix = oracle.features(motion.rotations, places, bounds, *how)
        n_rotations = 30 * len(embedding.joints)
        points = oracle.embed(matrix, n_rotations, library.config)
        # Samples are stored in single precision, and loadings are rounded to about 1e-6.
        np.testing.assert_allclose(embedding.points, points, atol=3e-5)
        sigma = oracle.max_cluster_diameter(points, library.config)
        assert library.sigma[group] == pytest.approx(sigma, rel=1e-6)
        expected = oracle.cluster(points, sigma)
        pairs = {*zip(expected.tolist(), library.labels[group].tolist(), strict=True)}
        assert len(pairs) == expected.max() == library.labels[group].max() + 1


def test_build_globs_are_sorted_by_name(motion, tmp_path):
    for name in ("b", "a", "c"):
        write_bvh(motion[:200], tmp_path / f"{name}.bvh")
    library = Library.build(str(tmp_path / "*.bvh"))
    assert [clip.name for clip in library.clips] == ["a", "b", "c"]
    assert len(Library.build(tmp_path / "a.bvh").clips) == 1
    with pytest.raises(FileNotFoundError, match="no file matches"):
        Library.build(str(tmp_path / "*.fbx"))
    with pytest.raises(FileNotFoundError, match="No such file"):
        Library.index([tmp_path / "a.bvh", tmp_path / "missing.bvh"], tmp_path / "library")


def test_build_constant_pose_has_no_embedding_and_warns(motion):
    still = replace(
        motion[:200],
        rotations=np.tile(motion.rotations[:1], (200, 1, 1)),
        positions=np.tile(motion.positions[:1], (200, 1, 1)),
        channel_values=None,
    )
    with pytest.warns(UserWarning, match="alike|too few"):
        library = Library.build(still)
    assert all(embedding is None for embedding in library.embedding.values())
    np.testing.assert_array_equal(library.labels["lower"], np.arange(len(library.segments)))


def test_resolve_base_moved_copy_joins_the_same_clusters(motion, library):
    moved = transform_motion(motion, yaw=1.0, offset=(5.0, 0.0, 9.0))
    extended, index = library.resolve_base(moved)
    assert index == 1
    new = extended.segments.of_clip(1)
    np.testing.assert_array_equal(extended.labels["lower"][new], library.labels["lower"])
    assert not extended.is_donor[new].any()
    assert library.resolve_base(motion)[1] == 0
    assert library.resolve_base("dance")[1] == 0
    with pytest.raises(ValueError, match="`base` must be a clip, one of dance; got 'walk'"):
        library.resolve_base("walk")


def test_with_clip_new_motion_keeps_cluster_diameters(motion, library):
    other = dance(seed=8, strides=1).motion
    extended = library.with_clip(other)
    new = extended.segments.of_clip(1)
    both = Library.build([motion, other], config=library.config)
    assert len(both.segments) == len(extended.segments)
    embedding, labels = library.embedding["lower"], extended.labels["lower"]
    points = extended.embedding["lower"].points[new]
    assert (labels[new] <= library.labels["lower"].max()).any()
    for point, label in zip(points, labels[new], strict=True):
        members = embedding.points[library.labels["lower"] == label]
        if len(members):
            assert np.linalg.norm(members - point, axis=1).max() <= library.sigma["lower"]


def test_relabelled_changes_labels_only(library):
    wider = library.relabelled(replace(library.config, sigma_scale=1.5))
    assert wider.labels["lower"].max() < library.labels["lower"].max()
    assert wider.segments is library.segments
    back = wider.relabelled(library.config)
    np.testing.assert_array_equal(back.labels["lower"], library.labels["lower"])
    with pytest.raises(ValueError, match=r"`samples` must be 10, .* the library was built; got 5"):
        library.relabelled(replace(library.config, samples=5))


def test_candidates_list_reasons_and_check_arguments(library):
    candidates = mg.candidates(library, 5, "upper")
    assert candidates.allowed[0].segment == 5
    assert all(candidate.refused for candidate in candidates.refused)
    with pytest.raises(ValueError, match="not the base group, which is kept; got 'lower'"):
        mg.candidates(library, 0, "lower")
    with pytest.raises(ValueError, match="`group` must be one of lower, upper, got 'tail'"):
        mg.candidates(library, 0, "tail")


def test_build_root_is_that_of_most_clips():
    """One clip moves by the joint above the hips, two by the hips."""
    hips, dummy = (with_joint_above_root(DANCE, share) for share in (0.0, 1.0))
    assert [own.locomotion_root() for own in (hips, dummy)] == [1, 0]
    names = list(hips.skeleton.names)
    groups = JointGroups({"low": names[:8], "high": names[8:]}, base="low")
    library = Library.build([dummy[:160], hips[160:320], hips[320:480]], groups)
    assert library.root == 1
    expected = Library.build([hips[:160], hips[160:320], hips[320:480]], groups)
    chunks = zip(library.samples.chunks(), expected.samples.chunks(), strict=True)
    for chunk, expected_chunk in chunks:
        np.testing.assert_allclose(chunk.rows, expected_chunk.rows, atol=1e-5)


PARTS = JointGroups({"lower": ["Hips"], "upper": ["Spine"]}, base="lower")


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"sources": []}, ValueError, "`sources` must hold at least one clip"),
        (
            {"sources": replace(DANCE[:1], name="single")},
            ValueError,
            "`single` must have at least 2",
        ),
        ({"groups": PARTS}, ValueError, "LeftUpLeg"),
        ({"groups": "wings"}, ValueError, "wings"),
        ({"match": "anatomi"}, ValueError, "`match` must be one of 'names', 'anatomy', got 'anat"),
        ({"tag": {}}, TypeError, "unexpected keyword argument 'tag'"),
        ({"tags": ["slow"]}, TypeError, "`tags` must be a Mapping, got list"),
        ({"frame_rates": 30.0}, TypeError, "`frame_rates` must be a Mapping, got float"),
        ({"progress": 3}, TypeError, "`progress` must be a function, got int"),
        ({"executor": 3}, TypeError, "`executor` must be a Executor, got int"),
        ({"config": {}}, TypeError, "`config` must be a Config, got dict"),
    ],
)
def test_build_invalid_argument_is_refused(options, error, message):
    with pytest.raises(error, match=message):
        Library.build(**{"sources": DANCE[:200], **options})


BASE = replace(DANCE[700:900], name="base")
# 3.7 and 4 intervals cannot have the same rate: the rate stays above the library's.
FAST = replace(BASE[:5], frame_time=BASE.frame_time * 0.92)


def test_pickle_of_library_in_memory_holds_its_arrays(stored_library):
    library = Library.build(DANCE[:160])
    again = pickle.loads(pickle.dumps(library))
    assert_same_libraries(again, library)
    # A library with replaced fields is no longer that of the folder.
    changed = replace(stored_library, is_donor=np.zeros_like(stored_library.is_donor))
    again = pickle.loads(pickle.dumps(changed))
    assert_same_libraries(again, changed)
    assert not again.is_donor.any()


@settings(max_examples=20)
@given(st.lists(st.sampled_from(["relabelled", "extended", "resampled"]), max_size=3), st.data())
def test_pickle_of_stored_or_derived_library_is_small_and_equal(stored_library, steps, data):
    """Whatever was derived from a stored library, and in which order; unpickling does not warn."""
    library, n_motions = stored_library, 0
    for step in steps:
        if step == "extended":
            library, n_motions = library.with_clip(BASE), n_motions + 1
        elif step == "resampled":
            with pytest.warns(UserWarning, match="is resampled from"):
                library, n_motions = library.with_clip(FAST), n_motions + 1
        else:
            scale = data.draw(st.sampled_from([0.3, 0.5, 1.0, 2.0]))
            library = library.relabelled(Config(sigma_scale=scale))
    pickled = pickle.dumps(library)
    again = pickle.loads(pickled)
    assert_same_libraries(again, library)
    assert again.refused == library.refused
    assert len(pickled) < 100_000 + n_motions * len(pickle.dumps(BASE))
    assert len(pickle.dumps(again)) == len(pickled)


def test_unpickle_changed_folder_raises_library_error(stored_library, clip_folder, tmp_path):
    shutil.copytree(stored_library.folder, tmp_path / "l")
    data = pickle.dumps(Library.open(tmp_path / "l"))
    Library.index(clip_folder / "c.bvh", tmp_path / "l", force=True)
    with pytest.raises(LibraryError, match="has changed since the library was pickled"):
        pickle.loads(data)
    shutil.rmtree(tmp_path / "l")
    with pytest.raises(FileNotFoundError):
        pickle.loads(data)


def test_pickle_relative_folder_opens_from_another_directory(stored_library, tmp_path, monkeypatch):
    monkeypatch.chdir(stored_library.folder.parent)
    data = pickle.dumps(Library.open(stored_library.folder.name))
    monkeypatch.chdir(tmp_path)
    assert_same_libraries(pickle.loads(data), stored_library)


def test_graft_of_stored_library_in_another_process_is_identical(stored_library):
    expected = graft(stored_library, BASE, seed=3)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        received = pool.apply(graft, (stored_library, BASE), {"seed": 3})
    np.testing.assert_array_equal(received.motion.rotations, expected.motion.rotations)
    assert mg.graft_record(received) == mg.graft_record(expected)
