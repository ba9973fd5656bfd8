"""Exact complete-linkage clustering in memory linear in the number of points."""

from . import dendrogram
from ._kernels import kernels
from .clustering import cut, linkage, linkage_condensed, threshold
from .estimator import CompleteLinkage

__all__ = [
    "CompleteLinkage",
    "__version__",
    "cut",
    "dendrogram",
    "linkage",
    "linkage_condensed",
    "threshold",
]

__version__: str = kernels.VERSION
