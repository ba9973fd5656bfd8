"""The inputs of a stream's donor search: the donors of each group, and constraints with costs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

from mograft._util.arrays import FloatArray, IntArray
from mograft.body.anatomy import feature_joints
from mograft.config import Config
from mograft.library.library import Library
from mograft.search.constraints import Clip, Constraint
from mograft.search.costs import CostModel
from mograft.search.donor_choice import cost_model
from mograft.search.donor_constraints import limit_config
from mograft.search.segment_pool import SegmentPool
from mograft.stream.placed_donors import frames_with_neighbours

_MAX_CACHED_DONORS = 4096


@dataclass(frozen=True, eq=False, kw_only=True)
class StreamDonors:
    """The donors of a stream for each grafted group. Made by `StreamDonors.build`."""

    library: Library
    clips: tuple[Clip, ...]  # those of the library, and the base motion as the last one
    joints: Mapping[str, IntArray]  # of each grafted group, parents before children
    compared_joints: Mapping[str, IntArray]  # those whose rotations are compared at seams
    pools: Mapping[str, SegmentPool]
    read_rotations: Callable[[int], FloatArray]  # of a donor, as from `frames_with_neighbours`

    @classmethod
    def build(cls, library: Library, groups: Sequence[str]) -> "StreamDonors":
        """Return the donors of the given groups."""
        joints = {group: library.joints(group) for group in groups}
        return cls(
            library=library,
            clips=(*library.entries, _BaseClip()),
            joints=joints,
            compared_joints={
                group: feature_joints(library.skeleton, members)
                for group, members in joints.items()
            },
            pools={group: library.pool(group) for group in groups},
            read_rotations=lru_cache(_MAX_CACHED_DONORS)(partial(_read_rotations, library)),
        )


@dataclass(frozen=True, eq=False)
class StreamRules:
    """The constraints and cost models of a stream. Made by `StreamRules.build`."""

    constraints: tuple[Constraint, ...]
    config: Config  # of the library, limited by the constraints
    models: Mapping[str, CostModel]  # the cost model of each grafted group

    @classmethod
    def build(cls, donors: StreamDonors, constraints: Sequence[Constraint]) -> "StreamRules":
        """Apply the constraints to the library's configuration, and build the cost models."""
        config = limit_config(donors.library.config, constraints)
        models = {group: cost_model(config, pool) for group, pool in donors.pools.items()}
        return cls(tuple(constraints), config, models)


@dataclass(frozen=True)
class _BaseClip:
    """Name and tags of the base motion, for constraints on the clips of donors."""

    name: str = "the base"
    tags: tuple[str, ...] = ()


def _read_rotations(library: Library, segment: int) -> FloatArray:
    segments = library.segments
    clip = library.clips[segments.clip[segment]]
    start, stop = int(segments.start[segment]), int(segments.stop[segment])
    return frames_with_neighbours(clip.rotations, start, stop)
