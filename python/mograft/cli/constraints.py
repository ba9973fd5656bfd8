"""The constraints that the options of a command describe."""

import argparse

import numpy as np

from mograft.cli.values import SHAPE_NUMBERS
from mograft.io.bvh.reader import read_bvh
from mograft.search import donor_constraints, pose_constraints
from mograft.search.constraints import Constraint
from mograft.search.obstacles import Box, Capsule, Character, HalfSpace, Obstacle, Sphere


def read_constraints(options: argparse.Namespace) -> list[Constraint]:
    """Return the constraints that the options describe."""
    found: list[Constraint] = [
        pose_constraints.Avoid(_read_obstacle(kind, numbers, options))
        for kind, numbers in options.avoid
    ]
    if options.avoid_self:
        found.append(pose_constraints.AvoidSelf())
    for frame, joint, target, tolerance in options.reach:
        found.append(pose_constraints.Reach(joint, target, frame, tolerance))
    for target, frames in options.face:
        found.append(pose_constraints.Face(target, frames=frames))
    found += [donor_constraints.KeepOriginal(frames=frames) for frames in options.keep]
    for options_of, kind_of in (
        (options.take, donor_constraints.Use),
        (options.ban, donor_constraints.Ban),
    ):
        found += [kind_of(number, donor, frames=span) for number, span, donor in options_of]
    for clips, tags, kind in (
        (options.only_from, options.only_tagged, donor_constraints.OnlyFrom),
        (options.not_from, options.not_tagged, donor_constraints.NotFrom),
    ):
        if clips is not None or tags is not None:
            found.append(kind(_words(clips), tags=_words(tags)))
    if options.max_stretch is not None:
        found.append(donor_constraints.MaxStretch(options.max_stretch))
    if options.max_angle is not None:
        found.append(donor_constraints.MaxAngle(float(np.radians(options.max_angle))))
    return found


def _read_obstacle(kind: str, numbers: list[float], options: argparse.Namespace) -> Obstacle:
    """Return the obstacle that a value of ``--avoid`` describes.

    `kind` is the name of a shape, such as ``"sphere"``, or the path of a character's BVH file.
    `numbers` are the dimensions of the shape, or the character's position and yaw in degrees.
    """
    x, y, z, *rest = numbers
    if kind not in SHAPE_NUMBERS:
        yaw = float(np.radians(rest[0]))
        return Character(read_bvh(kind), (x, y, z), yaw, radius=options.radius)
    try:
        if kind == "sphere":
            return Sphere((x, y, z), rest[0])
        vector = (rest[0], rest[1], rest[2])
        if kind == "capsule":
            return Capsule((x, y, z), vector, rest[3])
        return Box((x, y, z), vector) if kind == "box" else HalfSpace((x, y, z), vector)
    except ValueError as error:
        options.usage_error(f"--avoid {kind}: {error}")
        raise


def _words(text: str | None) -> list[str]:
    return [] if text is None else text.split(",")
