"""USD: UsdSkel files for Houdini, Maya, Omniverse, Unreal and Blender."""

import errno
import os
import re
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray
from mograft._util.atomic import checked_path
from mograft._util.extras import import_extra
from mograft.body.groups import JointGroups
from mograft.io.export_figure import BoneMesh, ExportTransform, bone_mesh, check_single_precision
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

SUFFIXES = (".usd", ".usda", ".usdc")
NEED = "USD needs usd-core"

# Paths of the prims.
_FIGURE = "/figure"
_SKELETON = "/figure/skeleton"
_ANIMATION = "/figure/motion"
_MESH = "/figure/bones"


def write_usd(
    motion: Motion,
    path: str | os.PathLike[str],
    *,
    scale: float | None = None,
    groups: JointGroups | str | None = None,
) -> None:
    """Write a motion as a skinned, animated figure in USD; requires ``mograft[usd]``.

    Parameters
    ----------
    motion : Motion
        The motion.
    path : str or path
        The file to write: ``.usda`` is text, ``.usdc`` and ``.usd`` are binary.
    scale, groups
        As for `write_glb`; ``customLayerData`` of the file states the scale.

    Raises
    ------
    ModuleNotFoundError
        If usd-core is not installed.
    ValueError
        If the path has another suffix, the scale is not above 0, the groups do not fit the
        skeleton, or a coordinate exceeds 1e38.
    OSError
        If the file cannot be written.

    Notes
    -----
    Lengths are in metres (``metersPerUnit`` 1), ``upAxis`` is Y, each frame is one time code, and
    ``timeCodesPerSecond`` is the rate of the motion. The figure is a ``SkelRoot`` with a
    ``Skeleton`` whose rest pose has all rotations zero, a ``SkelAnimation`` with a key at every
    frame, and a mesh of the bones. Only the root is rotated from the up direction of the motion
    to y. Joints are identified by paths, in which characters other than letters, digits and
    underscores are replaced; ``jointNames`` holds the original names.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> write_usd(dance(strides=1).motion, "dance.usdc")  # doctest: +SKIP
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise ValueError(f"`path` must end in {', '.join(SUFFIXES)}, got {target.name}")
    import_extra("pxr", NEED, "usd")
    from pxr import Tf, Usd

    transform = ExportTransform.of(motion, scale)
    mesh = bone_mesh(motion.skeleton, transform, groups)
    # The stage is in memory, so an interrupted call leaves no file.
    stage = Usd.Stage.CreateInMemory()
    _define_figure(stage, motion, transform)
    _define_mesh(stage, mesh)
    with checked_path(target, lambda draft: _has_keys(draft, motion.n_frames)) as draft:
        try:
            stage.GetRootLayer().Export(str(draft))
        except Tf.ErrorException as error:
            raise OSError(errno.EIO, usd_reasons(error)[0], str(target)) from error


def usd_reasons(error: Exception) -> list[str]:
    """Return the reasons in an error of usd-core, without its functions and files."""
    try:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    except UnicodeDecodeError:  # usd-core quotes a file that is not text
        lines = ["expected text in UTF-8"]
    pattern = re.compile(r"^Error in '.*?' at line \d+ in file .*? : '(.*)'$")
    return [pattern.sub(r"\1", own) for own in lines]


def _has_keys(path: Path, count: int) -> bool:
    """Return whether usd-core reads `count` keys of the rotations in a file."""
    from pxr import Sdf

    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    return bool(layer.GetNumTimeSamplesForPath(f"{_ANIMATION}.rotations") == count)


# The stage of pxr has no type.
def _define_figure(stage: Any, motion: Motion, transform: ExportTransform) -> None:  # noqa: ANN401
    """Set units, axes, times and metadata; add the skeleton in its rest pose, and its motion."""
    from pxr import Sdf, UsdGeom, UsdSkel, Vt

    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(motion.rate)
    stage.SetFramesPerSecond(motion.rate)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(motion.n_frames - 1)
    stage.GetRootLayer().customLayerData = {"mograft": transform.metadata}
    figure = UsdSkel.Root.Define(stage, _FIGURE).GetPrim()
    stage.SetDefaultPrim(figure)
    figure.SetDisplayName(_to_usd_text(motion.name or "motion"))

    skeleton, paths = motion.skeleton, _joint_paths(motion.skeleton)
    prim = UsdSkel.Skeleton.Define(stage, _SKELETON)
    prim.CreateJointsAttr(paths)
    prim.CreateJointNamesAttr([_to_usd_text(name) for name in skeleton.names])
    world_positions = transform.points(skeleton.rest_positions())
    check_single_precision("rest position", world_positions, skeleton)
    positions = transform.scale * skeleton.offsets
    positions[0] = world_positions[0]
    world_quats = np.tile(transform.to_y_up, (skeleton.n_joints, 1))
    quats = np.tile(rotations.IDENTITY, (skeleton.n_joints, 1))
    quats[0] = transform.to_y_up
    prim.CreateBindTransformsAttr(_to_matrices(world_quats, world_positions))
    prim.CreateRestTransformsAttr(_to_matrices(quats, positions))

    animation = UsdSkel.Animation.Define(stage, _ANIMATION)
    animation.CreateJointsAttr(paths)
    animation.CreateScalesAttr(Vt.Vec3hArray.FromNumpy(np.ones((motion.n_joints, 3), np.float16)))
    local = transform.local_transforms(motion)
    turns, places = (values.astype(np.float32) for values in local)
    rotation_keys = animation.CreateRotationsAttr()
    translation_keys = animation.CreateTranslationsAttr()
    with Sdf.ChangeBlock():
        for frame in range(motion.n_frames):
            rotation_keys.Set(Vt.QuatfArray.FromNumpy(turns[frame]), frame)
            translation_keys.Set(Vt.Vec3fArray.FromNumpy(places[frame]), frame)
    binding = UsdSkel.BindingAPI.Apply(prim.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])


def _define_mesh(stage: Any, mesh: BoneMesh) -> None:  # noqa: ANN401
    """Add the bones as a mesh; each vertex is bound to one joint."""
    from pxr import Gf, Sdf, UsdGeom, UsdSkel, Vt

    points, normals, joints, colours = mesh
    prim = UsdGeom.Mesh.Define(stage, _MESH)
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    prim.CreateFaceVertexCountsAttr([3] * (len(points) // 3))
    prim.CreateFaceVertexIndicesAttr(list(range(len(points))))
    prim.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals.astype(np.float32)))
    prim.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    bounds = points.min(axis=0), points.max(axis=0)
    prim.CreateExtentAttr([Gf.Vec3f(*corner.tolist()) for corner in bounds])
    display_colour = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex
    )
    display_colour.Set(Vt.Vec3fArray.FromNumpy(colours.astype(np.float32)))
    skin = UsdSkel.BindingAPI.Apply(prim.GetPrim())
    skin.CreateSkeletonRel().SetTargets([_SKELETON])
    skin.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
    indices = Vt.IntArray.FromNumpy(joints.astype(np.int32))
    skin.CreateJointIndicesPrimvar(constant=False, elementSize=1).Set(indices)
    weights = Vt.FloatArray.FromNumpy(np.ones(len(points), np.float32))
    skin.CreateJointWeightsPrimvar(constant=False, elementSize=1).Set(weights)


def _to_matrices(quats: FloatArray, positions: FloatArray) -> Any:  # noqa: ANN401 - pxr
    """Return rigid transforms as USD matrices. These act on row vectors."""
    from pxr import Gf, Vt

    places = (Gf.Vec3d(*own) for own in positions.tolist())
    turns = (Gf.Quatd(w, x, y, z) for x, y, z, w in quats.tolist())
    pairs = zip(turns, places, strict=True)
    rigid = [Gf.Matrix4d(1.0).SetRotateOnly(a).SetTranslateOnly(b) for a, b in pairs]
    return Vt.Matrix4dArray(rigid)


def _joint_paths(skeleton: Skeleton) -> list[str]:
    """Return a unique path from the root for each joint, made of valid USD identifiers."""
    paths: list[str] = []
    taken: set[str] = set()
    for joint, name in enumerate(skeleton.names):
        identifier = re.sub(r"[^0-9A-Za-z_]", "_", name)
        if not identifier or identifier[0].isdigit():
            identifier = f"_{identifier}"
        parent = int(skeleton.parents[joint])
        path = identifier if parent < 0 else f"{paths[parent]}/{identifier}"
        while path in taken:
            path = f"{path}_{joint}"
        taken.add(path)
        paths.append(path)
    return paths


def _to_usd_text(text: str) -> str:
    """Return text that USD can store: lone surrogates are replaced, null characters removed."""
    return text.encode("utf-8", "replace").decode("utf-8").replace("\0", "")
