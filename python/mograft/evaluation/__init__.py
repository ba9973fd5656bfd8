"""Measures of grafts: quality, novelty, variety, detectability and balance.

The measures take grafts, or a library of which `evaluate` makes some. Estimates from samples have
the sample size and, if the sample is large enough, a 95 % interval. If the data does not support a
measure, it raises `InsufficientDataError`. No measure is a share of natural motions.
"""

from mograft.body.support_polygon import Support, convex_hull, support_polygons
from mograft.evaluation.balance import (
    Balance,
    BalanceRow,
    BalanceSample,
    balance_row,
    dynamic_balance,
    static_balance,
)
from mograft.evaluation.detectability import Detectability, detectability
from mograft.evaluation.estimate import Estimate
from mograft.evaluation.novelty import Novelty, novelty
from mograft.evaluation.quality import Quality, quality
from mograft.evaluation.suite import Evaluation, evaluate
from mograft.evaluation.two_sample import Detection
from mograft.evaluation.world_measures import WorldMeasures, world_measures
from mograft.evaluation.world_quality import WorldQuality, world_quality

__all__ = [
    "Balance",
    "BalanceRow",
    "BalanceSample",
    "Detectability",
    "Detection",
    "Estimate",
    "Evaluation",
    "Novelty",
    "Quality",
    "Support",
    "WorldMeasures",
    "WorldQuality",
    "balance_row",
    "convex_hull",
    "detectability",
    "dynamic_balance",
    "evaluate",
    "novelty",
    "quality",
    "static_balance",
    "support_polygons",
    "world_measures",
    "world_quality",
]
