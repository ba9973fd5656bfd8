"""The page on which a person labels pieces of motion as natural or unnatural (paper, 5.3)."""

import hashlib
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray
from mograft._util.validate import as_integer
from mograft.body.contacts import Ground
from mograft.body.mass import mass_model
from mograft.body.support_polygon import facing_directions
from mograft.errors import InsufficientDataError
from mograft.evaluation.baselines import Captured, Method, RandomLength, grafted_group, grafts_by
from mograft.evaluation.label_table import COLUMNS, label_row
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.synthesis.graft_result import Graft
from mograft.viewing.geometry import node_parents, node_positions
from mograft.viewing.page import Page, assemble_page, embed_json

_CONTEXT_SECONDS = 0.4  # duration of the motion that is shown before and after each piece
_FRAME_RATE = 30.0  # frame rate of the page, unless that of the library is lower
_VIEW_ANGLE = 0.6  # radians from the line of sight to the facing direction at the first frame
_UNIT = 4.0 / 32767  # skeleton heights that the 16-bit integer 1 of the page stands for
_MAX_ROUNDS = 40  # number of grafts of each clip from which pieces are drawn, at most


@dataclass(frozen=True, eq=False)
class Item:
    """A piece of a graft to label."""

    graft: Graft
    group: str
    segment: int  # base segment in the library
    donor: int
    start: int  # first frame in the graft
    stop: int  # last frame, included


def label_items(
    library: Library,
    count: int = 500,
    *,
    captured: int | None = None,
    group: str | None = None,
    method: Method | None = None,
    seed: int = 0,
) -> list[Item]:
    """Draw pieces of motion, one segment each, for a person to label.

    Parameters
    ----------
    library : Library
        Library with the segments.
    count : int
        Number of pieces with an exchanged part. The paper has 300 for training and 200 for
        testing.
    captured : int, optional
        Number of captured pieces that are mixed with the others and not marked. Default: a tenth
        of `count`.
    group : str, optional
        Grafted group. Default: the first group that is not the base group.
    method : Method, optional
        Method that selects the donors. Default: random donors of similar length, so that the
        labels depend on the combination of parts and not on stretching.
    seed : int
        Seed of the donors and of the order.

    Returns
    -------
    list of Item
        Pieces in random order. All pairs of base segment and donor are different.

    Raises
    ------
    InsufficientDataError
        If the library does not have enough different pieces.
    ValueError
        If `count` is not an integer of at least 1, `captured` not one of at least 0, or `group` is
        the base group or unknown.
    """
    count = as_integer("count", count, 1)
    n_captured = round(count / 10) if captured is None else as_integer("captured", captured)
    group = grafted_group(library, group)
    method = RandomLength() if method is None else method
    rng = np.random.default_rng(seed)
    exchanged: dict[tuple[int, int], Item] = {}
    kept: dict[tuple[int, int], Item] = {}
    rounds = 0
    while len(exchanged) < count and rounds < _MAX_ROUNDS:
        for clip in rng.permutation(len(library.entries)).tolist():
            graft_seed = int(rng.integers(2**31))
            for item in _graft_items(method, library, clip, group, graft_seed):
                is_kept = item.segment == item.donor
                (kept if is_kept else exchanged)[item.segment, item.donor] = item
            if rounds == 0 and n_captured and len(kept) < n_captured:
                for item in _graft_items(Captured(), library, clip, group, seed):
                    kept[item.segment, item.donor] = item
            if len(exchanged) > 4 * count + 200:
                break
        rounds += 1
    if len(exchanged) < count or len(kept) < n_captured:
        raise InsufficientDataError(
            f"{count} pieces with an exchanged part and {n_captured} captured pieces were "
            f"requested, but the library has only {len(exchanged)} and {len(kept)}"
        )
    items = list[Item]()
    for pieces, number in ((exchanged, count), (kept, n_captured)):
        drawn = rng.choice(len(pieces), number, replace=False)
        items += [list(pieces.values())[index] for index in drawn]
    return [items[index] for index in rng.permutation(len(items))]


def _graft_items(method: Method, library: Library, clip: int, group: str, seed: int) -> list[Item]:
    """Compute one graft of a clip and return its pieces, one for each segment."""
    graft = grafts_by(method, library, library.entries[clip].name, swap=[group], seed=seed)[0]
    return [
        Item(graft=graft, group=group, segment=s.segment, donor=s.donor, start=s.start, stop=s.stop)
        for s in graft.substitutions
    ]


def label_page(library: Library, items: Sequence[Item], title: str = "Label motions") -> Page:
    """Return a page that plays pieces and asks for a label of each.

    Parameters
    ----------
    library : Library
        Library with the segments of the pieces.
    items : sequence of Item
        Pieces as `label_items` returns them.
    title : str
        Title of the page.

    Returns
    -------
    Page
        Self-contained page. It stores the labels in the browser and saves them as
        ``labels.csv``, which `read_labels` reads.

    Raises
    ------
    ValueError
        If `items` is empty.
    """
    if not items:
        raise ValueError("`items` must contain at least one piece, got none")
    group_of_joint = np.zeros(library.skeleton.n_joints, int)
    for index, name in enumerate(library.groups.names):
        group_of_joint[library.joints(name)] = index
    rows = [label_row(library, item.group, item.segment, item.donor) for item in items]
    tracks: dict[int, tuple[FloatArray, FloatArray]] = {}
    for item in items:
        if id(item.graft) not in tracks:
            tracks[id(item.graft)] = _y_up_track(item.graft.motion, item.graft.base)
    step = max(round(library.rate / _FRAME_RATE), 1)
    values = {
        "key": hashlib.sha256(repr(rows).encode()).hexdigest()[:16],
        "columns": COLUMNS,
        "parents": node_parents(library.clips[0]),
        "group": group_of_joint.tolist(),
        "dt": step / library.rate,
        "unit": _UNIT,
        "items": [
            {"row": list(row), **_encode_item(item, tracks[id(item.graft)], step, library.rate)}
            for item, row in zip(items, rows, strict=True)
        ],
    }
    folder = files("mograft.evaluation")
    body, style, script = (
        folder.joinpath(f"label.{kind}").read_text(encoding="utf-8").strip()
        for kind in ("html", "css", "js")
    )
    return assemble_page(title, f"{body}\n{embed_json(values)}", "report", style, script)


def _encode_item(
    item: Item, track: tuple[FloatArray, FloatArray], step: int, rate: float
) -> dict[str, Any]:
    """Return the data of one piece in the form that the script of the page reads.

    `track` has the node positions and the headings of the graft in each frame; every `step`-th
    frame is encoded. `rate` is in frames per second.
    """
    context = round(_CONTEXT_SECONDS * rate)
    first = max(item.start - context, 0)
    last = min(item.stop + context, item.graft.motion.n_frames - 1)
    frames = np.arange(first, last + 1, step)
    nodes, heading = (values[frames] for values in track)
    nodes = nodes - nodes[len(nodes) // 2].mean(axis=0) * [1.0, 0.0, 1.0]
    nodes = rotations.rotate(rotations.exp([0.0, _VIEW_ANGLE - heading[0], 0.0]), nodes)
    integers = np.clip(np.round(nodes / _UNIT), -32767, 32767).astype("<i2")
    return {
        "frames": len(frames),
        "first": int(np.ceil((item.start - first) / step)),
        "last": int((item.stop - first) // step),
        "pos": b64encode(integers.tobytes()).decode("ascii"),
    }


def _y_up_track(motion: Motion, base: Motion) -> tuple[FloatArray, FloatArray]:
    """Return positions of joints and end sites, and headings about the vertical axis in radians.

    Positions are in skeleton heights; y points up and is 0 at the floor of `base`.
    """
    ground = Ground.of(base)
    nodes = node_positions(motion)
    up = int(np.flatnonzero(ground.up)[0])
    floor = (nodes @ ground.up).min() if not ground.floors.size else ground.floors.min()
    # Cyclic order of the axes, and two signs: a rotation and no reflection.
    order = [(up + 2) % 3, up, (up + 1) % 3]
    signs = np.array([ground.up[up], ground.up[up], 1.0])
    y_up = nodes[..., order] * signs - [0.0, float(floor), 0.0]
    forward = facing_directions(motion, ground)[:, order] * signs
    return y_up / mass_model(motion.skeleton).height, np.arctan2(forward[:, 0], forward[:, 2])
