"""The mesh of a character in a glTF file, as a page contains it."""

import base64
import io
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray
from mograft.errors import DAMAGE, FormatError
from mograft.io.character import open_character
from mograft.io.gltf.container import Container, read_accessor, to_floats
from mograft.io.gltf.copy_content import IMAGE_TYPES
from mograft.io.gltf.document import GltfFile
from mograft.io.gltf.nodes import NodeTree
from mograft.motion import rotations
from mograft.motion.skeleton import Skeleton

MAX_TRIANGLES = 20_000
MAX_BYTES = 8_000_000
"""Maximum size of the mesh and textures of a character on a page, compressed."""

_MAX_TEXTURE_PIXELS = 1024
_REST_TOLERANCE = 0.02  # Difference of rest poses, relative to the extent.
_COMPRESSED = ("KHR_draco_mesh_compression", "KHR_texture_basisu")


def read_character(path: Path, skeleton: Skeleton) -> dict[str, Any] | None:
    """Return the meshes of a glTF or FBX file as a dict for JSON, for motions of a skeleton.

    The script of the page binds each vertex to joints by the transforms ``inverses`` from the axes
    of the mesh to those of the joint. Nodes with a mesh but without a skin follow the nearest joint
    above. The result is None if the file has no mesh, or only the bones that mograft draws.

    Raises
    ------
    FormatError
        If the file is invalid, if the mesh uses a feature that pages do not show or is too large,
        or if the joints or the rest pose are not those of the skeleton.
    """
    file = open_character(path)
    if file is None:
        return None
    container = file.container
    meshes = {i: own for i, own in enumerate(container.items("nodes")) if "mesh" in own}
    names = [own.get("name") for own in container.items("meshes")]
    if not meshes or names == ["bones"]:
        return None
    scale = _check_skeleton(file, skeleton)
    if unread := set(container.document.get("extensionsUsed") or ()) & set(_COMPRESSED):
        container.fail("extensionsUsed", f"{min(unread)} is not decoded")
    skins = {own["skin"] for own in meshes.values() if "skin" in own}
    if len(skins) > 1:
        container.fail("skins", f"the mesh has {len(skins)} skins, expected one")
    world, texts, n_triangles = _world_matrices(file.tree), list[str](), 0
    spread = np.diag([scale, scale, scale, 1.0])
    bound = np.tile(np.eye(4), (skeleton.n_joints, 1, 1))
    members: list[int] = []
    if skins:
        members, inverses = _read_skin(container, next(iter(skins)))
        for node, inverse in zip(members, inverses, strict=True):
            linear = world[node].copy()
            linear[:3, 3] = 0.0
            bound[_row(file, node)] = spread @ linear @ inverse
    parts = []
    for node, own in meshes.items():
        joint = node
        while joint >= 0 and _row(file, joint) < 0:
            joint = int(file.tree.parents[joint])
        if joint < 0 and "skin" not in own:
            continue  # It does not move with the figure.
        place = world[node].copy()
        place[:3, 3] -= file.rest.positions[_row(file, joint)] if joint >= 0 else 0.0
        rows = np.array([_row(file, member) for member in members]) if "skin" in own else None
        mesh = container.item("meshes", own["mesh"], f"nodes[{node}].mesh")
        for number, primitive in enumerate(mesh.get("primitives", ())):
            where = f"meshes[{own['mesh']}].primitives[{number}]"
            arrays = _read_primitive(container, primitive, where)
            if rows is None:
                arrays = _attach(arrays, spread @ place, _row(file, joint))
            else:
                arrays["skinIndex"] = rows[arrays["skinIndex"]].astype("<u2")
            n_triangles += len(arrays["index"]) // 3
            attributes = {name: _compress(array, texts) for name, array in arrays.items()}
            material = _read_material(container, primitive.get("material"))
            parts.append({"attributes": attributes, "material": material, "isRigid": rows is None})
    if n_triangles > MAX_TRIANGLES:
        limit = f"{n_triangles} triangles exceed {MAX_TRIANGLES}"
        container.fail("meshes", f"{limit}; reduce the mesh")
    textures = [_read_texture(container, index) for index in range(len(_textures(container)))]
    size = sum(map(len, texts)) + sum(len(own["data"]) for own in textures)
    if size > MAX_BYTES:
        remedy = "reduce the mesh or its textures"
        container.fail("meshes", f"{size / 1e6:.1f} MB exceed {MAX_BYTES / 1e6:.0f} MB; {remedy}")
    columns = np.round(bound.transpose(0, 2, 1).reshape(-1, 16), 9).tolist()
    return {"inverses": columns, "parts": parts, "arrays": texts, "textures": textures}


def _compress(array: npt.NDArray[Any], texts: list[str]) -> dict[str, Any]:
    """Append the compressed array of vertices or triangles to `texts`; return its description."""
    packed = zlib.compress(np.ascontiguousarray(array).tobytes(), 9)
    texts.append(base64.b64encode(packed).decode("ascii"))
    width = 1 if array.ndim == 1 else array.shape[1]
    return {"type": array.dtype.str[1:], "width": width, "key": len(texts) - 1}


def _row(file: GltfFile, node: int) -> int:
    """Return the joint of a node, below 0 if it is none."""
    return int(file.moved_rows[node]) - file.n_above


def _check_skeleton(file: GltfFile, skeleton: Skeleton) -> float:
    """Return the length of the skeleton's unit in the file's unit; check names and rest pose."""
    if file.rest.names != skeleton.names:
        file.container.fail("nodes", "expected the joints of the motion")
    bones, own = file.rest.offsets[1:], skeleton.offsets[1:]
    length = float(np.linalg.norm(bones))
    scale = float(np.linalg.norm(own)) / length if length else 1.0
    if np.abs(own - scale * bones).max(initial=0) > _REST_TOLERANCE * scale * file.rest.extent:
        file.container.fail("nodes", "expected the rest pose of the motion")
    return scale


def _world_matrices(tree: NodeTree) -> FloatArray:
    """Return the world transforms of all nodes by default, shape (n_nodes, 4, 4)."""
    matrices = np.tile(np.eye(4), (len(tree.names), 1, 1))
    rest = tree.rest
    for root in np.flatnonzero(tree.parents < 0).tolist():
        for node in tree.below(root):
            turned = rotations.rotate(rest.rotations[0, node], np.eye(3)).T
            matrices[node, :3, :3] = turned * rest.scales[0, node]
            matrices[node, :3, 3] = rest.translations[0, node]
            if tree.parents[node] >= 0:
                matrices[node] = matrices[tree.parents[node]] @ matrices[node]
    return matrices


def _read_skin(container: Container, index: object) -> tuple[list[int], FloatArray]:
    """Return the nodes of a skin, and their inverse bind matrices."""
    skin = container.item("skins", index, "skins")
    joints: list[int] = skin["joints"]
    if "inverseBindMatrices" not in skin:
        return joints, np.tile(np.eye(4), (len(joints), 1, 1))
    place = f"skins[{index}].inverseBindMatrices"
    matrices = to_floats(read_accessor(container, skin["inverseBindMatrices"], place, 16))
    if len(matrices) < len(joints):
        container.fail(place, f"expected {len(joints)} matrices, got {len(matrices)}")
    return joints, matrices[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)


def _read_primitive(
    container: Container, primitive: dict[str, Any], where: str
) -> dict[str, npt.NDArray[Any]]:
    given = primitive.get("attributes")
    if not isinstance(given, dict) or "POSITION" not in given:
        container.fail(where, "expected attributes with POSITION")
    if primitive.get("mode", 4) != 4:
        container.fail(where, "the page shows triangles only")
    if primitive.get("targets"):
        container.fail(where, "morph targets are not shown")
    if "JOINTS_1" in given:
        container.fail(where, "more than four joints move a vertex")
    names = {"position": ("POSITION", 3), "normal": ("NORMAL", 3), "uv": ("TEXCOORD_0", 2)}
    names |= {"skinIndex": ("JOINTS_0", 4), "skinWeight": ("WEIGHTS_0", 4)}
    arrays = {
        name: read_accessor(container, given[key], f"{where}.{key}", width)
        for name, (key, width) in names.items()
        if key in given
    }
    n = len(arrays["position"])
    for name, array in arrays.items():
        if len(array) != n:
            container.fail(where, f"expected {n} elements of {name}, got {len(array)}")
        if name != "skinIndex":
            arrays[name] = array.astype("<f4")
    index = np.arange(n)
    if "indices" in primitive:
        index = read_accessor(container, primitive["indices"], f"{where}.indices", 1)[:, 0]
    if len(index) % 3 or index.max(initial=0) >= n:
        container.fail(where, f"expected triangles of {n} vertices")
    return {**arrays, "index": index.astype("<u4")}


def _attach(
    arrays: dict[str, npt.NDArray[Any]], place: FloatArray, joint: int
) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of a mesh without a skin in the axes of a joint, bound to the joint."""
    n, kept = len(arrays["position"]), {"position", "normal", "uv", "index"}
    moved = {name: array for name, array in arrays.items() if name in kept}
    moved["position"] = (arrays["position"] @ place[:3, :3].T + place[:3, 3]).astype("<f4")
    if "normal" in moved:
        turned = arrays["normal"] @ np.linalg.pinv(place[:3, :3])
        turned /= np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-12)
        moved["normal"] = turned.astype("<f4")
    weights = np.tile(np.array([1, 0, 0, 0], "<f4"), (n, 1))
    return {**moved, "skinIndex": (joint * weights).astype("<u2"), "skinWeight": weights}


def _textures(container: Container) -> list[dict[str, Any]]:
    found = container.document.get("textures")
    return [own for own in found if isinstance(own, dict)] if isinstance(found, list) else []


def _read_material(container: Container, index: object) -> dict[str, Any]:
    found = container.document.get("materials")
    material: dict[str, Any] = {}
    if index is not None:
        material = container.choose(found or [], index, "materials", "materials")
    surface = material.get("pbrMetallicRoughness") or {}
    texture = (surface.get("baseColorTexture") or {}).get("index")
    if texture is not None:
        container.choose(_textures(container), texture, "materials", "textures")
    white, place = [1, 1, 1, 1], "materials"
    return {
        "color": container.floats(surface.get("baseColorFactor", white), place, 4),
        "emissive": container.floats(material.get("emissiveFactor", [0, 0, 0]), place, 3),
        "texture": texture,
        "metalness": float(surface.get("metallicFactor", 1)),
        "roughness": float(surface.get("roughnessFactor", 1)),
        "isDouble": material.get("doubleSided") is True,
        "mode": str(material.get("alphaMode", "OPAQUE")),
        "cutoff": float(material.get("alphaCutoff", 0.5)),
    }


def _read_texture(container: Container, index: int) -> dict[str, Any]:
    """Return a texture with at most 1,024 pixels if Pillow is installed; "" if it is no image."""
    texture, place = _textures(container)[index], f"textures[{index}]"
    images = container.document.get("images") or []
    image = container.choose(images, texture.get("source"), f"{place}.source", "images")
    if "bufferView" in image:
        view = container.item("bufferViews", image["bufferView"], place)
        start, length = view.get("byteOffset", 0), view.get("byteLength", 0)
        content = bytes(container.buffer(view.get("buffer", -1), place)[start : start + length])
    else:
        uri = str(image.get("uri", ""))
        content = bytes(
            base64.b64decode(uri.partition(",")[2])
            if uri.startswith("data:")
            else container.read_file(uri, MAX_BYTES, place)
        )
    kind = next((k for magic, k in IMAGE_TYPES.items() if content.startswith(magic)), "")
    if kind:
        content, kind = _shrink(content, kind)
    samplers = container.document.get("samplers") or []
    number = texture.get("sampler")
    sampler = {} if number is None else container.choose(samplers, number, place, "samplers")
    wrap = [sampler.get(name, 10497) for name in ("wrapS", "wrapT")]
    text = base64.b64encode(content).decode("ascii") if kind else ""
    return {"type": kind, "data": text, "wrap": wrap}


def _shrink(content: bytes, kind: str) -> tuple[bytes, str]:
    """Return an image of at most 1,024 pixels and its type; unchanged without Pillow."""
    try:
        from PIL import Image
    except ImportError:
        return content, kind
    try:
        with Image.open(io.BytesIO(content)) as image:
            if max(image.size) <= _MAX_TEXTURE_PIXELS:
                return content, kind
            image.thumbnail((_MAX_TEXTURE_PIXELS, _MAX_TEXTURE_PIXELS))
            target = io.BytesIO()
            image.convert("RGBA").save(target, "PNG")
    except (OSError, ValueError, Image.DecompressionBombError):
        return content, kind
    return target.getvalue(), "image/png"


def find_characters(
    figures: list[tuple[Path | None, Skeleton]], given: Path | None
) -> tuple[list[dict[str, Any]], list[int | None], list[str]]:
    """Return the characters of figures, the number of each figure's, and reasons for missing ones.

    A figure has the character of its file, or of `given`, or that of another figure of the same
    skeleton.
    """
    characters: list[dict[str, Any]] = []
    found: dict[tuple[str, ...], int | None] = {}
    reasons: list[str] = []
    for path, skeleton in figures:
        source = given or path
        if skeleton.names in found or source is None:
            continue
        if source.suffix.lower() not in (".glb", ".gltf") or not source.exists():
            continue
        found[skeleton.names] = None
        try:
            character = read_character(source, skeleton)
        except (FormatError, OSError, *DAMAGE) as error:
            reasons.append(f"Figures are capsules, not the mesh of {source.name}: {error}.")
            if given is not None:
                warnings.warn(reasons[-1], stacklevel=2)
            continue
        if character is not None:
            found[skeleton.names] = len(characters)
            characters.append(character)
    return characters, [found.get(own.names) for _, own in figures], reasons
