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
    from mograft import evaluation, plot, scenario
    from mograft.analysis.clustering import (
        CompleteLinkage,
        cut,
        linkage,
        linkage_condensed,
        threshold,
    )
    from mograft.analysis.segmentation import Segments, kinetic_energy, segment
    from mograft.blend.foot_planting import FeetReport, plant_feet
    from mograft.body.contacts import foot_skate
    from mograft.body.faults import Fault, find_faults
    from mograft.body.group_entries import subtree
    from mograft.body.groups import JointGroups
    from mograft.body.mirroring import mirror
    from mograft.body.world_poses import Poses
    from mograft.config import Config
    from mograft.errors import (
        BvhError,
        InsufficientDataError,
        LibraryError,
        MograftError,
        SkeletonMismatchError,
    )
    from mograft.io.bvh import BvhSummary, read_bvh, scan_bvh, write_bvh
    from mograft.io.csv import write_csv
    from mograft.io.glb import write_glb
    from mograft.io.npz import read_npz, write_npz
    from mograft.io.pybvh import from_pybvh, to_pybvh
    from mograft.io.usd import write_usd
    from mograft.library.library import Library
    from mograft.motion import resample, rotations
    from mograft.motion.motion import Motion
    from mograft.motion.skeleton import EndSite, Skeleton
    from mograft.search.candidates import Candidate, Candidates
    from mograft.search.constraints import Constraint, Violation
    from mograft.search.donor_constraints import (
        KeepOriginal,
        MaxAngle,
        MaxStretch,
        NotFrom,
        OnlyFrom,
    )
    from mograft.search.obstacles import Box, Capsule, Character, HalfSpace, Sphere
    from mograft.search.pose_constraints import Avoid, AvoidSelf, Custom, Face, KeepOut, Reach
    from mograft.synthesis.graft import Grafts, graft, graft_many, repair
    from mograft.synthesis.graft_result import Graft, Seam, Substitution
    from mograft.synthesis.stream import Stream
    from mograft.viewing.page import Page, view
    from mograft.viewing.report import report_page
    from mograft.viewing.video import write_video

_HOMES = {
    "io.bvh": "BvhSummary read_bvh scan_bvh write_bvh",
    "analysis.clustering": "CompleteLinkage cut linkage linkage_condensed threshold",
    "config": "Config",
    "search.constraints": "Constraint Violation",
    "search.donor_constraints": "KeepOriginal MaxAngle MaxStretch NotFrom OnlyFrom",
    "search.pose_constraints": "Avoid AvoidSelf Custom Face KeepOut Reach",
    "errors": "BvhError InsufficientDataError LibraryError MograftError SkeletonMismatchError",
    "body.faults": "Fault find_faults",
    "body.contacts": "foot_skate",
    "blend.foot_planting": "FeetReport plant_feet",
    "io.glb": "write_glb",
    "io.csv": "write_csv",
    "io.npz": "read_npz write_npz",
    "io.usd": "write_usd",
    "synthesis.graft": "Grafts graft graft_many repair",
    "synthesis.graft_result": "Graft Seam Substitution",
    "body.group_entries": "subtree",
    "body.groups": "JointGroups",
    "io.pybvh": "from_pybvh to_pybvh",
    "library.library": "Library",
    "body.mirroring": "mirror",
    "motion.motion": "Motion",
    "search.obstacles": "Box Capsule Character HalfSpace Sphere",
    "body.world_poses": "Poses",
    "analysis.segmentation": "Segments kinetic_energy segment",
    "motion.skeleton": "EndSite Skeleton",
    "synthesis.stream": "Stream",
    "search.candidates": "Candidate Candidates",
    "viewing.page": "Page view",
    "viewing.report": "report_page",
    "viewing.video": "write_video",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}
_MODULES = {
    "evaluation": "mograft.evaluation",
    "plot": "mograft.plot",
    "resample": "mograft.motion.resample",
    "rotations": "mograft.motion.rotations",
    "scenario": "mograft.scenario",
}

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
            return importlib.import_module(_MODULES[name])
        if name not in _HOME_OF:
            raise AttributeError(f"module 'mograft' has no attribute {name!r}")
        value = getattr(importlib.import_module(f"mograft.{_HOME_OF[name]}"), name)
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
