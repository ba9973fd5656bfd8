"""NPZ files that are damaged, claim too much, hold pickled objects, or have no known format."""

import io
import subprocess
import sys
import zipfile

import numpy as np
import pytest

import mograft as mg
from mograft.io.npz_archive import open_npz_archive
from tests.fuzz import npz as fuzz_npz
from tests.io.amass_file import write_arrays
from tests.memory import PEAK_BYTES


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
    code = (
        f"{PEAK_BYTES}\n"
        "import sys, mograft as mg\n"
        "before = peak_bytes()\n"
        "try:\n"
        "    mg.read(sys.argv[1])\n"
        "except mg.FormatError as error:\n"
        "    print(error)\n"
        "print((peak_bytes() - before) >> 20)\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True
    )
    message, mebibytes = run.stdout.splitlines()
    assert "array `poses`: damaged: EOF: reading array header, expected 2147483647 bytes" in message
    assert int(mebibytes) < 100


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"x": np.zeros(3)}, r"expected the arrays of mograft \(`format`\), AMASS .*, got x$"),
        ({"format": np.array("other/2")}, "`format`: expected mograft.motion/1, got other/2"),
        ({"format": np.array(None)}, "array `format`: expected numbers, got pickled objects"),
        ({"format": np.array("mograft.motion/1")}, "array `names`: expected this array, got none"),
    ],
)
def test_npz_of_unknown_content_raises_format_error(tmp_path, arrays, message):
    path = write_arrays(tmp_path / "a.npz", arrays)
    with pytest.raises(mg.FormatError, match=r"a\.npz: .*" + message):
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


@pytest.mark.parametrize("version", [1, 2])
def test_npz_header_that_ends_early_raises_format_error(tmp_path, version):
    length = (118).to_bytes(2 * version, "little")
    member = b"\x93NUMPY" + bytes([version, 0]) + length + header_of((2, 3))[10:-1]
    path = write_members(tmp_path / "a.npz", {"x": member})
    with pytest.raises(mg.FormatError, match=r"array `x`: .* header, expected 118 bytes got 117"):
        open_npz_archive(path)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (b"{'descr': '<f8', 'fortran_order': False, 'shape': (3), }", "shape is not valid: 3"),
        (b"{'descr': " + b"-" * 9000 + b"1}", "expected the header of a NumPy array, got a deep"),
    ],
)
def test_npz_header_that_is_invalid_raises_format_error(tmp_path, header, message):
    member = b"\x93NUMPY\1\0" + len(header).to_bytes(2, "little") + header + bytes(24)
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


@pytest.mark.parametrize("seed", [*fuzz_npz.SEEDS, *range(100)])
def test_npz_fuzzed_file_gives_motion_or_format_error(tmp_path, seed):
    fuzz_npz.check(seed, tmp_path)
