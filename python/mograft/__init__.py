"""Make new motions out of captured ones by grafting body parts.

The steps: `read_bvh` → `Motion` → `segment` → `Library.build` (embedding,
clustering) → `graft` → `Graft.motion` → `write_bvh`.
"""

# Public names are imported when they are first used, because NumPy takes longer to load than
# `mograft --help` to answer. `__init__.pyi` lists them for type checkers. Nothing else is
# imported here, so that the program handles signals from its first instructions on.
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
    "synthesis.advice": "advise",
    "synthesis.graft": "Grafts graft graft_many repair",
    "synthesis.graft_result": "Graft",
    "synthesis.substitution": "Seam Substitution",
    "provenance.document": "graft_record",
    "provenance.graft_edit": "edit",
    "solve.candidate_verdicts": "candidates",
    "provenance.graft_files": "write_graft",
    "synthesis.graft_request": "GraftRequest",
    "provenance.replay": "replay",
    "solve.self_repair": "RepairedWindow",
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
    "analysis.segmentation": "kinetic_energy segment",
    "motion.segments": "Segments",
    "motion.skeleton": "EndSite Skeleton",
    "stream.stream": "Piece Stream join_pieces",
    "search.candidates": "Candidate Candidates",
    "viewing.page": "Page view",
    "viewing.report": "report_page",
    "viewing.video": "write_video",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}
_MODULES = {
    "dendrogram": "mograft._standalone.mograft_linkage.dendrogram",
    "evaluation": "mograft.evaluation",
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
    importlib.import_module("mograft._util.notebooks").register_view(_show_in_notebook)
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
