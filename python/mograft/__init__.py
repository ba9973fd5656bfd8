"""Make new, natural motions out of captured ones by grafting body parts."""

from mograft import resample
from mograft._core import VERSION as __version__  # noqa: TID251 - the crates hold the version
from mograft.bvh import BvhSummary, read_bvh, scan_bvh, write_bvh
from mograft.errors import BvhError, LibraryError, MograftError, SkeletonMismatchError
from mograft.faults import Fault, find_faults
from mograft.interop import from_pybvh, to_pybvh
from mograft.motion import Motion
from mograft.skeleton import EndSite, Skeleton

__all__ = [
    "BvhError",
    "BvhSummary",
    "EndSite",
    "Fault",
    "LibraryError",
    "MograftError",
    "Motion",
    "Skeleton",
    "SkeletonMismatchError",
    "__version__",
    "find_faults",
    "from_pybvh",
    "read_bvh",
    "resample",
    "scan_bvh",
    "to_pybvh",
    "write_bvh",
]
