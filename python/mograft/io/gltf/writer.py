"""New animations in a copy of a glTF file."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft._util.atomic import write_bytes
from mograft._util.names import unique_names
from mograft._util.validate import check_type
from mograft.errors import DAMAGE, SkeletonMismatchError, suggest_name
from mograft.io.export_figure import ROTATIONS_TO_Y_UP
from mograft.io.glb import GltfBuffer, Json
from mograft.io.gltf.animation import PATH_WIDTHS, Animation, animation_names
from mograft.io.gltf.copy_content import copy_content
from mograft.io.gltf.document import GltfFile, read_gltf_file
from mograft.io.gltf.grafts import complete, find_original, provenance, with_provenance
from mograft.io.gltf.nodes import SCALE_TOLERANCE, Transforms, remove_mirroring, to_matrices
from mograft.io.rest_pose import POSITION_TOLERANCE, restore
from mograft.motion import rotations
from mograft.motion.motion import Motion, as_motions
from mograft.motion.skeleton import Skeleton

_REMEDY = (
    "; export each file by itself, or graft them together with --match anatomy (match='anatomy')"
)
_NEGLIGIBLE_BONE = 0.02
"""Length of bones whose direction is not compared, as a fraction of the extent of the rest pose."""

_MIN_COSINE = np.cos(np.radians(10.0))
"""Of the angle between bones in two rest poses that count as equal."""


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
    provenance: str | None = None  # the text of a JSON document, if the motion is a graft


def fit_motion(file: GltfFile, motion: Motion) -> Motion:
    """Return a motion in the unit and the axes of a file that has the same joints.

    Bones get the lengths that they have in the file. Raises SkeletonMismatchError if the joints
    differ, or the directions of bones in the rest pose.
    """
    name, rest = motion.name or "a motion", file.rest
    try:
        Skeleton(rest.names, rest.parents, rest.offsets).check_same_hierarchy(motion.skeleton, name)
    except SkeletonMismatchError as error:
        raise SkeletonMismatchError(f"{error}, unlike {file.container.path}{_REMEDY}") from None
    reach = _NEGLIGIBLE_BONE * rest.extent
    for turn in (rotations.IDENTITY, *ROTATIONS_TO_Y_UP):
        own, wanted = rotations.rotate(turn, motion.skeleton.offsets[1:]), rest.offsets[1:]
        products, size = (own * wanted).sum(axis=1), float((own * own).sum())
        scale = float(products.sum()) / size if size else 1.0
        lengths = np.linalg.norm(wanted, axis=1)
        areas = np.maximum(np.linalg.norm(own, axis=1) * lengths, 1e-300)
        cosines = (products / areas)[lengths > reach]
        if scale > 0 and cosines.min(initial=1.0) >= _MIN_COSINE:
            return transform(motion, rest.offsets, turn, scale)
    other = f"has another rest pose than {file.container.path}, so that its rotations do not fit"
    raise SkeletonMismatchError(f"{name} {other}{_REMEDY}")


def transform(motion: Motion, offsets: FloatArray, turn: FloatArray, scale: float) -> Motion:
    """Return a motion, with its rest pose, turned and scaled, and with the given offsets."""
    old = motion.skeleton.offsets
    difference = np.abs(old[1:] - offsets[1:]).max(initial=0.0)
    if abs(scale - 1.0) < 1e-6 and difference <= 1e-6 * np.abs(offsets).max(initial=0.0):
        return motion
    turned = rotations.multiply(turn, motion.rotations)
    quats = rotations.multiply(turned, rotations.inverse(turn))
    positions = scale * rotations.rotate(turn, motion.positions - old)
    positions[:, 1:] += offsets[1:]
    positions[:, 0] += scale * rotations.rotate(turn, old[0])
    skeleton = replace(motion.skeleton, offsets=offsets, end_sites=())
    return replace(
        motion, skeleton=skeleton, rotations=quats, positions=positions, channel_values=None
    )


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
    file: GltfFile,
    additions: Sequence[Addition],
    *,
    kept: Sequence[Json] | None = None,
    is_update: bool = False,
) -> tuple[tuple[str, ...], bytes]:
    """Return the names of the new animations, and the bytes of the GLB file that has them.

    `kept` are the animations of the file that stay, by default all. If `is_update` is true, a new
    animation takes the place of one that has its name; otherwise it gets another name.
    """
    skeleton = Skeleton(file.rest.names, file.rest.parents, file.rest.offsets)
    for addition in additions:
        motion = addition.motion
        skeleton.check_same_hierarchy(motion.skeleton, motion.name or "a motion")
    document, buffer = copy_content(file.container)
    original = find_original(file.container, buffer)
    before = file.container.items("animations")
    animations = list(before if kept is None else kept)
    present = animation_names(animations)
    given = [own.motion.name or "motion" for own in additions]
    names = given if is_update else unique_names([*present, *given])[len(present) :]
    animated: set[int] = set()
    added = list(map(partial(_build_animation, file, buffer, animated), additions, names))
    document["nodes"] = _animated_nodes(file, animated)
    for own in added:
        place = present.index(own["name"]) if own["name"] in present else len(animations)
        animations[place : place + 1] = [own]
    captured = [[own for own in items if not provenance(own)] for items in (before, animations)]
    if captured[0] != captured[1]:
        original = original._replace(sha256="")
    try:
        document = complete({**document, "animations": animations}, buffer, original)
    except DAMAGE as error:
        file.container.fail("animations", f"expected samplers with input and output: {error}")
    return tuple(names), buffer.pack(document)


def _animated_nodes(file: GltfFile, animated: set[int]) -> list[Json]:
    """Return the nodes of the file; matrices of `animated` become translation, rotation and scale.

    glTF forbids matrices in animated nodes.
    """
    nodes, rest = list(file.container.items("nodes")), file.tree.rest
    for node in animated:
        if "matrix" in nodes[node]:
            pairs = zip(PATH_WIDTHS, rest, strict=True)
            nodes[node] = nodes[node] | {path: own[0, node].tolist() for path, own in pairs}
            del nodes[node]["matrix"]
    return nodes


def _build_animation(
    file: GltfFile, buffer: GltfBuffer, animated: set[int], addition: Addition, name: str
) -> Json:
    """Append the keys of an animation to the buffer; return the animation.

    Nodes with new keys are added to `animated`. Properties without keep the samplers of the clip.
    """
    motion, clip = addition.motion, addition.clip
    base = None if clip is None else file.read(clip)
    start = 0.0 if base is None else base.start
    times = np.linspace(start, start + motion.duration, motion.n_frames)
    tracks = _new_tracks(file, addition, base, times)
    animated.update(node for node, _ in tracks)
    channels, samplers = ([], []) if clip is None else _keep_channels(file, clip, tracks)
    ends = sorted({0, len(times) - 1})
    inputs: dict[int, int] = {}
    for (node, path), values in tracks.items():
        stored = values.astype("<f4")
        rows = np.arange(len(stored)) if (stored != stored[0]).any() else np.array(ends)
        channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
        keys = times[rows], values[rows]
        samplers.append(buffer.add_keys(*keys, inputs, interpolation="LINEAR"))
    animation = {"name": name, "channels": channels, "samplers": samplers}
    text = addition.provenance
    return animation if text is None else with_provenance(animation, text)


def _new_tracks(
    file: GltfFile, addition: Addition, animation: Animation | None, times: FloatArray
) -> dict[tuple[int, str], FloatArray]:
    """Return the tracks of a motion that it does not share with its base, the clip `animation`.

    These are the values at `times` by node and property.
    """
    motion, base = addition.motion, addition.base
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
    tracks: dict[tuple[int, str], FloatArray] = {}
    for joint, node in enumerate(file.joints.tolist()):
        if is_moved[joint]:
            tracks[node, "translation"] = translations[:, joint]
        if is_turned[joint]:
            tracks[node, "rotation"] = quats[:, joint]
    return tracks


def _keep_channels(
    file: GltfFile, clip: int, tracks: dict[tuple[int, str], FloatArray]
) -> tuple[list[Json], list[Json]]:
    """Return the channels of a clip that have no new tracks, and their samplers."""
    number = file.animations[clip]
    base = file.container.items("animations")[number]
    channels: list[Json] = []
    kept: dict[int, int] = {}  # index of each kept sampler of the clip
    for channel in base["channels"]:
        target, index = channel["target"], channel.get("sampler")
        if (target.get("node"), target.get("path")) in tracks:
            continue
        place = f"animations[{number}].channels"
        file.container.choose(base["samplers"], index, place, "samplers")
        channels.append({**channel, "sampler": kept.setdefault(index, len(kept))})
    return channels, [base["samplers"][index] for index in kept]


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
    # Of each node: world rotation without mirroring, axes with scale as columns, position. The last
    # entry is that above the first node, whose parent is -1.
    turns = np.tile(rotations.IDENTITY, (len(parents) + 1, n_frames, 1))
    axes = np.tile(np.eye(3), (len(parents) + 1, n_frames, 1, 1))
    places = np.zeros((len(parents) + 1, n_frames, 3))
    for node, parent in enumerate(parents):
        joint, mirror = node - n_above, half_turns[:, node]
        above, base, origin = turns[parent], axes[parent], places[parent]
        if joint < 0:
            own, shift = nodes.rotations[:, node], nodes.translations[:, node]
            turns[node] = rotations.multiply(above, rotations.multiply(own, mirror))
            places[node] = origin + np.einsum("fij,fj->fi", base, shift)
        else:
            turns[node], places[node] = world_turns[:, joint], world_places[:, joint]
            own = rotations.multiply(rotations.inverse(above), turns[node])
            own = rotations.multiply(own, rotations.inverse(mirror))
            quats[:, joint] = own
            fallback = nodes.translations[:, node]
            shifts[:, joint] = _solve(base, places[node] - origin, fallback)
        axes[node] = base @ (to_matrices(own) * nodes.scales[:, node, None, :])
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
