"""Damaged NPZ files: small ones of mograft, AMASS or Kimodo, with changes of arrays or of bytes.

Within 5 seconds, reading must return a motion of finite numbers or raise a `FormatError` with the
path.
"""

import io
import random
import tempfile
import warnings
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np

from mograft import formats
from mograft.dancer import dance
from tests.fuzz import change_bytes, limits, read_motions
from tests.io.npz_files import amass_arrays, kimodo_arrays

_VALUES = (0, 1, -1, 1e300, -1e300, 1e-300, np.nan, np.inf, 1e19, 0.5)
_TYPES = ("f4", "f8", ">f8", "f2", "i4", "u1", "bool", "U3", "c16", "M8[s]", "O", "S2")
_SHAPES = ((-1,), (1, -1), (-1, 1, 1), (2, -1), (0,))
_WORDS = (bytes(4), b"\xff" * 4, b"PK\1\2", b"PK\3\4", b"\x93NUMPY", b"'descr'", b"(9, 9)")


def _with_value(array, rng):
    is_changed = np.arange(array.size).reshape(array.shape) == rng.randrange(array.size)
    return np.where(is_changed, rng.choice(_VALUES), array).astype(array.dtype)


_CHANGES = (
    lambda array, rng: array[..., : rng.randint(0, 4)],
    lambda array, rng: array.reshape(rng.choice(_SHAPES)),
    lambda array, _: np.asfortranarray(array),
    # NumPy 2.4 can crash where it converts texts to dates or dates to texts.
    lambda array, rng: array if array.dtype.kind in "MSU" else array.astype(rng.choice(_TYPES)),
    _with_value,
)


@cache
def valid_arrays():
    """Arrays of one valid file of each kind."""
    buffer = Path(tempfile.mkdtemp()) / "m.npz"
    formats.write_npz(dance(strides=1).motion[:2], buffer)
    with np.load(buffer) as data:
        own = dict(data)
    kinds = [own, *(amass_arrays(columns, 2) for columns in (72, 156, 165))]
    return [*kinds, kimodo_arrays(30, 2)[0], kimodo_arrays(22, 2)[0]]


def mutate(seed):
    """Return the bytes of a damaged file."""
    rng = random.Random(seed)
    arrays = dict(rng.choice(valid_arrays()))
    for _ in range(rng.choice([0, 0, 1, 1, 2])):
        name = rng.choice(list(arrays))
        if rng.random() < 0.2:
            arrays[rng.choice(["poses", "trans", "x", "pose_body"])] = arrays.pop(name)
            continue
        quiet = np.errstate(all="ignore"), warnings.catch_warnings(action="ignore")
        with quiet[0], quiet[1], suppress(IndexError, OverflowError, TypeError, ValueError):
            arrays[name] = rng.choice(_CHANGES)(arrays[name], rng)
    buffer = io.BytesIO()
    rng.choice([np.savez, np.savez_compressed])(buffer, **arrays)
    data = buffer.getvalue()
    for _ in range(rng.choice([0, 0, 1, 2, 6])):
        start = rng.choice([0, max(len(data) - 900, 0)])  # the end has the directory
        data = data[:start] + change_bytes(data[start:], rng, _WORDS)
    return data or b"P"


def check(seed, folder):
    """Read a damaged file; return whether it is a motion."""
    path = folder / "m.npz"
    path.write_bytes(mutate(seed))
    with limits(5.0):
        return len(read_motions(path)[0])
