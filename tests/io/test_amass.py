"""AMASS files against forward kinematics of SMPL, written back, and with wrong content."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import formats
from mograft.body.mass import mass_model, up_axis
from mograft.errors import join_names
from mograft.io.smpl.body_models import MODELS, STATURE, rest_skeleton, stand_in
from mograft.motion import rotations
from tests.hierarchies import human
from tests.io.npz_files import amass_arrays, write_arrays
from tests.oracles import smpl as oracle
from tests.strategies import SEEDS, assert_same_rotations, few_examples

COLUMNS = [72, 156, 165]


def model_of(n_columns):
    return next(model for model in MODELS if model.n_columns == n_columns)


def random_rest(model, seed):
    """A skeleton with the joints of a model and random bones near those of the stand-in."""
    rng = np.random.default_rng(seed)
    standard = stand_in(model)
    offsets = standard.offsets + rng.normal(scale=0.01, size=standard.offsets.shape)
    return mg.Skeleton(standard.names, standard.parents, offsets)


@few_examples(15)
@given(st.sampled_from(COLUMNS), SEEDS, st.sampled_from([np.float32, np.float64]), st.booleans())
def test_read_amass_joint_positions_match_forward_kinematics(
    tmp_path_factory, n_columns, seed, dtype, has_parts_only
):
    arrays = amass_arrays(n_columns, 4, seed, dtype)
    content = dict(arrays)
    if has_parts_only and n_columns == 165:
        del content["poses"]
    path = write_arrays(tmp_path_factory.mktemp("amass") / "walk.npz", content)
    rest = random_rest(model_of(n_columns), seed)
    motion = mg.read(path, skeleton=rest)[0]
    values = (arrays[name].astype(np.float64) for name in ("poses", "trans"))
    expected = oracle.joints(*values, rest.rest_positions())
    np.testing.assert_allclose(motion.world_positions(), expected, atol=1e-9)
    np.testing.assert_array_equal(motion.skeleton.parents, oracle.PARENTS[n_columns])
    assert motion.rate == pytest.approx(60)
    assert motion.name == "walk"
    assert up_axis(motion) == 2


def test_read_amass_without_skeleton_uses_stand_in_and_notes_it(tmp_path):
    clips = mg.read(write_arrays(tmp_path / "walk.npz", amass_arrays()))
    assert "stand-in of 1.7 m" in clips.notes[0]
    assert clips.notes[1] == "arrays that are not part of the motion: gender, betas, dmpls"
    skeleton = clips["walk"].skeleton
    np.testing.assert_array_equal(skeleton.offsets, stand_in(model_of(156)).offsets)
    # The stature that mograft computes for any skeleton, from bones.
    assert mass_model(skeleton).height == pytest.approx(STATURE, rel=0.02)
    left, right = (skeleton.names.index(f"{side}_knee") for side in ("left", "right"))
    positions = skeleton.rest_positions()
    np.testing.assert_array_equal(positions[left], positions[right] * [-1, 1, 1])
    assert mg.read(tmp_path / "walk.npz", rate=20)[0].n_frames == 11


@few_examples(30)
@given(
    n_columns=st.sampled_from(COLUMNS),
    seed=SEEDS,
    dtype=st.sampled_from([np.float32, np.float64]),
    n_changed=st.sampled_from([0, 7]),
)
def test_write_amass_changes_what_the_motion_changed_and_keeps_all_other_bits(
    tmp_path_factory, n_columns, seed, dtype, n_changed
):
    folder, rng = tmp_path_factory.mktemp("amass"), np.random.default_rng(seed)
    arrays = amass_arrays(n_columns, 6, seed, dtype)
    # Rotation vectors longer than half a turn, and of length 0, are kept too.
    arrays["poses"][1, 3:6] = [5.0, 0, 0]
    arrays["poses"][2, 3:6] = 0
    source, rest = write_arrays(folder / "a.npz", arrays), random_rest(model_of(n_columns), seed)
    motion = mg.read(source, skeleton=rest)[0]
    is_changed = np.zeros((6, motion.n_joints), bool)
    is_changed[2:, rng.permutation(motion.n_joints)[:n_changed]] = True
    quats, positions = motion.rotations.copy(), motion.positions.copy()
    quats[is_changed] = rotations.exp(rng.uniform(-1.8, 1.8, (is_changed.sum(), 3)))
    positions[4:, 0] += n_changed * rng.normal(size=(2, 3))
    edited = replace(motion, rotations=quats, positions=positions)
    for name in ("b.npz", "c.npz"):
        formats.write_amass(edited, folder / name, like=source)
    assert (folder / "b.npz").read_bytes() == (folder / "c.npz").read_bytes()
    again, precision = mg.read(folder / "b.npz", skeleton=rest)[0], np.finfo(dtype).eps
    assert_same_rotations(again.rotations, quats, atol=1e2 * precision)
    np.testing.assert_allclose(again.positions, positions, atol=1e2 * precision)
    columns = {"poses": slice(None), **model_of(n_columns).columns}
    is_kept = {name: np.repeat(~is_changed, 3, axis=1)[:, own] for name, own in columns.items()}
    is_kept["trans"] = np.repeat(np.arange(6)[:, None] < (4 if n_changed else 6), 3, axis=1)
    with np.load(folder / "b.npz") as written:
        assert written.files == list(arrays)
        for name, array in arrays.items():
            kept = is_kept.get(name, np.ones(array.shape, bool))
            assert written[name].dtype == array.dtype, name
            np.testing.assert_array_equal(written[name][kept], array[kept], err_msg=name)
            if name in columns:  # the parts of `poses` follow it
                np.testing.assert_array_equal(written[name], written["poses"][:, columns[name]])


def test_write_amass_other_length_omits_arrays_of_frames(tmp_path):
    arrays = amass_arrays(n_frames=16)  # as many as `betas`
    source = write_arrays(tmp_path / "a.npz", arrays)
    motion = mg.read(source)[0]
    longer = motion.resample(120)
    for own, name in ((motion[:10], "b.npz"), (longer, "c.npz")):
        with pytest.warns(UserWarning, match=rf"{name} lacks dmpls, which have one row per frame"):
            formats.write_amass(own, tmp_path / name, like=source)
    with np.load(tmp_path / "b.npz") as short, np.load(tmp_path / "c.npz") as long:
        assert "dmpls" not in short.files
        np.testing.assert_array_equal(short["betas"], arrays["betas"])
        np.testing.assert_array_equal(short["poses"], arrays["poses"][:10])
        assert short["mocap_framerate"] == 60
        assert long["mocap_framerate"] == pytest.approx(longer.rate)
        assert len(long["trans"]) == longer.n_frames


def test_write_amass_file_of_one_frame_keeps_array_of_its_rate(tmp_path):
    """An array of one frame rate is not an array of one row per frame."""
    arrays = amass_arrays(n_frames=1) | {"mocap_framerate": np.array([60.0])}
    one = write_arrays(tmp_path / "one.npz", arrays)
    motion = mg.read(write_arrays(tmp_path / "ten.npz", amass_arrays(n_frames=10)))[0]
    with pytest.warns(UserWarning, match="lacks dmpls"):
        formats.write_amass(motion, tmp_path / "out.npz", like=one)
    assert mg.read(tmp_path / "out.npz")[0].rate == 60


def test_write_amass_keeps_pickled_members_without_reading_them(tmp_path, monkeypatch):
    arrays = amass_arrays(165) | {"markers_latent_vids": np.array([{"a": 1}], object)}
    source = write_arrays(tmp_path / "a.npz", arrays)
    monkeypatch.setattr(pickle, "load", None)
    monkeypatch.setattr(pickle, "loads", None)
    clips = mg.read(source)
    assert clips.notes[-1] == ("arrays of pickled objects, which are not read: markers_latent_vids")
    formats.write_amass(clips[0], tmp_path / "b.npz", like=source)
    monkeypatch.undo()
    with np.load(tmp_path / "b.npz", allow_pickle=True) as written:
        assert written["markers_latent_vids"][0] == {"a": 1}


def test_write_amass_motion_that_does_not_fit_raises_error(tmp_path):
    source = write_arrays(tmp_path / "a.npz", amass_arrays(156))
    other = write_arrays(tmp_path / "b.npz", amass_arrays(72))
    motion = mg.read(source)[0]
    with pytest.raises(mg.SkeletonMismatchError, match=r"52 joints of SMPL-H, as in .*a\.npz, got"):
        formats.write_amass(mg.read(other)[0], tmp_path / "c.npz", like=source)
    positions = motion.positions.copy()
    positions[3, 5] += 0.1
    with pytest.raises(ValueError, match=r"the root only, got a joint that leaves .* right_knee"):
        formats.write_amass(replace(motion, positions=positions), tmp_path / "c.npz", like=source)
    body = {name: amass_arrays(165)[name] for name in ("trans", "root_orient", "pose_body")}
    part = write_arrays(tmp_path / "d.npz", body | {"mocap_frame_rate": np.array(30.0)})
    clips = mg.read(part)
    assert "poses: zero for pose_hand" in clips.notes
    quats = clips[0].rotations.copy()
    quats[2, 40] = rotations.exp([0, 0, 1.0])
    with pytest.raises(ValueError, match=r"d\.npz has no array for the rotations of right_"):
        formats.write_amass(replace(clips[0], rotations=quats), tmp_path / "c.npz", like=part)
    assert not (tmp_path / "c.npz").exists()


def test_read_amass_given_rate_replaces_missing_one(tmp_path):
    arrays = amass_arrays(156, 4)
    del arrays["mocap_framerate"]
    clips = mg.read(write_arrays(tmp_path / "a.npz", arrays), rate=50)
    assert clips[0].rate == pytest.approx(50)
    assert clips[0].n_frames == 4
    assert "frames per second: those given, because the file states none" in clips.notes


def test_rest_skeleton_foreign_names_gives_bone_lengths_of_the_figure():
    figure, model = human(), model_of(156)
    rest, note = rest_skeleton(model, figure)
    assert "bone lengths of the given skeleton" in note
    shins = ("LeftAnkle", "left_ankle"), ("RightWrist", "right_wrist")
    for theirs, own in shins:
        length = 0.01 * np.linalg.norm(figure.offsets[figure.index(theirs)])
        assert np.linalg.norm(rest.offsets[rest.index(own)]) == pytest.approx(length)
    bones = (own.offsets[1:] for own in (rest, stand_in(model)))
    directions, standard = (own / np.linalg.norm(own, axis=1, keepdims=True) for own in bones)
    np.testing.assert_allclose(directions, standard, atol=1e-12)


@pytest.mark.parametrize("rename", ["{0}", "m_avg_{1}", "{1}"])
@pytest.mark.parametrize("n_columns", COLUMNS)
def test_rest_skeleton_smpl_names_gives_offsets_of_the_figure(rename, n_columns):
    rest = random_rest(model_of(n_columns), 3)
    short = {"left": "L", "right": "R"}
    words = [[short.get(word, word.title()) for word in name.split("_")] for name in rest.names]
    names = [rename.format(*own) for own in zip(rest.names, map("_".join, words), strict=True)]
    centimetres = mg.Skeleton(names, rest.parents, 100 * rest.offsets)
    for other in COLUMNS:
        found, note = rest_skeleton(model_of(other), centimetres)
        common = sorted({*rest.names} & {*found.names})
        offsets = [own.offsets[[own.index(name) for name in common]] for own in (found, rest)]
        np.testing.assert_allclose(*offsets, atol=1e-12)
        missing = [name for name in found.names if name not in rest.names]
        text = "offsets: those of the given skeleton"
        assert note == text + (f"; of the stand-in for {join_names(missing)}" if missing else "")


def test_rest_skeleton_no_human_raises_value_error():
    animal = mg.Skeleton(["a", "b"], [-1, 0], np.ones((2, 3)))
    with pytest.raises(ValueError, match="`skeleton` must be that of a human"):
        rest_skeleton(model_of(72), animal)
