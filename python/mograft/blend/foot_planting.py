"""Feet that stand still: how legs are bent so that feet stand where they should.

After Kovar, Schreiner and Gleicher, Footskate Cleanup for Motion Capture Editing (2002).
Lengths are in skeleton heights, so that no number depends on a file's unit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft._util.gaussian import gaussian_filter
from mograft._util.validate import check_type
from mograft.blend.recombine import Part, recombine
from mograft.body.contacts import (
    CONTACT_HEIGHT,
    SLIDING_SPEED,
    Ground,
    Leg,
    detect_contacts,
    find_legs,
    point_speeds,
    runs,
    skating_share,
)
from mograft.config import FRAME
from mograft.motion import rotations
from mograft.motion.motion import Motion

__all__ = ["FeetReport", "plant_feet"]

_BLEND = 3 * FRAME
_ROOT_BLEND = 3 * FRAME
_STRAIGHT = 0.995
_CLEAR = 0.05
"""Heights at which a foot that swings is clear of the floor."""
_RISE = 1.5
"""Frames after a plant from which on it is lifted."""
_FAR = 0.1
"""Heights from its mean place at which a foot that moves fast steps instead of sliding."""
_SINK = 0.01
"""Heights by which a plant may be below the floor; above it, as near as in `contacts`."""
_MISSED = 1e-4
"""Heights by which a foot may be off its plant before it counts as out of reach."""
_SWEEPS, _SPARE = 1000, 0.9999
"""How often too great a speed of the root is passed on to the frames beside, and down to what."""


@dataclass(frozen=True)
class FeetReport:
    """What the clean-up of feet did.

    Attributes
    ----------
    plants : int
        How many times a heel or a toe stands.
    skate_before, skate_after : float
        Share of feet and frames that skate; see `foot_skate`.
    moved_root : float
        Greatest way by which the root was moved, in skeleton heights.
    unreached : float
        Greatest distance of a heel or toe from its plant, in skeleton heights.
    unreached_frames : int
        Frames in which some distance is above 1e-4 skeleton heights.
    """

    plants: int
    skate_before: float
    skate_after: float
    moved_root: float
    unreached: float
    unreached_frames: int


def plant_feet(
    motion: Motion,
    foot_contacts: BoolArray | None = None,
    *,
    movable_legs: Sequence[bool] | None = None,
    move_root: bool = True,
    floor_reference: Motion | None = None,
    min_heights: FloatArray | None = None,
) -> tuple[Motion, FeetReport]:
    """Make feet stand still where they stand.

    Parameters
    ----------
    motion : Motion
        The motion.
    foot_contacts : ndarray of bool, shape (n_frames, n_legs, 2), optional
        When heels and toes stand. Default: `contacts` of the motion.
    movable_legs : sequence of bool, optional
        Which of `legs` may be bent. Default: all.
    move_root : bool
        Whether the root may be moved where a leg is too short.
    floor_reference : Motion, optional
        A motion of the same skeleton on the same floor, to find the floor by; longer ones
        tell it better. Default: the motion.
    min_heights : ndarray, shape (n_frames, n_legs, 2), optional
        How high heels and toes should be above the floor, in skeleton heights: where they do
        not stand and would drag lower over the floor, they are lifted so high, or just clear
        of it. Default: as they are.

    Returns
    -------
    motion : Motion
        The motion with legs bent, and the root moved only where a leg does not reach. Where
        nothing is to be done every number stays.
    report : FeetReport
        What was done, and what stayed out of reach.

    Raises
    ------
    ValueError
        If `foot_contacts`, `movable_legs` or `min_heights` do not fit the motion's legs.

    Notes
    -----
    A heel or toe stands at its mean place, 0.01 heights below to 0.03 above the floor; between
    plants its way there fades within 3 frames of 1/30 s. With `min_heights` a foot between plants
    is no lower than they say, up to 0.05.
    The leg is then bent in its own plane, at the knee so that it is as long as needed and at the
    hip so that it points there; the foot keeps its turn in the world.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> still, report = plant_feet(dance(strides=1).motion)
    >>> report.skate_after <= report.skate_before
    True
    """
    check_type("motion", motion, Motion)
    limbs = find_legs(motion.skeleton)
    given = detect_contacts(motion) if foot_contacts is None else np.asarray(foot_contacts, bool)
    if given.shape != (motion.n_frames, len(limbs), 2):
        wanted = (motion.n_frames, len(limbs), 2)
        raise ValueError(f"foot_contacts must have shape {wanted}, got {given.shape}")
    may_bend = [True] * len(limbs) if movable_legs is None else [bool(one) for one in movable_legs]
    if len(may_bend) != len(limbs):
        raise ValueError(f"movable_legs must tell of {len(limbs)} legs, got {len(may_bend)}")
    if min_heights is not None and min_heights.shape != given.shape:
        raise ValueError(f"min_heights must have shape {given.shape}, got {min_heights.shape}")
    ground = Ground.of(motion if floor_reference is None else floor_reference)
    before = skating_share(motion, ground)
    if (min_heights is None and not given.any()) or not any(may_bend):
        return motion, FeetReport(0, before, before, 0.0, 0.0, 0)
    turned, placed = motion.world_transforms()
    points = ground.points(motion)
    parted = _parted(given, points, ground, motion.rate)
    least = np.full(given.shape, -np.inf) if min_heights is None else min_heights
    least = np.where(given & ~parted, _CLEAR, least)
    given = parted
    ways = np.zeros_like(points)
    for index, bend in enumerate(may_bend):
        if bend:
            ways[:, index] = _ways(
                points[:, index], given[:, index], least[:, index], ground, index, motion.rate
            )
    given = given & np.array(may_bend)[None, :, None]
    shift = np.zeros((motion.n_frames, 3))
    if move_root:
        shift = _root_shift(limbs, placed, ways[:, :, 0], given.any(axis=2), motion.rate)
        shift = _no_faster(shift, placed[:, motion.locomotion_root()], ground.up)
    parts = [
        _bent(
            motion,
            turned,
            placed + shift[:, None],
            limb,
            ways[:, i] - shift[:, None],
            points[:, i] + shift[:, None],
        )
        for i, limb in enumerate(limbs)
        if may_bend[i]
    ]
    parts = [part for part in parts if len(part.joints)]
    if shift.any():
        parts.append(_shifted(motion, turned, shift))
    still = recombine(motion, parts, motion.name)
    off = np.linalg.norm(ground.points(still) - (points + ways), axis=-1) / ground.height
    missed = np.where(given, off, 0.0)
    report = FeetReport(
        sum(len(runs(given[:, i, k])) for i in range(len(limbs)) for k in range(2)),
        before,
        skating_share(still, ground),
        float(np.linalg.norm(shift, axis=1).max()) / ground.height,
        float(missed.max()),
        int((missed > _MISSED).any(axis=(1, 2)).sum()),
    )
    return still, report


def _parted(stands: BoolArray, points: FloatArray, ground: Ground, rate: float) -> BoolArray:
    """Return when heels and toes stand without the frames in which they go fast.

    Where donors' feet stand on both sides of a seam, but far apart, they are no one plant: the
    root would be pulled half way between the two. They step.
    """
    parted = stands.copy()
    fast = point_speeds(points, rate) >= SLIDING_SPEED * ground.height
    for leg, point in np.ndindex(stands.shape[1:]):
        for first, last in runs(stands[:, leg, point]):
            own = slice(first, last + 1)
            places = points[own, leg, point]
            off = np.linalg.norm(places - places.mean(axis=0), axis=1)
            if off.max() > _FAR * ground.height:
                parted[own, leg, point] = ~fast[own, leg, point]
    return parted


def _lifts(
    points: FloatArray,
    stands: BoolArray,
    heights: FloatArray,
    ground: Ground,
    index: int,
    rate: float,
) -> FloatArray:
    """Return by how much a heel and a toe must be lifted where they would drag, in file units."""
    above = points @ ground.up - ground.floors[index]
    lack: FloatArray = np.maximum(np.minimum(heights, _CLEAR) * ground.height - above, 0.0)
    held = stands.any(axis=1)
    lack[held] = 0.0
    if not lack.any():
        return lack
    # As the root's shift: the highest lift nearby, then smoothed; it begins where a plant ends.
    around = max(round(_BLEND * rate), 1)
    padded = np.pad(lack, ((around, around), (0, 0)), mode="edge")
    most = np.lib.stride_tricks.sliding_window_view(padded, 2 * around + 1, axis=0).max(axis=2)
    smooth = np.stack([gaussian_filter(own, 0.5 * around) for own in most.T], axis=1)
    near = np.pad(~held, around, constant_values=True)
    windows = np.lib.stride_tricks.sliding_window_view(near, 2 * around + 1)
    off = np.abs(np.arange(2 * around + 1) - around)
    steps = np.where(windows, around + 1, off).min(axis=1)
    lifts: FloatArray = smooth * np.minimum(steps / _RISE, 1.0)[:, None]
    return lifts


def _ways(
    points: FloatArray,
    stands: BoolArray,
    heights: FloatArray,
    ground: Ground,
    index: int,
    rate: float,
) -> FloatArray:
    """Return the ways of a heel and toe to where they should be, shape (n_frames, 2, 3).

    What does not stand goes with the other, if that does, and is lifted.
    """
    own, holds = np.zeros_like(points), np.zeros(stands.shape)
    targets = _targets(points, stands, ground, index)
    blend = max(round(_BLEND * rate), 1)
    for point in range(2):
        own[:, point], holds[:, point] = _faded(points[:, point], targets[point], ground.up, blend)
    ways: FloatArray = own + (1.0 - holds)[..., None] * own[:, ::-1]
    lifts = _lifts(points + ways, stands, heights, ground, index, rate)
    ways += lifts[..., None] * ground.up
    # A foot is as long as it is: the one of heel and toe that stands has its way, and in between
    # the one that holds more firmly.
    heel, toe = holds[:, 0] * (1.0 - holds[:, 1]), holds[:, 1] * (1.0 - holds[:, 0])
    yields = toe / np.where(toe + heel > 0, toe + heel, 1.0)
    yields = np.where(stands[:, 1] > stands[:, 0], 1.0, np.where(stands[:, 0], 0.0, yields))
    foot, to = points[:, 1] - points[:, 0], points[:, 1] - points[:, 0] + ways[:, 1] - ways[:, 0]
    length, wanted = np.linalg.norm(foot, axis=1), np.linalg.norm(to, axis=1)
    off = np.where(wanted > 0, 1.0 - length / np.where(wanted > 0, wanted, 1.0), 0.0)
    ways[:, 0] += (yields * off)[:, None] * to
    ways[np.abs(ways).max(axis=(1, 2)) < 1e-12 * ground.height] = 0.0
    return ways


def _targets(
    points: FloatArray, stands: BoolArray, ground: Ground, index: int
) -> tuple[list[tuple[int, int, FloatArray]], ...]:
    """Return the plants of a heel and of a toe: first and last frame, and where.

    Where both stand, they keep the distance that they have: the later goes by the earlier.
    """
    plants: tuple[list[tuple[int, int, FloatArray]], ...] = ([], [])
    order = [(int(a), int(b), k) for k in range(2) for a, b in runs(stands[:, k])]
    for first, last, point in sorted(order):
        place = points[first : last + 1, point].mean(axis=0)
        high = place @ ground.up - ground.floors[index, point]
        stays = np.clip(high, -_SINK * ground.height, CONTACT_HEIGHT * ground.height)
        place = place + (stays - high) * ground.up
        for start, stop, other in plants[1 - point]:
            both = slice(max(first, start), min(last, stop) + 1)
            if both.start < both.stop:
                length = np.linalg.norm(points[both, 1] - points[both, 0], axis=-1).mean()
                apart = place - other
                # A foot whose toe is not known has no length, and no direction either.
                if length > 0 and apart.any():
                    place = other + apart * (length / np.linalg.norm(apart))
                    break
        plants[point].append((first, last, place))
    return plants


def _faded(
    track: FloatArray, plants: Sequence[tuple[int, int, FloatArray]], up: FloatArray, blend: int
) -> tuple[FloatArray, FloatArray]:
    """Return the ways to plants and how firmly they hold, fading where nothing stands.

    Outside a plant the way is that at its end, fading to none, or over to the next one's. A
    foot leaves its plant as fast as it did: to start it from rest would make it rush after.
    The way down fades sooner, lest a foot that has been lifted drags over the floor.
    """
    ways, holds = np.zeros_like(track), np.zeros(len(track))
    for first, last, place in plants:
        ways[first : last + 1] = place - track[first : last + 1]
        holds[first : last + 1] = 1.0
    for at, sign in [(p[1], 1) for p in plants] + [(p[0], -1) for p in plants]:
        frames = at + sign * np.arange(1, blend + 1)
        frames = frames[(frames >= 0) & (frames < len(track))]
        held = np.flatnonzero(holds[frames] == 1.0)
        frames = frames[: held[0]] if len(held) else frames  # up to the next plant at most
        width = min(blend, len(frames)) + 1
        t = np.abs(frames - at) / width
        hold = 1.0 + t * t * (2.0 * t - 3.0)
        down = min(float(ways[at] @ up), 0.0) * up
        ways[frames] += hold[:, None] * (ways[at] - down) + hold[:, None] ** 3 * down
        holds[frames] = np.minimum(holds[frames] + hold, 1.0)
    return ways, holds


def _root_shift(
    limbs: Sequence[Leg], placed: FloatArray, ways: FloatArray, stands: BoolArray, rate: float
) -> FloatArray:
    """Return by how much the root must move so that legs reach, shape (n_frames, 3)."""
    centers, radii = [], []
    for index, limb in enumerate(limbs):
        hip, knee, ankle = (placed[:, j] for j in (limb.hip, limb.knee, limb.ankle))
        whole = np.linalg.norm(knee - hip, axis=1) + np.linalg.norm(ankle - knee, axis=1)
        now = np.linalg.norm(ankle - hip, axis=1)
        centers.append(ankle + ways[:, index] - hip)
        radii.append(np.where(stands[:, index], np.maximum(_STRAIGHT * whole, now), np.inf))

    def within(shift: FloatArray) -> FloatArray:
        for _ in range(10):
            for center, radius in zip(centers, radii, strict=True):
                back = shift - center
                far = np.linalg.norm(back, axis=1)
                out = far > radius * (1.0 + 1e-9)
                shift = shift.copy()
                shift[out] = center[out] + back[out] * (radius[out] / far[out])[:, None]
        return shift

    nearest = within(np.zeros((len(placed), 3)))
    if not nearest.any():
        return nearest
    # Each frame takes the farthest shift nearby before they are smoothed, so that the smooth
    # one goes as far: mending it afterwards would make the root leap.
    around = round(2 * _ROOT_BLEND * rate)
    far = np.pad(np.linalg.norm(nearest, axis=1), around, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(far, 2 * around + 1)
    pick = (np.arange(len(nearest)) + windows.argmax(axis=1) - around).clip(0, len(nearest) - 1)
    smooth = np.stack(
        [gaussian_filter(axis, _ROOT_BLEND * rate) for axis in nearest[pick].T], axis=1
    )
    return within(smooth)


def _no_faster(shift: FloatArray, path: FloatArray, up: FloatArray) -> FloatArray:
    """Return a shift with which a path goes over the floor no faster than at its fastest.

    Frames that would be too far apart are moved towards each other, and the next ones after.
    """
    level = np.eye(3) - np.outer(up, up)
    own, wanted = path @ level, (path + shift) @ level
    most = np.linalg.norm(np.diff(own, axis=0), axis=1).max(initial=0.0)
    moved = wanted.copy()
    for _ in range(_SWEEPS if most > 0 else 0):
        steps = np.diff(moved, axis=0)
        speeds = np.linalg.norm(steps, axis=1)
        over = np.flatnonzero(speeds > most)
        if not len(over):
            return shift + (moved - wanted)
        # To a little less, so that there is an end to it.
        too_far = 0.5 * (1.0 - _SPARE * most / speeds[over])[:, None] * steps[over]
        moved[over] += too_far
        moved[over + 1] -= too_far
    return shift + (own - wanted)


def _shifted(motion: Motion, turned: FloatArray, shift: FloatArray) -> Part:
    """Return the root, moved in the world."""
    root = motion.locomotion_root()
    parent = int(motion.skeleton.parents[root])
    if parent >= 0:
        shift = rotations.rotate(rotations.inverse(turned[:, parent]), shift)
    places = motion.positions[:, root] + shift
    quats = motion.rotations[:, root]
    return Part(np.array([root]), quats[:, None], places[:, None])


def _bent(
    motion: Motion,
    turned: FloatArray,
    placed: FloatArray,
    limb: Leg,
    ways: FloatArray,
    points: FloatArray,
) -> Part:
    """Return a leg bent so that its heel and toe go the ways; no joints where there are none."""
    joints = np.array([limb.hip, limb.knee, limb.ankle])
    none = np.zeros(0, np.int64)
    moves = np.flatnonzero((ways != 0.0).any(axis=(1, 2)))
    if not len(moves):
        return Part(none, np.zeros((0, 0, 4)), np.zeros((0, 0, 3)))
    hinge = _hinges(turned, placed, limb)[moves]
    hip, knee, ankle = (placed[moves, joint] for joint in joints)
    wanted, aim = points[moves] + ways[moves], points[moves]
    at_hip, at_knee = two_bones(hip, knee, ankle, wanted[:, 0], hinge)
    foot, to = aim[:, 1] - aim[:, 0], wanted[:, 1] - wanted[:, 0]
    roll = rotations.shortest_arc(foot, to)

    quats = motion.rotations[:, joints].copy()
    turns = (at_hip, at_knee, _chain(rotations.inverse(at_knee), rotations.inverse(at_hip), roll))
    for column, (joint, turn) in enumerate(zip(joints, turns, strict=True)):
        parent = int(motion.skeleton.parents[joint])
        above = (
            turned[moves, parent]
            if parent >= 0
            else np.broadcast_to(rotations.IDENTITY, turn.shape)
        )
        quats[moves, column] = _chain(rotations.inverse(above), turn, turned[moves, joint])
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    quats = np.where(
        (ways != 0.0).any(axis=(1, 2))[:, None, None], quats, motion.rotations[:, joints]
    )
    return Part(joints, quats, motion.positions[:, joints])


def _chain(*turns: FloatArray) -> FloatArray:
    product = turns[0]
    for turn in turns[1:]:
        product = rotations.multiply(product, turn)
    return product


def _hinges(turned: FloatArray, placed: FloatArray, limb: Leg) -> FloatArray:
    """Return the axis that each frame's knee bends about, in the world.

    That of its own plane; of a leg that is nearly straight, which has none, more and more that
    of the leg's other frames, seen from the thigh.
    """
    thigh, shank = placed[:, limb.hip] - placed[:, limb.knee], placed[:, limb.ankle]
    shank = shank - placed[:, limb.knee]
    lengths = np.linalg.norm(thigh, axis=1) * np.linalg.norm(shank, axis=1)
    across = np.cross(thigh, shank) / np.where(lengths > 0, lengths, 1.0)[:, None]
    local = rotations.rotate(rotations.inverse(turned[:, limb.hip]), across)
    mean = local.sum(axis=0)
    if np.linalg.norm(mean) < 1e-9:  # never bent: any axis across the leg
        along = rotations.rotate(rotations.inverse(turned[:1, limb.hip]), thigh[:1])[0]
        mean = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    usual = rotations.rotate(
        turned[:, limb.hip], np.tile(mean / np.linalg.norm(mean), (len(turned), 1))
    )
    axes = across + 0.1 * usual
    normal: FloatArray = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    return normal


def two_bones(
    start: FloatArray, middle: FloatArray, end: FloatArray, wanted: FloatArray, hinge: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Bend a limb of two bones so that its end is where it should be.

    Parameters
    ----------
    start, middle, end : ndarray, shape (n, 3)
        Where the limb starts, bends and ends.
    wanted : ndarray, shape (n, 3)
        Where its end should be; out of reach, it goes as near as it can.
    hinge : ndarray, shape (n, 3)
        Unit axes about which it bends, the cross product of thigh and shank for a knee,
        roughly across both.

    Returns
    -------
    at_start, at_middle : ndarray, shape (n, 4)
        Turns in the world: of the whole limb about its start, and before that of the lower
        bone about the middle.
    """
    upper, lower = start - middle, end - middle

    def split(vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
        along = (vectors * hinge).sum(axis=1)
        return along, vectors - along[:, None] * hinge

    upper_along, upper_across = split(upper)
    lower_along, lower_across = split(lower)
    turn = np.linalg.norm(upper_across, axis=1) * np.linalg.norm(lower_across, axis=1)
    reach = ((wanted - start) ** 2).sum(axis=1)
    cosine = 0.5 * ((upper**2).sum(axis=1) + (lower**2).sum(axis=1) - reach)
    cosine = (cosine - upper_along * lower_along) / np.maximum(turn, 1e-300)
    now = np.arctan2(
        (np.cross(upper_across, lower_across) * hinge).sum(axis=1),
        (upper_across * lower_across).sum(axis=1),
    )
    bend = np.arccos(cosine.clip(-1.0, 1.0)) - now
    half = 0.5 * bend[:, None]
    at_middle = np.concatenate([np.sin(half) * hinge, np.cos(half)], axis=1)
    bent = middle + rotations.rotate(at_middle, lower) - start
    straight, aim = end - start, wanted - start
    # In two steps, so that the plane of the limb is turned no more than its direction.
    at_start = rotations.multiply(
        rotations.shortest_arc(straight, aim), rotations.shortest_arc(bent, straight)
    )
    return at_start, at_middle
