"""Static and dynamic balance: reference points against the support polygon (paper, 5.5, table 3).

Static balance is a poor measure of naturalness: every step of a walk is statically unbalanced.
It shows whether grafts are less balanced than the recordings that they were made from.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple, Self

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft.body import support_polygon
from mograft.body.contacts import find_legs
from mograft.body.mass import center_of_mass, mass_model
from mograft.errors import InsufficientDataError
from mograft.evaluation import estimate
from mograft.evaluation.estimate import Estimate, Record, import_measure
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.synthesis.graft_result import Graft

_DEGENERATE_MARGIN = 0.01  # distance, in heights, from a point or line of support that is inside
_SMOOTHING_SECONDS = 0.2


@dataclass(frozen=True, eq=False)
class Balance:
    """Distances of a reference point to the support polygon, for each frame.

    Attributes
    ----------
    kind : {"static", "dynamic"}
        Whether the reference point is the projected centre of mass or the zero-moment point.
    distance : ndarray, shape (n_frames,)
        Distance to the edge of the support polygon in skeleton heights, negative inside. If the
        polygon is a point or a line, 0.01 is subtracted, so that points within 0.01 are inside.
        NaN in frames that are not grounded.
    grounded : ndarray of bool, shape (n_frames,)
        Frames with a foot that carries weight and with a defined reference point.
    model : str
        Mass model: "de Leva" or "rods".
    """

    kind: Literal["static", "dynamic"]
    distance: FloatArray
    grounded: BoolArray
    model: str

    def classify(self, cut: Segments) -> tuple[BoolArray, BoolArray]:
        """Classify segments as balanced, unbalanced or in flight.

        Parameters
        ----------
        cut : Segments
            Segments of the motion.

        Returns
        -------
        unbalanced, flight : ndarray of bool, shape (n_segments,)
            Segments with the reference point outside of the support polygon in all grounded
            frames, and segments without a grounded frame, which are not unbalanced. The paper does
            not state its rule.
        """
        is_outside = self.grounded & (np.where(self.grounded, self.distance, 0.0) > 0)
        sums = np.cumsum([is_outside, self.grounded], axis=1)
        sums = np.concatenate([np.zeros((2, 1), np.int64), sums], axis=1)
        n_outside, n = sums[:, cut.stop + 1] - sums[:, cut.start]
        flight = n == 0
        return (n_outside == n) & ~flight, flight


def static_balance(
    motion: Motion,
    *,
    support: support_polygon.Support | None = None,
    floor_reference: Motion | None = None,
) -> Balance:
    """Return the distances of the projected centre of mass to the support polygon.

    Parameters
    ----------
    motion : Motion
        The motion to measure.
    support : Support, optional
        Support polygons of the motion, if they are already computed. For example, a graft has the
        support polygons of its base if the base group contains the legs and the root. Default:
        `support_polygons` of `motion`.
    floor_reference : Motion, optional
        As for `support_polygons`.

    Returns
    -------
    Balance
        Distances for each frame.

    Raises
    ------
    InsufficientDataError
        If the skeleton has no known leg.
    ValueError
        If `support` has another number of frames than `motion`.
    """
    return _measure("static", motion, support, floor_reference)


def dynamic_balance(
    motion: Motion,
    *,
    support: support_polygon.Support | None = None,
    floor_reference: Motion | None = None,
) -> Balance:
    """Return the distances of the zero-moment point to the support polygon.

    Parameters
    ----------
    motion : Motion
        The motion to measure.
    support, floor_reference
        As for `static_balance`.

    Returns
    -------
    Balance
        Distances for each frame. Frames without a foot on the floor, or with less than a
        fifth of the weight on the floor, are not grounded.

    Raises
    ------
    ImportError
        If SciPy is not installed.
    InsufficientDataError
        If the skeleton has no known leg, or the motion is too short for its derivatives.
    ValueError
        If `support` has another number of frames than `motion`.

    Notes
    -----
    Along each horizontal axis, the zero-moment point is x - (z - floor) ẍ / (z̈ + g), where x is
    the coordinate of the centre of mass, z its height and g the gravity (Vukobratović and
    Borovac, International Journal of Humanoid Robotics 1, 2004, for a point mass). A cubic
    Savitzky-Golay filter over 0.2 s smooths the centre of mass. Gravity is converted to the unit
    of the file by the assumption that the skeleton is 1.75 m tall.
    """
    return _measure("dynamic", motion, support, floor_reference)


BALANCES = {"static": static_balance, "dynamic": dynamic_balance}


def graft_balance(kind: str, graft: Graft, base_support: support_polygon.Support | None) -> Balance:
    """Return the balance of a graft on the floor of its base, whose support is `base_support`."""
    support = base_support if _has_base_legs(graft) else None
    return BALANCES[kind](graft.motion, support=support, floor_reference=graft.base)


def _has_base_legs(graft: Graft) -> bool:
    """Return whether all joints of the legs and their ancestors move as in the base."""
    ends = [leg.ankle if leg.toe is None else leg.toe for leg in find_legs(graft.base.skeleton)]
    joints = sorted({j for end in ends for j in (end, *graft.base.skeleton.ancestors(end))})
    new, base = graft.motion, graft.base
    return np.array_equal(new.rotations[:, joints], base.rotations[:, joints]) and np.array_equal(
        new.positions[:, joints], base.positions[:, joints]
    )


def _measure(
    kind: Literal["static", "dynamic"],
    motion: Motion,
    support: support_polygon.Support | None,
    floor_reference: Motion | None,
) -> Balance:
    if support is None:
        support = support_polygon.support_polygons(motion, floor_reference=floor_reference)
    sizes, n = support.sizes, motion.n_frames
    if len(sizes) != n:
        raise ValueError(f"`support` must have {n} frames, as the motion has, got {len(sizes)}")
    points, grounded = center_of_mass(motion), sizes > 0
    if kind == "dynamic":
        points, is_loaded = _zero_moment_points(motion, points, support)
        grounded &= is_loaded
    distances = support_polygon.signed_distance(support.polygons, sizes, points[:, support.axes])
    distances = distances / support.height - np.where(sizes < 3, _DEGENERATE_MARGIN, 0.0)
    distances = np.where(grounded, distances, np.nan)
    return Balance(kind, distances, grounded, mass_model(motion.skeleton).model)


def _zero_moment_points(
    motion: Motion, center: FloatArray, support: support_polygon.Support
) -> tuple[FloatArray, BoolArray]:
    window = max(2 * round(_SMOOTHING_SECONDS * motion.rate / 2) + 1, 5)
    if motion.n_frames < window:
        raise InsufficientDataError(
            f"dynamic balance needs at least {window} frames for derivatives, "
            f"{motion.name or 'the motion'} has {motion.n_frames}"
        )
    smooth = partial(import_measure("scipy.signal").savgol_filter, center, window, 3, axis=0)
    acceleration = smooth(deriv=2, delta=motion.frame_time)
    return support_polygon.zero_moment_points(
        smooth(), acceleration, support.up, support.floor, support.height
    )


class BalanceSample(NamedTuple):
    """States of the segments of one base and of its grafts, for `balance_row`.

    States are 1 for unbalanced segments, 0 for balanced ones and NaN for those in flight.
    """

    before: FloatArray  # states in the base, (n_segments,)
    after: FloatArray  # states in each graft, (n_runs, n_segments)
    changed: BoolArray  # whether a segment has an exchanged part, (n_runs, n_segments)


@dataclass(frozen=True, eq=False)
class BalancedBase:
    """A base with its segments, support polygons, and static and dynamic balance."""

    cut: Segments
    support: support_polygon.Support
    balances: dict[str, Balance]

    @classmethod
    def of(cls, library: Library, clip: int) -> Self:
        """Return a clip of a library as a base."""
        motion = library.clips[clip]
        support = support_polygon.support_polygons(motion)
        balances = {kind: measure(motion, support=support) for kind, measure in BALANCES.items()}
        return cls(library.segments[library.segments.of_clip(clip)], support, balances)

    def sample(self, kind: str, grafts: Sequence[Graft] | None) -> BalanceSample:
        """Return the states of the base and its grafts; for None, the base is its only graft."""
        before, n_segments = self._states(self.balances[kind]), len(self.cut)
        if grafts is None:
            return BalanceSample(before, before[None], np.ones((1, n_segments), bool))
        after = [self._states(graft_balance(kind, graft, self.support)) for graft in grafts]
        is_exchanged = np.array([[not s.is_own for s in graft.substitutions] for graft in grafts])
        changed = np.any(is_exchanged.reshape(len(grafts), -1, n_segments), axis=1)
        return BalanceSample(before, np.stack(after), np.asarray(changed, bool))

    def _states(self, balance: Balance) -> FloatArray:
        unbalanced, flight = balance.classify(self.cut)
        return np.where(flight, np.nan, unbalanced)


@dataclass(frozen=True)
class BalanceRow(Record):
    """Shares of unbalanced segments in the grafts of one method.

    Attributes
    ----------
    kind : str
        "static" or "dynamic"; see `Balance`.
    method : str
        Name of the method that selected the donors, or "recording".
    rate : Estimate
        Share of unbalanced segments among all segments that are not in flight.
    rate_changed, difference_changed : Estimate
        Share of unbalanced segments among those with an exchanged part that are not in flight, and
        this share minus that of the same segments in the recording.
    flight : float
        Share of the segments that are in flight.
    runs : int
        Number of grafts for each base.
    """

    kind: str
    method: str
    rate: Estimate
    rate_changed: Estimate
    difference_changed: Estimate
    flight: float
    runs: int


def balance_row(kind: str, method: str, samples: Sequence[BalanceSample]) -> BalanceRow:
    """Compare the balance of grafts with that of their bases, segment by segment.

    Parameters
    ----------
    kind, method : str
        As for `BalanceRow`.
    samples : sequence of BalanceSample
        States of each base and of its grafts. All bases have the same number of grafts.

    Returns
    -------
    BalanceRow
        The rates. Their intervals resample blocks of neighbouring segments of a base. A block
        contains these segments in all grafts of the base.

    Raises
    ------
    InsufficientDataError
        If every segment is in flight.
    """
    before, after, is_changed = (np.concatenate(own, axis=-1) for own in zip(*samples, strict=True))
    is_grounded = np.isfinite(after)
    if not is_grounded.any():
        raise InsufficientDataError("balance needs feet on the floor: every segment is in flight")
    changed = np.where(is_changed, after, np.nan)
    lengths = [len(sample.before) for sample in samples]
    blocks = estimate.segment_blocks(np.repeat(np.arange(len(samples)), lengths))
    all_blocks = np.tile(blocks, len(after))
    paired = "changed segments, paired with the recording"
    return BalanceRow(
        kind=kind,
        method=method,
        rate=estimate.block_mean(after.ravel(), all_blocks, "segments times runs"),
        rate_changed=estimate.block_mean(changed.ravel(), all_blocks, "changed segments"),
        difference_changed=estimate.block_mean((changed - before).ravel(), all_blocks, paired),
        flight=float(1.0 - is_grounded.mean()),
        runs=len(after),
    )
