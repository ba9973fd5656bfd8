"""Figures of grafts in files, whose donors are read from the provenance beside them."""

import warnings
from pathlib import Path

from mograft._util.arrays import IntArray
from mograft.errors import DAMAGE, MograftError, ProvenanceError
from mograft.io.addresses import read_clip
from mograft.library.discover import has_provenance
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.provenance.graft_record import ClipRecord, GraftRecord, read_clip_record
from mograft.provenance.record_library import find_clip
from mograft.search.constraint_records import decode_constraint
from mograft.search.constraints import Constraint
from mograft.viewing.figure import Figure, TimelinePart, TimelineRow


def read_recorded(motion: Motion, path: Path) -> tuple[Figure, GraftRecord] | None:
    """Return the figure of a graft, and the provenance in the ``.json`` file beside it.

    The figure has the donors, seams and groups of the provenance. The result is None if there is no
    provenance of the clip, and with a warning also if the provenance is damaged or is that of a
    motion of another length.
    """
    if not has_provenance(path):
        return None
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
    seams = {
        seam["frame"]: float(seam["gap_degrees"])
        for seam in record.document["seams"]
        if seam["group"] == group
    }
    parts = (
        TimelinePart(
            start=own.frames[0],
            stop=own.frames[1],
            clip=own.donor.clip,
            donor_start=own.donor.frames[0],
            donor_stop=own.donor.frames[1],
            is_exchanged=not own.is_own,
            stretch=float(substitution["stretch"]),
            seam_angles=(seams.get(own.frames[0]), seams.get(own.frames[1])),
            n_alternatives=own.alternatives,
        )
        for own, substitution in zip(record.donors, record.document["substitutions"], strict=True)
        if own.group == group
    )
    return TimelineRow(group, tuple(parts))


def recorded_base(
    motion: Motion, record: GraftRecord, skeleton: Skeleton | None = None
) -> Motion | None:
    """Return the base of a graft; None if its file is missing, changed or of another length.

    `skeleton` is the rest pose for files that store none, by default that of the provenance.
    """
    skeleton = record.library.rest if skeleton is None else skeleton
    for clip in record.clips:
        if clip.is_base and clip.name == record.base and not clip.is_mirrored:
            try:
                base = read_clip(find_clip(record, clip, ()), skeleton=skeleton)
            except (MograftError, OSError):
                return None
            return base if base.n_frames == motion.n_frames else None
    return None


def recorded_constraints(record: GraftRecord) -> list[Constraint]:
    """Return the constraints of a graft, except those whose files are missing or damaged."""

    def decode_motion(values: dict[str, object]) -> Motion:
        return read_clip(find_clip(record, ClipRecord.from_json(values), ()))

    found: list[Constraint] = []
    for values in (record.document.get("request") or {}).get("constraints", ()):
        try:
            found.append(decode_constraint(values, decode_motion))
        except (*DAMAGE, MograftError, OSError):
            continue
    return found
