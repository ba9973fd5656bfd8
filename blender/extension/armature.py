# SPDX-License-Identifier: GPL-3.0-or-later
"""Armatures as skeletons of mograft, and their actions as motions, in world space.

A pose bone turns and moves relative to its rest pose in axes of its own. mograft, as BVH, has world
axes in the rest pose. Both directions go through the poses of all bones in the space of the
armature, so that bones that inherit no rotation, and parents outside of the figure, are right.
"""

import json
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np

from mograft import rotations
from mograft.io.rest_pose import RestPose, rebase, restore

from . import curves as fc

OBJECT_JOINT = "Object"
INFLUENCES = "mograft_influences"
"""Custom property: the influence of the constraints that a new action turns off, as JSON."""

REST_TURNS = {"rotation_quaternion": (1, 0, 0, 0), "rotation_axis_angle": (0, 0, 1, 0)}
REST_PLACES = {"rotation_euler": (0, 0, 0), "location": (0, 0, 0), "scale": (1, 1, 1)}
REST_CHANNELS = REST_TURNS | REST_PLACES
ROTATION_CHANNELS = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}
UNITY = np.array([0.0, 0.0, 0.0, 1.0])
TOLERANCE = 1e-4
"""Relative difference up to which scales count as equal."""


class RefusedError(Exception):
    """What cannot be grafted, in words for the user."""


@dataclass(frozen=True)
class Placement:
    """Where an armature stands: the transform of its object, or of what its object moves in."""

    location: tuple
    rotation: tuple  # xyzw
    scale: float
    rest: tuple  # rotation to the world in the rest pose, without a turn about the vertical
    has_object: bool  # whether the object moves, and is the first joint


@dataclass(frozen=True)
class Rig:
    """The bones of an armature that form a figure."""

    owner: object
    placement: Placement
    bones: tuple  # of Bone, parents first
    parents: tuple  # index of the joint above each bone; -1 for none
    rest: RestPose
    heads: np.ndarray  # rest positions in the space of the armature, (n_bones, 3)
    turns: np.ndarray  # rest rotations in the space of the armature, (n_bones, 4)


def check_armature(owner):
    """Raise RefusedError if the actions of an object cannot be grafted."""
    if owner is None or owner.type != "ARMATURE":
        raise RefusedError("Select an armature")
    if owner.override_library is not None:
        raise RefusedError(f"{owner.name} is a library override: make it local")
    library = owner.library or owner.data.library
    if library is not None:
        raise RefusedError(f"{owner.name} is linked from {library.filepath}: make it local")
    if owner.mode == "EDIT":
        raise RefusedError(f"{owner.name} is in edit mode: leave it with Tab")


def needs_object(owner, actions):
    """Return whether the object is a joint: it moves, or the bones have several roots."""
    paths = {path for own in actions for path, _ in fc.find_curves(own, owner)}
    n_roots = sum(own.parent is None for own in owner.data.bones)
    return not paths.isdisjoint(fc.OBJECT_CHANNELS) or n_roots > 1


def place(owner, actions, *, has_object):
    """Return where an armature stands; its object moves as in `actions` if it is a joint."""
    if not has_object:
        found = _decompose(owner, owner.matrix_world)
        return Placement(*found, _upright(np.array(found[1])), has_object)
    matrix = owner.matrix_parent_inverse.copy()
    if owner.parent is not None:
        matrix = owner.parent.matrix_world @ matrix
    location, turn, scale = _decompose(owner, matrix)
    curves = next(filter(None, (_object_curves(own, owner) for own in actions)), {})
    frame = np.array([min((own.range()[0] for own in curves.values()), default=0.0)])
    size = fc.sample_channel(curves, "scale", 3, frame, owner.scale)[0]
    if np.ptp(size) > TOLERANCE * size.max() or size.min() <= 0:
        raise RefusedError(f"The scale of {owner.name} differs between the axes: apply it")
    rest = rotations.multiply(np.array(turn), _rotations_of(owner, curves, "", frame)[0])
    return Placement(location, turn, scale * float(size[0]), _upright(rest), has_object)


def _object_curves(action, owner):
    found = fc.find_curves(action, owner)
    return {key: own for key, own in found.items() if key[0] in fc.OBJECT_CHANNELS}


def _upright(turn):
    """Return a rotation without its part about the vertical axis.

    Armatures that face different ways then have the same rest pose.
    """
    heading = rotations.twist(turn, 2)
    return tuple(rotations.multiply(rotations.inverse(heading), turn).tolist())


def _decompose(owner, matrix):
    location, turn, scale = matrix.decompose()
    if max(scale) - min(scale) > TOLERANCE * max(scale) or min(scale) <= 0:
        raise RefusedError(f"The scale of {owner.name} differs between the axes: apply it")
    return tuple(location), (turn.x, turn.y, turn.z, turn.w), sum(scale) / 3


def make_rig(owner, placement, *, is_deform_only=False):
    """Return the figure that the bones of an armature form."""
    bones = [own for own in owner.data.bones if own.use_deform or not is_deform_only]
    if not bones:
        raise RefusedError(f"{owner.name} has no deform bones")
    index = {own.name: i for i, own in enumerate(bones)}
    parents = []
    for number, bone in enumerate(bones):
        above = (_joint_of(own, index) for own in bone.parent_recursive)
        known = (own for own in above if own is not None and own < number)
        parents.append(next(known, -1))
    matrices = np.array([own.matrix_local for own in bones])
    heads, turns = matrices[:, :3, 3], rotations.from_matrices(_orthogonal(matrices[:, :3, :3]))
    names, links = [own.name for own in bones], np.array(parents)
    location, base = np.array(placement.location), np.array(placement.rest)
    places = rotations.rotate(base, placement.scale * heads)
    quats = rotations.multiply(base, turns)
    if placement.has_object:
        names, links = [OBJECT_JOINT, *names], np.concatenate([[-1], links + 1])
        quats, places = np.vstack([base, quats]), np.vstack([np.zeros(3), places])
    elif parents.count(-1) > 1:
        roots = ", ".join(own.name for own, above in zip(bones, parents) if above < 0)
        raise RefusedError(f"The deform bones of {owner.name} have several roots: {roots}")
    rest = RestPose(tuple(names), links, quats, places + location)
    return Rig(owner, placement, tuple(bones), tuple(parents), rest, heads, turns)


def _joint_of(bone, index):
    """Return the joint of a bone above; an ORG bone of Rigify stands for its deform bone."""
    own = index.get(bone.name)
    return index.get("DEF-" + bone.name.removeprefix("ORG-")) if own is None else own


def _orthogonal(matrices):
    left, _, right = np.linalg.svd(matrices)
    return left @ right


def find_scaled_bones(rig, action):
    """Return the names of bones whose scale an action changes; grafts do not consider scale."""
    curves, bones = fc.find_curves(action, rig.owner), rig.owner.pose.bones
    keys = {(own.path_from_id("scale"), i): own.name for own in bones for i in range(3)}
    points = ((keys[k], p) for k in keys.keys() & curves.keys() for p in curves[k].keyframe_points)
    return sorted({name for name, own in points if abs(own.co[1] - 1.0) > 1e-3})


def _rotations_of(owned, curves, prefix, frames):
    """Return the rotations of an object or pose bone in frames, from the curves of its mode."""
    mode = owned.rotation_mode
    channel = ROTATION_CHANNELS.get(mode, "rotation_euler")
    # An object need not stand straight without keys.
    default = REST_CHANNELS[channel] if prefix else tuple(getattr(owned, channel))
    values = fc.sample_channel(curves, prefix + channel, len(default), frames, default)
    if mode == "QUATERNION":
        quats = values[:, [1, 2, 3, 0]]
        norms = np.linalg.norm(quats, axis=1, keepdims=True)
        return np.where(norms > 1e-9, quats / np.maximum(norms, 1e-9), UNITY)
    if mode == "AXIS_ANGLE":
        norms = np.linalg.norm(values[:, 1:], axis=1, keepdims=True)
        axes = np.where(norms > 1e-9, values[:, 1:] / np.maximum(norms, 1e-9), (0, 1, 0))
        return rotations.exp(axes * values[:, :1])
    order = mode[::-1]  # Blender turns about the fixed axes, in the order of the name
    return rotations.from_euler(values[:, ["XYZ".index(own) for own in order]], order)


def _angles_of(owned, quats):
    """Return the channel and the values that give rotations in the mode of a pose bone."""
    mode = owned.rotation_mode
    if mode == "QUATERNION":
        quats = rotations.continuous_signs(np.ascontiguousarray(quats))
        return "rotation_quaternion", quats[:, [3, 0, 1, 2]]
    if mode == "AXIS_ANGLE":
        turns = rotations.log(quats)
        angles = np.linalg.norm(turns, axis=1, keepdims=True)
        axes = np.where(angles > 1e-9, turns / np.maximum(angles, 1e-9), (0, 1, 0))
        return "rotation_axis_angle", np.hstack([angles, axes])
    order = mode[::-1]
    angles = rotations.to_euler(np.ascontiguousarray(quats), order)
    return "rotation_euler", angles[:, [order.index(own) for own in "XYZ"]]


def _bases(rig, number, above):
    """Return the axes of rotation, those of location, and the origin of a bone in each frame.

    `above` has the rotation and position of the bone's parent, or is None.
    """
    bone = rig.bones[number]
    rest_turn = rig.turns[number]
    if above is None:
        return rest_turn, rest_turn if bone.use_local_location else UNITY, rig.heads[number]
    turn, position = above
    rest = np.array(bone.parent.matrix_local)
    back = rotations.inverse(rotations.from_matrices(_orthogonal(rest[:3, :3])))
    moved = rotations.multiply(turn, rotations.multiply(back, rest_turn))
    offset = rotations.rotate(back, rig.heads[number] - rest[:3, 3])
    axes = moved if bone.use_inherit_rotation else rest_turn
    move = moved if bone.use_local_location else turn
    return axes, move, position + rotations.rotate(turn, offset)


def _frames_to_read(rig, action):
    """Return the frames of an action that can be grafted; raise RefusedError for others."""
    if not any(fc.BONE_PATH.match(path) for path, _ in fc.find_curves(action, rig.owner)):
        raise RefusedError(f"{action.name} animates no bone of {rig.owner.name}")
    first, last = fc.frames_of(action)
    if last <= first:
        raise RefusedError(f"{action.name} has one frame: an action to graft needs several")
    return np.arange(first, last + 1)


def read_action(rig, action, rate):
    """Return the motion of an action, sampled in whole frames.

    Channels without curves have their rest values. Cyclic and other modifiers are evaluated.
    """
    frames, owner = _frames_to_read(rig, action), rig.owner
    curves = fc.find_curves(action, owner)
    turns = np.empty((len(frames), len(rig.bones), 4))
    places = np.empty((len(frames), len(rig.bones), 3))
    numbers = {own.name: i for i, own in enumerate(rig.bones)}
    for number, bone in enumerate(rig.bones):
        above = None
        if bone.parent is not None:
            parent = numbers.get(bone.parent.name)
            if parent is None:
                raise RefusedError(f"{bone.name} is below a bone that is no deform bone")
            above = turns[:, parent], places[:, parent]
        own = owner.pose.bones[bone.name]
        axes, move, origin = _bases(rig, number, above)
        quats = _rotations_of(own, curves, own.path_from_id() + ".", frames)
        turns[:, number], places[:, number] = rotations.multiply(axes, quats), origin
        path = own.path_from_id("location")
        if not bone.use_connect and any((path, i) in curves for i in range(3)):
            shift = fc.sample_channel(curves, path, 3, frames, (0, 0, 0))
            places[:, number] += rotations.rotate(move, shift)
    return _to_motion(rig, action, curves, frames, turns, places, rate)


def _to_motion(rig, action, curves, frames, turns, places, rate):
    """Return the motion of bones given in the space of the armature."""
    placement, owner = rig.placement, rig.owner
    object_turns = np.tile(np.array(placement.rotation), (len(frames), 1))
    object_places = np.tile(np.array(placement.location), (len(frames), 1))
    if placement.has_object:
        outer = np.array(placement.rotation)
        own = _rotations_of(owner, curves, "", frames)
        path = fc.sample_channel(curves, "location", 3, frames, owner.location)
        size = fc.sample_channel(curves, "scale", 3, frames[:1], owner.scale)
        path *= placement.scale / size[0, 0]
        object_places = object_places + rotations.rotate(outer, path)
        object_turns = rotations.multiply(outer, own)
    quats = rotations.multiply(object_turns[:, None], turns)
    moved = rotations.rotate(object_turns[:, None], placement.scale * places)
    points = object_places[:, None] + moved
    if placement.has_object:
        quats = np.concatenate([object_turns[:, None], quats], axis=1)
        points = np.concatenate([object_places[:, None], points], axis=1)
    return rebase(rig.rest, (quats, points), 1.0 / rate, name=action.name)


def sample_visual(rig, action, rate):
    """Return the motion of the evaluated pose, parents outside of the figure, and scaled bones.

    Constraints and drivers are evaluated in every frame. The scene is left as it was.
    """
    frames, owner, scene = _frames_to_read(rig, action), rig.owner, bpy.context.scene
    parents = {b.parent.name for b in rig.bones if b.parent} - {b.name for b in rig.bones}
    names = [*(own.name for own in rig.bones), *sorted(parents)]
    matrices = np.empty((len(frames), len(names), 4, 4), np.float32)
    with shown(owner, action):
        graph = bpy.context.evaluated_depsgraph_get()
        owner.update_tag()
        scene.frame_set(int(frames[0]))  # drivers need a pass to settle
        for row, frame in enumerate(frames.tolist()):
            scene.frame_set(frame)
            pose = owner.evaluated_get(graph).pose.bones
            matrices[row] = [pose[own].matrix for own in names]
    sizes = np.linalg.norm(matrices[..., :3, :3], axis=-2)
    scaled = [own for own, n in zip(names, np.abs(sizes - 1).max(axis=(0, 2))) if n > 1e-3]
    quats = rotations.from_matrices(_orthogonal(matrices[..., :3, :3].astype(float)))
    places = matrices[..., :3, 3].astype(float)
    n, curves = len(rig.bones), fc.find_curves(action, owner)
    motion = _to_motion(rig, action, curves, frames, quats[:, :n], places[:, :n], rate)
    outside = {}
    for number, name in enumerate(names[n:], n):
        above = (own.name for own in owner.data.bones[name].parent_recursive)
        above = next((names.index(own) for own in above if own in names[:n]), -1)
        turn, spot = quats[:, number], places[:, number]
        if above >= 0:
            back = rotations.inverse(quats[:, above])
            turn = rotations.multiply(back, turn)
            spot = rotations.rotate(back, spot - places[:, above])
        outside[name] = above, turn, spot
    return motion, outside, scaled


@contextmanager
def shown(owner, action):
    """While a block runs, an armature has an action; then action, pose and frame are restored."""
    scene, data = bpy.context.scene, owner.animation_data_create()
    frame = scene.frame_current, scene.frame_subframe
    old, slot, use_nla = data.action, getattr(data, "action_slot", None), data.use_nla
    moved = [owner, *owner.pose.bones]
    pose = [(own, name, tuple(getattr(own, name))) for own in moved for name in REST_CHANNELS]
    data.use_nla = False
    try:
        show(owner, action)
        yield
    finally:
        data.action, data.use_nla = old, use_nla
        if slot is not None:
            data.action_slot = slot
        scene.frame_set(frame[0], subframe=frame[1])
        for own, name, value in pose:
            setattr(own, name, value)


def show(owner, action):
    """Assign an action, with its slot, to an armature.

    What only a graft keys, and the constraints that it turns off, get their values from before.
    """
    data, slot = owner.animation_data_create(), fc.find_slot(action, owner)
    old, new = data.action, fc.find_curves(action, owner)
    if old is not None and INFLUENCES in old:
        for path, value in json.loads(old[INFLUENCES]).items():
            owner.path_resolve(path.rpartition(".")[0]).influence = value
        for path, index in fc.find_curves(old, owner).keys() - new.keys():
            found = fc.BONE_PATH.match(path)
            if found is not None and found[2] in REST_CHANNELS:
                owner.path_resolve(path)[index] = REST_CHANNELS[found[2]][index]
    data.action = action
    if slot is not None and data.action_slot != slot:
        data.action_slot = slot


def write_action(rig, action, first, motion, base, outside):
    """Key the bones in which a motion differs from its base; return their names.

    `action` is a copy of the action of the base. `outside` has the poses of parents that are not in
    the figure, if it was sampled as evaluated: relative to the bone of the figure above, or to the
    armature if its index is -1.
    """
    owner, skip = rig.owner, int(rig.placement.has_object)
    frames = np.arange(first, first + motion.n_frames)
    turns, places = restore(rig.rest, motion)
    turns, places = _to_armature(rig, turns, places)
    differs = (motion.rotations != base.rotations).any(axis=(0, 2))
    moves = (motion.positions != base.positions).any(axis=(0, 2))
    if skip and (differs[0] or moves[0]):
        raise RefusedError("The object moves with an exchanged group: put it in the base group")
    bag = fc.find_bag(action, fc.find_slot(action, owner))
    links = {own.name: (i, UNITY, np.zeros(3)) for i, own in enumerate(rig.bones)} | outside
    written, is_changed = [], np.zeros(len(rig.bones), bool)
    for number, bone in enumerate(rig.bones):
        joint, parent = number + skip, rig.parents[number]
        is_outside = bone.parent is not None and bone.parent.name in outside
        is_bound = bone.use_inherit_rotation and not is_outside
        below = parent >= 0 and is_changed[parent]
        is_changed[number] = differs[joint] or moves[joint] or below
        if not (differs[joint] or moves[joint] or (below and not is_bound)):
            continue
        above = None
        if bone.parent is not None:
            link, turn, spot = links[bone.parent.name]
            if link >= 0:
                spot = places[:, link] + rotations.rotate(turns[:, link], spot)
                turn = rotations.multiply(turns[:, link], turn)
            above = turn, spot
        own = owner.pose.bones[bone.name]
        axes, move, origin = _bases(rig, number, above)
        turned = rotations.multiply(rotations.inverse(axes), turns[:, number])
        channel, values = _angles_of(own, turned)
        fc.write_channel(bag, own.path_from_id(channel), bone.name, frames, values)
        if (moves[joint] or not is_bound or outside) and not bone.use_connect:
            shift = rotations.rotate(rotations.inverse(move), places[:, number] - origin)
            fc.write_channel(bag, own.path_from_id("location"), bone.name, frames, shift)
        written.append(bone.name)
    return written


def _to_armature(rig, turns, places):
    """Return world rotations and positions of bones in the space of the armature."""
    placement = rig.placement
    object_turns, object_places = np.array(placement.rotation), np.array(placement.location)
    if placement.has_object:
        object_turns, object_places = turns[:, :1], places[:, :1]
        turns, places = turns[:, 1:], places[:, 1:]
    back = rotations.inverse(object_turns)
    places = rotations.rotate(back, places - object_places) / placement.scale
    return rotations.multiply(back, turns), places
