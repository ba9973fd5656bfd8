"""`IngestPlan`: the options of `Library.build`, `index` and `add`, checked once, never changed."""

from collections.abc import Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import chain
from typing import TypedDict

from mograft._util.validate import check_type
from mograft.body.groups import JointGroups
from mograft.config import Config
from mograft.errors import suggest_name
from mograft.io.addresses import absolute_address
from mograft.library.clusters import Progress
from mograft.library.discover import (
    ClipSource,
    FoundClip,
    exclude_grafts,
    find_clips,
    matching_values,
)
from mograft.library.ingest import ClipOrder, IngestTask, PendingClip
from mograft.library.spec import MATCHES, Match
from mograft.motion.skeleton import Skeleton


class AddOptions(TypedDict, total=False):
    """Keyword arguments of all of `Library.build`, `index` and `add`, which document them."""

    include_grafts: bool
    frame_rates: Mapping[str, float] | None
    tags: Mapping[str, Iterable[str]] | None
    executor: Executor | None
    progress: Progress | None


class IngestOptions(AddOptions, total=False):
    """Keyword arguments of `Library.build` and `index`; `add` takes those of `AddOptions` only."""

    rate: float | None
    match: Match
    skeleton: Skeleton | None
    hierarchy: Skeleton | None


_OPTION_TYPES: Mapping[str, type] = {
    "skeleton": Skeleton,
    "hierarchy": Skeleton,
    "frame_rates": Mapping,
    "tags": Mapping,
    "executor": Executor,
}
"""Types of the options that may be None."""


@dataclass(frozen=True, eq=False, kw_only=True)
class IngestPlan:
    """The options of a library that is built, as in `Library.build`.

    It passes down unchanged from the methods of `Library` to the ingest of clips and to storage.
    """

    config: Config
    groups: JointGroups | str = "lower_upper"
    strict: bool = True  # whether a clip that is refused ends the run with an error
    is_packed: bool = False  # as for `ingest`
    include_grafts: bool = False
    rate: float | None = None
    match: Match = "names"
    skeleton: Skeleton | None = None  # the rest pose of files that store none
    hierarchy: Skeleton | None = None  # of the library, if clips are matched by anatomy
    frame_rates: Mapping[str, float] | None = None
    tags: Mapping[str, Iterable[str]] | None = None
    executor: Executor | None = None
    progress: Progress | None = None

    def __post_init__(self) -> None:
        if self.match not in MATCHES:
            hint = suggest_name(self.match, MATCHES)
            raise ValueError(f"`match` must be 'names' or 'anatomy', got {self.match!r}{hint}")
        check_type("config", self.config, Config)
        if self.is_packed:
            check_storable(self.config)
        for name, kind in _OPTION_TYPES.items():
            if getattr(self, name) is not None:
                check_type(name, getattr(self, name), kind)
        if self.progress is not None and not callable(self.progress):
            raise TypeError(f"`progress` must be a function, got {type(self.progress).__name__}")
        if self.hierarchy is not None and self.match != "anatomy":
            raise ValueError("`match` must be 'anatomy' if `hierarchy` is given, got 'names'")

    def find_clips(self, sources: ClipSource | Iterable[ClipSource]) -> list[FoundClip]:
        """Find the clips that `sources` stand for.

        Grafts that are found in folders are left out, unless `include_grafts` is true.
        """
        found = find_clips(sources)
        return found if self.include_grafts else exclude_grafts(found)

    def pending(self, order: ClipOrder, found: FoundClip) -> PendingClip:
        """Return a found clip as a clip to ingest, with its tags and the rate of `frame_rates`.

        Raise ValueError if the rate is not above 0.
        """
        rates = matching_values(self.frame_rates, found)
        if rates and not 0 < rates[-1] < float("inf"):
            raise ValueError(
                f"values of `frame_rates` must be above 0 frames per second, got {rates[-1]}"
            )
        source = found.source
        if isinstance(source, str):
            source = absolute_address(source)
        task = IngestTask(source, float(rates[-1]) if rates else None)
        tags = chain(found.folders, *matching_values(self.tags, found))
        return PendingClip(order, lambda: task, tuple(dict.fromkeys(tags)))

    def report(self, stage: str, done: int, total: int) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(stage, done, total)


def check_storable(config: Config) -> None:
    """Raise ValueError if a library with this configuration cannot be stored."""
    if callable(config.segmentation):
        raise ValueError(
            "`segmentation` of a stored library must be 'energy' or the cut frames of each clip, "
            f"got the function {config.segmentation!r}"
        )
