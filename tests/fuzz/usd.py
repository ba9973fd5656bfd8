"""Damaged USD files: small valid text or binary ones with one to five random changes.

Reading must raise `FormatError`, or give clips that are finite motions or raise `FormatError` when
they are accessed. Text files must take less than 10 seconds and 1 GiB, and must not end the
process. usd-core has no such limits for binary files: those at which it exceeds the limits or ends
the process are counted.
"""

import signal
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdSkel, Vt
from scipy.spatial.transform import Rotation

from tests.fuzz import NUMBERS, LimitError, damage, limits, read_motions

JOINTS = ["hips", "hips/spine", "hips/spine/head", "hips/leg"]
TOKENS = [
    *b"0 -1 nan inf -inf 1e300 1e-300 1e12 4294967296 99999999 None [] ()".split(),
    *(b"(0, 0, 0)", b"(0, 0, 0, 0)", b'""', b'"a/b"', b'"hips"', b'["hips"]'),
    *b"@../x.usda@ @./damaged.usda@ @damaged.usda@</figure> </figure> </figure/walk>".split(),
    *b"Skeleton SkelAnimation SkelRoot Xform def over class { } uniform timeSamples".split(),
    *b"float quatf[] half3[] matrix4d[] token[] = \xc3\x89 \x89".split(),
    *NUMBERS,
]


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


def make_stage(seed, pose="rest"):
    """Return a stage with a moving figure of four joints and an animation of three of them."""
    rng = np.random.default_rng(seed)
    stage = Usd.Stage.CreateInMemory()
    root = UsdSkel.Root.Define(stage, "/figure")
    shift, turn = root.AddTranslateOp(), root.AddRotateXYZOp()
    for code in (1.0, 4.0):
        shift.Set(Gf.Vec3d(code, 0, 1), code)
        turn.Set(Gf.Vec3f(10 * code, 20, -30 * code), code)
    rest = np.tile(np.eye(4), (4, 1, 1))
    rest[:, :3, :3] = Rotation.random(4, random_state=rng).as_matrix()
    rest[:, :3, 3] = rng.normal(size=(4, 3))
    skeleton = define_figure(stage, "figure", JOINTS, **{pose: rest})
    keys = {}
    for code in (1.0, 2.0, 4.0):
        quats = Rotation.random(3, random_state=rng).as_quat()
        keys[code] = rng.normal(size=(3, 3)), quats, rng.uniform(0.5, 1.5, (3, 1)) * np.ones(3)
    moved = [JOINTS[3], JOINTS[0], JOINTS[1]]  # in another order, without the head
    animation = define_animation(stage, "/figure/walk", moved, keys)
    binding = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    return stage


@cache
def valid_files():
    """Return the contents of some valid files by name."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in ("rest.usda", "bind.usda", "rest.usdc", "bind.usdc"):
            path = Path(folder) / name
            stage = make_stage(0, path.stem)  # the layer exists as long as it
            assert stage.GetRootLayer().Export(str(path))
            found[name] = path.read_bytes()
    return found


def mutate(seed):
    """Return the name and the content of a damaged file."""
    return damage(seed, valid_files(), TOKENS)


def check(seed, folder):
    """Read a damaged file; return the number of motions that were read."""
    name, data = mutate(seed)
    path = folder / f"damaged{seed}{name}"  # usd-core keeps layers by name
    path.write_bytes(data)
    try:
        with limits(10.0):
            motions, _ = read_motions(path)
    except LimitError:
        if path.suffix == ".usda":
            raise
        signal.raise_signal(signal.SIGTERM)  # ends this process, whose peak would stay
    path.unlink()
    return len(motions)


def is_excused(seed, returncode):
    """Return whether a signal ended the process at a binary file: usd-core has no limits there."""
    return returncode < 0 and mutate(seed)[0].endswith("usdc")
