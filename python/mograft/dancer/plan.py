"""Where everything goes: the strides, the way of the pelvis, the feet on the floor."""

from dataclasses import dataclass, fields
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray, IntArray
from mograft.dancer.figure import (
    ANKLE_BACK,
    ANKLE_HEIGHT,
    HEEL,
    INDEX,
    LEG_REACH,
    OFFSETS,
    TOE,
    TOE_OUT,
    X,
    Y,
)
from mograft.dancer.styles import ARM_JITTER, ARM_PATTERNS, JITTER, LEG_STYLES, LegStyle
from mograft.motion import rotations

BoolArray: TypeAlias = npt.NDArray[np.bool_]
StrArray: TypeAlias = npt.NDArray[np.str_]

# Headings stay in front of a right angle, where Euler angles in the order ZYX lock.
_MAX_HEADING = 62.0
_GRID = 256  # nodes per stride of integrated curves
_FADE = 0.8  # how many strides it takes to go over from one stride's values to the next's


@dataclass(frozen=True, eq=False)
class Plan:
    """What is danced in each stride, in arrays of shape (n_strides,).

    The values are those of `LegStyle` by name, varied, and ``arms``, the size of arm moves.
    """

    legs: StrArray
    arms: StrArray
    values: dict[str, FloatArray]

    @property
    def n_strides(self) -> int:
        """Number of strides."""
        return len(self.legs)

    def stride(self, clock: FloatArray) -> IntArray:
        """Return the stride that is danced at each time of the clock."""
        return np.clip(np.floor(clock), 0, self.n_strides - 1).astype(np.int64)

    def faded(self, name: str, clock: FloatArray, outside: float | None = None) -> FloatArray:
        """Return a value over time, fading from stride to stride.

        Before the first stride and after the last it is `outside`, or as within.
        """
        values = self.values[name]
        ends = (values[0], values[-1]) if outside is None else (outside, outside)
        padded = np.concatenate([[ends[0]], values, [ends[1]]])
        border, weight = fade(clock, self.n_strides)
        return padded[border] * (1 - weight) + padded[border + 1] * weight


def make_plan(generator: np.random.Generator, strides: int) -> Plan:
    """Shuffle the combinations and vary their strides a little."""
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
        # Clipped, since reach and speed are bounded for what is likely, not for all numbers.
        noise = generator.normal(size=len(order)).clip(-2, 2)
        values[name] = values[name] * (1 + deviation * noise)
    ways = generator.choice([-1.0, 1.0], size=len(combinations)).repeat(strides)
    half = max(strides // 2, 1)
    values["side"] = values["side"] * ways * np.where(np.arange(len(order)) // half % 2, -1.0, 1.0)
    values["turn"] = _bounded_turns(values["turn"], ways)
    return Plan(legs, arms, values)


def _bounded_turns(turns: FloatArray, ways: FloatArray) -> FloatArray:
    """Give turns a sign: as the ways say, but back where the heading would go too far."""
    signed = turns * ways
    heading = 0.0
    back = 1.0
    for stride in range(len(turns)):
        if stride and ways[stride] != ways[stride - 1]:
            back = 1.0
        if abs(heading + back * signed[stride]) > _MAX_HEADING:
            back = -back
        signed[stride] *= back
        heading += signed[stride]
    return signed


def make_clock(plan: Plan, rate: float) -> FloatArray:
    """Return how many strides are over at each frame, shape (n_frames,)."""
    grid = _grid(plan)
    seconds = _integral(plan.faded("period", grid))
    n_frames = int(seconds[-1] * rate * (1 + 1e-12)) + 1
    return np.interp(np.arange(n_frames) / rate, seconds, grid)


@dataclass(frozen=True, eq=False)
class Route:
    """The way of the pelvis over the floor: radians and cm on a fine grid of the clock."""

    grid: FloatArray
    headings: FloatArray
    x: FloatArray
    z: FloatArray

    def heading(self, clock: FloatArray) -> FloatArray:
        """Return headings in radians, 0 along z, shape of the clock."""
        return np.interp(clock, self.grid, self.headings)

    def at(self, clock: FloatArray) -> FloatArray:
        """Return places on the floor, shape (..., 3)."""
        x, z = (np.interp(clock, self.grid, values) for values in (self.x, self.z))
        return np.stack([x, np.zeros_like(x), z], axis=-1)


def make_route(plan: Plan) -> Route:
    """Add up turns and ways, from a standstill to a standstill."""
    grid = _grid(plan)
    headings = _integral(np.radians(plan.faded("turn", grid, outside=0.0)))
    surge = 1 - plan.faded("surge", grid) * np.cos(4 * np.pi * grid)
    forward = 2 * plan.faded("step", grid, outside=0.0) * surge
    left = plan.faded("side", grid, outside=0.0)
    x = _integral(left * np.cos(headings) + forward * np.sin(headings))
    z = _integral(forward * np.cos(headings) - left * np.sin(headings))
    return Route(grid, headings, x, z)


@dataclass(frozen=True, eq=False)
class Foot:
    """A foot over time: where the ankle is, how the foot is turned, and when it stands.

    The shapes are (n_frames, 3), (n_frames, 4) and (n_frames,).
    """

    ankle: FloatArray
    quats: FloatArray
    stands: BoolArray


def make_foot(plan: Plan, route: Route, clock: FloatArray, side: int) -> Foot:
    """Plan the left foot (`side` 0) or the right one (1).

    A foot rolls: at first about the toe, which stays, at last about the heel. In between
    the pivot slides from toe to heel while the sole is well above the floor.
    """
    plants, yaws = _plants(plan, route, side)
    steps = (plants[1:] != plants[:-1]).any(axis=1)
    stride = plan.stride(clock)
    swing = plan.values["swing"][stride]
    middle = 0.25 + 0.5 * side
    u = ((clock - stride - middle) / swing + 0.5).clip(0, 1)

    push = plan.values["push"][stride]
    way = _ease((u - push) / (0.92 - push))
    sole = plants[stride] + way[:, None] * (plants[stride + 1] - plants[stride])
    yaw = yaws[stride] + way * (yaws[stride + 1] - yaws[stride])
    heel_off, strike, lift = (plan.values[name][stride] for name in ("heel_off", "strike", "lift"))
    pitch = heel_off * _bump(u / (0.58 + push)) - strike * _bump((u - 0.6) / 0.4)
    turned = rotations.from_axis_angle(Y, yaw)
    rolled = rotations.from_axis_angle(X, np.radians(np.where(steps[stride], pitch, 0.0)))
    pivot = np.zeros_like(sole)
    pivot[:, 1] = -ANKLE_HEIGHT
    pivot[:, 2] = TOE + (HEEL - TOE) * _ease((u - 0.4 - push) / 0.35)
    ankle = sole + rotations.rotate(turned, pivot - rotations.rotate(rolled, pivot))
    ankle[:, 1] += ANKLE_HEIGHT + np.where(
        steps[stride], lift * _bump((u - push) / (0.98 - push)), 0.0
    )
    stands = (u <= 0) | (u >= 1) | ~steps[stride]
    return Foot(ankle, rotations.multiply(turned, rolled), stands)


def _plants(plan: Plan, route: Route, side: int) -> tuple[FloatArray, FloatArray]:
    """Return where a foot stands before and after each stride, and its turns about y.

    The shapes are (n_strides + 1, 3) and (n_strides + 1,).
    """
    out = 1 - 2 * side
    middles = np.arange(0.0, plan.n_strides + 1) - 0.25 * out
    yaws = route.heading(middles)
    width = plan.faded("width", middles)
    beside = np.stack([out * width, np.zeros_like(width), np.full_like(width, -ANKLE_BACK)], -1)
    plants = route.at(middles) + rotations.rotate(rotations.from_axis_angle(Y, yaws), beside)
    yaws = yaws + out * TOE_OUT
    for stride in range(plan.n_strides):
        # A foot that is nearly where it should be stays, rather than shuffle.
        gap = np.linalg.norm(plants[stride + 1] - plants[stride])
        if gap < 2.0 and abs(yaws[stride + 1] - yaws[stride]) < np.radians(4.0):
            plants[stride + 1], yaws[stride + 1] = plants[stride], yaws[stride]
    return plants, yaws


def make_pelvis(
    plan: Plan, route: Route, clock: FloatArray, feet: list[Foot]
) -> tuple[FloatArray, FloatArray]:
    """Return rotations and places of the pelvis, shapes (n_frames, 4) and (n_frames, 3).

    It goes up and down as the style wants, but never so high that a leg would be too short.
    """
    beat = 2 * np.pi * clock
    heading = route.heading(clock)
    twist, roll, lean = (np.radians(plan.faded(name, clock)) for name in ("twist", "roll", "lean"))
    angles = np.stack([heading + twist * np.cos(beat), -roll * np.sin(beat), 0.4 * lean], axis=-1)
    quats = rotations.from_euler(angles, "YZX")

    aside = np.zeros((len(clock), 3))
    aside[:, 0] = -plan.faded("sway", clock) * np.sin(beat)
    places = route.at(clock) + rotations.rotate(rotations.from_axis_angle(Y, heading), aside)
    late = 2 * (beat - 2 * np.pi * plan.faded("lag", clock))
    wanted = plan.faded("height", clock) - plan.faded("bounce", clock) * np.cos(late)
    limits = []
    for foot, hip in zip(feet, ("LeftUpLeg", "RightUpLeg"), strict=True):
        to_hip = rotations.rotate(quats, OFFSETS[INDEX[hip]])
        gap = (places + to_hip - foot.ankle)[:, [0, 2]]
        below = np.sqrt(LEG_REACH**2 - (gap**2).sum(axis=-1))
        limits.append(foot.ankle[:, 1] + below - to_hip[:, 1])
    places[:, 1] = soft_minimum(np.stack([wanted, *limits]), 1.5)
    return quats, places


def _ease(t: FloatArray) -> FloatArray:
    """Go from 0 to 1 while t does, with no speed and no acceleration at the ends."""
    t = t.clip(0, 1)
    eased: FloatArray = t**3 * (10 + t * (6 * t - 15))
    return eased


def _bump(t: FloatArray) -> FloatArray:
    """Go from 0 to 1 and back while t goes from 0 to 1, smoothly at the ends."""
    t = t.clip(0, 1)
    bump: FloatArray = 64 * (t * (1 - t)) ** 3
    return bump


def fade(clock: FloatArray, n_strides: int) -> tuple[IntArray, FloatArray]:
    """Return the nearest border of strides, 0 to n_strides, and how far it is crossed, 0 to 1."""
    border = np.clip(np.round(clock), 0, n_strides).astype(np.int64)
    return border, _ease((clock - border) / _FADE + 0.5)


def soft_minimum(values: FloatArray, softness: float) -> FloatArray:
    """Return a smooth curve below the least of n curves, shape (n, n_frames) to (n_frames,)."""
    least = values.min(axis=0)
    soft: FloatArray = least - softness * np.log(np.exp((least - values) / softness).sum(axis=0))
    return soft


def _grid(plan: Plan) -> FloatArray:
    return np.linspace(0, plan.n_strides, plan.n_strides * _GRID + 1)


def _integral(rates: FloatArray) -> FloatArray:
    """Integrate rates per stride on the grid, by trapezia, from 0."""
    areas = 0.5 * (rates[1:] + rates[:-1]) / _GRID
    return np.concatenate([[0.0], np.cumsum(areas)])
