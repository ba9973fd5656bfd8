"""``mograft export``: motions as files for other programs."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mograft.cli.arguments import Command, option, positional, switch
from mograft.cli.configuration import options_given, selected_groups
from mograft.cli.files import check_writable, expand_folders, select_frames
from mograft.cli.options import FORCE, JSON
from mograft.cli.output import print_json, print_remark, show_progress
from mograft.cli.values import frame_range, positive_number

if TYPE_CHECKING:
    from mograft.motion.motion import Motion

_FIGURES = (".glb", ".usd", ".usda", ".usdc")
_FILMS = (".mp4", ".gif")
_TABLES = (".npz", ".csv", ".bvh")
_ENDINGS = (*_FIGURES, *_FILMS, *_TABLES)
_ENDINGS_OF_SEVERAL = (".glb", *_FILMS)
_ENDINGS_OF_OPTION = {"scale": _FIGURES, "groups": (*_FIGURES, *_FILMS), "dark": _FILMS}
_UNITS = ("m", "cm", "mm", "inch", "CMU")


def _scale(text: str) -> float | str:
    try:
        return text if text in _UNITS else positive_number(text)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(
            f"must be {', '.join(_UNITS)} or a number above 0, got {text}"
        ) from None


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT, as 720x480, got {text}")
    return int(width), int(height)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    target: Path = options.output
    ending = target.suffix.lower()
    files = expand_folders(options.files)
    _check_usage(options, ending, len(files))
    check_writable([target], force=options.force)
    from mograft.io.bvh import read_bvh

    if options.groups is not None:
        options.groups = selected_groups(options)
    motions = [select_frames(read_bvh(name), options.frames) for name in files]
    target.parent.mkdir(parents=True, exist_ok=True)
    document: dict[str, Any] = {"schema": "mograft.export/1", "file": str(target)}
    if ending in _FILMS:
        document |= _write_film(motions, target, options)
    else:
        if options.rate is not None:
            motions = [motion.resample(options.rate) for motion in motions]
        document |= {"frames": [motion.n_frames for motion in motions], "rate": motions[0].rate}
        if ending in _FIGURES:
            document |= _write_figure(motions, target, options)
        else:
            _write_table(motions[0], target)
            document |= {"up": "as in the file", "unit": "of the file"}
            print_remark(f"{target.name}: unit and axes of {files[0]}")
    if options.json:
        print_json(document)
    else:
        print(target)
    return 0


def _check_usage(options: argparse.Namespace, ending: str, n_files: int) -> None:
    name = options.output.name
    if ending == ".fbx":
        options.usage_error("-o cannot be .fbx: write .glb or .bvh and convert it in Blender")
    if ending not in _ENDINGS:
        options.usage_error(f"-o must end in {', '.join(_ENDINGS)}, got {name}")
    if n_files > 1 and ending not in _ENDINGS_OF_SEVERAL:
        options.usage_error(f"-o {name} can contain one motion, got {n_files} files")
    for option_name in options_given(options, *_ENDINGS_OF_OPTION):
        endings = _ENDINGS_OF_OPTION[option_name]
        if ending not in endings:
            options.usage_error(f"--{option_name} requires {', '.join(endings)}; got {name}")


def _write_figure(
    motions: "Sequence[Motion]", target: Path, options: argparse.Namespace
) -> dict[str, Any]:
    from mograft.io.glb import write_glb
    from mograft.io.units import UNITS
    from mograft.io.usd import write_usd

    scale = UNITS[options.scale] if isinstance(options.scale, str) else options.scale
    if target.suffix.lower() == ".glb":
        metres = write_glb(motions, target, scale=scale, groups=options.groups)
    else:
        metres = write_usd(motions[0], target, scale=scale, groups=options.groups)
    estimated = "" if options.scale is not None else " (estimated from the figure's height)"
    print_remark(f"{target.name}: metres, y up; 1 unit of the file is {metres:g} m{estimated}")
    return {"up": "y", "unit": "m", "metres_in_a_unit": metres}


def _write_film(
    motions: "Sequence[Motion]", target: Path, options: argparse.Namespace
) -> dict[str, Any]:
    from mograft.viewing.video import write_video

    with show_progress() as progress:
        rate = write_video(
            motions,
            target,
            rate=options.rate,
            size=options.size,
            groups=options.groups,
            dark=options.dark,
            progress=progress,
        )
    width, height = options.size
    print_remark(f"{target.name}: {width} by {height} pixels, {rate:.6g} pictures per second")
    return {"size": [width, height], "rate": rate, "frames": [m.n_frames for m in motions]}


def _write_table(motion: "Motion", target: Path) -> None:
    from mograft.io.bvh import write_bvh
    from mograft.io.csv import write_csv
    from mograft.io.npz import write_npz

    write = {".npz": write_npz, ".csv": write_csv, ".bvh": write_bvh}[target.suffix.lower()]
    write(motion, target)


COMMAND = Command(
    name="export",
    help="write motions for other programs",
    description="Write motions in the format that the ending of the output file selects: an "
    "animated figure (.glb; .usd, .usda or .usdc with the extra usd), a film (.mp4 or .gif, with "
    "the extra video), or channel values (.npz, .csv, .bvh).",
    run=run,
    arguments=(
        positional(
            "files",
            is_path=True,
            nargs="+",
            metavar="FILE",
            help="BVH file; for a .glb also several of one skeleton, for a film also several",
        ),
        option(
            "-o",
            "--output",
            is_setting=False,
            is_path=True,
            type=Path,
            required=True,
            metavar="FILE",
            help="file to write",
        ),
        option(
            "--frames",
            is_setting=False,
            type=frame_range,
            metavar="FIRST-LAST",
            help="frames to write (default: all)",
        ),
        option(
            "--rate",
            type=positive_number,
            metavar="FPS",
            help="frame rate to resample to, in frames per second (default: that of the file, of "
            "a film at most 60, of a GIF 20)",
        ),
        option(
            "--scale",
            type=_scale,
            metavar="UNIT|X",
            help=f"unit of the BVH file, for a figure: {', '.join(_UNITS)}, or a number of metres "
            "(default: the unit that gives the figure human height)",
        ),
        option(
            "--groups",
            is_path=True,
            metavar="NAME|FILE",
            help="joint groups that set the colours of a figure or film: the name of a preset, "
            "or a TOML file (default: trunk, arms and legs)",
        ),
        option(
            "--size",
            type=_size,
            default="720x480",
            metavar="WIDTHxHEIGHT",
            help="size of a film in pixels (default: 720x480)",
        ),
        switch("--dark", help="draw a film in light colours on a dark background"),
        JSON,
        FORCE,
    ),
)
