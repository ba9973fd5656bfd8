"""GLB: the binary form of glTF 2.0, for browsers, Blender, Unreal and Unity."""

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
from mograft._util.arrays import FloatArray
from mograft._util.atomic import write_bytes
from mograft.body.groups import JointGroups
from mograft.io.export_figure import BoneMesh, ExportTransform, bone_mesh, check_single_precision
from mograft.motion import rotations
from mograft.motion.motion import Motion, as_motions
from mograft.motion.skeleton import Skeleton

# Constants of the glTF specification: component types by NumPy type, and the target of vertex
# buffers.
_COMPONENT_TYPES = {"f4": 5126, "u1": 5121, "u2": 5123}
_ARRAY_BUFFER = 34962

Json = dict[str, Any]


@dataclass
class GltfBuffer:
    """The binary buffer of a GLB file, and the buffer views and accessors of its arrays.

    The views and accessors may begin with those of a file to which arrays are added.
    """

    data: bytearray = field(default_factory=bytearray)
    views: list[Json] = field(default_factory=list)
    accessors: list[Json] = field(default_factory=list)

    def add(
        self, array: npt.NDArray[Any], *, has_bounds: bool = False, is_vertex_data: bool = False
    ) -> int:
        """Append numbers, (n,), vectors, (n, 2 to 4), or matrices, (n, 4, 4), as an accessor.

        Return its index. `has_bounds` adds the minimum and maximum; `is_vertex_data` marks vertex
        attributes.
        """
        array = np.ascontiguousarray(array)
        kind = ("SCALAR", f"VEC{array.shape[-1]}", "MAT4")[array.ndim - 1]
        view = self.add_bytes(array.tobytes())
        if is_vertex_data:
            self.views[view]["target"] = _ARRAY_BUFFER
        accessor = {
            "bufferView": view,
            "componentType": _COMPONENT_TYPES[array.dtype.str[1:]],
            "count": len(array),
            "type": kind,
        }
        if has_bounds:
            rows = array.reshape(len(array), -1)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def add_keys(
        self, times: FloatArray, values: FloatArray, inputs: dict[int, int], **fields: str
    ) -> Json:
        """Append the keys of a track, in single precision, and return its sampler with `fields`.

        `inputs` has the accessors of the key times of an animation, by number of keys. Each is
        added at its first use, because validators report unused accessors.
        """
        if len(times) not in inputs:
            inputs[len(times)] = self.add(times.astype("<f4"), has_bounds=True)
        output = self.add(values.astype("<f4"))
        return {"input": inputs[len(times)], **fields, "output": output}

    def add_bytes(self, content: bytes | memoryview) -> int:
        """Append bytes and return the index of their buffer view."""
        offset = self.append(content)
        self.views.append({"buffer": 0, "byteOffset": offset, "byteLength": len(content)})
        return len(self.views) - 1

    def append(self, content: bytes | memoryview) -> int:
        """Append bytes at a multiple of 4, as glTF requires, and return their offset."""
        self.data += bytes(-len(self.data) % 4)
        offset = len(self.data)
        self.data += content
        return offset

    def pack(self, document: Json) -> bytes:
        """Return the bytes of the GLB file: header, JSON chunk of `document`, binary chunk.

        ``bufferViews`` and ``accessors`` of the document become those of this buffer. Its first
        entry of ``buffers`` describes the binary chunk: the length is set, and other fields are
        kept, as are the other entries. Raises ValueError if the file would have 4 GiB or more.
        """
        self.data += bytes(-len(self.data) % 4)
        buffers = document.get("buffers") or [{}]
        document = document | {
            "buffers": [{**buffers[0], "byteLength": len(self.data)}, *buffers[1:]],
            "bufferViews": self.views,
            "accessors": self.accessors,
        }
        text = json.dumps(document, separators=(",", ":"), ensure_ascii=False)
        chunk = text.encode("utf-8", "replace")
        chunk += b" " * (-len(chunk) % 4)
        n_bytes = 28 + len(chunk) + len(self.data)
        if n_bytes >= 2**32:
            raise ValueError(f"a GLB file must be smaller than 4 GiB, got {n_bytes} bytes")
        header = struct.pack("<4sIII4s", b"glTF", 2, n_bytes, len(chunk), b"JSON")
        return b"".join([header, chunk, struct.pack("<I4s", len(self.data), b"BIN\0"), self.data])


def write_glb(
    motions: Motion | Sequence[Motion],
    path: str | os.PathLike[str],
    *,
    scale: float | None = None,
    groups: JointGroups | str | None = None,
) -> None:
    """Write motions of one skeleton as a skinned, animated figure in binary glTF (GLB).

    Parameters
    ----------
    motions : Motion or sequence of Motion
        The motions; each becomes an animation of the same name. Offsets and frame rates may differ
        between motions; the mesh has the offsets of the first.
    path : str or path
        The file to write.
    scale : float, optional
        Metres per unit of length, which ``asset.extras`` of the file states. Default: guessed from
        the height of the skeleton.
    groups : JointGroups or str, optional
        Joint groups, or the name of a preset. The bones of a group have one colour. Default:
        trunk, arms and legs.

    Raises
    ------
    SkeletonMismatchError
        If the hierarchies differ.
    ValueError
        If there is no motion, the scale is not above 0, the groups do not fit the skeleton, a
        coordinate exceeds 1e38, or the file would have 4 GiB or more.
    OSError
        If the file cannot be written.

    Notes
    -----
    Lengths are in metres and y is up, as glTF requires. Only the root is rotated from the up
    direction of the motion to y; other joints keep their local rotations, which are zero in the
    rest pose. Each bone is a slim octahedron bound to its joint, because engines import no
    skeleton without a mesh. A track of constant values has one key, any other one key per frame;
    rotations between keys are interpolated on the sphere.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from mograft.dancer import dance
    >>> target = Path(tempfile.mkdtemp()) / "dance.glb"
    >>> write_glb(dance(strides=1).motion[:30], target)
    """
    clips = as_motions(motions)
    first = clips[0]
    for clip in clips[1:]:
        first.skeleton.check_same_hierarchy(clip.skeleton, clip.name or "a motion")
    write_bytes(Path(path), _build_file(clips, first, scale, groups))


def bone_figure(motion: Motion) -> bytes:
    """Return a GLB file as `write_glb` writes it, without the animation."""
    return _build_file([], motion, None, None)


def _build_file(
    motions: Sequence[Motion], figure: Motion, scale: float | None, groups: JointGroups | str | None
) -> bytes:
    """Return the bytes of a GLB file of motions, with the bones of the motion `figure` as mesh."""
    skeleton, transform = figure.skeleton, ExportTransform.of(figure, scale)
    buffer, mesh = GltfBuffer(), bone_mesh(skeleton, transform, groups)
    rest = transform.points(skeleton.rest_positions())
    check_single_precision("rest position", rest, skeleton)
    primitive = _build_mesh(buffer, mesh, skeleton.n_joints)
    # In the rest pose, the axes of every joint are those of the root, rotated to y up.
    inverse_bind = np.zeros((skeleton.n_joints, 4, 4))
    from_y_up = rotations.inverse(transform.to_y_up)
    inverse_bind[:, :3, :3] = rotations.rotate(from_y_up, np.eye(3)).T
    inverse_bind[:, :3, 3] = -rotations.rotate(from_y_up, rest)
    inverse_bind[:, 3, 3] = 1.0
    columns = buffer.add(inverse_bind.transpose(0, 2, 1).astype("<f4"))
    joints, metadata = list(range(skeleton.n_joints)), transform.metadata
    offsets = skeleton.offsets
    animations = [_build_animation(buffer, own, transform, offsets) for own in motions]
    surface = {"metallicFactor": 0.0, "roughnessFactor": 0.8}
    document = {
        "asset": {"version": "2.0", "generator": f"mograft {VERSION}", "extras": metadata},
        "scene": 0,
        "scenes": [{"nodes": [0, skeleton.n_joints]}],
        "nodes": _build_nodes(skeleton, transform, rest[0]),
        "meshes": [{"name": "bones", "primitives": [primitive]}],
        "materials": [{"name": "bones", "pbrMetallicRoughness": surface}],
        "skins": [{"joints": joints, "skeleton": 0, "inverseBindMatrices": columns}],
        **({"animations": animations} if animations else {}),
    }
    return buffer.pack(document)


def _build_nodes(
    skeleton: Skeleton, transform: ExportTransform, root_position: FloatArray
) -> list[Json]:
    """Return the glTF nodes: one per joint, and one for the mesh."""
    nodes: list[Json] = []
    for joint, name in enumerate(skeleton.names):
        translation = transform.scale * skeleton.offsets[joint] if joint else root_position
        node: Json = {"name": name, "translation": translation.tolist()}
        if joint == 0:
            node["rotation"] = transform.to_y_up.tolist()
        if skeleton.children[joint]:
            node["children"] = list(skeleton.children[joint])
        nodes.append(node)
    nodes.append({"name": "bones", "mesh": 0, "skin": 0})
    return nodes


def _build_animation(
    buffer: GltfBuffer, motion: Motion, transform: ExportTransform, offsets: FloatArray
) -> Json:
    """Return the glTF animation of a motion.

    `offsets`, shape (n_joints, 3), are those of the nodes. A joint other than the root that stays
    at its offset has no translation keys.
    """
    quats, positions = transform.local_transforms(motion)
    offsets = transform.scale * offsets
    times = np.arange(motion.n_frames, dtype=np.float64) * motion.frame_time
    inputs: dict[int, int] = {}
    samplers: list[Json] = []
    channels: list[Json] = []
    for joint in range(motion.n_joints):
        tracks = {"rotation": quats[:, joint]}
        if joint == 0 or (positions[:, joint] != offsets[joint]).any():
            tracks["translation"] = positions[:, joint]
        for path, values in tracks.items():
            keys = slice(None if np.ptp(values, axis=0).any() else 1)
            channels.append({"sampler": len(samplers), "target": {"node": joint, "path": path}})
            samplers.append(buffer.add_keys(times[keys], values[keys], inputs))
    return {"name": motion.name or "motion", "samplers": samplers, "channels": channels}


def _build_mesh(buffer: GltfBuffer, mesh: BoneMesh, n_joints: int) -> Json:
    """Return the bones as a glTF mesh primitive; each vertex is bound to one joint."""
    points, normals, vertex_joints, colours = mesh
    joints = np.zeros((len(vertex_joints), 4), "u1" if n_joints <= 256 else "<u2")
    joints[:, 0] = vertex_joints
    weights = np.zeros((len(vertex_joints), 4), "<f4")
    weights[:, 0] = 1.0
    arrays = {"POSITION": points, "NORMAL": normals, "COLOR_0": colours}
    arrays = {name: array.astype("<f4") for name, array in arrays.items()}
    attributes: dict[str, int] = {}
    for name, array in (arrays | {"JOINTS_0": joints, "WEIGHTS_0": weights}).items():
        attributes[name] = buffer.add(array, has_bounds=name == "POSITION", is_vertex_data=True)
    return {"attributes": attributes, "material": 0}
