"""Pictures of motions, energies, timelines and clusters, drawn by Matplotlib."""

from mograft.plot.plot import PALETTE, clusters, dendrogram, energy, pca, strip, timeline

__all__ = ["PALETTE", "clusters", "dendrogram", "energy", "pca", "strip", "timeline"]
