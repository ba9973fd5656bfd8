"""The donors of a range of a motion, ranked by cost, with the reasons against refused ones."""

from collections.abc import Mapping
from itertools import islice
from typing import Any

import numpy as np

from mograft.library.library import Library
from mograft.provenance.graft_change import plan_of, unchanged
from mograft.search.constraints import Span, as_span
from mograft.search.donor_choice import cost_model
from mograft.solve.candidates import Candidate, list_candidates
from mograft.solve.donor_spans import ChangedPart, DonorSpan, find_donor_spans
from mograft.studio.actions.editing import base_segments
from mograft.studio.actions.fields import Fields
from mograft.studio.desk import Desk
from mograft.synthesis.graft_result import Graft

Json = dict[str, Any]
_LIMIT = 40
_MAX_LIMIT = 500


def find(desk: Desk, question: Mapping[str, Any]) -> Json:
    """Return the donors of a segment, or of a range between any frames.

    The costs and seams of donors of a segment are those beside its present neighbours in the
    motion. Donors of any other range are parts of clips of about its length.
    """
    fields = Fields(question)
    own = desk.project.motion(question.get("id"))
    graft, group = desk.workshop.editable(own.record), fields.text("group")
    frames, limit = fields.frames(), fields.integer("limit", _LIMIT, 1, _MAX_LIMIT)
    library = desk.workshop.with_variety(graft.library, fields.number("variety"))
    if group in graft.alternatives:
        cut = base_segments(graft, group)
        found = np.flatnonzero((cut.start == frames[0]) & (cut.stop == frames[1]))
        if len(found):
            return _of_segment(graft, library, group, int(found[0]), limit)
    return _of_range(graft, group, frames, limit)


def _of_segment(graft: Graft, library: Library, group: str, position: int, limit: int) -> Json:
    own = [each for each in graft.substitutions if each.group == group]
    around = (
        own[position - 1].donor if position else None,
        own[position + 1].donor if position + 1 < len(own) else None,
    )
    pool = library.pool(group)
    model = cost_model(library.config, pool)
    listed = list_candidates(pool, own[position].segment, model, around=around)
    ranked = sorted(listed.allowed, key=lambda each: each.cost)
    ranked += sorted(listed.refused, key=lambda each: each.cost)
    used = [each for each in ranked if each.segment == own[position].donor]
    shown = [*used, *(each for each in ranked[:limit] if each not in used)]
    length = own[position].stop - own[position].start
    rows = [
        _row(library, each, length)
        | {
            "seamBefore": round(float(np.degrees(each.gap_before)), 2),
            "seamAfter": round(float(np.degrees(each.gap_after)), 2),
            "refused": each.refused,
            "isUsed": each.segment == own[position].donor,
            "isCaptured": each.segment == own[position].segment,
        }
        for each in shown
    ]
    return {"donors": rows, "total": len(ranked)}


def _row(library: Library, own: Candidate | DonorSpan, length: int) -> Json:
    """Return a donor of `length` frame intervals; without its seams, and allowed, by default."""
    return {
        "clip": library.names[own.clip],
        "first": own.start,
        "last": own.stop,
        "cost": round(own.cost, 4),
        **{"seamBefore": None, "seamAfter": None},
        "stretch": round(length / (own.stop - own.start) - 1.0, 4),
        **{"refused": "", "isUsed": False, "isCaptured": False},
    }


def _of_range(graft: Graft, group: str, frames: Span, limit: int) -> Json:
    first, last = as_span("first, last", frames)
    if not first < last < graft.motion.n_frames:
        raise ValueError(
            f"`first` and `last` must be two frames from 0 to {graft.motion.n_frames - 1}, got "
            f"{first}-{last}"
        )
    problem = plan_of(unchanged(graft), graft.request.constraints).problem
    part = ChangedPart.find(problem, group)
    spans = list(islice(find_donor_spans(problem, graft.motion, part, frames), _MAX_LIMIT))
    library, names = graft.library, graft.library.names
    used = {
        (own.clip, own.clip_frames)
        for own in graft.changes
        if own.frames == (first, last) and group in (own.part, own.group)
    }
    rows = [
        _row(library, own, last - first)
        | {"isUsed": (names[own.clip], (own.start, own.stop)) in used}
        for own in spans[:limit]
    ]
    return {"donors": rows, "total": len(spans)}
