"""AMASS files against forward kinematics of SMPL, written back, and with wrong content."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import formats
from mograft.body.mass import mass_model, up_axis
from mograft.io.smpl.body_models import MODELS, STATURE, read_offsets, rest_skeleton, stand_in
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
@given(st.sampled_from(COLUMNS), SEEDS, st.sampled_from([np.float32, np.float64]))
def test_read_amass_joint_positions_match_forward_kinematics(
    tmp_path_factory, n_columns, seed, dtype
):
    arrays = amass_arrays(n_columns, 4, seed, dtype)
    path = write_arrays(tmp_path_factory.mktemp("amass") / "walk.npz", arrays)
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


@few_examples(15)
@given(st.sampled_from(COLUMNS), SEEDS, st.sampled_from([np.float32, np.float64]))
def test_write_amass_unchanged_motion_gives_identical_arrays(
    tmp_path_factory, n_columns, seed, dtype
):
    folder = tmp_path_factory.mktemp("amass")
    arrays = amass_arrays(n_columns, 5, seed, dtype)
    # Rotation vectors longer than half a turn, and of length 0, are kept too.
    arrays["poses"][1, 3:6] = [5.0, 0, 0]
    arrays["poses"][2, 3:6] = 0
    source = write_arrays(folder / "a.npz", arrays)
    motion = mg.read(source, skeleton=random_rest(model_of(n_columns), seed))[0]
    for name in ("b.npz", "c.npz"):
        formats.write_amass(motion, folder / name, like=source)
    assert (folder / "b.npz").read_bytes() == (folder / "c.npz").read_bytes()
    with np.load(folder / "b.npz") as written:
        assert written.files == list(arrays)
        for name, array in arrays.items():
            assert written[name].dtype == array.dtype, name
            np.testing.assert_array_equal(written[name], array, err_msg=name)


@few_examples(15)
@given(st.sampled_from(COLUMNS), SEEDS, SEEDS)
def test_write_amass_then_read_gives_changed_motion_and_keeps_other_joints(
    tmp_path_factory, n_columns, seed, other
):
    folder = tmp_path_factory.mktemp("amass")
    arrays = amass_arrays(n_columns, 6, seed)
    source = write_arrays(folder / "a.npz", arrays)
    motion = mg.read(source)[0]
    rng = np.random.default_rng(other)
    changed = rng.permutation(motion.n_joints)[:7]
    quats = motion.rotations.copy()
    quats[2:, changed] = rotations.exp(rng.uniform(-1.8, 1.8, (4, 7, 3)))
    positions = motion.positions.copy()
    positions[4:, 0] += rng.normal(size=(2, 3))
    edited = replace(motion, rotations=quats, positions=positions)
    formats.write_amass(edited, folder / "b.npz", like=source)
    again = mg.read(folder / "b.npz")[0]
    assert_same_rotations(again.rotations, quats, atol=1e-9)
    np.testing.assert_allclose(again.positions, positions, atol=1e-12)
    with np.load(folder / "b.npz") as written:
        poses = written["poses"].reshape(6, -1, 3)
        kept = np.ones(poses.shape[:2], bool)
        kept[2:, changed] = False
        np.testing.assert_array_equal(poses[kept], arrays["poses"].reshape(6, -1, 3)[kept])
        np.testing.assert_array_equal(written["trans"][:4], arrays["trans"][:4])
        np.testing.assert_array_equal(written["betas"], arrays["betas"])
        if n_columns == 165:  # the parts of `poses` follow it
            np.testing.assert_array_equal(written["pose_hand"], written["poses"][:, 75:])
            np.testing.assert_array_equal(written["root_orient"], written["poses"][:, :3])


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


def test_read_amass_parts_without_poses_equal_poses(tmp_path):
    arrays = amass_arrays(165)
    whole = mg.read(write_arrays(tmp_path / "a.npz", arrays))[0]
    del arrays["poses"]
    parts = mg.read(write_arrays(tmp_path / "b.npz", arrays))[0]
    np.testing.assert_array_equal(parts.rotations, whole.rotations)


EMPTY = {"root_orient": np.zeros((0, 3)), "pose_body": np.zeros((0, 63)), "trans": np.zeros((0, 3))}


def change(**changes):
    arrays = amass_arrays(156, 4) | changes
    return {name: array for name, array in arrays.items() if array is not None}


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        (change(poses=np.zeros((4, 150))), r"`poses`: expected 72 \(SMPL\), 156 .* got 150"),
        (change(poses=np.zeros(156)), r"`poses`: expected shape \(n_frames, n_columns\)"),
        (change(poses=np.zeros((0, 156)), trans=np.zeros((0, 3))), "`poses`: expected at least"),
        (change(poses=None, **EMPTY), "`root_orient`: expected at least"),
        (change(trans=np.zeros((5, 3))), r"`trans`: expected shape \(4, 3\), got \(5, 3\)"),
        (change(poses=np.full((4, 156), "x")), "`poses`: expected real numbers, got <U1"),
        (change(poses=np.full((4, 156), np.nan)), r"`poses`: expected finite .* nan at \[0, 0\]"),
        (change(trans=np.full((4, 3), 1e309)), r"`trans`: expected finite numbers, got inf"),
        (change(poses=np.full((4, 156), None)), "`poses`: expected numbers, got pickled objects"),
        (change(mocap_framerate=None), "`mocap_framerate`: expected frames per second, got no"),
        (change(mocap_framerate=np.array(0.0)), "`mocap_framerate`: expected frames per second"),
        (change(mocap_framerate=np.array("60")), "`mocap_framerate`: expected real numbers"),
        (change(mocap_framerate=np.ones(4)), r"`mocap_framerate`: expected shape \(1,\), got"),
        (change(pose_body=np.zeros((4, 3))), r"`pose_body`: expected shape \(4, 63\), got"),
    ],
)
def test_read_amass_wrong_array_raises_format_error_naming_it(tmp_path, arrays, message):
    path = write_arrays(tmp_path / "walk.npz", arrays)
    with pytest.raises(mg.FormatError, match=r"walk\.npz: array " + message):
        mg.read(path)[0]


def test_read_amass_given_rate_replaces_missing_one(tmp_path):
    clips = mg.read(write_arrays(tmp_path / "a.npz", change(mocap_framerate=None)), rate=50)
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
    directions, standard = (
        own.offsets[1:] / np.linalg.norm(own.offsets[1:], axis=1, keepdims=True)
        for own in (rest, stand_in(model))
    )
    np.testing.assert_allclose(directions, standard, atol=1e-12)


@pytest.mark.parametrize("rename", ["{0}", "m_avg_{1}", "{1}"])
def test_rest_skeleton_smpl_names_gives_offsets_of_the_figure(rename):
    rest = random_rest(model_of(72), 3)
    short = {"left": "L", "right": "R"}
    words = [[short.get(word, word.title()) for word in name.split("_")] for name in rest.names]
    names = [rename.format(*own) for own in zip(rest.names, map("_".join, words), strict=True)]
    centimetres = mg.Skeleton(names, rest.parents, 100 * rest.offsets)
    found, note = rest_skeleton(model_of(72), centimetres)
    assert note == "offsets: those of the given skeleton"
    np.testing.assert_allclose(found.offsets, rest.offsets, atol=1e-12)
    bigger, note = rest_skeleton(model_of(156), centimetres)
    assert "of the stand-in for left_index1" in note
    np.testing.assert_allclose(bigger.offsets[1:22], rest.offsets[1:22], atol=1e-12)


def test_rest_skeleton_no_human_raises_value_error():
    animal = mg.Skeleton(["a", "b"], [-1, 0], np.ones((2, 3)))
    with pytest.raises(ValueError, match="`skeleton` must be that of a human"):
        rest_skeleton(model_of(72), animal)


def offsets_of(model):
    return dict(zip(model.joints, stand_in(model).offsets.tolist(), strict=True))


WITHOUT_FINGER = {k: v for k, v in offsets_of(model_of(156)).items() if k != "left_index1"}


def test_read_offsets_gives_rest_pose_of_model(tmp_path):
    (tmp_path / "body.json").write_text(json.dumps(offsets_of(model_of(165))))
    skeleton = read_offsets(tmp_path / "body.json")
    given_offsets = dict(zip(skeleton.names, skeleton.offsets, strict=True))
    for n_columns in COLUMNS:
        rest, note = rest_skeleton(model_of(n_columns), skeleton)
        for name in given_offsets.keys() & {*rest.names}:
            offset = rest.offsets[rest.names.index(name)]
            np.testing.assert_allclose(offset, given_offsets[name], atol=1e-15)
    assert note == "offsets: those of the given skeleton"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[1, 2]", "expected an object with joint offsets, got a list"),
        ("{", "expected JSON"),
        ("[" * 100_000, "expected JSON"),
        ('{"pelvis": [0, 0, 0]}', "expected all joints of the body, got none for left_hip, right"),
        ('{"left_hop": [0, 0, 0]}', "left_hop: expected the name of an SMPL joint; did you mean"),
        ('{"left_hip": [0, 0]}', r"left_hip: expected \[x, y, z\] in metres"),
        ('{"left_hip": [0, 0, "1"]}', r"left_hip: expected \[x, y, z\] in metres"),
        ('{"left_hip": [0, 0, 1e999]}', r"left_hip: expected \[x, y, z\] in metres"),
        (f'{{"left_hip": [0, 0, 1{"0" * 400}]}}', r"left_hip: expected \[x, y, z\] in metres"),
        (" " * (2**20 + 1), "expected at most 1 MiB"),
        (json.dumps(offsets_of(model_of(156)) | {"left_index1": None}), r"left_index1: expected"),
        (json.dumps(WITHOUT_FINGER), ".* got none for left_index1$"),
    ],
    ids=range(12),
)
def test_read_offsets_wrong_content_raises_format_error(tmp_path, content, message):
    (tmp_path / "body.json").write_text(content)
    with pytest.raises(mg.FormatError, match=r"body\.json: " + message):
        read_offsets(tmp_path / "body.json")
