"""Make new motions out of captured ones by grafting body parts.

The steps: `read_bvh` → `Motion` → `segment` → `Library.build` (embedding,
clustering) → `graft` → `Graft.motion` → `write_bvh`.
"""

# Public names are imported when they are first used, because NumPy takes longer to load than
# `mograft --help` to answer. `__init__.pyi` lists them for type checkers. Nothing else is
# imported here, so that the program handles signals from its first instructions on.
_HOMES = {
    "analysis.group_discovery": "GroupDiscovery",
    "analysis.segmentation": "kinetic_energy segment",
    "blend.cycles": "cut_cycle",
    "blend.foot_planting": "FeetReport plant_feet",
    "blend.reach_completion": "ReachCompletion",
    "body.contacts": "foot_skate",
    "body.faults": "Fault find_faults",
    "body.group_entries": "subtree",
    "body.groups": "JointGroups",
    "body.mirroring": "mirror",
    "body.capsules": "Poses",
    "config": "Config",
    "errors": "BvhError FormatError InsufficientDataError LibraryError "
    "MemoryBudgetError MograftError ProvenanceError SkeletonMismatchError",
    "io.bvh.reader": "read_bvh",
    "io.bvh.writer": "write_bvh",
    "io.clips": "Clips",
    "io.formats": "read",
    "library.build": "discover_groups",
    "library.library": "Library",
    "motion.motion": "Motion",
    "motion.segments": "Segments",
    "motion.skeleton": "EndSite Skeleton",
    "provenance.document": "graft_record",
    "provenance.graft_change": "change",
    "provenance.graft_edit": "edit",
    "provenance.replay": "replay",
    "provenance.writing": "write write_graft",
    "solve.candidates": "Candidate Candidates candidates",
    "stream.stream": "StreamPiece Stream join_pieces",
    "synthesis.advice": "advise",
    "synthesis.graft": "Grafts graft graft_many repair",
    "synthesis.graft_result": "Change Graft GraftRequest Seam Substitution",
    "synthesis.newness": "Newness newness",
    "viewing.page": "Page view",
    "viewing.report": "report_page",
    "viewing.video": "write_video",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}
_MODULES = {
    "clustering": "mograft.clustering",
    "constraints": "mograft.constraints",
    "datasets": "mograft.datasets",
    "evaluation": "mograft.evaluation",
    "formats": "mograft.formats",
    "plot": "mograft.viewing.plot",
    "resample": "mograft.motion.resample",
    "rotations": "mograft.motion.rotations",
    "scenario": "mograft.scenario",
}

__all__ = ["__version__", *_HOME_OF, *_MODULES]


def __getattr__(name: str) -> object:
    import importlib

    if name == "__version__":
        return importlib.import_module("mograft._core").VERSION
    if name in _MODULES:
        return importlib.import_module(_MODULES[name])
    if name not in _HOME_OF:
        raise AttributeError(f"module 'mograft' has no attribute {name!r}")
    importlib.import_module("mograft._util.html_table").register_view(_show_in_notebook)
    value = getattr(importlib.import_module(f"mograft.{_HOME_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def _show_in_notebook(item: object) -> str:
    # The highest layers draw pages; they are imported when the first value is shown.
    import importlib

    html: str = importlib.import_module("mograft.viewing.page").notebook_view(item)
    return html
