"""``mograft export``: motions as files for other programs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mograft.body.groups import JointGroups
from mograft.cli.configuration import figure_groups, refuse_useless_options, selected_skeleton
from mograft.cli.files import check_writable, expand_folders, frame_range
from mograft.cli.output import print_remark, print_result, show_progress
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.commands import ExportOptions
from mograft.cli.syntax.values import Range
from mograft.config import Config
from mograft.io.addresses import read_clip
from mograft.io.bvh.writer import write_bvh
from mograft.io.csv import write_csv
from mograft.io.glb import write_glb
from mograft.io.npz import write_npz
from mograft.io.smpl.writer import write_amass
from mograft.io.units import UNITS, guess_unit
from mograft.io.usd import write_usd
from mograft.motion.motion import Motion
from mograft.viewing.video import write_video

_FIGURES = (".glb", ".usd", ".usda", ".usdc")
_FILMS = (".mp4", ".gif")
_TABLE_WRITERS = {".npz": write_npz, ".csv": write_csv}
_ENDINGS = (*_FIGURES, *_FILMS, *_TABLE_WRITERS, ".bvh")
_ENDINGS_OF_SEVERAL = (".glb", *_FILMS)
_ENDINGS_OF_OPTION = {
    "scale": _FIGURES,
    "groups": (*_FIGURES, *_FILMS),
    "dark": _FILMS,
    "digits": (".bvh",),
    "like": (".npz",),
}
_Groups = JointGroups | str | None


def run(options: ExportOptions) -> int:
    """Run the command."""
    target = options.output
    ending = target.suffix.lower()
    files = expand_folders(options.files)
    if ending == ".fbx":
        raise UsageError("-o cannot be .fbx: write .glb or .bvh and convert it in Blender")
    if ending not in _ENDINGS:
        raise UsageError(f"-o must end in {', '.join(_ENDINGS)}, got {target.name}")
    if len(files) > 1 and ending not in _ENDINGS_OF_SEVERAL:
        raise UsageError(f"-o {target.name} can contain only one motion, got {len(files)} files")
    refuse_useless_options(options, _ENDINGS_OF_OPTION, ending, target.name)
    check_writable([target], force=options.force, inputs=files)
    skeleton = selected_skeleton(options.skeleton)
    groups = figure_groups(options.groups, files, Config(), skeleton)
    motions = [_select_frames(read_clip(name, skeleton=skeleton), options.frames) for name in files]
    target.parent.mkdir(parents=True, exist_ok=True)
    document: dict[str, Any] = {"file": str(target)}
    if ending in _FILMS:
        document |= _write_film(motions, target, groups, options)
    else:
        if options.rate is not None:
            motions = [motion.resample(options.rate) for motion in motions]
        document |= {"frames": [motion.n_frames for motion in motions], "rate": motions[0].rate}
        if ending in _FIGURES:
            document |= _write_figure(motions, target, groups, options)
        else:
            if ending == ".bvh":
                write_bvh(motions[0], target, digits=options.digits)
            elif options.like is not None:
                write_amass(motions[0], target, like=options.like)
            else:
                _TABLE_WRITERS[ending](motions[0], target)
            document |= {"up": "as in the file", "unit": "of the file"}
            print_remark(f"{target.name}: unit and axes of {files[0]}")
    print_result(options, "export", document, [target])
    return 0


def _select_frames(motion: Motion, given: Range | None) -> Motion:
    if given is None:
        return motion
    first, last = frame_range(motion, given)
    return motion[first : last + 1]


def _write_figure(
    motions: Sequence[Motion], target: Path, groups: _Groups, options: ExportOptions
) -> dict[str, Any]:
    scale = UNITS[options.scale] if isinstance(options.scale, str) else options.scale
    if target.suffix.lower() == ".glb":
        write_glb(motions, target, scale=scale, groups=groups)
    else:
        write_usd(motions[0], target, scale=scale, groups=groups)
    metres = UNITS[guess_unit(motions[0].skeleton)] if scale is None else scale
    estimated = "" if options.scale is not None else " (estimated from the figure's height)"
    print_remark(f"{target.name}: metres, y up; 1 unit of the file is {metres:g} m{estimated}")
    return {"up": "y", "unit": "m", "metres_in_a_unit": metres}


def _write_film(
    motions: Sequence[Motion], target: Path, groups: _Groups, options: ExportOptions
) -> dict[str, Any]:
    with show_progress() as progress:
        rate = write_video(
            motions,
            target,
            rate=options.rate,
            size=options.size,
            groups=groups,
            dark=options.dark,
            progress=progress,
        )
    width, height = options.size
    print_remark(f"{target.name}: {width} by {height} pixels, {rate:.6g} pictures per second")
    return {"size": [width, height], "rate": rate, "frames": [m.n_frames for m in motions]}
