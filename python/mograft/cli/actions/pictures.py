"""``mograft view``, ``plot`` and ``export``: motions as pages, pictures and files."""

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mograft as mg
from mograft._util.atomic import write_bytes
from mograft._util.extras import import_extra
from mograft._util.names import portable_stem, unique_names
from mograft.cli import configuration, files
from mograft.cli.graft_files import open_page
from mograft.cli.output import print_remark, print_result, show_progress
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.commands import ExportOptions, PlotOptions, ViewOptions
from mograft.cli.syntax.values import resolve_frames
from mograft.errors import join_names
from mograft.io.character import open_character
from mograft.io.export_figure import UNITS, guess_unit
from mograft.io.formats import read_clip, split_address
from mograft.io.gltf.document import GltfFile
from mograft.library.discover import is_graft
from mograft.provenance.writing import WRITERS, write_character
from mograft.scenario.bending import bend
from mograft.viewing.page import temporary_path
from mograft.viewing.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_CLUSTER_KINDS = {"pca": mg.plot.pca, "dendrogram": mg.plot.dendrogram}
_KINDS_OF_OPTION: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("clip", "frames"), ("strip", "timeline", "energy")),
    "groups": ("strip", "timeline", *_CLUSTER_KINDS),
    "match": ("timeline", *_CLUSTER_KINDS),
    "group": tuple(_CLUSTER_KINDS),
}
_FIGURES = (".glb", ".usd", ".usda", ".usdc")
_FILMS = (".mp4", ".gif")
_ENDINGS = (*_FIGURES, *_FILMS, ".npz", ".csv", ".bvh")
_ENDINGS_OF_SEVERAL = (".glb", *_FILMS)
_ENDINGS_OF_OPTION = {
    "scale": _FIGURES,
    "groups": (*_FIGURES, *_FILMS),
    **dict.fromkeys(("dark", "renderer", "character"), _FILMS),
    "digits": (".bvh",),
    "like": (".npz",),
    "tracker": (".npz",),
}
_Groups = mg.JointGroups | str | None


def run_view(options: ViewOptions) -> int:
    """Run the command."""
    if options.output is not None:
        files.check_suffix(options.output, ".html", ".htm")
        files.check_writable([options.output], force=options.force, inputs=options.files)
    folder = files.library_folder(options.files, options.clip)
    if folder is None:
        sources = files.expand_folders(options.files)
        groups, config, skeleton = configuration.figure_settings(options, sources)
        scene = Scene.of(sources, groups, config, skeleton)
    else:
        configuration.refuse_fixed_options(options, "groups", "skeleton", "model")
        library = mg.Library.open(folder)
        scene = Scene.of_clips(library, files.select_clips(library, options.clip))
    page = mg.view(scene.with_character(options.character), show=False)
    target = options.output or temporary_path()
    target.parent.mkdir(parents=True, exist_ok=True)
    path = page.save(target, force=True)
    print_result(options, "view/1", {"file": str(path), "title": page.title}, [path])
    if options.output is None or options.open:
        open_page(path)
    return 0


def run_plot(options: PlotOptions) -> int:
    """Run the command."""
    target = options.output
    files.check_suffix(target, ".png", ".svg", ".pdf")
    files.check_writable([target], force=options.force, inputs=options.files)
    mpl = import_extra("matplotlib", "plots need matplotlib", "plot")
    mpl.use("agg")
    metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(target.suffix.lower())
    from matplotlib import pyplot

    with mpl.rc_context(), pyplot.style.context("dark_background" if options.dark else "default"):
        # Without a date and with constant element names, equal input gives equal bytes.
        mpl.rcParams["svg.hashsalt"] = "mograft"
        figure = _draw(options).get_figure(root=True)
        assert figure is not None  # The axes were created with a figure.
        target.parent.mkdir(parents=True, exist_ok=True)
        picture = io.BytesIO()  # Matplotlib and Pillow ignore short writes to files
        try:
            kind = target.suffix.lower().removeprefix(".")
            figure.savefig(picture, dpi=150, metadata=metadata, format=kind)
        finally:
            pyplot.close("all")
        write_bytes(target, picture.getvalue())
    print_result(options, "plot/1", {"file": str(target), "kind": options.kind}, [target])
    return 0


def _draw(options: PlotOptions) -> "Axes":
    configuration.refuse_useless_options(options, _KINDS_OF_OPTION, options.kind)
    folder = files.library_folder(options.files, options.clip)
    if folder is not None:
        configuration.refuse_fixed_options(options, "groups", "match", "skeleton", "model")
    if options.kind in ("strip", "energy"):
        motion, groups, config = _single_motion(options, folder)
        frames = files.frame_range(motion, options.frames)
        if options.kind == "energy":
            return mg.plot.energy(motion, config, frames=frames)
        return mg.plot.strip(motion, options.poses, groups=groups, frames=frames)
    if options.kind == "timeline":
        scene = _timeline_scene(options, folder)
        rate = scene.figures[0].motion.rate
        return mg.plot.timeline(scene, frames=resolve_frames(options.frames, rate))
    library = configuration.load_library(options)
    return _CLUSTER_KINDS[options.kind](library, options.group)


def _timeline_scene(options: PlotOptions, folder: Path | None) -> Scene:
    """Return a scene of the selected clips of a library, or of motion files.

    `folder` is that of a library, or None for motion files. Grafts that have a .json file are shown
    with their donors. The scene shows all other files as clips of one library, with clusters.
    """
    if folder is not None:
        library = configuration.load_library(options)
        return Scene.of_clips(library, files.select_clips(library, options.clip))
    sources = files.expand_folders(options.files)
    grafts = [file for file in sources if is_graft(file)]
    others = tuple(file for file in sources if file not in grafts)
    libraries = [configuration.load_library(replace(options, files=others))] if others else []
    return Scene.of([*libraries, *grafts], skeleton=configuration.selected_skeleton(options))


def _single_motion(
    options: PlotOptions, folder: Path | None
) -> tuple[mg.Motion, _Groups, mg.Config]:
    """Return the only motion that the options select, its joint groups and its configuration.

    `folder` is that of a library, or None for motion files. Raise ValueError if the options select
    several motions.
    """
    groups: _Groups
    if folder is not None:
        library = configuration.load_library(options)
        motions = [library.clips[index] for index in files.select_clips(library, options.clip)]
        names, groups, config = [own.name for own in motions], library.groups, library.config
    else:
        names = files.expand_folders(options.files)
        groups, config, skeleton = configuration.figure_settings(options, names)
        motions = [read_clip(name, skeleton=skeleton) for name in names]
    if len(motions) != 1:
        way = f"give one{' by --clip' * (folder is not None)} of {files.shell_names(names)}"
        raise ValueError(f"{options.kind} shows one motion, got {len(names)}: {way}")
    return motions[0], groups, config


def run_export(options: ExportOptions) -> int:
    """Run the command."""
    sources = files.expand_folders(options.files)
    if options.format is None:
        print_result(options, "export/1", _export(options, sources), [options.output])
        return 0
    if options.output.suffix.lower() in _ENDINGS:
        raise UsageError(
            f"--format needs a folder, got -o {options.output}: for one file leave --format out"
        )
    names = [split_address(own)[1] or Path(own).stem for own in sources]
    stems = unique_names([portable_stem(name) for name in names])
    targets = [options.output / f"{stem}.{options.format}" for stem in stems]
    files.check_writable(targets, force=options.force, inputs=sources)
    documents = [
        _export(replace(options, output=target, files=(source,)), [source])
        for source, target in zip(sources, targets, strict=True)
    ]
    print_result(options, "export/1", {"files": documents}, targets)
    return 0


def _export(options: ExportOptions, sources: Sequence[str]) -> dict[str, Any]:
    """Write one file; return what is in it."""
    target = options.output
    ending = target.suffix.lower()
    if ending == ".fbx":
        raise UsageError("-o cannot be .fbx: write .glb or .bvh and convert it in Blender")
    if ending not in _ENDINGS:
        raise UsageError(
            f"-o must end in {', '.join(_ENDINGS)}, got {target.name}; for a folder with one file "
            "for each motion add --format, such as --format bvh"
        )
    if len(sources) > 1 and ending not in _ENDINGS_OF_SEVERAL:
        raise UsageError(
            f"-o {target.name} can contain only one motion, got {len(sources)}: write "
            f"{' or '.join(_ENDINGS_OF_SEVERAL)}, or one file for each by -o FOLDER --format "
            f"{ending[1:]}, or give one of {files.shell_names(sources)}"
        )
    configuration.refuse_useless_options(options, _ENDINGS_OF_OPTION, ending)
    files.check_writable([target], force=options.force, inputs=sources)
    groups, _, skeleton = configuration.figure_settings(options, sources)
    selected = [_select_frames(read_clip(name, skeleton=skeleton), options) for name in sources]
    motions = [motion for motion, _ in selected]
    target.parent.mkdir(parents=True, exist_ok=True)
    document: dict[str, Any] = {"file": str(target)}
    if options.cycle is not None:
        document["cycles"] = [frames for _, frames in selected]
    if ending in _FILMS:
        document |= _write_film(motions, target, groups, options)
    else:
        if options.rate is not None:
            motions = [motion.resample(options.rate) for motion in motions]
        document |= {"frames": [motion.n_frames for motion in motions], "rate": motions[0].rate}
        if ending in _FIGURES:
            document |= _write_figure(motions, sources, groups, options)
        else:
            if ending == ".bvh":
                mg.write_bvh(motions[0], target, digits=options.digits)
            elif options.tracker is not None:
                if motions[0].skeleton.hinges is None:
                    raise ValueError(
                        "--tracker needs a robot, given by --model (its MJCF or URDF file), and a "
                        f"motion of its joints; got {sources[0]}"
                    )
                mg.formats.write_tracker(motions[0], target, tracker=options.tracker)
            elif options.like is not None:
                mg.formats.write_amass(motions[0], target, like=options.like)
            else:
                WRITERS[ending](motions[0], target)
            document |= {"up": "as in the file", "unit": "of the file"}
            print_remark(f"{target.name}: unit and axes of {sources[0]}")
    return document


def _select_frames(motion: mg.Motion, options: ExportOptions) -> tuple[mg.Motion, tuple[int, int]]:
    """Return what ``--frames``, ``--turn``, ``--avoid`` and ``--cycle`` make of a motion.

    Also return the first and the last of its frames.
    """
    first, last = files.frame_range(motion, options.frames)
    if options.frames is not None:
        motion = motion[first : last + 1]
    avoid = configuration.read_obstacles(options.avoid, motion.rate)
    motion = bend(motion, math.radians(options.turn or 0.0), avoid)
    if options.cycle is None:
        return motion, (first, last)
    seconds = None if isinstance(options.cycle, str) else options.cycle
    motion, (start, stop) = mg.cut_cycle(motion, seconds)
    frames = first + start, first + stop
    print_remark(
        f"{motion.name}: frames {frames[0]}-{frames[1]}, a loop of {motion.duration:.3g} s"
    )
    return motion, frames


def _write_figure(
    motions: Sequence[mg.Motion], sources: Sequence[str], groups: _Groups, options: ExportOptions
) -> dict[str, Any]:
    target = options.output
    paths = list(dict.fromkeys(split_address(file)[0] for file in sources))
    characters = [own for own in map(open_character, map(Path, paths)) if own is not None]
    if characters and target.suffix.lower() == ".glb" and not options.given("scale", "groups"):
        character = characters.pop(0)
        path = character.container.path
        keeps_all = str(path) in options.files and options.rate is None
        keeps_all &= not options.given("frames", "cycle", "turn", "avoid")
        added = [own for own in motions if not (keeps_all and own.path == path)]
        write_character(character, added, target, keeps_animations=keeps_all)
        print_remark(f"{target.name}: meshes and skin of {path}; metres, y up")
        _warn_of_meshes(characters, target)
        return {"up": "y", "unit": "m", "character": str(path)}
    _warn_of_meshes(characters, target)
    scale = UNITS[options.scale] if isinstance(options.scale, str) else options.scale
    if target.suffix.lower() == ".glb":
        mg.formats.write_glb(motions, target, scale=scale, groups=groups)
    else:
        mg.formats.write_usd(motions[0], target, scale=scale, groups=groups)
    metres = UNITS[guess_unit(motions[0].skeleton)] if scale is None else scale
    estimated = "" if options.scale is not None else " (estimated from the figure's height)"
    print_remark(f"{target.name}: metres, y up; 1 unit of the file is {metres:g} m{estimated}")
    return {"up": "y", "unit": "m", "metres_in_a_unit": metres}


def _warn_of_meshes(characters: Sequence[GltfFile], target: Path) -> None:
    if characters:
        names = join_names([str(own.container.path) for own in characters])
        print_remark(f"warning: {target.name} does not have the meshes of {names}")


def _write_film(
    motions: Sequence[mg.Motion], target: Path, groups: _Groups, options: ExportOptions
) -> dict[str, Any]:
    with show_progress() as progress:
        given = {name: getattr(options, name) for name in ("rate", "size", "dark", "character")}
        given |= {"renderer": options.renderer or "capsules", "groups": groups}
        rate = mg.write_video(motions, target, progress=progress, **given)
    width, height = options.size
    print_remark(f"{target.name}: {width} by {height} pixels, {rate:.6g} pictures per second")
    return {"size": [width, height], "rate": rate, "frames": [m.n_frames for m in motions]}
