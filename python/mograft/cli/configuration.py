"""The library, joint groups, configuration and constraints that the options of a command select."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

import mograft as mg
from mograft import constraints
from mograft._util.arrays import IntArray
from mograft._util.documents import read_document
from mograft._util.names import automatic_number, is_automatic
from mograft.cli.files import expand_folders, library_folder
from mograft.cli.output import print_remark, show_progress
from mograft.cli.syntax.arguments import Options, UsageError
from mograft.cli.syntax.options import (
    DEFAULT_DURATION,
    ConstraintOptions,
    FieldOptions,
    GraftOptions,
    LibraryOptions,
    SkeletonOptions,
)
from mograft.cli.syntax.values import PRESETS, SHAPES, Range, resolve_frames
from mograft.config import scale_of_variety
from mograft.config_text import parse_fields
from mograft.io.formats import open_clips, read_clip, split_address
from mograft.io.robots.model import read_model
from mograft.library.derive import BUILD_STAGES
from mograft.library.ingest_run import MISMATCH_REMEDY, IngestOptions
from mograft.scenario import Scenario, fill, follow, to_beats, transitions, walk
from mograft.scenario.walks import check_duration
from mograft.search.obstacles import Obstacle

_MAX_EXCLUDED = 3  # clips whose reasons are stated without --verbose

FIXED_OPTIONS = ("groups", "preset", "match", "skeleton", "model", "rate")
"""Options that can only be set when a library is created."""

_GRAPH_OPTIONS = ("duration", "length", "path", "beats", "among")
_CONFLICTS = {
    "only_violations": ("change", "count", "scenario"),
    "scenario": ("base",),
    "duration": ("length", "path"),
    "length": ("path",),
    "beats": ("length", "path"),
}
"""Options that cannot be combined."""

_FIXED_FIELDS = mg.Config.fields_of(*BUILD_STAGES)
"""Fields of `Config` that can only be set when a library is created."""


def refuse_useless_options(options: Options, uses: Mapping[str, Sequence[str]], value: str) -> None:
    """Raise a UsageError if an option on the command line has no effect.

    `value` is the choice on which the effect depends, such as a kind of picture. `uses` maps the
    name of each option to the choices with which it has an effect.
    """
    for name in options.given(*uses):
        if value not in uses[name]:
            raise UsageError(f"--{name} requires {', '.join(uses[name])}; got {value}")


def refuse_fixed_options(options: FieldOptions, *names: str) -> None:
    """Raise a UsageError if the command line sets what is fixed when a library is created.

    `names` are options. Fields of ``--set`` on which segments depend are fixed, too.
    """
    fixed = options.given(*names)
    fixed += [f"set {name}" for name, _ in options.set if name in _FIXED_FIELDS]
    if fixed:
        raise UsageError(
            f"--{fixed[0]} is fixed when a library is created: make another library "
            "with it by mograft index, or give the motion files instead of a library"
        )


def load_library(
    options: LibraryOptions, *, rate: float | None = None, strict: bool = True
) -> mg.Library:
    """Open the library that is given to a command; without one, build it from the motion files.

    The motions of motion files are resampled to `rate` frames per second, if it is given. `strict`
    is that of `Library.build`.
    """
    folder = library_folder(options.files)
    if folder is not None:
        refuse_fixed_options(options, *FIXED_OPTIONS)
        library = mg.Library.open(folder)
        config = _with_options(library.config, options, is_stored=True)
        return library if config == library.config else library.relabelled(config)
    files = expand_folders(options.files, include_grafts=options.include_grafts)
    groups, config = selected_groups(options.groups), selected_config(options)
    skeleton, hierarchy = selected_skeleton(options), None
    if options.match == "anatomy":
        base = _base_address(getattr(options, "base", None), files)
        hierarchy = read_clip(base, skeleton=skeleton).skeleton
    with show_progress() as progress:
        more: IngestOptions = {"match": options.match or "names", "hierarchy": hierarchy}
        more |= {"skeleton": skeleton, "progress": progress}
        clips: Sequence[mg.Motion | str] = files
        if rate is not None:
            clips = [read_clip(file, skeleton=skeleton).resample(rate) for file in files]
        library = mg.Library.build(clips, groups, config, strict=strict, **more)
    for line in describe_excluded(library.refused, options):
        print_remark(line)
    return library


def describe_excluded(excluded: Mapping[str, str], options: Options) -> list[str]:
    """Return the lines that report excluded clips, from the reasons by the address of the clip.

    Without ``--verbose``, these are at most three, and clips of other hierarchies are left out, of
    which the library warns.
    """
    lines = [
        f"excluded: {'' if why.startswith(split_address(address)[0]) else f'{address}: '}{why}"
        for address, why in excluded.items()
        if options.verbose or not why.endswith(MISMATCH_REMEDY)
    ]
    n = len(excluded) - min(len(lines), _MAX_EXCLUDED)
    if options.verbose or not n:
        return lines
    return [*lines[:_MAX_EXCLUDED], f"excluded: {n} other clips; -v states the reasons"]


def _base_address(base: str | None, files: Sequence[str]) -> str:
    """Return the address of the clip that ``--base`` names, by default of the first clip.

    `base` is an address, or the name of a clip or file among the addresses `files`.
    """
    if base is not None and Path(split_address(base)[0]).exists():
        return base
    for address in files:
        path, clip = split_address(address)
        if base in (clip, Path(path).stem, Path(path).name) and base is not None:
            return address
    return files[0]  # the command reports an unknown name


def selected_skeleton(options: SkeletonOptions) -> mg.Skeleton | None:
    """Return the rest pose or the robot that ``--skeleton`` or ``--model`` names, or None."""
    name = options.skeleton
    if options.model is not None:
        if name is not None:
            raise UsageError("--skeleton cannot be combined with --model")
        rates = dict(options.fps) or None
        return read_model(options.model, quaternion=options.quaternion, rate=rates)
    for given in options.given("quaternion", "fps"):
        lack = "frame rate" if given == "fps" else "order of quaternions"
        raise UsageError(
            f"--{given} requires --model, the MJCF or URDF file of a robot: only files of robots, "
            f"which are tables, may have no {lack}"
        )
    return None if name is None else open_clips(name)[0].skeleton


def selected_groups(given: str | None) -> mg.JointGroups | str:
    """Return what ``--groups`` selects: a preset, automatic groups, or the groups of a TOML file.

    A preset is returned as its name, automatic groups as ``auto`` or ``auto:N``.
    """
    name = given or "lower_upper"
    is_file = name not in PRESETS and not is_automatic(name)
    return mg.JointGroups.from_toml(Path(name)) if is_file else name


def figure_settings(
    options: SkeletonOptions, files: Sequence[str]
) -> tuple[mg.JointGroups | str | None, mg.Config, mg.Skeleton | None]:
    """Return the groups for the colours of figures, the configuration, and the rest pose.

    The groups are those of ``--groups``, None if it is not given. Automatic groups are discovered
    in `files`.
    """
    config = selected_config(options) if isinstance(options, FieldOptions) else mg.Config()
    skeleton, given = selected_skeleton(options), getattr(options, "groups", None)
    groups = None if given is None else selected_groups(given)
    if isinstance(groups, str) and is_automatic(groups):
        n = automatic_number(groups)
        found = mg.discover_groups(files, n, config=config, include_grafts=True, skeleton=skeleton)
        groups = found.groups
    return groups, config, skeleton


def selected_config(options: FieldOptions) -> mg.Config:
    """Return the configuration that ``--preset`` selects, with the values of other options."""
    sigma = {"paper": "literal", "paper-rms": "rms"}.get(getattr(options, "preset", None) or "")
    return _with_options(mg.Config.paper(sigma=sigma) if sigma else mg.Config(), options)


def _with_options(
    config: mg.Config, options: FieldOptions, *, is_stored: bool = False
) -> mg.Config:
    """Return a configuration with the values of the options.

    For a stored library, fields of the configuration file on which segments depend are ignored.
    """
    try:
        given, configured = parse_fields(options.set), parse_fields(options.configured)
        if is_stored:
            configured = {k: value for k, value in configured.items() if k not in _FIXED_FIELDS}
        variety = getattr(options, "variety", None)
        if variety is not None:  # of the command line, it replaces a setting
            if "sigma_scale" in (configured if "variety" in options.origins else given):
                raise ValueError("--variety sets sigma_scale: give one of them, not both")
            configured["sigma_scale"] = scale_of_variety(variety)
        fields = configured | given
        path = fields.get("segmentation")
        if isinstance(path, str) and path.endswith(".json"):
            fields["segmentation"] = read_document(Path(path))
        if isinstance(options, ConstraintOptions):
            # A value below a limit is a constraint instead; see `read_constraints`.
            angle = None if options.max_angle is None else math.radians(options.max_angle)
            for name, limit in (("max_stretch", options.max_stretch), ("max_angle", angle)):
                if limit is not None:
                    fields[name] = max(fields.get(name, getattr(config, name)), limit)
        return mg.Config.from_dict(config.as_dict() | fields)
    except (TypeError, ValueError) as error:
        raise UsageError(f"--set: {error}") from None


def read_constraints(options: ConstraintOptions, rate: float) -> list[constraints.Constraint]:
    """Return the constraints that the options describe; `rate` is in frames per second.

    Raise UsageError if an obstacle is invalid.
    """
    found: list[constraints.Constraint] = [*read_obstacles(options.avoid, rate)]
    if options.avoid_self:
        found.append(constraints.AvoidSelf())
    for within, joint, part, place, tolerance in options.reach:
        target = place if part is None else constraints.FigurePosition(part, place)
        frames = resolve_frames(within, rate)
        found.append(constraints.Reach(joint, target, tolerance=tolerance, frames=frames))
    found += [
        constraints.Face(target, frames=resolve_frames(span, rate)) for target, span in options.face
    ]
    found += [constraints.KeepOriginal(frames=span) for span in resolve_frames(options.keep, rate)]
    for kind, given in ((constraints.Use, options.take), (constraints.Ban, options.ban)):
        for (number, span, group), donor in resolve_frames(given, rate):
            found.append(kind(number, donor, frames=span, group=group))
    for selector, clips, tags in (
        (constraints.OnlyFrom, options.only_from, options.only_tagged),
        (constraints.NotFrom, options.not_from, options.not_tagged),
    ):
        if clips is not None or tags is not None:
            found.append(selector(clips or (), tags=tags or ()))
    if options.max_stretch is not None:
        found.append(constraints.MaxStretch(options.max_stretch))
    if options.max_angle is not None:
        found.append(constraints.MaxAngle(math.radians(options.max_angle)))
    return found


def read_obstacles(
    given: Sequence[tuple[str, tuple[float, ...], Range | None]], rate: float
) -> list[constraints.Avoid]:
    """Return the constraints that ``--avoid`` describes; see `read_constraints`."""
    return [
        constraints.Avoid(_read_obstacle(kind, numbers), frames=resolve_frames(span, rate))
        for kind, numbers, span in given
    ]


def _read_obstacle(kind: str, numbers: Sequence[float]) -> Obstacle:
    """Return the obstacle that a value of ``--avoid`` describes.

    `kind` is the name of a shape, such as ``"sphere"``, or the address of a character's motion.
    `numbers` are the dimensions of the shape, or the character's position and yaw in degrees.
    """
    points, rest = [numbers[k : k + 3] for k in range(0, len(numbers) - 2, 3)], numbers[-1]
    if kind not in SHAPES:
        place = (numbers[0], numbers[1], numbers[2])
        return constraints.Character(read_clip(kind), place, math.radians(rest))
    try:  # a shape is made of its points and a radius, if it has one
        return getattr(constraints, SHAPES[kind][0])(*points, *([rest] * (len(numbers) % 3)))
    except ValueError as error:
        text = str(error).replace("`half`", "HX,HY,HZ")
        raise UsageError(f"--avoid {kind}: {text}") from None


def check_combinations(options: GraftOptions) -> None:
    """Raise a UsageError if options for new grafts contradict each other, or files are missing."""
    if not options.files:
        raise UsageError("expected LIB or FILE")
    if records := [name for name in options.files if name.endswith(".json")]:
        raise UsageError(f"{records[0]} is no motion; --from {records[0]} makes a graft again")
    names = options.changed()
    given = [name for name in _GRAPH_OPTIONS if name in names]
    if given and options.scenario != "graph":
        other = ", which makes a base itself: leave --base out" * ("base" in names)
        raise UsageError(f"--{given[0]} requires --scenario graph{other}")
    for name, others in _CONFLICTS.items():
        for other in others:
            if name in names and other in names:
                hint = ", whose clips --among selects" if other == "base" else ""
                raise UsageError(f"--{names[other]} cannot be combined with --{names[name]}{hint}")


def read_scenario(library: mg.Library, options: GraftOptions) -> IntArray | Scenario | None:
    """Return the base segments that ``--scenario`` selects, or None for a captured clip."""
    if options.scenario == "original":
        return None
    seed, duration = options.seed or 0, options.duration or DEFAULT_DURATION
    check_duration(duration)
    graph = transitions(library, options.among)
    if options.length is not None:
        is_time = isinstance(options.length, float)
        n_frames = resolve_frames(options.length, library.rate) + is_time
        return fill(library, n_frames, seed, graph=graph)
    if options.path is not None:
        return follow(library, options.path, graph=graph)
    if options.beats is not None:
        if options.beats > 60.0 * library.rate:
            raise ValueError(
                f"--beats must be at most {60.0 * library.rate:.6g} beats per minute, one per "
                f"frame, got {options.beats:g}"
            )
        beats = np.arange(int(duration * options.beats / 60.0) + 1) * (60.0 / options.beats)
        return to_beats(library, beats, seed, graph=graph)
    return walk(library, duration, seed, graph=graph)
