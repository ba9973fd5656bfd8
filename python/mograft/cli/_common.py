"""What the commands share: files in, results and progress out."""

import argparse
import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from mograft import __version__
from mograft._util.atomic import write_text
from mograft.errors import join_names

if TYPE_CHECKING:
    from mograft.library.library import Library
    from mograft.motion.motion import Motion
    from mograft.synthesis.graft import Graft

N = TypeVar("N", int, float)

__all__ = [
    "ENDS",
    "PRESETS",
    "above_zero",
    "add_making",
    "at_least_one",
    "check_free",
    "chosen_clips",
    "expanded",
    "frames",
    "given",
    "library_folder",
    "not_negative",
    "only_frames",
    "print_json",
    "progress",
    "say",
    "whole",
    "write",
    "write_report",
    "write_text",
]

PRESETS = (
    "lower_upper",
    "lower_torso_arms",
    "lower_torso_larm_rarm",
    "lower_torso_head_larm_rarm",
)

ENDS = (".bvh", ".json")
"""A motion and its provenance lie side by side."""

_MOST_CLIPS = 12
"""Clips of a library that are shown at once."""


def add_making(parser: argparse.ArgumentParser) -> None:
    """Add what every command that makes motions takes."""
    parser.add_argument(
        "--seed", type=whole, default=0, help="of what is left to chance (default 0)"
    )
    parser.add_argument("--force", action="store_true", help="overwrite what is there")


def whole(text: str) -> int:
    """Read a whole number from 0, for argparse."""
    return _number(int, text, lambda number: number >= 0, "a whole number, 0 or more")


def at_least_one(text: str) -> int:
    """Read a whole number from 1, for argparse."""
    return _number(int, text, lambda number: number >= 1, "a whole number, 1 or more")


def above_zero(text: str) -> float:
    """Read a number above 0, for argparse."""
    return _number(float, text, lambda number: 0 < number < math.inf, "a number above 0")


def not_negative(text: str) -> float:
    """Read a number from 0, for argparse."""
    return _number(float, text, lambda number: 0 <= number < math.inf, "a number, 0 or more")


def _number(kind: Callable[[str], N], text: str, fits: Callable[[N], bool], wanted: str) -> N:
    try:
        number = kind(text)
    except ValueError:
        number = None
    if number is None or not fits(number):
        raise argparse.ArgumentTypeError(f"must be {wanted}, got {text}")
    return number


def frames(text: str) -> tuple[int, int]:
    """Read the first and last of some frames, for argparse."""
    first, dash, last = text.partition("-")
    if not (dash and first.isdigit() and last.isdigit() and int(first) < int(last)):
        raise argparse.ArgumentTypeError(f"must be FIRST-LAST, as 100-400, got {text}")
    return int(first), int(last)


def only_frames(motion: "Motion", span: tuple[int, int] | None) -> "Motion":
    """Return the frames that ``--frames`` means; all, if it is not given."""
    if span is None:
        return motion
    first, last = span
    if last >= motion.n_frames:
        raise ValueError(
            f"--frames must be within 0-{motion.n_frames - 1} of {motion.name}, got {first}-{last}"
        )
    return motion[first : last + 1]


def given(options: argparse.Namespace, *names: str) -> list[str]:
    """Return those of the options that this command line gives, not a setting or a default."""
    own = [name for name in names if name not in options.origins]
    return [name for name in own if getattr(options, name) not in (None, False)]


def expanded(names: Iterable[str]) -> list[str]:
    """Put the BVH files of a folder in its place, in order of name."""
    files: list[str] = []
    for name in names:
        if Path(name).is_dir():
            if _is_library(name):
                raise ValueError(f"{name} is a library, where BVH files are wanted")
            inside = sorted(str(p) for p in Path(name).rglob("*") if p.suffix.lower() == ".bvh")
            if not inside:
                raise ValueError(f"{name}: no BVH file in this folder")
            files += inside
        else:
            files.append(name)
    return files


def library_folder(options: argparse.Namespace) -> Path | None:
    """Return the library, if that is what the files of a command are."""
    if not any(_is_library(name) for name in options.files):
        return None
    if len(options.files) > 1:
        options.usage("give one library or files; mograft index --add joins them")
    return Path(options.files[0])


def _is_library(name: str) -> bool:
    return (Path(name) / "manifest.json").is_file()


def chosen_clips(library: "Library", patterns: Sequence[str]) -> list[int]:
    """Return the clips of a library that ``--clip`` means; all, if it is not given."""
    names = [entry.name for entry in library.entries]
    chosen = set() if patterns else set(range(len(names)))
    for pattern in patterns:
        own = {index for index, name in enumerate(names) if fnmatchcase(name, pattern)}
        if not own:
            raise ValueError(f"--clip must name clips of {join_names(names)}; got {pattern!r}")
        chosen |= own
    if len(chosen) > _MOST_CLIPS:
        raise ValueError(
            f"{len(chosen)} clips are too many to show at once: choose {_MOST_CLIPS} at most by "
            f"--clip NAME, of {join_names([names[index] for index in sorted(chosen)])}"
        )
    return sorted(chosen)


def check_free(paths: Iterable[Path], *, force: bool) -> None:
    """Refuse to overwrite files, or to write into what is no folder."""
    paths = list(paths)
    for path in paths:
        nearest = next((above for above in path.parents if above.exists()), path)
        if not nearest.is_dir():
            raise NotADirectoryError(f"{nearest} is a file, where a folder is wanted")
    taken = [str(path) for path in paths if path.exists()]
    if taken and not force:
        more = f" and {len(taken) - 1} more" if len(taken) > 1 else ""
        raise FileExistsError(f"{taken[0]}{more} is there already; --force overwrites")


def write(graft: "Graft", path: Path) -> Path:
    """Write a graft's motion, and beside it where every part comes from."""
    from mograft.io.bvh import write_bvh

    document = {"mograft": __version__, **graft.as_dict()}
    # First, so that whenever this is interrupted no motion lies there without its provenance.
    write_text(path.with_suffix(".json"), json.dumps(document, indent=1) + "\n")
    write_bvh(graft.motion, path)
    return path


def write_report(
    grafts: "Sequence[Graft]", paths: Sequence[Path], target: Path, *, show: bool
) -> Path:
    """Write the page that tells of grafts, with links to their files; show it if wanted."""
    from mograft.viewing.page import open_file
    from mograft.viewing.report import report_page

    links = [Path(os.path.relpath(path, target.parent)) for path in paths]
    report_page(grafts, links).save(target, force=True)
    if show and not open_file(target):
        say("no browser was found: open the page yourself")
    return target


def print_json(document: dict[str, Any]) -> None:
    print(json.dumps(document, indent=1))


def say(text: str) -> None:
    print(text, file=sys.stderr)


def left_out(path: str, why: str) -> str:
    """Return that a file was left out; most reasons name it, and the line, themselves."""
    return f"left out: {why}" if why.startswith(path) else f"left out: {path}: {why}"


@contextmanager
def progress() -> Iterator[Callable[[str, int, int], None] | None]:
    """Show on a terminal what is being done; nothing where stderr is none."""
    if not sys.stderr.isatty():
        yield None
        return

    def show(stage: str, done: int, whole: int) -> None:
        print(f"\r\033[K{stage} {done}/{whole}", end="", file=sys.stderr, flush=True)

    try:
        yield show
    finally:
        print("\r\033[K", end="", file=sys.stderr, flush=True)
