"""The constraints that the options of a command describe."""

from collections.abc import Sequence
from fnmatch import fnmatchcase

import numpy as np

from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.frames import Range, resolve_frames
from mograft.cli.syntax.options import ConstraintOptions
from mograft.cli.syntax.values import SHAPE_NUMBERS
from mograft.errors import join_names, suggest_name
from mograft.io.addresses import read_clip
from mograft.library.library import Library
from mograft.search import donor_constraints, pose_constraints
from mograft.search.constraints import Constraint, Span
from mograft.search.donor_constraints import Ban, KeepOriginal, Use
from mograft.search.obstacles import Box, Capsule, Character, HalfSpace, Obstacle, Sphere

FLAGS = {"KeepOriginal": "--keep", "Reach": "--reach", "Face": "--face", "Avoid": "--avoid"}
"""The options of constraints that errors name."""


def read_constraints(options: ConstraintOptions, library: Library) -> list[Constraint]:
    """Return the constraints that the options describe.

    Raise ValueError if an option names a clip or tag that `library` does not have, and UsageError
    if an obstacle is invalid.
    """
    _check_names(options, library)

    def span(given: Range | None) -> Span | None:
        return None if given is None else resolve_frames(given, library.rate)

    found: list[Constraint] = [
        pose_constraints.Avoid(_read_obstacle(kind, numbers), frames=span(given))
        for kind, numbers, given in options.avoid
    ]
    if options.avoid_self:
        found.append(pose_constraints.AvoidSelf())
    for frames, joint, target, tolerance in options.reach:
        reach = pose_constraints.Reach(joint, target, tolerance=tolerance, frames=span(frames))
        found.append(reach)
    for target, given in options.face:
        found.append(pose_constraints.Face(target, frames=span(given)))
    found += read_segment_constraints(options, library.rate)
    for clips, tags, kind in (
        (options.only_from, options.only_tagged, donor_constraints.OnlyFrom),
        (options.not_from, options.not_tagged, donor_constraints.NotFrom),
    ):
        if clips is not None or tags is not None:
            found.append(kind(clips or (), tags=tags or ()))
    if options.max_stretch is not None:
        found.append(donor_constraints.MaxStretch(options.max_stretch))
    if options.max_angle is not None:
        found.append(donor_constraints.MaxAngle(float(np.radians(options.max_angle))))
    return found


def _check_names(options: ConstraintOptions, library: Library) -> None:
    """Raise ValueError if a clip or tag in the options for donors is not in the library."""
    tags = sorted({tag for entry in library.entries for tag in entry.tags})
    for option, names in (("only_from", library.names), ("not_from", library.names)):
        for word in getattr(options, option) or ():
            if not any(fnmatchcase(name, word) for name in names):
                raise ValueError(
                    f"--{option.replace('_', '-')} must match one of {join_names(names)}; "
                    f"got {word!r}{suggest_name(word, names)}"
                )
    for option in ("only_tagged", "not_tagged"):
        for word in getattr(options, option) or ():
            if word not in tags:
                expected = f"one of {join_names(tags)}" if tags else "omitted: no clip has a tag"
                raise ValueError(
                    f"--{option.replace('_', '-')} must be {expected}; "
                    f"got {word!r}{suggest_name(word, tags)}"
                )


def read_segment_constraints(
    options: ConstraintOptions, rate: float
) -> list[KeepOriginal | Use | Ban]:
    """Return the constraints of ``--keep``, ``--take`` and ``--ban``; `rate` is in frames/s."""
    found: list[KeepOriginal | Use | Ban] = [
        KeepOriginal(frames=resolve_frames(span, rate)) for span in options.keep
    ]
    kinds: tuple[type[Use | Ban], ...] = (Use, Ban)
    for kind, values in zip(kinds, (options.take, options.ban), strict=True):
        for value, donor in values:
            if isinstance(donor, tuple):
                donor = (donor[0], *resolve_frames(donor[1:], rate))
            frames = value.resolve_span(rate)
            found.append(kind(value.number, donor, frames=frames, group=value.group))
    return found


def _read_obstacle(kind: str, numbers: Sequence[float]) -> Obstacle:
    """Return the obstacle that a value of ``--avoid`` describes.

    `kind` is the name of a shape, such as ``"sphere"``, or the address of a character's motion.
    `numbers` are the dimensions of the shape, or the character's position and yaw in degrees.
    """
    x, y, z, *rest = numbers
    if kind not in SHAPE_NUMBERS:
        yaw = float(np.radians(rest[0]))
        return Character(read_clip(kind), (x, y, z), yaw)
    try:
        if kind == "sphere":
            return Sphere((x, y, z), rest[0])
        vector = (rest[0], rest[1], rest[2])
        if kind == "capsule":
            return Capsule((x, y, z), vector, rest[3])
        return Box((x, y, z), vector) if kind == "box" else HalfSpace((x, y, z), vector)
    except ValueError as error:
        raise UsageError(f"--avoid {kind}: {error}") from None
