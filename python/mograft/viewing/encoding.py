"""The data of a page: a scene as JSON, with quantized and compressed node positions."""

import base64
import zlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.gaussian import gaussian_filter
from mograft._util.runs import find_runs
from mograft.analysis.segmentation import kinetic_energy
from mograft.body.mass import mass_model, up_axis
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.search.constraints import Constraint
from mograft.search.obstacles import Box, Capsule, Character, HalfSpace, Obstacle, Sphere
from mograft.search.pose_constraints import Avoid, Face, KeepOut, Reach
from mograft.viewing.character import find_characters
from mograft.viewing.figure import Figure, ShownConstraint, TimelineRow
from mograft.viewing.geometry import DrawnSkeleton
from mograft.viewing.scene import Scene

MAX_ROTATIONS = 6_000_000
"""Maximum number of joint rotations on a page: of more, those of every n-th frame are stored."""

_ROTATION_UNIT = 2.0**-17
"""Step to which the components of unit quaternions are rounded."""

_MESH_PRECISION = 1 / 16
"""Steps of rotations and positions of a mesh, relative to those of capsules."""

_MAX_CURVE_POINTS = 1_500
"""Maximum number of points of the energy curve, which is about the width of a screen in pixels."""

_CURVE_SMOOTHING_SECONDS = 0.07

_FACE_TARGET_RADIUS = 0.02
"""Radius of the mark of a `Face` target, in heights."""


def encode_scene(
    scene: Scene, max_rotations: int = MAX_ROTATIONS, n_shown: int | None = None
) -> dict[str, Any]:
    """Return a scene as a dict for JSON, which the script of the page reads.

    If all frames together have more than `max_rotations` joint rotations, only every n-th frame is
    stored, with the smallest n that suffices. Donors that the page does not show as figures have
    at most a fifteenth of this number. The page shows the first `n_shown` figures until the reader
    chooses others; None means all.
    """
    objects = encode_objects(scene.constraints)
    motions = [figure.motion for figure in scene.figures]
    motions += [own["clip"].motion for own in objects if own["kind"] == "figure"]
    total = sum(motion.n_frames * motion.n_joints for motion in motions)
    step = max(1, -(-total // max_rotations))
    skeletons = [DrawnSkeleton.of(figure.motion) for figure in scene.figures]
    donors: dict[str, int] = {}
    listed = {id(own.candidates): own for own in scene.figures if own.candidates}
    numbers = {key: number for number, key in enumerate(listed)}
    paths = [(figure.motion.path, figure.motion.skeleton) for figure in scene.figures]
    characters, worn, notes = find_characters(paths, scene.character)
    clips = [
        _encode_figure(figure, skeleton, (step, 1.0 if number is None else _MESH_PRECISION), donors)
        | {"candidates": numbers.get(id(figure.candidates)), "character": number}
        for figure, skeleton, number in zip(scene.figures, skeletons, worn, strict=True)
    ]
    for own in objects:
        if own["kind"] == "figure":
            own["clip"] = _encode_character(own["clip"], own.pop("to_page"), step)
    if step > 1:
        note = f"Long motions: every {_ordinal(step)} frame is stored, the others are interpolated."
        notes.append(note)
    candidates = [
        {group: _with_numbers(table, donors) for group, table in (own.candidates or {}).items()}
        for own in listed.values()
    ]
    shown = len(clips) if n_shown is None else n_shown
    return {
        "format": "mograft.view/2",
        "height": max(each.height for each in skeletons),
        "floor": min(each.floor for each in skeletons),
        **{"note": " ".join(notes), "shown": shown, "groups": list(scene.groups)},
        "characters": characters,
        "windows": _encode_windows(list(listed.values()), scene, max_rotations // 15),
        **{"candidates": candidates, "objects": objects, "donors": list(donors), "clips": clips},
    }


def encode_figure(figure: Figure, *, is_mesh: bool) -> dict[str, Any]:
    """Return a single figure as a dict for JSON, with all its frames.

    ``donors`` has the clips of its `source` numbers. `is_mesh` is whether a mesh shows it.
    """
    skeleton, donors = DrawnSkeleton.of(figure.motion), dict[str, int]()
    own = _encode_figure(figure, skeleton, (1, _MESH_PRECISION if is_mesh else 1.0), donors)
    return {**own, "donors": list(donors), "height": skeleton.height, "floor": skeleton.floor}


def encode_change(old: Motion, figure: Figure, *, is_mesh: bool) -> dict[str, Any] | None:
    """Return what differs between a motion, whose figure a page has, and the figure of another one.

    ``patch`` has the rotations and positions from the first to the last frame that differs, of the
    joints that a page has of `old`; None if the two are the same. The result is None if the page
    needs the whole figure.
    """
    new, donors = figure.motion, dict[str, int]()
    is_known = old.rotations.shape == new.rotations.shape
    if not is_known or not np.array_equal(old.is_translated, new.is_translated):
        return None
    turns, places = old.rotations != new.rotations, old.positions != new.positions
    frames = np.flatnonzero(turns.any(axis=(1, 2)) | places.any(axis=(1, 2)))
    joints = _turning_joints(old.rotations)
    if not np.array_equal(joints, _turning_joints(new.rotations)):
        return None
    patch = None
    if len(frames):
        first, last = int(frames[0]), int(frames[-1])
        precision, height = _MESH_PRECISION if is_mesh else 1.0, mass_model(new.skeleton).height
        units = (precision * _ROTATION_UNIT, precision * 1e-4 * height)
        part = np.arange(first, last + 1)
        patch = {"first": first, "last": last, **_encode_frames(new, part, units, turning=joints)}
    rows = [_encode_row(row, donors) for row in figure.rows]
    return {"patch": patch, "rows": rows, "donors": list(donors), "energy": _energy_curve(new)}


def _turning_joints(turns: FloatArray) -> IntArray:
    """Return the joints that have a rotation in any frame, given (n_frames, n_joints, 4)."""
    return np.flatnonzero((turns != rotations.IDENTITY).any(axis=(0, 2)))


def encode_window(motion: Motion, first: int, last: int) -> dict[str, Any]:
    """Return the rotations of all joints in a part of a clip, without the path of the root."""
    mask = np.zeros(motion.n_frames, bool)
    mask[first : last + 1] = True
    return _encode_spans(motion, mask)


def _encode_spans(motion: Motion, mask: BoolArray) -> dict[str, Any]:
    """Return the rotations of all joints in some frames, (n_frames,), without the root's path."""
    start, stop = find_runs(mask).T
    joints: IntArray = np.arange(1, motion.n_joints)
    packed = _encode_frames(motion, np.flatnonzero(mask), (_ROTATION_UNIT, 1e-3), joints)
    return {**packed, "step": 1, "start": start.tolist(), "stop": (stop - 1).tolist()}


def _encode_figure(
    figure: Figure, skeleton: DrawnSkeleton, steps: tuple[int, float], donors: dict[str, int]
) -> dict[str, Any]:
    """Return a figure as a dict for JSON.

    `donors` maps names of donor clips to numbers. The figure's donor clips that it does not contain
    are added to it, with the next numbers.
    """
    poses, groups = _encode_motion(figure.motion, skeleton, *steps), list(figure.members)
    return {"name": figure.name, **poses, "tips": skeleton.tips, "groups": groups} | {
        "group": figure.group_of_nodes(skeleton.parents),
        "energy": _energy_curve(figure.motion),
        **{"command": figure.command, "keep": figure.keep, "note": figure.note},
        "isGraft": any(clip is not None for row in figure.rows for clip in row.parts["clip"]),
        "rows": [_encode_row(row, donors) for row in figure.rows],
    }


def _encode_motion(
    motion: Motion, drawn: DrawnSkeleton, step: int, precision: float = 1.0
) -> dict[str, Any]:
    """Return a skeleton with its shapes, and the rotations of every `step`-th frame.

    `precision` is that of rotations and positions, relative to that of capsules.
    """
    skeleton, frames = motion.skeleton, np.arange(0, motion.n_frames, step)
    units = (precision * _ROTATION_UNIT, precision * 1e-4 * drawn.height)
    return {
        **{"frames": motion.n_frames, "dt": motion.frame_time},
        **_encode_frames(motion, frames, units),
        **{"step": step, "parents": skeleton.parents.tolist(), "root": drawn.root},
        "offsets": _numbers(skeleton.offsets.ravel()),
        "ends": [[joint, *_numbers(offset)] for joint, offset in drawn.ends],
        "bones": [
            [bone.joint, *_numbers(bone.end), float(f"{bone.radius:.6g}"), bone.kind]
            for bone in drawn.bones
        ],
        "turn": _numbers(rotations.from_matrices(drawn.to_y_up)),
        "place": [0.0, 0.0, 0.0],
    }


def _encode_frames(
    motion: Motion,
    frames: IntArray,
    units: tuple[float, float],
    joints: IntArray | None = None,
    turning: IntArray | None = None,
) -> dict[str, Any]:
    """Return the rotations of some joints in some frames, and the positions that vary.

    `joints` are by default all. Rotations that are zero in all these frames are left out, unless
    `turning` has the joints whose rotations are returned.
    """
    joints = np.arange(motion.n_joints) if joints is None else joints
    if turning is None:
        turning = joints[_turning_joints(motion.rotations[frames][:, joints])]
    turns = motion.rotations[frames][:, turning]
    moving = joints[motion.is_translated[joints] | (joints == 0)]
    tracks = [
        rotations.continuous_signs(turns).reshape(len(frames), -1),
        motion.positions[frames][:, moving].reshape(len(frames), -1),
    ]
    steps, pose = quantize(tracks, units)
    packed = {"units": steps, "pose": _compress(pose)}
    named = {"turning": turning.tolist(), "moving": moving.tolist()}
    return {"kept": len(frames), **named, **packed}


def _encode_windows(figures: Sequence[Figure], scene: Scene, max_rotations: int) -> dict[str, Any]:
    """Return the frames of listed donors by the name of their clip, the cheapest of each first.

    Clips that the page shows are left out. At most `max_rotations` joint rotations are included.
    """
    shown = {own.name for own in scene.figures if own.candidates is None}
    found: dict[str, tuple[Motion, BoolArray]] = {}
    listed = []
    for figure in figures:
        for table in (figure.candidates or {}).values():
            ranks = np.concatenate([np.arange(count) for count in (0, *table["counts"])]).tolist()
            spans = zip(ranks, table["source"], table["first"], table["last"], strict=True)
            listed += [(*span, figure.clip_of) for span in spans if span[1] not in shown]
    for _, name, first, last, clip_of in sorted(listed, key=lambda own: own[0]):
        if clip_of is None:
            continue
        if name not in found:
            motion = clip_of(name)
            found[name] = motion, np.zeros(motion.n_frames, bool)
        motion, mask = found[name]
        max_rotations -= motion.n_joints * int((~mask[first : last + 1]).sum())
        if max_rotations < 0:
            break
        mask[first : last + 1] = True
    return {name: _encode_spans(*own) for name, own in found.items() if own[1].any()}


def _with_numbers(listed: Mapping[str, list[Any]], donors: dict[str, int]) -> dict[str, Any]:
    """Return candidates of `CandidateTable` with the numbers in `donors` in place of clip names."""
    source = [donors.setdefault(clip, len(donors)) for clip in listed["source"]]
    return {**listed, "source": source}


def quantize(tracks: Sequence[FloatArray], units: Sequence[float]) -> tuple[list[float], bytes]:
    """Encode arrays of shape (n_frames, n_tracks) in few bytes; return the steps and the bytes.

    The values of array i are rounded to multiples of `units[i]`, or of a larger step if they exceed
    four million steps. Each value is replaced by its second difference in time. A difference d ≥ 0
    becomes the unsigned integer 2d, and d < 0 becomes -2d - 1, with 24 bits. All low bytes precede
    all middle bytes and these all high bytes, because zlib compresses this order best.
    """
    steps = [
        max(unit, float(np.abs(own).max(initial=0.0)) / 4_000_000)
        for own, unit in zip(tracks, units, strict=True)
    ]
    scaled = [own / step for own, step in zip(tracks, steps, strict=True)]
    integers = np.concatenate(scaled, axis=1).round().astype(np.int32)
    velocity = np.diff(integers, axis=0, prepend=np.zeros_like(integers[:1]))
    change = np.diff(velocity, axis=0, prepend=np.zeros_like(integers[:1]))
    # Differences overflow 24 bits as the sums in the page's script do, so that both cancel.
    change = (change << 8) >> 8
    folded = ((change << 1) ^ (change >> 31)).T
    return steps, b"".join((folded >> shift).astype(np.uint8).tobytes() for shift in (0, 8, 16))


def _compress(data: bytes) -> str:
    """Return bytes compressed by zlib, as base64 text.

    The search for repetitions is limited to runs of one byte (``Z_RLE``): differences of positions
    hardly repeat, except for zeros. The time is a seventh of that of a full search, and the result
    is 5 % smaller.
    """
    packer = zlib.compressobj(9, zlib.DEFLATED, zlib.MAX_WBITS, 9, zlib.Z_RLE)
    return base64.b64encode(packer.compress(data) + packer.flush()).decode("ascii")


def _encode_row(row: TimelineRow, donors: dict[str, int]) -> dict[str, Any]:
    parts = row.parts
    source = [
        donors.setdefault(clip, len(donors)) if clip and is_exchanged else -1
        for clip, is_exchanged in zip(parts["clip"], parts["is_exchanged"], strict=True)
    ]
    return {
        "group": row.group,
        "grafted": any(clip is not None for clip in parts["clip"]),
        **{name: parts[name] for name in ("start", "stop", "cluster")},
        **{"source": source, "first": parts["first"], "last": parts["last"]},
        "stretch": np.round(parts["stretch"], 4).tolist(),
        **{name: parts[name] for name in ("before", "after", "others")},
        "changes": [
            {**own, "source": donors.setdefault(own["source"], len(donors))} for own in row.changes
        ],
    }


def _energy_curve(motion: Motion) -> list[int]:
    """Return the smoothed kinetic energy at equally spaced frames, scaled to 0 to 255.

    Values above the 99th percentile are 255.
    """
    if motion.n_frames < 2:
        return []
    energy = gaussian_filter(kinetic_energy(motion), _CURVE_SMOOTHING_SECONDS * motion.rate)
    n_points = min(len(energy), _MAX_CURVE_POINTS)
    frames = np.linspace(0, len(energy) - 1, n_points).round().astype(int)
    # The scale ends at the 99th percentile, as single high peaks would flatten the curve.
    top = float(np.percentile(energy, 99)) or 1.0
    return np.round(255 * np.clip(energy[frames] / top, 0, 1)).astype(int).tolist()


def _ordinal(number: int) -> str:
    ending = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{'th' if number // 10 % 10 == 1 else ending}"


def encode_objects(shown: Iterable[ShownConstraint]) -> list[dict[str, Any]]:
    """Return the obstacles and targets as dicts for JSON, with positions in the axes of the page.

    Constraints without a place in the world are omitted. A dict of kind ``"figure"`` has the
    `Character` under ``"clip"`` and the rotation matrix to the page's axes under ``"to_page"``,
    which the caller must encode.
    """
    objects = []
    for constraint, motion in shown:
        to_page = DrawnSkeleton.of(motion[:1]).to_y_up
        shape = _encode_shape(constraint, motion, to_page)
        if shape is not None:
            frames = None if constraint.frames is None else list(constraint.frames)
            objects.append({**shape, "frames": frames, "label": _label(constraint)})
    return objects


def _encode_shape(
    constraint: Constraint, motion: Motion, to_page: FloatArray
) -> dict[str, Any] | None:
    if isinstance(constraint, Avoid):
        return _encode_obstacle(constraint.obstacle, to_page)
    if isinstance(constraint, KeepOut):
        return _encode_obstacle(constraint.region, to_page)
    if isinstance(constraint, Reach):
        center, size = constraint.targets(motion)[0], constraint.tolerance
    elif isinstance(constraint, Face):
        center, size = np.array(constraint.target), _FACE_TARGET_RADIUS
    else:
        return None
    return {
        "kind": "target",
        "center": _numbers(to_page @ center),
        "radius": float(size * mass_model(motion.skeleton).height),
        "joint": _joint(constraint.joint, motion.skeleton),
    }


def _joint(name: str | None, skeleton: Skeleton) -> int:
    """Return the index of a joint, by default of the head; -1 if there is none."""
    if name is not None:
        return skeleton.index(name)
    head = mass_model(skeleton).head
    return -1 if head is None else head


def _label(constraint: Constraint) -> str:
    frames = ""
    if constraint.frames is not None:
        first, last = constraint.frames
        frames = f", frame {first}" if first == last else f", frames {first}\N{EN DASH}{last}"
    if isinstance(constraint, Reach):
        return f"{constraint.joint}{frames}"
    if isinstance(constraint, Face):
        return f"face{frames}"
    if isinstance(constraint, KeepOut):
        return f"{constraint.joint} {'inside' if constraint.inside else 'outside'}{frames}"
    return frames.removeprefix(", ")


def _encode_obstacle(obstacle: Obstacle, to_page: FloatArray) -> dict[str, Any] | None:
    """Return an obstacle as a dict, or None if its class is unknown."""

    def place(center: npt.ArrayLike, turn: FloatArray | None = None) -> dict[str, list[float]]:
        found = {"center": _numbers(to_page @ np.asarray(center, float))}
        if turn is not None:
            found["turn"] = _numbers(rotations.multiply(rotations.from_matrices(to_page), turn))
        return found

    if isinstance(obstacle, Sphere):
        return {"kind": "sphere", **place(obstacle.center), "radius": obstacle.radius}
    if isinstance(obstacle, Capsule):
        start, stop = np.array([obstacle.start, obstacle.stop], float)
        turn = rotations.shortest_arc(np.array([0.0, 1.0, 0.0]), stop - start)
        size = {"radius": obstacle.radius, "length": float(np.linalg.norm(stop - start))}
        return {"kind": "capsule", **place((start + stop) / 2, turn), **size}
    if isinstance(obstacle, Box):
        turn = np.array(obstacle.rotation, float)
        return {"kind": "box", **place(obstacle.center, turn), "half": list(obstacle.half)}
    if isinstance(obstacle, HalfSpace):
        turn = rotations.shortest_arc(np.array([0.0, 0.0, 1.0]), np.array(obstacle.normal, float))
        return {"kind": "plane", **place(obstacle.point, turn)}
    if isinstance(obstacle, Character):
        return {"kind": "figure", "delay": obstacle.delay, "clip": obstacle, "to_page": to_page}
    return None


def _encode_character(own: Character, to_page: FloatArray, step: int) -> dict[str, Any]:
    """Return the motion of a character, placed in the axes of the page."""
    drawn = DrawnSkeleton.of(own.motion)
    yaw = rotations.exp(own.yaw * np.eye(3)[up_axis(own.motion)])
    turn = rotations.multiply(rotations.from_matrices(to_page), yaw)
    place = {"turn": _numbers(turn), "place": _numbers(to_page @ np.array(own.offset, float))}
    return _encode_motion(own.motion, drawn, step) | place | {"character": None}


def _numbers(values: FloatArray) -> list[float]:
    return [float(f"{value:.6g}") for value in values.tolist()]
