"""NPZ files: damaged ones, ones that claim too much or have no known format, those of Kimodo."""

import io
import subprocess
import sys
import warnings
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.dancer import dance
from mograft.io.kimodo import SKELETONS
from mograft.io.npz import open_npz_archive
from tests.fuzz import npz as fuzz_npz
from tests.hierarchies import DATA
from tests.io.npz_files import amass_arrays, kimodo_arrays, write_arrays
from tests.memory import PEAK_BYTES
from tests.strategies import SEEDS, assert_same_rotations, few_examples

MOTION = dance(strides=1).motion[:5]


def header_of(shape, dtype="<f8"):
    """The header of an array, without its elements."""
    stream = io.BytesIO()
    description = {"descr": dtype, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, description)
    return stream.getvalue()


def write_members(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)
    return path


def test_npz_claim_larger_than_file_raises_format_error(tmp_path):
    poses = header_of((10_000_000, 156))
    members = {"poses": poses, "trans": header_of((10_000_000, 3)), "x": header_of((2,))}
    path = write_members(tmp_path / "a.npz", members)
    archive = open_npz_archive(path)
    assert archive.headers["poses"].n_bytes > 10 * 2**30
    with pytest.raises(mg.FormatError, match=r"a\.npz: array `poses`: expected at most 1 GiB, got"):
        archive.read("poses", ("n", 156))
    with pytest.raises(mg.FormatError, match=r"array `x`: expected 16 bytes .* got 0"):
        archive.read("x", (2,))


@given(code=st.integers(sys.maxunicode + 1, 2**32 - 1), byte_order=st.sampled_from("<>"))
def test_npz_text_of_numbers_that_are_no_characters_raises(tmp_path_factory, code, byte_order):
    path = tmp_path_factory.mktemp("text") / "a.npz"
    mg.write(MOTION, path)
    with zipfile.ZipFile(path) as archive:
        members = {name.removesuffix(".npy"): archive.read(name) for name in archive.namelist()}
    for name in ("name", "names", "format"):
        shape = (MOTION.n_joints,) if name == "names" else ()
        text = np.full(shape, code, f"{byte_order}u4").tobytes()
        header = header_of(shape, f"{byte_order}U1")
        damaged = write_members(path.with_name(f"{name}.npz"), {**members, name: header + text})
        with pytest.raises(mg.FormatError, match=f"array `{name}`.*no characters"):
            mg.read(damaged)[0]


@few_examples(20)
@given(exponent=st.integers(100, 307), name=st.sampled_from(["positions", "offsets"]))
def test_npz_huge_coordinate_raises_format_error_without_warnings(tmp_path_factory, exponent, name):
    path = tmp_path_factory.mktemp("huge") / "a.npz"
    mg.write(MOTION, path)
    with np.load(path) as archive:
        arrays = dict(archive)
    arrays[name] = arrays[name].astype(float)
    arrays[name].flat[-1] = -1.1 * 10.0**exponent
    write_arrays(path, arrays)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(mg.FormatError, match=r"at most 1e\+100"):
            mg.read(path)[0]


READ_BOMB = """
import sys, mograft as mg
before = peak_bytes()
try:
    mg.read(sys.argv[1])
except mg.FormatError as error:
    print(error)
print((peak_bytes() - before) >> 20)
"""


def test_npz_bomb_is_refused_in_bounded_memory(tmp_path):
    """2 MB that unpack to 400 MiB, all of which a header claims to be its own text."""
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("trans.npy", header_of((5, 3)))
        with archive.open("poses.npy", "w") as member:
            member.write(b"\x93NUMPY\2\0\xff\xff\xff\x7f")
            for _ in range(400):
                member.write(bytes(2**20))
    assert path.stat().st_size < 2**22
    command = [sys.executable, "-c", PEAK_BYTES + READ_BOMB, str(path)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    message, mebibytes = run.stdout.splitlines()
    assert "array `poses`: damaged: EOF: reading array header, expected 2147483647 bytes" in message
    assert int(mebibytes) < 100


AMASS, KIMODO = amass_arrays(156, 4), kimodo_arrays()[0]
EMPTY = {"root_orient": np.zeros((0, 3)), "pose_body": np.zeros((0, 63)), "trans": np.zeros((0, 3))}
zeros = np.zeros


def empty_kimodo(*shape):
    return {"posed_joints": zeros((*shape, 3)), "global_rot_mats": zeros((*shape, 3, 3))}


@pytest.mark.parametrize(
    ("base", "changes", "message"),
    [
        ({}, {"x": zeros(3)}, r"expected the arrays of mograft \(`format`\), AMASS .*, got x$"),
        ({}, {"format": np.array("other/2")}, "`format`: expected mograft.motion/1, got other/2"),
        ({}, {"format": np.array(None)}, "array `format`: expected numbers, got pickled objects"),
        ({}, {"format": np.array("mograft.motion/1")}, "array `names`: expected this array, got n"),
        (AMASS, {"poses": zeros((4, 150))}, r"`poses`: expected 72 \(SMPL\), 156 .* got 150"),
        (AMASS, {"poses": zeros(156)}, r"`poses`: expected shape \(n_frames, n_columns\)"),
        (AMASS, EMPTY | {"poses": zeros((0, 156))}, "`poses`: expected at least"),
        (EMPTY, {}, "`root_orient`: expected at least"),
        (AMASS, {"trans": zeros((5, 3))}, r"`trans`: expected shape \(4, 3\), got \(5, 3\)"),
        (AMASS, {"poses": np.full((4, 156), "x")}, "`poses`: expected real numbers, got <U1"),
        (AMASS, {"poses": zeros((4, 156)) + np.nan}, r"`poses`: .* finite .* nan at \[0, 0\]"),
        (AMASS, {"trans": np.full((4, 3), 1e309)}, r"`trans`: expected finite numbers, got inf"),
        (AMASS, {"poses": np.full((4, 156), None)}, "`poses`: expected numbers, got pickled"),
        (AMASS, {"mocap_framerate": None}, "`mocap_framerate`: expected frames per second, got no"),
        (AMASS, {"mocap_framerate": np.array(0.0)}, "`mocap_framerate`: expected frames per sec"),
        (AMASS, {"mocap_framerate": np.array("60")}, "`mocap_framerate`: expected real numbers"),
        (AMASS, {"mocap_framerate": zeros(4)}, r"`mocap_framerate`: expected shape \(1,\), got"),
        (AMASS, {"pose_body": zeros((4, 3))}, r"`pose_body`: expected shape \(4, 63\), got"),
        (KIMODO, {"posed_joints": zeros((5, 31, 3))}, r"`global_rot_mats`: expected shape \(5, 31"),
        (KIMODO, {"posed_joints": zeros((6, 30, 3))}, r"`global_rot_mats`: expected shape \(6, 30"),
        (KIMODO, {"posed_joints": zeros((1, 5, 30, 3))}, "`posed_joints`: expected shape"),
        (KIMODO, {"posed_joints": zeros((5, 30, 3)) + np.nan}, "`posed_joints`: expected finite"),
        (KIMODO, {"global_rot_mats": zeros((5, 30, 4))}, r"`global_rot_mats`: expected shape \(5,"),
        (KIMODO, {"global_rot_mats": zeros((5, 30, 3, 3))}, r"rotation matrices, .* at \[0, 0\]"),
        (KIMODO, {"global_rot_mats": zeros((5, 30, 3, 3)) + 1e300}, "expected rotation matrices"),
        (KIMODO, {"global_rot_mats": zeros((5, 30, 3, 3)) - np.eye(3)}, "expected rotation matri"),
        ({}, empty_kimodo(5, 31), "posed_joints`: expected 22 .* joints, got 31"),
        ({}, empty_kimodo(0, 30), "`posed_joints`: expected at least one frame"),
    ],
    ids=range(28),
)
def test_npz_of_wrong_content_raises_format_error_naming_the_array(
    tmp_path, base, changes, message
):
    arrays = {name: own for name, own in (base | changes).items() if own is not None}
    path = write_arrays(tmp_path / "walk.npz", arrays)
    with pytest.raises(mg.FormatError, match=r"walk\.npz: .*" + message):
        mg.read(path)[0]


def test_npz_fortran_order_and_other_types_are_read(tmp_path):
    values = np.arange(6.0).reshape(2, 3)
    arrays = {"f": np.asfortranarray(values), "big": values.astype(">f4"), "int": np.arange(3)}
    archive = open_npz_archive(write_arrays(tmp_path / "a.npz", arrays))
    assert archive.headers["f"].is_fortran
    for name in ("f", "big"):
        np.testing.assert_array_equal(archive.read_floats(name, (2, "n")), values)
    np.testing.assert_array_equal(archive.read_floats("int", (3,)), [0, 1, 2])


def test_npz_header_of_python_2_is_read_without_warning(tmp_path):
    header = header_of((2, 3)).replace(b"(2, 3), }  ", b"(2L, 3L), }")
    assert b"2L" in header
    values = np.arange(6.0).reshape(2, 3)
    path = write_members(tmp_path / "a.npz", {"x": header + values.tobytes()})
    np.testing.assert_array_equal(open_npz_archive(path).read_floats("x", (2, 3)), values)


HEADER = header_of((2, 3))[10:]


@pytest.mark.parametrize(
    ("version", "header", "size", "message"),
    [
        (1, HEADER[:-1], 118, "EOF: .* header, expected 118 bytes got 117"),
        (2, HEADER[:-1], 118, "EOF: .* header, expected 118 bytes got 117"),
        (1, HEADER.replace(b"(2, 3)", b"(True,)"), 119, "expected a shape of lengths"),
        (1, b"{'descr': '<f8', 'fortran_order': False, 'shape': (3), }", 56, "shape .* valid: 3"),
        (1, b"{'descr': " + b"-" * 9000 + b"1}", 9012, "expected the header .*, got a deep"),
    ],
)
def test_npz_header_that_is_invalid_raises_format_error(tmp_path, version, header, size, message):
    member = b"\x93NUMPY" + bytes([version, 0]) + size.to_bytes(2 * version, "little") + header
    path = write_members(tmp_path / "a.npz", {"x": member})
    with pytest.raises(mg.FormatError, match=f"array `x`: damaged: {message}"):
        open_npz_archive(path)


def test_npz_without_memory_for_an_array_is_not_called_damaged(tmp_path, monkeypatch):
    def refuse(*_):
        raise MemoryError

    archive = open_npz_archive(write_arrays(tmp_path / "a.npz", {"x": np.zeros(3)}))
    monkeypatch.setattr(zipfile.ZipExtFile, "read", refuse)
    with pytest.raises(MemoryError):
        archive.read("x", (3,))


@pytest.mark.parametrize("seed", range(100))
def test_npz_fuzzed_file_gives_motion_or_format_error(tmp_path, seed):
    fuzz_npz.check(seed, tmp_path)


FILES = sorted((DATA.parent / "data" / "npz").glob("kimodo*.npz"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_read_kimodo_positions_equal_posed_joints(path):
    clips = mg.read(path)
    motion = clips[0]
    with np.load(path) as data:
        np.testing.assert_allclose(motion.world_positions(), data["posed_joints"], atol=2e-4)
    assert motion.is_translated.tolist() == [True] + [False] * 29  # bones keep their lengths
    rate_note, arrays_note = clips.notes
    assert rate_note == "frames per second: 30, that of Kimodo's models; the file states none"
    assert arrays_note == "arrays that are not part of the motion: foot_contacts"


@few_examples(20)
@given(st.sampled_from(sorted(SKELETONS)), SEEDS)
def test_read_kimodo_recovers_rotations_and_offsets(tmp_path_factory, n_joints, seed):
    arrays, expected = kimodo_arrays(n_joints, seed=seed)
    path = write_arrays(tmp_path_factory.mktemp("kimodo") / "a.npz", arrays)
    motion = mg.read(path)[0]
    assert_same_rotations(motion.rotations, expected.rotations, atol=1e-5)
    found, offsets = motion.skeleton.offsets, expected.skeleton.offsets
    np.testing.assert_allclose(found[1:], offsets[1:], atol=1e-5)
    np.testing.assert_allclose(motion.world_positions(), arrays["posed_joints"], atol=2e-5)
    assert mg.read(path, rate=60)[0].n_frames == 9


def test_read_kimodo_stretched_bone_keeps_positions(tmp_path):
    arrays, _ = kimodo_arrays()
    arrays["posed_joints"][2, 22:26] += np.float32(0.1)  # the left leg
    motion = mg.read(write_arrays(tmp_path / "a.npz", arrays))[0]
    np.testing.assert_allclose(motion.world_positions(), arrays["posed_joints"], atol=2e-5)
    assert np.flatnonzero(motion.is_translated).tolist() == [0, 22]
    assert motion.skeleton.channels[22][:3] == ("Xposition", "Yposition", "Zposition")
