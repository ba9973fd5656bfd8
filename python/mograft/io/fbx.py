"""FBX: takes of binary and text files, read by the extension ``mograft-fbx``."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft._util.names import unique_names
from mograft.errors import FormatError, join_names
from mograft.io.clips import ClipLength, Clips
from mograft.io.named_errors import errors_of_file
from mograft.io.rest_pose import RestPose, rebase
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


@dataclass(frozen=True, eq=False)
class _Nodes:
    """The nodes of a file in preorder; node 0 is the root of the scene."""

    names: tuple[str, ...]
    parents: IntArray
    kinds: tuple[str, ...]  # "bone", "mesh", "camera", "light" or "node"
    is_animated: IntArray  # 1 at nodes that have keys in any take, else 0

    def joints(self) -> IntArray:
        """Return the indices of the joints.

        These are the bones, their lowest common ancestor, and the nodes between them. The extension
        counts nodes to which a skin is bound as bones. In a file without bones, animated nodes take
        their place. The result is empty if there are none, too.
        """
        is_joint = np.array([kind == "bone" for kind in self.kinds], bool)
        is_joint = is_joint if is_joint.any() else self.is_animated.astype(bool)
        n_below = is_joint.astype(np.int64)
        for node in range(len(n_below) - 1, 0, -1):
            n_below[self.parents[node]] += n_below[node]
        # The common ancestor is the last node in preorder that has all of them at or below it.
        complete = np.flatnonzero(n_below == n_below[0])
        top = int(complete[-1]) if n_below[0] else len(n_below)
        indices = np.flatnonzero(n_below)
        return indices[indices >= top]

    def depth(self, node: int) -> int:
        """Return the number of nodes above a node."""
        depth = 0
        while (node := int(self.parents[node])) >= 0:
            depth += 1
        return depth


@dataclass(frozen=True, eq=False)
class _Take:
    """A take of a file: an animation that is read as a clip."""

    name: str  # in the file
    clip: str  # name of the clip
    begin: float  # time of the first frame in seconds
    length: ClipLength


@dataclass(frozen=True, eq=False)
class _FbxFile:
    """An open file with its joints and takes."""

    path: Path
    scene: Any  # a `Scene` of the extension, which is not typed
    joints: IntArray  # index of the node of each joint
    rest: RestPose
    takes: tuple[_Take, ...]
    max_frames: int  # limit of the frames of a take

    def load(self, index: int) -> Motion:
        """Return the motion of a take."""
        take = self.takes[index]
        place, n_frames = f"take {take.name!r}", take.length.n_frames
        if n_frames > self.max_frames:
            message = (
                f"expected at most {self.max_frames} frames in a file of this size, got {n_frames}"
            )
            raise FormatError(message, self.path, place)
        with errors_of_file(self.path, place):
            limits.check_frames(n_frames)
            limits.check_frame_time(take.length.frame_time)
        rotations, positions = self.scene.bake(
            index, self.joints.tolist(), begin=take.begin, rate=take.length.rate, n_frames=n_frames
        )
        self._check_finite(rotations, positions, place)
        motion = rebase(self.rest, rotations, positions, take.length.frame_time)
        return replace(motion, name=take.clip)

    def _check_finite(self, rotations: FloatArray, positions: FloatArray, place: str) -> None:
        if not (np.isfinite(rotations).all() and np.isfinite(positions).all()):
            is_finite = np.isfinite(rotations).all(axis=2) & np.isfinite(positions).all(axis=2)
            frame, joint = np.argwhere(~is_finite)[0]
            raise FormatError(
                f"expected finite transforms, got NaN or infinity at {self.rest.names[joint]} in "
                f"frame {frame}",
                self.path,
                place,
            )


def open_fbx(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:  # noqa: ARG001
    """Return the takes of an FBX file as clips; see `mograft.io.formats.Opener`.

    World positions are in the unit of the file, right-handed with y up. Raises ModuleNotFoundError
    if the extension is not installed.
    """
    data = path.read_bytes()
    scene = _load_scene(path, data)
    *_, unit_metres, axes, file_rate = scene.settings
    if rate is None:
        if not file_rate > 0:
            raise FormatError(
                f"expected a frame rate above 0, got {file_rate:g}", path, "GlobalSettings"
            )
        with errors_of_file(path, "GlobalSettings"):
            limits.check_frame_time(1.0 / file_rate)
    scene_takes = scene.takes
    is_animated = np.zeros(len(scene.kinds), np.int64)
    for _, _, _, animated in scene_takes:
        is_animated[animated] = 1
    nodes = _Nodes(tuple(scene.names), scene.parents, tuple(scene.kinds), is_animated)
    joints = nodes.joints()
    notes = _describe(nodes, joints, unit_metres, axes, scene.n_constraints)
    if not len(joints):
        return Clips.without_motions(path, "FBX", notes)
    with errors_of_file(path):
        limits.check_joints(len(joints))
    names = _clip_names(path, [name for name, _, _, _ in scene_takes])
    takes = tuple(
        _define_take((name, clip), span, key_span, rate or file_rate)
        for clip, (name, span, key_span, _) in zip(names, scene_takes, strict=True)
    )
    max_poses = max(_MIN_POSES, _POSES_PER_BYTE * len(data))
    rest = _rest_pose(path, scene, nodes, joints)
    # The nodes above the joints are evaluated, too.
    n_evaluated = len(joints) + nodes.depth(int(joints[0]))
    file = _FbxFile(path, scene, joints, rest, takes, max_poses // n_evaluated)
    return Clips(path, names, file.load, "FBX", notes, tuple(take.length for take in takes))


def _load_scene(path: Path, data: bytes) -> Any:  # noqa: ANN401 - an object of the extension
    """Parse a file with the extension."""
    try:
        import mograft_fbx
    except ImportError as error:
        raise ModuleNotFoundError(
            "FBX needs mograft-fbx: pip install 'mograft[fbx]', or pip install ./python-fbx in the "
            "repository of mograft",
            name="mograft_fbx",
        ) from error
    try:
        scene = mograft_fbx.Scene(data, _MEMORY_BYTES + _MEMORY_FACTOR * len(data))
    except ValueError as error:
        raise FormatError(
            f"expected an FBX file, got one that the library ufbx cannot read: {error}", path
        ) from error
    version = scene.settings[0]
    if version not in VERSIONS:
        supported = f"{VERSIONS.start} to {VERSIONS.stop - 1}"
        raise FormatError(f"expected FBX version {supported}, got {version}", path, "header")
    return scene


def _define_take(
    names: tuple[str, str],
    span: tuple[float, float],
    key_span: tuple[float, float] | None,
    rate: float,
) -> _Take:
    """Return a take whose frames divide its time span into equal intervals.

    `names` are those of the take and of its clip. `span` is the time span of the take in seconds,
    first and last; if it is empty, `key_span`, the span of the keys, is used. The frame rate is
    `rate` or, if the duration is not a multiple of 1 / `rate`, the nearest rate that divides it. A
    deviation below `_ROUNDING_INTERVALS` counts as rounding.
    """
    begin, end = span if span[1] > span[0] else key_span or (span[0], span[0])
    duration = max(end - begin, 0.0)
    n_intervals = round(duration * rate)
    frame_time = 1.0 / rate
    if abs(n_intervals - duration * rate) > _ROUNDING_INTERVALS:
        n_intervals = max(n_intervals, 1)
        frame_time = duration / n_intervals
    return _Take(*names, begin, ClipLength(n_intervals + 1, frame_time))


def _rest_pose(path: Path, scene: Any, nodes: _Nodes, joints: IntArray) -> RestPose:  # noqa: ANN401
    """Return the rest pose of the joints; the topmost joint is the root."""
    rotations, positions = scene.rest_pose()
    if not (np.isfinite(rotations[joints]).all() and np.isfinite(positions[joints]).all()):
        raise FormatError("expected a finite rest pose, got NaN or infinity", path)
    index_of = np.full(len(nodes.names), -1)
    index_of[joints] = np.arange(len(joints))
    parents = index_of[nodes.parents[joints]]
    parents[0] = -1
    names = tuple(_joint_name(nodes.names[node], node) for node in joints)
    with errors_of_file(path):
        limits.check_hierarchy(names, parents.tolist())
    return RestPose(names, parents, rotations[joints], positions[joints])


def _joint_name(name: str, node: int) -> str:
    """Return the name of a node with ``_`` in place of unprintable characters.

    A node without a name is called ``node`` with its index, the root of the scene ``scene``.
    """
    printable = "".join(character if character.isprintable() else "_" for character in name)
    return printable.strip() or ("scene" if node == 0 else f"node{node}")


def _clip_names(path: Path, takes: list[str]) -> tuple[str, ...]:
    """Return a unique clip name for each of the names of takes.

    The clip of a single take has the name of the file, because programs give such takes names
    without meaning. Otherwise a clip has the name of its take. A take without a name gets a number
    as name, and repeated names get a number appended.
    """
    if len(takes) == 1:
        return (path.stem,)
    return tuple(unique_names([name or f"take{i}" for i, name in enumerate(takes, 1)]))


def _describe(
    nodes: _Nodes, joints: IntArray, unit_metres: float, axes: str, n_constraints: int
) -> tuple[str, ...]:
    """Return the notes: unit, axes, and the content that is not part of the motions."""
    notes = [f"lengths are in units of {unit_metres:g} m"]
    if axes != _AXES:
        notes.append(f"axes (right, up, front) were converted from {axes} to {_AXES}")
    others = sorted(set(range(1, len(nodes.names))) - set(joints.tolist()))
    if others:
        listed = [f"{nodes.kinds[node]} {nodes.names[node]}" for node in others]
        notes.append(f"nodes that are not joints: {join_names(listed)}")
    if n_constraints:
        notes.append(f"{n_constraints} constraints are not evaluated")
    if not len(joints):
        notes.append("there are no bones and no animated nodes, so that there are no clips")
    return tuple(notes)
