"""Parameters of the leg styles and of the arm patterns."""

from dataclasses import dataclass, replace
from typing import Literal

from mograft.dancer.skeleton import Vector


@dataclass(frozen=True)
class LegStyle:
    """Parameters of a leg style; lengths in cm, angles in degrees."""

    period: float  # seconds per stride, which is two steps
    step: float = 0.0  # distance forward per step
    side: float = 0.0  # distance sideways per stride
    turn: float = 0.0  # change of heading per stride
    swing: float = 0.46  # fraction of a stride in which each foot is in the air or rolls
    push: float = 0.1  # fraction of the swing before the toe leaves the ground
    lift: float = 4.0  # height of the sole in mid swing
    heel_off: float = 28.0  # pitch of the foot at take-off, heel up
    strike: float = 14.0  # pitch of the foot at landing, toe up
    width: float = 9.0  # lateral distance of each ankle from the midline
    height: float = 89.0  # mean height of the pelvis
    bounce: float = 1.5  # amplitude of the pelvis's vertical motion
    lag: float = 0.03  # delay of the pelvis's lowest point after a foot lands, in strides
    surge: float = 0.0  # variation of the forward speed, as a fraction of its mean
    sway: float = 2.5  # lateral motion of the pelvis towards the standing foot
    twist: float = 5.0  # rotation of the pelvis about y
    roll: float = 4.0  # rotation of the pelvis about z
    lean: float = 2.0  # forward inclination of the trunk


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

# Standard deviations of the random factors of each stride.
JITTER = {"period": 0.03, "step": 0.04, "side": 0.04, "lift": 0.06, "bounce": 0.08, "twist": 0.06}
ARM_JITTER = 0.06


@dataclass(frozen=True)
class ArmPattern:
    """A periodic movement of the left arm; lengths in cm, angles in degrees.

    The wrist moves on the curve ``wrist + sway * s + arc * s**2``, where s oscillates between 1 and
    -1. Each coefficient has three components, to the left, up and forward; positions are relative
    to the joint `on`, and turn with it. A pattern for the right arm is mirrored.
    """

    wrist: Vector
    sway: Vector
    elbow: Vector  # direction in which the elbow is off the line from shoulder to wrist
    arc: Vector = (0, 0, 0)
    hand: Vector | None = None  # direction of the hand; by default that of the forearm
    beats: int = 1  # periods of s per stride
    start: float = 0.0  # phase of s at the start of a stride, as a fraction of its period
    snap: float = 0.0  # if above 0, s is flattened at its extremes and steeper in between
    shrug: float = 0.0  # elevation of the collar bone
    on: Literal["Spine", "Hips"] = "Spine"  # joint that carries the pattern


_SWING = ArmPattern((24, -19, 3), sway=(-2, 2.5, 19), arc=(0, 7, 1), elbow=(0.4, 0, -1))
_HIPS = ArmPattern((19.5, 8, 1), sway=(0.5, 0.5, 0.5), elbow=(1, 0, -0.75),
                   hand=(-0.25, -0.6, 0.74), beats=2, shrug=4, on="Hips")  # fmt: skip
_CLAP = ArmPattern((14, 22, 33), sway=(-10.5, 0, 2), elbow=(0.7, -1, -0.1),
                   hand=(-0.05, 0.5, 0.85), beats=2, snap=0.8)  # fmt: skip
_FLAP = ArmPattern((66, 30, 8), sway=(0, 20, 0), arc=(-7, 0, 0), elbow=(0, -0.4, -1), beats=2,
                   shrug=6)  # fmt: skip
_PUNCH = ArmPattern((14, 19, 30), sway=(-5, 4, 14), elbow=(0.7, -1, 0), snap=1.2)
_ROBOT = ArmPattern((42, 31, 24), sway=(0, 23, 0), arc=(0, 0, -18), elbow=(1, 0, -0.3), snap=1.8)
_WAVE = ArmPattern((36, 66, 8), sway=(11, -2, 0), elbow=(1, -1, -0.2), hand=(0.1, 1, 0.1), beats=2,
                   shrug=14)  # fmt: skip


def _alternate(pattern: ArmPattern) -> tuple[ArmPattern, ArmPattern]:
    """Return the patterns of the left and the right arm, which differ by half a period."""
    return pattern, replace(pattern, start=pattern.start + 0.5)


# The patterns of the left and of the right arm.
ARM_PATTERNS: dict[str, tuple[ArmPattern, ArmPattern]] = {
    "swing": _alternate(_SWING),
    "hips": (_HIPS, _HIPS),
    "clap": (_CLAP, _CLAP),
    "flap": (_FLAP, _FLAP),
    "punch": _alternate(_PUNCH),
    "robot": _alternate(_ROBOT),
    "wave": (_SWING, _WAVE),
}
