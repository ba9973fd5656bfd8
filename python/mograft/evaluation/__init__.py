"""Honest measures: how many motions can be made, how natural, how balanced, how smooth.

Each measure takes a library, or grafts of one, and returns numbers with their sample size and
95 % interval. Where the data cannot support a number it raises `InsufficientDataError`.
"""

from mograft.evaluation.balance import (
    Balance,
    BalanceRow,
    Support,
    convex_hull,
    dynamic_balance,
    static_balance,
    support,
)
from mograft.evaluation.baselines import (
    Analogy,
    ByCost,
    Captured,
    ContactPattern,
    Method,
    Nearest,
    Random,
    RandomLength,
    grafts_by,
    methods,
)
from mograft.evaluation.enrichment import Enrichment, enrichment, moment_laws, sweep
from mograft.evaluation.estimate import Estimate
from mograft.evaluation.naturalness import Compatibility, compatibility
from mograft.evaluation.people import judgement, label_items, label_page, read_labels
from mograft.evaluation.quality import Quality, quality
from mograft.evaluation.report import evaluation_page
from mograft.evaluation.suite import Evaluation, evaluate

__all__ = [
    "Analogy",
    "Balance",
    "BalanceRow",
    "ByCost",
    "Captured",
    "Compatibility",
    "ContactPattern",
    "Enrichment",
    "Estimate",
    "Evaluation",
    "Method",
    "Nearest",
    "Quality",
    "Random",
    "RandomLength",
    "Support",
    "compatibility",
    "convex_hull",
    "dynamic_balance",
    "enrichment",
    "evaluate",
    "evaluation_page",
    "grafts_by",
    "judgement",
    "label_items",
    "label_page",
    "methods",
    "moment_laws",
    "quality",
    "read_labels",
    "static_balance",
    "support",
    "sweep",
]
