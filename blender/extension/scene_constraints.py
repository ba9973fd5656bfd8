# SPDX-License-Identifier: GPL-3.0-or-later
"""Constraints on grafts from objects of the scene."""

import numpy as np

import mograft as mg

from .armature import RefusedError

KINDS = (
    ("AVOID", "Avoid an object", "No contact with a mesh (its box), an empty or an armature"),
    ("REACH", "Hand or foot at an object", "A bone is at the place of an object in the frames"),
    ("FACE", "Look at an object", "The head turns to the place of an object"),
    ("KEEP", "Keep captured frames", "The frames stay as in the base action"),
)


def make_constraints(items, first, last, read_other):
    """Return the constraints of a panel, and by number what a setup stores of avoided armatures.

    `first` and `last` are the frames of the base action; `read_other` returns the motion of another
    armature, and the names that its setup stores.
    """
    found, others = [], {}
    for item in items:
        frames = None
        if item.use_frames:
            frames = item.first - first, item.last - first
            if not 0 <= frames[0] <= frames[1] <= last - first:
                got = f"got {item.first} to {item.last}"
                raise RefusedError(f"Conditions must be within frames {first} to {last}, {got}")
        if item.kind == "KEEP":
            found.append(mg.constraints.KeepOriginal(frames=frames))
            continue
        target = item.target
        if target is None:
            raise RefusedError("A condition has no object: choose one, or remove the condition")
        place = tuple(target.matrix_world.translation)
        if item.kind == "AVOID" and target.type == "ARMATURE":
            motion, other = read_other(target)
            others[len(found)] = {**other, "frames": frames}
            found.append(avoid_motion(motion, other, frames))
        elif item.kind == "AVOID":
            found.append(mg.constraints.Avoid(_obstacle(target), frames=frames))
        elif item.kind == "REACH":
            if not item.bone:
                raise RefusedError(f"Choose the bone that reaches {target.name}")
            span = frames or (0, last - first)
            found.append(mg.constraints.Reach(item.bone, place, frames=span))
        else:
            found.append(mg.constraints.Face(place, item.bone or None, frames=frames))
    return found, others


def avoid_motion(motion, other, frames):
    """Return the condition to avoid another armature, which starts `delay` seconds later."""
    obstacle = mg.constraints.Character(motion, delay=other["delay"])
    return mg.constraints.Avoid(obstacle, frames=frames)


def _obstacle(target):
    """Return an empty or the box of another object as an obstacle."""
    place, turn, scale = target.matrix_world.decompose()
    size = np.abs(np.array(scale))
    if target.type == "EMPTY":
        radius = target.empty_display_size
        if target.empty_display_type == "SINGLE_ARROW":
            normal = target.matrix_world.to_3x3().col[2]
            return mg.constraints.HalfSpace(tuple(place), tuple(normal))
        if target.empty_display_type != "CUBE":
            return mg.constraints.Sphere(tuple(place), float(radius * size.max()))
        corners = np.array([[-radius] * 3, [radius] * 3])
    else:
        corners = np.array(target.bound_box)
    low, high = corners.min(axis=0), corners.max(axis=0)
    if not (high > low).any():
        raise RefusedError(f"{target.name} has no extent: a mesh or an empty can be avoided")
    center = np.array(target.matrix_world)[:3, :3] @ ((low + high) / 2) + np.array(place)
    half = tuple((size * (high - low) / 2).tolist())
    return mg.constraints.Box(tuple(center.tolist()), half, (turn.x, turn.y, turn.z, turn.w))
