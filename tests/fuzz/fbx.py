"""Damaged FBX files: small generated ones with one to six random changes.

Reading must raise `FormatError`, or give clips that are finite motions or raise `FormatError` when
they are accessed. It must take less than 10 seconds and 1 GiB, and must not end the process.
"""

import random
from functools import cache

import numpy as np

from tests.fuzz import limits, read_motions
from tests.io import fbx_scenes as fbx

# Seeds of files that failed in earlier versions.
SEEDS = ()

NUMBERS = [
    bytes(8), b"\xff" * 8, b"\xff\xff\xff\x7f" + bytes(4), b"\xff" * 7 + b"\x7f", b"\1" + bytes(7),
    b"\0\0\0\0\0\0\xf0\x7f", b"\0\0\0\0\0\0\xf8\x7f", b"\xff" * 6 + b"\xef\x7f", b"\0\0\0\x80" * 2
]  # fmt: skip
"""Extreme integers and floats, little-endian."""

TOKENS = [
    *b"0 -1 1 3 1e308 -1e309 nan inf 9223372036854775807 99999999999999999999 *2147483647".split(),
    *b'{ } "" "Model::hips" , : OO OP 1001 1002 L C U a: Properties70: Objects:'.split(),
    b"\0", b"\n", b";", b'"', b"\xff", b""
]  # fmt: skip


@cache
def sources():
    """Return the contents that are damaged, one of each kind of container."""
    rng = np.random.default_rng(0)
    nodes = (
        fbx.Node("hips", T=(0, 90, 0), pre=(10, 0, 20)),
        fbx.Node("spine", 0, T=(0, 20, 0), order=3, inherit=fbx.INHERIT_RRSS),
        fbx.Node("leg", 0, T=(10, 0, 0), post=(0, 45, 0), rotation_pivot=(1, 2, 3)),
        fbx.Node("foot", 2, T=(0, -40, 0), inherit=fbx.INHERIT_RRS),
    )
    tracks = {(n, key): rng.uniform(0.5, 30, (12, 3)) for n in range(4) for key in "TRS"}
    clips = {"walk": tracks, "run": {(0, "T"): tracks[0, "T"]}}
    takes = tuple(fbx.Take(name, 12, (fbx.Layer(own),)) for name, own in clips.items())
    scene = fbx.Scene(nodes, takes, bind={0: np.eye(4), 1: np.eye(4)})
    return [write(scene) for write in fbx.CONTAINERS.values()]


def mutate(seed):
    """Return a damaged file."""
    rng = random.Random(seed)
    data = rng.choice(sources())
    is_text = data.startswith(b";")
    for _ in range(rng.randint(1, 6)):
        data = _change_text(rng, data) if is_text and rng.random() < 0.7 else _change(rng, data)
    return data


def _change(rng, data):
    """Change bytes anywhere."""
    start = rng.randint(0, len(data))
    length = rng.choice([1, 1, 4, 8, 60, 900])
    kind = rng.randrange(7)
    if kind == 0:
        return data[:start] + rng.randbytes(length) + data[start + length :]
    if kind in (1, 2):
        number = rng.choice(NUMBERS)[: rng.choice([1, 4, 8])]
        return data[:start] + number + data[start + len(number) :]
    if kind == 3:
        return data[:start] + data[start + length :]
    if kind in (4, 5):
        other, stop = rng.randint(0, len(data)), start if kind == 4 else start + length
        return data[:start] + data[other : other + length] + data[stop:]
    return data[:start] if rng.random() < 0.3 else data[:start] + data[start : start + 1] * 2


def _change_text(rng, data):
    """Change words or lines."""
    kind = rng.randrange(3)
    if kind == 0:
        words = data.split(b" ")
        words[rng.randrange(len(words))] = rng.choice(TOKENS)
        return b" ".join(words)
    if kind == 1:
        numbers = data.split(b",")
        numbers[rng.randrange(len(numbers))] = rng.choice(TOKENS)
        return b",".join(numbers)
    lines = data.split(b"\n")
    one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[one : one + rng.randint(0, 3)] = lines[other : other + rng.randint(0, 30)]
    return b"\n".join(lines)


def check(seed, folder):
    """Read a damaged file; return the number of motions that were read."""
    path = folder / "damaged.fbx"
    path.write_bytes(mutate(seed))
    with limits(10.0):
        motions, errors = read_motions(path)
    assert not motions or all("take" in error.place for error in errors)
    return len(motions)
