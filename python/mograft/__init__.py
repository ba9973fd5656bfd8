"""Make new, natural motions out of captured ones by grafting body parts."""

from mograft import resample
from mograft._core import VERSION as __version__  # noqa: TID251 - the crates hold the version
from mograft.anatomy import Anatomy, anatomy, feature_joints
from mograft.body import Body, Foot, body
from mograft.errors import BvhError, LibraryError, MograftError, SkeletonMismatchError
from mograft.groups import JointGroups, subtree
from mograft.motion import Motion
from mograft.skeleton import EndSite, Skeleton

__all__ = [
    "Anatomy",
    "Body",
    "BvhError",
    "EndSite",
    "Foot",
    "JointGroups",
    "LibraryError",
    "MograftError",
    "Motion",
    "Skeleton",
    "SkeletonMismatchError",
    "__version__",
    "anatomy",
    "body",
    "feature_joints",
    "resample",
    "subtree",
]
