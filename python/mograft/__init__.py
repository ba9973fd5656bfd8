"""Make new, natural motions out of captured ones by grafting body parts.

The way of the data: `read_bvh` → `Motion` → `segment` → `Library.build` (embedding,
clustering) → `graft` → `Graft.motion` → `write_bvh`.
"""

import importlib
from typing import TYPE_CHECKING

from mograft._core import VERSION as __version__  # noqa: TID251 - the crates hold the version

# Names are fetched when they are first used: NumPy and what stands on it take longer to load
# than `mograft --help` to answer.
if TYPE_CHECKING:
    from mograft import evaluation, plot, resample, rotations, scenario
    from mograft.bvh import BvhSummary, read_bvh, scan_bvh, write_bvh
    from mograft.clustering import CompleteLinkage, cut, linkage, linkage_condensed, threshold
    from mograft.config import Config
    from mograft.constraints import (
        Avoid,
        AvoidSelf,
        Constraint,
        Custom,
        Face,
        KeepOriginal,
        KeepOut,
        MaxAngle,
        MaxStretch,
        NotFrom,
        OnlyFrom,
        Reach,
        Violation,
    )
    from mograft.contacts import foot_skate
    from mograft.errors import (
        BvhError,
        InsufficientDataError,
        LibraryError,
        MograftError,
        SkeletonMismatchError,
    )
    from mograft.faults import Fault, find_faults
    from mograft.footskate import FeetReport, plant_feet
    from mograft.formats import read_npz, write_csv, write_glb, write_npz, write_usd
    from mograft.grafting import Graft, Grafts, Seam, Substitution, graft, graft_many, repair
    from mograft.groups import JointGroups, subtree
    from mograft.interop import from_pybvh, to_pybvh
    from mograft.library import Library
    from mograft.mirroring import mirror
    from mograft.motion import Motion
    from mograft.obstacles import Box, Capsule, Character, HalfSpace, Sphere
    from mograft.poses import Poses
    from mograft.segmentation import Segments, kinetic_energy, segment
    from mograft.skeleton import EndSite, Skeleton
    from mograft.stream import Stream
    from mograft.substitution import Candidate, Candidates
    from mograft.viewing import Page, report_page, view, write_video

_HOMES = {
    "bvh": "BvhSummary read_bvh scan_bvh write_bvh",
    "clustering": "CompleteLinkage cut linkage linkage_condensed threshold",
    "config": "Config",
    "constraints": "Avoid AvoidSelf Constraint Custom Face KeepOriginal KeepOut MaxAngle "
    "MaxStretch NotFrom OnlyFrom Reach Violation",
    "errors": "BvhError InsufficientDataError LibraryError MograftError SkeletonMismatchError",
    "faults": "Fault find_faults",
    "contacts": "foot_skate",
    "footskate": "FeetReport plant_feet",
    "formats": "read_npz write_csv write_glb write_npz write_usd",
    "grafting": "Graft Grafts Seam Substitution graft graft_many repair",
    "groups": "JointGroups subtree",
    "interop": "from_pybvh to_pybvh",
    "library": "Library",
    "mirroring": "mirror",
    "motion": "Motion",
    "obstacles": "Box Capsule Character HalfSpace Sphere",
    "poses": "Poses",
    "segmentation": "Segments kinetic_energy segment",
    "skeleton": "EndSite Skeleton",
    "stream": "Stream",
    "substitution": "Candidate Candidates",
    "viewing": "Page report_page view write_video",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}
_MODULES = ("evaluation", "plot", "resample", "rotations", "scenario")

__all__ = [
    "Avoid",
    "AvoidSelf",
    "Box",
    "BvhError",
    "BvhSummary",
    "Candidate",
    "Candidates",
    "Capsule",
    "Character",
    "CompleteLinkage",
    "Config",
    "Constraint",
    "Custom",
    "EndSite",
    "Face",
    "Fault",
    "FeetReport",
    "Graft",
    "Grafts",
    "HalfSpace",
    "InsufficientDataError",
    "JointGroups",
    "KeepOriginal",
    "KeepOut",
    "Library",
    "LibraryError",
    "MaxAngle",
    "MaxStretch",
    "MograftError",
    "Motion",
    "NotFrom",
    "OnlyFrom",
    "Page",
    "Poses",
    "Reach",
    "Seam",
    "Segments",
    "Skeleton",
    "SkeletonMismatchError",
    "Sphere",
    "Stream",
    "Substitution",
    "Violation",
    "__version__",
    "cut",
    "evaluation",
    "find_faults",
    "foot_skate",
    "from_pybvh",
    "graft",
    "graft_many",
    "kinetic_energy",
    "linkage",
    "linkage_condensed",
    "mirror",
    "plant_feet",
    "plot",
    "read_bvh",
    "read_npz",
    "repair",
    "report_page",
    "resample",
    "rotations",
    "scan_bvh",
    "scenario",
    "segment",
    "subtree",
    "threshold",
    "to_pybvh",
    "view",
    "write_bvh",
    "write_csv",
    "write_glb",
    "write_npz",
    "write_usd",
    "write_video",
]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name in _MODULES:
            return importlib.import_module(f"mograft.{name}")
        if name not in _HOME_OF:
            raise AttributeError(f"module 'mograft' has no attribute {name!r}")
        value = getattr(importlib.import_module(f"mograft.{_HOME_OF[name]}"), name)
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
