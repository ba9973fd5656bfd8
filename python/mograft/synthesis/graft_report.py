"""The summary of a graft in text."""

from typing import TYPE_CHECKING

import numpy as np

from mograft.scenario import repetition
from mograft.search.donor_constraints import limit_config

if TYPE_CHECKING:
    from mograft.blend.reach_completion import ReachCompletion
    from mograft.synthesis.graft_result import Graft
    from mograft.synthesis.self_repair import RepairedWindow


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
    lines += [_reach_line(own) for own in graft.reach_completions]
    return "\n".join(lines)


def _reach_line(completion: "ReachCompletion") -> str:
    first, last = completion.frames
    when = f"frame {first}" if first == last else f"frames {first}-{last}"
    where = f"  reach: {completion.reach.joint}, {when}: {completion.before:.3f} heights"
    if completion.is_moved:
        return f"{where} from the target, {completion.after:.3f} after inverse kinematics"
    return f"{where} from the target, not moved: {completion.reason}"


def _repair_line(window: "RepairedWindow") -> str:
    where = f"{window.group}, frames {window.start}-{window.stop}: {window.measure}"
    if window.after < window.before:
        result = f"{window.after:.1f} with other donors"
    else:
        result = "no better donors"
    return f"  {where} {window.before:.1f} times its limit; {result}"


def seam_limit(graft: "Graft") -> float:
    """Return the largest seam gap in radians that configuration and constraints accept."""
    return limit_config(graft.library.config, graft.request.constraints).max_angle


def _group_lines(graft: "Graft", group: str, *, each: bool) -> list[str]:
    limit = seam_limit(graft)
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
            f"    {len(gaps)} seams, mean gap {gaps.mean():.1f}°, largest {gaps.max():.1f}° "
            f"(limit {np.degrees(limit):.0f}°)"
        )
    if n_wide:
        lines.append(f"    {n_wide} seams are wider than {np.degrees(limit):.0f}°")
    if each:
        lines += [
            f"    segment {number}, {s.start}-{s.stop} from {s.clip} {s.donor_start}-"
            f"{s.donor_stop}: cost {s.cost:.2f}, stretch {s.stretch:+.2f}, seams "
            f"{np.degrees(s.gap_before):.1f}° and {np.degrees(s.gap_after):.1f}°"
            for number, s in enumerate(substitutions)
            if not s.is_own
        ]
    return lines
