"""Pictures of motions, energies, timelines, clusters and joint groups, drawn by Matplotlib.

Each function draws into the given axes, or into new ones, and returns them. They need the extra
``plot``, and raise an ImportError if matplotlib is not installed.
"""

from mograft.io.export_figure import PALETTE
from mograft.viewing.plot.cluster_plots import clusters, dendrogram, groups, pca
from mograft.viewing.plot.motion_plots import energy, strip, timeline

__all__ = ["PALETTE", "clusters", "dendrogram", "energy", "groups", "pca", "strip", "timeline"]
