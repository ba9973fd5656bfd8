"""Remarks about grafts: what was not exchanged, why, and which option helps."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import IntArray
from mograft.config import scale_of_variety
from mograft.library.library import Library
from mograft.search.costs import length_fits
from mograft.search.donor_constraints import OnlyFrom
from mograft.search.pose_constraints import Reach
from mograft.synthesis.graft import graft as make_graft
from mograft.synthesis.graft_result import Graft, Substitution, find_missing

_MAX_TRIED = 20_000  # frames

_REMEDIES = {
    "no similar segment": "{similar}add clips",
    "none of similar length": "raise `max_stretch` (now {max_stretch:.2f})",
    "only segments with recording faults": "correct the faults that mograft check lists",
    "only copies of the captured part": "add other clips",
    "none within the constraints": "relax the constraints",
}
"""The causes why a segment has no candidate, and what the user can do about each."""


def advise(graft: Graft, motions: Sequence[Sequence[Substitution]] = ()) -> list[str]:
    """Return remarks about segments that were not exchanged, and the options that help.

    Parameters
    ----------
    graft : Graft
        One of the grafts of a base.
    motions : sequence of sequence of Substitution
        `Graft.substitutions` of each of these grafts. Default: those of `graft`.

    Returns
    -------
    list of str
        One remark per line. Options have the names of `Config`, with "`variety`" for the argument
        of `Config.with_variety`.

    Examples
    --------
    >>> from mograft import Config, Library, graft
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion, config=Config(sigma_scale=1e-6))
    >>> advise(graft(library))[0]
    'warning: no segment was exchanged: no segment has a candidate'
    """
    if graft.remarks is not None:
        return list(graft.remarks)
    motions = motions or [graft.substitutions]
    lines: list[str] = []
    is_kept = np.ones(graft.base.n_frames - 1, bool)  # intervals between frames
    exchanged = [own for substitutions in motions for own in substitutions if not own.is_own]
    for substitution in exchanged:
        is_kept[substitution.start : substitution.stop] = False
    kept = float(is_kept.sum()) * graft.base.frame_time
    if not exchanged and graft.changes:
        return lines
    if not exchanged:
        lines.append(f"warning: no segment was exchanged: {_cause_of_no_exchange(graft)}")
    elif kept > 0 and graft.request.method != "repair":
        where = "the motion" if len(motions) == 1 else f"any of the {len(motions)} motions"
        total = graft.base.duration
        lines.append(f"in {kept:.1f} of {total:.1f} s no segment was exchanged in {where}")
    if graft.request.method == "repair":
        return lines  # Only segments near violations have other candidates.
    without = [group for group in graft.alternatives if find_missing(graft, group).any()]
    return [*lines, *(_describe_missing(graft, group) for group in without)]


def find_remedies(graft: Graft) -> list[str]:
    """Return what helps against the violations of a new graft: options, named as in `advise`.

    A `Reach` on a base of at most `_MAX_TRIED` frames is tried with the `Config.reach_ik` 1.
    """
    library, request, remedies = graft.library, graft.request, list[str]()
    if request.method == "repair":
        return remedies
    violated = [own.constraint for own in graft.violations]
    is_short = graft.base.n_frames <= _MAX_TRIED
    if is_short and library.config.reach_ik < 1.0 and any(isinstance(v, Reach) for v in violated):
        longer = library.relabelled(replace(library.config, reach_ik=1.0))
        names = ("constraints", "swap", "scenario")
        arguments = {name: getattr(request, name) for name in names}
        trial = make_graft(longer, request.base, seed=graft.seed, **arguments)
        result = "is not enough: place the target nearer" if trial.violations else "satisfies them"
        remedies.append(f"`reach_ik=1` {result}")
    if request.scenario is None and any(own.is_on_poses for own in violated):
        remedies.append("`only_violations` also tries less similar donors")
    if any(own.is_on_poses for own in violated):
        remedies.append("a target or obstacle elsewhere, or a larger tolerance (~TOL), may help")
    if any(isinstance(own, OnlyFrom) for own in violated):
        scale = library.config.sigma_scale
        is_usual = scale >= scale_of_variety(0.0)
        small = "" if is_usual else f"`sigma_scale={scale:g}` is small: "
        name = "`variety`" if is_usual else "value"
        remedies.append(f"{small}a larger {name} allows less similar donors")
    return remedies


def _cause_of_no_exchange(graft: Graft) -> str:
    if graft.request.method == "repair":
        return "the base satisfies the constraints, or no candidate satisfies them better"
    if all((counts == 0).all() for counts in graft.alternatives.values()):
        return "no segment has a candidate"
    if graft.self_repairs:
        return (
            "self-repair restored the captured parts, because all donors exceed the acceleration, "
            "jerk or floor depth of the base; `self_repair=False` keeps the exchanges"
        )
    return "the captured parts cost less than all candidates"


def _describe_missing(graft: Graft, group: str) -> str:
    """Return how many segments of a group have no candidate, with causes and remedies."""
    library, counts = graft.library, graft.alternatives[group]
    segments = np.array([own.segment for own in graft.substitutions if own.group == group])
    causes = Counter(_find_causes(library, group, segments[find_missing(graft, group)]))
    numbers = ", ".join(f"{n} {cause}" for cause, n in causes.most_common())
    config = library.config
    is_widest = config.sigma_scale >= scale_of_variety(1.0)
    similar = "" if is_widest else "raise `variety` or "
    remedies = ", ".join(
        _REMEDIES[cause].format(similar=similar, max_stretch=config.max_stretch)
        for cause, _ in causes.most_common()
    )
    return (
        f"{group}: {causes.total()} of {len(counts)} segments had no candidate "
        f"({numbers}): {remedies}"
    )


def _find_causes(library: Library, group: str, segments: IntArray) -> Iterator[str]:
    """Yield why each of `segments`, which all lack candidates, has none: a key of `_REMEDIES`."""
    pool, config, lengths = library.pool(group), library.config, library.segments.lengths
    for segment, members in zip(segments, pool.neighbours(segments, config), strict=True):
        others = members[members != segment]
        fitting = others[length_fits(lengths[[segment]], lengths[others], pool.rate, config)]
        donors = fitting[pool.is_donor[fitting]]
        if not len(others):
            yield "no similar segment"
        elif not len(fitting):
            yield "none of similar length"
        elif not len(donors):
            yield "only segments with recording faults"
        elif pool.are_copies(np.full(len(donors), segment), donors).all():
            yield "only copies of the captured part"
        else:
            yield "none within the constraints"
