"""``mograft export``: motions as files for other programs."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mograft.cli._common import (
    above_zero,
    check_free,
    expanded,
    frames,
    given,
    only_frames,
    print_json,
    progress,
    say,
)
from mograft.cli.graft import chosen_groups

if TYPE_CHECKING:
    from mograft.motion.motion import Motion

FIGURES = (".glb", ".usd", ".usda", ".usdc")
FILMS = (".mp4", ".gif")
NUMBERS = (".npz", ".csv", ".bvh")
SEVERAL = (".glb", *FILMS)
ENDINGS = (*FIGURES, *FILMS, *NUMBERS)
_USES = {
    "scale": FIGURES,
    "groups": (*FIGURES, *FILMS),
    "size": FILMS,
    "dark": FILMS,
}


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    export = commands.add_parser(
        "export",
        help="write motions for other programs",
        description="The ending of the file to write says how: a figure with its motion (.glb; "
        ".usd, .usda or .usdc with the extra usd), a film (.mp4 or .gif, with the extra video), "
        "or numbers (.npz, .csv, .bvh).",
    )
    export.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="BVH files; several, of one skeleton, for a .glb; several for a film",
    )
    export.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE", help="the file to write"
    )
    export.add_argument(
        "--frames", type=frames, metavar="FIRST-LAST", help="only these; default: all"
    )
    export.add_argument("--rate", type=above_zero, metavar="FPS", help="resample to this rate")
    export.add_argument(
        "--scale",
        type=_scale,
        metavar="UNIT|X",
        help="of a figure: the file's unit, m, cm, mm, inch or CMU, or metres in it; "
        "default: what makes the figure as tall as a human",
    )
    export.add_argument(
        "--groups",
        metavar="NAME|FILE",
        help="of a figure or film: joint groups to colour by",
    )
    export.add_argument(
        "--size",
        type=_size,
        default="720x480",
        metavar="WIDTHxHEIGHT",
        help="of a film, in pixels (default 720x480)",
    )
    export.add_argument("--dark", action="store_true", help="of a film: light on dark")
    export.add_argument("--json", action="store_true", help="tell as JSON what was written")
    export.add_argument("--force", action="store_true", help="overwrite what is there")
    export.set_defaults(run=run, usage=export.error)


def _scale(text: str) -> float | str:
    units = ("m", "cm", "mm", "inch", "CMU")
    try:
        return text if text in units else above_zero(text)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(
            f"must be {', '.join(units)} or a number above 0, got {text}"
        ) from None


def _size(text: str) -> tuple[int, int]:
    wide, _, high = text.partition("x")
    if not (wide.isdecimal() and high.isdecimal()):
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT, as 720x480, got {text}")
    return int(wide), int(high)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    target: Path = options.output
    ending = target.suffix.lower()
    files = expanded(options.files)
    if ending == ".fbx":
        options.usage("-o cannot be .fbx: write a .glb or .bvh and let Blender convert it")
    if ending not in ENDINGS:
        options.usage(f"-o must end in {', '.join(ENDINGS)}, got {target.name}")
    if len(files) > 1 and ending not in SEVERAL:
        options.usage(f"-o {target.name} holds one motion, got {len(files)} files")
    for name in given(options, "scale", "groups", "dark"):
        if ending not in _USES[name]:
            options.usage(f"--{name} is for {', '.join(_USES[name])}; got {target.name}")
    check_free([target], force=options.force)
    from mograft.io.bvh import read_bvh

    if options.groups is not None:
        options.groups = chosen_groups(options)
    motions = [only_frames(read_bvh(name), options.frames) for name in files]
    target.parent.mkdir(parents=True, exist_ok=True)
    told: dict[str, Any] = {"schema": "mograft.export/1", "file": str(target)}
    if ending in FILMS:
        told |= _write_film(motions, target, options)
    else:
        if options.rate is not None:
            motions = [motion.resample(options.rate) for motion in motions]
        told |= {"frames": [motion.n_frames for motion in motions], "rate": motions[0].rate}
        if ending in FIGURES:
            told |= _write_figure(motions, target, options)
        else:
            _write_numbers(motions[0], target)
            told |= {"up": "as in the file", "unit": "of the file"}
            say(f"{target.name}: unit and axes of {files[0]}")
    if options.json:
        print_json(told)
    else:
        print(target)
    return 0


def _write_figure(
    motions: "Sequence[Motion]", target: Path, options: argparse.Namespace
) -> dict[str, Any]:
    from mograft.io.figure import UNITS
    from mograft.io.glb import write_glb
    from mograft.io.usd import write_usd

    scale = UNITS[options.scale] if isinstance(options.scale, str) else options.scale
    if target.suffix.lower() == ".glb":
        used = write_glb(motions, target, scale=scale, groups=options.groups)
    else:
        used = write_usd(motions[0], target, scale=scale, groups=options.groups)
    guessed = "" if options.scale is not None else ", a guess from the figure's height"
    say(f"{target.name}: metres, y up; 1 unit of the file is {used:g} m{guessed}")
    return {"up": "y", "unit": "m", "metres_in_a_unit": used}


def _write_film(
    motions: "Sequence[Motion]", target: Path, options: argparse.Namespace
) -> dict[str, Any]:
    from mograft.viewing.video import write_video

    with progress() as tell:
        rate = write_video(
            motions,
            target,
            rate=options.rate,
            size=options.size,
            groups=options.groups,
            dark=options.dark,
            progress=tell,
        )
    wide, high = options.size
    say(f"{target.name}: {wide} by {high} pixels, {rate:.6g} pictures a second")
    return {"size": [wide, high], "rate": rate, "frames": [m.n_frames for m in motions]}


def _write_numbers(motion: "Motion", target: Path) -> None:
    from mograft.io.bvh import write_bvh
    from mograft.io.tables import write_csv, write_npz

    write = {".npz": write_npz, ".csv": write_csv, ".bvh": write_bvh}[target.suffix.lower()]
    write(motion, target)
