"""How the body follows the plan: inverse kinematics of the limbs, and the upper body."""

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.dancer.figure import (
    ARM_REACH,
    FOREARM,
    INDEX,
    OFFSETS,
    SHANK,
    THIGH,
    UPPER_ARM,
    X,
    Y,
    Z,
)
from mograft.dancer.plan import Foot, Plan, Route, fade, soft_minimum
from mograft.dancer.styles import ARM_PATTERNS, ArmMove
from mograft.motion import rotations


def leg_pose(pelvis: FloatArray, places: FloatArray, foot: Foot, hip: FloatArray) -> FloatArray:
    """Return local rotations of thigh, shank and foot, shape (n_frames, 3, 4)."""
    reach = foot.ankle - places - rotations.rotate(pelvis, hip)
    # The knee points between where the pelvis and where the foot points.
    yaw = rotations.twist(foot.quats, 1)
    knee = rotations.rotate(pelvis, Z) + rotations.rotate(yaw, Z)
    thigh, bend = _two_bones(reach, knee, (THIGH, SHANK), -Y, X)
    shank = rotations.from_axis_angle(X, bend)
    down = rotations.multiply(thigh, shank)
    return np.stack(
        [
            rotations.multiply(rotations.inverse(pelvis), thigh),
            shank,
            rotations.multiply(rotations.inverse(down), foot.quats),
        ],
        axis=1,
    )


def _two_bones(
    reach: FloatArray,
    pole: FloatArray,
    lengths: tuple[float, float],
    rest: FloatArray,
    hinge: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Bend a limb of two bones so that its end is where it should be.

    Parameters
    ----------
    reach : ndarray, shape (n, 3)
        From the start of the limb to its end; no longer than both bones.
    pole : ndarray, shape (n, 3) or (3,)
        Where to the middle joint points.
    lengths : tuple of float
        Of the two bones.
    rest, hinge : ndarray, shape (3,)
        Direction of the limb at rest, and the axis about which it bends.

    Returns
    -------
    upper : ndarray, shape (n, 4)
        Rotations of the first bone.
    bend : ndarray, shape (n,)
        Angles about the hinge of the second against the first, in radians, 0 if straight.
    """
    upper, lower = lengths
    distance = np.linalg.norm(reach, axis=-1)
    direction = reach / distance[:, None]
    axis = np.cross(pole, direction)
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    bend = np.pi - np.arccos((upper**2 + lower**2 - distance**2) / (2 * upper * lower))
    ahead = np.arccos((upper**2 + distance**2 - lower**2) / (2 * upper * distance))
    along = rotations.shortest_arc(rest, direction)
    about = rotations.shortest_arc(rotations.rotate(along, hinge), axis)
    turned = rotations.multiply(about, along)
    return rotations.multiply(turned, rotations.from_axis_angle(hinge, -ahead)), bend


def trunk_pose(plan: Plan, route: Route, clock: FloatArray, pelvis: FloatArray) -> FloatArray:
    """Return local rotations of spine, neck and head, shape (n_frames, 3, 4).

    The shoulders turn against the hips; the head looks where the dance goes and stays level.
    """
    beat = 2 * np.pi * clock
    twist, roll, lean = (np.radians(plan.faded(name, clock)) for name in ("twist", "roll", "lean"))
    nod = np.radians(1.5) * np.cos(2 * beat)
    angles = np.stack([-2 * twist * np.cos(beat), 1.5 * roll * np.sin(beat), lean + nod], axis=-1)
    spine = rotations.from_euler(angles, "YZX")
    chest = rotations.multiply(pelvis, spine)
    ahead = np.stack([route.heading(clock + 0.15), 0.4 * lean - 2 * nod], axis=-1)
    gaze = rotations.from_euler(ahead, "YX")
    to_gaze = rotations.multiply(rotations.inverse(chest), gaze)
    neck = rotations.exp(0.5 * rotations.log(to_gaze))
    head = rotations.multiply(rotations.inverse(neck), to_gaze)
    return np.stack([spine, neck, head], axis=1)


# Arms fade from pattern to pattern as rotation vectors from here, out to the side, a little
# down and forward: between any two poses the arm then passes where it has room.
_ARM_HOME = rotations.from_euler(np.radians([-30.0, -35.0, 0.0]), "ZYX")


def arm_pose(plan: Plan, clock: FloatArray, spine: FloatArray, side: int) -> FloatArray:
    """Return local rotations of shoulder, arm, forearm and hand, shape (n_frames, 4, 4).

    `side` is 0 for the left arm and 1 for the right, which moves as a left one in a mirror.
    """
    names = list(ARM_PATTERNS)
    size = plan.faded("arms", clock)
    own_spine = _mirrored(spine) if side else spine
    poses = np.stack(
        [_move_pose(ARM_PATTERNS[name][side], clock, size, own_spine) for name in names]
    )
    pattern = np.array([names.index(name) for name in plan.arms])
    padded = np.concatenate([pattern[:1], pattern, pattern[-1:]])
    border, weight = fade(clock, plan.n_strides)
    frame = np.arange(len(clock))
    before, after = poses[padded[border], frame], poses[padded[border + 1], frame]
    pose = before + weight[:, None] * (after - before)

    quats = np.stack(
        [
            rotations.from_axis_angle(Z, pose[:, 0]),
            rotations.multiply(_ARM_HOME, rotations.exp(pose[:, 1:4])),
            rotations.from_axis_angle(-Y, pose[:, 4]),
            rotations.exp(pose[:, 5:8]),
        ],
        axis=1,
    )
    return _mirrored(quats) if side else quats


def _move_pose(move: ArmMove, clock: FloatArray, size: FloatArray, spine: FloatArray) -> FloatArray:
    """Return a left arm's move as numbers that may be faded, shape (n_frames, 8).

    They are the angle of the shoulder, the rotation vector of the arm from its home, the
    angle of the elbow, and the rotation vector of the hand.
    """
    wave = np.cos(2 * np.pi * (move.beats * clock + move.start))
    if move.snap:
        wave = np.tanh(move.snap * wave) / np.tanh(move.snap)
    s = (size * wave)[:, None]
    wrist = np.array(move.wrist) + s * np.array(move.sway) + s**2 * np.array(move.arc)
    if move.on == "Hips":
        wrist = rotations.rotate(rotations.inverse(spine), wrist - OFFSETS[INDEX["Spine"]])

    shrug = np.radians(move.shrug) * (1 + 0.3 * wave)
    shoulder = rotations.from_axis_angle(Z, shrug)
    arm = OFFSETS[INDEX["LeftShoulder"]] + rotations.rotate(shoulder, OFFSETS[INDEX["LeftArm"]])
    reach = wrist - arm
    distance = np.linalg.norm(reach, axis=-1)
    within = soft_minimum(np.stack([distance, np.full_like(distance, ARM_REACH)]), 0.7)
    reach = reach * (within / distance)[:, None]
    bones = (UPPER_ARM, FOREARM)
    upper, bend = _two_bones(reach, np.array(move.elbow), bones, X, -Y)
    forearm = rotations.multiply(upper, rotations.from_axis_angle(-Y, bend))
    hand = np.zeros_like(reach)
    if move.hand is not None:
        aim = np.array(move.hand) / np.linalg.norm(move.hand)
        hand = rotations.log(
            rotations.shortest_arc(X, rotations.rotate(rotations.inverse(forearm), aim))
        )
    local = rotations.multiply(rotations.inverse(shoulder), upper)
    turn = rotations.log(rotations.multiply(rotations.inverse(_ARM_HOME), local))
    return np.concatenate([shrug[:, None], turn, bend[:, None], hand], axis=-1)


def _mirrored(quats: FloatArray) -> FloatArray:
    """Return rotations as seen in a mirror between left and right."""
    seen: FloatArray = quats * np.array([1.0, -1.0, -1.0, 1.0])
    return seen
