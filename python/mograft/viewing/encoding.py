"""The data of a page: a scene as JSON, with quantized and compressed node positions."""

import base64
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray
from mograft._util.gaussian import gaussian_filter
from mograft.analysis.segmentation import kinetic_energy
from mograft.body.mass import mass_model, up_axis
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.search.constraints import Constraint
from mograft.search.obstacles import Box, Capsule, Character, HalfSpace, Obstacle, Sphere
from mograft.search.pose_constraints import Avoid, Face, KeepOut, Reach
from mograft.viewing.figure import Figure, ShownConstraint, TimelineRow
from mograft.viewing.geometry import DrawnSkeleton, count_nodes
from mograft.viewing.scene import Scene

MAX_NODE_POSITIONS = 6_000_000
"""Maximum number of node positions on a page: of more, those of every n-th frame are stored."""

_MAX_CURVE_POINTS = 1_500
"""Maximum number of points of the energy curve, which is about the width of a screen in pixels."""

_CURVE_SMOOTHING_SECONDS = 0.07

_FACE_TARGET_RADIUS = 0.02
"""Radius of the mark of a `Face` target, in heights."""


def encode_scene(
    scene: Scene, max_positions: int = MAX_NODE_POSITIONS, n_shown: int | None = None
) -> dict[str, Any]:
    """Return a scene as a dict for JSON, which the script of the page reads.

    The y axis of positions points up. If all frames together have more than `max_positions` node
    positions, only every n-th frame is stored, with the smallest n that suffices. The page shows
    the first `n_shown` figures until the reader chooses others; None means all.
    """
    objects = encode_objects(scene.constraints)
    motions = [figure.motion for figure in scene.figures]
    motions += [own["clip"][1] for own in objects if own["kind"] == "figure"]
    total = sum(motion.n_frames * count_nodes(motion) for motion in motions)
    step = max(1, -(-total // max_positions))
    skeletons = [DrawnSkeleton.of(figure.motion, step) for figure in scene.figures]
    donors: dict[str, int] = {}
    tables = {id(own.candidates): own.candidates for own in scene.figures if own.candidates}
    numbers = {key: number for number, key in enumerate(tables)}
    clips = [
        _encode_figure(figure, skeleton, step, donors)
        | {"candidates": numbers.get(id(figure.candidates))}
        for figure, skeleton in zip(scene.figures, skeletons, strict=True)
    ]
    for own in objects:
        if own["kind"] == "figure":
            skeleton, motion = own["clip"]
            stored = replace(skeleton, positions=skeleton.positions[::step])
            own["clip"] = _encode_poses(stored, motion, step)
    note = ""
    if step > 1:
        note = f"Long motions: every {_ordinal(step)} frame is stored, the others are interpolated."
    candidates = [
        {group: _with_numbers(own, donors) for group, own in table.items()}
        for table in tables.values()
    ]
    shown = len(clips) if n_shown is None else n_shown
    return {
        "format": "mograft.view/1",
        "height": max(each.height for each in skeletons),
        "floor": min(each.floor for each in skeletons),
        **{"follow": True, "note": note, "shown": shown, "groups": list(scene.groups)},
        **{"candidates": candidates, "objects": objects, "donors": list(donors), "clips": clips},
    }


def _encode_figure(
    figure: Figure, skeleton: DrawnSkeleton, step: int, donors: dict[str, int]
) -> dict[str, Any]:
    """Return a figure as a dict for JSON; `skeleton` has its positions in every `step`-th frame.

    `donors` maps names of donor clips to numbers. The figure's donor clips that it does not contain
    are added to it, with the next numbers.
    """
    poses, groups = _encode_poses(skeleton, figure.motion, step), list(figure.members)
    return {"name": figure.name, **poses, "tips": skeleton.tips, "groups": groups} | {
        "group": figure.group_of_nodes(skeleton.parents),
        "energy": _energy_curve(figure.motion),
        "command": figure.command,
        "rows": [_encode_row(row, donors) for row in figure.rows],
    }


def _encode_poses(skeleton: DrawnSkeleton, motion: Motion, step: int) -> dict[str, Any]:
    """Return a figure's bones and poses; `skeleton` has the positions of every `step`-th frame."""
    stored = skeleton.positions
    unit, path, pose = quantize(stored, skeleton.root, skeleton.height)
    time = {"frames": motion.n_frames, "dt": motion.frame_time, "step": step, "kept": len(stored)}
    bones = {"nodes": stored.shape[1], "parents": skeleton.parents, "width": skeleton.widths}
    packed = {"path": _compress(path.astype("<f4").tobytes()), "pose": _compress(pose)}
    return {**time, **bones, "unit": unit, **packed}


def _with_numbers(listed: Mapping[str, list[Any]], donors: dict[str, int]) -> dict[str, Any]:
    """Return candidates of `CandidateTable` with the numbers in `donors` in place of clip names."""
    source = [donors.setdefault(clip, len(donors)) for clip in listed["source"]]
    return {**listed, "source": source}


def quantize(positions: FloatArray, root: int, height: float) -> tuple[float, FloatArray, bytes]:
    """Encode world positions, shape (n_frames, n_nodes, 3), in few bytes.

    Return the quantization step, the path of the node `root`, shape (n_frames, 3), rounded to
    float32, and the encoded positions of all nodes relative to this path. The relative positions
    are rounded to 16-bit multiples of the step, which is at least a ten-thousandth of the body
    height `height`. Each coordinate of each node is replaced by its second differences in time. A
    difference d ≥ 0 becomes the unsigned integer 2d, and d < 0 becomes -2d - 1. All low bytes
    precede all high bytes, because zlib compresses this order best.
    """
    path = positions[:, root].astype(np.float32).astype(np.float64)
    relative = positions - path[:, None]
    greatest = max(float(relative.max()), -float(relative.min()))
    unit = max(greatest / 32_000, 1e-4 * height)
    # In place: these are the largest arrays of a page.
    relative /= unit
    integers = np.round(relative, out=relative).astype(np.int16)
    # Differences overflow as the sums in the page's script do, so that both cancel.
    with np.errstate(over="ignore"):
        velocity = np.diff(integers, axis=0, prepend=np.zeros_like(integers[:1]))
        change = np.diff(velocity, axis=0, prepend=np.zeros_like(integers[:1]))
    folded = ((change << 1) ^ (change >> 15)).astype(np.uint16)
    tracks = np.ascontiguousarray(folded.reshape(len(folded), -1).T)
    planes = (tracks & 0xFF, tracks >> 8)
    return unit, path, b"".join(plane.astype(np.uint8).tobytes() for plane in planes)


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
    angles = zip(*(part.seam_angles for part in parts), strict=True) if parts else [(), ()]
    before, after = ([None if a is None else round(a, 2) for a in column] for column in angles)
    source = [
        donors.setdefault(part.clip, len(donors)) if part.clip and part.is_exchanged else -1
        for part in parts
    ]

    def column(name: str) -> list[Any]:
        return [getattr(part, name) for part in parts]

    return {
        "group": row.group,
        "grafted": any(part.clip is not None for part in parts),
        **{name: column(name) for name in ("start", "stop", "cluster")},
        **{"source": source, "first": column("donor_start"), "last": column("donor_stop")},
        "stretch": np.round(column("stretch"), 4).tolist(),
        **{"before": before, "after": after, "others": column("n_alternatives")},
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
    levels: list[int] = np.round(255 * np.clip(energy[frames] / top, 0, 1)).astype(int).tolist()
    return levels


def _ordinal(number: int) -> str:
    ending = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{'th' if number // 10 % 10 == 1 else ending}"


def encode_objects(shown: Iterable[ShownConstraint]) -> list[dict[str, Any]]:
    """Return the obstacles and targets as dicts for JSON, with positions in the axes of the page.

    Constraints without a place in the world are omitted. A dict of kind ``"figure"`` has the
    skeleton in these axes and the motion of a character under ``"clip"``, which the caller must
    encode.
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

    def move(position: npt.ArrayLike) -> list[float]:
        return _numbers(to_page @ np.asarray(position, float))

    if isinstance(obstacle, Sphere):
        return {"kind": "sphere", "center": move(obstacle.center), "radius": obstacle.radius}
    if isinstance(obstacle, Capsule):
        start, stop = obstacle.start, obstacle.stop
        center = move(np.mean([start, stop], axis=0))
        ends = {"start": move(start), "stop": move(stop)}
        return {"kind": "capsule", "center": center, **ends, "radius": obstacle.radius}
    if isinstance(obstacle, Box):
        signs = np.array(list(product((-1.0, 1.0), repeat=3)))
        turn = np.broadcast_to(np.array(obstacle.rotation, float), (8, 4))
        corners = rotations.rotate(turn, signs * obstacle.half) + obstacle.center
        center = move(obstacle.center)
        return {"kind": "box", "center": center, "corners": [move(corner) for corner in corners]}
    if isinstance(obstacle, HalfSpace):
        normal = to_page @ (np.array(obstacle.normal) / np.linalg.norm(obstacle.normal))
        across = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
        across /= np.linalg.norm(across)
        axes = {"normal": normal, "across": across, "along": np.cross(normal, across)}
        numbers = {name: _numbers(axis) for name, axis in axes.items()}
        return {"kind": "plane", "point": move(obstacle.point), **numbers}
    if isinstance(obstacle, Character):
        return {"kind": "figure", "delay": obstacle.delay, "clip": _character(obstacle, to_page)}
    return None


def _character(obstacle: Character, to_page: FloatArray) -> tuple[DrawnSkeleton, Motion]:
    drawn = DrawnSkeleton.of(obstacle.motion)
    world = drawn.positions @ drawn.to_y_up
    axis = np.eye(3)[up_axis(obstacle.motion)]
    turn = np.broadcast_to(rotations.exp(obstacle.yaw * axis), (*world.shape[:-1], 4))
    moved = rotations.rotate(turn, world) + np.array(obstacle.offset)
    return replace(drawn, positions=moved @ to_page.T), obstacle.motion


def _numbers(values: FloatArray) -> list[float]:
    return [float(f"{value:.6g}") for value in values.tolist()]
