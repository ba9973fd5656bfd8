"""The command line: a thin layer over the public functions.

Results go to stdout, progress and remarks to stderr. Exit codes: 0 done, 1 failed at run
time, 2 usage, 3 invalid input file, 130 interrupted.
"""

import argparse
import json
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mograft import __version__
from mograft.errors import BvhError, MograftError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mograft.config import Config
    from mograft.grafting import Graft
    from mograft.groups import JointGroups
    from mograft.library import Library
    from mograft.motion import Motion

__all__ = ["main"]

PRESETS = (
    "lower_upper",
    "lower_torso_arms",
    "lower_torso_larm_rarm",
    "lower_torso_head_larm_rarm",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        The words after the program's name. Default: those of the process.

    Returns
    -------
    int
        The exit code.
    """
    options = _parser().parse_args(arguments)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = lambda message, *_, **__: _say(f"warning: {message}")
        try:
            code: int = options.run(options)
        except BvhError as error:
            _say(f"error: {error}")
            code = 3
        except (MograftError, OSError, ValueError) as error:
            _say(f"error: {_in_words(error)}")
            code = 1
        except KeyboardInterrupt:
            _say("interrupted")
            code = 130
    return code


def _in_words(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="mograft",
        description="Make new, natural motions out of captured ones by grafting body parts.",
    )
    parser.add_argument("--version", action="version", version=f"mograft {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    demo = commands.add_parser("demo", help="the whole story on the built-in dancer")
    demo.add_argument("-o", "--output", type=Path, default=Path("demo"), help="folder to fill")
    _add_making(demo)
    demo.set_defaults(run=_demo)

    info = commands.add_parser("info", help="joints, rate, length, groups and faults of files")
    info.add_argument("files", nargs="+", metavar="FILE")
    info.add_argument("--json", action="store_true", help="as one JSON document")
    info.set_defaults(run=_info)

    groups = commands.add_parser("groups", help="joint groups of a file, to edit and pass back")
    groups.add_argument("file", metavar="FILE")
    groups.add_argument("--preset", choices=PRESETS, default="lower_upper")
    groups.add_argument("-o", "--output", type=Path, help="TOML file to write; default: stdout")
    groups.add_argument("--force", action="store_true", help="overwrite what is there")
    groups.set_defaults(run=_groups)

    graft = commands.add_parser("graft", help="make new motions on the legs of a captured one")
    graft.add_argument("files", nargs="+", metavar="FILE", help="BVH files: where donors come from")
    graft.add_argument(
        "--base", metavar="FILE", help="whose base group is kept; default: the first"
    )
    graft.add_argument("--groups", default="lower_upper", metavar="NAME|FILE")
    graft.add_argument("--swap", metavar="GROUP,...", help="groups to graft; default: all others")
    graft.add_argument("-n", "--count", type=int, default=1, help="how many motions (default 1)")
    graft.add_argument("-o", "--output", type=Path, required=True, help="folder, or a .bvh file")
    graft.add_argument("--preset", choices=("default", "paper"), default="default")
    graft.add_argument(
        "--sigma-scale",
        type=float,
        metavar="X",
        help="how unlike the legs may be whose upper bodies are exchanged: smaller is more "
        "natural, larger more varied. Default: 0.75, and as much more as COUNT motions need",
    )
    graft.add_argument("--json", action="store_true", help="the reports as one JSON document")
    _add_making(graft)
    graft.set_defaults(run=_graft)
    return parser


def _add_making(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seed", type=int, default=0, help="another seed, another motion")
    parser.add_argument("--force", action="store_true", help="overwrite what is there")


def _demo(options: argparse.Namespace) -> int:
    from mograft.bvh import write_bvh
    from mograft.dancer import dance
    from mograft.grafting import graft_many
    from mograft.library import Library
    from mograft.substitution import combinations

    folder: Path = options.output
    sample = folder / "dance.bvh"
    names = [sample, *(folder / f"dance_graft{i}{end}" for i in range(3) for end in _ENDS)]
    _check_free(names, force=options.force)
    motion = dance(seed=options.seed).motion
    folder.mkdir(parents=True, exist_ok=True)
    write_bvh(motion, sample)
    print(
        f"sample      {sample}: a procedural dancer, {motion.n_joints} joints, "
        f"{motion.n_frames} frames, {motion.duration:.0f} s"
    )
    with _progress() as progress:
        library = Library.build(motion, progress=progress)
    print(f"segments    {len(library.segments)}, cut at the extrema of kinetic energy")
    clusters = ", ".join(f"{labels.max() + 1} of {g}" for g, labels in library.labels.items())
    print(f"clusters    {clusters}: segments whose legs move alike")
    whole = combinations(library.labels[library.groups.base], len(library.groups.names))
    n = len(library.segments)
    print(f"combinations {whole} of legs and upper bodies, {whole / n:.1f} times the {n} captured")
    for graft in graft_many(library, count=3, seed=options.seed):
        path = _write(graft, folder / f"{graft.motion.name}.bvh")
        exchanged = sum(not s.is_own for s in graft.substitutions)
        print(f"graft       {path}: {exchanged} of {len(graft.substitutions)} upper bodies are new")
    print("next:       mograft graft your.bvh -o out/ -n 5")
    return 0


def _info(options: argparse.Namespace) -> int:
    documents = []
    for name in _expanded(options.files):
        document = _describe(name)
        documents.append(document)
        if not options.json:
            print(_description(document))
    if options.json:
        _print_json({"schema": "mograft.info/1", "files": documents})
    return 0


def _describe(name: str) -> dict[str, Any]:
    from mograft.bvh import read_bvh
    from mograft.faults import find_faults
    from mograft.groups import JointGroups

    motion = read_bvh(name)
    skeleton = motion.skeleton
    try:
        members = JointGroups.preset("lower_torso_arms", skeleton).resolve(skeleton)
        groups = {g: [skeleton.names[j] for j in own] for g, own in members.items()}
    except ValueError:
        groups = {}
    return {
        "file": name,
        "joints": motion.n_joints,
        "channels": skeleton.n_channels,
        "frames": motion.n_frames,
        "frame_time": motion.frame_time,
        "rate": motion.rate,
        "seconds": motion.duration,
        "groups": groups,
        "repairs": list(motion.repairs),
        "faults": [fault.message for fault in find_faults(motion)],
    }


def _description(document: dict[str, Any]) -> str:
    lines = [
        f"{document['file']}",
        f"  {document['joints']} joints, {document['channels']} channels (DoF)",
        f"  {document['frames']} frames at {document['rate']:.6g} fps, {document['seconds']:.2f} s",
    ]
    groups = document["groups"]
    lines += [f"  {group}: {' '.join(names)}" for group, names in groups.items()]
    if not groups:
        lines.append("  no groups recognised: see mograft groups and --groups FILE")
    lines += [f"  repaired: {repair}" for repair in document["repairs"]]
    lines += [f"  warning: {fault}" for fault in document["faults"]]
    return "\n".join(lines)


def _groups(options: argparse.Namespace) -> int:
    from mograft.bvh import read_bvh
    from mograft.groups import JointGroups

    text = JointGroups.preset(options.preset, read_bvh(options.file).skeleton).to_toml()
    if options.output is None:
        print(text, end="")
    else:
        _check_free([options.output], force=options.force)
        _write_text(options.output, text)
        print(options.output)
    return 0


def _graft(options: argparse.Namespace) -> int:
    from mograft.grafting import graft_many
    from mograft.library import Library

    files = _expanded(options.files)
    single = options.output.suffix.lower() == ".bvh"
    if single and options.count != 1:
        raise SystemExit(_usage("-o must be a folder where -n is not 1"))
    if options.count < 1:
        raise SystemExit(_usage(f"-n must be 1 or more, got {options.count}"))
    if options.seed < 0:
        raise SystemExit(_usage(f"--seed must be 0 or more, got {options.seed}"))
    stem = Path(options.base or files[0]).stem
    paths = (
        [options.output]
        if single
        else [options.output / f"{stem}_graft{i}.bvh" for i in range(options.count)]
    )
    _check_free([p.with_suffix(e) for p in paths for e in _ENDS], force=options.force)
    groups, config = _chosen_groups(options.groups), _chosen_config(options)
    swap = None if options.swap is None else options.swap.split(",")
    with _progress() as progress:
        library = Library.build(files, groups, config, progress=progress)
    base = _base(library, options.base)
    grafts = list(graft_many(library, base, options.count, swap=swap, seed=options.seed))
    while len(grafts) < options.count and options.sigma_scale is None:
        wider = library.config.sigma_scale * 4 / 3
        if wider > _WIDEST or library.config.sigma not in ("rms", "literal"):
            break
        _say(
            f"only {len(grafts)} different motions at sigma_scale "
            f"{library.config.sigma_scale:.3g}: trying {wider:.3g}, which is less strict"
        )
        library = library.relabelled(replace(library.config, sigma_scale=wider))
        grafts = list(graft_many(library, base, options.count, swap=swap, seed=options.seed))
    paths[0].parent.mkdir(parents=True, exist_ok=True)
    documents = []
    for path, graft in zip(paths, grafts, strict=False):
        _write(graft, path)
        documents.append({"file": str(path), **graft.as_dict()})
        _say(graft.report())
        if not options.json:
            print(path)
    if len(documents) < options.count:
        _say(
            f"warning: the donors allow only {len(documents)} different motions, "
            f"not {options.count}; more clips or a larger --sigma-scale give more"
        )
    if options.json:
        _print_json({"schema": "mograft.grafts/1", "grafts": documents})
    return 0


def _base(library: "Library", name: str | None) -> "Motion | None":
    """Return the clip that was read from a file, else the file's motion."""
    if name is None:
        return None
    from mograft.bvh import read_bvh

    for clip in library.clips:
        if clip.path is not None and os.path.samefile(clip.path, name):
            return clip
    return read_bvh(name)


def _chosen_groups(name: str) -> "JointGroups | str":
    if name in PRESETS:
        return name
    if Path(name).suffix.lower() != ".toml" and not Path(name).exists():
        raise SystemExit(_usage(f"--groups must be a TOML file or {', '.join(PRESETS)}: {name}"))
    from mograft.groups import JointGroups

    return JointGroups.from_toml(Path(name))


def _chosen_config(options: argparse.Namespace) -> "Config":
    from mograft.config import Config

    config = Config.paper() if options.preset == "paper" else Config()
    scale = options.sigma_scale
    return config if scale is None else replace(config, sigma_scale=scale)


def _expanded(names: Iterable[str]) -> list[str]:
    """Put the BVH files of a folder in its place, in order of name."""
    files: list[str] = []
    for name in names:
        if Path(name).is_dir():
            inside = sorted(str(p) for p in Path(name).rglob("*") if p.suffix.lower() == ".bvh")
            if not inside:
                raise ValueError(f"{name}: no BVH file in this folder")
            files += inside
        else:
            files.append(name)
    return files


_ENDS = (".bvh", ".json")

_WIDEST = 4.0
"""Clusters of four times the spread of all segments hold them all: more changes nothing."""


def _check_free(paths: Iterable[Path], *, force: bool) -> None:
    taken = [str(path) for path in paths if path.exists()]
    if taken and not force:
        more = f" and {len(taken) - 1} more" if len(taken) > 1 else ""
        raise FileExistsError(f"{taken[0]}{more} is there already; --force overwrites")


def _write(graft: "Graft", path: Path) -> Path:
    """Write a graft's motion, and beside it where every part comes from."""
    from mograft.bvh import write_bvh

    write_bvh(graft.motion, path)
    document = {"mograft": __version__, **graft.as_dict()}
    _write_text(path.with_suffix(".json"), json.dumps(document, indent=1) + "\n")
    return path


def _write_text(path: Path, text: str) -> None:
    """Write a file so that it is there whole or not at all."""
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        draft.write_text(text, encoding="utf-8")
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def _print_json(document: dict[str, Any]) -> None:
    print(json.dumps(document, indent=1))


def _say(text: str) -> None:
    print(text, file=sys.stderr)


def _usage(text: str) -> int:
    _say(f"mograft: {text}")
    return 2


@contextmanager
def _progress() -> "Iterator[Callable[[str, int, int], None] | None]":
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
