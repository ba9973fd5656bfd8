"""Self-repair: other donors where an assembled motion is rougher than the recordings.

The donors at defects are penalised and the trellis is searched again around them. The sequences
found are assembled and measured. The sequence with the smallest defects is used; if none is better,
that is the first one. No repair may violate a hard limit that the first sequence satisfies.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.runs import dilate, find_runs
from mograft.search.constraints import Span, Violation
from mograft.search.costs import excess
from mograft.search.trellis import DonorTrellis
from mograft.solve.assembly import Assembly, Excerpt, assemble_excerpts
from mograft.solve.defects import MEASURES, DefectMeasure
from mograft.solve.donor_repair import replace_unlisted, search_again

_Window = tuple[int, int]  # half-open range of positions
_FindViolations = Callable[[Assembly], Sequence[Violation]]

_RADIUS = 2  # positions beside a defect that repair can change
_MARGIN = 3  # positions beside a window that are assembled with it
_MAX_ROUNDS = 4  # searches with penalised donors
_MAX_ASSEMBLIES = 3  # of the whole motion
_LIMIT_FACTOR = 1e6  # of infeasible costs: penalties at defects must not outweigh them
_ROUNDING = 1e-12  # radians


@dataclass(frozen=True, kw_only=True)
class RepairedWindow:
    """A range of frames in which self-repair searched for other donors.

    Attributes
    ----------
    group : str
        The joint group.
    start, stop : int
        First and last frame in the base, both included.
    measure : {"seam acceleration", "seam jerk", "world jerk", "floor depth"}
        The measure that exceeded its limit most before the repair.
    before, after : float
        Greatest ratio of any measure to its limit, before and after the repair. Both are equal if
        no better donors were found.
    """

    group: str
    start: int
    stop: int
    measure: str
    before: float
    after: float


def self_repair(
    assembly: Assembly, trellises: Mapping[str, DonorTrellis], violations: _FindViolations
) -> tuple[Assembly, list[RepairedWindow]]:
    """Replace donors where a measure exceeds its limit; see `DefectMeasure`.

    Return the new assembly and the frame ranges searched, including those without better donors. If
    no donor is replaced, the assembly is returned unchanged. No seam exceeds `max_angle` by more
    than before, no constraint has more or greater `violations`, and neither the greatest amount of
    the repaired group nor that of all groups grows.
    """
    reports: list[RepairedWindow] = []
    defects = {
        group: _Defects.build(assembly, DefectMeasure(assembly.problem, group), violations)
        for group in assembly.donors
    }
    for group in assembly.donors:
        before = defects[group]
        if not before.windows:
            continue
        after = _keep_better(before, _search(before, trellises[group]))
        if after is not before:
            # The donors of a group also move joints of other groups.
            measured = {
                other: after if other == group else own.measured_in(after.assembly)
                for other, own in defects.items()
            }
            if after.worst <= before.worst and _worst(measured) <= max(_worst(defects), 1.0):
                defects = measured
            else:
                after = before
        reports += before.report(after)
    return next(iter(defects.values())).assembly, reports


@dataclass(frozen=True, eq=False)
class _Defects:
    """The defects of one group at each position of an assembly.

    Amounts are measures divided by their limits, as in `DefectMeasure`; above 1 is a defect.
    """

    assembly: Assembly
    measure: DefectMeasure
    violations: _FindViolations
    amounts: FloatArray  # shape (n_positions, n_measures)

    @classmethod
    def build(
        cls, assembly: Assembly, measure: DefectMeasure, violations: _FindViolations
    ) -> "_Defects":
        """Measure a group of an assembly."""
        whole = Excerpt(assembly.donors, 0, len(assembly.problem.base_segments))
        return cls(assembly, measure, violations, measure.amounts(assembly.motion, [whole])[0])

    def measured_in(self, assembly: Assembly) -> "_Defects":
        """Return the defects of the same group in another assembly."""
        return _Defects.build(assembly, self.measure, self.violations)

    @property
    def donors(self) -> IntArray:
        """The donor sequence of the group."""
        return self.assembly.donors[self.measure.group]

    @property
    def worst(self) -> float:
        """The greatest amount."""
        return float(self.amounts.max(initial=0.0))

    @cached_property
    def windows(self) -> list[_Window]:
        """Half-open ranges of the positions within `_RADIUS` of a defect."""
        has_defect = self.amounts.max(axis=1) > 1.0
        return [(start, stop) for start, stop in find_runs(dilate(has_defect, _RADIUS)).tolist()]

    def is_better(self, after: FloatArray, window: _Window) -> bool:
        """Whether the amounts `after` have a smaller total excess and no greater maximum.

        They are those in a window, and at the positions just before and just after it.
        """
        before = _around(self.amounts, window)
        return after.max() <= before.max() and _total_excess(after) < _total_excess(before)

    def overlaps(self, window: _Window, frames: Sequence[Span]) -> bool:
        """Whether a window, or the position before or after it, overlaps one of the ranges."""
        cut, (start, stop) = self.assembly.problem.base_segments, window
        first, last = cut.start[max(start - 1, 0)], cut.stop[min(stop, len(cut) - 1)]
        return any(first <= end and begin <= last for begin, end in frames)

    def report(self, after: "_Defects") -> list[RepairedWindow]:
        """Return one record for each window.

        It holds the greatest ratio of a measure to its limit twice: before the repair, in this
        assembly, and after it, in the repaired assembly `after`. These two may be of different
        measures; the record names the first.
        """
        cut = self.assembly.problem.base_segments
        reports = []
        for start, stop in self.windows:
            own = _around(self.amounts, (start, stop))
            reports.append(
                RepairedWindow(
                    group=self.measure.group,
                    start=int(cut.start[start]),
                    stop=int(cut.stop[stop - 1]),
                    measure=MEASURES[int(own.max(axis=0).argmax())],
                    before=float(own.max()),
                    after=float(_around(after.amounts, (start, stop)).max()),
                )
            )
        return reports

    def has_feasible_seams(self, donors: IntArray) -> BoolArray:
        """Return whether each seam exceeds `max_angle` by no more than before the repair."""
        problem = self.assembly.problem
        pool, limit = problem.pools[self.measure.group], problem.config.max_angle
        first, own = (
            np.maximum(pool.seam_angles_along(each) - limit, 0.0) for each in (self.donors, donors)
        )
        return own <= first + _ROUNDING

    def broken_frames(self, assembly: Assembly) -> list[Span]:
        """Return the frames of the violations of constraints that `assembly` violates more.

        These constraints have more violations, or a greater total amount, than before the repair.
        The result is empty if there are none.
        """
        grown: list[Span] = []
        if not assembly.problem.constraints:
            return grown
        found = self.violations(assembly)
        for constraint in assembly.problem.constraints:
            old = [own.error for own in self.first_violations if own.constraint is constraint]
            new = [own.error for own in found if own.constraint is constraint]
            if len(new) > len(old) or sum(new) > sum(old) + _ROUNDING:
                grown += [own.frames for own in found if own.constraint is constraint]
        return grown

    @cached_property
    def first_violations(self) -> Sequence[Violation]:
        """The violations of the first donors."""
        return self.violations(self.assembly)


def _search(defects: _Defects, trellis: DonorTrellis) -> IntArray:
    """Replace the donors of segments near defects; return the donors with the least defects.

    In several rounds, the donors at defects are penalised and the cheapest sequence is measured. A
    last round measures the base segments. Sequences whose seams exceed `max_angle` by more than the
    first are skipped.
    """
    problem, first = defects.assembly.problem, defects.donors
    best, above = first.copy(), excess(defects.amounts.max(axis=1))
    least = dict.fromkeys(defects.windows, np.inf)
    current = replace_unlisted(first, trellis)
    captured = replace_unlisted(problem.scenario, trellis)
    penalties = [np.zeros(len(own)) for own in trellis.candidates]
    for attempt in range(_MAX_ROUNDS + 1):
        windows = [window for window, total in least.items() if total > 0.0]
        if not windows:
            break
        is_open = np.zeros(len(first), bool)
        for start, stop in windows:
            is_open[start:stop] = True
        if attempt == _MAX_ROUNDS:
            current = np.where(is_open, captured, current)
        else:
            # A search also changes the positions before and after those that it penalises.
            is_inner = ~dilate(~is_open)
            inner = np.where(is_inner, above, 0.0)
            current = search_again(trellis, penalties, current, inner, _LIMIT_FACTOR)
        donors = np.where(is_open, current, first)
        found = _measure(defects, donors, windows)
        is_feasible = defects.has_feasible_seams(donors)
        for (start, stop), own in zip(windows, found, strict=True):
            inside = own[min(start, 1) :][: stop - start]
            above[start:stop] = excess(inside.max(axis=1))
            total = _total_excess(own)
            if (
                total < least[start, stop]
                and defects.is_better(own, (start, stop))
                and is_feasible[max(start - 1, 0) : stop].all()
            ):
                least[start, stop] = total
                best[start:stop] = current[start:stop]
    return best


def _measure(defects: _Defects, donors: IntArray, windows: Sequence[_Window]) -> list[FloatArray]:
    """Return the defect amounts if the group has the donor sequence `donors`.

    Each array has those of a window, and of the positions just before and just after it.
    """
    assembly, group = defects.assembly, defects.measure.group
    problem, n = assembly.problem, len(donors)
    chosen = {**assembly.donors, group: donors}
    if problem.root_group is not None:
        # A root's transform accumulates from the start.
        whole = [Excerpt(chosen, 0, n)]
        (amounts,) = defects.measure.amounts(assemble_excerpts(problem, whole), whole)
        return [_around(amounts, window) for window in windows]
    excerpts = [
        Excerpt(chosen, max(start - _MARGIN, 0), min(stop + _MARGIN, n)) for start, stop in windows
    ]
    measured = defects.measure.amounts(assemble_excerpts(problem, excerpts), excerpts)
    return [
        _around(own, (start - excerpt.first, stop - excerpt.first))
        for own, excerpt, (start, stop) in zip(measured, excerpts, windows, strict=True)
    ]


def _keep_better(before: _Defects, donors: IntArray) -> _Defects:
    """Replace the donors in the windows where this reduces the defects; return the resulting ones.

    A window keeps its old donors if its defects do not become smaller or a constraint is violated
    more. After `_MAX_ASSEMBLIES` attempts without an acceptable motion, all windows do.
    """
    for _ in range(_MAX_ASSEMBLIES):
        is_changed = donors != before.donors
        changed = [own for own in before.windows if is_changed[slice(*own)].any()]
        if not changed:
            break
        assembly = before.assembly.replace_donors(before.measure.group, donors)
        after = before.measured_in(assembly)
        reverted = [
            own for own in changed if not before.is_better(_around(after.amounts, own), own)
        ]
        if not reverted:
            broken = before.broken_frames(assembly)
            if not broken:
                return after
            reverted = [own for own in changed if before.overlaps(own, broken)] or changed
        donors = donors.copy()
        for start, stop in reverted:
            donors[start:stop] = before.donors[start:stop]
    return before


def _worst(defects: Mapping[str, _Defects]) -> float:
    return max(own.worst for own in defects.values())


def _around(amounts: FloatArray, window: _Window) -> FloatArray:
    """Return the amounts in a window, and at the positions just before and just after it."""
    start, stop = window
    return amounts[max(start - 1, 0) : stop + 1]


def _total_excess(amounts: FloatArray) -> float:
    return float(excess(amounts.max(axis=1)).sum())
