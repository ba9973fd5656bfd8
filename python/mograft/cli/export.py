"""``mograft export``: motions as files for other programs."""

import argparse
from pathlib import Path
from typing import Any

from mograft.cli._common import PRESETS, check_free, expanded, print_json, say

ENDINGS = (".glb", ".npz", ".csv", ".bvh")


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    export = commands.add_parser("export", help="write motions for other programs")
    export.add_argument(
        "files", nargs="+", metavar="FILE", help="BVH files; several, of one skeleton, to a .glb"
    )
    export.add_argument(
        "-o", "--output", type=Path, required=True, help="a .glb, .npz, .csv or .bvh to write"
    )
    export.add_argument("--rate", type=_above_zero, metavar="FPS", help="resample to this rate")
    export.add_argument(
        "--scale",
        type=_scale,
        metavar="UNIT|X",
        help="of a .glb: the file's unit, m, cm, mm, inch or CMU, or metres in it; "
        "default: what makes the figure as tall as a human",
    )
    export.add_argument("--groups", choices=PRESETS, help="of a .glb: joint groups to colour by")
    export.add_argument("--json", action="store_true", help="tell as JSON what was written")
    export.add_argument("--force", action="store_true", help="overwrite what is there")
    export.set_defaults(run=run, usage=export.error)


def _above_zero(text: str) -> float:
    number = float(text)
    if not 0 < number < float("inf"):
        raise argparse.ArgumentTypeError(f"must be above 0, got {text}")
    return number


def _scale(text: str) -> float | str:
    return text if text in ("m", "cm", "mm", "inch", "CMU") else _above_zero(text)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    target: Path = options.output
    ending = target.suffix.lower()
    files = expanded(options.files)
    if ending == ".fbx":
        options.usage("-o cannot be .fbx: write a .glb or .bvh and let Blender convert it")
    if ending not in ENDINGS:
        options.usage(f"-o must end in {', '.join(ENDINGS)}, got {target.name}")
    if len(files) > 1 and ending != ".glb":
        options.usage(f"-o {target.name} holds one motion, got {len(files)} files")
    if ending != ".glb" and not (options.scale is None and options.groups is None):
        options.usage("--scale and --groups are for a .glb; the other formats keep the file's unit")
    check_free([target], force=options.force)
    from mograft.bvh import read_bvh, write_bvh
    from mograft.formats import write_csv, write_glb, write_npz
    from mograft.formats.glb import UNITS

    motions = [read_bvh(name) for name in files]
    if options.rate is not None:
        motions = [motion.resample(options.rate) for motion in motions]
    told: dict[str, Any] = {
        "schema": "mograft.export/1",
        "file": str(target),
        "frames": [motion.n_frames for motion in motions],
        "rate": motions[0].rate,
    }
    if ending == ".glb":
        scale = UNITS[options.scale] if isinstance(options.scale, str) else options.scale
        used = write_glb(motions, target, scale=scale, groups=options.groups)
        told |= {"up": "y", "metres_in_a_unit": used}
        guessed = "" if options.scale is not None else ", a guess from the figure's height"
        say(f"{target.name}: metres, y up; 1 unit of the file is {used:g} m{guessed}")
    else:
        write = {".npz": write_npz, ".csv": write_csv, ".bvh": write_bvh}[ending]
        write(motions[0], target)
        say(f"{target.name}: unit and axes of {files[0]}")
    if options.json:
        print_json(told)
    else:
        print(target)
    return 0
