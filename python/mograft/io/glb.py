"""GLB: the binary form of glTF 2.0, for browsers, Blender, Unreal and Unity."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.arrays import FloatArray, IntArray
from mograft._util.atomic import write_bytes
from mograft._util.validate import check_type
from mograft.body.groups import JointGroups
from mograft.io.bone_mesh import BoneMesh, bone_mesh, joint_group_indices
from mograft.io.gltf.buffer import GltfBuffer
from mograft.io.palette import linear_colours
from mograft.io.units import ExportTransform, check_single_precision
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton


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
    clips = [motions] if isinstance(motions, Motion) else list(motions)
    if not clips:
        raise ValueError("`motions` must hold at least one motion, got none")
    for clip in clips:
        check_type("motions", clip, Motion)
    first = clips[0]
    for clip in clips[1:]:
        first.skeleton.check_same_hierarchy(clip.skeleton, clip.name or "a motion")
    transform = ExportTransform.of(first, scale)
    buffer = GltfBuffer()
    group_indices = joint_group_indices(first.skeleton, groups)
    document = _build_document(buffer, clips, transform, group_indices)
    write_bytes(Path(path), buffer.pack(document))


def _build_document(
    buffer: GltfBuffer,
    motions: Sequence[Motion],
    transform: ExportTransform,
    group_indices: IntArray,
) -> dict[str, Any]:
    """Fill the buffer; return the JSON document without the entries that `GltfBuffer.pack` adds."""
    skeleton = motions[0].skeleton
    rest = transform.points(skeleton.rest_positions())
    check_single_precision("rest position", rest, skeleton)
    mesh = _build_mesh(buffer, bone_mesh(skeleton, transform), group_indices)
    # In the rest pose, the axes of every joint are those of the root, rotated to y up.
    inverse_bind = np.zeros((skeleton.n_joints, 4, 4))
    from_y_up = rotations.inverse(transform.to_y_up)
    inverse_bind[:, :3, :3] = rotations.rotate(from_y_up, np.eye(3)).T
    inverse_bind[:, :3, 3] = -rotations.rotate(from_y_up, rest)
    inverse_bind[:, 3, 3] = 1.0
    columns = buffer.add(inverse_bind.transpose(0, 2, 1).astype("<f4"), "MAT4")
    joints, metadata = list(range(skeleton.n_joints)), transform.metadata
    offsets = skeleton.offsets
    animations = [_build_animation(buffer, own, transform, offsets) for own in motions]
    surface = {"metallicFactor": 0.0, "roughnessFactor": 0.8}
    return {
        "asset": {"version": "2.0", "generator": f"mograft {VERSION}", "extras": metadata},
        "scene": 0,
        "scenes": [{"nodes": [0, skeleton.n_joints]}],
        "nodes": _build_nodes(skeleton, transform, rest[0]),
        "meshes": [{"name": "bones", "primitives": [mesh]}],
        "materials": [{"name": "bones", "pbrMetallicRoughness": surface}],
        "skins": [{"joints": joints, "skeleton": 0, "inverseBindMatrices": columns}],
        "animations": animations,
    }


def _build_nodes(
    skeleton: Skeleton, transform: ExportTransform, root_position: FloatArray
) -> list[dict[str, Any]]:
    """Return the glTF nodes: one per joint, and one for the mesh."""
    nodes: list[dict[str, Any]] = []
    for joint, name in enumerate(skeleton.names):
        translation = transform.scale * skeleton.offsets[joint] if joint else root_position
        node: dict[str, Any] = {"name": name, "translation": translation.tolist()}
        if joint == 0:
            node["rotation"] = transform.to_y_up.tolist()
        if skeleton.children[joint]:
            node["children"] = list(skeleton.children[joint])
        nodes.append(node)
    nodes.append({"name": "bones", "mesh": 0, "skin": 0})
    return nodes


def _build_animation(
    buffer: GltfBuffer, motion: Motion, transform: ExportTransform, offsets: FloatArray
) -> dict[str, Any]:
    """Return the glTF animation of a motion.

    `offsets`, shape (n_joints, 3), are those of the nodes. A joint other than the root that stays
    at its offset has no translation keys.
    """
    quats, positions = transform.local_transforms(motion)
    offsets = transform.scale * offsets
    times = (np.arange(motion.n_frames) * motion.frame_time).astype("<f4")
    # Accessors of the key times, by number of keys. Each is added at its first use, because
    # validators report unused accessors.
    inputs: dict[int, int] = {}
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    for joint in range(motion.n_joints):
        tracks = [("rotation", "VEC4", quats[:, joint])]
        if joint == 0 or (positions[:, joint] != offsets[joint]).any():
            tracks.append(("translation", "VEC3", positions[:, joint]))
        for path, element_type, values in tracks:
            is_constant = not np.ptp(values, axis=0).any()
            keys = values[:1] if is_constant else values
            if len(keys) not in inputs:
                inputs[len(keys)] = buffer.add(times[: len(keys)], "SCALAR", has_bounds=True)
            output = buffer.add(keys.astype("<f4"), element_type)
            samplers.append({"input": inputs[len(keys)], "output": output})
            target = {"node": joint, "path": path}
            channels.append({"sampler": len(samplers) - 1, "target": target})
    return {"name": motion.name or "motion", "samplers": samplers, "channels": channels}


def _build_mesh(buffer: GltfBuffer, mesh: BoneMesh, group_indices: IntArray) -> dict[str, Any]:
    """Return the bones as a glTF mesh primitive; each vertex is bound to one joint."""
    points, normals, vertex_joints = mesh
    joints = np.zeros((len(vertex_joints), 4), "u1" if len(group_indices) <= 256 else "<u2")
    joints[:, 0] = vertex_joints
    weights = np.zeros((len(vertex_joints), 4), "<f4")
    weights[:, 0] = 1.0
    colours = linear_colours(group_indices[vertex_joints])
    arrays = {"POSITION": points, "NORMAL": normals, "COLOR_0": colours}
    arrays = {name: array.astype("<f4") for name, array in arrays.items()}
    attributes: dict[str, int] = {}
    for name, array in (arrays | {"JOINTS_0": joints, "WEIGHTS_0": weights}).items():
        kind, has_bounds = f"VEC{array.shape[1]}", name == "POSITION"
        attributes[name] = buffer.add(array, kind, has_bounds=has_bounds, is_vertex_data=True)
    return {"attributes": attributes, "material": 0}
