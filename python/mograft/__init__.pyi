# For type checkers: the public names, which `__init__.py` imports when they are first used.

from mograft import clustering as clustering
from mograft import constraints as constraints
from mograft import datasets as datasets
from mograft import evaluation as evaluation
from mograft import formats as formats
from mograft import scenario as scenario
from mograft.analysis.group_discovery import GroupDiscovery as GroupDiscovery
from mograft.analysis.segmentation import kinetic_energy as kinetic_energy
from mograft.analysis.segmentation import segment as segment
from mograft.blend.cycles import cut_cycle as cut_cycle
from mograft.blend.foot_planting import FeetReport as FeetReport
from mograft.blend.foot_planting import plant_feet as plant_feet
from mograft.blend.reach_completion import ReachCompletion as ReachCompletion
from mograft.body.capsules import Poses as Poses
from mograft.body.contacts import foot_skate as foot_skate
from mograft.body.faults import Fault as Fault
from mograft.body.faults import find_faults as find_faults
from mograft.body.group_entries import subtree as subtree
from mograft.body.groups import JointGroups as JointGroups
from mograft.body.mirroring import mirror as mirror
from mograft.config import Config as Config
from mograft.errors import BvhError as BvhError
from mograft.errors import FormatError as FormatError
from mograft.errors import InsufficientDataError as InsufficientDataError
from mograft.errors import LibraryError as LibraryError
from mograft.errors import MemoryBudgetError as MemoryBudgetError
from mograft.errors import MograftError as MograftError
from mograft.errors import ProvenanceError as ProvenanceError
from mograft.errors import SkeletonMismatchError as SkeletonMismatchError
from mograft.io.bvh.reader import read_bvh as read_bvh
from mograft.io.bvh.writer import write_bvh as write_bvh
from mograft.io.clips import Clips as Clips
from mograft.io.formats import read as read
from mograft.library.build import discover_groups as discover_groups
from mograft.library.library import Library as Library
from mograft.motion import resample as resample
from mograft.motion import rotations as rotations
from mograft.motion.motion import Motion as Motion
from mograft.motion.segments import Segments as Segments
from mograft.motion.skeleton import EndSite as EndSite
from mograft.motion.skeleton import Skeleton as Skeleton
from mograft.provenance.document import graft_record as graft_record
from mograft.provenance.graft_change import change as change
from mograft.provenance.graft_edit import edit as edit
from mograft.provenance.replay import replay as replay
from mograft.provenance.writing import write as write
from mograft.provenance.writing import write_graft as write_graft
from mograft.solve.candidates import Candidate as Candidate
from mograft.solve.candidates import Candidates as Candidates
from mograft.solve.candidates import candidates as candidates
from mograft.stream.stream import Stream as Stream
from mograft.stream.stream import StreamPiece as StreamPiece
from mograft.stream.stream import join_pieces as join_pieces
from mograft.synthesis.advice import advise as advise
from mograft.synthesis.graft import Grafts as Grafts
from mograft.synthesis.graft import graft as graft
from mograft.synthesis.graft import graft_many as graft_many
from mograft.synthesis.graft import repair as repair
from mograft.synthesis.graft_result import Change as Change
from mograft.synthesis.graft_result import Graft as Graft
from mograft.synthesis.graft_result import GraftRequest as GraftRequest
from mograft.synthesis.graft_result import Seam as Seam
from mograft.synthesis.graft_result import Substitution as Substitution
from mograft.synthesis.newness import Newness as Newness
from mograft.synthesis.newness import newness as newness
from mograft.viewing import plot as plot
from mograft.viewing.page import Page as Page
from mograft.viewing.page import view as view
from mograft.viewing.report import report_page as report_page
from mograft.viewing.video import write_video as write_video

__version__: str
__all__: list[str]

def __dir__() -> list[str]: ...
