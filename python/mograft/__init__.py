"""Make new, natural motions out of captured ones by grafting body parts."""

from mograft import resample
from mograft._core import VERSION as __version__  # noqa: TID251 - the crates hold the version
from mograft.clustering import CompleteLinkage, cut, linkage, linkage_condensed, threshold
from mograft.errors import BvhError, LibraryError, MograftError, SkeletonMismatchError
from mograft.motion import Motion
from mograft.skeleton import EndSite, Skeleton

__all__ = [
    "BvhError",
    "CompleteLinkage",
    "EndSite",
    "LibraryError",
    "MograftError",
    "Motion",
    "Skeleton",
    "SkeletonMismatchError",
    "__version__",
    "cut",
    "linkage",
    "linkage_condensed",
    "resample",
    "threshold",
]
