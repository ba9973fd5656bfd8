"""Constraints on the command line."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from mograft.cli._common import above_zero, not_negative

if TYPE_CHECKING:
    from mograft.search.constraints import Constraint
    from mograft.search.obstacles import Obstacle

T = TypeVar("T")

_SHAPES = {"sphere": 4, "capsule": 7, "box": 6, "wall": 6}


def add_constraints(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the options that say what a motion must do; return their group."""
    group = parser.add_argument_group(
        "constraints",
        "Places are in the file's unit, frames those of the base. What cannot be met ends "
        "with exit code 4 and the nearest miss.",
    )
    group.add_argument(
        "--avoid",
        action="append",
        default=[],
        type=_told(_avoided),
        metavar="WHAT",
        help="FILE.bvh[@X,Y,Z[,YAW]] (another character, moved there and turned by degrees), "
        "sphere:X,Y,Z,R, capsule:X,Y,Z,X,Y,Z,R, box:X,Y,Z,HALF,HALF,HALF or "
        "wall:X,Y,Z,NX,NY,NZ; may be given several times",
    )
    group.add_argument(
        "--radius",
        type=above_zero,
        default=1.0,
        metavar="X",
        help="how stout the characters of --avoid are (default 1)",
    )
    group.add_argument("--avoid-self", action="store_true", help="keep hands out of the body")
    group.add_argument(
        "--reach",
        action="append",
        default=[],
        type=_told(_reached),
        metavar="FRAME:JOINT:X,Y,Z[~TOL]",
        help="have a joint in a place, within TOL skeleton heights (default 0.03)",
    )
    group.add_argument(
        "--face",
        action="append",
        default=[],
        type=_told(_faced),
        metavar="X,Y,Z[@FIRST-LAST]",
        help="have the head look at a place, within 20 degrees",
    )
    group.add_argument(
        "--keep",
        action="append",
        default=[],
        type=_told(_span),
        metavar="FIRST-LAST",
        help="keep the captured motion in these frames",
    )
    group.add_argument(
        "--only-from", metavar="CLIP,...", help="clips that donors come from, as waltz*"
    )
    group.add_argument("--not-from", metavar="CLIP,...", help="clips that none comes from")
    group.add_argument(
        "--only-tagged", metavar="TAG,...", help="tags of clips that donors come from"
    )
    group.add_argument("--not-tagged", metavar="TAG,...", help="tags of clips that none comes from")
    group.add_argument(
        "--max-stretch",
        type=not_negative,
        metavar="X",
        help="part of its length a donor may change by",
    )
    group.add_argument(
        "--max-angle", type=above_zero, metavar="DEGREES", help="widest seam (default 45)"
    )
    return group


def constraints(options: argparse.Namespace) -> "list[Constraint]":
    """Return the constraints that the options ask for."""
    import numpy as np

    from mograft.io.bvh import read_bvh
    from mograft.search import constraints as of
    from mograft.search.obstacles import Character

    found: list[Constraint] = []
    for kind, numbers in options.avoid:
        if kind in _SHAPES:
            try:
                found.append(of.Avoid(_shape(kind, numbers)))
            except ValueError as error:
                options.usage(f"--avoid {kind}: {error}")
            continue
        other = Character(
            read_bvh(kind),
            (numbers[0], numbers[1], numbers[2]),
            float(np.radians(numbers[3])),
            radius=options.radius,
        )
        found.append(of.Avoid(other))
    if options.avoid_self:
        found.append(of.AvoidSelf())
    for frame, joint, target, tolerance in options.reach:
        found.append(of.Reach(joint, target, frame, tolerance))
    for target, frames in options.face:
        found.append(of.Face(target, frames=frames))
    found += [of.KeepOriginal(frames=frames) for frames in options.keep]
    for clips, tags, kind in (
        (options.only_from, options.only_tagged, of.OnlyFrom),
        (options.not_from, options.not_tagged, of.NotFrom),
    ):
        if clips is not None or tags is not None:
            found.append(kind(_words(clips), tags=_words(tags)))
    if options.max_stretch is not None:
        found.append(of.MaxStretch(options.max_stretch))
    if options.max_angle is not None:
        found.append(of.MaxAngle(float(np.radians(options.max_angle))))
    return found


def _shape(kind: str, numbers: list[float]) -> "Obstacle":
    from mograft.search import obstacles as of

    x, y, z, *rest = numbers
    if kind == "sphere":
        return of.Sphere((x, y, z), rest[0])
    along = (rest[0], rest[1], rest[2])
    if kind == "capsule":
        return of.Capsule((x, y, z), along, rest[3])
    return of.Box((x, y, z), along) if kind == "box" else of.HalfSpace((x, y, z), along)


def _words(text: str | None) -> list[str]:
    return [] if text is None else text.split(",")


def _told(read: Callable[[str], T]) -> Callable[[str], T]:
    """Have argparse print what was wrong with a value."""

    def checked(text: str) -> T:
        try:
            return read(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return checked


def _numbers(text: str, *counts: int) -> list[float]:
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts:
        wanted = " or ".join(str(count) for count in counts)
        raise ValueError(f"expected {wanted} numbers with commas between, got {text!r}")
    return numbers


def _avoided(text: str) -> tuple[str, list[float]]:
    kind, colon, rest = text.partition(":")
    if colon and kind in _SHAPES:
        return kind, _numbers(rest, _SHAPES[kind])
    if colon and len(kind) > 1 and kind.isalpha() and not Path(text).exists():
        raise ValueError(f"expected a file or one of {', '.join(_SHAPES)}, got {kind}")
    name, at, place = text.rpartition("@")
    if not at or Path(text).exists():
        return text, [0.0] * 4
    return name, [*_numbers(place, 3, 4), 0.0][:4]


def _reached(text: str) -> tuple[int, str, tuple[float, ...], float]:
    frame, _, rest = text.partition(":")
    joint, colon, place = rest.rpartition(":")  # a joint's name may have colons
    if not colon or not frame.isdigit():
        raise ValueError(f"expected FRAME:JOINT:X,Y,Z[~TOL], got {text!r}")
    place, tilde, tolerance = place.partition("~")
    within = above_zero(tolerance) if tilde else 0.03
    return int(frame), joint, tuple(_numbers(place, 3)), within


def _faced(text: str) -> tuple[tuple[float, ...], tuple[int, int] | None]:
    place, at, frames = text.partition("@")
    return tuple(_numbers(place, 3)), _span(frames) if at else None


def _span(text: str) -> tuple[int, int]:
    first, dash, last = text.partition("-")
    if not dash or not first.isdigit() or not last.isdigit() or int(first) > int(last):
        raise ValueError(f"expected FIRST-LAST, ascending frames, got {text!r}")
    return int(first), int(last)
