"""Pictures of motions, energies, timelines and clusters, drawn by Matplotlib.

Each function draws into the given axes, or into new ones, and returns them. They need the extra
``plot``, and raise an ImportError if matplotlib is not installed.
"""

from mograft.io.export_figure import PALETTE
from mograft.viewing.plot.cluster_plots import dendrogram, pca
from mograft.viewing.plot.motion_plots import energy, strip, timeline

__all__ = ["PALETTE", "dendrogram", "energy", "pca", "strip", "timeline"]
