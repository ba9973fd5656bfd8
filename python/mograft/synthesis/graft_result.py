"""Grafts: new motions with the source of every part."""

import math
from dataclasses import dataclass, field

import numpy as np

from mograft._util.arrays import IntArray
from mograft._util.html_table import notebook_table
from mograft._util.notebooks import notebook_html
from mograft.blend.foot_planting import FeetReport
from mograft.blend.reach_completion import ReachCompletion
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.scenario import repetition
from mograft.search.constraints import Violation
from mograft.search.donor_constraints import limit_config
from mograft.search.trellis import DonorSequences
from mograft.solve.self_repair import RepairedWindow
from mograft.synthesis.graft_request import GraftRequest
from mograft.synthesis.substitution import Seam, Substitution


@dataclass(frozen=True, eq=False, kw_only=True)
class Graft:
    """A new motion and the donor of every base segment.

    Attributes
    ----------
    motion : Motion
        The new motion, with as many frames as the base.
    base : Motion
        The motion whose base group is kept.
    library : Library
        The library that contains the donors.
    substitutions : tuple of Substitution
        The donor of every base segment and grafted group; it may be the segment itself.
    seams : tuple of Seam
        The treated seams.
    alternatives : dict of str to ndarray of int
        For each grafted group, the number of candidates for every base segment, not counting the
        base segment itself.
    seed : int
        The seed of the donor choice.
    index : int
        Index of this graft among those of the same call.
    violations : tuple of Violation
        Violations of hard constraints; empty if all are satisfied.
    feet : FeetReport or None
        Result of foot planting; None with ``Config(feet="never")`` or if no exchanged group drives
        the feet.
    reach_completions : tuple of ReachCompletion
        The result of inverse kinematics for each `Reach`; empty with ``Config(reach_ik=0)``.
    self_repairs : tuple of RepairedWindow
        The frames in which `Config.self_repair` searched for other donors.
    request : GraftRequest
        The arguments with which the graft was made.
    history : tuple of dict of str to ndarray of int
        The donors by group before each call of `replace`, oldest first.
    completion_history : tuple of tuple of ReachCompletion
        `reach_completions` before each call of `replace`, oldest first.
    """

    motion: Motion
    base: Motion
    library: Library
    substitutions: tuple[Substitution, ...]
    seams: tuple[Seam, ...]
    alternatives: dict[str, IntArray]
    seed: int
    index: int
    violations: tuple[Violation, ...] = ()
    feet: FeetReport | None = None
    reach_completions: tuple[ReachCompletion, ...] = ()
    self_repairs: tuple[RepairedWindow, ...] = ()
    request: GraftRequest = field(default_factory=GraftRequest)
    history: tuple[DonorSequences, ...] = ()
    completion_history: tuple[tuple[ReachCompletion, ...], ...] = ()

    def __repr__(self) -> str:
        new = sum(not s.is_own for s in self.substitutions)
        return f"Graft({self.motion.name}: {new} of {len(self.substitutions)} parts exchanged)"

    @property
    def donors(self) -> DonorSequences:
        """The donor of every base segment as an index in the library, by grafted group."""
        return {
            group: np.array([own.donor for own in self.substitutions if own.group == group])
            for group in self.alternatives
        }

    @property
    def scenario(self) -> tuple[int, ...]:
        """The segments that form the base; empty if the base is a clip."""
        scenario = self.request.scenario
        return () if scenario is None else tuple(scenario.segments.tolist())

    def _repr_html_(self) -> str:
        return (notebook_html(self) or "") + self._substitution_table()

    def _substitution_table(self) -> str:
        """Return an HTML table of the exchanged parts, in the order of the frames."""
        exchanged = sorted(
            (s for s in self.substitutions if not s.is_own), key=lambda s: (s.start, s.group)
        )
        rows = (
            (
                *(s.group, f"{s.start}-{s.stop}", s.clip, f"{s.donor_start}-{s.donor_stop}"),
                *(s.cost, math.degrees(s.gap_before)),
            )
            for s in exchanged
        )
        columns = ("group", "frames", "donor clip", "donor frames", "cost", "seam before (°)")
        return notebook_table(repr(self), columns, rows, len(exchanged))

    def report(self, *, each: bool = False) -> str:
        """Return a text summary: segments, seams, violations, foot planting and targets.

        Parameters
        ----------
        each : bool
            Whether to list every exchanged segment with its donor, cost and seams.
        """
        return _report(self, each=each)


def _report(graft: Graft, *, each: bool = False) -> str:
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
    lines += [_repair_line(own) for own in graft.self_repairs]
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


def _reach_line(completion: ReachCompletion) -> str:
    first, last = completion.frames
    when = f"frame {first}" if first == last else f"frames {first}-{last}"
    where = f"  reach: {completion.reach.joint}, {when}: {completion.before:.3f} heights"
    if completion.is_moved:
        return f"{where} from the target, {completion.after:.3f} after inverse kinematics"
    return f"{where} from the target, not moved: {completion.reason}"


def _repair_line(window: RepairedWindow) -> str:
    where = f"{window.group}, frames {window.start}-{window.stop}: {window.measure}"
    if window.after < window.before:
        result = f"{window.after:.1f} with other donors"
    else:
        result = "no better donors"
    return f"  {where} {window.before:.1f} times its limit; {result}"


def seam_limit(graft: Graft) -> float:
    """Return the largest seam gap in radians that configuration and constraints accept."""
    return limit_config(graft.library.config, graft.request.constraints).max_angle


def _group_lines(graft: Graft, group: str, *, each: bool) -> list[str]:
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
