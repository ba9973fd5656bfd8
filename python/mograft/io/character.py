"""Characters: files with meshes to which animations are added."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.arrays import IntArray
from mograft.errors import FormatError, join_names
from mograft.io.clips import errors_of_file
from mograft.io.fbx import figure_joints, load_scene, open_fbx, read_rest_pose
from mograft.io.formats import find_format
from mograft.io.glb import GltfBuffer, Json
from mograft.io.gltf.copy_content import IMAGE_TYPES, MAX_IMAGE_BYTES
from mograft.io.gltf.document import GltfFile, read_gltf_file
from mograft.io.gltf.writer import Addition, append_animations, fit_motion
from mograft.io.rest_pose import RestPose, to_local
from mograft.motion import rotations

_MIN_CORNERS, _CORNERS_PER_BYTE = 1 << 22, 4
"""Limit of the corners of triangles: at least the constant, else corners per byte of the file."""


def open_character(path: Path) -> GltfFile | None:
    """Return a glTF file that has the meshes and the animations of a file; None without meshes.

    An FBX file is converted. Raises `FormatError` if the file is invalid, and OSError if it cannot
    be read.
    """
    form = find_format(path).name
    if form == "FBX":
        return _convert_fbx(path)
    file = read_gltf_file(path) if form == "glTF" else None
    return file if file is not None and file.container.items("meshes") else None


def _convert_fbx(path: Path) -> GltfFile | None:
    """Return an FBX file as a GLB file in metres; None if it has no meshes or no joints.

    The bones have no scale: vertices have their places in the rest pose, and move with the rotation
    and the position of at most four bones.
    """
    data = path.read_bytes()
    scene = load_scene(path, data, with_geometry=True)
    with errors_of_file(path, "meshes"):
        parts = scene.meshes(max(_MIN_CORNERS, _CORNERS_PER_BYTE * len(data)))
    joints = figure_joints(scene)
    if not parts or not len(joints):
        return None
    rest, buffer = read_rest_pose(path, scene, joints), GltfBuffer()
    unit = scene.settings[2]
    turned, places = to_local(rest.parents, rest.rotations[None], rest.positions[None])
    nodes: list[Json] = [
        {"name": name, "rotation": turned[0, joint].tolist(), "translation": place.tolist()}
        for joint, (name, place) in enumerate(zip(rest.names, unit * places[0], strict=True))
    ]
    for joint, parent in enumerate(rest.parents.tolist()):
        if parent >= 0:
            nodes[parent].setdefault("children", []).append(joint)
    bones = np.full(len(scene.names), -1)  # the joint that moves each node
    bones[joints] = np.arange(len(joints))
    for node, parent in enumerate(scene.parents.tolist()):
        if bones[node] < 0 and parent >= 0:
            bones[node] = bones[parent]
    meshes: list[Json] = []
    roots, owner = [0], -1
    for name, node, material, *arrays in parts:
        if node != owner:
            roots.append(len(nodes))
            nodes.append({"name": name, "mesh": len(meshes)})
            meshes.append({"name": name, "primitives": []})
            owner = node
        if not np.isfinite(arrays[1]).all():
            raise FormatError(f"expected finite positions, got others in {name}", path, "meshes")
        primitive = _add_part(buffer, arrays, bones, unit, len(joints))
        if "JOINTS_0" in primitive["attributes"]:
            nodes[-1]["skin"] = 0
        meshes[-1]["primitives"].append(
            primitive if material is None else {**primitive, "material": material}
        )
    document: Json = {
        "asset": {"version": "2.0", "generator": f"mograft {VERSION}"},
        "scene": 0,
        "scenes": [{"nodes": roots}],
        "nodes": nodes,
        "meshes": meshes,
        "skins": [{"joints": [*range(len(joints))], "skeleton": 0}],
        **_add_materials(path, scene, buffer),
    }
    document["skins"][0]["inverseBindMatrices"] = _add_bindings(buffer, rest, unit)
    file = read_gltf_file(path, buffer.pack(document))
    clips = open_fbx(path, rate=None, skeleton=None)
    takes = [Addition(fit_motion(file, clip)) for clip in clips]
    return read_gltf_file(path, append_animations(file, takes)[1]) if takes else file


def _add_bindings(buffer: GltfBuffer, rest: RestPose, unit: float) -> int:
    """Add the inverse of the rest pose of the joints; return the index of the accessor."""
    inverse = rotations.inverse(rest.rotations)
    matrices = np.tile(np.eye(4), (len(inverse), 1, 1))
    for axis in range(3):
        matrices[:, axis, :3] = rotations.rotate(inverse, np.eye(3)[axis])  # columns, transposed
    matrices[:, 3, :3] = -rotations.rotate(inverse, unit * rest.positions)
    return buffer.add(matrices.astype("<f4"), "MAT4")


def _add_part(
    buffer: GltfBuffer, arrays: list[Any], bones: IntArray, unit: float, n_joints: int
) -> Json:
    """Add the triangles of one material; return the primitive.

    Without the attribute ``JOINTS_0``, no joint moves the mesh.
    """
    triangles, positions, normals, uvs, movers, weights = arrays
    moved = np.where(weights > 0, bones[movers], 0)
    given = {"POSITION": unit * positions, "NORMAL": normals}
    if len(uvs):
        given["TEXCOORD_0"] = uvs * (1, -1) + (0, 1)
    columns = {name: array.astype("<f4") for name, array in given.items()}
    if (moved[:, 0] >= 0).any():
        joints = np.maximum(moved, 0).astype("u1" if n_joints <= 256 else "<u2")
        columns |= {"JOINTS_0": joints, "WEIGHTS_0": weights.astype("<f4")}
    attributes = {
        name: buffer.add(
            array, f"VEC{array.shape[1]}", has_bounds=name == "POSITION", is_vertex_data=True
        )
        for name, array in columns.items()
    }
    return {"attributes": attributes, "indices": buffer.add_indices(triangles)}


def _add_materials(path: Path, scene: Any, buffer: GltfBuffer) -> Json:  # noqa: ANN401
    """Add the textures of an FBX file; return ``materials`` and what they refer to."""
    found: Json = {"materials": [], "textures": [], "images": []}
    missing, indices = [], dict[str, int]()
    for name, color, texture in scene.materials:
        surface: Json = {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0}
        if texture is not None and texture[0] not in indices:
            data = texture[1] or _read_texture(path, texture[0])
            kinds = [kind for start, kind in IMAGE_TYPES.items() if data.startswith(start)]
            if kinds:
                view = buffer.add_bytes(data)
                indices[texture[0]] = len(found["images"])
                found["textures"].append({"source": len(found["images"])})
                found["images"].append({"mimeType": kinds[0], "bufferView": view})
            else:
                missing.append(texture[0])
        if texture is not None and texture[0] in indices:
            surface["baseColorTexture"] = {"index": indices[texture[0]]}
        found["materials"].append({"name": name, "pbrMetallicRoughness": surface})
    if missing:
        warnings.warn(
            f"{path}: textures that are not PNG or JPEG files in its folder were left out: "
            f"{join_names(list(dict.fromkeys(missing)))}",
            stacklevel=5,
        )
    return {name: items for name, items in found.items() if items}


def _read_texture(path: Path, name: str) -> bytes:
    """Return the bytes of a texture in the folder of a file or below it; empty without one."""
    folder, relative = path.parent.resolve(), Path(name.replace("\\", "/"))
    for file in (relative, Path(relative.name), Path(f"{path.stem}.fbm", relative.name)):
        try:
            found = (folder / file).resolve()
            is_inside = found.is_relative_to(folder) and found.is_file()
            if is_inside and found.stat().st_size <= MAX_IMAGE_BYTES:
                return found.read_bytes()
        except (OSError, ValueError):
            continue
    return b""
