"""The provenance of a graft as a JSON document."""

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from mograft.blend.reach_completion import ReachCompletion
from mograft.library import origin
from mograft.library.clip_table import skeleton_to_json
from mograft.library.discover import SourceFile, relative_path
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.scenario import repetition
from mograft.search.constraint_records import constraint_kind, encode_constraint
from mograft.search.constraints import Constraint, Violation
from mograft.search.trellis import DonorSequences
from mograft.solve.self_repair import RepairedWindow
from mograft.synthesis.advice import advise
from mograft.synthesis.graft_result import Graft, Substitution, find_missing

Record = dict[str, Any]

SCHEMA = "mograft.graft/2"
_LICENCE_TAGS = ("licence:", "license:")
"""How a tag starts that gives the licence of a clip."""


def graft_record(graft: Graft, folder: str | PathLike[str] = ".") -> Record:
    """Return the provenance of a graft as a JSON document, from which `replay` remakes it.

    docs/formats.md describes the keys.

    Parameters
    ----------
    graft : Graft
        The graft.
    folder : path
        The folder to which paths of files are relative: that of the document.
    """
    library, place, request = graft.library, Path(folder), graft.request
    return {
        "schema": SCHEMA,
        "name": graft.motion.name,
        "base": graft.base.name,
        "seed": graft.seed,
        "index": graft.index,
        "frames": graft.motion.n_frames,
        "frame_time": graft.motion.frame_time,
        "poses_sha256": origin.hash_poses(graft.motion),
        "request": _request_record(graft, place),
        "config": library.config.as_dict(),
        "groups": {
            name: [library.skeleton.names[j] for j in library.joints(name)]
            for name in library.groups.names
        },
        "groups_toml": library.groups.to_toml(),
        "base_group": library.groups.base,
        "library": _library_record(library, place),
        "clips": _clip_records(graft, place),
        "scenario": _scenario_record(graft),
        "repetition": _repetition_record(graft),
        "substitutions": [
            {**substitution_record(own), "alternatives": n}
            for own, n in zip(graft.substitutions, _flat(graft.alternatives), strict=True)
        ],
        "edits": [
            {"command": command, "replaced": replaced, "reach_ik": _completions(graft, found)}
            for command, replaced, found in zip(
                request.edit_commands,
                _replaced_donors(graft),
                graft.completion_history,
                strict=True,
            )
        ],
        "changes": [
            vars(own) | {"frames": list(own.frames), "clip_frames": list(own.clip_frames)}
            for own in graft.changes
        ],
        "seams": [
            {"group": s.group, "frame": s.frame, "gap_degrees": round(np.degrees(s.gap), 4)}
            for s in graft.seams
        ],
        "violations": [violation_record(own, request.constraints) for own in graft.violations],
        "self_repair": [_repair_record(own) for own in graft.self_repairs],
        "feet": None if graft.feet is None else asdict(graft.feet),
        "reach_ik": _completions(graft, graft.reach_completions),
        "kept_without_candidate": {
            name: int(find_missing(graft, name).sum()) for name in graft.alternatives
        },
        "remarks": advise(graft),
    }


def move_record(record: Any, old: Path, new: Path, key: str = "") -> Any:  # noqa: ANN401 - of JSON
    """Return a record, or a part of it, with its paths relative to the folder `new`, not `old`."""
    if isinstance(record, dict):
        return {name: move_record(value, old, new, name) for name, value in record.items()}
    if isinstance(record, list):
        return [move_record(value, old, new) for value in record]
    is_path = key in ("file", "folder") and isinstance(record, str)
    return relative_path(str(old / record), new).as_posix() if is_path else record


def _request_record(graft: Graft, folder: Path) -> Record:
    request = graft.request

    def encode_motion(motion: Motion) -> Record:
        return {"name": motion.name, **_file_record(origin.find_source_file(motion), folder)}

    return {
        "method": request.method,
        "command": request.command,
        "sources": list(request.sources),
        "base": request.base,
        "swap": None if request.swap is None else list(request.swap),
        "constraints": [encode_constraint(own, encode_motion) for own in request.constraints],
    }


def _library_record(library: Library, folder: Path) -> Record:
    recorded = origin.find_library_origin(library)
    path, skeletons = recorded.folder, {"hierarchy": recorded.hierarchy, "rest": recorded.rest}
    return {
        "folder": None if path is None else relative_path(str(path), folder).as_posix(),
        "sha256": recorded.sha256,
        "clips": recorded.n_clips,
        **{key: getattr(recorded, key) for key in ("is_mirrored", "rate", "root", "up", "match")},
        **{key: own and skeleton_to_json(own) for key, own in skeletons.items()},
    }


def _clip_records(graft: Graft, folder: Path) -> list[Record]:
    """Return the clips of which the graft is made, in the order of the library."""
    library, clip_of = graft.library, graft.library.segments.clip
    segments = {
        "base": [own.segment for own in graft.substitutions],
        "donor": [own for version in (*graft.history, graft.donors) for own in _flat(version)],
    }
    roles = {role: set(clip_of[own].tolist()) for role, own in segments.items()}
    roles["donor"] |= {library.names.index(own.clip) for own in graft.changes}
    records = []
    for clip in sorted(set.union(*roles.values())):
        info, found = library.entries[clip], origin.find_clip_origin(library, clip)
        records.append(
            {
                "name": info.name,
                **_file_record(found.source_file, folder),
                "roles": [role for role, clips in roles.items() if clip in clips],
                "is_mirrored": found.is_mirrored,
                "is_in_library": found.is_in_library,
                "true_rate": info.rate_override,
                "licence": _licence(info.tags),
            }
        )
    return records


def _file_record(file: SourceFile | None, folder: Path) -> Record:
    if file is None:
        return {"file": None, "clip": None, "sha256": None}
    path = relative_path(file.path, folder).as_posix()
    return {"file": path, "clip": file.clip, "sha256": file.sha256}


def _licence(tags: Iterable[str]) -> str | None:
    """Return the licence that a tag names, such as CC0 for ``"licence:CC0"``; None without one."""
    licences = (tag.partition(":")[2] for tag in tags if tag.lower().startswith(_LICENCE_TAGS))
    return next((own.strip() for own in licences), None)


def _scenario_record(graft: Graft) -> Record | None:
    scenario = graft.request.scenario
    if scenario is None:
        return None
    arrays = {"lengths": scenario.lengths, "place": scenario.place}
    return {
        "segments": [_segment_record(graft.library, own) for own in scenario.segments.tolist()],
        **{name: None if own is None else own.tolist() for name, own in arrays.items()},
        "turn": scenario.turn,
    }


def _segment_record(library: Library, segment: int) -> Record:
    segments = library.segments
    return {
        "clip": library.entries[segments.clip[segment]].name,
        "clip_frames": [int(segments.start[segment]), int(segments.stop[segment])],
    }


def _replaced_donors(graft: Graft) -> Iterator[list[Record]]:
    """Yield for each edit the donors that it replaced."""
    for old, new in pairwise([*graft.history, graft.donors]):
        yield [
            {
                "group": own.group,
                "frames": [own.start, own.stop],
                **_segment_record(graft.library, donor),
                "exchanged": donor != own.segment,
            }
            for own, donor, following in zip(
                graft.substitutions, _flat(old), _flat(new), strict=True
            )
            if donor != following
        ]


def _flat(values: DonorSequences) -> list[int]:
    """Return the values of all groups in the order of `Graft.substitutions`."""
    return [value for own in values.values() for value in own.tolist()]


def _repetition_record(graft: Graft) -> Record | None:
    if not graft.scenario:
        return None
    repeated = repetition(graft.library, graft.scenario)
    return {
        "longest_repeat_seconds": round(repeated.longest_repeat, 4),
        "distinct_share": round(repeated.distinct_share, 4),
    }


def substitution_record(substitution: Substitution) -> Record:
    """Return a substitution as JSON."""
    gaps = (substitution.gap_before, substitution.gap_after)
    return {
        "group": substitution.group,
        "frames": [substitution.start, substitution.stop],
        "clip": substitution.clip,
        "clip_frames": [substitution.donor_start, substitution.donor_stop],
        "exchanged": not substitution.is_own,
        "stretch": round(substitution.stretch, 6),
        "cost": round(substitution.cost, 6),
        "gaps_degrees": [round(float(np.degrees(gap)), 4) for gap in gaps],
    }


def violation_record(violation: Violation, constraints: Iterable[Constraint]) -> Record:
    """Return a violation as JSON, with the index of its constraint in `constraints`."""
    return {
        "constraint": constraint_kind(violation.constraint),
        "number": _constraint_number(violation.constraint, constraints),
        "frames": list(violation.frames),
        "worst_frame": violation.worst,
        "joint": violation.joint,
        "tolerances": round(violation.error, 4),
        "message": violation.message,
    }


def _completions(graft: Graft, completions: Iterable[ReachCompletion]) -> list[Record]:
    """Return as JSON what inverse kinematics did for each `Reach`."""
    return [
        {
            "number": _constraint_number(own.reach, graft.request.constraints),
            "joint": own.reach.joint,
            "frames": list(own.frames),
            "before_heights": round(own.before, 6),
            "after_heights": round(own.after, 6),
            "is_moved": own.is_moved,
            "reason": own.reason,
        }
        for own in completions
    ]


def _constraint_number(constraint: Constraint, constraints: Iterable[Constraint]) -> int | None:
    """Return the index of a constraint in `constraints`; None if it is not among them."""
    return next((i for i, own in enumerate(constraints) if own is constraint), None)


def _repair_record(window: RepairedWindow) -> Record:
    frames, amounts = [window.start, window.stop], {"before": window.before, "after": window.after}
    rounded = {name: round(amount, 4) for name, amount in amounts.items()}
    return {"group": window.group, "frames": frames, "measure": window.measure, **rounded}
