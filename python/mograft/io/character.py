"""Characters: files with meshes to which animations are added."""

import warnings
from contextlib import suppress
from pathlib import Path

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft.errors import join_names
from mograft.io.clips import errors_of_file
from mograft.io.fbx import figure_joints, load_scene, open_fbx, read_rest_pose
from mograft.io.formats import find_format
from mograft.io.gltf.copy_content import MAX_IMAGE_BYTES
from mograft.io.gltf.document import GltfFile, read_gltf_file
from mograft.io.gltf.writer import Addition, append_animations, transform
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
    joints = figure_joints(scene)
    if not len(joints):
        return None
    names = read_rest_pose(path, scene, joints).names
    textures = {name: content for name in scene.textures if (content := _texture(path, name))}
    limit = max(_MIN_CORNERS, _CORNERS_PER_BYTE * len(data))
    with errors_of_file(path, "meshes"):
        options = {"generator": f"mograft {VERSION}", "max_corners": limit}
        found = scene.to_glb(joints.tolist(), names, textures, **options)
    if found is None:
        return None
    content, missing = found
    if missing:
        text = "left out textures, which are not PNG or JPEG files in its folder"
        warnings.warn(f"{path}: {text}: {join_names(missing)}", stacklevel=4)
    file = read_gltf_file(path, content)
    clips = open_fbx(path, rate=None, skeleton=None)
    change = file.rest.offsets, rotations.IDENTITY, scene.settings[2]
    takes = [Addition(transform(own, *change)) for own in clips]
    return read_gltf_file(path, append_animations(file, takes)[1]) if takes else file


def _texture(path: Path, name: str) -> bytes:
    """Return the bytes of a texture in the folder of a file or below it; empty without one."""
    folder, relative = path.parent.resolve(), Path(name.replace("\\", "/"))
    for file in (relative, relative.name, f"{path.stem}.fbm/{relative.name}"):
        with suppress(OSError, ValueError):
            found = (folder / file).resolve()
            if found.is_relative_to(folder) and 0 < found.stat().st_size <= MAX_IMAGE_BYTES:
                return found.read_bytes()
    return b""
