"""Measures of grafts: combinations, balance, compatibility, quality and detectability.

The measures take a library, or grafts from one. Estimates from samples have the sample size
and, if the sample is large enough, a 95 % interval. The counts of combinations are exact. If the
data does not support a measure, it raises `InsufficientDataError`. No measure is a share of
natural motions, except for the judgement that a person's labels give.
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
from mograft.evaluation.baselines import (
    Analogy,
    Ball,
    ByCost,
    Captured,
    ContactPattern,
    Method,
    Nearest,
    Random,
    RandomLength,
    default_methods,
    grafts_by,
)
from mograft.evaluation.detectability import Detectability, detectability
from mograft.evaluation.enrichment import Enrichment, enrichment, moment_laws, sweep
from mograft.evaluation.estimate import Estimate
from mograft.evaluation.label_judgement import judgement
from mograft.evaluation.label_table import read_labels
from mograft.evaluation.labelling import label_items, label_page
from mograft.evaluation.naturalness import Compatibility, compatibility
from mograft.evaluation.novelty import Novelty, novelty
from mograft.evaluation.quality import Quality, quality
from mograft.evaluation.retrieval import Advantage, Retrieval, RuleScore, retrieval
from mograft.evaluation.suite import Evaluation, evaluate
from mograft.evaluation.two_sample import Detection
from mograft.evaluation.world_measures import WorldMeasures, world_measures
from mograft.evaluation.world_quality import WorldQuality, world_quality

__all__ = [
    "Advantage",
    "Analogy",
    "Balance",
    "BalanceRow",
    "BalanceSample",
    "Ball",
    "ByCost",
    "Captured",
    "Compatibility",
    "ContactPattern",
    "Detectability",
    "Detection",
    "Enrichment",
    "Estimate",
    "Evaluation",
    "Method",
    "Nearest",
    "Novelty",
    "Quality",
    "Random",
    "RandomLength",
    "Retrieval",
    "RuleScore",
    "Support",
    "WorldMeasures",
    "WorldQuality",
    "balance_row",
    "compatibility",
    "convex_hull",
    "default_methods",
    "detectability",
    "dynamic_balance",
    "enrichment",
    "evaluate",
    "grafts_by",
    "judgement",
    "label_items",
    "label_page",
    "moment_laws",
    "novelty",
    "quality",
    "read_labels",
    "retrieval",
    "static_balance",
    "support_polygons",
    "sweep",
    "world_measures",
    "world_quality",
]
