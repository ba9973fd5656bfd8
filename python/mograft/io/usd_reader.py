"""Read the motions of USD files: the animations of UsdSkel skeletons.

The import of this module raises ModuleNotFoundError if usd-core is not installed.
"""

import os
import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.extras import import_extra
from mograft._util.names import unique_names
from mograft.errors import FormatError
from mograft.io.clips import Clips, errors_of_file
from mograft.io.gltf.animation import DEFAULT_RATE
from mograft.io.gltf.nodes import Transforms, decompose, to_rest_pose, to_transforms, to_world
from mograft.io.rest_pose import rebase
from mograft.io.usd import NEED, usd_reasons
from mograft.motion import limits
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

import_extra("pxr", NEED, "usd")
from pxr import Sdf, Tf, Usd, UsdGeom, UsdSkel, UsdUtils  # noqa: E402 - needs the extra

_GRID_TOLERANCE = 1e-6
"""Deviation of keys from whole time codes that is tolerated, in time codes."""

_MIN_FRAME_LIMIT, _FRAMES_PER_KEY = 1 << 15, 8
_MIN_POSE_LIMIT, _POSES_PER_BYTE = 1 << 21, 8
"""Limits of the frames of a motion, and of the poses of its joints: a constant, or a multiple of
the keys and of the bytes of the layers if that is more. Two keys may claim any duration."""

_MAGIC = b"PXR-USDC"
_HEADER = struct.Struct("<8s8sq64x")  # magic, version, offset of the table of contents
_SECTION = struct.Struct("<16sqq")  # name, first byte, size
_COUNT = struct.Struct("<Q")
_MIN_COUNT_LIMIT, _COUNTS_PER_BYTE = 1 << 16, 256
"""Limits of the elements of a section of a binary file: the first constant, or the second one per
byte of the file if that is more. Elements are compressed by LZ4, whose largest ratio is 255."""

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
        with _usd_errors(path):
            return replace(_sample(stage, *pairs[clip], rate), name=names[clip])

    names = tuple(unique_names([animation.GetName() for animation in animations]))
    return Clips(path, names, load, "USD", notes)


@contextmanager
def _usd_errors(path: Path) -> Iterator[None]:
    """Convert the errors of usd-core, which may occur at any access, to `FormatError`.

    Its warnings are not printed.
    """
    warnings = UsdUtils.CoalescingDiagnosticDelegate()  # receives them while it exists
    try:
        yield
    except FormatError:
        raise
    except (Tf.ErrorException, *_VALUE_ERRORS) as error:
        reason = (usd_reasons(error) or [type(error).__name__])[-1]
        raise FormatError(f"expected a USD file: {reason}", path) from error
    finally:
        del warnings


def _open_stage(path: Path) -> Any:  # noqa: ANN401 - pxr has no types
    """Open a stage; raise `FormatError` if a layer is outside the folder of the file."""
    with _usd_errors(path):
        folder = path.resolve().parent
        pending, known = [str(path)], set()
        while pending:
            name = pending.pop()
            _check_crate(Path(name))
            layer = Sdf.Layer.FindOrOpen(name)
            if layer is None or name in known:
                continue
            known.add(name)
            for asset in layer.GetCompositionAssetDependencies():
                target = layer.ComputeAbsolutePath(asset)
                # A layer may lie in a package, as in "a.usdz[b.usd]".
                if not Path(target.partition("[")[0]).resolve().is_relative_to(folder):
                    message = f"expected layers in the folder of the file, got {asset}"
                    raise FormatError(message, path, name)
                pending.append(target)
        stage = Usd.Stage.Open(str(path))
    if stage is None:
        raise FormatError("expected a USD file", path)
    return stage


def _check_crate(path: Path) -> None:
    """Raise `FormatError` if a binary USD file states sections or elements that it cannot hold.

    usd-core allocates memory for what the file states. Files of other formats are not checked. The
    layout is that of ``pxr/usd/sdf/crateFile.h``: a header of 88 bytes, and sections that begin
    with the number of their elements.
    """
    data = path.read_bytes() if path.is_file() else b""
    size, limit = len(data), max(_MIN_COUNT_LIMIT, _COUNTS_PER_BYTE * len(data))
    if not data.startswith(_MAGIC):
        return

    def check(is_valid: bool, place: str, message: str) -> None:  # noqa: FBT001 - a condition
        if not is_valid:
            raise FormatError(f"expected {message}", path, place)

    def read(start: int, layout: struct.Struct, place: str) -> tuple[Any, ...]:
        message = f"{layout.size} bytes from byte {start} on, got {size} in the file"
        check(0 <= start <= size - layout.size, place, message)
        return layout.unpack_from(data, start)

    *_, contents = read(0, _HEADER, "header")
    (n_sections,) = read(contents, _COUNT, "table of contents")
    most = size // _SECTION.size
    message = f"at most {most} sections in {size} bytes, got {n_sections}"
    check(n_sections <= most, "table of contents", message)
    for section in range(n_sections):
        start = contents + _COUNT.size + section * _SECTION.size
        name, first, length = read(start, _SECTION, f"section {section}")
        place = f"section {name.rstrip(bytes(1)).decode('latin-1')}"
        message = f"an end within {size} bytes, got {length} bytes from byte {first} on"
        check(length >= 0 and first + length <= size, place, message)
        # These sections begin with two counts.
        for number in range(2 if name.startswith((b"TOKENS\0", b"PATHS\0")) else 1):
            (count,) = read(first + number * _COUNT.size, _COUNT, place)
            check(count <= limit, place, f"at most {limit} elements, got {count}")


def _prims(stage: Any, kind: str) -> list[Any]:  # noqa: ANN401
    """Return the prims of the type `kind`, in the order of the stage, instances included."""
    rule = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
    return [prim for prim in stage.Traverse(rule) if prim.GetTypeName() == kind]


def _read_figure(path: Path, prim: Any) -> _Figure:  # noqa: ANN401
    """Read the joints and the rest pose of a skeleton."""
    skeleton = UsdSkel.Skeleton(prim)
    place = str(prim.GetPath())
    joints = tuple(map(str, skeleton.GetJointsAttr().Get() or ()))
    topology = UsdSkel.Topology(joints)
    with errors_of_file(path, place):
        if not joints:
            raise ValueError("expected joints, got none")
        repeated, count = Counter(joints).most_common(1)[0]
        if count > 1:
            raise ValueError(f"expected different joints, got {repeated} more than once")
        valid, reason = topology.Validate()
        if not valid:
            raise ValueError(f"expected parents before children: {reason}")
        parents = np.array([0, *(topology.GetParent(joint) + 1 for joint in range(len(joints)))])
        parents[0] = -1
        given = tuple(map(str, skeleton.GetJointNamesAttr().Get() or ()))
        names = given if len(given) == len(joints) else tuple(j.rpartition("/")[2] for j in joints)
        limits.check_hierarchy(names, (parents[1:] - 1).tolist())
        transforms = skeleton.GetRestTransformsAttr().Get()
        if not transforms or len(transforms) != len(joints):
            transforms = _bind_pose(skeleton, topology)
        world = UsdGeom.XformCache(Usd.TimeCode.Default()).GetLocalToWorldTransform(prim)
        rest = _to_transforms([world, *transforms])
    return _Figure(path, prim, joints, (prim.GetName(), *names), parents, rest)


def _bind_pose(skeleton: Any, topology: Any) -> list[Any]:  # noqa: ANN401
    """Return local matrices of the bind pose; raise ValueError if the skeleton has no bind pose."""
    bind = skeleton.GetBindTransformsAttr().Get()
    if not bind or len(bind) != topology.GetNumJoints():
        raise ValueError("expected restTransforms or bindTransforms of all joints")
    above = [(own, topology.GetParent(joint)) for joint, own in enumerate(bind)]
    return [own if parent < 0 else own * bind[parent].GetInverse() for own, parent in above]


def _to_transforms(matrices: Sequence[Any]) -> Transforms:
    """Return USD matrices as transforms of one frame. The matrices act on row vectors.

    Raises ValueError if one is not finite.
    """
    values = np.array([np.array(matrix).T for matrix in matrices], np.float64)
    if not np.isfinite(values).all():
        raise ValueError("expected finite matrices")
    return to_transforms(np.array([decompose(matrix) for matrix in values]))


def _find_figure(path: Path, animation: Any, figures: Sequence[_Figure]) -> _Figure:  # noqa: ANN401
    """Return the figure to which an animation is bound, or the first one with all of its joints.

    Raises `FormatError` if there is neither.
    """
    for figure in figures:
        bound = UsdSkel.BindingAPI(figure.prim).GetInheritedAnimationSource()
        if bound and bound.GetPath() == animation.GetPath():
            return figure
    joints = {*map(str, UsdSkel.Animation(animation).GetJointsAttr().Get() or ())}
    for figure in figures:
        if joints <= {*figure.joints}:
            return figure
    message = "expected a Skeleton with the joints of the animation, got none"
    raise FormatError(message, path, str(animation.GetPath()))


def _sample(stage: Any, prim: Any, figure: _Figure, rate: float | None) -> Motion:  # noqa: ANN401
    """Return the motion of an animation, sampled from its first to its last key."""
    animation = UsdSkel.Animation(prim)
    attributes = {name: prim.GetAttribute(name) for name in Transforms._fields}
    keys = np.unique([t for attribute in attributes.values() for t in attribute.GetTimeSamples()])
    codes_per_second = float(stage.GetTimeCodesPerSecond())
    with errors_of_file(figure.path, str(prim.GetPath())):
        if not codes_per_second > 0:
            raise ValueError(f"expected timeCodesPerSecond above 0, got {codes_per_second:g}")
        if not np.isfinite(keys).all():
            invalid = keys[~np.isfinite(keys)][0]
            raise ValueError(f"expected finite times of keys, got {invalid:g}")
        codes, frame_time = _choose_times(keys, codes_per_second, rate)
        limits.check_frame_time(frame_time)
        _check_poses(stage, len(codes) * len(figure.parents))
        joints = list(map(str, animation.GetJointsAttr().Get() or ()))
        node_of = {joint: node for node, joint in enumerate(figure.joints, 1)}
        rows = [row for row, joint in enumerate(joints) if joint in node_of]
        nodes = [node_of[joints[row]] for row in rows]
        local = figure.rest.of(np.arange(len(figure.parents)), len(codes))
        for frame, code in enumerate(codes):
            for name, attribute in attributes.items():
                values = attribute.Get(code)
                if values is None:
                    continue
                array = np.array(values, np.float64)
                if len(array) != len(joints) or not np.isfinite(array).all():
                    expected = f"{len(joints)} finite {name}"
                    raise ValueError(f"expected {expected} at time code {code:g}")
                getattr(local, name)[frame, nodes] = array[rows]
        _move_figure(figure, local, codes)
        norms = np.linalg.norm(local.rotations, axis=-1, keepdims=True)
        if (norms < 1e-6).any():
            raise ValueError("expected unit quaternions, got zero")
    local.rotations[...] /= norms
    rest = to_rest_pose(figure.names, figure.parents, figure.rest, figure.first)
    return rebase(rest, to_world(figure.parents, local), frame_time)


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
        given = f"a duration of {duration:.6g} s at {rate:.6g} frames per second"
        raise ValueError(f"{given} is too long for {len(keys)} keys; choose a lower rate")
    count = max(round(duration * rate), 1) + 1
    limits.check_frames(count)
    return np.linspace(keys[0], keys[-1], count), duration / (count - 1)


def _check_poses(stage: Any, n_poses: int) -> None:  # noqa: ANN401
    """Raise ValueError if a motion has more joint poses than the limit for the files of a stage."""
    paths = [layer.realPath for layer in stage.GetUsedLayers()]
    n_bytes = sum(os.path.getsize(path) for path in paths if os.path.isfile(path))
    limit = max(_MIN_POSE_LIMIT, _POSES_PER_BYTE * n_bytes)
    if n_poses > limit:
        expected = f"at most {limit} poses of joints in files of this size"
        raise ValueError(f"expected {expected}, got {n_poses}")


def _move_figure(figure: _Figure, local: Transforms, codes: FloatArray) -> None:
    """Set the transforms of node 0 in `local` to the world transforms of the skeleton's prim."""
    prim, is_moving = figure.prim, False
    while prim:
        is_moving |= UsdGeom.Xformable(prim).TransformMightBeTimeVarying()
        prim = prim.GetParent()
    for frame, code in enumerate(codes if is_moving else ()):
        cache = UsdGeom.XformCache(Usd.TimeCode(code))
        world = _to_transforms([cache.GetLocalToWorldTransform(figure.prim)])
        for values, own in zip(local, world, strict=True):
            values[frame, 0] = own[0, 0]


def _notes(stage: Any) -> tuple[str, ...]:  # noqa: ANN401
    """Return notes of units and axes, and of prims that are not part of the motions."""
    types = Counter(str(prim.GetTypeName()) for prim in stage.Traverse())
    for name in ("", "Skeleton", "SkelAnimation", "SkelRoot", "Xform", "Scope"):
        types.pop(name, None)
    units = UsdGeom.GetStageMetersPerUnit(stage)
    notes = [f"unit: {units:g} m, {UsdGeom.GetStageUpAxis(stage)} up"]
    if types:
        listed = ", ".join(f"{count} {name}" for name, count in sorted(types.items()))
        notes.append(f"prims that are not joints: {listed}")
    return tuple(notes)
