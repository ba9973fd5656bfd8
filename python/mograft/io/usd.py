"""USD: UsdSkel, which Houdini, Maya, Omniverse, Unreal and Blender read."""

import os
import re
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.atomic import atomic_path
from mograft.body.groups import JointGroups
from mograft.body.mass import up_axis
from mograft.io.figure import PALETTE, bones, members, scale_of, to_y_up
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

__all__ = ["ENDINGS", "write_usd"]

ENDINGS = (".usd", ".usda", ".usdc")


def write_usd(
    motion: Motion,
    path: str | os.PathLike[str],
    *,
    scale: float | None = None,
    groups: JointGroups | str | None = None,
) -> float:
    """Write a motion as a skinned, animated figure in USD; needs the extra ``usd``.

    Parameters
    ----------
    motion : Motion
        The motion.
    path : str or path
        The file to write: ``.usda`` is text, ``.usdc`` and ``.usd`` are binary.
    scale : float, optional
        Metres in a unit of the motion's lengths. Default: as for `write_glb`, a guess.
    groups : JointGroups or str, optional
        Joint groups that the bones are coloured by, or the name of a preset. Default: trunk,
        arms and legs.

    Returns
    -------
    float
        The scale that was used; the file tells it too, in ``customLayerData``.

    Raises
    ------
    ModuleNotFoundError
        If usd-core is not installed.
    ValueError
        If the path ends otherwise, the scale is not above 0, or the groups do not fit.

    Notes
    -----
    Metres (``metersPerUnit`` 1), ``upAxis`` Y, a time code per frame and the motion's rate as
    ``timeCodesPerSecond``. The figure is a ``SkelRoot`` with a ``Skeleton`` whose rest pose has
    all rotations zero, a ``SkelAnimation`` with a key at every frame, and a mesh of the bones.
    What is up in the motion is turned to y by the root alone. Joints are named by paths, which
    hold no signs but letters, digits and underscores; ``jointNames`` holds the names as they are.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> write_usd(dance(strides=1).motion, "dance.usdc")  # metres in a unit  # doctest: +SKIP
    0.01
    """
    target = Path(path)
    if target.suffix.lower() not in ENDINGS:
        raise ValueError(f"path must end in {', '.join(ENDINGS)}, got {target.name}")
    try:
        from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt
    except ImportError as error:
        raise ModuleNotFoundError(
            "USD needs usd-core: pip install 'mograft[usd]'", name="usd-core"
        ) from error
    skeleton = motion.skeleton
    scale, unit = scale_of(skeleton, scale)
    turn = to_y_up(motion)
    group = members(skeleton, groups)
    rest = scale * rotations.rotate(turn, skeleton.rest_positions())

    # A layer without a file: what is interrupted leaves none.
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(motion.rate)
    stage.SetFramesPerSecond(motion.rate)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(motion.n_frames - 1)
    layer = stage.GetRootLayer()
    layer.customLayerData = {
        "mograft": {
            "metres_in_a_unit": scale,
            "unit": unit,
            "up_in_the_motion": "xyz"[up_axis(motion)],
        }
    }
    figure = UsdSkel.Root.Define(stage, "/figure")
    stage.SetDefaultPrim(figure.GetPrim())
    figure.GetPrim().SetDisplayName(_plain(motion.name or "motion"))

    joints = _paths(skeleton)
    bind = UsdSkel.Skeleton.Define(stage, "/figure/skeleton")
    bind.CreateJointsAttr(joints)
    bind.CreateJointNamesAttr([_plain(name) for name in skeleton.names])
    local = scale * skeleton.offsets
    local[0] = rest[0]
    still = np.tile([0.0, 0.0, 0.0, 1.0], (skeleton.n_joints, 1))
    first = still.copy()
    first[0] = turn
    everywhere = np.tile(turn, (skeleton.n_joints, 1))
    bind.CreateBindTransformsAttr(_matrices(Gf, Vt, everywhere, rest))
    bind.CreateRestTransformsAttr(_matrices(Gf, Vt, first, local))

    animation = UsdSkel.Animation.Define(stage, "/figure/motion")
    animation.CreateJointsAttr(joints)
    ones = np.ones((skeleton.n_joints, 3), np.float16)
    animation.CreateScalesAttr(Vt.Vec3hArray.FromNumpy(ones))
    quats = motion.rotations.copy()
    quats[:, 0] = rotations.multiply(np.broadcast_to(turn, quats[:, 0].shape), quats[:, 0])
    quats = rotations.continuous_signs(quats).astype(np.float32)
    places = scale * motion.positions
    places[:, 0] = rotations.rotate(turn, places[:, 0])
    places = places.astype(np.float32)
    turns, shifts = animation.CreateRotationsAttr(), animation.CreateTranslationsAttr()
    with Sdf.ChangeBlock():
        for frame in range(motion.n_frames):
            turns.Set(Vt.QuatfArray.FromNumpy(quats[frame]), frame)
            shifts.Set(Vt.Vec3fArray.FromNumpy(places[frame]), frame)
    binding = UsdSkel.BindingAPI.Apply(bind.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])

    _draw(stage, bones(skeleton, scale, turn), group)
    with atomic_path(target) as draft:
        if not layer.Export(str(draft)):
            raise OSError(f"{target}: cannot be written")
    return scale


def _draw(stage: Any, shape: tuple[FloatArray, FloatArray, IntArray], group: IntArray) -> None:  # noqa: ANN401
    """Add the bones as a mesh that moves with its joints."""
    from pxr import Gf, Sdf, UsdGeom, UsdSkel, Vt

    points, normals, owner = shape
    mesh = UsdGeom.Mesh.Define(stage, "/figure/bones")
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([3] * (len(points) // 3))
    mesh.CreateFaceVertexIndicesAttr(list(range(len(points))))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals.astype(np.float32)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    mesh.CreateExtentAttr([Gf.Vec3f(*low), Gf.Vec3f(*high)])
    palette = np.array([[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in PALETTE]) ** 2.2
    colour = palette[group[owner] % len(palette)].astype(np.float32)
    shown = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex
    )
    shown.Set(Vt.Vec3fArray.FromNumpy(colour))
    skin = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    skin.CreateSkeletonRel().SetTargets(["/figure/skeleton"])
    skin.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
    skin.CreateJointIndicesPrimvar(constant=False, elementSize=1).Set(
        Vt.IntArray.FromNumpy(owner.astype(np.int32))
    )
    weights = Vt.FloatArray.FromNumpy(np.ones(len(points), np.float32))
    skin.CreateJointWeightsPrimvar(constant=False, elementSize=1).Set(weights)


def _matrices(gf: Any, vt: Any, quats: FloatArray, places: FloatArray) -> Any:  # noqa: ANN401 - pxr
    """Return transforms as USD has them, of row vectors."""
    found = []
    for (x, y, z, w), place in zip(quats.tolist(), places.tolist(), strict=True):
        matrix = gf.Matrix4d(1.0)
        matrix.SetRotateOnly(gf.Quatd(w, x, y, z))
        matrix.SetTranslateOnly(gf.Vec3d(*place))
        found.append(matrix)
    return vt.Matrix4dArray(found)


def _paths(skeleton: Skeleton) -> list[str]:
    """Return each joint's path from the root, by names that USD allows and none twice."""
    paths: list[str] = []
    for joint, name in enumerate(skeleton.names):
        own = re.sub(r"[^0-9A-Za-z_]", "_", name)
        if not own or own[0].isdigit():
            own = f"_{own}"
        parent = int(skeleton.parents[joint])
        path = own if parent < 0 else f"{paths[parent]}/{own}"
        paths.append(f"{path}_{joint}" if path in paths else path)
    return paths


def _plain(text: str) -> str:
    """Return text without what UTF-8 and C cannot hold."""
    return text.encode("utf-8", "replace").decode("utf-8").replace("\0", "")
