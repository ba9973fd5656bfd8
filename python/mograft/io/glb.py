"""GLB: the binary form of glTF 2.0, which browsers, Blender, Unreal and Unity read."""

import json
import os
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.arrays import FloatArray, IntArray
from mograft._util.atomic import write_bytes
from mograft.body.groups import JointGroups
from mograft.body.mass import up_axis
from mograft.io.figure import PALETTE, bones, members, scale_of, to_y_up
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

__all__ = ["write_glb"]

_FLOAT, _BYTE, _SHORT = 5126, 5121, 5123
_VERTICES = 34962


def write_glb(
    motions: Motion | Sequence[Motion],
    path: str | os.PathLike[str],
    *,
    scale: float | None = None,
    groups: JointGroups | str | None = None,
) -> float:
    """Write motions of one skeleton as a skinned, animated figure.

    Parameters
    ----------
    motions : Motion or sequence of Motion
        The motions, each an animation of the motion's name. Those after the first may differ
        in offsets and frame rate.
    path : str or path
        The file to write.
    scale : float, optional
        Metres in a unit of the motion's lengths. Default: as `unit_of` guesses.
    groups : JointGroups or str, optional
        Joint groups that the bones are coloured by, or the name of a preset. Default: trunk,
        arms and legs.

    Returns
    -------
    float
        The scale that was used; the file tells it too, in ``asset.extras``.

    Raises
    ------
    SkeletonMismatchError
        If the hierarchies differ.
    ValueError
        If there is no motion, the scale is not above 0, or the groups do not fit.

    Notes
    -----
    As glTF wants it: metres, y up, the rest pose with all rotations zero. What is up in the
    motion is turned to y by the root alone, so that the other joints keep their rotations.
    Each bone is a slim octahedron bound to its joint; engines import no skeleton without a
    mesh. Keys are those of the frames, with spherical linear interpolation between.

    Examples
    --------
    >>> import tempfile
    >>> from mograft.dancer import dance
    >>> target = Path(tempfile.mkdtemp()) / "dance.glb"
    >>> write_glb(dance(strides=1).motion[:30], target)  # metres in a unit: it is in cm
    0.01
    """
    several = [motions] if isinstance(motions, Motion) else list(motions)
    if not several:
        raise ValueError("motions must hold at least one, got none")
    first = several[0]
    for motion in several[1:]:
        first.skeleton.check_same_hierarchy(motion.skeleton, motion.name or "a motion")
    scale, unit = scale_of(first.skeleton, scale)
    file = _File()
    group = members(first.skeleton, groups)
    document = _document(file, several, scale, to_y_up(first), group)
    document["asset"]["extras"] = {
        "metres_in_a_unit": scale,
        "unit": unit,
        "up_in_the_motion": "xyz"[up_axis(first)],
    }
    write_bytes(Path(path), file.packed(document))
    return scale


@dataclass
class _File:
    """The buffer of a GLB while it is filled, and what points into it."""

    data: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)

    def add(
        self,
        array: npt.NDArray[Any],
        kind: str,
        *,
        component: int = _FLOAT,
        bounds: bool = False,
        vertices: bool = False,
    ) -> int:
        """Append an array; return the index of its accessor."""
        array = np.ascontiguousarray(array)
        view: dict[str, Any] = {
            "buffer": 0,
            "byteOffset": len(self.data),
            "byteLength": array.nbytes,
        }
        if vertices:
            view["target"] = _VERTICES
        accessor = {
            "bufferView": len(self.views),
            "componentType": component,
            "count": len(array),
            "type": kind,
        }
        if bounds:
            rows = array.reshape(len(array), -1)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        # Every row is of whole words, so that each array begins at one, as it must.
        self.data += array.tobytes()
        self.views.append(view)
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def packed(self, document: dict[str, Any]) -> bytes:
        """Return the whole file."""
        document = document | {
            "buffers": [{"byteLength": len(self.data)}],
            "bufferViews": self.views,
            "accessors": self.accessors,
        }
        text = json.dumps(document, separators=(",", ":"), ensure_ascii=False)
        head = text.encode("utf-8", "replace")
        head += b" " * (-len(head) % 4)
        return b"".join(
            [
                struct.pack("<4sII", b"glTF", 2, 28 + len(head) + len(self.data)),
                struct.pack("<I4s", len(head), b"JSON"),
                head,
                struct.pack("<I4s", len(self.data), b"BIN\0"),
                bytes(self.data),
            ]
        )


def _document(
    file: _File, motions: Sequence[Motion], scale: float, turn: FloatArray, group: IntArray
) -> dict[str, Any]:
    skeleton = motions[0].skeleton
    rest = scale * rotations.rotate(turn, skeleton.rest_positions())
    nodes: list[dict[str, Any]] = []
    for joint, name in enumerate(skeleton.names):
        place = scale * skeleton.offsets[joint]
        node: dict[str, Any] = {"name": name, "translation": place.tolist()}
        if joint == 0:
            node["translation"] = rest[0].tolist()
            node["rotation"] = turn.tolist()
        if skeleton.children[joint]:
            node["children"] = list(skeleton.children[joint])
        nodes.append(node)
    nodes.append({"name": "bones", "mesh": 0, "skin": 0})
    # A joint's own axes at rest are those of the turned root.
    inverse = np.zeros((skeleton.n_joints, 4, 4))
    inverse[:, :3, :3] = rotations.rotate(rotations.inverse(turn), np.eye(3)).T
    inverse[:, :3, 3] = -rotations.rotate(rotations.inverse(turn), rest)
    inverse[:, 3, 3] = 1.0
    columns = inverse.transpose(0, 2, 1).astype("<f4")
    return {
        "asset": {"version": "2.0", "generator": f"mograft {VERSION}"},
        "scene": 0,
        "scenes": [{"nodes": [0, skeleton.n_joints]}],
        "nodes": nodes,
        "meshes": [{"name": "bones", "primitives": [_mesh(file, skeleton, scale, turn, group)]}],
        "materials": [
            {
                "name": "bones",
                "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.8},
            }
        ],
        "skins": [
            {
                "joints": list(range(skeleton.n_joints)),
                "skeleton": 0,
                "inverseBindMatrices": file.add(columns, "MAT4"),
            }
        ],
        "animations": [
            _animation(file, motion, scale, turn, scale * skeleton.offsets) for motion in motions
        ],
    }


def _animation(
    file: _File, motion: Motion, scale: float, turn: FloatArray, offsets: FloatArray
) -> dict[str, Any]:
    """Return a motion as keys for nodes that rest at `offsets`, shape (n_joints, 3)."""
    skeleton = motion.skeleton
    times = (np.arange(motion.n_frames) * motion.frame_time).astype("<f4")
    # Accessors that nothing refers to are frowned upon: each is added when it is needed.
    inputs: dict[int, int] = {}
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    for joint in range(skeleton.n_joints):
        quats = motion.rotations[:, joint]
        places = scale * motion.positions[:, joint]
        if joint == 0:
            quats = rotations.multiply(np.broadcast_to(turn, quats.shape), quats)
            places = rotations.rotate(turn, places)
        tracks: list[tuple[str, str, FloatArray]] = []
        tracks.append(("rotation", "VEC4", rotations.continuous_signs(quats[:, None])[:, 0]))
        if joint == 0 or (places != offsets[joint]).any():
            tracks.append(("translation", "VEC3", places))
        for target, kind, values in tracks:
            keys = values if np.ptp(values, axis=0).any() else values[:1]
            if len(keys) not in inputs:
                inputs[len(keys)] = file.add(times[: len(keys)], "SCALAR", bounds=True)
            output = file.add(keys.astype("<f4"), kind)
            samplers.append({"input": inputs[len(keys)], "output": output})
            where = {"node": joint, "path": target}
            channels.append({"sampler": len(samplers) - 1, "target": where})
    return {"name": motion.name or "motion", "samplers": samplers, "channels": channels}


def _mesh(
    file: _File, skeleton: Skeleton, scale: float, turn: FloatArray, group: IntArray
) -> dict[str, Any]:
    places, normals, owner = bones(skeleton, scale, turn)
    colours = np.array([[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in PALETTE])
    few = skeleton.n_joints <= 256
    joints = np.zeros((len(owner), 4), "u1" if few else "<u2")
    joints[:, 0] = owner
    weights = np.zeros((len(owner), 4), "<f4")
    weights[:, 0] = 1.0
    linear = colours[group[owner] % len(colours)] ** 2.2
    return {
        "attributes": {
            "POSITION": file.add(places.astype("<f4"), "VEC3", bounds=True, vertices=True),
            "NORMAL": file.add(normals.astype("<f4"), "VEC3", vertices=True),
            "COLOR_0": file.add(linear.astype("<f4"), "VEC3", vertices=True),
            "JOINTS_0": file.add(joints, "VEC4", component=_BYTE if few else _SHORT, vertices=True),
            "WEIGHTS_0": file.add(weights, "VEC4", vertices=True),
        },
        "material": 0,
    }
