"""The plan of a dance: strides, the path of the pelvis, and the footholds."""

from dataclasses import dataclass, fields
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.dancer import skeleton as figure
from mograft.dancer.skeleton import X, Y
from mograft.dancer.styles import ARM_JITTER, ARM_PATTERNS, JITTER, LEG_STYLES, LegStyle
from mograft.motion import rotations

StrArray: TypeAlias = npt.NDArray[np.str_]

# Degrees. At 90 degrees, Euler angles in the order ZYX are singular (gimbal lock).
_MAX_HEADING = 62.0
_STEP = ("swing", "push", "heel_off", "strike", "lift")
_GRID = 256  # nodes per stride of integrated curves
_FADE = 0.8  # duration of the transition from one stride's values to the next, in strides


@dataclass(frozen=True, eq=False)
class Plan:
    """The leg style, arm pattern and parameters of each stride, in arrays of shape (n_strides,).

    `legs` and `arms` hold the names of the styles and patterns. `values` holds the parameters, some
    of them varied randomly: each field of `LegStyle` by name, and ``"arms"``, the amplitude of the
    arm pattern.
    """

    legs: StrArray
    arms: StrArray
    values: dict[str, FloatArray]

    @property
    def n_strides(self) -> int:
        """Number of strides."""
        return len(self.legs)

    def stride(self, clock: FloatArray) -> IntArray:
        """Return the index of the stride at each value of the clock, which counts strides."""
        return np.clip(np.floor(clock), 0, self.n_strides - 1).astype(np.int64)

    def interpolate(self, name: str, clock: FloatArray, outside: float | None = None) -> FloatArray:
        """Return the parameter `name` at each value of the clock, with smooth transitions.

        Before the first and after the last stride the parameter has the value `outside`; by
        default it keeps the value of the nearest stride.
        """
        values = self.values[name]
        ends = (values[0], values[-1]) if outside is None else (outside, outside)
        padded = np.concatenate([[ends[0]], values, [ends[1]]])
        boundary, weight = stride_transition(clock, self.n_strides)
        return padded[boundary] * (1 - weight) + padded[boundary + 1] * weight


def make_plan(generator: np.random.Generator, strides: int) -> Plan:
    """Return a plan with all combinations of leg style and arm pattern in random order.

    Each combination lasts for `strides` strides, whose parameters vary randomly.
    """
    combinations = [(legs, arms) for legs in LEG_STYLES for arms in ARM_PATTERNS]
    order = generator.permutation(len(combinations)).repeat(strides)
    legs = np.array([combinations[i][0] for i in order])
    arms = np.array([combinations[i][1] for i in order])
    values = {
        field.name: np.array([getattr(LEG_STYLES[style], field.name) for style in legs], float)
        for field in fields(LegStyle)
    }
    values["arms"] = np.ones(len(order))
    for name, deviation in (*JITTER.items(), ("arms", ARM_JITTER)):
        # Clipped, because unlimited deviations would exceed the reach of the limbs.
        noise = generator.normal(size=len(order)).clip(-2, 2)
        values[name] = values[name] * (1 + deviation * noise)
    signs = generator.choice([-1.0, 1.0], size=len(combinations)).repeat(strides)
    half = max(strides // 2, 1)
    values["side"] = values["side"] * signs * np.where(np.arange(len(order)) // half % 2, -1.0, 1.0)
    values["turn"] = _limit_heading(values["turn"], signs)
    return Plan(legs, arms, values)


def _limit_heading(turns: FloatArray, signs: FloatArray) -> FloatArray:
    """Return the products of `turns` and `signs`, in degrees, shape (n_strides,).

    Where the heading would exceed 62 degrees to either side, the sign of this turn and of the
    following ones is reversed, until `signs` changes.
    """
    signed = turns * signs
    heading, direction = 0.0, 1.0
    for stride in range(len(turns)):
        if stride and signs[stride] != signs[stride - 1]:
            direction = 1.0
        if abs(heading + direction * signed[stride]) > _MAX_HEADING:
            direction = -direction
        signed[stride] *= direction
        heading += signed[stride]
    return signed


def make_clock(plan: Plan, rate: float) -> FloatArray:
    """Return the clock: how many strides have passed at each frame, shape (n_frames,).

    It includes the fraction of the current stride. `rate` is in frames per second.
    """
    grid = _grid(plan)
    seconds = _integral(plan.interpolate("period", grid))
    n_frames = int(seconds[-1] * rate * (1 + 1e-12)) + 1
    return np.interp(np.arange(n_frames) / rate, seconds, grid)


@dataclass(frozen=True, eq=False)
class Route:
    """The path of the pelvis on the floor: headings in radians and positions in cm.

    All arrays have shape (n_nodes,). `grid` holds the values of the clock at the nodes.
    """

    grid: FloatArray
    headings: FloatArray
    x: FloatArray
    z: FloatArray

    def heading(self, clock: FloatArray) -> FloatArray:
        """Return the heading at each value of the clock, in radians; 0 is along z."""
        return np.interp(clock, self.grid, self.headings)

    def position(self, clock: FloatArray, offsets: FloatArray) -> FloatArray:
        """Return the position on the floor at each value of the clock, moved by an offset.

        `offsets` and the result have shape (n, 3). Offsets are relative to the heading: x points
        left, z forward.
        """
        x, z = (np.interp(clock, self.grid, values) for values in (self.x, self.z))
        heading = rotations.from_axis_angle(Y, self.heading(clock))
        return np.stack([x, np.zeros_like(x), z], axis=-1) + rotations.rotate(heading, offsets)


def make_route(plan: Plan) -> Route:
    """Return the path that results from the turns and steps of all strides.

    The speed is 0 at its start and at its end.
    """
    grid = _grid(plan)
    headings = _integral(np.radians(plan.interpolate("turn", grid, outside=0.0)))
    surge = 1 - plan.interpolate("surge", grid) * np.cos(4 * np.pi * grid)
    forward = 2 * plan.interpolate("step", grid, outside=0.0) * surge
    left = plan.interpolate("side", grid, outside=0.0)
    x = _integral(left * np.cos(headings) + forward * np.sin(headings))
    z = _integral(forward * np.cos(headings) - left * np.sin(headings))
    return Route(grid, headings, x, z)


@dataclass(frozen=True, eq=False)
class Foot:
    """The motion of a foot in the world."""

    ankle: FloatArray  # positions, (n_frames, 3)
    quats: FloatArray  # (n_frames, 4)
    is_standing: BoolArray  # (n_frames,): flat and still


def make_foot(plan: Plan, route: Route, clock: FloatArray, side: int) -> Foot:
    """Return the motion of the left foot (`side` 0) or the right foot (1).

    A foot rolls about the toe at take-off and about the heel at landing. In between, while the
    sole is above the floor, the pivot moves from toe to heel.
    """
    footholds, yaws = _footholds(plan, route, side)
    is_step = (footholds[1:] != footholds[:-1]).any(axis=1)
    stride, middle = plan.stride(clock), 0.25 + 0.5 * side
    swing, push, heel_off, strike, lift = (plan.values[name][stride] for name in _STEP)
    u = ((clock - stride - middle) / swing + 0.5).clip(0, 1)
    progress = _ease((u - push) / (0.92 - push))
    start, stop = footholds[stride], footholds[stride + 1]
    sole = start + progress[:, None] * (stop - start)
    yaw = yaws[stride] + progress * (yaws[stride + 1] - yaws[stride])
    pitch = heel_off * _bump(u / (0.58 + push)) - strike * _bump((u - 0.6) / 0.4)
    turned = rotations.from_axis_angle(Y, yaw)
    rolled = rotations.from_axis_angle(X, np.radians(np.where(is_step[stride], pitch, 0.0)))
    pivot = np.zeros_like(sole)
    pivot[:, 1] = -figure.ANKLE_HEIGHT
    pivot[:, 2] = figure.TOE + (figure.HEEL - figure.TOE) * _ease((u - 0.4 - push) / 0.35)
    ankle = sole + rotations.rotate(turned, pivot - rotations.rotate(rolled, pivot))
    lift = np.where(is_step[stride], lift * _bump((u - push) / (0.98 - push)), 0.0)
    ankle[:, 1] += figure.ANKLE_HEIGHT + lift
    is_standing = (u <= 0) | (u >= 1) | ~is_step[stride]
    return Foot(ankle, rotations.multiply(turned, rolled), is_standing)


def _footholds(plan: Plan, route: Route, side: int) -> tuple[FloatArray, FloatArray]:
    """Return the positions and yaws at which a foot stands, in the order of time.

    The shapes are (n_strides + 1, 3) and (n_strides + 1,). In stride i, the foot moves from row i
    to row i + 1. `side` is as for `make_foot`.
    """
    out = 1 - 2 * side
    middles = np.arange(0.0, plan.n_strides + 1) - 0.25 * out
    beside = np.zeros((len(middles), 3))
    beside[:, 0], beside[:, 2] = out * plan.interpolate("width", middles), -figure.ANKLE_BACK
    footholds = route.position(middles, beside)
    yaws = route.heading(middles) + out * figure.TOE_OUT
    for stride in range(plan.n_strides):
        # A foot stays in place if its step would be shorter than 2 cm and turn less than 4 degrees.
        gap = np.linalg.norm(footholds[stride + 1] - footholds[stride])
        if gap < 2.0 and abs(yaws[stride + 1] - yaws[stride]) < np.radians(4.0):
            footholds[stride + 1], yaws[stride + 1] = footholds[stride], yaws[stride]
    return footholds, yaws


def _ease(t: FloatArray) -> FloatArray:
    """Return the quintic smoothstep function of `t`: 0 for t ≤ 0, 1 for t ≥ 1.

    Its first and second derivatives are 0 at both ends.
    """
    t = t.clip(0, 1)
    return t**3 * (10 + t * (6 * t - 15))


def _bump(t: FloatArray) -> FloatArray:
    """Return a smooth curve that is 0 at t = 0, 1 at t = 0.5 and 0 at t = 1."""
    t = t.clip(0, 1)
    return 64 * (t * (1 - t)) ** 3


def stride_transition(clock: FloatArray, n_strides: int) -> tuple[IntArray, FloatArray]:
    """Return, for each value of the clock, the nearest stride boundary and a weight from 0 to 1.

    Boundaries are numbered from 0 to `n_strides`. In the transition between the two strides that
    meet at the boundary, the weight is that of the later stride.
    """
    boundary = np.clip(np.round(clock), 0, n_strides).astype(np.int64)
    return boundary, _ease((clock - boundary) / _FADE + 0.5)


def soft_minimum(values: FloatArray, softness: float) -> FloatArray:
    """Return a smooth approximation of the minimum of n curves, which never exceeds the minimum.

    `values` has shape (n, n_frames), the result (n_frames,). A smaller `softness`, in the unit of
    the values, gives a closer approximation.
    """
    least = values.min(axis=0)
    return least - softness * np.log(np.exp((least - values) / softness).sum(axis=0))


def _grid(plan: Plan) -> FloatArray:
    return np.linspace(0, plan.n_strides, plan.n_strides * _GRID + 1)


def _integral(rates: FloatArray) -> FloatArray:
    """Return the integral of `rates` from the first to each node of the grid (trapezoidal rule).

    `rates` holds changes per stride at the nodes.
    """
    return np.concatenate([[0.0], np.cumsum(0.5 * (rates[1:] + rates[:-1]) / _GRID)])
