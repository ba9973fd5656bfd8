"""Laws of the registry of formats, of clip addresses and of the change of the rest pose."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.dancer import dance
from mograft.io import formats
from mograft.io.formats import find_addresses, read_clip, split_address
from mograft.io.rest_pose import RestPose, rebase, restore, to_local
from mograft.motion import rotations
from mograft.motion.motion import forward_kinematics
from tests.strategies import few_examples, motions


def test_rebase_translated_joint_has_position_channels():
    motion = dance(strides=1).motion[:3]
    skeleton = motion.skeleton
    turned, places = motion.world_transforms()
    places[1, 5] += 0.1
    identity = np.tile([0, 0, 0, 1.0], (skeleton.n_joints, 1))
    rest = RestPose(skeleton.names, skeleton.parents, identity, skeleton.rest_positions())
    rebased = rebase(rest, turned, places, motion.frame_time)
    np.testing.assert_allclose(rebased.world_positions(), places, atol=1e-9)
    moved = {5, *skeleton.children[5]}
    assert {j for j, channels in enumerate(rebased.skeleton.channels) if len(channels) == 6} == {
        0,
        *moved,
    }


@few_examples(20)
@given(motion=motions(max_frames=6))
def test_read_every_registered_writer_round_trips(motion, tmp_path_factory):
    folder = tmp_path_factory.mktemp("formats")
    mg.write_bvh(motion, folder / "clip.bvh")
    mg.formats.write_npz(motion, folder / "clip.npz")
    for name, direct in (("clip.bvh", mg.read_bvh), ("clip.npz", mg.formats.read_npz)):
        clips = mg.read(folder / name)
        assert len(clips) == 1
        expected = direct(folder / name)
        for found in (*clips, clips[clips.names[0]], read_clip(clips.address(0))):
            np.testing.assert_array_equal(found.rotations, expected.rotations)
            np.testing.assert_array_equal(found.positions, expected.positions)


def test_read_content_decides_over_suffix(tmp_path):
    motion = dance(strides=1).motion[:3]
    mg.formats.write_npz(motion, tmp_path / "dance.npz")
    (tmp_path / "dance.npz").rename(tmp_path / "dance.bvh")
    assert mg.read(tmp_path / "dance.bvh").format == "NPZ"
    for name in ("dance.txt", "dance"):
        mg.write_bvh(motion, tmp_path / name)
        assert mg.read(tmp_path / name).format == "BVH"


def test_read_missing_file_raises_file_not_found(tmp_path):
    with pytest.raises(FileNotFoundError, match="No such file"):
        mg.read(tmp_path / "no.bvh")


def test_clips_index_that_does_not_exist_raises_error_naming_file(tmp_path):
    mg.write_bvh(dance(strides=1).motion[:3], tmp_path / "dance.bvh")
    clips = mg.read(tmp_path / "dance.bvh")
    assert clips[-1].name == clips[np.int64(0)].name == "dance"
    with pytest.raises(IndexError, match=r"dance\.bvh has 1 clip, got the index 1"):
        clips[1]
    with pytest.raises(TypeError, match="must be an integer, name or slice, got float"):
        clips[0.0]


def test_read_rate_resamples(tmp_path):
    motion = dance(strides=1).motion[:61]
    mg.write_bvh(motion, tmp_path / "dance.bvh")
    assert mg.read(tmp_path / "dance.bvh", rate=10)[0].n_frames == 21
    with pytest.raises(ValueError, match="`rate` must be above 0"):
        mg.read(tmp_path / "dance.bvh", rate=0)


def test_split_address_prefers_longest_existing_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a.glb", "a.glb#b", "c#d.bvh"):
        (tmp_path / name).touch()
    assert split_address("a.glb#b#c") == ("a.glb#b", "c")
    assert split_address("a.glb#x#c") == ("a.glb", "x#c")
    assert split_address("a.glb#b") == ("a.glb#b", None)
    assert split_address("c#d.bvh") == ("c#d.bvh", None)
    assert split_address("none.glb#a#b") == ("none.glb#a", "b")
    assert split_address("#b") == ("", "b")


def test_find_addresses_unknown_clip_raises_value_error(tmp_path):
    path = tmp_path / "dance.bvh"
    mg.write_bvh(dance(strides=1).motion[:3], path)
    assert find_addresses(f"{path}#d*") == find_addresses(str(path)) == [str(path)]
    with pytest.raises(ValueError, match="has no clip named 'dnace'; did you mean 'dance'"):
        find_addresses(f"{path}#dnace")


@pytest.mark.parametrize(
    "error",
    [mg.FormatError("expected X", "a.glb", "byte 3"), mg.BvhError("expected X", "a.bvh", 3, 4)],
)
def test_format_error_survives_pickle(error):
    copy = pickle.loads(pickle.dumps(error))
    assert (str(copy), vars(copy), type(copy)) == (str(error), vars(error), type(error))
    assert isinstance(copy, ValueError)


def test_open_clips_parses_a_file_once_and_again_after_a_change(tmp_path, monkeypatch):
    motion = dance(strides=1).motion[:9]
    paths = [tmp_path / f"{number}.glb" for number in range(3)]
    for path in paths:
        mg.formats.write_glb([motion, motion[:4]], path)
    parsed = []
    real = formats.read
    monkeypatch.setattr(
        formats, "read", lambda path, **options: parsed.append(path) or real(path, **options)
    )
    every = [found for _ in range(3) for path in paths for found in find_addresses(str(path))]
    lengths = [read_clip(address).n_frames for address in every]
    assert lengths == [9, 4] * 9
    # Only the clips of the last file are kept.
    assert parsed == [*map(str, paths)] * 6
    mg.formats.write_glb([motion[:5], motion[:6]], paths[-1])
    assert read_clip(every[-1]).n_frames == 6
    assert parsed[18:] == [str(paths[-1])]


def random_figure(seed, n_joints, n_frames):
    """Return random parents, and rotations and positions of the joints in some frames."""
    rng = np.random.default_rng(seed)
    parents = np.array([-1, *(int(rng.integers(joint)) for joint in range(1, n_joints))])
    quats = rng.normal(size=(n_frames, n_joints, 4))
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    return parents, quats, rng.normal(size=(n_frames, n_joints, 3))


@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(0, 5))
def test_to_local_is_the_inverse_of_forward_kinematics(seed, n_joints, n_frames):
    parents, quats, places = random_figure(seed, n_joints, n_frames)
    local, positions = to_local(parents, *forward_kinematics(parents, quats, places))
    np.testing.assert_allclose(local, quats, atol=1e-13)
    np.testing.assert_allclose(positions, places, atol=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(1, 5))
def test_restore_of_rebase_returns_the_world_transforms(seed, n_joints, n_frames):
    parents, quats, places = random_figure(seed, n_joints, n_frames + 1)
    names = tuple(f"joint {i}" for i in range(n_joints))
    rest = RestPose(names, parents, quats[-1], places[-1])
    motion = rebase(rest, quats[:-1], places[:-1], 0.1)
    turned, positions = restore(rest, motion)
    same = np.abs(np.einsum("fji,fji->fj", turned, quats[:-1]))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)
    np.testing.assert_allclose(positions, places[:-1], atol=1e-10)


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_rebase_of_the_rest_pose_has_identity_rotations(seed, n_joints):
    parents, quats, places = random_figure(seed, n_joints, 1)
    rest = RestPose(tuple("abcd"[:n_joints]), parents, quats[0], places[0])
    motion = rebase(rest, quats, places, 0.1)
    identity = np.broadcast_to(rotations.IDENTITY, motion.rotations.shape)
    np.testing.assert_allclose(motion.rotations, identity, atol=1e-13)
    np.testing.assert_allclose(motion.world_positions()[0], places[0], atol=1e-12)
    # Rounding does not give joints position channels.
    assert [len(own) for own in motion.skeleton.channels] == [6, *[3] * (n_joints - 1)]
