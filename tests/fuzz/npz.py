"""Damaged NPZ files: small ones of mograft, AMASS or Kimodo, with changes of arrays or of bytes.

Within 5 seconds, reading must return a motion of finite numbers or raise a `FormatError` with the
path.
"""

import contextlib
import io
import random
import tempfile
import warnings
from functools import cache
from pathlib import Path

import numpy as np

from mograft import formats
from mograft.dancer import dance
from tests.fuzz import limits, read_motions
from tests.io.npz_files import amass_arrays, kimodo_arrays

# Seeds of files that failed in earlier versions.
SEEDS = (1264, 1473)

_VALUES = (0, 1, -1, 1e300, -1e300, 1e-300, np.nan, np.inf, 1e19, 0.5)
_TYPES = ("f4", "f8", ">f8", "f2", "i4", "u1", "bool", "U3", "c16", "M8[s]", "O", "S2")


@cache
def valid_arrays():
    """Arrays of one valid file of each kind."""
    buffer = Path(tempfile.mkdtemp()) / "m.npz"
    formats.write_npz(dance(strides=1).motion[:2], buffer)
    with np.load(buffer) as data:
        own = dict(data)
    kinds = [own, *(amass_arrays(columns, 2) for columns in (72, 156, 165))]
    return [*kinds, kimodo_arrays(30, 2)[0], kimodo_arrays(22, 2)[0]]


def change_array(array, rng):
    """Return an array with another shape, type or value."""
    change = rng.randrange(6)
    with contextlib.suppress(ValueError, TypeError, OverflowError):
        if change == 0 and array.ndim:
            return array[:, : rng.randint(0, 4)] if array.ndim > 1 else array[: rng.randint(0, 4)]
        if change == 1:
            kind = rng.choice(_TYPES)
            # NumPy 2.4 can crash where it converts texts to dates or dates to texts.
            return array if array.dtype.kind in "MSU" else array.astype(kind)
        if change == 2 and array.size:
            changed = array.copy()
            changed.reshape(-1)[rng.randrange(array.size)] = rng.choice(_VALUES)
            return changed
        if change == 3:
            return array.reshape(rng.choice([(-1,), (1, -1), (-1, 1, 1), (2, -1), (0,)]))
        if change == 4:
            return np.asfortranarray(array)
        return np.full(array.shape, rng.choice(_VALUES)).astype(array.dtype)
    return array


def mutate(seed):
    """Return the bytes of a damaged file."""
    rng = random.Random(seed)
    arrays = dict(rng.choice(valid_arrays()))
    for _ in range(rng.choice([0, 0, 1, 1, 2])):
        name = rng.choice(list(arrays))
        if rng.random() < 0.2:
            arrays[rng.choice(["poses", "trans", "x", "pose_body"])] = arrays.pop(name)
        else:
            with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
                arrays[name] = change_array(arrays[name], rng)
    buffer = io.BytesIO()
    rng.choice([np.savez, np.savez_compressed])(buffer, **arrays)
    data = bytearray(buffer.getvalue())
    for _ in range(rng.choice([0, 0, 1, 2, 6])):
        start = rng.choice([rng.randrange(len(data)), rng.randrange(400), -1 - rng.randrange(900)])
        start = max(min(start, len(data) - 1), -len(data))
        if rng.random() < 0.8:
            changed = [0, 255, rng.randrange(256), data[start] ^ 1 << rng.randrange(8)]
            data[start] = rng.choice(changed)
        else:
            del data[start : start + rng.choice([1, 8, 100, len(data)])]
            data = data or bytearray(b"P")
        if len(data) < 1000:
            break
    return bytes(data)


def check(seed, folder):
    """Read a damaged file; return whether it is a motion."""
    path = folder / "m.npz"
    path.write_bytes(mutate(seed))
    with limits(5.0):
        return len(read_motions(path)[0])
