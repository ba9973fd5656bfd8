"""The library, joint groups and configuration that the options of a command select."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mograft._util.names import automatic_number, is_automatic
from mograft._util.validate import freeze_cut_frames
from mograft.body.groups import JointGroups
from mograft.cli.files import expand_folders, library_folder
from mograft.cli.output import show_progress
from mograft.cli.syntax.arguments import Options, UsageError
from mograft.cli.syntax.options import PRESETS, ConstraintOptions, FieldOptions, LibraryOptions
from mograft.config import Config, scale_of_variety
from mograft.config_text import parse_fields
from mograft.errors import suggest_name
from mograft.io.addresses import open_clips, read_clip, split_address
from mograft.io.smpl.rest import read_offsets
from mograft.library.build import discover_groups
from mograft.library.derive import BUILD_STAGES
from mograft.library.library import Library
from mograft.library.spec import Match
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

FIXED_OPTIONS = ("groups", "preset", "match", "skeleton")
"""Options that can only be set when a library is created."""

_FIXED_FIELDS = Config.fields_of(*BUILD_STAGES)
"""Fields of `Config` that can only be set when a library is created."""


@contextmanager
def flags_in_errors(**flags: str) -> Iterator[None]:
    """Replace names of parameters by flags in the messages of ValueErrors of the ``with`` block.

    For example, ``clips="--among"`` replaces `` `clips` `` by ``--among``.
    """
    try:
        yield
    except ValueError as error:
        if type(error) is not ValueError:
            raise
        raise ValueError(with_flags(str(error), flags)) from error


def with_flags(text: str, flags: Mapping[str, str]) -> str:
    """Return a text in which each quoted name of a parameter is replaced by a flag."""
    for name, flag in flags.items():
        text = text.replace(f"`{name}`", flag)
    return text


def refuse_useless_options(
    options: Options, uses: Mapping[str, Sequence[str]], value: str, shown: str
) -> None:
    """Raise a UsageError if an option on the command line has no effect.

    `value` is the choice on which the effect depends, such as a kind of picture. `uses` maps the
    name of each option to the choices with which it has an effect. The message contains
    `shown` instead of `value`.
    """
    for name in options.given(*uses):
        if value not in uses[name]:
            raise UsageError(f"--{name} requires {', '.join(uses[name])}; got {shown}")


def refuse_fixed_options(options: Options, *names: str) -> None:
    """Raise a UsageError if the command line sets what is fixed when a library is created.

    `names` are options. Fields of ``--set`` on which segments depend are fixed, too.
    """
    fixed = [f"--{name.replace('_', '-')}" for name in options.given(*names)]
    if isinstance(options, FieldOptions):
        fixed += [f"--set {name}" for name, _ in options.set if name in _FIXED_FIELDS]
    if fixed:
        raise UsageError(
            f"{fixed[0]} is fixed when a library is created: use it with mograft index, not --add"
        )


def load_library(options: LibraryOptions, *, rate: float | None = None) -> Library:
    """Open the library that is given to a command; without one, build it from the motion files.

    The motions of motion files are resampled to `rate` frames per second, if it is given.
    """
    folder = library_folder(options.files)
    if folder is not None:
        if rate is not None:
            refuse_fixed_options(options, "rate")
        refuse_fixed_options(options, *FIXED_OPTIONS)
        library = Library.open(folder)
        config = _with_options(library.config, options, is_stored=True)
        return library if config == library.config else library.relabelled(config)
    files = expand_folders(options.files, include_grafts=options.include_grafts)
    groups, config = selected_groups(options.groups), selected_config(options)
    skeleton, hierarchy = selected_skeleton(options.skeleton), None
    match: Match = "anatomy" if options.match == "anatomy" else "names"
    if match == "anatomy":
        base = _base_address(getattr(options, "base", None), files)
        hierarchy = read_clip(base, skeleton=skeleton).skeleton
    with show_progress() as progress:
        clips: Sequence[Motion | str] = files
        if rate is not None:
            clips = [read_clip(file, skeleton=skeleton).resample(rate) for file in files]
        return Library.build(
            clips,
            groups,
            config,
            match=match,
            hierarchy=hierarchy,
            skeleton=skeleton,
            progress=progress,
        )


def _base_address(base: str | None, files: Sequence[str]) -> str:
    """Return the address of the clip that ``--base`` names, by default of the first clip.

    `base` is an address, or the name of a clip or file among the addresses `files`.
    """
    if base is None:
        return files[0]
    if Path(split_address(base)[0]).exists():
        return base
    for address in files:
        path, clip = split_address(address)
        if base in (clip, Path(path).stem, Path(path).name):
            return address
    return files[0]  # the command reports the unknown name


def selected_skeleton(name: str | None) -> Skeleton | None:
    """Return the rest pose that ``--skeleton`` names, or None."""
    if name is None:
        return None
    if Path(name).suffix.lower() == ".json":
        return read_offsets(Path(name))
    return open_clips(name)[0].skeleton


def selected_groups(given: str | None) -> JointGroups | str:
    """Return what ``--groups`` selects: a preset, automatic groups, or the groups of a TOML file.

    A preset is returned as its name, automatic groups as ``auto`` or ``auto:N``.
    """
    name = given or "lower_upper"
    if name in PRESETS:
        return name
    if is_automatic(name):
        try:
            automatic_number(name)
        except ValueError as error:
            raise UsageError(with_flags(str(error), {"groups": "--groups"})) from None
        return name
    if Path(name).suffix.lower() != ".toml" and not Path(name).exists():
        raise UsageError(
            f"--groups must be a TOML file, auto, auto:N or one of {', '.join(PRESETS)}; got {name}"
            f"{suggest_name(name, PRESETS)}"
        )
    return JointGroups.from_toml(Path(name))


def figure_groups(
    given: str | None, files: Sequence[str], config: Config, skeleton: Skeleton | None
) -> JointGroups | str | None:
    """Return the groups of ``--groups`` for the colours of figures; None if it is not given.

    Automatic groups are discovered in `files`.
    """
    groups = None if given is None else selected_groups(given)
    if isinstance(groups, str) and is_automatic(groups):
        number = automatic_number(groups)
        return discover_groups(
            files, number, config=config, include_grafts=True, skeleton=skeleton
        ).groups
    return groups


def selected_config(options: FieldOptions) -> Config:
    """Return the configuration that ``--preset`` selects, with the values of other options."""
    is_paper = getattr(options, "preset", None) == "paper"
    return _with_options(Config.paper() if is_paper else Config(), options)


def _with_options(config: Config, options: FieldOptions, *, is_stored: bool = False) -> Config:
    """Return a configuration with the values of the options.

    For a stored library, fields of the configuration file on which segments depend are ignored.
    """
    try:
        given, configured = parse_fields(options.set), parse_fields(options.configured)
        if is_stored:
            configured = {k: value for k, value in configured.items() if k not in _FIXED_FIELDS}
        fields = _with_variety(configured, given, options)
        if isinstance(fields.get("segmentation"), str) and fields["segmentation"].endswith(".json"):
            fields["segmentation"] = _read_cut_frames(Path(fields["segmentation"]))
        if isinstance(options, ConstraintOptions):
            fields = _with_limits(config, fields, options)
        return Config.from_dict(config.as_dict() | fields)
    except (TypeError, ValueError) as error:
        raise UsageError(f"--set: {error}") from None


def _with_variety(
    configured: dict[str, Any], given: dict[str, Any], options: FieldOptions
) -> dict[str, Any]:
    """Return the fields of ``--set`` and ``--variety``; the command line replaces settings."""
    variety = getattr(options, "variety", None)
    if variety is None:
        return configured | given
    by_variety = {"sigma_scale": scale_of_variety(variety)}
    is_setting = "variety" in options.origins
    if by_variety.keys() & (configured if is_setting else given).keys():
        raise ValueError("--variety sets sigma_scale: give one of them, not both")
    return configured | by_variety | given


def _with_limits(
    config: Config, fields: dict[str, Any], options: ConstraintOptions
) -> dict[str, Any]:
    """Return fields of which ``--max-stretch`` and ``--max-angle`` raise the limits.

    A value below such a limit is a constraint instead; see `read_constraints`.
    """
    limits = {"max_stretch": options.max_stretch}
    limits["max_angle"] = None if options.max_angle is None else math.radians(options.max_angle)
    present = {name: fields.get(name, getattr(config, name)) for name in limits}
    raised = {k: max(present[k], limit) for k, limit in limits.items() if limit is not None}
    return fields | raised


def _read_cut_frames(path: Path) -> Mapping[str, tuple[int, ...]]:
    """Read the cut frames of each clip from a JSON file; raise ValueError if it is invalid."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(document, dict):
            raise ValueError('expected an object such as {"walk": [12, 40]}')
        return freeze_cut_frames(document)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
