"""Motions as other figures perform them: other names, axes, units and rest poses."""

from dataclasses import replace

import numpy as np

from mograft.body.anatomy import anatomy
from mograft.io.rest_pose import RestPose, rebase
from mograft.motion import rotations
from tests.strategies import transform_motion, turn_motion


def other_names(skeleton):
    """Names of another convention, in which no name stays the same."""
    words = {"UpLeg": "Thigh", "Leg": "Shin", "Arm": "UpperArm", "ForeArm": "LowerArm"}
    words |= {"Hips": "pelvis", "Shoulder": "Collar", "ToeBase": "Toe", "Head": "skull"}
    names = []
    for name in skeleton.names:
        side = next((word for word in ("Left", "Right") if name.startswith(word)), "")
        stem = name.removeprefix(side)
        names.append(f"{words.get(stem, stem)}{side and '_' + side[0]}".lower())
    return names


def with_other_rest_pose(motion, rng):
    """The same motion relative to a rest pose with bent arms, turned as a whole."""
    skeleton = motion.skeleton
    known = anatomy(skeleton)
    bent = np.tile(rotations.IDENTITY, (skeleton.n_joints, 1))
    for joint, part in enumerate(known.parts):
        if part in ("upper_arm", "forearm"):
            bone = skeleton.offsets[skeleton.children[joint][0]]
            normal = np.cross(bone, rng.normal(size=3))  # no twist about the bone
            bent[joint] = rotations.exp(0.8 * normal / np.linalg.norm(normal))
        elif part in ("hand", "finger"):
            bent[joint] = bent[skeleton.parents[joint]]
    pose = rng.integers(4) * np.pi / 2
    whole = rotations.exp(pose * np.eye(3)[rng.integers(3)])
    # World rotations of the new rest pose, from which its positions follow.
    world = rotations.multiply(whole, bent)
    places = np.zeros_like(skeleton.offsets)
    for joint, parent in enumerate(skeleton.parents.tolist()):
        if parent >= 0:
            places[joint] = places[parent] + rotations.rotate(
                world[parent], skeleton.offsets[joint]
            )
    rest = RestPose(skeleton.names, skeleton.parents, world, places)
    turned, positions = motion.world_transforms()
    return rebase(rest, (turned, positions), motion.frame_time)


def as_other_figure(motion, seed=0):
    """The motion in metres with z up, with other names and another rest pose."""
    turn = rotations.shortest_arc(np.eye(3)[1], np.eye(3)[2])
    turned = turn_motion(transform_motion(motion, 0.01), turn)
    posed = with_other_rest_pose(turned, np.random.default_rng(seed))
    skeleton = replace(posed.skeleton, names=tuple(other_names(posed.skeleton)))
    return replace(posed, skeleton=skeleton, name=motion.name)
