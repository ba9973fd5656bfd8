"""The data of a page: a scene as JSON, with quantized and compressed node positions."""

import base64
import zlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray
from mograft._util.gaussian import gaussian_filter
from mograft.analysis.segmentation import kinetic_energy
from mograft.motion.motion import Motion
from mograft.viewing.figure import Figure, TimelineRow
from mograft.viewing.geometry import DrawnSkeleton, count_nodes
from mograft.viewing.objects import encode_objects
from mograft.viewing.scene import Scene

MAX_NODE_POSITIONS = 6_000_000
"""Maximum number of node positions on a page: of more, those of every n-th frame are stored."""

_MAX_CURVE_POINTS = 1_500
"""Maximum number of points of the energy curve, which is about the width of a screen in pixels."""

_CURVE_SMOOTHING_SECONDS = 0.07


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
        {
            **_encode_figure(figure, skeleton, step, donors),
            "candidates": numbers.get(id(figure.candidates)),
        }
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
    return {
        "format": "mograft.view/1",
        "height": max(each.height for each in skeletons),
        "floor": min(each.floor for each in skeletons),
        "follow": True,
        "note": note,
        "shown": len(clips) if n_shown is None else n_shown,
        "groups": list(scene.groups),
        "candidates": [
            {group: _with_numbers(own, donors) for group, own in table.items()}
            for table in tables.values()
        ],
        "objects": objects,
        "donors": list(donors),
        "clips": clips,
    }


def _encode_figure(
    figure: Figure, skeleton: DrawnSkeleton, step: int, donors: dict[str, int]
) -> dict[str, Any]:
    """Return a figure as a dict for JSON; `skeleton` has its positions in every `step`-th frame.

    `donors` maps names of donor clips to numbers. The figure's donor clips that it does not contain
    are added to it, with the next numbers.
    """
    return {
        "name": figure.name,
        **_encode_poses(skeleton, figure.motion, step),
        "tips": skeleton.tips,
        "groups": list(figure.members),
        "group": figure.group_of_nodes(skeleton.parents),
        "energy": _energy_curve(figure.motion),
        "command": figure.command,
        "rows": [_encode_row(row, donors) for row in figure.rows],
    }


def _encode_poses(skeleton: DrawnSkeleton, motion: Motion, step: int) -> dict[str, Any]:
    """Return a figure's bones and poses; `skeleton` has the positions of every `step`-th frame."""
    stored = skeleton.positions
    unit, path, pose = quantize(stored, skeleton.root, skeleton.height)
    return {
        "frames": motion.n_frames,
        "dt": motion.frame_time,
        "step": step,
        "kept": len(stored),
        "nodes": stored.shape[1],
        "parents": skeleton.parents,
        "width": skeleton.widths,
        "unit": unit,
        "path": _compress(path.astype("<f4").tobytes()),
        "pose": _compress(pose),
    }


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
    return {
        "group": row.group,
        "grafted": any(part.clip is not None for part in parts),
        "start": [part.start for part in parts],
        "stop": [part.stop for part in parts],
        "cluster": [part.cluster for part in parts],
        "source": [
            donors.setdefault(part.clip, len(donors)) if part.clip and part.is_exchanged else -1
            for part in parts
        ],
        "first": [part.donor_start for part in parts],
        "last": [part.donor_stop for part in parts],
        "stretch": np.round([part.stretch for part in parts], 4).tolist(),
        "before": before,
        "after": after,
        "others": [part.n_alternatives for part in parts],
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
