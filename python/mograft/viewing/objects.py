"""The obstacles and targets of constraints, as the page draws them."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray
from mograft.body.mass import mass_model, up_axis
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.search.constraints import Constraint
from mograft.search.obstacles import Box, Capsule, Character, HalfSpace, Obstacle, Sphere
from mograft.search.pose_constraints import Avoid, Face, KeepOut, Reach
from mograft.viewing.geometry import DrawnSkeleton

_FACE_TARGET_RADIUS = 0.02
"""Radius of the mark of a `Face` target, in heights."""


class ShownConstraint(NamedTuple):
    """A constraint, and a motion whose axes and unit are those of the constraint's positions."""

    constraint: Constraint
    motion: Motion


def encode_objects(shown: Iterable[ShownConstraint]) -> list[dict[str, Any]]:
    """Return the obstacles and targets as dicts for JSON, with positions in the axes of the page.

    Constraints without a place in the world are omitted. A dict of kind ``"figure"`` has the
    skeleton in these axes and the motion of a character under ``"clip"``, which the caller must
    encode.
    """
    objects = []
    for constraint, motion in shown:
        to_page = DrawnSkeleton.of(motion[:1]).to_y_up
        shape = _encode_shape(constraint, motion, to_page)
        if shape is not None:
            frames = None if constraint.frames is None else list(constraint.frames)
            objects.append({**shape, "frames": frames, "label": _label(constraint)})
    return objects


def _encode_shape(
    constraint: Constraint, motion: Motion, to_page: FloatArray
) -> dict[str, Any] | None:
    if isinstance(constraint, Avoid):
        return _encode_obstacle(constraint.obstacle, to_page)
    if isinstance(constraint, KeepOut):
        return _encode_obstacle(constraint.region, to_page)
    if not isinstance(constraint, Reach | Face):
        return None
    size = constraint.tolerance if isinstance(constraint, Reach) else _FACE_TARGET_RADIUS
    return {
        "kind": "target",
        "center": _numbers(to_page @ np.array(constraint.target)),
        "radius": float(size * mass_model(motion.skeleton).height),
        "joint": _joint(constraint.joint, motion.skeleton),
    }


def _joint(name: str | None, skeleton: Skeleton) -> int:
    """Return the index of a joint, by default of the head; -1 if there is none."""
    if name is not None:
        return skeleton.index(name)
    head = mass_model(skeleton).head
    return -1 if head is None else head


def _label(constraint: Constraint) -> str:
    frames = ""
    if constraint.frames is not None:
        first, last = constraint.frames
        frames = f", frame {first}" if first == last else f", frames {first}\N{EN DASH}{last}"
    if isinstance(constraint, Reach):
        return f"{constraint.joint}{frames}"
    if isinstance(constraint, Face):
        return f"face{frames}"
    if isinstance(constraint, KeepOut):
        return f"{constraint.joint} {'inside' if constraint.inside else 'outside'}{frames}"
    return frames.removeprefix(", ")


def _encode_obstacle(obstacle: Obstacle, to_page: FloatArray) -> dict[str, Any] | None:
    """Return an obstacle as a dict, or None if its class is unknown."""

    def move(position: npt.ArrayLike) -> list[float]:
        return _numbers(to_page @ np.asarray(position, float))

    if isinstance(obstacle, Sphere):
        return {"kind": "sphere", "center": move(obstacle.center), "radius": obstacle.radius}
    if isinstance(obstacle, Capsule):
        start, stop = obstacle.start, obstacle.stop
        return {
            "kind": "capsule",
            "center": move(np.mean([start, stop], axis=0)),
            "start": move(start),
            "stop": move(stop),
            "radius": obstacle.radius,
        }
    if isinstance(obstacle, Box):
        signs = np.array(list(product((-1.0, 1.0), repeat=3)))
        turn = np.broadcast_to(np.array(obstacle.rotation, float), (8, 4))
        corners = rotations.rotate(turn, signs * obstacle.half) + obstacle.center
        center = move(obstacle.center)
        return {"kind": "box", "center": center, "corners": [move(corner) for corner in corners]}
    if isinstance(obstacle, HalfSpace):
        normal = to_page @ (np.array(obstacle.normal) / np.linalg.norm(obstacle.normal))
        across = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
        across /= np.linalg.norm(across)
        return {
            "kind": "plane",
            "point": move(obstacle.point),
            "normal": _numbers(normal),
            "across": _numbers(across),
            "along": _numbers(np.cross(normal, across)),
        }
    if isinstance(obstacle, Character):
        return {"kind": "figure", "delay": obstacle.delay, "clip": _character(obstacle, to_page)}
    return None


def _character(obstacle: Character, to_page: FloatArray) -> tuple[DrawnSkeleton, Motion]:
    drawn = DrawnSkeleton.of(obstacle.motion)
    world = drawn.positions @ drawn.to_y_up
    axis = np.eye(3)[up_axis(obstacle.motion)]
    turn = np.broadcast_to(rotations.exp(obstacle.yaw * axis), (*world.shape[:-1], 4))
    moved = rotations.rotate(turn, world) + np.array(obstacle.offset)
    return replace(drawn, positions=moved @ to_page.T), obstacle.motion


def _numbers(values: FloatArray) -> list[float]:
    return [float(f"{value:.6g}") for value in values.tolist()]
