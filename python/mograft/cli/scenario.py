"""The sequence of base segments that the options of a scenario describe."""

from collections.abc import Sequence

import numpy as np

from mograft._util.arrays import IntArray
from mograft.cli.configuration import flags_in_errors
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.frames import Seconds, resolve_frame
from mograft.cli.syntax.graft_options import DEFAULT_DURATION, GraftOptions
from mograft.library.library import Library
from mograft.scenario import Scenario, fill, follow, to_beats, transitions, walk
from mograft.scenario.walks import check_duration

_GRAPH_OPTIONS = ("duration", "frames", "path", "beats", "among")


def check_scenario(options: GraftOptions) -> None:
    """Raise a UsageError if the options of the scenario contradict each other."""
    scenario = options.scenario
    numbers = [word.strip() for word in scenario.split(",")]
    if scenario not in ("original", "graph") and not all(word.isdecimal() for word in numbers):
        raise UsageError(f"--scenario must be original, graph or segment numbers; got {scenario}")
    if scenario != "original" and options.base is not None:
        raise UsageError("--base cannot be combined with --scenario, which creates the base")
    given = [name for name in _GRAPH_OPTIONS if getattr(options, name) is not None]
    if scenario != "graph" and given:
        raise UsageError(f"--{given[0]} requires --scenario graph")
    lengths = [name for name in given if name in ("duration", "frames", "path")]
    if len(lengths) > 1:
        raise UsageError(f"--{lengths[1]} cannot be combined with --{lengths[0]}")
    if "beats" in given and lengths not in ([], ["duration"]):
        raise UsageError(f"--{lengths[0]} cannot be combined with --beats")


def read_scenario(
    library: Library, options: GraftOptions
) -> Sequence[int] | IntArray | Scenario | None:
    """Return the base segments that ``--scenario`` selects, or None for a captured clip."""
    if options.scenario == "original":
        return None
    if options.scenario != "graph":
        return [int(word) for word in options.scenario.split(",")]
    with flags_in_errors(
        clips="--among", frames="--frames", path="--path", duration="--duration", beats="--beats"
    ):
        return _draw_scenario(library, options)


def _draw_scenario(library: Library, options: GraftOptions) -> Sequence[int] | IntArray | Scenario:
    """Return the base segments of ``--scenario graph``."""
    seed, duration = options.seed or 0, options.duration or DEFAULT_DURATION
    check_duration(duration)
    graph = transitions(library, options.among)
    if options.frames is not None:
        is_time = isinstance(options.frames, Seconds)
        n_frames = resolve_frame(options.frames, library.rate) + is_time
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
