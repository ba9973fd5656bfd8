"""Exact complete linkage in linear memory, independent of motion."""

from mograft._standalone.mograft_linkage import (
    CompleteLinkage,
    cut,
    dendrogram,
    linkage,
    linkage_condensed,
    threshold,
)

__all__ = ["CompleteLinkage", "cut", "dendrogram", "linkage", "linkage_condensed", "threshold"]
