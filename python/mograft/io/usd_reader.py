"""Read the motions of USD files: the animations of UsdSkel skeletons."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.names import unique_names
from mograft.errors import FormatError
from mograft.io.clips import Clips, errors_of_file
from mograft.io.gltf.animation import DEFAULT_RATE
from mograft.io.gltf.nodes import Transforms, decompose, to_world
from mograft.io.rest_pose import RestPose, rebase
from mograft.io.usd_crate import check_crate
from mograft.motion import limits
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

_CHANNELS = ("translations", "rotations", "scales")

_GRID_TOLERANCE = 1e-6
"""Deviation of keys from whole time codes that is tolerated, in time codes."""

_MIN_FRAME_LIMIT, _FRAMES_PER_KEY = 1 << 15, 8
_MIN_POSE_LIMIT, _POSES_PER_BYTE = 1 << 21, 8
"""Limits of the frames of a motion, and of the poses of its joints: a constant, or a multiple of
the keys and of the bytes of the layers if that is more. Two keys may claim any duration."""


_VALUE_ERRORS = (AttributeError, OverflowError, RuntimeError, TypeError, ValueError)
"""Errors of values that have another type than that of the schema, and of names not in UTF-8."""


@dataclass(frozen=True, eq=False)
class _Figure:
    """A skeleton of a stage as a tree of nodes: node 0 is its prim, the others are its joints."""

    path: Path
    prim: Any  # a prim of pxr, which is not typed
    joints: tuple[str, ...]  # paths of the joints
    names: tuple[str, ...]  # of all nodes
    parents: IntArray  # of all nodes
    rest: Transforms  # of all nodes, one frame; that of node 0 is its world transform

    @property
    def first(self) -> int:
        """The node that is the root of the motion, which has a single root.

        It is the root joint or, if there are several, the prim.
        """
        return 1 if (self.parents[1:] == 0).sum() == 1 else 0

    def rest_pose(self) -> RestPose:
        """Return the rest pose of the joints of the motion."""
        turned, positions = to_world(self.parents, self.rest)
        parents = np.maximum(self.parents[self.first :] - self.first, -1)
        return RestPose(
            self.names[self.first :], parents, turned[0, self.first :], positions[0, self.first :]
        )


def open_usd(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:  # noqa: ARG001
    """Return the clips of a USD file; see `mograft.io.formats.Opener`.

    Each ``SkelAnimation`` is a clip. It moves the ``Skeleton`` to which it is bound, or else the
    first ``Skeleton`` that has all of its joints. The rest pose is that of ``restTransforms``, or
    else of ``bindTransforms``. Units and axes are those of the file. Raises `FormatError` if a
    layer is outside the folder of the file, and ModuleNotFoundError if usd-core is not installed.
    """
    stage = _open_stage(path)
    with _usd_errors(path):
        figures = [_read_figure(path, prim) for prim in _prims(stage, "Skeleton")]
        animations = _prims(stage, "SkelAnimation")
        pairs = [(animation, _find_figure(path, animation, figures)) for animation in animations]
        notes = _notes(stage)

    def load(clip: int) -> Motion:
        animation, figure = pairs[clip]
        with _usd_errors(path):
            motion = _sample(stage, animation, figure, rate)
        return replace(motion, name=names[clip], path=path)

    names = tuple(unique_names([animation.GetName() for animation in animations]))
    return Clips(path, names, load, "USD", notes)


@contextmanager
def _usd_errors(path: Path) -> Iterator[None]:
    """Convert the errors of usd-core, which may occur at any access, to `FormatError`."""
    from pxr import Tf

    try:
        yield
    except FormatError:
        raise
    except (Tf.ErrorException, *_VALUE_ERRORS) as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        raise FormatError(f"expected a USD file: {lines[-1] if lines else error}", path) from error


def _open_stage(path: Path) -> Any:  # noqa: ANN401 - pxr has no types
    """Open a stage; raise `FormatError` if a layer is outside the folder of the file."""
    try:
        from pxr import Sdf, Usd
    except ImportError as error:
        raise ModuleNotFoundError(
            "USD needs usd-core: pip install 'mograft[usd]'", name="usd-core"
        ) from error
    with _usd_errors(path):
        folder = path.resolve().parent
        pending, known = [str(path)], set()
        while pending:
            name = pending.pop()
            check_crate(Path(name))
            layer = Sdf.Layer.FindOrOpen(name)
            if layer is None or name in known:
                continue
            known.add(name)
            for asset in layer.GetCompositionAssetDependencies():
                target = layer.ComputeAbsolutePath(asset)
                if not _is_inside(target, folder):
                    raise FormatError(
                        f"expected layers in the folder of the file, got {asset}", path, name
                    )
                pending.append(target)
        stage = Usd.Stage.Open(str(path))
    if stage is None:
        raise FormatError("expected a USD file", path)
    return stage


def _is_inside(target: str, folder: Path) -> bool:
    """Return whether a layer lies in a folder, or in a package such as ``a.usdz[b.usd]`` in it."""
    return Path(target.partition("[")[0]).resolve().is_relative_to(folder)


def _prims(stage: Any, kind: str) -> list[Any]:  # noqa: ANN401
    """Return the prims of the type `kind`, in the order of the stage, instances included."""
    from pxr import Usd

    rule = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
    return [prim for prim in stage.Traverse(rule) if prim.GetTypeName() == kind]


def _read_figure(path: Path, prim: Any) -> _Figure:  # noqa: ANN401
    """Read the joints and the rest pose of a skeleton."""
    from pxr import Usd, UsdGeom, UsdSkel

    skeleton = UsdSkel.Skeleton(prim)
    place = str(prim.GetPath())
    joints = tuple(map(str, skeleton.GetJointsAttr().Get() or ()))
    if not joints:
        raise FormatError("expected joints, got none", path, place)
    with errors_of_file(path, place):
        limits.check_joints(len(joints))
    repeated = [joint for joint, count in Counter(joints).items() if count > 1]
    if repeated:
        raise FormatError(
            f"expected different joints, got {repeated[0]} more than once", path, place
        )
    topology = UsdSkel.Topology(joints)
    valid, reason = topology.Validate()
    if not valid:
        raise FormatError(f"expected parents before children: {reason}", path, place)
    parents = np.array([0, *(topology.GetParent(joint) + 1 for joint in range(len(joints)))])
    parents[0] = -1
    given = tuple(map(str, skeleton.GetJointNamesAttr().Get() or ()))
    names = given if len(given) == len(joints) else tuple(j.rpartition("/")[2] for j in joints)
    with errors_of_file(path, place):
        limits.check_hierarchy(names, (parents[1:] - 1).tolist())
    transforms = skeleton.GetRestTransformsAttr().Get()
    if not transforms or len(transforms) != len(joints):
        transforms = _bind_pose(skeleton, topology)
    if transforms is None:
        raise FormatError("expected restTransforms or bindTransforms of all joints", path, place)
    world = UsdGeom.XformCache(Usd.TimeCode.Default()).GetLocalToWorldTransform(prim)
    return _Figure(
        path,
        prim,
        joints,
        (prim.GetName(), *names),
        parents,
        _to_transforms(path, place, [world, *transforms]),
    )


def _bind_pose(skeleton: Any, topology: Any) -> list[Any] | None:  # noqa: ANN401
    """Return local matrices of the bind pose, or None if the skeleton has no bind pose."""
    bind = skeleton.GetBindTransformsAttr().Get()
    if not bind or len(bind) != topology.GetNumJoints():
        return None
    parents = [topology.GetParent(joint) for joint in range(len(bind))]
    return [
        matrix if parent < 0 else matrix * bind[parent].GetInverse()
        for matrix, parent in zip(bind, parents, strict=True)
    ]


def _to_transforms(path: Path, place: str, matrices: Sequence[Any]) -> Transforms:
    """Return USD matrices as transforms of one frame. The matrices act on row vectors."""
    values = np.array([np.array(matrix).T for matrix in matrices], np.float64)
    if not np.isfinite(values).all():
        raise FormatError("expected finite matrices", path, place)
    parts = np.array([decompose(matrix) for matrix in values])
    return Transforms(parts[None, :, :3], parts[None, :, 3:7], parts[None, :, 7:])


def _find_figure(path: Path, animation: Any, figures: Sequence[_Figure]) -> _Figure:  # noqa: ANN401
    """Return the figure to which an animation is bound, or the first one with all of its joints.

    Raises `FormatError` if there is neither.
    """
    from pxr import UsdSkel

    for figure in figures:
        bound = UsdSkel.BindingAPI(figure.prim).GetInheritedAnimationSource()
        if bound and bound.GetPath() == animation.GetPath():
            return figure
    joints = {*map(str, UsdSkel.Animation(animation).GetJointsAttr().Get() or ())}
    for figure in figures:
        if joints <= {*figure.joints}:
            return figure
    raise FormatError(
        "expected a Skeleton with the joints of the animation, got none",
        path,
        str(animation.GetPath()),
    )


def _sample(stage: Any, prim: Any, figure: _Figure, rate: float | None) -> Motion:  # noqa: ANN401
    """Return the motion of an animation, sampled from its first to its last key."""
    from pxr import UsdSkel

    animation = UsdSkel.Animation(prim)
    place = str(prim.GetPath())
    attributes = {name: prim.GetAttribute(name) for name in _CHANNELS}
    keys = np.unique([t for attribute in attributes.values() for t in attribute.GetTimeSamples()])
    codes_per_second = float(stage.GetTimeCodesPerSecond())
    if not codes_per_second > 0:
        text = f"expected timeCodesPerSecond above 0, got {codes_per_second:g}"
        raise FormatError(text, figure.path)
    if not np.isfinite(keys).all():
        raise FormatError(
            f"expected finite times of keys, got {keys[~np.isfinite(keys)][0]:g}",
            figure.path,
            place,
        )
    with errors_of_file(figure.path, place):
        codes, frame_time = _choose_times(keys, codes_per_second, rate)
        limits.check_frame_time(frame_time)
        _check_poses(stage, len(codes) * len(figure.parents))
    joints = list(map(str, animation.GetJointsAttr().Get() or ()))
    node_of = {joint: node for node, joint in enumerate(figure.joints, 1)}
    nodes = [node_of[joint] for joint in joints if joint in node_of]
    rows = [row for row, joint in enumerate(joints) if joint in node_of]
    local = figure.rest.of(np.arange(len(figure.parents)), len(codes))
    for frame, code in enumerate(codes):
        for name, attribute in attributes.items():
            values = attribute.Get(code)
            if values is None:
                continue
            array = np.array(values, np.float64)
            if len(array) != len(joints) or not np.isfinite(array).all():
                raise FormatError(
                    f"expected {len(joints)} finite values at time code {code:g}",
                    figure.path,
                    f"{place}.{name}",
                )
            getattr(local, name)[frame, nodes] = array[rows]
    _move_figure(figure, local, codes)
    turned, positions = to_world(figure.parents, _normalise(figure, local, place))
    first = figure.first
    return rebase(figure.rest_pose(), turned[:, first:], positions[:, first:], frame_time)


def _choose_times(
    keys: FloatArray, codes_per_second: float, rate: float | None
) -> tuple[FloatArray, float]:
    """Return the time codes of the frames, and the seconds per frame.

    The frames divide the duration exactly; their rate is as near as possible to `rate`. By default
    this is the rate of the keys if they are uniform and at most one time code apart; otherwise the
    rate of the time codes if keys are whole time codes apart; otherwise 30 fps. An animation
    without keys has one frame. Raises ValueError if there are too many frames.
    """
    if len(keys) < 2:
        return keys if len(keys) else np.zeros(1), 1.0 / (rate or codes_per_second)
    steps = np.diff(keys)
    if rate is None:
        rate = DEFAULT_RATE
        if np.ptp(steps) <= _GRID_TOLERANCE * steps[0] and steps[0] <= 1.0:
            rate = codes_per_second / float(steps[0])
        elif np.abs(steps - np.round(steps)).max() <= _GRID_TOLERANCE:
            rate = codes_per_second
    duration = float(keys[-1] - keys[0]) / codes_per_second
    if duration * rate > max(_MIN_FRAME_LIMIT, _FRAMES_PER_KEY * len(keys)):
        raise ValueError(
            f"a duration of {duration:.6g} s at {rate:.6g} frames per second is too long for "
            f"{len(keys)} keys; choose a lower rate"
        )
    count = max(round(duration * rate), 1) + 1
    limits.check_frames(count)
    return np.linspace(keys[0], keys[-1], count), duration / (count - 1)


def _check_poses(stage: Any, n_poses: int) -> None:  # noqa: ANN401
    """Raise ValueError if a motion has more joint poses than the limit for the files of a stage."""
    paths = [layer.realPath for layer in stage.GetUsedLayers()]
    n_bytes = sum(os.path.getsize(path) for path in paths if os.path.isfile(path))
    limit = max(_MIN_POSE_LIMIT, _POSES_PER_BYTE * n_bytes)
    if n_poses > limit:
        raise ValueError(
            f"expected at most {limit} poses of joints in files of this size, got {n_poses}"
        )


def _move_figure(figure: _Figure, local: Transforms, codes: FloatArray) -> None:
    """Set the transforms of node 0 in `local` to the world transforms of the skeleton's prim."""
    from pxr import Usd, UsdGeom

    prim, is_moving = figure.prim, False
    while prim:
        is_moving |= UsdGeom.Xformable(prim).TransformMightBeTimeVarying()
        prim = prim.GetParent()
    for frame, code in enumerate(codes if is_moving else ()):
        cache = UsdGeom.XformCache(Usd.TimeCode(code))
        world = _to_transforms(figure.path, "", [cache.GetLocalToWorldTransform(figure.prim)])
        for name in _CHANNELS:
            getattr(local, name)[frame, 0] = getattr(world, name)[0, 0]


def _normalise(figure: _Figure, local: Transforms, place: str) -> Transforms:
    """Return transforms with rotations of unit norm."""
    norms = np.linalg.norm(local.rotations, axis=-1, keepdims=True)
    if (norms < 1e-6).any():
        raise FormatError("expected unit quaternions, got zero", figure.path, f"{place}.rotations")
    return Transforms(local.translations, local.rotations / norms, local.scales)


def _notes(stage: Any) -> tuple[str, ...]:  # noqa: ANN401
    """Return notes of units and axes, and of prims that are not part of the motions."""
    from pxr import UsdGeom

    types = Counter(str(prim.GetTypeName()) for prim in stage.Traverse())
    for name in ("", "Skeleton", "SkelAnimation", "SkelRoot", "Xform", "Scope"):
        types.pop(name, None)
    units = UsdGeom.GetStageMetersPerUnit(stage)
    notes = [f"unit: {units:g} m, {UsdGeom.GetStageUpAxis(stage)} up"]
    if types:
        listed = ", ".join(f"{count} {name}" for name, count in sorted(types.items()))
        notes.append(f"prims that are not joints: {listed}")
    return tuple(notes)
