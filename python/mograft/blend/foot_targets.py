"""Target positions of heels and toes: plants, transitions between them, and lifted swings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft._util.gaussian import gaussian_filter_columns
from mograft._util.runs import find_runs
from mograft.body.contacts import CONTACT_HEIGHT, SLIDING_SPEED, Ground, point_speeds
from mograft.config import FRAME

CLEARANCE = 0.05  # maximum height to which a swinging foot is lifted, in skeleton heights
_FADE_SECONDS = 3 * FRAME
_RISE_FRAMES = 1.5  # frames from a contact within which the lift of a swinging foot is reduced
_MAX_SLIDE = 0.1  # skeleton heights from the mean position; a longer slide loses its fast frames
_MAX_DEPTH = 0.01  # maximum depth of a plant below the floor, in skeleton heights
_DEPTH_MARGIN = 0.001  # skeleton heights by which planting may lower a point into the floor


@dataclass(frozen=True, eq=False)
class _Plant:
    """First and last frame of a contact, and the fixed position of the heel or toe during it."""

    first: int
    last: int
    position: FloatArray


def remove_sliding_frames(
    contacts: BoolArray, points: FloatArray, ground: Ground, rate: float
) -> BoolArray:
    """Return `contacts` without the fast frames of contacts in which a heel or toe slides far.

    Before and after a seam, a foot can stand at two distant positions. A single plant would be
    halfway between them. Without the fast frames there are two plants, and the foot steps from one
    to the other.
    """
    at_rest = contacts.copy()
    is_fast = point_speeds(points, rate) >= SLIDING_SPEED * ground.height
    for leg, point in np.ndindex(contacts.shape[1:]):
        for start, stop in find_runs(contacts[:, leg, point]):
            rows = slice(start, stop)
            positions = points[rows, leg, point]
            distances = np.linalg.norm(positions - positions.mean(axis=0), axis=1)
            if distances.max() > _MAX_SLIDE * ground.height:
                at_rest[rows, leg, point] = ~is_fast[rows, leg, point]
    return at_rest


def lowest_heights(points: FloatArray, recorded: FloatArray, ground: Ground) -> FloatArray:
    """Return the lowest allowed heights of heels and toes, shape (n_frames, n_legs, 2).

    The limit is 0.001 skeleton heights below the higher of two heights: that of the point in the
    same frame of `points`, and that of the point in its lowest frame in `recorded`. Heights above
    the floor count as the height of the floor. Both arrays are positions, shape
    (n_frames, n_legs, 2, 3).
    """
    deepest = (recorded @ ground.up).min(axis=0)
    lowest: FloatArray = np.minimum(np.maximum(points @ ground.up, deepest), ground.floors)
    return lowest - _DEPTH_MARGIN * ground.height


def foot_displacements(
    points: FloatArray,
    contacts: BoolArray,
    min_heights: FloatArray,
    lowest: FloatArray,
    ground: Ground,
    leg: int,
    rate: float,
) -> FloatArray:
    """Return the displacements of a leg's heel and toe to their targets, shape (n_frames, 2, 3).

    `points` are the positions of heel and toe, of the same shape. `contacts` marks the frames of
    their contacts; `min_heights` are their minimum heights in skeleton heights while neither is in
    contact; both have shape (n_frames, 2). If only one of the two is planted, the other is
    displaced with it. The foot keeps its length. Both points stay above `lowest`; see
    `lowest_heights`. `leg` is the index of the leg, `rate` the frame rate.
    """
    single, holds = np.zeros_like(points), np.zeros(contacts.shape)
    fade = max(round(_FADE_SECONDS * rate), 1)
    for point, plants in enumerate(_plants(points, contacts, lowest, ground, leg)):
        single[:, point], holds[:, point] = _fade(points[:, point], plants, ground.up, fade)
    displacements: FloatArray = single + (1.0 - holds)[..., None] * single[:, ::-1]
    lifts = _lifts(points + displacements, contacts, min_heights, ground, leg, rate)
    displacements += lifts[..., None] * ground.up
    # A point in contact keeps its displacement, and the other one restores the length of the foot.
    # While neither is in contact, the point with the smaller weight moves more.
    heel, toe = holds[:, 0] * (1.0 - holds[:, 1]), holds[:, 1] * (1.0 - holds[:, 0])
    share = np.where(contacts[:, 0], 0.0, toe / np.where(toe + heel > 0, toe + heel, 1.0))
    heel_share = np.where(contacts[:, 1] > contacts[:, 0], 1.0, share)[:, None]
    foot = points[:, 1] - points[:, 0]
    target = foot + displacements[:, 1] - displacements[:, 0]
    length, new_length = (np.linalg.norm(v, axis=1, keepdims=True) for v in (foot, target))
    ratio = length / np.where(new_length > 0, new_length, 1.0)
    foot = np.where(new_length > 0, ratio * target, foot)
    displacements[:, 0] += heel_share * (target - foot)
    heels = points[:, 0] + displacements[:, 0]
    is_low = (np.stack([heels, heels + foot], axis=1) @ ground.up < lowest).any(axis=1)
    raised = _raise_foot(
        heels[is_low], foot[is_low], lowest[is_low], holds[is_low], heel_share[is_low], ground.up
    )
    displacements[is_low] = raised - points[is_low]
    displacements[np.abs(displacements).max(axis=(1, 2)) < 1e-12 * ground.height] = 0.0
    return displacements


def _raise_foot(
    heels: FloatArray,
    foot: FloatArray,
    lowest: FloatArray,
    holds: FloatArray,
    heel_share: FloatArray,
    up: FloatArray,
) -> FloatArray:
    """Return the positions of heel and toe, raised to at least the heights `lowest`, (n, 2, 3).

    `foot` is the vector from heel to toe. A point that is not planted is raised together with the
    other one; `holds`, from 0 to 1, are the weights of the plants. Horizontal displacements restore
    the length of the foot; the heel takes the fraction `heel_share` of them, the toe the rest.
    """
    heights = np.stack([heels, heels + foot], axis=1) @ up
    deficits = np.maximum(lowest - heights, 0.0)
    other_deficits = np.maximum(deficits[:, ::-1] - deficits, 0.0)
    heights += deficits + (1.0 - holds) * other_deficits
    # A foot that becomes vertical is raised as a whole.
    lengths = np.linalg.norm(foot, axis=1, keepdims=True)
    heights = np.maximum(heights, heights[:, ::-1] - lengths)
    new_foot = _with_rise(foot, heights[:, 1] - heights[:, 0], lengths[:, 0], up)
    ends = heels - heel_share * (new_foot - foot)
    ends += (heights[:, 0] - ends @ up)[:, None] * up
    return np.stack([ends, ends + new_foot], axis=1)


def _with_rise(
    foot: FloatArray, rise: FloatArray, length: FloatArray, up: FloatArray
) -> FloatArray:
    """Return vectors of length `length` and height `rise` in the horizontal direction of `foot`."""
    level = foot - (foot @ up)[..., None] * up
    size = np.linalg.norm(level, axis=-1, keepdims=True)
    any_level = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    direction = np.where(size > 0, level / np.where(size > 0, size, 1.0), any_level)
    rise = np.clip(rise, -length, length)
    result: FloatArray = np.sqrt(length**2 - rise**2)[..., None] * direction
    return result + rise[..., None] * up


def _lifts(
    points: FloatArray,
    contacts: BoolArray,
    min_heights: FloatArray,
    ground: Ground,
    leg: int,
    rate: float,
) -> FloatArray:
    """Return how far to raise heel and toe in each frame without contact, (n_frames, 2).

    The result is in the file's unit, `min_heights` in skeleton heights.
    """
    heights = points @ ground.up - ground.floors[leg]
    wanted = np.minimum(min_heights, CLEARANCE) * ground.height
    deficit: FloatArray = np.maximum(wanted - heights, 0.0)
    stands = contacts.any(axis=1)
    deficit[stands] = 0.0
    if not deficit.any():
        return deficit
    # The maximum deficit of nearby frames, then smoothed, as for the shift of the root.
    width = max(round(_FADE_SECONDS * rate), 1)
    padded = np.pad(deficit, ((width, width), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1, axis=0)
    smooth = gaussian_filter_columns(windows.max(axis=2), 0.5 * width)
    # The lift is 0 during a contact and rises over the frames before and after it.
    is_free = np.pad(~stands, width, constant_values=True)
    free_windows = np.lib.stride_tricks.sliding_window_view(is_free, 2 * width + 1)
    distances = np.abs(np.arange(2 * width + 1) - width)
    frames_from_contact = np.where(free_windows, width + 1, distances).min(axis=1)
    return smooth * np.minimum(frames_from_contact / _RISE_FRAMES, 1.0)[:, None]


def _plants(
    points: FloatArray, contacts: BoolArray, lowest: FloatArray, ground: Ground, leg: int
) -> tuple[list[_Plant], list[_Plant]]:
    """Return the plants of the heel and those of the toe; none is below `lowest`.

    If a plant of the heel and one of the toe overlap in time, the later one is moved horizontally:
    their distance becomes the mean distance of heel and toe in the shared frames.
    """
    plants: tuple[list[_Plant], list[_Plant]] = ([], [])
    intervals = [
        (start, stop - 1, point)
        for point in range(2)
        for start, stop in find_runs(contacts[:, point]).tolist()
    ]
    for first, last, point in sorted(intervals):
        position = points[first : last + 1, point].mean(axis=0)
        height = position @ ground.up - ground.floors[leg, point]
        deepest = lowest[first : last + 1, point].max() - ground.floors[leg, point]
        deepest = max(deepest, -_MAX_DEPTH * ground.height)
        clamped = np.clip(height, deepest, CONTACT_HEIGHT * ground.height)
        position = position + (clamped - height) * ground.up
        for other in plants[1 - point]:
            both = slice(max(first, other.first), min(last, other.last) + 1)
            if both.start >= both.stop:
                continue
            length = np.linalg.norm(points[both, 1] - points[both, 0], axis=-1).mean()
            offset = position - other.position
            # Without a known toe the foot has no length and no direction. The plant keeps its
            # height: vertical moves would add up from plant to plant.
            if length > 0:
                offset = _with_rise(offset, offset @ ground.up, length, ground.up)
                position = other.position + offset
                break
        plants[point].append(_Plant(first, last, position))
    return plants


def _fade(
    track: FloatArray, plants: Sequence[_Plant], up: FloatArray, width: int
) -> tuple[FloatArray, FloatArray]:
    """Return the displacements of a heel or toe to its plants, and the weights of the plants.

    The weight is 1 during a plant. Before and after it, weight and displacement fall to 0 within
    `width` frames, or before the next plant. Their slope is 0 next to the plant, so that the
    velocity is continuous. A downward displacement fades faster, so that a lifted foot does not
    drag.
    """
    displacements, holds = np.zeros_like(track), np.zeros(len(track))
    for plant in plants:
        rows = slice(plant.first, plant.last + 1)
        displacements[rows] = plant.position - track[rows]
        holds[rows] = 1.0
    ends = [(plant.last, 1) for plant in plants] + [(plant.first, -1) for plant in plants]
    for end, direction in ends:
        frames = end + direction * np.arange(1, width + 1)
        frames = frames[(frames >= 0) & (frames < len(track))]
        held = np.flatnonzero(holds[frames] == 1.0)
        frames = frames[: held[0]] if len(held) else frames  # at most up to the next plant
        t = np.abs(frames - end) / (min(width, len(frames)) + 1)
        weight = 1.0 + t * t * (2.0 * t - 3.0)
        down = min(float(displacements[end] @ up), 0.0) * up
        level = weight[:, None] * (displacements[end] - down)
        displacements[frames] += level + weight[:, None] ** 3 * down
        holds[frames] = np.minimum(holds[frames] + weight, 1.0)
    return displacements, holds
