"""Measures of grafts: quality, novelty, variety, detectability and balance.

The measures take grafts, or a library of which `evaluate` makes some. Estimates from samples have
the sample size and, if the sample is large enough, a 95 % interval. If the data does not support a
measure, it raises `InsufficientDataError`. No measure is a share of natural motions.
"""

from mograft.evaluation.balance import Balance, dynamic_balance, static_balance
from mograft.evaluation.detectability import Detectability, detectability
from mograft.evaluation.donor_methods import Method, RandomLength, draw_donors, grafts_by
from mograft.evaluation.novelty import Novelty, novelty
from mograft.evaluation.quality import Quality, quality
from mograft.evaluation.robot_checks import feasible_limits, robot_checks
from mograft.evaluation.suite import Evaluation, evaluate
from mograft.evaluation.world_measures import (
    WorldMeasures,
    WorldQuality,
    world_measures,
    world_quality,
)

__all__ = [
    "Balance",
    "Detectability",
    "Evaluation",
    "Method",
    "Novelty",
    "Quality",
    "RandomLength",
    "WorldMeasures",
    "WorldQuality",
    "detectability",
    "draw_donors",
    "dynamic_balance",
    "evaluate",
    "feasible_limits",
    "grafts_by",
    "novelty",
    "quality",
    "robot_checks",
    "static_balance",
    "world_measures",
    "world_quality",
]
