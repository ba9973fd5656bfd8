"""How the legs and the arms move: the tables of the dance."""

from dataclasses import dataclass, replace
from typing import Literal

from mograft.dancer.figure import Vector


@dataclass(frozen=True)
class LegStyle:
    """How the legs move; lengths in cm, angles in degrees.

    Parameters
    ----------
    period : float
        Seconds per stride, which is two steps.
    step, side : float
        Way forward per step, and to the side per stride.
    turn : float
        Change of heading per stride.
    swing : float
        Share of a stride that each foot is off the ground or rolls.
    push : float
        Share of the swing before the toe leaves the ground.
    lift, heel_off, strike : float
        Height of the sole in mid swing; how far the heel rises as the foot leaves, and the
        toe as it lands.
    width : float
        Distance of each ankle from the middle.
    height, bounce : float
        Mean height of the pelvis, and how far it goes up and down from there.
    lag : float
        Share of a stride by which it is lowest after a foot has landed.
    surge : float
        How much the way forward slows while both feet stand, as a share of its speed.
    sway, twist, roll, lean : float
        Of the pelvis over the standing foot, about y and about z; of the trunk forward.
    """

    period: float
    step: float = 0.0
    side: float = 0.0
    turn: float = 0.0
    swing: float = 0.46
    push: float = 0.1
    lift: float = 4.0
    heel_off: float = 28.0
    strike: float = 14.0
    width: float = 9.0
    height: float = 89.0
    bounce: float = 1.5
    lag: float = 0.03
    surge: float = 0.0
    sway: float = 2.5
    twist: float = 5.0
    roll: float = 4.0
    lean: float = 2.0


LEG_STYLES: dict[str, LegStyle] = {
    "walk": LegStyle(1.05, step=50, turn=8, swing=0.5, height=89.5, bounce=2.2, sway=3, roll=5),
    "turn": LegStyle(1.1, step=22, turn=50, lift=6, heel_off=24, twist=3, height=90),
    "march": LegStyle(1.1, step=32, push=0.12, lift=30, heel_off=48, strike=0, height=91, roll=2,
                      lean=0),
    "sidestep": LegStyle(1.25, side=40, lift=6, heel_off=14, strike=0, width=15, sway=4,
                         twist=3, roll=6),
    "bounce": LegStyle(0.95, lift=5, heel_off=14, strike=0, width=13, height=85, bounce=3.6,
                       sway=5, twist=7, roll=7, lean=4),
    "lunge": LegStyle(1.67, step=64, swing=0.5, push=0.2, lift=6, heel_off=46, strike=6,
                      height=77, bounce=8, lag=0.1, surge=0.4, sway=2, twist=7, roll=3, lean=9),
}  # fmt: skip

# Standard deviations of the factors by which strides differ.
JITTER = {"period": 0.03, "step": 0.04, "side": 0.04, "lift": 0.06, "bounce": 0.08, "twist": 0.06}
ARM_JITTER = 0.06


@dataclass(frozen=True)
class ArmMove:
    """How the left arm moves, or the right one mirrored; lengths in cm, angles in degrees.

    The wrist is at ``wrist + sway * s + arc * s**2``, where s goes between 1 and -1.

    Parameters
    ----------
    wrist, sway, arc : tuple of float
        Outward, up and forward, from the lower end of the trunk.
    elbow : tuple of float
        Where to the elbow points, as seen from the line between shoulder and wrist.
    hand : tuple of float, optional
        Where to the hand points. Default: on along the forearm.
    beats : int
        How often s goes to and fro in a stride.
    start : float
        Share of a cycle by which it is ahead.
    snap : float
        Above 0, s lingers at its ends and hurries in between.
    shrug : float
        How far the collar bone is raised.
    on : {"Spine", "Hips"}
        The joint that carries the wrist along.
    """

    wrist: Vector
    sway: Vector
    elbow: Vector
    arc: Vector = (0, 0, 0)
    hand: Vector | None = None
    beats: int = 1
    start: float = 0.0
    snap: float = 0.0
    shrug: float = 0.0
    on: Literal["Spine", "Hips"] = "Spine"


_SWING = ArmMove((24, -19, 3), sway=(-2, 2.5, 19), arc=(0, 7, 1), elbow=(0.4, 0, -1))
_HIPS = ArmMove((19.5, 8, 1), sway=(0.5, 0.5, 0.5), elbow=(1, 0, -0.75), hand=(-0.25, -0.6, 0.74),
                beats=2, shrug=4, on="Hips")  # fmt: skip
_CLAP = ArmMove((14, 22, 33), sway=(-10.5, 0, 2), elbow=(0.7, -1, -0.1), hand=(-0.05, 0.5, 0.85),
                beats=2, snap=0.8)  # fmt: skip
_FLAP = ArmMove((66, 30, 8), sway=(0, 20, 0), arc=(-7, 0, 0), elbow=(0, -0.4, -1), beats=2,
                shrug=6)  # fmt: skip
_PUNCH = ArmMove((14, 19, 30), sway=(-5, 4, 14), elbow=(0.7, -1, 0), snap=1.2)
_ROBOT = ArmMove((42, 31, 24), sway=(0, 23, 0), arc=(0, 0, -18), elbow=(1, 0, -0.3), snap=1.8)
_WAVE = ArmMove((36, 66, 8), sway=(11, -2, 0), elbow=(1, -1, -0.2), hand=(0.1, 1, 0.1), beats=2,
                shrug=14)  # fmt: skip


def _in_turn(move: ArmMove) -> tuple[ArmMove, ArmMove]:
    """Return the move of the left arm and that of the right, half a cycle later."""
    return move, replace(move, start=move.start + 0.5)


# The move of the left arm and of the right.
ARM_PATTERNS: dict[str, tuple[ArmMove, ArmMove]] = {
    "swing": _in_turn(_SWING),
    "hips": (_HIPS, _HIPS),
    "clap": (_CLAP, _CLAP),
    "flap": (_FLAP, _FLAP),
    "punch": _in_turn(_PUNCH),
    "robot": _in_turn(_ROBOT),
    "wave": (_SWING, _WAVE),
}
