"""The sequence of base segments that the options of a scenario describe."""

import argparse
from collections.abc import Sequence

import numpy as np

from mograft._util.arrays import IntArray
from mograft.cli.configuration import flags_in_errors
from mograft.cli.syntax.frame_times import Seconds, resolve_frame
from mograft.cli.syntax.options import DEFAULT_DURATION
from mograft.library.library import Library
from mograft.scenario import Scenario, fill, follow, to_beats, transitions, walk
from mograft.scenario.walks import check_duration

_GRAPH_OPTIONS = ("duration", "frames", "path", "beats", "among")


def check_scenario(options: argparse.Namespace) -> None:
    """End with a usage error if the options of the scenario contradict each other."""
    scenario: str = options.scenario
    numbers = [word.strip() for word in scenario.split(",")]
    if scenario not in ("original", "graph") and not all(word.isdecimal() for word in numbers):
        options.usage_error(
            f"--scenario must be original, graph or segment numbers; got {scenario}"
        )
    if scenario != "original" and options.base is not None:
        options.usage_error("--base cannot be combined with --scenario, which creates the base")
    given = [name for name in _GRAPH_OPTIONS if getattr(options, name) is not None]
    if scenario != "graph" and given:
        options.usage_error(f"--{given[0]} requires --scenario graph")
    lengths = [name for name in given if name in ("duration", "frames", "path")]
    if len(lengths) > 1:
        options.usage_error(f"--{lengths[1]} cannot be combined with --{lengths[0]}")
    if "beats" in given and lengths not in ([], ["duration"]):
        options.usage_error(f"--{lengths[0]} cannot be combined with --beats")


def read_scenario(
    library: Library, options: argparse.Namespace
) -> Sequence[int] | IntArray | Scenario | None:
    """Return the base segments that ``--scenario`` selects, or None for a captured clip."""
    if options.scenario == "original":
        return None
    if options.scenario != "graph":
        return [int(word) for word in options.scenario.split(",")]
    with flags_in_errors(clips="--among", frames="--frames", path="--path", duration="--duration"):
        return _draw_scenario(library, options)


def _draw_scenario(
    library: Library, options: argparse.Namespace
) -> Sequence[int] | IntArray | Scenario:
    """Return the base segments of ``--scenario graph``."""
    seed, duration = options.seed or 0, options.duration or DEFAULT_DURATION
    check_duration(duration)
    graph = transitions(library, options.among and options.among.split(","))
    if options.frames is not None:
        is_time = isinstance(options.frames, Seconds)
        n_frames = resolve_frame(options.frames, library.rate) + is_time
        return fill(library, n_frames, seed, graph=graph)
    if options.path is not None:
        return follow(library, options.path, graph=graph)
    if options.beats is not None:
        period = 60.0 / options.beats
        if period < 1.0 / library.rate:
            raise ValueError(
                f"--beats must be at most {60.0 * library.rate:.6g} beats per minute, "
                f"one per frame, got {options.beats:g}"
            )
        n_beats = int(duration * options.beats / 60.0) + 1
        if n_beats < 2:
            raise ValueError(
                f"--duration must be at least {period:.6g} s, the time between two beats, "
                f"got {duration:g}"
            )
        return to_beats(library, np.arange(n_beats) * period, seed, graph=graph)
    return walk(library, duration, seed, graph=graph)
