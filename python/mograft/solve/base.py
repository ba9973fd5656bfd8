"""The base of a graft, from the arguments of a user: a motion, its segments, and the groups."""

from collections.abc import Sequence
from dataclasses import dataclass

from mograft._util.arrays import IntArray, as_indices
from mograft.errors import suggest_name
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.scenario import Scenario
from mograft.scenario.realize import realize_scenario


@dataclass(frozen=True, eq=False)
class GraftBase:
    """A base motion, and the library that contains its segments. Made by `GraftBase.find`."""

    library: Library
    motion: Motion
    indices: IntArray  # of the segments in the library
    segments: Segments  # in frames of the motion
    scenario: Scenario | None = None  # if the base is composed of segments

    @classmethod
    def find(
        cls,
        library: Library,
        base: Motion | str | int | None,
        scenario: Sequence[int] | IntArray | Scenario | None = None,
    ) -> "GraftBase":
        """Return the base; the arguments are those of `mograft.graft`.

        `base` may also be the index of a clip.
        """
        if scenario is not None:
            if base is not None:
                raise ValueError(
                    "`base` must not be given together with `scenario`, which replaces it"
                )
            scenario = _as_scenario(scenario, library)
            return cls(library, *_realize(library, scenario), scenario)
        library, clip = (library, base) if isinstance(base, int) else library.resolve_base(base)
        indices = library.segments.of_clip(clip)
        return cls(library, library.clips[clip], indices, library.segments[indices])


def grafted_groups(library: Library, swap: Sequence[str] | None) -> list[str]:
    """Return the groups to graft, in the library's order; None means all but the base group."""
    base = library.groups.base
    others = [name for name in library.groups.names if name != base]
    if isinstance(swap, str):
        raise TypeError(f"`swap` must be a list of groups, got {swap!r}")
    wanted = others if swap is None else list(swap)
    for name in wanted:
        if name not in others:
            raise ValueError(
                f"`swap` must name groups other than the base group {base!r}, got {name!r}: "
                f"choose from {', '.join(others)}{suggest_name(name, others)}"
            )
    if not wanted:
        raise ValueError(f"`swap` must name at least one of {', '.join(others)}; got none")
    return [name for name in others if name in wanted]


def _realize(library: Library, scenario: Scenario) -> tuple[Motion, IntArray, Segments]:
    motion, segments = realize_scenario(library, scenario)
    return motion, scenario.segments, segments


def _as_scenario(scenario: Sequence[int] | IntArray | Scenario, library: Library) -> Scenario:
    """Convert a sequence of segments to a `Scenario`, and check that all segments exist."""
    if not isinstance(scenario, Scenario):
        indices = as_indices("scenario", scenario, ("n",))
        if not len(indices):
            raise ValueError("`scenario` must contain at least one segment, got none")
        scenario = Scenario(indices)
    n = len(library.segments)
    wrong = scenario.segments[(scenario.segments < 0) | (scenario.segments >= n)]
    if len(wrong):
        raise ValueError(f"`scenario` must contain only segments 0 to {n - 1}, got {wrong[0]}")
    return scenario
