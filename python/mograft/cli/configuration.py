"""The library, joint groups and configuration that the options of a command select."""

import argparse
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from mograft._util.automatic_groups import automatic_number, is_automatic
from mograft._util.cut_frames import freeze_cut_frames
from mograft.analysis.segmentation import check_segmentation
from mograft.body.groups import JointGroups
from mograft.cli.files import expand_folders, library_folder
from mograft.cli.output import show_progress
from mograft.cli.syntax.options import PRESETS
from mograft.config import Config, variety_fields
from mograft.errors import suggest_name
from mograft.io.addresses import open_clips, read_clip, split_address
from mograft.io.smpl.rest import read_offsets
from mograft.library.group_choice import discover_groups
from mograft.library.library import Library
from mograft.library.spec import Match
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

_CONFIG_OPTIONS = (
    "sigma_scale",
    "neighbourhood",
    "choice",
    "temperature",
    "diversity",
    "seam",
    "alignment",
    "torso",
    "feet",
    "reach_ik",
    "self_repair",
)
"""Options that set the configuration field of the same name."""


def options_given(options: argparse.Namespace, *names: str) -> list[str]:
    """Return those of `names` that are options given on the command line.

    Values from the configuration file or the environment do not count. The default of each option
    in `names` must be None or False.
    """
    given = [name for name in names if name not in options.origins]
    values = {name: getattr(options, name, None) for name in given}
    return [name for name, value in values.items() if value is not None and value is not False]


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
    options: argparse.Namespace, uses: Mapping[str, Sequence[str]], value: str, shown: str
) -> None:
    """End with a usage error if an option on the command line has no effect.

    `value` is the choice on which the effect depends, such as a kind of picture. `uses` maps the
    name of each option to the choices with which it has an effect. The message contains
    `shown` instead of `value`.
    """
    for name in options_given(options, *uses):
        if value not in uses[name]:
            options.usage_error(f"--{name} requires {', '.join(uses[name])}; got {shown}")


def refuse_fixed_options(options: argparse.Namespace, *names: str) -> None:
    """End with a usage error if the command line sets one of the options `names`.

    These options can only be set when a library is created.
    """
    for name in options_given(options, *names):
        options.usage_error(
            f"--{name} is fixed when a library is created: use it with mograft index"
        )


def load_library(options: argparse.Namespace) -> Library:
    """Open the library that is given to a command; without one, build it from the motion files.

    If ``--rate`` is given, the motions of the motion files are resampled to this frame rate.
    """
    rate = getattr(options, "rate", None)
    folder = library_folder(options)
    if folder is not None:
        if rate is not None:
            options.usage_error(
                "--rate is fixed when a library is created: use it with mograft index"
            )
        refuse_fixed_options(options, "groups", "preset", "segmentation", "match", "skeleton")
        library = Library.open(folder)
        config = _with_options(library.config, options)
        return library if config == library.config else library.relabelled(config)
    files = expand_folders(options.files, include_grafts=options.include_grafts)
    groups, config = selected_groups(options), selected_config(options)
    skeleton, hierarchy = selected_skeleton(options), None
    match: Match = getattr(options, "match", None) or "names"
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


def selected_skeleton(options: argparse.Namespace) -> Skeleton | None:
    """Return the rest pose that ``--skeleton`` names, or None."""
    given = getattr(options, "skeleton", None)
    if given is None:
        return None
    path = Path(given)
    if path.suffix.lower() == ".json":
        return read_offsets(path)
    return open_clips(str(path))[0].skeleton


def selected_groups(options: argparse.Namespace) -> JointGroups | str:
    """Return what ``--groups`` selects: a preset, automatic groups, or the groups of a TOML file.

    A preset is returned as its name, automatic groups as ``auto`` or ``auto:N``.
    """
    name: str = options.groups or "lower_upper"
    if name in PRESETS:
        return name
    if is_automatic(name):
        try:
            with flags_in_errors(groups="--groups"):
                automatic_number(name)
        except ValueError as error:
            options.usage_error(str(error))
        return name
    if Path(name).suffix.lower() != ".toml" and not Path(name).exists():
        options.usage_error(
            f"--groups must be a TOML file, auto, auto:N or one of {', '.join(PRESETS)}; got {name}"
            f"{suggest_name(name, PRESETS)}"
        )
    return JointGroups.from_toml(Path(name))


def figure_groups(options: argparse.Namespace, files: Sequence[str]) -> JointGroups | str | None:
    """Return the groups of ``--groups`` for the colours of figures; None if it is not given.

    Automatic groups are discovered in `files`.
    """
    if options.groups is None:
        return None
    groups = selected_groups(options)
    if isinstance(groups, str) and is_automatic(groups):
        found = discover_groups(
            files,
            automatic_number(groups),
            config=selected_config(options),
            include_grafts=True,
            skeleton=selected_skeleton(options),
        )
        return found.groups
    return groups


def selected_config(options: argparse.Namespace) -> Config:
    """Return the configuration that ``--preset`` selects, with the values of other options."""
    is_paper = getattr(options, "preset", None) == "paper"
    config = _with_options(Config.paper() if is_paper else Config(), options)
    return _with_segmentation(config, options)


def _with_segmentation(config: Config, options: argparse.Namespace) -> Config:
    """Return a configuration with the method of segmentation that ``--segmentation`` selects."""
    chosen = getattr(options, "segmentation", None)
    if chosen is None:
        return config
    if isinstance(chosen, Path):
        return replace(config, segmentation=_read_cut_frames(chosen), segmentation_parameters={})
    name, parameters = chosen
    config = replace(config, segmentation=name, segmentation_parameters=parameters)
    try:
        check_segmentation(config)
    except (TypeError, ValueError) as error:
        options.usage_error(f"--segmentation: {error}")
    return config


def _read_cut_frames(path: Path) -> Mapping[str, tuple[int, ...]]:
    """Read the cut frames of each clip from a JSON file; raise ValueError if it is invalid."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(document, dict):
            raise ValueError('expected an object such as {"walk": [12, 40]}')
        return freeze_cut_frames(document)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _with_options(config: Config, options: argparse.Namespace) -> Config:
    """Return a configuration with the values of the options.

    ``--max-stretch`` and ``--max-angle`` raise the limits of the configuration here. A value
    below such a limit is a constraint instead; see `read_constraints`.
    """
    stretch, angle = (getattr(options, name, None) for name in ("max_stretch", "max_angle"))
    if stretch is not None:
        config = replace(config, max_stretch=max(config.max_stretch, stretch))
    if angle is not None:
        config = replace(config, max_angle=max(config.max_angle, math.radians(angle)))
    values = {name: getattr(options, name, None) for name in _CONFIG_OPTIONS}
    given = {name: value for name, value in values.items() if value is not None}
    variety = getattr(options, "variety", None)
    if variety is None:
        return replace(config, **given)
    by_variety = variety_fields(variety)
    for name in by_variety.keys() & given.keys():
        sources = [options.origins.get(own, "the command line") for own in ("variety", name)]
        # An option of the command line replaces both kinds of setting.
        if "the command line" not in sources or sources[0] == sources[1]:
            option = name.replace("_", "-")
            options.usage_error(f"--variety sets --{option}: give one of them, not both")
    is_setting = "variety" in options.origins
    return replace(config, **(by_variety | given if is_setting else given | by_variety))
