"""What a page shows: figures, their joint groups, and the timeline of their segments."""

import base64
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray, IntArray
from mograft.analysis.segmentation import gaussian, kinetic_energy, segment
from mograft.body.anatomy import anatomy
from mograft.body.groups import JointGroups
from mograft.body.mass import mass_model, up_axis
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.synthesis.graft import Graft

__all__ = ["POINTS", "Drawn", "Figure", "Row", "Scene", "quantised", "unpacked"]

_PRESETS = ("lower_torso_larm_rarm", "lower_torso_arms", "lower_upper")
POINTS = 6_000_000
"""Places of nodes that a page holds at most; of longer motions not every frame is kept."""
_CURVE = 1_500
"""Points of the energy curve: more than there are pixels is of no use."""

# How thick the bones of a part are drawn, in about a fiftieth of the height.
_WIDTHS = {
    "head": 2.6,
    "neck": 1.1,
    "trunk": 1.9,
    "pelvis": 1.9,
    "clavicle": 1.2,
    "upper_arm": 1.3,
    "forearm": 1.1,
    "hand": 0.9,
    "finger": 0.4,
    "thigh": 1.7,
    "shank": 1.4,
    "foot": 1.2,
    "toe": 1.0,
}


@dataclass(frozen=True, eq=False)
class Row:
    """One line of the timeline: the segments of a clip as one joint group sees them.

    Attributes
    ----------
    group : str
        What the line is of.
    start, stop : ndarray of int
        First and last frame of each segment, both included.
    cluster : ndarray of int
        Its cluster; -1 where there is none.
    donors : tuple of str
        Names of the donors' clips; empty where nothing was grafted.
    first, last : ndarray of int
        Frames of the donor in its clip.
    exchanged : ndarray of bool
        Whether the part comes from elsewhere.
    stretch : ndarray
        By which part of its length the donor was made longer.
    gaps : ndarray, shape (n_segments, 2)
        Angles at the seams before and after, in degrees; NaN where there is no seam.
    others : ndarray of int
        How many donors besides itself each segment had; -1 where unknown.
    """

    group: str
    start: IntArray
    stop: IntArray
    cluster: IntArray
    donors: tuple[str, ...] = ()
    first: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    last: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    exchanged: npt.NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    stretch: FloatArray = field(default_factory=lambda: np.zeros(0))
    gaps: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    others: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))


@dataclass(frozen=True, eq=False)
class Figure:
    """One moving figure of a page.

    Attributes
    ----------
    motion : Motion
        How it moves.
    name : str
        What it is called on the page.
    members : dict of str to ndarray of int
        The joints of each group.
    rows : tuple of Row
        Its lines of the timeline.
    """

    motion: Motion
    name: str
    members: Mapping[str, IntArray]
    rows: tuple[Row, ...]


@dataclass(frozen=True, eq=False)
class Scene:
    """Figures that are shown together.

    Attributes
    ----------
    figures : tuple of Figure
        The figures; the first one's frames are those that the page counts.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> scene = Scene.of([dance(strides=1).motion])
    >>> scene.figures[0].name
    'dance'
    """

    figures: tuple[Figure, ...]

    @classmethod
    def of(
        cls,
        items: "Iterable[Motion | Graft | Library | Scene]",
        groups: JointGroups | str | None = None,
    ) -> "Scene":
        """Return a scene of motions, grafts, each after its base, and clips of libraries.

        Parameters
        ----------
        items : iterable of Motion, Graft, Library or Scene
            What to show.
        groups : JointGroups or str, optional
            The joint groups that plain motions are coloured by, or the name of a preset.
            Default: those of the grafts and libraries that have the same skeleton, else
            trunk, arms and legs.

        Returns
        -------
        Scene
            With each motion once.

        Raises
        ------
        TypeError
            If an item is none of these; names it.
        ValueError
            If there is nothing to show, or the groups do not fit a skeleton.
        """
        several = list(items)
        known = [item.library if isinstance(item, Graft) else item for item in several]
        libraries = [own for own in known if isinstance(own, Library)]
        figures: list[Figure] = []
        for item in several:
            if isinstance(item, Graft):
                _add(figures, _of_clip(item.library, item.base))
                _add(figures, _of_graft(item))
            elif isinstance(item, Library):
                for clip in item.clips:
                    _add(figures, _of_clip(item, clip))
            elif isinstance(item, Motion):
                _add(figures, _of_motion(item, groups, libraries))
            elif isinstance(item, Scene):
                for figure in item.figures:
                    _add(figures, figure)
            else:
                raise TypeError(f"items must be motions, grafts or libraries, got {item!r}")
        if not figures:
            raise ValueError("items must hold at least one motion, got none")
        return cls(tuple(figures))

    @classmethod
    def of_clips(cls, library: Library, clips: Iterable[int]) -> "Scene":
        """Return a scene of some clips of a library, by their numbers there."""
        return cls(tuple(_of_clip(library, library.clips[clip]) for clip in clips))

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of all joint groups in order."""
        names = [*(name for figure in self.figures for name in figure.members)]
        return tuple(dict.fromkeys(names))

    def as_dict(self, points: int = POINTS) -> dict[str, Any]:
        """Return the scene as the page's script reads it.

        Parameters
        ----------
        points : int
            How many places of nodes it may hold.

        Returns
        -------
        dict
            Of what JSON can hold. Places are turned to y up.
        """
        drawn = [Drawn.of(figure.motion) for figure in self.figures]
        whole = sum(own.places.shape[0] * own.places.shape[1] for own in drawn)
        step = max(1, -(-whole // points))
        donors: dict[str, int] = {}
        groups = self.groups
        clips = []
        for figure, own in zip(self.figures, drawn, strict=True):
            kept = own.places[::step]
            unit, path, pose = quantised(kept, own.root, own.height)
            clips.append(
                {
                    "name": figure.name,
                    "frames": figure.motion.n_frames,
                    "dt": figure.motion.frame_time,
                    "step": step,
                    "kept": len(kept),
                    "nodes": kept.shape[1],
                    "parents": own.parents,
                    "width": own.widths,
                    "tips": own.tips,
                    "groups": list(figure.members),
                    "group": _group_of_nodes(figure, own),
                    "unit": unit,
                    "path": _packed(path.astype("<f4").tobytes()),
                    "pose": _packed(pose),
                    "energy": _curve(figure.motion),
                    "rows": [_row(row, donors) for row in figure.rows],
                }
            )
        note = ""
        if step > 1:
            note = f"Of these long motions every {_ordinal(step)} frame is kept; between, lines."
        return {
            "format": "mograft.view/1",
            "height": max(own.height for own in drawn),
            "floor": min(own.floor for own in drawn),
            "follow": True,
            "note": note,
            "groups": list(groups),
            "donors": list(donors),
            "clips": clips,
        }


def quantised(places: FloatArray, root: int, height: float) -> tuple[float, FloatArray, bytes]:
    """Return places as small numbers about the root's way.

    Parameters
    ----------
    places : ndarray, shape (n_frames, n_nodes, 3)
        Places of nodes.
    root : int
        The node that the others are told from.
    height : float
        The figure's; a ten-thousandth of it is the finest difference that is kept.

    Returns
    -------
    unit : float
        The difference of one.
    path : ndarray, shape (n_frames, 3)
        The root's way, in float32.
    pose : bytes
        Second differences in time of places over `unit`, each track by itself, folded to
        even numbers for positive and odd for negative ones: first all low, then all high
        bytes. A place is off by half a unit at most.
    """
    path = places[:, root].astype(np.float32).astype(np.float64)
    about = places - path[:, None]
    unit = max(float(np.abs(about).max()) / 32_000, 1e-4 * height)
    whole = np.round(about / unit).astype(np.int16)
    # Differences wrap around as the sums on the other side do.
    with np.errstate(over="ignore"):
        speed = np.diff(whole, axis=0, prepend=np.zeros_like(whole[:1]))
        change = np.diff(speed, axis=0, prepend=np.zeros_like(whole[:1]))
    folded = ((change << 1) ^ (change >> 15)).astype(np.uint16)
    tracks = np.ascontiguousarray(folded.reshape(len(folded), -1).T)
    planes = (tracks & 0xFF, tracks >> 8)
    return unit, path, b"".join(plane.astype(np.uint8).tobytes() for plane in planes)


def unpacked(unit: float, path: FloatArray, pose: bytes) -> FloatArray:
    """Return the places that `quantised` was given, shape (n_frames, n_nodes, 3)."""
    planes = np.frombuffer(pose, np.uint8).reshape(2, -1, len(path)).astype(np.uint16)
    folded = planes[0] | (planes[1] << 8)
    change = ((folded >> 1) ^ -(folded & 1).astype(np.int16)).astype(np.int16)
    whole = change.cumsum(axis=1, dtype=np.int16).cumsum(axis=1, dtype=np.int16)
    places: FloatArray = path[:, None] + whole.T.reshape(len(path), -1, 3) * unit
    return places


def _packed(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data, 9)).decode("ascii")


@dataclass(frozen=True, eq=False)
class Drawn:
    """What is drawn of a motion: its joints, then its end sites, as nodes; y up.

    Attributes
    ----------
    places : ndarray, shape (n_frames, n_nodes, 3)
        Where the nodes are, in the motion's unit.
    parents : list of int
        The node at which each one's bone begins; -1 where there is none.
    root : int
        The joint that carries the body through the world.
    height, floor : float
        The figure's height, and how high its floor lies.
    widths : list of float
        How thick each node's bone is, in about a fiftieth of the height.
    tips : list of int
        The nodes at the ends of limbs.
    """

    places: FloatArray
    parents: list[int]
    root: int
    height: float
    floor: float
    widths: list[float]
    tips: list[int]

    @classmethod
    def of(cls, motion: Motion) -> "Drawn":
        """Return what is drawn of a motion."""
        skeleton = motion.skeleton
        turns, joints = motion.world_transforms()
        sites = [
            joints[:, site.parent] + rotations.rotate(turns[:, site.parent], site.offset)
            for site in skeleton.end_sites
        ]
        parents = [*skeleton.parents.tolist(), *(site.parent for site in skeleton.end_sites)]
        known = anatomy(skeleton)
        figure = mass_model(skeleton)
        height, head = figure.height, figure.head
        on_head = {node for node, parent in enumerate(parents) if parent == head}
        if head is not None and on_head and on_head <= set(known.details):
            # Nothing but eyes: the head itself ends where its mass is taken to.
            sites.append(joints[:, head] + rotations.rotate(turns[:, head], figure.bone[head]))
            parents.append(head)
        places = _upright(np.concatenate([joints, *(s[:, None] for s in sites)], axis=1), motion)
        parts = known.parts
        widths = [_WIDTHS.get(part, 1.0) for part in parts]
        above = [max(parent, 0) for parent in parents]
        bones = [widths[node] for node in above]
        for joint, part in enumerate(parts):
            # From the trunk to a limb, beside the spine.
            if bones[joint] == _WIDTHS["trunk"] and part not in ("trunk", "neck", "head"):
                bones[joint] = 1.1
        for node, parent in enumerate(above):
            # Eyes and markers would make a second head.
            if {node, parent} & set(known.details):
                bones[node] = 0.4
        inner = {parent for parent in parents if parent >= 0}
        # Fingers are many and all go the same way.
        tips = [
            node
            for node in range(len(parents))
            if node not in inner and widths[above[node]] != _WIDTHS["finger"]
        ]
        lows = places[:, :, 1].min(axis=1)
        return cls(
            places,
            parents,
            motion.locomotion_root(),
            height,
            float(np.percentile(lows, 5)),
            bones,
            tips[:12],
        )


def _upright(places: FloatArray, motion: Motion) -> FloatArray:
    """Return places with y up, turned but not mirrored."""
    axis = up_axis(motion)
    known = mass_model(motion.skeleton)
    feet = [foot.ankle for foot in known.feet]
    x, y, z = np.moveaxis(places, -1, 0)
    turned = [(-y, x, z), (x, y, z), (x, z, -y)][axis]
    upright = np.stack(turned, axis=-1)
    high = known.head if known.head is not None else known.hips
    low = feet if feet else [known.hips]
    if upright[:, high, 1].mean() < upright[:, low, 1].mean():
        upright = upright * (-1.0, -1.0, 1.0)
    return upright


def _group_of_nodes(figure: Figure, drawn: Drawn) -> list[int]:
    """Return each node's group as an index; an end site goes with its joint."""
    group = np.zeros(len(drawn.parents), np.int64)
    for index, joints in enumerate(figure.members.values()):
        group[joints] = index
    for node in range(figure.motion.n_joints, len(group)):
        group[node] = group[drawn.parents[node]]
    own: list[int] = group.tolist()
    return own


def _row(row: Row, donors: dict[str, int]) -> dict[str, Any]:
    n = len(row.start)
    grafted = bool(row.donors)
    source = [-1] * n
    for part in np.flatnonzero(row.exchanged).tolist():
        source[part] = donors.setdefault(row.donors[part], len(donors))
    gaps: list[list[float | None]] = [
        [None if np.isnan(gap) else round(float(gap), 2) for gap in pair] for pair in row.gaps
    ]
    return {
        "group": row.group,
        "grafted": grafted,
        "start": row.start.tolist(),
        "stop": row.stop.tolist(),
        "cluster": row.cluster.tolist(),
        "source": source,
        "first": row.first.tolist() if grafted else [0] * n,
        "last": row.last.tolist() if grafted else [0] * n,
        "stretch": np.round(row.stretch, 4).tolist() if grafted else [0.0] * n,
        "before": [pair[0] for pair in gaps] if grafted else [None] * n,
        "after": [pair[1] for pair in gaps] if grafted else [None] * n,
        "others": [None if k < 0 else k for k in row.others.tolist()] if grafted else [None] * n,
    }


def _curve(motion: Motion) -> list[int]:
    """Return the smoothed kinetic energy, 0 to 255, at places equally far from each other."""
    if motion.n_frames < 2:
        return []
    energy = gaussian(kinetic_energy(motion), 0.07 * motion.rate)
    at = np.linspace(0, len(energy) - 1, min(len(energy), _CURVE)).round().astype(int)
    # The few highest peaks would press all others flat.
    top = float(np.percentile(energy, 99)) or 1.0
    levels: list[int] = np.round(255 * np.clip(energy[at] / top, 0, 1)).astype(int).tolist()
    return levels


def _add(figures: list[Figure], new: Figure) -> None:
    """Add a figure unless its motion is shown; one that knows more takes its place."""
    for index, old in enumerate(figures):
        if _same(old.motion, new.motion):
            if len(new.rows) > len(old.rows):
                figures[index] = replace(new, name=old.name)
            return
    names = {figure.name for figure in figures}
    name = plain = new.name or "motion"
    count = 1
    while name in names:
        count += 1
        name = f"{plain} ({count})"
    figures.append(replace(new, name=name))


def _same(a: Motion, b: Motion) -> bool:
    return a is b or (
        a.name == b.name
        and a.frame_time == b.frame_time
        and a.skeleton.names == b.skeleton.names
        and np.array_equal(a.rotations, b.rotations)
        and np.array_equal(a.positions, b.positions)
        and np.array_equal(a.skeleton.offsets, b.skeleton.offsets)
    )


def _of_motion(
    motion: Motion, groups: JointGroups | str | None, libraries: Sequence[Library]
) -> Figure:
    for library in libraries:
        for clip in library.clips:
            if _same(clip, motion):
                return _of_clip(library, clip)
    rows: tuple[Row, ...] = ()
    if motion.n_frames >= 2:
        own = segment(motion)
        rows = (Row("segments", own.start, own.stop, np.full(len(own), -1)),)
    return Figure(motion, motion.name, _members(motion.skeleton, groups, libraries), rows)


def _members(
    skeleton: Skeleton, groups: JointGroups | str | None, libraries: Sequence[Library]
) -> dict[str, IntArray]:
    if isinstance(groups, str):
        groups = JointGroups.preset(groups, skeleton)
    if groups is not None:
        return groups.resolve(skeleton)
    for library in libraries:
        if library.skeleton.names == skeleton.names:
            return library.groups.resolve(skeleton)
    for preset in _PRESETS:
        try:
            return JointGroups.preset(preset, skeleton).resolve(skeleton)
        except ValueError:
            continue
    return {"body": np.arange(skeleton.n_joints)}


def _of_clip(library: Library, clip: Motion) -> Figure:
    library, index = library.resolve_base(clip)
    own = library.segments.of_clip(index)
    start, stop = library.segments.start[own], library.segments.stop[own]
    rows = [Row(group, start, stop, labels[own]) for group, labels in library.labels.items()]
    shown = library.clips[index]
    return Figure(shown, shown.name, library.groups.resolve(shown.skeleton), tuple(rows))


def _of_graft(graft: Graft) -> Figure:
    library = graft.library
    rows = []
    for group in dict.fromkeys(s.group for s in graft.substitutions):
        own = [s for s in graft.substitutions if s.group == group]
        gap = {seam.frame: np.degrees(seam.gap) for seam in graft.seams if seam.group == group}
        rows.append(
            Row(
                group,
                np.array([s.start for s in own]),
                np.array([s.stop for s in own]),
                library.labels[group][[s.donor for s in own]],
                tuple(s.clip for s in own),
                np.array([s.donor_start for s in own]),
                np.array([s.donor_stop for s in own]),
                np.array([not s.is_own for s in own]),
                np.array([s.stretch for s in own]),
                np.array([[gap.get(s.start, np.nan), gap.get(s.stop, np.nan)] for s in own]),
                np.asarray(graft.alternatives[group]),
            )
        )
    members = library.groups.resolve(graft.motion.skeleton)
    return Figure(graft.motion, graft.motion.name, members, tuple(rows))


def _ordinal(number: int) -> str:
    ending = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{'th' if number // 10 % 10 == 1 else ending}"
