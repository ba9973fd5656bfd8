"""Damaged USD files: small valid text or binary ones with one to six random changes.

Reading must raise `FormatError`, or give clips that are finite motions or raise `FormatError` when
they are accessed. Text files must take less than 10 seconds and 1 GiB, and must not end the
process. usd-core has no such limits for binary files: those at which it exceeds the limits or ends
the process are counted.
"""

import random
import signal
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

from tests.fuzz import LimitError, change_words, limits, read_motions

# Seeds of files that failed in earlier versions.
SEEDS = (15, 593, 761, 1000415, 2002924)

JOINTS = ("hips", "hips/spine", "hips/leg")
TOKENS = [
    *b"0 -1 nan inf -inf 1e300 1e-300 1e12 4294967296 99999999 None [] ()".split(),
    *(b"(0, 0, 0)", b"(0, 0, 0, 0)", b'""', b'"a/b"', b'"hips"', b'["hips"]'),
    *b"@../x.usda@ @./damaged.usda@ @damaged.usda@</figure> </figure> </figure/walk>".split(),
    *b"Skeleton SkelAnimation SkelRoot Xform def over class { } uniform timeSamples".split(),
    *b"float quatf[] half3[] matrix4d[] token[] = \xc3\x89 \x89".split(),
]
WORDS = [
    bytes(8), b"\xff" * 8, b"\xff\xff\xff\x7f" + bytes(4), b"\xff" * 7 + b"\x7f", b"\1" + bytes(7),
    b"\0\0\0\0\0\0\xf0\x7f", b"\0\0\0\0\0\0\xf8\x7f", b"\0\0\0\x80" * 2, b"\0\0\1" + bytes(5)
]  # fmt: skip


def define_figure(stage, name, joints, rest=None, bind=None):
    """A skeleton; `rest` and `bind` are lists of 4 x 4 arrays that act on column vectors."""
    prim = UsdSkel.Skeleton.Define(stage, f"/{name}/skel")
    prim.CreateJointsAttr(joints)
    for attribute, matrices in (("Rest", rest), ("Bind", bind)):
        if matrices is not None:
            values = Vt.Matrix4dArray([Gf.Matrix4d(m.T.tolist()) for m in matrices])
            getattr(prim, f"Create{attribute}TransformsAttr")(values)
    return prim


def define_animation(stage, path, joints, keys):
    """An animation; `keys` maps a time code to translations, rotations (xyzw) and scales."""
    animation = UsdSkel.Animation.Define(stage, path)
    animation.CreateJointsAttr(joints)
    for code, (translations, quats, scales) in keys.items():
        places = Vt.Vec3fArray.FromNumpy(np.float32(translations))
        animation.CreateTranslationsAttr().Set(places, code)
        animation.CreateRotationsAttr().Set(Vt.QuatfArray.FromNumpy(np.float32(quats)), code)
        animation.CreateScalesAttr().Set(Vt.Vec3hArray.FromNumpy(np.float16(scales)), code)
    return animation


def make_stage(seed):
    """Return a stage with a skeleton and an animation of three joints."""
    rng = np.random.default_rng(seed)
    stage = Usd.Stage.CreateInMemory()
    root = UsdSkel.Root.Define(stage, "/figure")
    if seed % 2:
        turn = root.AddRotateXYZOp()
        for code in (0.0, 2.0):
            turn.Set(Gf.Vec3f(10 * code, 20, 0), code)
    rest = np.tile(np.eye(4), (3, 1, 1))
    rest[:, :3, 3] = rng.normal(size=(3, 3))
    poses = {"rest" if seed % 3 else "bind": rest}
    skeleton = define_figure(stage, "figure", JOINTS, **poses)
    keys = {}
    for code in (0.0, 1.0, 2.0 + seed % 4):
        places, quats = rng.normal(size=(3, 3)), rng.normal(size=(3, 4))
        keys[code] = places, quats / np.linalg.norm(quats, axis=1, keepdims=True), np.ones((3, 3))
    animation = define_animation(stage, "/figure/walk", JOINTS, keys)
    binding = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    UsdGeom.SetStageUpAxis(stage, "Y")
    return stage


@cache
def valid_files():
    """Return the suffix and the bytes of some valid files."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(6):
            for suffix in ("usda", "usdc"):
                path = Path(folder) / f"valid{seed}.{suffix}"
                stage = make_stage(seed)
                assert stage.GetRootLayer().Export(str(path))
                found.append((suffix, path.read_bytes()))
    return found


def mutate(seed):
    """Return the suffix and the bytes of a damaged file."""
    rng = random.Random(seed)
    suffix, data = rng.choice(valid_files())
    for _ in range(rng.randint(1, 6)):
        data = change_words(data, rng, TOKENS) if suffix == "usda" else change_bytes(data, rng)
    return suffix, data


def change_bytes(data, rng):
    """Change bytes, overwrite words, or cut the end."""
    data = bytearray(data)
    kind = rng.randrange(8)
    start = rng.randrange(len(data))
    if kind < 3:
        data[start] = rng.randrange(256)
    elif kind < 6:
        start -= start % 8
        data[start : start + 8] = rng.choice(WORDS)
    elif kind < 7:
        data[start : start + rng.randint(1, 64)] = data[: rng.randint(1, 64)]
    else:
        del data[start:]
    return bytes(data) or b"P"


def check(seed, folder):
    """Read a damaged file; return the number of motions that were read."""
    suffix, data = mutate(seed)
    path = folder / f"damaged{seed}.{suffix}"  # usd-core keeps layers by name
    path.write_bytes(data)
    try:
        with limits(10.0):
            motions, _ = read_motions(path)
    except LimitError:
        if suffix == "usda":
            raise
        signal.raise_signal(signal.SIGTERM)  # ends this process, whose peak would stay
    path.unlink()
    return len(motions)


def is_excused(seed, returncode):
    """Return whether a signal ended the process at a binary file: usd-core has no limits there."""
    return returncode < 0 and mutate(seed)[0] == "usdc"
