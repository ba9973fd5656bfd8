"""The provenance of a graft: as a JSON document and as a summary in text."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from mograft.scenario import repetition
from mograft.search.constraints import Violation

if TYPE_CHECKING:
    from mograft.synthesis.graft_result import Graft, Substitution
    from mograft.synthesis.self_repair import RepairedWindow


def document(graft: "Graft") -> dict[str, Any]:
    """Return the donors, seams and settings of a graft as JSON, schema ``mograft.graft/1``."""
    library, segments = graft.library, graft.library.segments
    repeated = repetition(library, graft.scenario) if graft.scenario else None
    return {
        "schema": "mograft.graft/1",
        "name": graft.motion.name,
        "base": graft.base.name,
        "seed": graft.seed,
        "index": graft.index,
        "frames": graft.motion.n_frames,
        "frame_time": graft.motion.frame_time,
        "config": library.config.as_dict(),
        "groups": {
            name: [library.skeleton.names[j] for j in library.joints(name)]
            for name in library.groups.names
        },
        "base_group": library.groups.base,
        "clips": [
            {
                "name": entry.name,
                "file": library.file_name(index),
                "sha256": None if entry.source_file is None else entry.source_file.sha256,
            }
            for index, entry in enumerate(library.entries)
        ],
        "scenario": [
            {
                "clip": library.entries[segments.clip[index]].name,
                "clip_frames": [int(segments.start[index]), int(segments.stop[index])],
            }
            for index in graft.scenario
        ],
        "repetition": None
        if repeated is None
        else {
            "longest_repeat_seconds": round(repeated.longest_repeat, 4),
            "distinct_share": round(repeated.distinct_share, 4),
        },
        "substitutions": [_substitution_record(own) for own in graft.substitutions],
        "seams": [
            {"group": s.group, "frame": s.frame, "gap_degrees": round(np.degrees(s.gap), 4)}
            for s in graft.seams
        ],
        "violations": [_violation_record(own) for own in graft.violations],
        "self_repair": [_repair_record(own) for own in graft.repairs],
        "feet": None if graft.feet is None else asdict(graft.feet),
        "kept_without_candidate": {
            name: int((counts == 0).sum()) for name, counts in graft.alternatives.items()
        },
    }


def _substitution_record(substitution: "Substitution") -> dict[str, Any]:
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


def _violation_record(violation: Violation) -> dict[str, Any]:
    return {
        "constraint": type(violation.constraint).__name__,
        "frames": list(violation.frames),
        "worst_frame": violation.worst,
        "joint": violation.joint,
        "tolerances": round(violation.error, 4),
        "message": violation.message,
    }


def _repair_record(window: "RepairedWindow") -> dict[str, Any]:
    return {
        "group": window.group,
        "frames": [window.start, window.stop],
        "measure": window.measure,
        "before": round(window.before, 4),
        "after": round(window.after, 4),
    }


def report(graft: "Graft", *, each: bool = False) -> str:
    """Return a text summary of a graft; with `each`, also a list of all exchanged segments."""
    lines = [f"{graft.motion.name}: {graft.base.n_frames} frames of {graft.base.name}"]
    if graft.scenario:
        repeated = repetition(graft.library, graft.scenario)
        lines.append(
            f"  scenario: {len(graft.scenario)} segments, {repeated.distinct_share:.0%} different; "
            f"longest repeat {repeated.longest_repeat:.1f} s"
        )
    for group in graft.alternatives:
        lines += _group_lines(graft, group, each=each)
    lines += [f"  {violation.message}" for violation in graft.violations]
    lines += [_repair_line(own) for own in graft.repairs]
    feet = graft.feet
    if feet is not None:
        lines.append(
            f"  feet: {feet.plants} plants; skating frames {feet.skate_before:.1%} before "
            f"planting, {feet.skate_after:.1%} after"
        )
        if feet.unreached_frames:
            lines.append(
                f"    out of reach in {feet.unreached_frames} frames, "
                f"by up to {feet.unreached:.4f} heights"
            )
    return "\n".join(lines)


def _repair_line(window: "RepairedWindow") -> str:
    where = f"{window.group}, frames {window.start}-{window.stop}: {window.measure}"
    if window.after < window.before:
        result = f"{window.after:.1f} with other donors"
    else:
        result = "no better donors"
    return f"  {where} {window.before:.1f} times its limit; {result}"


def _group_lines(graft: "Graft", group: str, *, each: bool) -> list[str]:
    limit = graft.library.config.max_angle
    substitutions = [s for s in graft.substitutions if s.group == group]
    exchanged = [s for s in substitutions if not s.is_own]
    gaps = np.degrees([seam.gap for seam in graft.seams if seam.group == group])
    n_wide = int((gaps > np.degrees(limit) + 1e-6).sum())
    n_without = int((graft.alternatives[group] == 0).sum())
    lines = [f"  {group}: {len(exchanged)} of {len(substitutions)} segments exchanged"]
    if n_without:
        lines.append(f"    {n_without} had no candidate and were kept")
    if len(gaps):
        lines.append(
            f"    {len(gaps)} seams, mean gap {gaps.mean():.1f}°, largest {gaps.max():.1f}°"
        )
    if n_wide:
        lines.append(f"    {n_wide} seams are wider than {np.degrees(limit):.0f}°")
    if each:
        lines += [
            f"    {s.start}-{s.stop} from {s.clip} {s.donor_start}-{s.donor_stop}: "
            f"cost {s.cost:.2f}, stretch {s.stretch:+.2f}, seams "
            f"{np.degrees(s.gap_before):.1f}° and {np.degrees(s.gap_after):.1f}°"
            for s in exchanged
        ]
    return lines
