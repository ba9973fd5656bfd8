"""New animations in a copy of a glTF file."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft._util.atomic import write_bytes
from mograft._util.names import unique_names
from mograft._util.validate import check_type
from mograft.errors import FormatError, suggest_name
from mograft.io.glb import GltfBuffer, Json, as_motions
from mograft.io.gltf.animation import PATH_WIDTHS, animation_names
from mograft.io.gltf.container import COMPRESSION, Container
from mograft.io.gltf.document import GltfFile, read_gltf_file
from mograft.io.gltf.nodes import SCALE_TOLERANCE, Transforms, remove_mirroring
from mograft.io.rest_pose import POSITION_TOLERANCE, restore
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

_IMAGE_TYPES = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}
"""Media types of images by their first bytes."""

_MAX_IMAGE_BYTES = 1 << 30

_Place = tuple[int, int]  # of a buffer's bytes in the copy: the index of the buffer, and the offset


def write_glb_animations(
    source: str | os.PathLike[str],
    motions: Motion | Sequence[Motion],
    path: str | os.PathLike[str],
    *,
    bases: Sequence[Motion | None] | None = None,
) -> None:
    """Write a copy of a glTF file to which motions are added as animations.

    Meshes, skins, materials, images and the animations of the file keep their bytes.

    Parameters
    ----------
    source : str or path
        The file to copy, ``.glb`` or ``.gltf``. It is not changed.
    motions : Motion or sequence of Motion
        The motions, with the joints of the file; each becomes an animation of its name, with
        ``~2``, ``~3``... appended if an animation already has the name.
    path : str or path
        The GLB file to write.
    bases : sequence of Motion or None, optional
        For each motion the clip of `source` from which it was made, as `read` returns it, with the
        same frames; or None. Rotations and positions of a joint that do not differ from the clip
        keep the clip's tracks. The new animation also has the scales of the clip and everything
        else that the clip animates. Default: None for all motions, so that all joints get new
        tracks.

    Raises
    ------
    FormatError
        If `source` is not a valid glTF file with joints.
    SkeletonMismatchError
        If a motion has other joints than the file.
    ValueError
        If there is no motion; if a base is not a clip of the file, or has another number of frames
        than its motion; or if the file would have 4 GiB or more.
    OSError
        If a file cannot be read or written.

    Notes
    -----
    A new track has a key at every frame with linear interpolation, or two equal keys if it is
    constant. If a graft is written with its base, the joints that are not exchanged keep their
    tracks.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from mograft.dancer import dance
    >>> from mograft.io.formats import read
    >>> from mograft.io.glb import write_glb
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_glb(dance(strides=1).motion[:30], folder / "a.glb")
    >>> clip = read(folder / "a.glb")[0]
    >>> write_glb_animations(folder / "a.glb", clip[10:], folder / "b.glb")
    >>> read(folder / "b.glb").names
    ('dance', 'dance~2')
    """
    given = as_motions(motions)
    origins = [None] * len(given) if bases is None else list(bases)
    if len(origins) != len(given):
        raise ValueError(f"`bases` must have {len(given)} items, got {len(origins)}")
    file = read_gltf_file(Path(source))
    additions = [_add(file, *pair) for pair in zip(given, origins, strict=True)]
    write_bytes(Path(path), append_animations(file, additions)[1])


@dataclass(frozen=True, eq=False)
class Addition:
    """A motion to add to a file, and the clip of the file whose tracks it keeps, if any."""

    motion: Motion
    base: Motion | None = None  # the motion of the clip, in the same frames as `motion`
    clip: int | None = None  # index of the clip


def has_duration(file: GltfFile, clip: int, base: Motion) -> bool:
    """Return whether the durations of a motion and a clip differ by at most a quarter frame."""
    return abs(base.duration - file.read(clip).duration) <= 0.25 * base.frame_time


def _add(file: GltfFile, motion: Motion, base: Motion | None) -> Addition:
    """Check a motion and its base, and return the addition of the motion."""
    if base is None:
        return Addition(motion)
    check_type("bases", base, Motion)
    sizes = [f"{own.n_frames} and {own.n_joints}" for own in (motion, base)]
    if sizes[0] != sizes[1]:
        expected = f"as many frames and joints as their motions, {sizes[0]}"
        raise ValueError(f"`bases` must have {expected}, got {sizes[1]}")
    name, expected = base.clip or base.name, f"`bases` must be clips of {file.container.path}"
    if name not in file.clip_names:
        hint = suggest_name(name, file.clip_names)
        raise ValueError(f"{expected}, which has no {name!r}{hint}")
    clip = file.clip_names.index(name)
    if not has_duration(file, clip, base):
        raise ValueError(f"{expected}, whose clip {name} does not last {base.duration:.6g} s")
    return Addition(motion, base, clip)


def append_animations(
    file: GltfFile, additions: Sequence[Addition]
) -> tuple[tuple[str, ...], bytes]:
    """Return the names of the new animations, and the bytes of the GLB file that has them."""
    skeleton = Skeleton(file.rest.names, file.rest.parents, file.rest.offsets)
    for addition in additions:
        motion = addition.motion
        skeleton.check_same_hierarchy(motion.skeleton, motion.name or "a motion")
    document, buffer = copy_content(file.container)
    old, given = animation_names(file.container), [own.motion.name or "motion" for own in additions]
    names = unique_names([*old, *given])[len(old) :]
    tables = [_new_tables(file, addition) for addition in additions]
    document["nodes"] = _animated_nodes(file, {node for table in tables for node, _ in table.keys})
    document["animations"] = [
        *file.container.items("animations"),
        *map(partial(_build_animation, file, buffer), tables, additions, names),
    ]
    return tuple(names), buffer.pack(document)


class _NewTables(NamedTuple):
    """The new tracks of an animation."""

    times: FloatArray  # seconds, shape (n_frames,)
    keys: dict[tuple[int, str], FloatArray]  # values in every frame, by node and property


def _new_tables(file: GltfFile, addition: Addition) -> _NewTables:
    """Return the tracks of a motion that it does not share with its base clip."""
    motion, base, clip = addition.motion, addition.base, addition.clip
    animation = None if clip is None else file.read(clip)
    start = 0.0 if animation is None else animation.start
    times = np.linspace(start, start + motion.duration, motion.n_frames)
    if animation is None or base is None:
        local = file.moved_rest.of(np.arange(len(file.moved_nodes)), motion.n_frames)
        quats, translations = _local_tracks(file, motion, local)
        is_turned = np.ones(motion.n_joints, bool)
        rest = file.tree.rest.translations[0, file.joints]
        reach = POSITION_TOLERANCE * np.abs(rest).max(initial=0.0)
        is_moved = np.abs(translations - rest).max(axis=(0, 2)) > reach
        is_moved[0] = True
    else:
        local = file.sample(animation, times)
        quats, translations = _local_tracks(file, motion, local)
        is_turned, is_moved = _changed_tracks(file, motion, base, local.scales)
    values: dict[tuple[int, str], FloatArray] = {}
    for joint, node in enumerate(file.joints.tolist()):
        if is_moved[joint]:
            values[node, "translation"] = translations[:, joint]
        if is_turned[joint]:
            values[node, "rotation"] = quats[:, joint]
    return _NewTables(times, values)


def _animated_nodes(file: GltfFile, animated: set[int]) -> list[Json]:
    """Return the nodes of the file; matrices of `animated` become translation, rotation and scale.

    glTF forbids matrices in animated nodes.
    """
    nodes = list(file.container.items("nodes"))
    rest = file.tree.rest
    for node in animated:
        if "matrix" in nodes[node]:
            nodes[node] = nodes[node] | {
                "translation": rest.translations[0, node].tolist(),
                "rotation": rest.rotations[0, node].tolist(),
                "scale": rest.scales[0, node].tolist(),
            }
            del nodes[node]["matrix"]
    return nodes


def _build_animation(
    file: GltfFile, buffer: GltfBuffer, tables: _NewTables, addition: Addition, name: str
) -> Json:
    """Append the keys of an animation to the buffer; return the animation.

    Properties without new keys keep the samplers of the clip.
    """
    samplers: list[Json] = []
    channels: list[Json] = []
    if addition.clip is not None:
        _keep_channels(file, addition.clip, tables, samplers, channels)
    ends = sorted({0, len(tables.times) - 1})
    inputs: dict[int, int] = {}  # accessor of the key times, by number of keys
    for (node, path), values in tables.keys.items():
        stored = values.astype("<f4")
        rows = np.arange(len(stored)) if (stored != stored[0]).any() else np.array(ends)
        if len(rows) not in inputs:
            times = tables.times[rows].astype("<f4")
            inputs[len(rows)] = buffer.add(times, "SCALAR", has_bounds=True)
        output = buffer.add(stored[rows], f"VEC{stored.shape[1]}")
        channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
        samplers.append({"input": inputs[len(rows)], "interpolation": "LINEAR", "output": output})
    return {"name": name, "channels": channels, "samplers": samplers}


def _keep_channels(
    file: GltfFile, clip: int, tables: _NewTables, samplers: list[Json], channels: list[Json]
) -> None:
    """Append the channels of a clip that have no new keys, and their samplers."""
    number = file.animations[clip]
    base = file.container.items("animations")[number]
    kept: dict[int, int] = {}  # index of each kept sampler of the clip
    for channel in base["channels"]:
        target, index = channel["target"], channel.get("sampler")
        path = target.get("path")
        if path in PATH_WIDTHS and (target.get("node"), path) in tables.keys:
            continue
        place = f"animations[{number}].channels"
        sampler = file.container.choose(base["samplers"], index, place, "samplers")
        if index not in kept:
            kept[index] = len(samplers)
            samplers.append(sampler)
        channels.append({**channel, "sampler": kept[index]})


def _local_tracks(
    file: GltfFile, motion: Motion, nodes: Transforms
) -> tuple[FloatArray, FloatArray]:
    """Return local transforms that give the joints of a file the world transforms of a motion.

    Rotations have shape (n_frames, n_joints, 4), translations (n_frames, n_joints, 3).
    `nodes` holds, in every frame, the local transforms of `GltfFile.moved_nodes`. The transforms of
    the nodes above the root joint and the scales of the joints are used as they are. If a parent
    has a scale of 0, no translation gives the position, and the translation of `nodes` is returned.
    """
    world_turns, world_places = restore(file.rest, motion)
    parents = file.moved_parents.tolist()
    n_above, n_frames = file.n_above, motion.n_frames
    half_turns, _ = remove_mirroring(
        np.broadcast_to(rotations.IDENTITY, nodes.rotations.shape), nodes.scales
    )
    quats, shifts = np.empty(world_turns.shape), np.empty(world_places.shape)
    # Of each node: world rotation without mirroring, axes with scale as columns, position.
    turns: list[FloatArray] = []
    axes: list[FloatArray] = []
    places: list[FloatArray] = []
    for node, parent in enumerate(parents):
        joint = node - n_above
        above = turns[parent] if parent >= 0 else np.tile(rotations.IDENTITY, (n_frames, 1))
        base = axes[parent] if parent >= 0 else np.tile(np.eye(3), (n_frames, 1, 1))
        origin = places[parent] if parent >= 0 else np.zeros((n_frames, 3))
        mirror = half_turns[:, node]
        if joint < 0:
            own, shift = nodes.rotations[:, node], nodes.translations[:, node]
            turns.append(rotations.multiply(above, rotations.multiply(own, mirror)))
            places.append(origin + np.einsum("fij,fj->fi", base, shift))
        else:
            turns.append(world_turns[:, joint])
            places.append(world_places[:, joint])
            own = rotations.multiply(rotations.inverse(above), turns[node])
            own = rotations.multiply(own, rotations.inverse(mirror))
            quats[:, joint] = own
            fallback = nodes.translations[:, node]
            shifts[:, joint] = _solve(base, places[node] - origin, fallback)
        columns = np.stack([rotations.rotate(own, np.eye(3)[i]) for i in range(3)], axis=-1)
        axes.append(base @ (columns * nodes.scales[:, node, None, :]))
    return rotations.continuous_signs(quats), shifts


def _solve(axes: FloatArray, vectors: FloatArray, fallback: FloatArray) -> FloatArray:
    """Return the coordinates of vectors, (n, 3), in terms of axes, the columns of (n, 3, 3).

    Where the axes are singular, return `fallback`, (n, 3).
    """
    sizes = np.linalg.norm(axes, axis=1)
    volumes = np.abs(np.linalg.det(axes))
    is_regular = volumes > 1e-9 * sizes.max(axis=1) ** 3
    found = fallback.copy()
    found[is_regular] = np.linalg.solve(axes[is_regular], vectors[is_regular][..., None])[..., 0]
    return found


def _changed_tracks(
    file: GltfFile, motion: Motion, base: Motion, scales: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Return whether each joint needs new rotations, and whether it needs new translations.

    A joint needs none if its values in `base` are the same, bit for bit. `scales` are those of
    `GltfFile.moved_nodes`. If the scales along the axes of a node differ, new rotations above a
    joint require new translations of the joint, too.
    """
    is_equal = (motion.rotations == base.rotations).all(axis=2)
    is_equal |= (motion.rotations == -base.rotations).all(axis=2)
    is_turned = ~is_equal.all(axis=0)
    is_moved = (motion.positions != base.positions).any(axis=(0, 2))
    spread = np.ptp(scales, axis=2) > SCALE_TOLERANCE * np.abs(scales[..., 0])
    if spread.any():
        below = np.zeros(motion.n_joints, bool)
        for joint, parent in enumerate(file.rest.parents.tolist()):
            below[joint] = parent >= 0 and (below[parent] or is_turned[parent])
        is_moved |= below
    return is_turned, is_moved


def copy_content(container: Container) -> tuple[Json, GltfBuffer]:
    """Return the JSON document of a copy, and a binary buffer with all data of the file.

    The binary buffer begins with the file's binary chunk, if there is one. The bytes of the other
    buffers and of images in other files follow. Buffers without data, which extensions use, are
    kept as they are. The document shares the objects of the file that do not change.
    """
    buffer = GltfBuffer(accessors=list(container.items("accessors")))
    places, buffers = _merge_buffers(container, buffer)
    is_moved = any(place != (index, 0) for index, place in enumerate(places))
    views = container.items("bufferViews")
    buffer.views += [_move_view(container, view, places) for view in views] if is_moved else views
    document = {**container.document, "buffers": buffers}
    images = document.get("images")
    if isinstance(images, list):
        document["images"] = [_copy_image(container, image, buffer) for image in images]
    return document, buffer


def _merge_buffers(container: Container, buffer: GltfBuffer) -> tuple[list[_Place], list[Json]]:
    """Append the data of all buffers to `buffer`.

    Return the place of each buffer, and the entries of ``buffers`` in the copy: that of the binary
    chunk, then the buffers without data.
    """
    items = container.items("buffers")
    places: list[_Place] = []
    entries: list[Json] = [{}]
    for index, item in enumerate(items):
        has_data = "uri" in item or (index == 0 and container.binary is not None)
        if has_data:
            data = container.buffer(index, f"buffers[{index}]")
            places.append((0, buffer.append(data)))
            if index == 0:
                entries[0] = {name: value for name, value in item.items() if name != "uri"}
        else:
            places.append((len(entries), 0))
            entries.append(item)
    return places, entries


def _move_view(container: Container, view: Json, places: list[_Place]) -> Json:
    """Return a buffer view that refers to the buffers of the copy."""
    view = _move(container, view, places)
    extensions = view.get("extensions")
    if isinstance(extensions, dict):
        view["extensions"] = extensions | {
            name: _move(container, extensions[name], places)
            for name in COMPRESSION
            if type(extensions.get(name)) is dict
        }
    return view


def _move(container: Container, reference: Json, places: list[_Place]) -> Json:
    """Return an object with its ``buffer`` and ``byteOffset`` changed to those in the copy."""
    index = container.integer(reference.get("buffer"), "bufferViews.buffer")
    container.item("buffers", index, "bufferViews.buffer")
    offset = container.integer(reference.get("byteOffset", 0), "bufferViews.byteOffset")
    place, start = places[index]
    return {**reference, "buffer": place, "byteOffset": offset + start}


def _copy_image(container: Container, image: object, buffer: GltfBuffer) -> object:
    """Append the bytes of an image in another file to `buffer`; return the changed image.

    An image stays a reference to its file if the file is missing or not in the folder of the glTF
    file, or if its type is unknown: neither PNG nor JPEG, and no media type is given.
    """
    uri = image.get("uri") if isinstance(image, dict) else None
    if not isinstance(image, dict) or not isinstance(uri, str) or uri.startswith("data:"):
        return image
    try:
        data = container.read_file(uri, _MAX_IMAGE_BYTES, "images")
    except FormatError:
        return image
    found = [name for start, name in _IMAGE_TYPES.items() if data[: len(start)] == start]
    kind = found[0] if found else image.get("mimeType")
    if not isinstance(kind, str):
        return image
    rest = {name: value for name, value in image.items() if name != "uri"}
    return {**rest, "mimeType": kind, "bufferView": buffer.add_bytes(data)}
