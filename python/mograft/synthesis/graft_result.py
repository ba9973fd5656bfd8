"""Grafts: new motions with the source of every part."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from mograft._util.arrays import IntArray
from mograft._util.html_table import html_table
from mograft.blend.foot_planting import FeetReport
from mograft.blend.reach_completion import ReachCompletion
from mograft.library.library import Library
from mograft.motion.motion import Motion, notebook_html
from mograft.search.constraints import Constraint, Violation
from mograft.search.trellis import DonorSequences
from mograft.synthesis import graft_report, provenance
from mograft.synthesis.graft_request import GraftRequest
from mograft.synthesis.self_repair import RepairedWindow


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
    repairs : tuple of RepairedWindow
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
    repairs: tuple[RepairedWindow, ...] = ()
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
        return notebook_html(self) + self._substitution_table()

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
        return html_table(repr(self), columns, rows, len(exchanged))

    def report(self, *, each: bool = False) -> str:
        """Return a text summary: segments, seams, violations, foot planting and targets.

        Parameters
        ----------
        each : bool
            Whether to list every exchanged segment with its donor, cost and seams.
        """
        return graft_report.report(self, each=each)

    def replace(
        self,
        *edits: Constraint,
        reroll: Sequence[int | tuple[int, int]] = (),
        seed: int | None = None,
    ) -> "Graft":
        """Return the graft with other donors at some segments; all other segments keep theirs.

        Parameters
        ----------
        *edits : Use, Ban or KeepOriginal
            `Use` sets the donor of a segment, `KeepOriginal` restores the captured motion. `Ban`
            excludes a donor, by default the present one, and the segment gets another. At its
            segments an edit replaces the constraints `Use` and `KeepOriginal` of the graft and of
            earlier edits, and `Use` and `KeepOriginal` also replace earlier bans. Other bans remain
            in force: no ban and no reroll brings an excluded donor back.
        reroll : sequence of int or tuple of int
            Segments to draw again, by their numbers or by ranges of frames. Each gets another donor
            than the present one if it has another candidate.
        seed : int, optional
            Seed of the choice. Default: that of the graft.

        Returns
        -------
        Graft
            Other segments have the same donors. The frames near the changed segments are new. A
            range of new frames ends at least `Config.seam_blend` seconds outside these segments, at
            a frame at which no joint differs by more than 0.0001 radians from the present motion.
            All other frames are the same, bit for bit. If an exchanged group contains the root, the
            later frames of the root are moved rigidly.
            `violations` lists edits and constraints that contradict each other.

        Raises
        ------
        TypeError
            If an edit is of another class.
        ValueError
            If neither an edit nor `reroll` is given; if an edit has a weight; if a segment, donor,
            group or frame does not exist; if the library has only the clips of the graft, because
            `replay` read their files.

        Examples
        --------
        >>> import mograft as mg
        >>> from mograft.dancer import dance
        >>> new = mg.graft(mg.Library.build(dance(strides=1).motion), seed=7)
        >>> edited = new.replace(mg.KeepOriginal(frames=(60, 90)), reroll=[40])
        >>> (edited.motion.rotations[400:] == new.motion.rotations[400:]).all()
        np.True_
        """
        from mograft.synthesis.graft_edit import edit_graft  # layer exception: a convenience

        return edit_graft(self, edits, reroll, seed)

    def as_dict(self, folder: str | PathLike[str] = ".") -> dict[str, Any]:
        """Return the provenance of the motion as a JSON document, from which `replay` remakes it.

        Parameters
        ----------
        folder : path
            The folder to which paths of files are relative: that of the document.
        """
        return provenance.document(self, folder)
