"""Options for constraints, and the constraints that they describe."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mograft.cli.arguments import Argument, ArgumentGroup, option, repeated_option, switch
from mograft.cli.values import argument_type, non_negative_number, positive_number

if TYPE_CHECKING:
    from mograft.search.constraints import Constraint
    from mograft.search.obstacles import Obstacle

__all__ = ["constraint_options", "read_constraints"]

_SHAPE_NUMBERS = {"sphere": 4, "capsule": 7, "box": 6, "wall": 6}
"""How many numbers describe a shape."""

_REACH_TOLERANCE = 0.03


def _numbers(text: str, *counts: int) -> list[float]:
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts:
        expected = " or ".join(str(count) for count in counts)
        raise ValueError(f"expected {expected} numbers separated by commas, got {text!r}")
    return numbers


def _obstacle(text: str) -> tuple[str, list[float]]:
    """Read a shape with its numbers, or a file with its position and heading."""
    kind, colon, rest = text.partition(":")
    if colon and kind in _SHAPE_NUMBERS:
        return kind, _numbers(rest, _SHAPE_NUMBERS[kind])
    if colon and len(kind) > 1 and kind.isalpha() and not Path(text).exists():
        raise ValueError(f"expected a file or one of {', '.join(_SHAPE_NUMBERS)}, got {kind}")
    name, separator, place = text.rpartition("@")
    if not separator or Path(text).exists():
        return text, [0.0] * 4
    return name, [*_numbers(place, 3, 4), 0.0][:4]


def _reach(text: str) -> tuple[int, str, tuple[float, ...], float]:
    """Read a frame, a joint, a position and a tolerance."""
    frame, _, rest = text.partition(":")
    joint, colon, place = rest.rpartition(":")  # The name of a joint may contain colons.
    if not colon or not frame.isdigit():
        raise ValueError(f"expected FRAME:JOINT:X,Y,Z[~TOL], got {text!r}")
    place, tilde, tolerance = place.partition("~")
    within = positive_number(tolerance) if tilde else _REACH_TOLERANCE
    return int(frame), joint, tuple(_numbers(place, 3)), within


def _face(text: str) -> tuple[tuple[float, ...], tuple[int, int] | None]:
    """Read a position and the frames."""
    place, separator, frames = text.partition("@")
    return tuple(_numbers(place, 3)), _frames(frames) if separator else None


def _frames(text: str) -> tuple[int, int]:
    first, dash, last = text.partition("-")
    if not dash or not first.isdigit() or not last.isdigit() or int(first) > int(last):
        raise ValueError(f"expected FIRST-LAST, ascending frames, got {text!r}")
    return int(first), int(last)


_OBSTACLE_OPTIONS = (
    repeated_option(
        "--avoid",
        type=argument_type(_obstacle),
        metavar="WHAT",
        help="obstacle that the body must not touch: FILE.bvh[@X,Y,Z[,YAW]] (another "
        "character, moved to a position and turned by YAW degrees), sphere:X,Y,Z,R, "
        "capsule:X,Y,Z,X,Y,Z,R, box:X,Y,Z,HALF,HALF,HALF or wall:X,Y,Z,NX,NY,NZ; may be repeated",
    ),
    option(
        "--radius",
        type=positive_number,
        default=1.0,
        metavar="X",
        help="factor on the capsule radii of the characters of --avoid (default: 1)",
    ),
    switch(
        "--avoid-self",
        help="forbid contact of hands and forearms with trunk, head, thighs and each other",
    ),
)
_TARGET_OPTIONS = (
    repeated_option(
        "--reach",
        type=argument_type(_reach),
        metavar="FRAME:JOINT:X,Y,Z[~TOL]",
        help="position of a joint in a frame, within TOL skeleton heights "
        f"(default: {_REACH_TOLERANCE}); may be repeated",
    ),
    repeated_option(
        "--face",
        type=argument_type(_face),
        metavar="X,Y,Z[@FIRST-LAST]",
        help="position that the head faces, within 20 degrees, in all frames or a range; may be "
        "repeated",
    ),
    repeated_option(
        "--keep",
        type=argument_type(_frames),
        metavar="FIRST-LAST",
        help="frames that keep the captured motion; may be repeated",
    ),
)
_DONOR_OPTIONS = (
    option(
        "--only-from",
        metavar="CLIP,...",
        help="clips that may provide donors, globs such as waltz* (default: all)",
    ),
    option(
        "--not-from",
        metavar="CLIP,...",
        help="clips that are excluded as donors, globs such as waltz* (default: none)",
    ),
    option(
        "--only-tagged",
        metavar="TAG,...",
        help="tags of the clips that may provide donors (default: all)",
    ),
    option(
        "--not-tagged",
        metavar="TAG,...",
        help="tags of the clips that provide no donors (default: none)",
    ),
    option(
        "--max-stretch",
        type=non_negative_number,
        metavar="X",
        help="maximum difference between the durations of donor and base segment, as a fraction of "
        "the latter (default: 0.15)",
    ),
    option(
        "--max-angle",
        type=positive_number,
        metavar="DEGREES",
        help="maximum seam angle in degrees (default: 45)",
    ),
)


def constraint_options(*more: Argument) -> ArgumentGroup:
    """Return the options of the constraints, followed by `more`."""
    return ArgumentGroup(
        "constraints",
        "Positions are in the unit of the file, frames are those of the base. If no donor "
        "sequence satisfies the constraints, the exit code is 4 and stderr lists the smallest "
        "violation.",
        (*_OBSTACLE_OPTIONS, *_TARGET_OPTIONS, *_DONOR_OPTIONS, *more),
    )


def read_constraints(options: argparse.Namespace) -> "list[Constraint]":
    """Return the constraints that the options describe."""
    import numpy as np

    from mograft.search import donor_constraints, pose_constraints

    found: list[Constraint] = [
        pose_constraints.Avoid(obstacle) for obstacle in _read_obstacles(options)
    ]
    if options.avoid_self:
        found.append(pose_constraints.AvoidSelf())
    for frame, joint, target, tolerance in options.reach:
        found.append(pose_constraints.Reach(joint, target, frame, tolerance))
    for target, frames in options.face:
        found.append(pose_constraints.Face(target, frames=frames))
    found += [donor_constraints.KeepOriginal(frames=frames) for frames in options.keep]
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


def _read_obstacles(options: argparse.Namespace) -> "list[Obstacle]":
    import numpy as np

    from mograft.io.bvh import read_bvh
    from mograft.search.obstacles import Character

    obstacles: list[Obstacle] = []
    for kind, numbers in options.avoid:
        if kind in _SHAPE_NUMBERS:
            try:
                obstacles.append(_shape(kind, numbers))
            except ValueError as error:
                options.usage_error(f"--avoid {kind}: {error}")
        else:
            x, y, z, heading = numbers
            yaw = float(np.radians(heading))
            obstacles.append(Character(read_bvh(kind), (x, y, z), yaw, radius=options.radius))
    return obstacles


def _shape(kind: str, numbers: list[float]) -> "Obstacle":
    from mograft.search import obstacles

    x, y, z, *rest = numbers
    if kind == "sphere":
        return obstacles.Sphere((x, y, z), rest[0])
    vector = (rest[0], rest[1], rest[2])
    if kind == "capsule":
        return obstacles.Capsule((x, y, z), vector, rest[3])
    if kind == "box":
        return obstacles.Box((x, y, z), vector)
    return obstacles.HalfSpace((x, y, z), vector)


def _words(text: str | None) -> list[str]:
    return [] if text is None else text.split(",")
