"""World-space measures of the grafts of one method."""

from collections.abc import Sequence
from dataclasses import dataclass

from mograft.errors import InsufficientDataError
from mograft.evaluation import estimate
from mograft.evaluation.estimate import Estimate, Record
from mograft.evaluation.novelty import Novelty, novelty
from mograft.evaluation.world_measures import WorldReference
from mograft.synthesis.graft_result import Graft


@dataclass(frozen=True)
class WorldQuality(Record):
    """World-space measures of the grafts of one method; see `WorldMeasures` for each.

    Attributes
    ----------
    method : str
        Name of the method that selected the donors.
    runs : int
        Number of grafts for each base.
    head_jerk, chest_jerk, hands_jerk : Estimate
        Mean over the grafts of the ratio of the jerk to that of base and donors.
    floor_depth, under_floor, skate, balance : Estimate
        Mean over the grafts of the difference from the base. `floor_depth` is in skeleton
        heights, the others are shares.
    novelty : Novelty
        Novelty, coverage and diversity.
    """

    method: str
    runs: int
    head_jerk: Estimate
    chest_jerk: Estimate
    hands_jerk: Estimate
    floor_depth: Estimate
    under_floor: Estimate
    skate: Estimate
    balance: Estimate
    novelty: Novelty


_FIELDS = (
    "head_jerk",
    "chest_jerk",
    "hands_jerk",
    "floor_depth",
    "under_floor",
    "skate",
    "balance",
)


def world_quality(method: str, grafts: Sequence[Sequence[Graft]], seed: int = 0) -> WorldQuality:
    """Measure the grafts of one method by their world positions.

    Parameters
    ----------
    method : str
        Name of the method that selected the donors.
    grafts : sequence of sequence of Graft
        For each base, its grafts; all from one library.
    seed : int
        Seed of the resampling.

    Returns
    -------
    WorldQuality
        Measures for which the skeleton has no known joints are NaN with a sample size of 0. The
        intervals resample grafts, and blocks of five seconds for `WorldQuality.novelty`.

    Raises
    ------
    ImportError
        If SciPy is not installed.
    InsufficientDataError
        If there is no graft, or the clips are too short for `novelty`.
    """
    if not grafts or not all(grafts):
        raise InsufficientDataError("world-space measures need at least one graft on every base")
    reference = WorldReference(grafts[0][0].library)
    measured = [reference.measure(graft) for several in grafts for graft in several]
    samples = {name: [getattr(found, name) for found in measured] for name in _FIELDS}
    return WorldQuality(
        method=method,
        runs=len(grafts[0]),
        novelty=novelty(grafts, seed),
        **{
            name: estimate.block_mean(values, range(len(values)), "grafts", seed)
            for name, values in samples.items()
        },
    )
