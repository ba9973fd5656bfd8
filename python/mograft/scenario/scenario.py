"""`Scenario`: a sequence of base segments; its motion, and the runs that are repeated in it."""

from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray, as_floats, as_indices, set_fields
from mograft.blend.foot_planting import plant_feet
from mograft.blend.recombine import recombine
from mograft.blend.rigid_alignment import RootTransforms
from mograft.blend.transplant import GraftedGroup, transplant
from mograft.body.contacts import detect_contacts, find_legs, foot_heights
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.motion.motion import NO_FILE, Motion, select_frames
from mograft.motion.segments import Segments


@dataclass(frozen=True, eq=False)
class Scenario:
    """A sequence of base segments, their lengths, and the position and turn of the first.

    Parameters
    ----------
    segments : array_like of int, shape (n,)
        Segments of a library, in order.
    lengths : array_like of int, shape (n,), optional
        Length of each segment in frame intervals. Default: the captured lengths.
    place : array_like, shape (3,), optional
        Position of the root over the floor in the first frame, in the file's unit; the component
        along the up axis is ignored. Default: the captured position.
    turn : float
        Rotation of the first segment about the up axis, in radians.

    Raises
    ------
    ValueError
        If there is no segment, if `lengths` does not have one entry per segment, if a length is
        below 1, or if a number is not finite.

    Examples
    --------
    >>> Scenario([3, 4, 0], turn=0.5)
    Scenario(3 segments)
    """

    segments: IntArray
    lengths: IntArray | None = None
    place: FloatArray | None = None
    turn: float = 0.0

    def __post_init__(self) -> None:
        segments = as_indices("segments", self.segments, ("n",)).copy()
        if not len(segments):
            raise ValueError("`segments` must contain at least one segment, got none")
        turn = float(as_floats("turn", self.turn, ()))
        fields: dict[str, object] = {"segments": segments, "turn": turn}
        if self.lengths is not None:
            lengths = as_indices("lengths", self.lengths, (len(segments),)).copy()
            if (lengths < 1).any():
                raise ValueError(f"values of `lengths` must be at least 1, got {lengths.min()}")
            fields["lengths"] = lengths
        if self.place is not None:
            fields["place"] = as_floats("place", self.place, (3,)).copy()
        set_fields(self, fields)

    def __repr__(self) -> str:
        return f"Scenario({len(self.segments)} segments)"


@dataclass(frozen=True)
class Repetition:
    """How much of a scenario is repeated; see `repetition`.

    Attributes
    ----------
    longest_repeat : float
        Duration in seconds of the longest run of segments that occurs twice without overlap; 0 if
        all segments are different.
    distinct_share : float
        Number of different segments, divided by the number of all segments.
    """

    longest_repeat: float
    distinct_share: float


def repetition(library: Library, scenario: Sequence[int] | IntArray | Scenario) -> Repetition:
    """Measure how much of a scenario is repeated.

    Parameters
    ----------
    library : Library
        The library of the segments.
    scenario : sequence of int or Scenario
        Segments of the library, in order.

    Returns
    -------
    Repetition
        The longest repeat in seconds, at captured speed, and the fraction of different segments.

    Raises
    ------
    ValueError
        If the scenario has no segment, or one that is not in the library.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> repetition(library, [0, 1, 5, 0, 1])
    Repetition(longest_repeat=0.5, distinct_share=0.6)
    """
    segments = as_scenario(scenario, library).segments.tolist()
    lengths, runs = library.segments.lengths[segments].tolist(), RepeatedRuns()
    longest = max(map(runs.append, segments, lengths))
    return Repetition(float(longest / library.rate), len(set(segments)) / len(segments))


def as_scenario(scenario: Sequence[int] | IntArray | Scenario, library: Library) -> Scenario:
    """Convert a sequence of segments to a `Scenario`, and check that all segments exist."""
    if not isinstance(scenario, Scenario):
        indices = as_indices("scenario", scenario, ("n",))
        if not len(indices):
            raise ValueError("`scenario` must contain at least one segment, got none")
        scenario = Scenario(indices)
    n = len(library.segments)
    wrong = scenario.segments[(scenario.segments < 0) | (scenario.segments >= n)]
    if len(wrong):
        raise ValueError(f"`scenario` must contain only segments 0 to {n - 1}, got {wrong[0]}")
    return scenario


class RepeatedRuns:
    """The runs of items at the end of a growing sequence that also occur earlier in it.

    The two occurrences do not overlap. Only the latest `max_visits` occurrences of an item are
    compared, which bounds the time per item. By default all are compared.
    """

    def __init__(self, max_visits: int | None = None) -> None:
        self._items: list[int] = []
        self._ends: list[int] = []
        self._positions: dict[int, deque[int]] = defaultdict(lambda: deque(maxlen=max_visits))
        self._runs: dict[int, int] = {}  # length of the repeated run that ends at each position

    def append(self, item: int, length: int) -> int:
        """Append an item; return the length of the longest repeated run that ends with it."""
        end = length + (self._ends[-1] if self._ends else 0)
        positions = self._positions[item]
        self._runs = {
            position: min(length + self._runs.get(position - 1, 0), end - self._ends[position])
            for position in positions
        }
        positions.append(len(self._items))
        self._items.append(item)
        self._ends.append(end)
        return max(self._runs.values(), default=0)

    def lengths_before(self) -> dict[int, int]:
        """Return the items that would extend a repeated run, with the length of the longest one."""
        # Of equal items the last one stays: that of the longest run.
        runs = sorted(self._runs.items(), key=lambda run: run[1])
        return {self._items[position + 1]: length for position, length in runs}


def realize_scenario(library: Library, scenario: Scenario) -> tuple[Motion, Segments]:
    """Return the motion of a scenario, and the frames of its segments in this motion.

    The figure is that of the first segment's clip. Gaps at seams are closed. Feet are planted
    unless `Config.feet` is "never".
    """
    donors = library.segments[scenario.segments]
    lengths = donors.lengths if scenario.lengths is None else scenario.lengths
    stops = np.cumsum(lengths)
    cut = Segments(np.concatenate([[0], stops[:-1]]), stops)
    # Clips of a stored library are read on access: each is read once.
    used, index = np.unique(donors.clip, return_inverse=True)
    clips = [library.clips[int(clip)] for clip in used]
    donors = replace(donors, clip=index)
    base = _still(clips[index[0]], int(donors.start[0]), int(stops[-1]) + 1)
    if scenario.place is not None or scenario.turn:
        base = _place_root(base, scenario, library.root, library.up)
    joints = joints_of_donors(library, np.arange(base.n_joints))
    group = GraftedGroup(joints, library.root, library.up)
    part = transplant(base, cut, donors, clips, group, library.config)
    motion = recombine(base, [part], base.name)
    if library.config.feet != "never" and len(part.seams):
        sources = [scenario.segments] * len(find_legs(base.skeleton))
        contacts, heights = donor_contacts(library, cut, sources)
        motion, _ = plant_feet(motion, contacts, min_heights=heights)
    return motion, cut


def joints_of_donors(library: Library, joints: IntArray) -> IntArray:
    """Return the joints whose motion donors replace: `joints` without the ancestors of the root.

    The ancestors keep the motion of the base. The root moves in the world as in the donors.
    """
    above = library.skeleton.ancestors(library.root)
    return np.setdiff1d(joints, above).astype(np.int64)


def donor_contacts(
    library: Library, cut: Segments, leg_donors: Sequence[IntArray]
) -> tuple[BoolArray, FloatArray]:
    """Return the foot contacts and foot heights that each leg has in its donors.

    `leg_donors` has, for every leg, the donor of each base segment in `cut`. Both results have
    shape (n_frames, n_legs, 2); see `detect_contacts` and `foot_heights`.
    """
    n_frames = int(cut.stop[-1]) + 1
    contacts = np.empty((n_frames, len(leg_donors), 2), bool)
    heights = np.empty((n_frames, len(leg_donors), 2))
    segments = library.segments

    @cache
    def clip_feet(clip: int) -> tuple[BoolArray, FloatArray]:
        motion = library.clips[clip]
        return detect_contacts(motion), foot_heights(motion)

    for leg, donors in enumerate(leg_donors):
        for position, donor in enumerate(donors.tolist()):
            clip_contacts, clip_heights = clip_feet(int(segments.clip[donor]))
            n, m = int(cut.lengths[position]), int(segments.lengths[donor])
            frames = segments.start[donor] + (np.arange(n + 1) * m + n // 2) // n
            rows = slice(int(cut.start[position]), int(cut.stop[position]) + 1)
            contacts[rows, leg] = clip_contacts[frames, leg]
            heights[rows, leg] = clip_heights[frames, leg]
    return contacts, heights


def _still(clip: Motion, frame: int, n_frames: int) -> Motion:
    """Return a motion that repeats one frame of a clip."""
    frames = np.full(n_frames, frame)
    still = select_frames(clip, frames, clip.frame_time, has_channels=False)
    return replace(still, **NO_FILE, name="scenario")


def _place_root(motion: Motion, scenario: Scenario, root: int, up: int) -> Motion:
    """Rotate a motionless figure by `scenario.turn` and move its root to `scenario.place`."""
    world, places = RootTransforms.from_motion(motion, root), scenario.place
    if places is None:
        places = world.positions
    yaw = rotations.from_axis_angle(np.eye(3)[up], scenario.turn)
    places = np.where(np.arange(3) == up, world.positions, places)
    transform = RootTransforms(rotations.multiply(yaw, world.rotations), places)
    transform = transform.relative_to_parent(motion, np.arange(motion.n_frames), root)
    quats, positions = motion.rotations.copy(), motion.positions.copy()
    quats[:, root], positions[:, root] = transform.rotations, transform.positions
    return replace(motion, rotations=quats, positions=positions)
