"""Figures on a page: motions with joint groups and segments, also of grafts in files."""

import math
import shlex
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from mograft._util.arrays import IntArray
from mograft.errors import DAMAGE, MograftError, ProvenanceError
from mograft.io.formats import read_clip
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.provenance.graft_record import GraftRecord, find_clip, read_clip_record, read_motion
from mograft.search.constraint_records import decode_constraint
from mograft.search.constraints import Constraint
from mograft.solve.candidates import candidates
from mograft.synthesis.graft_result import Graft

_MAX_LISTED = 20
"""Maximum number of donors listed for a segment."""

_MAX_SEGMENTS = 1_500
"""Maximum number of segments with listed donors, over all groups."""

_FROM = ("mograft", "graft", "--from")

CandidateTable: TypeAlias = Mapping[str, Mapping[str, list[Any]]]
"""For each exchanged group, one list per quantity for all listed candidates."""


class TimelineRow(NamedTuple):
    """One row of the timeline: the segments of one joint group of a motion.

    Attributes
    ----------
    group : str
        The group.
    parts : dict of str to list
        A value for each segment: its first and last frame ``start`` and ``stop``; its ``cluster``,
        in a graft that of the donor, -1 if unknown. In a graft also the ``clip`` of the donor, its
        ``first`` and ``last`` frame there; whether ``is_exchanged``, that is, the donor is another
        segment; ``stretch``, the relative change of the donor's duration; the seam angles
        ``before`` and ``after`` in degrees, None without a seam; ``others``, the number of donors
        other than the segment itself. ``clip`` is None in a captured motion.
    changes : list of dict
        The ranges that `Graft.changes` replaced: ``start``, ``stop``, ``first``, ``last``, and the
        name of the clip as ``source``.
    """

    group: str
    parts: Mapping[str, list[Any]]
    changes: Sequence[Mapping[str, Any]] = ()

    @classmethod
    def of_clip(
        cls, group: str, start: IntArray, stop: IntArray, cluster: IntArray
    ) -> "TimelineRow":
        """Return the row of captured segments."""
        found = {"start": start.tolist(), "stop": stop.tolist(), "cluster": cluster.tolist()}
        return cls(group, found | {name: [own] * len(start) for name, own in _CAPTURED.items()})


_CAPTURED = {"clip": None, "first": 0, "last": 0, "is_exchanged": False, "stretch": 0.0}
_CAPTURED |= dict.fromkeys(("before", "after", "others"))
"""Values of `TimelineRow.parts` that only segments of grafts have."""


@dataclass(frozen=True, eq=False)
class Figure:
    """One moving figure."""

    motion: Motion
    name: str  # Name on the page.
    members: Mapping[str, IntArray]  # The joints of each group.
    rows: tuple[TimelineRow, ...]  # The rows of the figure in the timeline.
    candidates: CandidateTable | None = None  # The donors that the segments of a graft could have.
    clip_of: Callable[[str], Motion] | None = None  # The donor clip of a name.
    note: str = ""  # How new a graft is.
    command: str | None = None  # Command line to which the page appends choices of donors.
    keep: list[str] | str | None = None  # Files of a graft, or the command that writes it again.

    def with_file(self, path: Path) -> "Figure":
        """Return the figure of a graft with the commands that edit and keep its file."""
        name, file, record = self.motion.name, str(path), str(path.with_suffix(".json"))
        source, target = record, [str(path.with_name(f"{path.stem}_new.bvh"))]
        keep: list[str] | str = [file, record]
        if path.suffix.lower() in (".glb", ".npz"):
            source = f"{file}#{name}"
            keep = shlex.join([*_FROM, source, "-o", f"kept/{name}{path.suffix}"])
        if path.suffix.lower() == ".glb":
            target = [file, "--as", f"{name}_new"]
        return replace(self, command=shlex.join([*_FROM, source, "-o", *target]), keep=keep)

    def group_of_nodes(self, parents: Sequence[int]) -> list[int]:
        """Return the index of the joint group of each node.

        `parents` holds the parent of each node: of the joints, then of the end sites. An end site
        belongs to the group of its parent.
        """
        groups = np.zeros(len(parents), np.int64)
        for index, joints in enumerate(self.members.values()):
            groups[joints] = index
        sites = slice(self.motion.n_joints, None)
        groups[sites] = groups[np.maximum(np.array(parents, np.int64), 0)[sites]]
        return groups.tolist()


class ShownConstraint(NamedTuple):
    """A constraint, and a motion whose axes and unit are those of the constraint's positions."""

    constraint: Constraint
    motion: Motion


def candidate_table(graft: Graft) -> CandidateTable:
    """Return the allowed candidates of a graft's segments in the order of `mograft.candidates`.

    Constraints are ignored. Costs and seam angles are those between the neighbours of the base
    segment in its clip; in a scenario, in which it has other neighbours, they are None. Only the
    first segments of each group are included, at most 1,500 segments over all groups.
    """
    most = _MAX_SEGMENTS // max(len(graft.alternatives), 1)
    return {group: _list_candidates(graft, group, most) for group in graft.alternatives}


def _list_candidates(graft: Graft, group: str, max_count: int) -> dict[str, list[Any]]:
    segments = [s.segment for s in graft.substitutions if s.group == group][:max_count]
    found = [candidates(graft.library, segment, group).allowed for segment in segments]
    pairs = zip(segments, found, strict=True)
    listed = [(segment, own) for segment, allowed in pairs for own in allowed[:_MAX_LISTED]]
    table: dict[str, list[Any]] = {
        "counts": [min(len(allowed), _MAX_LISTED) for allowed in found],
        "total": [len(allowed) for allowed in found],
        "source": [graft.library.names[own.clip] for _, own in listed],
        "first": [own.start for _, own in listed],
        "last": [own.stop for _, own in listed],
        "own": [int(own.segment == segment) for segment, own in listed],
        "cost": [round(own.cost, 4) for _, own in listed],
        "stretch": [round(own.stretch, 4) for _, own in listed],
        "before": [round(math.degrees(own.gap_before), 4) for _, own in listed],
        "after": [round(math.degrees(own.gap_after), 4) for _, own in listed],
    }
    if graft.scenario:
        table |= {key: [None] * len(listed) for key in ("cost", "stretch", "before", "after")}
    return table


def read_recorded(motion: Motion, path: Path) -> tuple[Figure, GraftRecord] | None:
    """Return the figure of a graft, and its provenance, in its file or beside it.

    The figure has the donors, seams and groups of the provenance. The result is None if there is no
    provenance of the clip, and with a warning also if the provenance is damaged or is that of a
    motion of another length.
    """
    try:
        record = read_clip_record(path, motion.clip)
        return None if record is None else (_recorded_figure(motion, record), record)
    except (OSError, ProvenanceError) as error:
        warnings.warn(f"{error}; {path} is shown without donors", stacklevel=2)
        return None


def _recorded_figure(motion: Motion, record: GraftRecord) -> Figure:
    try:
        n_frames = record.document["frames"]
        if n_frames != motion.n_frames:
            raise ValueError(f"`frames` is {n_frames}, but the motion has {motion.n_frames} frames")
        groups = dict.fromkeys(donor.group for donor in record.donors)
        rows = tuple(_recorded_row(record, group) for group in groups)
        members: dict[str, IntArray] = record.groups.resolve(motion.skeleton)
    except DAMAGE as error:
        raise record.error(f"damaged: {error}") from error
    return Figure(motion, motion.name, members, rows)


def _recorded_row(record: GraftRecord, group: str) -> TimelineRow:
    angles = {
        seam["frame"]: round(float(seam["gap_degrees"]), 2)
        for seam in record.document["seams"]
        if seam["group"] == group
    }
    pairs = zip(record.donors, record.document["substitutions"], strict=True)
    stretches = [float(own["stretch"]) for donor, own in pairs if donor.group == group]
    donors = [own for own in record.donors if own.group == group]
    parts: dict[str, list[Any]] = {
        "start": [own.frames[0] for own in donors],
        "stop": [own.frames[1] for own in donors],
        "cluster": [-1] * len(donors),
        "clip": [own.clip for own in donors],
        "first": [own.clip_frames[0] for own in donors],
        "last": [own.clip_frames[1] for own in donors],
        "is_exchanged": [not own.is_own for own in donors],
        "stretch": stretches,
        "before": [angles.get(own.frames[0]) for own in donors],
        "after": [angles.get(own.frames[1]) for own in donors],
        "others": [own.alternatives for own in donors],
    }
    return TimelineRow(group, parts)


def recorded_base(
    motion: Motion, record: GraftRecord, skeleton: Skeleton | None = None
) -> Motion | None:
    """Return the base of a graft; None if its file is missing, changed or of another length.

    `skeleton` is the rest pose for files that store none, by default that of the provenance.
    """
    skeleton = record.library.rest if skeleton is None else skeleton
    for clip in record.clips:
        if clip.is_base and clip.name == record.base and not clip.is_mirrored:
            with suppress(MograftError, OSError):
                base = read_clip(find_clip(record, clip, ()), skeleton=skeleton)
                return base if base.n_frames == motion.n_frames else None
    return None


def recorded_constraints(record: GraftRecord) -> list[Constraint]:
    """Return the constraints of a graft, except those whose files are missing or damaged."""
    found: list[Constraint] = []
    for values in (record.document.get("request") or {}).get("constraints", ()):
        with suppress(*DAMAGE, MograftError, OSError):
            found.append(decode_constraint(values, partial(read_motion, record=record)))
    return found
