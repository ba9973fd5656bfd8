"""Make new, natural motions out of captured ones by grafting body parts.

The way of the data: `read_bvh` → `Motion` → `segment` → `Library.build` (embedding,
clustering) → `graft` → `Graft.motion` → `write_bvh`.
"""

from mograft import resample, rotations
from mograft._core import VERSION as __version__  # noqa: TID251 - the crates hold the version
from mograft.bvh import read_bvh, write_bvh
from mograft.clustering import cut, linkage, linkage_condensed, threshold
from mograft.config import Config
from mograft.errors import BvhError, LibraryError, MograftError, SkeletonMismatchError
from mograft.grafting import Graft, Grafts, Seam, Substitution, graft, graft_many
from mograft.groups import JointGroups, subtree
from mograft.library import Library
from mograft.motion import Motion
from mograft.segmentation import Segments, kinetic_energy, segment
from mograft.skeleton import EndSite, Skeleton
from mograft.substitution import Candidate, Candidates

__all__ = [
    "BvhError",
    "Candidate",
    "Candidates",
    "Config",
    "EndSite",
    "Graft",
    "Grafts",
    "JointGroups",
    "Library",
    "LibraryError",
    "MograftError",
    "Motion",
    "Seam",
    "Segments",
    "Skeleton",
    "SkeletonMismatchError",
    "Substitution",
    "__version__",
    "cut",
    "graft",
    "graft_many",
    "kinetic_energy",
    "linkage",
    "linkage_condensed",
    "read_bvh",
    "resample",
    "rotations",
    "segment",
    "subtree",
    "threshold",
    "write_bvh",
]
