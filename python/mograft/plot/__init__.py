"""Pictures of motions, energies, timelines, clusters and joint groups, drawn by Matplotlib.

Each function draws into the given axes, or into new ones, and returns them. They need the extra
``plot``, and raise an ImportError if matplotlib is not installed.
"""

from mograft.io.palette import PALETTE
from mograft.plot.cluster_plots import clusters, dendrogram, pca
from mograft.plot.group_plots import groups
from mograft.plot.pose_strip import strip
from mograft.plot.threshold_plot import threshold
from mograft.plot.time_plots import energy, timeline

__all__ = [
    "PALETTE",
    "clusters",
    "dendrogram",
    "energy",
    "groups",
    "pca",
    "strip",
    "threshold",
    "timeline",
]
