"""Make new, natural motions out of captured ones by grafting body parts.

The way of the data: `read_bvh` → `Motion` → `segment` → `Library.build` (embedding,
clustering) → `graft` → `Graft.motion` → `write_bvh`.
"""

from mograft import resample, rotations
from mograft._core import VERSION as __version__  # noqa: TID251 - the crates hold the version
from mograft.bvh import BvhSummary, read_bvh, scan_bvh, write_bvh
from mograft.clustering import CompleteLinkage, cut, linkage, linkage_condensed, threshold
from mograft.config import Config
from mograft.errors import BvhError, LibraryError, MograftError, SkeletonMismatchError
from mograft.faults import Fault, find_faults
from mograft.grafting import Graft, Grafts, Seam, Substitution, graft, graft_many
from mograft.groups import JointGroups, subtree
from mograft.interop import from_pybvh, to_pybvh
from mograft.library import Library
from mograft.motion import Motion
from mograft.segmentation import Segments, kinetic_energy, segment
from mograft.skeleton import EndSite, Skeleton
from mograft.substitution import Candidate, Candidates
from mograft.viewing import Page, view

__all__ = [
    "BvhError",
    "BvhSummary",
    "Candidate",
    "Candidates",
    "CompleteLinkage",
    "Config",
    "EndSite",
    "Fault",
    "Graft",
    "Grafts",
    "JointGroups",
    "Library",
    "LibraryError",
    "MograftError",
    "Motion",
    "Page",
    "Seam",
    "Segments",
    "Skeleton",
    "SkeletonMismatchError",
    "Substitution",
    "__version__",
    "cut",
    "find_faults",
    "from_pybvh",
    "graft",
    "graft_many",
    "kinetic_energy",
    "linkage",
    "linkage_condensed",
    "read_bvh",
    "resample",
    "rotations",
    "scan_bvh",
    "segment",
    "subtree",
    "threshold",
    "to_pybvh",
    "view",
    "write_bvh",
]
