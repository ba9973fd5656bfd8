"""Poses that follow the plan: inverse kinematics of the limbs, and the trunk."""

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.dancer import skeleton as figure
from mograft.dancer.plan import Foot, Plan, Route, soft_minimum, stride_transition
from mograft.dancer.skeleton import INDEX, OFFSETS, X, Y, Z
from mograft.dancer.styles import ARM_PATTERNS, ArmPattern
from mograft.motion import rotations

_TILTS = ("twist", "roll", "lean")


def pelvis_pose(
    plan: Plan, route: Route, clock: FloatArray, feet: list[Foot]
) -> tuple[FloatArray, FloatArray]:
    """Return rotations and positions of the pelvis, shapes (n_frames, 4) and (n_frames, 3).

    The leg style sets the height of the pelvis; it is lowered where a leg would be too short.
    """
    beat = 2 * np.pi * clock
    twist, roll, lean = np.radians([plan.interpolate(name, clock) for name in _TILTS])
    yaw = route.heading(clock) + twist * np.cos(beat)
    angles = np.stack([yaw, -roll * np.sin(beat), 0.4 * lean], axis=-1)
    quats = rotations.from_euler(angles, "YZX")

    aside = -plan.interpolate("sway", clock) * np.sin(beat)
    positions = route.position(clock, aside[:, None] * X)
    bounce_phase = 2 * (beat - 2 * np.pi * plan.interpolate("lag", clock))
    bounce = plan.interpolate("bounce", clock) * np.cos(bounce_phase)
    target = plan.interpolate("height", clock) - bounce
    limits = []
    for foot, hip in zip(feet, ("LeftUpLeg", "RightUpLeg"), strict=True):
        to_hip = rotations.rotate(quats, OFFSETS[INDEX[hip]])
        gap = (positions + to_hip - foot.ankle)[:, [0, 2]]
        below = np.sqrt(figure.LEG_REACH**2 - (gap**2).sum(axis=-1))
        limits.append(foot.ankle[:, 1] + below - to_hip[:, 1])
    positions[:, 1] = soft_minimum(np.stack([target, *limits]), 1.5)
    return quats, positions


def leg_pose(
    pelvis: FloatArray, pelvis_positions: FloatArray, foot: Foot, hip: FloatArray
) -> FloatArray:
    """Return local rotations of thigh, shank and foot, shape (n_frames, 3, 4).

    `pelvis` and `pelvis_positions` hold world rotations and positions of the pelvis. `hip` is the
    offset of the hip joint from the pelvis.
    """
    reach = foot.ankle - pelvis_positions - rotations.rotate(pelvis, hip)
    # The knee points to the mean of the forward directions of pelvis and foot.
    yaw = rotations.twist(foot.quats, 1)
    knee = rotations.rotate(pelvis, Z) + rotations.rotate(yaw, Z)
    thigh, bend = _two_bone_ik(reach, knee, figure.LEG_BONES, -Y, X)
    shank = rotations.from_axis_angle(X, bend)
    to_shank = rotations.inverse(rotations.multiply(thigh, shank))
    thigh = rotations.multiply(rotations.inverse(pelvis), thigh)
    return np.stack([thigh, shank, rotations.multiply(to_shank, foot.quats)], axis=1)


def _two_bone_ik(
    reach: FloatArray, pole: FloatArray, lengths: FloatArray, rest: FloatArray, hinge: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Solve the inverse kinematics of a limb of two bones with the given lengths.

    `reach`, shape (n, 3), is the vector from the start to the end of the limb; it is shorter than
    the sum of the lengths. The middle joint bends towards the direction `pole`. In the rest pose
    the limb has the direction `rest`, and the axis of the middle joint is `hinge`. Return the
    rotations of the first bone, shape (n, 4), and the angles of the middle joint in radians, shape
    (n,), which are 0 if the limb is straight.
    """
    (upper, lower), distance = lengths, np.linalg.norm(reach, axis=-1)
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

    `pelvis` holds world rotations. The chest rotates opposite to the pelvis. The head faces the
    direction of travel and stays nearly level.
    """
    beat = 2 * np.pi * clock
    twist, roll, lean = np.radians([plan.interpolate(name, clock) for name in _TILTS])
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


# Arm patterns are interpolated as rotation vectors relative to this rotation: sideways, a little
# down and forward. The arm then does not pass through the body between two patterns.
_ARM_HOME = rotations.from_euler(np.radians([-30.0, -35.0, 0.0]), "ZYX")


def arm_pose(plan: Plan, clock: FloatArray, spine: FloatArray, side: int) -> FloatArray:
    """Return local rotations of shoulder, arm, forearm and hand, shape (n_frames, 4, 4).

    `spine` holds the local rotations of the spine. `side` is 0 for the left arm and 1 for the right
    arm, which is computed as a mirrored left arm.
    """
    names, size = list(ARM_PATTERNS), plan.interpolate("arms", clock)
    spine, patterns = _mirror(spine) if side else spine, [ARM_PATTERNS[name] for name in names]
    poses = np.stack([_pattern_pose(pair[side], clock, size, spine) for pair in patterns])
    indices = np.array([names.index(name) for name in plan.arms])
    padded = np.concatenate([indices[:1], indices, indices[-1:]])
    boundary, weight = stride_transition(clock, plan.n_strides)
    frame = np.arange(len(clock))
    before, after = poses[padded[boundary], frame], poses[padded[boundary + 1], frame]
    pose = before + weight[:, None] * (after - before)
    shoulder = rotations.from_axis_angle(Z, pose[:, 0])
    arm = rotations.multiply(_ARM_HOME, rotations.exp(pose[:, 1:4]))
    forearm = rotations.from_axis_angle(-Y, pose[:, 4])
    quats = np.stack([shoulder, arm, forearm, rotations.exp(pose[:, 5:8])], axis=1)
    return _mirror(quats) if side else quats


def _pattern_pose(
    pattern: ArmPattern, clock: FloatArray, size: FloatArray, spine: FloatArray
) -> FloatArray:
    """Return the poses of the left arm in a pattern, as numbers that can be interpolated.

    The shape is (n_frames, 8). The columns hold the angle of the shoulder (1), the rotation vector
    of the arm relative to the constant rotation `_ARM_HOME` (3), the angle of the elbow (1) and the
    rotation vector of the hand (3), in radians. `size` is the amplitude in each frame, 1 for the
    original pattern; `spine` holds the local rotations of the spine.
    """
    wave = np.cos(2 * np.pi * (pattern.beats * clock + pattern.start))
    if pattern.snap:
        wave = np.tanh(pattern.snap * wave) / np.tanh(pattern.snap)
    s = (size * wave)[:, None]
    wrist = np.array(pattern.wrist) + s * np.array(pattern.sway) + s**2 * np.array(pattern.arc)
    if pattern.on == "Hips":
        wrist = rotations.rotate(rotations.inverse(spine), wrist - OFFSETS[INDEX["Spine"]])

    shrug = np.radians(pattern.shrug) * (1 + 0.3 * wave)
    shoulder = rotations.from_axis_angle(Z, shrug)
    arm = OFFSETS[INDEX["LeftShoulder"]] + rotations.rotate(shoulder, OFFSETS[INDEX["LeftArm"]])
    reach = wrist - arm
    distance = np.linalg.norm(reach, axis=-1)
    within = soft_minimum(np.stack([distance, np.full_like(distance, figure.ARM_REACH)]), 0.7)
    reach = reach * (within / distance)[:, None]
    upper, bend = _two_bone_ik(reach, np.array(pattern.elbow), figure.ARM_BONES, X, -Y)
    forearm = rotations.multiply(upper, rotations.from_axis_angle(-Y, bend))
    hand = np.zeros_like(reach)
    if pattern.hand is not None:
        aim = np.array(pattern.hand) / np.linalg.norm(pattern.hand)
        local_aim = rotations.rotate(rotations.inverse(forearm), aim)
        hand = rotations.log(rotations.shortest_arc(X, local_aim))
    local = rotations.multiply(rotations.inverse(shoulder), upper)
    turn = rotations.log(rotations.multiply(rotations.inverse(_ARM_HOME), local))
    return np.concatenate([shrug[:, None], turn, bend[:, None], hand], axis=-1)


def _mirror(quats: FloatArray) -> FloatArray:
    """Return rotations mirrored at the plane x = 0, which separates left from right."""
    return quats * np.array([1.0, -1.0, -1.0, 1.0])
