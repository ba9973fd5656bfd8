"""Damaged FBX files: small generated ones with one to five random changes.

Reading must raise `FormatError`, or give clips that are finite motions or raise `FormatError` when
they are accessed. It must take less than 10 seconds and 1 GiB, and must not end the process.
"""

from functools import cache

import numpy as np

from tests.fuzz import NUMBERS, damage, limits, read_motions
from tests.io import fbx_scenes as fbx

TOKENS = [
    *b"0 -1 1 3 1e308 -1e309 nan inf 9223372036854775807 99999999999999999999 *2147483647".split(),
    *b'{ } "" "Model::hips" , : OO OP 1001 1002 L C U a: Properties70: Objects:'.split(),
    b"\0", b"\n", b";", b'"', b"\xff", b"", *NUMBERS
]  # fmt: skip


@cache
def sources():
    """Return the contents that are damaged, by the name of the container."""
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
    return {name: write(scene) for name, write in fbx.CONTAINERS.items()}


def mutate(seed):
    """Return a damaged file."""
    return damage(seed, sources(), TOKENS)[1]


def check(seed, folder):
    """Read a damaged file; return the number of motions that were read."""
    path = folder / "damaged.fbx"
    path.write_bytes(mutate(seed))
    with limits(10.0):
        motions, errors = read_motions(path)
    assert not motions or all("take" in error.place for error in errors)
    return len(motions)
