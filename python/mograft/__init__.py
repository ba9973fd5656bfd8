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
    from mograft import plot, resample, rotations
    from mograft.bvh import BvhSummary, read_bvh, scan_bvh, write_bvh
    from mograft.clustering import cut, linkage, linkage_condensed, threshold
    from mograft.config import Config
    from mograft.errors import BvhError, LibraryError, MograftError, SkeletonMismatchError
    from mograft.faults import Fault, find_faults
    from mograft.formats import read_npz, write_csv, write_glb, write_npz
    from mograft.grafting import Graft, Grafts, Seam, Substitution, graft, graft_many
    from mograft.groups import JointGroups, subtree
    from mograft.interop import from_pybvh, to_pybvh
    from mograft.library import Library
    from mograft.motion import Motion
    from mograft.segmentation import Segments, kinetic_energy, segment
    from mograft.skeleton import EndSite, Skeleton
    from mograft.substitution import Candidate, Candidates
    from mograft.viewing import Page, report_page, view

_HOMES = {
    "bvh": "BvhSummary read_bvh scan_bvh write_bvh",
    "clustering": "cut linkage linkage_condensed threshold",
    "config": "Config",
    "errors": "BvhError LibraryError MograftError SkeletonMismatchError",
    "faults": "Fault find_faults",
    "formats": "read_npz write_csv write_glb write_npz",
    "grafting": "Graft Grafts Seam Substitution graft graft_many",
    "groups": "JointGroups subtree",
    "interop": "from_pybvh to_pybvh",
    "library": "Library",
    "motion": "Motion",
    "segmentation": "Segments kinetic_energy segment",
    "skeleton": "EndSite Skeleton",
    "substitution": "Candidate Candidates",
    "viewing": "Page report_page view",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}
_MODULES = ("plot", "resample", "rotations")

__all__ = [
    "BvhError",
    "BvhSummary",
    "Candidate",
    "Candidates",
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
    "plot",
    "read_bvh",
    "read_npz",
    "report_page",
    "resample",
    "rotations",
    "scan_bvh",
    "segment",
    "subtree",
    "threshold",
    "to_pybvh",
    "view",
    "write_bvh",
    "write_csv",
    "write_glb",
    "write_npz",
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
