"""`Graft`: a new motion with the source of every part, and what was requested of it."""

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from mograft._util.arrays import BoolArray, IntArray
from mograft._util.html_table import notebook_html, notebook_table
from mograft.blend.foot_planting import FeetReport
from mograft.blend.reach_completion import ReachCompletion
from mograft.body.loops import is_loop
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.scenario import Scenario, repetition
from mograft.search.constraints import Constraint, Span, Violation, overlaps
from mograft.search.donor_constraints import KeepOriginal, limit_config
from mograft.search.trellis import DonorSequences
from mograft.solve.self_repair import RepairedWindow


class Substitution(NamedTuple):
    """The donor of one base segment for one joint group.

    Attributes
    ----------
    group : str
        The joint group.
    start, stop : int
        First and last frame in the base, both included.
    segment, donor : int
        Indices of the base segment and of the donor in the library.
    clip : str
        Name of the donor's clip.
    donor_start, donor_stop : int
        First and last frame of the donor in its clip.
    stretch : float
        Relative change of the donor's length: 0.1 if it was lengthened by 10 %.
    cost : float
        Cost of the donor without the costs of seams and constraints; see `Config`.
    gap_before, gap_after : float
        Mean joint angle, in radians, between this donor and the previous or next one where they
        meet; 0 if they are consecutive in a clip, and at the start and end of the motion.
    """

    group: str
    start: int
    stop: int
    segment: int
    donor: int
    clip: str
    donor_start: int
    donor_stop: int
    stretch: float
    cost: float = 0.0
    gap_before: float = 0.0
    gap_after: float = 0.0

    @property
    def is_own(self) -> bool:
        """Whether the donor is the base segment itself."""
        return self.segment == self.donor


@dataclass(frozen=True)
class Seam:
    """A frame at which the gap between two donors was closed.

    The donors are not consecutive in a clip, or one of them was stretched.

    Attributes
    ----------
    group : str
        The joint group.
    frame : int
        The frame in the base.
    gap : float
        Mean joint angle between the two donors' poses, in radians: the angle that
        `Config.max_angle` limits.
    """

    group: str
    frame: int
    gap: float


@dataclass(frozen=True, kw_only=True)
class Change:
    """A range of frames in which a group moves as in a part of a clip; made by `mograft.change`.

    Attributes
    ----------
    group : str
        The exchanged group.
    part : str or None
        The body part within the group that moves so; None for the whole group.
    frames : tuple of int
        First and last frame in the base, both included.
    clip : str
        Name of the donor's clip.
    clip_frames : tuple of int
        First and last frame of the donor in its clip.
    command : str or None
        The command line, as typed; None in Python.
    is_held : bool
        Whether the donor holds to the ends of a loop, which are then not closed.
    """

    group: str
    part: str | None = None
    frames: Span
    clip: str
    clip_frames: Span
    command: str | None = None
    is_held: bool = False

    def __str__(self) -> str:
        where, donor = (f"{first}-{last}" for first, last in (self.frames, self.clip_frames))
        return f"{self.part or self.group}, frames {where}: {self.clip} {donor}"


@dataclass(frozen=True, kw_only=True, eq=False)
class GraftRequest:
    """The arguments of `mograft.graft` or `mograft.repair` that led to a graft.

    Attributes
    ----------
    method : {"graft", "repair"}
        The function.
    base : str or None
        The name of the base; None for the first clip or a scenario.
    swap : tuple of str or None
        The groups to exchange; None for all but the base group.
    constraints : tuple of Constraint
        The constraints. They give base segments and donors by their frames, not by number.
    scenario : Scenario or None
        The base, if it is composed of segments.
    command : str or None
        The command line, as typed; None in Python.
    sources : tuple of str
        The files, folders or library that the command line names.
    edit_commands : tuple of str or None
        The command line of each later edit; None in Python.
    """

    method: Literal["graft", "repair"] = "graft"
    base: str | None = None
    swap: tuple[str, ...] | None = None
    constraints: tuple[Constraint, ...] = ()
    scenario: Scenario | None = None
    command: str | None = None
    sources: tuple[str, ...] = ()
    edit_commands: tuple[str | None, ...] = ()


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
        The frames in which `Config.self_repair` searched for other donors: the `group`, `start`,
        `stop`, the `measure`, and its ratio to its limit `before` and `after`.
    request : GraftRequest
        The arguments with which the graft was made.
    history : tuple of dict of str to ndarray of int
        The donors by group before each call of `replace`, oldest first.
    completion_history : tuple of tuple of ReachCompletion
        `reach_completions` before each call of `replace`, oldest first.
    changes : tuple of Change
        The calls of `mograft.change`, oldest first. The other attributes, except `motion` and
        `violations`, are those of `unchanged`.
    unchanged : Graft or None
        The graft without these changes; None if there are none.
    remarks : tuple of str or None
        Of a replayed graft, what `advise` returned for the original; otherwise None.
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
    changes: tuple[Change, ...] = ()
    unchanged: "Graft | None" = None
    remarks: tuple[str, ...] | None = None

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
        """Return the page of the graft, and a table of the exchanged parts by frame."""
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
        table = notebook_table(repr(self), columns, rows, len(exchanged))
        return (notebook_html(self) or "") + table

    def report(self, *, each: bool = False) -> str:
        """Return a text summary: segments, seams, violations, foot planting and targets.

        Parameters
        ----------
        each : bool
            Whether to list every exchanged segment with its donor, cost and seams.
        """
        lines = [f"{self.motion.name}: {self.base.n_frames} frames of {self.base.name}"]
        if self.scenario:
            repeated = repetition(self.library, self.scenario)
            lines.append(
                f"  scenario: {len(self.scenario)} segments, {repeated.distinct_share:.0%} "
                f"different; longest repeat {repeated.longest_repeat:.1f} s"
            )
        for group in self.alternatives:
            lines += _group_lines(self, group, each=each)
        lines += [f"  changed {own}" for own in self.changes]
        is_held = any(own.is_held for own in self.changes)
        if is_held and is_loop(self.base) and not is_loop(self.motion):
            text = "  the loop is open, because a changed part holds to its end; changes in frames"
            lines.append(f"{text} 1-{self.base.n_frames - 2} keep it closed")
        lines += [f"  {violation.message}" for violation in self.violations]
        lines += [_repair_line(own) for own in self.self_repairs]
        feet = self.feet
        if feet is not None:
            lines.append(
                f"  feet: {feet.plants} plants; skating frames {feet.skate_before:.1%} before "
                f"planting, {feet.skate_after:.1%} after"
            )
        if feet is not None and feet.unreached_frames:
            lines.append(
                f"    out of reach in {feet.unreached_frames} frames, "
                f"by up to {feet.unreached:.4f} heights"
            )
        return "\n".join([*lines, *map(_reach_line, self.reach_completions)])


def _reach_line(completion: ReachCompletion) -> str:
    first, last = completion.frames
    when = f"frame {first}" if first == last else f"frames {first}-{last}"
    result = f"not moved: {completion.reason}"
    if completion.is_moved:
        result = f"{completion.after:.3f} after inverse kinematics"
    where = f"  reach: {completion.reach.joint}, {when}: {completion.before:.3f} heights"
    return f"{where} from the target, {result}"


def _repair_line(window: RepairedWindow) -> str:
    where = f"{window.group}, frames {window.start}-{window.stop}: {window.measure}"
    is_better = window.after < window.before
    result = f"{window.after:.1f} with other donors" if is_better else "no better donors"
    return f"  {where} {window.before:.1f} times its limit; {result}"


def seam_limit(graft: Graft) -> float:
    """Return the largest seam gap in radians that configuration and constraints accept."""
    return limit_config(graft.library.config, graft.request.constraints).max_angle


def find_missing(graft: Graft, group: str) -> BoolArray:
    """Return which base segments have no other candidate, unless `KeepOriginal` keeps them."""
    own = [own for own in graft.substitutions if own.group == group]
    starts, stops = (np.array([getattr(s, name) for s in own]) for name in ("start", "stop"))
    is_missing: BoolArray = graft.alternatives[group] == 0
    for kept in graft.request.constraints:
        if isinstance(kept, KeepOriginal) and kept.is_hard and kept.applies_to_group(group):
            is_missing = is_missing & ~overlaps(Segments(starts, stops), kept.frames)
    return is_missing


def _group_lines(graft: Graft, group: str, *, each: bool) -> list[str]:
    limit = np.degrees(seam_limit(graft))
    substitutions = [s for s in graft.substitutions if s.group == group]
    exchanged = [s for s in substitutions if not s.is_own]
    gaps = np.degrees([seam.gap for seam in graft.seams if seam.group == group])
    n_wide = int((gaps > limit + 1e-6).sum())
    n_without = int(find_missing(graft, group).sum())
    lines = [f"  {group}: {len(exchanged)} of {len(substitutions)} segments exchanged"]
    if n_without:
        lines.append(f"    {n_without} had no candidate and were kept")
    if len(gaps):
        lines.append(
            f"    {len(gaps)} seams, mean gap {gaps.mean():.1f}°, largest {gaps.max():.1f}° "
            f"(limit {limit:.0f}°)"
        )
    if n_wide:
        lines.append(f"    {n_wide} seams are wider than {limit:.0f}°")
    if each:
        lines += [
            f"    segment {number}, {s.start}-{s.stop} from {s.clip} {s.donor_start}-"
            f"{s.donor_stop}: cost {s.cost:.2f}, stretch {s.stretch:+.2f}, seams "
            f"{np.degrees(s.gap_before):.1f}° and {np.degrees(s.gap_after):.1f}°"
            for number, s in enumerate(substitutions)
            if not s.is_own
        ]
    return lines
