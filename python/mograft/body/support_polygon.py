"""The support polygon, convex hull of the soles that carry weight, and the zero-moment point.

Lengths of the foot are those of an average adult, as multiples of the skeleton height.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.body.contacts import Ground
from mograft.errors import InsufficientDataError, join_names
from mograft.motion.motion import Motion

_MAX_CONTACT_HEIGHT = 0.035  # of an ankle or toe that carries weight, above its floor
_HEEL_LENGTH = 0.035  # distance from the ankle back to the end of the heel
_FOOT_LENGTH = 0.117  # distance from the ankle to the tip of the foot
_BALL_HALF_WIDTH, _TIP_HALF_WIDTH = 0.0275, 0.0165
_MIN_FOOT_EXTENT = 0.02  # horizontal distance from ankle to toe of a foot with a direction
GRAVITY = 9.81  # m/s²
STATURE_METERS = 1.75  # assumed stature, to convert gravity to the unit of a file
_MIN_LOAD = 0.2  # share of gravity that the floor must carry for a zero-moment point to exist
_FRAMES_PER_BATCH = 1024  # in memory together with their extents along all directions


@dataclass(frozen=True, eq=False)
class Support:
    """Support polygons of a motion, and the floor that they lie on.

    Attributes
    ----------
    polygons : ndarray, shape (n_frames, n_vertices, 2)
        Vertices of the convex support polygons on the floor, counterclockwise, in the unit of
        the file. The last vertex is repeated as padding.
    sizes : ndarray of int, shape (n_frames,)
        Number of vertices without the padding; 0 in flight.
    axes : tuple of int
        Indices of the two horizontal axes, those of the coordinates of `polygons`.
    up : ndarray, shape (3,)
        Unit vector that points up.
    floor, height : float
        Height of the floor along `up`, and skeleton height, in the unit of the file.
    """

    polygons: FloatArray
    sizes: IntArray
    axes: tuple[int, int]
    up: FloatArray
    floor: float
    height: float


def convex_hull(points: FloatArray) -> FloatArray:
    """Return the vertices of the convex hull of points in the plane.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        The points, in any order.

    Returns
    -------
    ndarray, shape (n_vertices, 2)
        Vertices, counterclockwise from the one with the smallest first coordinate. No vertex
        lies on the segment between two others. Collinear points have two vertices, equal
        points have one.

    Notes
    -----
    Andrew's monotone chain, Information Processing Letters 9 (1979). Unlike
    `scipy.spatial.ConvexHull`, it accepts collinear points.

    Examples
    --------
    >>> convex_hull(np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 0.5], [2.0, 2.0]])).tolist()
    [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]]
    """
    ascending = sorted(set(map(tuple, np.asarray(points, np.float64).tolist())))
    if len(ascending) <= 2:
        return np.array(ascending, np.float64).reshape(-1, 2)
    halves = []
    for ordered in (ascending, ascending[::-1]):
        chain: list[tuple[float, ...]] = []
        for x, y in ordered:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-2], chain[-1]
                if (bx - ax) * (y - ay) > (by - ay) * (x - ax):
                    break
                chain.pop()
            chain.append((x, y))
        halves.append(chain[:-1])
    return np.array(halves[0] + halves[1], np.float64)


def signed_distance(polygons: FloatArray, sizes: IntArray, points: FloatArray) -> FloatArray:
    """Return the distance of each point to the edge of its convex polygon, shape (n,).

    `points` has shape (n, 2). Polygons are as in `Support`: counterclockwise vertices, shape (n,
    n_vertices, 2), and the number of vertices of each polygon in `sizes`. Distances are negative
    inside and positive outside. Polygons with one or two vertices have no inside. The distance is
    NaN for polygons without vertices.
    """
    starts, ends = polygons, np.roll(polygons, -1, axis=1)
    edges, offsets = ends - starts, points[:, None] - starts
    lengths = np.linalg.norm(edges, axis=-1)
    has_length = lengths > 0
    along, zeros = (offsets * edges).sum(-1), np.zeros_like(lengths)
    fractions = np.divide(along, lengths**2, out=zeros, where=has_length)
    to_edges = offsets - fractions.clip(0.0, 1.0)[..., None] * edges
    distances = np.linalg.norm(to_edges, axis=-1).min(axis=1, initial=np.inf)
    # A point to the right of a counterclockwise edge is outside.
    crosses = edges[..., 1] * offsets[..., 0] - edges[..., 0] * offsets[..., 1]
    outside = np.full_like(lengths, -np.inf)
    right_of_edge = np.divide(crosses, lengths, out=outside, where=has_length)
    is_inside = (right_of_edge.max(axis=1, initial=-np.inf) <= 0) & (sizes > 2)
    signed: FloatArray = np.where(is_inside, -distances, distances)
    return np.where(sizes > 0, signed, np.nan)


def support_polygons(motion: Motion, *, floor_reference: Motion | None = None) -> Support:
    """Return the support polygon of each frame.

    Parameters
    ----------
    motion : Motion
        Motion on an even floor.
    floor_reference : Motion, optional
        Motion of the same hierarchy on the same floor, which determines the height of the floor.
        Default: `motion`.

    Returns
    -------
    Support
        Convex hulls of the soles that touch the floor.

    Raises
    ------
    InsufficientDataError
        If the skeleton has no known leg.
    SkeletonMismatchError
        If `floor_reference` has another hierarchy.

    Notes
    -----
    All lengths are in skeleton heights. The floor of an ankle or toe joint is the 5th percentile of
    the height of the joint. A joint touches its floor if it is less than 0.035 above the floor, at
    any speed. The heel ends 0.035 behind an ankle that touches the floor. The tip of the foot is
    0.117 from the ankle. The sole is 0.055 wide at the ball of the foot and 0.033 at the tip.
    """
    ground = Ground.below(motion, floor_reference)
    if not ground.limbs:
        names = f"among the joints {join_names(motion.skeleton.names)}"
        raise InsufficientDataError(f"balance needs legs, but no leg is known {names}")
    axes = horizontal_axes(ground.up)
    corners, carries = _soles(motion, ground)
    hulls = [convex_hull(points[is_used]) for points, is_used in zip(corners, carries, strict=True)]
    sizes = np.array([len(hull) for hull in hulls], np.int64)
    polygons = np.zeros((len(hulls), max(int(sizes.max(initial=1)), 1), 2))
    for frame, hull in enumerate(hulls):
        if len(hull):
            polygons[frame] = hull[np.minimum(np.arange(polygons.shape[1]), len(hull) - 1)]
    return Support(
        polygons=polygons,
        sizes=sizes,
        axes=axes,
        up=ground.up,
        floor=float(ground.floors.min()),
        height=ground.height,
    )


def horizontal_axes(up: FloatArray) -> tuple[int, int]:
    """Return the indices of the horizontal axes; their cross product, in this order, is `up`.

    `up` is a unit vector along one of the three axes.
    """
    axis = int(np.flatnonzero(up)[0])
    first, second = (axis + 1) % 3, (axis + 2) % 3
    return (second, first) if up[axis] < 0 else (first, second)


def facing_directions(motion: Motion, ground: Ground) -> FloatArray:
    """Return the horizontal direction that the hips face in each frame, shape (n_frames, 3).

    The vectors are zero if the skeleton has no pair of legs or the hip line is vertical.
    """
    hips = {limb.side: limb.hip for limb in reversed(ground.limbs)}
    if not {"left", "right"} <= hips.keys():
        return np.zeros((motion.n_frames, 3))
    left, right = hips["left"], hips["right"]
    lines = np.concatenate([own[:, left] - own[:, right] for _, _, own in motion.world_blocks()])
    return normalize(np.cross(lines, ground.up))


def normalize(vectors: FloatArray) -> FloatArray:
    """Return unit vectors; zero vectors stay zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)


def support_extents(
    motion: Motion, ground: Ground, frames: IntArray, directions: FloatArray
) -> FloatArray:
    """Return how far the support polygons of some frames extend along horizontal directions.

    `directions` are unit vectors for each of `frames`, shape (n, n_directions, 3). The result,
    shape (n, n_directions), has the greatest coordinate of the polygon along each direction, in the
    unit of the file: the support function of the polygon. The result is -inf in frames in which no
    foot carries weight.
    """
    extents = np.empty(directions.shape[:2])
    axes = horizontal_axes(ground.up)
    for start in range(0, len(frames), _FRAMES_PER_BATCH):
        batch = slice(start, start + _FRAMES_PER_BATCH)
        quats, places = (own[frames[batch]] for own in (motion.rotations, motion.positions))
        poses = Motion(motion.skeleton, motion.frame_time, quats, places)
        corners, carries = _soles(poses, ground)
        along = corners @ directions[batch][..., axes].swapaxes(1, 2)
        along[~carries] = -np.inf
        extents[batch] = along.max(axis=1, initial=-np.inf)
    return extents


def _soles(motion: Motion, ground: Ground) -> tuple[FloatArray, BoolArray]:
    """Return the corners of all soles, and which of them carry weight.

    The corners, shape (n_frames, 6 * n_legs, 2), have coordinates along `horizontal_axes`. The
    second array has shape (n_frames, 6 * n_legs).
    """
    axes = horizontal_axes(ground.up)
    joints = ground.points(motion)
    touches = ground.above(joints) < _MAX_CONTACT_HEIGHT * ground.height
    horizontal = joints[..., axes]
    forward = facing_directions(motion, ground)[:, axes]
    soles = [
        _sole_corners(horizontal[:, i], touches[:, i], joints[:, i], forward, ground.height)
        for i in range(len(ground.limbs))
    ]
    corners, carries = (np.concatenate(own, axis=1) for own in zip(*soles, strict=True))
    return corners, carries


def _sole_corners(
    horizontal: FloatArray,
    touches: BoolArray,
    joints: FloatArray,
    forward: FloatArray,
    height: float,
) -> tuple[FloatArray, BoolArray]:
    """Return the corners of one sole, shape (n_frames, 6, 2), and which of them carry weight.

    `horizontal` has the floor coordinates of ankle and toe, and `joints` their world positions;
    `touches` states which of the two touch the floor. `forward`, the direction that the hips face,
    replaces the direction from ankle to toe if the two are nearly above each other.
    """
    ankle, toe = horizontal[:, 0], horizontal[:, 1]
    foot = toe - ankle
    has_direction = np.linalg.norm(foot, axis=1) >= _MIN_FOOT_EXTENT * height
    ahead = np.where(has_direction[:, None], normalize(foot), forward)
    sideways = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) * height
    joint_distance = np.linalg.norm(joints[:, 1] - joints[:, 0], axis=1)
    tip_length = np.maximum(_FOOT_LENGTH * height - joint_distance, 0.0)
    heel, tip = ankle - _HEEL_LENGTH * height * ahead, toe + tip_length[:, None] * ahead
    edges = ((heel, _BALL_HALF_WIDTH), (toe, _BALL_HALF_WIDTH), (tip, _TIP_HALF_WIDTH))
    pairs = product(edges, (1.0, -1.0))
    corners = [center + side * width * sideways for (center, width), side in pairs]
    carries = [touches[:, 0], touches.any(axis=1), touches[:, 1]]
    return np.stack(corners, axis=1), np.repeat(np.stack(carries, axis=1), 2, axis=1)


def zero_moment_points(
    position: FloatArray, acceleration: FloatArray, up: FloatArray, floor: float, height: float
) -> tuple[FloatArray, BoolArray]:
    """Return the zero-moment point of a point mass in each frame, and whether it exists.

    The point is x - (z - floor) ẍ / (z̈ + g) along each horizontal axis, with the coordinate x and
    the height z of the centre of mass (Vukobratović and Borovac, International Journal of Humanoid
    Robotics 1, 2004). `position` and `acceleration`, shape (n_frames, 3), are those of the centre
    of mass. `up` is a unit vector, `floor` the height of the floor along `up`, and `height` the
    skeleton height. Lengths are in the unit of the file, times in seconds. The point does not
    exist, and `position` is returned, if the floor carries less than a fifth of the weight.
    """
    gravity = GRAVITY * height / STATURE_METERS
    load = acceleration @ up + gravity
    is_loaded: BoolArray = load > _MIN_LOAD * gravity
    lever = (position @ up - floor) / np.where(is_loaded, load, np.inf)
    points: FloatArray = position - lever[:, None] * acceleration
    return points, is_loaded
