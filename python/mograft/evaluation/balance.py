"""Whether a figure could stand as it does: centre of mass over the feet (paper, 5.5, table 3).

Static balance is a poor measure of naturalness: people who walk are out of it in every step.
What it can tell is whether grafts are further out than the recording they were made on.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.segmentation import Segments
from mograft.body.contacts import Ground
from mograft.body.mass import center_of_mass, mass_model
from mograft.errors import InsufficientDataError
from mograft.evaluation import estimate
from mograft.evaluation.estimate import Estimate
from mograft.motion.motion import Motion

__all__ = [
    "PAPER_TABLE",
    "RULES",
    "Balance",
    "BalanceRow",
    "Support",
    "balance_row",
    "convex_hull",
    "dynamic_balance",
    "signed_distance",
    "static_balance",
    "support",
]

PAPER_TABLE: Mapping[str, tuple[float, int]] = {
    "contact pattern": (85.8, 478),
    "analogy": (81.7, 478),
    "original": (64.0, 478),
}
"""Unbalanced segments, mean of 10 runs, and all segments, that the paper prints in table 3."""

Rule = Literal["all", "majority", "any"]
RULES: tuple[Rule, ...] = ("all", "majority", "any")

_NEAR = 0.035
"""Heights above its floor at which an ankle or toe bears weight, however fast it moves."""
_HEEL, _WIDE, _TIP_WIDE, _FOOT = 0.035, 0.0275, 0.0165, 0.117
"""The sole in heights: heel behind the ankle, half widths at ball and tip, ankle to tip."""
_POINTED = 0.02
"""Heights below which the way from ankle to toe over the floor points nowhere."""
_EDGE = 0.01
"""Heights about a support of one point or a line that count as upon it."""
_STATURE = 1.75
_GRAVITY = 9.81
_SMOOTH = 0.2
_FALLING = 0.2
"""Share of gravity that the floor must bear for a zero-moment point to be anywhere."""


@dataclass(frozen=True, eq=False)
class Support:
    """What a motion stands on, frame by frame.

    Attributes
    ----------
    polygons : ndarray, shape (n_frames, n_vertices, 2)
        Vertices of the convex support polygon over the floor, counterclockwise, in the file's
        unit; the last one is repeated to fill up.
    sizes : ndarray of int, shape (n_frames,)
        How many vertices each has; 0 in flight.
    touching : ndarray of bool, shape (n_frames, n_legs)
        Which feet bear weight.
    axes : tuple of int
        The two axes of the floor.
    up : ndarray, shape (3,)
        Unit vector that points up.
    floor : float
        Height of the floor along it, in the file's unit.
    height : float
        Stature in the file's unit.
    """

    polygons: FloatArray
    sizes: IntArray
    touching: BoolArray
    axes: tuple[int, int]
    up: FloatArray
    floor: float
    height: float


@dataclass(frozen=True, eq=False)
class Balance:
    """How far the point that must be supported is from the support, frame by frame.

    Attributes
    ----------
    kind : {"static", "dynamic"}
        Whether the point is the centre of mass on the floor or the zero-moment point.
    distance : ndarray, shape (n_frames,)
        Distance to the edge of the support polygon in heights, negative inside; NaN where
        nothing is supported.
    grounded : ndarray of bool, shape (n_frames,)
        Whether a foot bears weight and the point is defined.
    model : str
        Whose masses were used: "de Leva" or "rods".
    unmatched : tuple of str
        Joints whose names told nothing.
    """

    kind: Literal["static", "dynamic"]
    distance: FloatArray
    grounded: BoolArray
    model: str
    unmatched: tuple[str, ...]

    def unbalanced(
        self, cut: Segments, rule: Rule = "all", margin: float = 0.0
    ) -> tuple[BoolArray, BoolArray]:
        """Judge segments by their grounded frames.

        Parameters
        ----------
        cut : Segments
            Of the motion.
        rule : {"all", "majority", "any"}
            Of which of its grounded frames the point must be outside of the support for a
            segment to count as unbalanced. The paper does not say; its numbers are near "all".
        margin : float
            Heights outside of the support that are still in balance.

        Returns
        -------
        unbalanced : ndarray of bool, shape (n_segments,)
            False in flight.
        flight : ndarray of bool, shape (n_segments,)
            Segments without a grounded frame, of which nothing can be said.

        Raises
        ------
        ValueError
            If there is no such rule.
        """
        if rule not in RULES:
            raise ValueError(f"rule must be one of {', '.join(RULES)}, got {rule!r}")
        out = self.grounded & (np.where(self.grounded, self.distance, 0.0) > margin)
        outs, grounded = (
            np.concatenate([[0], np.cumsum(values)]) for values in (out, self.grounded)
        )
        n_out = outs[cut.stop + 1] - outs[cut.start]
        n = grounded[cut.stop + 1] - grounded[cut.start]
        flight = n == 0
        limit = {"all": n, "majority": n // 2 + 1, "any": np.ones_like(n)}[rule]
        return (n_out >= limit) & ~flight, flight


def convex_hull(points: FloatArray) -> FloatArray:
    """Return the vertices of the convex hull of points in the plane.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        The points.

    Returns
    -------
    ndarray, shape (n_vertices, 2)
        Counterclockwise from the leftmost one; no vertex on a line between two others. One
        or two where all points are one or on a line.

    Notes
    -----
    Andrew's monotone chain, Information Processing Letters 9 (1979).

    Examples
    --------
    >>> convex_hull(np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 0.5], [2.0, 2.0]])).tolist()
    [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]]
    """
    order = sorted(set(map(tuple, np.asarray(points, np.float64).tolist())))
    if len(order) <= 2:
        return np.array(order, np.float64).reshape(-1, 2)
    halves = []
    for run in (order, order[::-1]):
        chain: list[tuple[float, ...]] = []
        for x, y in run:
            while len(chain) > 1:
                (ax, ay), (bx, by) = chain[-2], chain[-1]
                if (bx - ax) * (y - ay) > (by - ay) * (x - ax):
                    break
                chain.pop()
            chain.append((x, y))
        halves.append(chain[:-1])
    return np.array(halves[0] + halves[1], np.float64)


def signed_distance(polygons: FloatArray, sizes: IntArray, points: FloatArray) -> FloatArray:
    """Return how far points are from the edges of convex polygons.

    Parameters
    ----------
    polygons : ndarray, shape (n, n_vertices, 2)
        Vertices, counterclockwise, the last one repeated to fill up.
    sizes : ndarray of int, shape (n,)
        How many vertices each has.
    points : ndarray, shape (n, 2)
        A point for each.

    Returns
    -------
    ndarray, shape (n,)
        Negative inside, positive outside, in the unit of the points; NaN without a vertex.
        From one or two vertices the distance, never negative.
    """
    starts, ends = polygons, np.roll(polygons, -1, axis=1)
    edge, way = ends - starts, points[:, None] - starts
    length = np.linalg.norm(edge, axis=-1)
    real = length > 0
    along = np.divide((way * edge).sum(-1), length**2, out=np.zeros_like(length), where=real)
    nearest = way - along.clip(0.0, 1.0)[..., None] * edge
    apart = np.linalg.norm(nearest, axis=-1).min(axis=1, initial=np.inf)
    # To the right of a counterclockwise edge is outside.
    across = edge[..., 1] * way[..., 0] - edge[..., 0] * way[..., 1]
    beyond = np.divide(across, length, out=np.full_like(length, -np.inf), where=real)
    inside = (beyond.max(axis=1, initial=-np.inf) <= 0) & (sizes > 2)
    signed: FloatArray = np.where(inside, -apart, apart)
    return np.where(sizes > 0, signed, np.nan)


def support(motion: Motion, *, like: Motion | None = None) -> Support:
    """Return what a motion stands on in every frame.

    Parameters
    ----------
    motion : Motion
        The motion; its floor is even.
    like : Motion, optional
        A motion on the same floor to find the floor by. Default: the motion.

    Returns
    -------
    Support
        The hull of the soles that touch.

    Raises
    ------
    InsufficientDataError
        If no leg is known in the skeleton.

    Notes
    -----
    An ankle or toe touches within 0.035 heights of its floor, the 5th percentile of its own
    height, whatever its speed. The sole reaches 0.035 heights behind an ankle that touches
    and, before a toe that touches, as far as a foot of 0.117 heights does, 0.055 heights wide
    at the ball and 0.033 at the tip.
    """
    ground = Ground.of(motion if like is None else like)
    if not ground.limbs:
        shown = ", ".join(motion.skeleton.names[:8])
        raise InsufficientDataError(
            f"balance needs feet to stand on: no leg is known among the joints {shown}, ..."
        )
    up = int(np.flatnonzero(ground.up)[0])
    axes = ((up + 1) % 3, (up + 2) % 3)
    if ground.up[up] < 0:
        axes = axes[::-1]
    joints = ground.points(motion)
    touches = ground.above(joints) < _NEAR * ground.height
    flat = joints[..., axes]
    forward = facing(motion, ground)[:, axes]
    soles = [
        _sole(flat[:, i], touches[:, i], joints[:, i], forward, ground.height)
        for i in range(len(ground.limbs))
    ]
    corners = np.concatenate([own for own, _ in soles], axis=1)
    counts = np.concatenate([used for _, used in soles], axis=1)
    hulls = [convex_hull(own[used]) for own, used in zip(corners, counts, strict=True)]
    sizes = np.array([len(hull) for hull in hulls], np.int64)
    polygons = np.zeros((len(hulls), max(int(sizes.max(initial=1)), 1), 2))
    for frame, hull in enumerate(hulls):
        if len(hull):
            polygons[frame] = hull[np.minimum(np.arange(polygons.shape[1]), len(hull) - 1)]
    touching = np.asarray(touches.any(axis=2), bool)
    return Support(
        polygons, sizes, touching, axes, ground.up, float(ground.floors.min()), ground.height
    )


def facing(motion: Motion, ground: Ground) -> FloatArray:
    """Return where the hips face, over the floor; zero where nothing tells."""
    sides = {limb.side: limb.hip for limb in reversed(ground.limbs)}
    if not {"left", "right"} <= sides.keys():
        return np.zeros((motion.n_frames, 3))
    places = motion.world_positions()
    ahead = np.cross(places[:, sides["left"]] - places[:, sides["right"]], ground.up)
    return _units(ahead)


def _units(vectors: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    units: FloatArray = np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 0)
    return units


def _sole(
    flat: FloatArray, touches: BoolArray, joints: FloatArray, forward: FloatArray, height: float
) -> tuple[FloatArray, BoolArray]:
    """Return corners of one foot's sole (n_frames, 6, 2) and which of them bear weight."""
    ankle, toe = flat[:, 0], flat[:, 1]
    way = toe - ankle
    points = np.linalg.norm(way, axis=1) >= _POINTED * height
    ahead = np.where(points[:, None], _units(way), forward)
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) * height
    reach = np.maximum(_FOOT * height - np.linalg.norm(joints[:, 1] - joints[:, 0], axis=1), 0.0)
    heel, tip = ankle - _HEEL * height * ahead, toe + reach[:, None] * ahead
    corners = np.stack(
        [
            middle + side * wide * aside
            for middle, wide in ((heel, _WIDE), (toe, _WIDE), (tip, _TIP_WIDE))
            for side in (1.0, -1.0)
        ],
        axis=1,
    )
    bears = [touches[:, 0], touches.any(axis=1), touches[:, 1]]
    return corners, np.repeat(np.stack(bears, axis=1), 2, axis=1)


def static_balance(
    motion: Motion, *, on: Support | None = None, like: Motion | None = None
) -> Balance:
    """Return how far the centre of mass is from being over the feet.

    Parameters
    ----------
    motion : Motion
        The motion.
    on : Support, optional
        What it stands on, if known: a graft on a base that keeps legs and root stands where
        the base does. Default: `support` of the motion.
    like : Motion, optional
        As for `support`.

    Returns
    -------
    Balance
        Frame by frame.

    Raises
    ------
    InsufficientDataError
        If no leg is known in the skeleton.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> still = dance(strides=1).motion[:1]
    >>> static_balance(still, like=dance(strides=1).motion).model
    'de Leva'
    """
    ground = support(motion, like=like) if on is None else on
    return _judged("static", motion, ground, center_of_mass(motion), ground.sizes > 0)


def dynamic_balance(
    motion: Motion, *, on: Support | None = None, like: Motion | None = None
) -> Balance:
    """Return how far the zero-moment point is from the support.

    Parameters
    ----------
    motion, on, like
        As for `static_balance`.

    Returns
    -------
    Balance
        Frames in which the floor bears less than a fifth of the weight are not grounded.

    Raises
    ------
    InsufficientDataError
        If no leg is known in the skeleton, or the motion is too short to be differentiated.

    Notes
    -----
    x - (z - floor) ẍ / (z̈ + g) along each axis of the floor (Vukobratović and Borovac,
    International Journal of Humanoid Robotics 1, 2004), of a point mass at the centre of mass
    smoothed by a cubic Savitzky-Golay filter over 0.2 s. The figure is taken to be 1.75 m
    tall, which sets how strong gravity is in the file's unit.
    """
    from mograft.evaluation._extra import needed

    ground = support(motion, like=like) if on is None else on
    window = max(2 * round(_SMOOTH * motion.rate / 2) + 1, 5)
    if motion.n_frames < window:
        raise InsufficientDataError(
            f"dynamic balance needs {window} frames to differentiate, "
            f"{motion.name or 'the motion'} has {motion.n_frames}"
        )
    smooth = needed("scipy.signal").savgol_filter
    center = center_of_mass(motion)
    place = smooth(center, window, 3, axis=0)
    pull = smooth(center, window, 3, deriv=2, delta=motion.frame_time, axis=0)
    gravity = _GRAVITY * ground.height / _STATURE
    borne = pull @ ground.up + gravity
    stands = borne > _FALLING * gravity
    lever = (place @ ground.up - ground.floor) / np.where(stands, borne, np.inf)
    return _judged(
        "dynamic", motion, ground, place - lever[:, None] * pull, stands & (ground.sizes > 0)
    )


def _judged(
    kind: Literal["static", "dynamic"],
    motion: Motion,
    ground: Support,
    points: FloatArray,
    grounded: BoolArray,
) -> Balance:
    if len(ground.sizes) != motion.n_frames:
        raise ValueError(
            f"on must have {motion.n_frames} frames, as the motion, got {len(ground.sizes)}"
        )
    apart = signed_distance(ground.polygons, ground.sizes, points[:, ground.axes]) / ground.height
    # A point or a line bears what is within a hair of it.
    apart = np.where(ground.sizes < 3, apart - _EDGE, apart)
    known = mass_model(motion.skeleton)
    distance = np.where(grounded, apart, np.nan)
    return Balance(kind, distance, grounded, known.model, known.unmatched)


@dataclass(frozen=True)
class BalanceRow:
    """How often segments of some motions are out of balance, by one rule.

    Attributes
    ----------
    kind, rule : str
        "static" or "dynamic", and "all", "majority" or "any" of the grounded frames.
    margin : float
        Heights outside of the support that still count as balanced.
    method : str
        How the motions were made.
    rate : Estimate
        Share of the segments that are not in flight, kept ones among them.
    spread : float
        Standard deviation of the rate from run to run; NaN of a single run.
    changed : Estimate
        The rate among segments that were exchanged.
    difference : Estimate
        By how much that is above the recording's own rate on the same segments.
    flight : float
        Share of all segments that are in flight.
    runs : int
        How many motions on each base.
    """

    kind: str
    rule: str
    margin: float
    method: str
    rate: Estimate
    spread: float
    changed: Estimate
    difference: Estimate
    flight: float
    runs: int

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        return {
            "kind": self.kind,
            "rule": self.rule,
            "margin": self.margin,
            "method": self.method,
            "rate": self.rate.as_dict(),
            "spread_of_runs": self.spread if math.isfinite(self.spread) else None,
            "rate_changed": self.changed.as_dict(),
            "difference_changed": self.difference.as_dict(),
            "flight": self.flight,
            "runs": self.runs,
        }


def balance_row(
    method: str,
    original: Sequence[Balance],
    made: Sequence[Sequence[Balance]],
    changed: Sequence[BoolArray],
    cuts: Sequence[Segments],
    rule: Rule = "all",
    margin: float = 0.0,
) -> BalanceRow:
    """Compare motions with those that they were made on, segment by segment.

    Parameters
    ----------
    method : str
        How they were made.
    original : sequence of Balance
        Of each base.
    made : sequence of sequence of Balance
        For each base those of the motions made on it, the same number for each.
    changed : sequence of ndarray of bool, each of shape (n_runs, n_segments)
        Where they differ from the base.
    cuts : sequence of Segments
        Of each base.
    rule, margin
        As for `Balance.unbalanced`.

    Returns
    -------
    BalanceRow
        Intervals resample blocks of neighbouring segments, each with all its runs.

    Raises
    ------
    InsufficientDataError
        If every segment is in flight.
    """
    out, own_out, stands, new, clip = [], [], [], [], []
    for index, cut in enumerate(cuts):
        before, flies = original[index].unbalanced(cut, rule, margin)
        after = [one.unbalanced(cut, rule, margin) for one in made[index]]
        out.append(np.stack([own for own, _ in after]))
        stands.append(~np.stack([own for _, own in after]))
        own_out.append(np.where(flies, np.nan, before))
        new.append(changed[index])
        clip.append(np.full(len(cut), index))
    outs, grounded = np.concatenate(out, axis=1), np.concatenate(stands, axis=1)
    before, changes = np.concatenate(own_out), np.concatenate(new, axis=1)
    if not grounded.any():
        raise InsufficientDataError("balance needs feet on the floor: every segment is in flight")
    order = np.concatenate(clip)
    together = estimate.blocks(Segments(np.arange(len(order)), np.arange(1, len(order) + 1), order))
    values = np.where(grounded, outs, np.nan)
    kind, runs = original[0].kind, len(outs)
    per_run = np.array(
        [row[np.isfinite(row)].mean() if np.isfinite(row).any() else np.nan for row in values]
    )
    differences = np.where(changes, values - before, np.nan)

    def average(rows: FloatArray, of: str) -> Estimate:
        block = np.broadcast_to(together, rows.shape)
        return estimate.mean(rows.ravel(), block.ravel(), of)

    return BalanceRow(
        kind,
        rule,
        margin,
        method,
        average(values, "segments times runs"),
        float(per_run.std(ddof=1)) if runs > 1 else math.nan,
        average(np.where(changes, values, np.nan), "changed segments"),
        average(differences, "changed segments, paired with the recording"),
        float(1.0 - grounded.mean()),
        runs,
    )
