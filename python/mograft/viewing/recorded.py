"""Figures of grafts in files, whose donors are read from the provenance beside them."""

import warnings
from pathlib import Path

import numpy as np

from mograft._util.arrays import IntArray
from mograft.errors import DAMAGE, MograftError, ProvenanceError
from mograft.io.addresses import read_clip
from mograft.library.discover import has_provenance
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.provenance.graft_record import ClipRecord, GraftRecord, find_clip, read_clip_record
from mograft.search.constraint_records import decode_constraint
from mograft.search.constraints import Constraint
from mograft.viewing.figure import Figure, TimelineRow


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
    indices = [i for i, donor in enumerate(record.donors) if donor.group == group]
    donors = [record.donors[i] for i in indices]
    seams = {
        seam["frame"]: float(seam["gap_degrees"])
        for seam in record.document["seams"]
        if seam["group"] == group
    }
    stretches = [float(record.document["substitutions"][i]["stretch"]) for i in indices]
    return TimelineRow(
        group=group,
        start=np.array([donor.frames[0] for donor in donors]),
        stop=np.array([donor.frames[1] for donor in donors]),
        cluster=np.full(len(donors), -1),
        donor_clips=tuple(donor.clip for donor in donors),
        donor_start=np.array([donor.clip_frames[0] for donor in donors]),
        donor_stop=np.array([donor.clip_frames[1] for donor in donors]),
        is_exchanged=np.array([not donor.is_own for donor in donors]),
        stretch=np.array(stretches),
        seam_angles=np.array(
            [[seams.get(frame, np.nan) for frame in donor.frames] for donor in donors]
        ),
        n_alternatives=np.array(
            [-1 if donor.alternatives is None else donor.alternatives for donor in donors]
        ),
    )


def recorded_base(
    motion: Motion, record: GraftRecord, skeleton: Skeleton | None = None
) -> Motion | None:
    """Return the base of a graft; None if its file is missing, changed or of another length.

    `skeleton` is the rest pose for files that store none, by default that of the provenance.
    """
    if skeleton is None and record.library is not None:
        skeleton = record.library.rest
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
