"""FBX: takes of binary and text files, read by the extension ``mograft-fbx``."""

from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.arrays import IntArray
from mograft._util.extras import import_extra
from mograft._util.names import unique_names
from mograft.errors import FormatError, join_names
from mograft.io.clips import Clips, errors_of_file
from mograft.io.rest_pose import RestPose, find_joints, rebase
from mograft.motion import limits
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

VERSIONS = range(6100, 7701)
"""Versions of FBX that are read."""

_AXES = "+X +Y +Z"
"""Axes to the right, up and to the front, to which the extension converts."""

_MEMORY_BYTES, _MEMORY_FACTOR = 1 << 28, 32
"""Limit of the memory for a file: a constant, and bytes per byte of the file."""

_MIN_POSES, _POSES_PER_BYTE = 1 << 22, 4
"""Limit of the joint poses of a take: at least the constant, else joint poses per byte."""

_ROUNDING_INTERVALS = 1e-4
"""Deviation of a duration from whole frame intervals that counts as rounding."""


def open_fbx(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:  # noqa: ARG001
    """Return the takes of an FBX file as clips; see `mograft.io.formats.Opener`.

    Joints are the bones, their lowest common ancestor, and the nodes between them. The extension
    counts nodes to which a skin is bound as bones. In a file without bones, animated nodes take
    their place. The clip of a single take has the name of the file, because programs give such
    takes names without meaning. World positions are in the unit of the file, right-handed with y
    up. Raises ModuleNotFoundError if the extension is not installed.
    """
    data = path.read_bytes()
    scene = load_scene(path, data)
    file_rate = scene.settings[-1]
    if rate is None:
        with errors_of_file(path, "GlobalSettings"):
            if not file_rate > 0:
                raise ValueError(f"expected a frame rate above 0, got {file_rate:g}")
            limits.check_frame_time(1.0 / file_rate)
    takes, parents = scene.takes, scene.parents.tolist()
    joints = figure_joints(scene)
    notes = _describe(scene, joints)
    if not len(joints):
        return Clips(path, (), tuple[Motion, ...]().__getitem__, "FBX", notes)
    names = unique_names([name or f"take{i}" for i, (name, *_) in enumerate(takes, 1)])
    names = [path.stem] if len(names) == 1 else names
    spans = [_frame_span(span, key_span, rate or file_rate) for _, span, key_span, _ in takes]
    n_evaluated, node = len(joints), int(joints[0])  # the nodes above the joints are evaluated, too
    while (node := parents[node]) >= 0:
        n_evaluated += 1
    max_frames = max(_MIN_POSES, _POSES_PER_BYTE * len(data)) // n_evaluated
    rest = read_rest_pose(path, scene, joints)

    def load(take: int) -> Motion:
        begin, n_frames, frame_time = spans[take]
        place = f"take {takes[take][0]!r}"
        with errors_of_file(path, place):
            if n_frames > max_frames:
                limit = f"at most {max_frames} frames in a file of this size"
                raise ValueError(f"expected {limit}, got {n_frames}")
            limits.check_frames(n_frames)
            limits.check_frame_time(frame_time)
            times = {"begin": begin, "rate": 1.0 / frame_time, "n_frames": n_frames}
            quats, positions = scene.bake(take, joints.tolist(), **times)
            is_finite = np.isfinite(quats).all(axis=2) & np.isfinite(positions).all(axis=2)
            if not is_finite.all():
                frame, joint = np.argwhere(~is_finite)[0]
                owner = f"{rest.names[joint]} in frame {frame}"
                raise ValueError(f"expected finite transforms, got NaN or infinity at {owner}")
            return rebase(rest, (quats, positions), frame_time, name=names[take])

    return Clips(path, tuple(names), load, "FBX", notes, lambda take: spans[take][1])


def figure_joints(scene: Any) -> IntArray:  # noqa: ANN401 - an object of the extension
    """Return the indices of the joints among the nodes; see `open_fbx`."""
    is_member = np.array([kind == "bone" for kind in scene.kinds], bool)
    if not is_member.any():
        for *_, animated in scene.takes:
            is_member[animated] = True
    return find_joints(scene.parents.tolist(), is_member)


def load_scene(path: Path, data: bytes, **options: bool) -> Any:  # noqa: ANN401
    """Parse a file with the extension; `options` may have ``with_geometry``."""
    need = "FBX needs mograft-fbx (./python-fbx in the repository of mograft)"
    mograft_fbx = import_extra("mograft_fbx", need, "fbx")
    try:
        scene = mograft_fbx.Scene(data, _MEMORY_BYTES + _MEMORY_FACTOR * len(data), **options)
    except ValueError as error:
        message = f"expected an FBX file, got one that the library ufbx cannot read: {error}"
        raise FormatError(message, path) from error
    version = scene.settings[0]
    if version not in VERSIONS:
        supported = f"{VERSIONS.start} to {VERSIONS.stop - 1}"
        raise FormatError(f"expected FBX version {supported}, got {version}", path, "header")
    return scene


def _frame_span(
    span: tuple[float, float], key_span: tuple[float, float] | None, rate: float
) -> tuple[float, int, float]:
    """Return the time of the first frame of a take, the number of frames, and the frame time.

    `span` is the time span of the take in seconds, first and last; if it is empty, `key_span`, the
    span of the keys, is used. The frames divide it into equal intervals. The frame rate is `rate`
    or, if the duration is not a multiple of 1 / `rate`, the nearest rate that divides it. A
    deviation below `_ROUNDING_INTERVALS` counts as rounding.
    """
    begin, end = span if span[1] > span[0] else key_span or (span[0], span[0])
    duration = max(end - begin, 0.0)
    n_intervals = round(duration * rate)
    frame_time = 1.0 / rate
    if abs(n_intervals - duration * rate) > _ROUNDING_INTERVALS:
        n_intervals = max(n_intervals, 1)
        frame_time = duration / n_intervals
    return begin, n_intervals + 1, frame_time


def read_rest_pose(path: Path, scene: Any, joints: IntArray) -> RestPose:  # noqa: ANN401
    """Return the rest pose of the joints; the topmost joint is the root."""
    quats, positions = (array[joints] for array in scene.rest_pose())
    if not (np.isfinite(quats).all() and np.isfinite(positions).all()):
        raise FormatError("expected a finite rest pose, got NaN or infinity", path)
    parents = np.searchsorted(joints, scene.parents[joints])
    parents[0] = -1
    node_names = scene.names
    names = tuple(_joint_name(node_names[node], node) for node in joints)
    with errors_of_file(path):
        limits.check_hierarchy(names, parents.tolist())
    return RestPose(names, parents, quats, positions)


def _joint_name(name: str, node: int) -> str:
    """Return the name of a node with ``_`` in place of unprintable characters.

    A node without a name is called ``node`` with its index, the root of the scene ``scene``.
    """
    printable = "".join(character if character.isprintable() else "_" for character in name)
    return printable.strip() or ("scene" if node == 0 else f"node{node}")


def _describe(scene: Any, joints: IntArray) -> tuple[str, ...]:  # noqa: ANN401
    """Return the notes: unit, axes, and the content that is not part of the motions."""
    *_, unit_metres, axes, _ = scene.settings
    notes = [f"lengths are in units of {unit_metres:g} m"]
    if axes != _AXES:
        notes.append(f"axes (right, up, front) were converted from {axes} to {_AXES}")
    nodes = [f"{kind} {name}" for kind, name in zip(scene.kinds, scene.names, strict=True)]
    others = sorted(set(range(1, len(nodes))) - set(joints.tolist()))
    if others:
        notes.append(f"nodes that are not joints: {join_names([nodes[node] for node in others])}")
    if scene.n_constraints:
        notes.append(f"{scene.n_constraints} constraints are not evaluated")
    if not len(joints):
        notes.append("there are no bones and no animated nodes, so that there are no clips")
    return tuple(notes)
