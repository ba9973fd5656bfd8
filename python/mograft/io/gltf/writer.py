"""New animations in a copy of a glTF file."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray
from mograft._util.atomic import write_bytes
from mograft._util.names import unique_names
from mograft._util.validate import check_type
from mograft.errors import suggest_name
from mograft.io.gltf.animation import PATH_WIDTHS, Animation, read_animation
from mograft.io.gltf.buffer import GltfBuffer
from mograft.io.gltf.copying import copy_content
from mograft.io.gltf.document import GltfFile, read_gltf_file
from mograft.io.gltf.local_tracks import (
    changed_tracks,
    differs_from_rest,
    frame_times,
    local_tracks,
)
from mograft.io.gltf.sampling import sample
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

Json = dict[str, Any]


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
    given = [motions] if isinstance(motions, Motion) else list(motions)
    for motion in given:
        check_type("motions", motion, Motion)
    if not given:
        raise ValueError("`motions` must hold at least one motion, got none")
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


def find_base_clip(file: GltfFile, base: Motion) -> int:
    """Return the index of the clip with the name of `base`.

    Raises ValueError if no clip has the name, or its duration differs from that of `base`.
    """
    name = base.name if base.clip is None else base.clip
    if name not in file.clip_names:
        hint = suggest_name(name, file.clip_names)
        raise ValueError(
            f"`bases` must be clips of {file.container.path}, which has no {name!r}{hint}"
        )
    clip = file.clip_names.index(name)
    if not has_duration(file, clip, base):
        raise ValueError(
            f"`bases` must be clips of {file.container.path}, whose clip {name} does not last "
            f"{base.duration:.6g} s"
        )
    return clip


def has_duration(file: GltfFile, clip: int, base: Motion) -> bool:
    """Return whether the durations of a motion and a clip differ by at most a quarter frame."""
    animation = _read_base(file, clip)
    difference = abs(base.duration - (animation.stop - animation.start))
    return difference <= 0.25 * base.frame_time


def _add(file: GltfFile, motion: Motion, base: Motion | None) -> Addition:
    """Check a motion and its base, and return the addition of the motion."""
    if base is None:
        return Addition(motion)
    check_type("bases", base, Motion)
    if (base.n_frames, base.n_joints) != (motion.n_frames, motion.n_joints):
        raise ValueError(
            f"`bases` must have as many frames and joints as their motions, {motion.n_frames} and "
            f"{motion.n_joints}, got {base.n_frames} and {base.n_joints}"
        )
    return Addition(motion, base, find_base_clip(file, base))


def _read_base(file: GltfFile, clip: int) -> Animation:
    return read_animation(
        file.container, file.animations[clip], frozenset(file.moved_nodes.tolist())
    )


def append_animations(
    file: GltfFile, additions: Sequence[Addition]
) -> tuple[tuple[str, ...], bytes]:
    """Return the names of the new animations, and the bytes of the GLB file that has them."""
    skeleton = Skeleton(file.rest.names, file.rest.parents, file.rest.offsets)
    for addition in additions:
        motion = addition.motion
        skeleton.check_same_hierarchy(motion.skeleton, motion.name or "a motion")
    document, buffer = copy_content(file.container)
    old = file.container.items("animations")
    names = [own["name"] if isinstance(own.get("name"), str) else "" for own in old]
    names = unique_names([*names, *(own.motion.name or "motion" for own in additions)])[len(old) :]
    tables = [_new_tables(file, addition) for addition in additions]
    document["nodes"] = _animated_nodes(file, {node for table in tables for node, _ in table.keys})
    document["animations"] = [
        *old,
        *(
            _build_animation(file, buffer, table, addition.clip, name)
            for table, addition, name in zip(tables, additions, names, strict=True)
        ),
    ]
    return tuple(names), buffer.pack(document)


@dataclass(frozen=True, eq=False)
class _NewTables:
    """The new tracks of an animation."""

    times: FloatArray  # seconds, shape (n_frames,)
    keys: dict[tuple[int, str], FloatArray]  # values in every frame, by node and property


def _new_tables(file: GltfFile, addition: Addition) -> _NewTables:
    """Return the tracks of a motion that it does not share with its base clip."""
    motion, nodes = addition.motion, file.moved_nodes
    rest = file.moved_rest
    if addition.clip is None or addition.base is None:
        times = frame_times(0.0, motion)
        tracks = local_tracks(file, motion, rest.of(np.arange(len(nodes)), motion.n_frames))
        is_turned = np.ones(motion.n_joints, bool)
        is_moved = differs_from_rest(file, tracks)
    else:
        animation = _read_base(file, addition.clip)
        times = frame_times(animation.start, motion)
        local = sample(animation, times, rest, file.moved_rows)
        tracks = local_tracks(file, motion, local)
        is_turned, is_moved = changed_tracks(file, motion, addition.base, local.scales)
    values: dict[tuple[int, str], FloatArray] = {}
    for joint, node in enumerate(file.joints.tolist()):
        if is_moved[joint]:
            values[node, "translation"] = tracks.translations[:, joint]
        if is_turned[joint]:
            values[node, "rotation"] = tracks.rotations[:, joint]
    return _NewTables(times, values)


def _animated_nodes(file: GltfFile, animated: set[int]) -> list[Json]:
    """Return the nodes of the file; matrices of `animated` become translation, rotation and scale.

    glTF forbids matrices in animated nodes.
    """
    nodes = list(file.container.items("nodes"))
    rest = file.tree.rest
    for node in animated:
        if "matrix" in nodes[node]:
            kept = {name: value for name, value in nodes[node].items() if name != "matrix"}
            nodes[node] = kept | {
                "translation": rest.translations[0, node].tolist(),
                "rotation": rest.rotations[0, node].tolist(),
                "scale": rest.scales[0, node].tolist(),
            }
    return nodes


def _build_animation(
    file: GltfFile, buffer: GltfBuffer, tables: _NewTables, clip: int | None, name: str
) -> Json:
    """Append the keys of an animation to the buffer; return the animation.

    Properties without new keys keep the samplers of the clip.
    """
    samplers: list[Json] = []
    channels: list[Json] = []
    if clip is not None:
        _keep_channels(file, clip, tables, samplers, channels)
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
        n_samplers = len(base["samplers"])
        if type(index) is not int or not 0 <= index < n_samplers:
            file.container.fail(
                f"animations[{number}].channels",
                f"expected an index of {n_samplers} samplers, got {index!r}",
            )
        if index not in kept:
            kept[index] = len(samplers)
            samplers.append(base["samplers"][index])
        channels.append({**channel, "sampler": kept[index]})
