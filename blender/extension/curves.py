# SPDX-License-Identifier: GPL-3.0-or-later
"""F-curves of actions as arrays, in every version of Blender's animation data."""

import re

import numpy as np

BONE_PATH = re.compile(r'pose\.bones\["((?:[^"\\]|\\.)*)"\]\.(\w+)$')
OBJECT_CHANNELS = {"location", "rotation_euler", "rotation_quaternion", "rotation_axis_angle"}


def find_slot(action, owner):
    """Return the slot of an action that animates an object; None if there is none.

    Before Blender 4.4 an action has no slots, and the result is None, too.
    """
    if not hasattr(action, "slots"):
        return None
    data = owner.animation_data
    if data is not None and data.action == action and data.action_slot is not None:
        return data.action_slot
    slots = [own for own in action.slots if own.target_id_type in ("OBJECT", "UNSPECIFIED")]
    named = [own for own in slots if own.identifier == f"OB{owner.name}"]
    return next(iter([*named, *slots]), None)


def find_bag(action, slot):
    """Return the owner of the F-curves and groups of a slot; None if the slot has none."""
    if not hasattr(action, "slots"):
        return action
    strips = (strip for layer in action.layers if slot is not None for strip in layer.strips)
    return next(filter(None, (own.channelbag(slot) for own in strips)), None)


def find_curves(action, owner):
    """Return the F-curves of an action that animate an object, by data path and index."""
    bag = find_bag(action, find_slot(action, owner))
    curves = () if bag is None else bag.fcurves
    return {(own.data_path, own.array_index): own for own in curves if not own.mute}


def frames_of(action):
    """Return the first and last frame of an action: its manual range, or that of its keys."""
    first, last = action.frame_range if action.use_frame_range else action.curve_frame_range
    return int(np.floor(first + 1e-4)), int(np.ceil(last - 1e-4))


def sample(curve, frames):
    """Return the values of an F-curve in consecutive frames."""
    points = curve.keyframe_points
    if len(points) and not len(curve.modifiers):
        flat = np.empty(2 * len(points), np.float32)
        points.foreach_get("co", flat)
        times, values = flat[::2], flat[1::2]
        if len(points) == 1 and curve.extrapolation == "CONSTANT":
            return np.full(len(frames), values[0], float)
        found = np.searchsorted(times, frames).clip(0, len(times) - 1)
        if (times[found] == frames).all():
            return values[found].astype(float)
    return np.array([curve.evaluate(frame) for frame in frames.tolist()])


def sample_channel(curves, path, size, frames, default):
    """Return the values of the curves of a property, shape (n_frames, size)."""
    values = np.tile(np.asarray(default, float), (len(frames), 1))
    for index in range(size):
        curve = curves.get((path, index))
        if curve is not None:
            values[:, index] = sample(curve, frames)
    return values


def write_channel(bag, path, group, frames, values, indices=(0, 1, 2, 3)):
    """Replace the curves of a property by linear keys in frames."""
    for index, column in zip(indices, np.asarray(values, np.float32).T):
        curve = bag.fcurves.find(path, index=index)
        name = group if curve is None or curve.group is None else curve.group.name
        if curve is not None:
            bag.fcurves.remove(curve)
        curve = bag.fcurves.new(path, index=index)
        curve.group = bag.groups.get(name) or bag.groups.new(name)
        points, n = curve.keyframe_points, len(frames)
        points.add(n)
        points.foreach_set("co", np.column_stack([frames, column]).astype(np.float32).ravel())
        points.foreach_set("interpolation", np.ones(n, np.int32))  # linear
        for side in ("handle_left_type", "handle_right_type"):
            points.foreach_set(side, np.full(n, 4, np.int32))  # clamped, if made Bezier later
        curve.update()
