"""Make new motions out of captured ones by grafting body parts.

The steps: `read_bvh` → `Motion` → `segment` → `Library.build` (embedding,
clustering) → `graft` → `Graft.motion` → `write_bvh`.
"""

# Public names are imported when they are first used, because NumPy takes longer to load than
# `mograft --help` to answer. For type checkers, `X as X` marks a public name. Nothing is imported
# here, so that the program handles signals from its first instructions on.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from mograft import evaluation as evaluation
    from mograft import plot as plot
    from mograft import scenario as scenario
    from mograft._standalone.mograft_linkage import CompleteLinkage as CompleteLinkage
    from mograft._standalone.mograft_linkage import cut as cut
    from mograft._standalone.mograft_linkage import dendrogram as dendrogram
    from mograft._standalone.mograft_linkage import linkage as linkage
    from mograft._standalone.mograft_linkage import linkage_condensed as linkage_condensed
    from mograft._standalone.mograft_linkage import threshold as threshold
    from mograft.analysis.group_discovery import GroupDiscovery as GroupDiscovery
    from mograft.analysis.segmentation import Segments as Segments
    from mograft.analysis.segmentation import kinetic_energy as kinetic_energy
    from mograft.analysis.segmentation import segment as segment
    from mograft.blend.foot_planting import FeetReport as FeetReport
    from mograft.blend.foot_planting import plant_feet as plant_feet
    from mograft.blend.reach_completion import ReachCompletion as ReachCompletion
    from mograft.body.contacts import foot_skate as foot_skate
    from mograft.body.faults import Fault as Fault
    from mograft.body.faults import find_faults as find_faults
    from mograft.body.group_entries import subtree as subtree
    from mograft.body.groups import JointGroups as JointGroups
    from mograft.body.mirroring import mirror as mirror
    from mograft.body.world_poses import Poses as Poses
    from mograft.config import Config as Config
    from mograft.errors import BvhError as BvhError
    from mograft.errors import FormatError as FormatError
    from mograft.errors import InsufficientDataError as InsufficientDataError
    from mograft.errors import LibraryError as LibraryError
    from mograft.errors import MemoryBudgetError as MemoryBudgetError
    from mograft.errors import MograftError as MograftError
    from mograft.errors import ProvenanceError as ProvenanceError
    from mograft.errors import SkeletonMismatchError as SkeletonMismatchError
    from mograft.io.bvh.reader import BvhSummary as BvhSummary
    from mograft.io.bvh.reader import read_bvh as read_bvh
    from mograft.io.bvh.reader import scan_bvh as scan_bvh
    from mograft.io.bvh.writer import write_bvh as write_bvh
    from mograft.io.clips import Clips as Clips
    from mograft.io.csv import write_csv as write_csv
    from mograft.io.formats import read as read
    from mograft.io.glb import write_glb as write_glb
    from mograft.io.gltf.writer import write_glb_animations as write_glb_animations
    from mograft.io.npz import read_npz as read_npz
    from mograft.io.npz import write_npz as write_npz
    from mograft.io.pybvh import from_pybvh as from_pybvh
    from mograft.io.pybvh import to_pybvh as to_pybvh
    from mograft.io.smpl.rest import read_offsets as read_offsets
    from mograft.io.smpl.writer import write_amass as write_amass
    from mograft.io.usd import write_usd as write_usd
    from mograft.library.group_choice import discover_groups as discover_groups
    from mograft.library.library import Library as Library
    from mograft.motion import resample as resample
    from mograft.motion import rotations as rotations
    from mograft.motion.motion import Motion as Motion
    from mograft.motion.skeleton import EndSite as EndSite
    from mograft.motion.skeleton import Skeleton as Skeleton
    from mograft.search.candidates import Candidate as Candidate
    from mograft.search.candidates import Candidates as Candidates
    from mograft.search.constraints import Constraint as Constraint
    from mograft.search.constraints import Violation as Violation
    from mograft.search.donor_constraints import Ban as Ban
    from mograft.search.donor_constraints import KeepOriginal as KeepOriginal
    from mograft.search.donor_constraints import MaxAngle as MaxAngle
    from mograft.search.donor_constraints import MaxStretch as MaxStretch
    from mograft.search.donor_constraints import NotFrom as NotFrom
    from mograft.search.donor_constraints import OnlyFrom as OnlyFrom
    from mograft.search.donor_constraints import Use as Use
    from mograft.search.obstacles import Box as Box
    from mograft.search.obstacles import Capsule as Capsule
    from mograft.search.obstacles import Character as Character
    from mograft.search.obstacles import HalfSpace as HalfSpace
    from mograft.search.obstacles import Sphere as Sphere
    from mograft.search.pose_constraints import Avoid as Avoid
    from mograft.search.pose_constraints import AvoidSelf as AvoidSelf
    from mograft.search.pose_constraints import Custom as Custom
    from mograft.search.pose_constraints import Face as Face
    from mograft.search.pose_constraints import KeepOut as KeepOut
    from mograft.search.pose_constraints import Reach as Reach
    from mograft.synthesis.graft import Grafts as Grafts
    from mograft.synthesis.graft import graft as graft
    from mograft.synthesis.graft import graft_many as graft_many
    from mograft.synthesis.graft import repair as repair
    from mograft.synthesis.graft_files import write_graft as write_graft
    from mograft.synthesis.graft_request import GraftRequest as GraftRequest
    from mograft.synthesis.graft_result import Graft as Graft
    from mograft.synthesis.graft_result import Seam as Seam
    from mograft.synthesis.graft_result import Substitution as Substitution
    from mograft.synthesis.replay import replay as replay
    from mograft.synthesis.self_repair import RepairedWindow as RepairedWindow
    from mograft.synthesis.stream import Piece as Piece
    from mograft.synthesis.stream import Stream as Stream
    from mograft.synthesis.stream import join_pieces as join_pieces
    from mograft.viewing.page import Page as Page
    from mograft.viewing.page import view as view
    from mograft.viewing.report import report_page as report_page
    from mograft.viewing.video import write_video as write_video

__version__: str

_HOMES = {
    "io.bvh.reader": "BvhSummary read_bvh scan_bvh",
    "io.bvh.writer": "write_bvh",
    "_standalone.mograft_linkage": "CompleteLinkage cut linkage linkage_condensed threshold",
    "config": "Config",
    "search.constraints": "Constraint Violation",
    "search.donor_constraints": "Ban KeepOriginal MaxAngle MaxStretch NotFrom OnlyFrom Use",
    "search.pose_constraints": "Avoid AvoidSelf Custom Face KeepOut Reach",
    "errors": "BvhError FormatError InsufficientDataError LibraryError "
    "MemoryBudgetError MograftError ProvenanceError SkeletonMismatchError",
    "body.faults": "Fault find_faults",
    "body.contacts": "foot_skate",
    "blend.foot_planting": "FeetReport plant_feet",
    "blend.reach_completion": "ReachCompletion",
    "io.glb": "write_glb",
    "io.gltf.writer": "write_glb_animations",
    "io.clips": "Clips",
    "io.csv": "write_csv",
    "io.formats": "read",
    "io.npz": "read_npz write_npz",
    "io.smpl.rest": "read_offsets",
    "io.smpl.writer": "write_amass",
    "io.usd": "write_usd",
    "synthesis.graft": "Grafts graft graft_many repair",
    "synthesis.graft_result": "Graft Seam Substitution",
    "synthesis.graft_files": "write_graft",
    "synthesis.graft_request": "GraftRequest",
    "synthesis.replay": "replay",
    "synthesis.self_repair": "RepairedWindow",
    "body.group_entries": "subtree",
    "body.groups": "JointGroups",
    "io.pybvh": "from_pybvh to_pybvh",
    "analysis.group_discovery": "GroupDiscovery",
    "library.group_choice": "discover_groups",
    "library.library": "Library",
    "body.mirroring": "mirror",
    "motion.motion": "Motion",
    "search.obstacles": "Box Capsule Character HalfSpace Sphere",
    "body.world_poses": "Poses",
    "analysis.segmentation": "Segments kinetic_energy segment",
    "motion.skeleton": "EndSite Skeleton",
    "synthesis.stream": "Piece Stream join_pieces",
    "search.candidates": "Candidate Candidates",
    "viewing.page": "Page view",
    "viewing.report": "report_page",
    "viewing.video": "write_video",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}
_MODULES = {
    "dendrogram": "mograft._standalone.mograft_linkage.dendrogram",
    "evaluation": "mograft.evaluation",
    "plot": "mograft.plot",
    "resample": "mograft.motion.resample",
    "rotations": "mograft.motion.rotations",
    "scenario": "mograft.scenario",
}

if not TYPE_CHECKING:
    __all__ = ["__version__", *_HOME_OF, *_MODULES]

    def __getattr__(name: str) -> object:
        import importlib

        if name == "__version__":
            return importlib.import_module("mograft._core").VERSION
        if name in _MODULES:
            return importlib.import_module(_MODULES[name])
        if name not in _HOME_OF:
            raise AttributeError(f"module 'mograft' has no attribute {name!r}")
        value = getattr(importlib.import_module(f"mograft.{_HOME_OF[name]}"), name)
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
