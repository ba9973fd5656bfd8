"""Damaged glTF files: small valid ones with changes of their document, buffer or bytes.

Within 5 seconds of processor time, reading must return motions of finite numbers or raise a
`FormatError` with the path. A copy of a file that is read, with new animations, must have the same
clips.
"""

import copy
import json
import random
from dataclasses import replace
from functools import cache

import numpy as np

import mograft as mg
from mograft import formats
from tests.fuzz import limits, outcome, read_motions
from tests.io.gltf_scenes import pack_glb, random_scene

# Seeds of files that failed in earlier versions.
SEEDS = (103662, 4000568)

_VALUES = (
    *(None, True, False, -1, 0, 1, 2, 3, 5, 255, 2**31, 2**32, 2**63, 2**64, 10**400),
    *(0.5, 1e30, 1e300, -1e300, float("nan"), float("inf"), "", "x", "STEP", "CUBICSPLINE"),
    *("rotation", "SCALAR", "VEC3", "VEC4", "MAT4", 5120, 5121, 5123, 5125, 5126, "../x", "x.bin"),
    *([], [0], [1, 0], [0] * 16, [None], {}, {"count": 1}, {"bufferView": 0}, "data:;base64,AAAA"),
)


@cache
def valid_files():
    """JSON documents and buffers of some valid files."""
    scales = ("none", "uniform", "mirrored", "any")
    found = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        scene = random_scene(rng, scale=scales[seed % 4], has_skin=seed % 3 > 0)
        document, binary = scene.document(rng)
        if seed % 2:
            document["buffers"].append({"byteLength": 3, "uri": "data:;base64,AAAA"})
            document["bufferViews"].append({"buffer": 1, "byteOffset": 1, "byteLength": 2})
            document["images"] = [{"uri": "x.png"}, {"bufferView": 0, "mimeType": "image/png"}]
        found.append((json.dumps(document), binary))
    return found


def mutate(seed):
    """Return the bytes of a damaged GLB file."""
    rng = random.Random(seed)
    text, binary = rng.choice(valid_files())
    document, buffer = json.loads(text), bytearray(binary)
    for _ in range(rng.randint(0, 3)):
        change_value(document, rng)
    for _ in range(rng.choice((0, 0, 1, 4))):
        start = rng.randrange(len(buffer) // 4) * 4
        words = (b"\0\0\xc0\x7f", b"\0\0\x80\x7f", b"\xff\xff\x7f\x7f", b"\0" * 4, rng.randbytes(4))
        buffer[start : start + 4] = rng.choice(words)
    if rng.random() < 0.1:
        del buffer[rng.randrange(len(buffer)) :]
    data = bytearray(pack_glb(document, bytes(buffer)))
    if rng.random() < 0.2:
        for _ in range(rng.randint(1, 4)):
            data[rng.randrange(len(data))] = rng.randrange(256)
    if rng.random() < 0.1:
        del data[rng.randrange(4, len(data)) :]
    return bytes(data)


def change_value(document, rng):
    """Replace, delete or copy a value at a random place of a JSON document."""
    inner = document
    while True:
        keys = list(inner) if isinstance(inner, dict) else list(range(len(inner)))
        if not keys:
            return
        key = rng.choice(keys)
        if not isinstance(inner[key], list | dict) or not inner[key] or rng.random() < 0.15:
            break
        inner = inner[key]
    way = rng.randrange(8)
    if way == 0:
        del inner[key]
    elif way == 1 and isinstance(inner, list):
        inner.append(copy.deepcopy(inner[key]))
    else:
        inner[key] = copy.deepcopy(rng.choice(_VALUES))


def check(seed, folder):
    """Read a damaged file, and write a copy if all clips are valid; return their number."""
    path = folder / "damaged.glb"
    path.write_bytes(mutate(seed))
    with limits(5.0):
        motions, errors = read_motions(path)
        if motions and not errors:
            refused = outcome(write_copy, path, motions, folder / "copy.glb")
            assert refused is None or str(refused).startswith(f"{path}: "), refused
    return len(motions)


def write_copy(path, clips, target):
    """Write a copy with new animations, and compare the old ones."""
    base = clips[0]
    # The lengths may be too large for single precision; long clips take long to write.
    if np.abs(base.positions).max() > 1e30 or base.n_frames > 20_000:
        return
    new = replace(base, rotations=base.rotations[::-1], name="new", channel_values=None)
    formats.write_glb_animations(path, [new, new], target, bases=[base, None])
    again = mg.read(target)
    assert len(again) == len(clips) + 2
    for old, own in zip(clips, again, strict=False):
        np.testing.assert_array_equal(own.world_positions(), old.world_positions())
