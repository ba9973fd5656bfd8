"""The bodies of a robot's model, and the skeleton that they give."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.motion import rotations
from mograft.motion.hinges import NO_LIMIT, Hinges, TableLayout
from mograft.motion.skeleton import Skeleton


@dataclass(eq=False)
class BodyJoint:
    """A hinge between a body and its parent, in the axes of the body."""

    name: str
    axis: FloatArray
    anchor: FloatArray = field(default_factory=lambda: np.zeros(3))
    limits: tuple[float, float] = (-NO_LIMIT, NO_LIMIT)  # radians
    speed: float = NO_LIMIT  # maximum, in radians per second


@dataclass(eq=False)
class Body:
    """A body, in the axes of its parent."""

    name: str
    parent: int  # index of the parent among the bodies, which precedes it; -1 at the root
    position: FloatArray
    rotation: FloatArray  # xyzw
    joints: list[BodyJoint]
    mass: float = 0.0
    center: FloatArray = field(default_factory=lambda: np.zeros(3))  # in the axes of the body


def to_skeleton(bodies: Sequence[Body], layout: TableLayout) -> Skeleton:
    """Return the skeleton of bodies.

    A body with several hinges has one joint for each; the last one has the name of the body.
    """
    # Of each joint: name, parent, position, axes and origin of the body, centre and mass, hinge.
    rows: list[tuple[Any, ...]] = []
    last: list[int] = []  # the joint that moves each body
    for body in bodies:
        above, origin, turn = -1, np.zeros(3), rotations.IDENTITY  # the motion places the root
        if rows:
            above = last[body.parent]
            *_, turn, origin, _, _, _ = rows[above]
            origin = origin + rotations.rotate(turn, body.position)
            turn = rotations.multiply(turn, body.rotation)
            turn = turn / np.linalg.norm(turn)
        joints: list[BodyJoint | None] = [*body.joints]
        for joint in joints or [None]:
            is_last = joint is None or joint is body.joints[-1]
            position = origin if joint is None else origin + rotations.rotate(turn, joint.anchor)
            center = origin + rotations.rotate(turn, body.center) if is_last else position
            mass, name = (body.mass, body.name) if is_last or joint is None else (0.0, joint.name)
            rows.append((name, above, position, turn, origin, center, mass, joint))
            above = len(rows) - 1
        last.append(above)
    names, parents, *columns, hinged = zip(*rows, strict=True)
    positions, turns, origins, centers, masses = map(np.array, columns)
    turning = [index for index, joint in enumerate(hinged) if joint is not None]
    own = [hinged[index] for index in turning]
    axes = rotations.rotate(turns[turning], np.array([joint.axis for joint in own]))
    hinges = Hinges(
        tuple(joint.name for joint in own),
        np.array(turning),
        axes / np.linalg.norm(axes, axis=1, keepdims=True),
        limits=np.array([joint.limits for joint in own]),
        speeds=np.array([joint.speed for joint in own]),
        bodies=np.array([last[i] for i, own in enumerate(bodies) if own.joints or not i]),
        frames=turns,
        origins=origins - positions,
        centers=centers - positions,
        masses=masses,
        layout=layout,
    )
    offsets = positions - positions[list(parents)]
    offsets[0] = 0.0
    return Skeleton(names, np.array(parents), offsets, hinges=hinges)
