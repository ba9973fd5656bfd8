"""Donor spans: parts of clips, between any two frames, that replace a range of a motion."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.cancel import check_cancelled
from mograft.blend.foot_planting import plant_feet
from mograft.blend.loop_join import close_join
from mograft.blend.recombine import recombine, splice
from mograft.blend.transplant import GraftedGroup, transplant
from mograft.body.anatomy import feature_joints
from mograft.body.contacts import detect_contacts, find_legs
from mograft.body.groups import OTHER_BASE, PRESETS, JointGroups
from mograft.errors import join_names, suggest_name
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.search.boundary_states import pose_gaps, velocity_gaps
from mograft.search.constraints import Span, overlaps
from mograft.search.copies import COPY_ANGLE
from mograft.search.costs import INFEASIBLE_PENALTY
from mograft.search.donor_constraints import Ban, MaxStretch, NotFrom, OnlyFrom
from mograft.solve.finish import plants_feet
from mograft.solve.search_problem import SearchProblem

_N_SAMPLES = 8  # poses at which a span is compared with the range
_N_LENGTHS = 7  # lengths that are tried, from the shortest to the longest
MAX_RATIO = 3.0
"""The greatest ratio of the lengths of a span and the range that it replaces."""

DISTINCT_ANGLE = np.radians(15.0)
"""Spans that differ from the present part by less, in the mean of all joints, come last."""

_PENALTY = 1e6  # above the cost of any span that is not excluded


@dataclass(frozen=True)
class DonorSpan:
    """A part of a clip, `clip` being its index in the library; both frames are included."""

    clip: int
    start: int
    stop: int
    cost: float = 0.0
    is_held: bool = False  # whether it holds to the ends of a loop, which are not closed


@dataclass(frozen=True, eq=False)
class ChangedPart:
    """The joints that a change moves: an exchanged group, or one body part of it."""

    group: str  # the exchanged group
    spec: GraftedGroup

    @classmethod
    def find(cls, problem: SearchProblem, name: str) -> "ChangedPart":
        """Return the exchanged group with a name, or the group of a preset within one.

        Raise ValueError if there is none.
        """
        skeleton, names = problem.base.skeleton, list(problem.pools)
        if name in names:
            return cls(name, problem.group_specs[name])
        for preset in PRESETS:
            try:
                groups = JointGroups.preset(preset, skeleton).resolve(skeleton)
            except ValueError:  # the skeleton lacks a body part
                continue
            names += [own for own in groups if own not in names]
            for group, spec in problem.group_specs.items():
                if name in groups and np.isin(groups[name], spec.whole_joints).all():
                    return cls(group, replace(spec, joints=groups[name], held={}))
        base = problem.library.groups.base
        hint = f"; the base group {base!r} keeps its motion; {OTHER_BASE}"
        known = "" if name in (base, *names) else ", which is no name of a group or part"
        raise ValueError(
            f"`group` must be an exchanged group, one of {join_names(list(problem.pools))}, or a "
            f"body part within one; got {name!r}{suggest_name(name, names) or known + hint}"
        )


def find_donor_spans(
    problem: SearchProblem,
    motion: Motion,
    part: ChangedPart,
    frames: Span,
    within: Sequence[int] | None = None,
    present: Collection[int] = (),
) -> Iterator[DonorSpan]:
    """Yield the spans that can replace a part in a range of frames of a motion, cheapest first.

    `within` has the indices of the clips that may donate. By default all clips donate, and spans
    in which the part moves as in the motion or its base, spans around the range itself, and those
    with seams wider than `Config.max_angle` are left out. Then spans that differ from the motion
    by `DISTINCT_ANGLE` come before others, and of both, those of clips that are not in `present`
    come first. The cost is that of `CostModel`, with the seams at the ends of the range, the mean
    angle of the base part instead of distances in the embedding, and the pose difference to the
    range. Spans of one clip that overlap by more than half are one: the cheapest. Spans are as long
    as the range up to `Config.max_stretch`; a clip that is shorter is taken as a whole.
    """
    range_ = _Range(problem, motion, part, frames)
    found = []
    for clip in within or range(len(problem.library.clips)):
        check_cancelled()
        starts, stops, costs = range_.compare(clip, accept_same=within is not None)
        costs += _PENALTY * (clip in present)
        for index in _pick(starts, stops, costs):
            ends = int(starts[index]), int(stops[index])
            found.append(DonorSpan(clip, *ends, float(costs[index]), is_held=within is not None))
    yield from sorted(found, key=lambda own: (own.cost, own.clip, own.start))


def _pick(starts: IntArray, stops: IntArray, costs: FloatArray) -> Iterator[int]:
    """Yield the indices of spans, cheapest first, that overlap no earlier one by over a half."""
    is_left = np.isfinite(costs)
    for index in np.argsort(costs, kind="stable").tolist():
        if is_left[index]:
            yield index
            shared = np.minimum(stops, stops[index]) - np.maximum(starts, starts[index])
            is_left &= shared * 2 <= np.minimum(stops - starts, stops[index] - starts[index])


class _Range:
    """A range of a motion with which spans of clips are compared."""

    def __init__(
        self, problem: SearchProblem, motion: Motion, part: ChangedPart, frames: Span
    ) -> None:
        self.problem, self.group, self.frames = problem, part.group, frames
        library = problem.library
        whole = part.spec.whole_joints
        self.joints = np.setdiff1d(feature_joints(library.skeleton, whole), [library.root])
        self.n = frames[1] - frames[0]
        samples = frames[0] + np.round(np.linspace(0.0, self.n, _N_SAMPLES)).astype(np.int64)
        # Of the motion, and of the base, which is no more new.
        self.parts = [own.rotations[samples][:, self.joints] for own in (motion, problem.base)]
        self.base_part = motion.rotations[samples][:, problem.base_joints]
        ends = [max(frames[0] - 1, 0), min(frames[1], motion.n_frames - 2)]
        self.speeds = _speeds(motion, self.joints)[ends]

    def compare(self, clip: int, *, accept_same: bool) -> tuple[IntArray, IntArray, FloatArray]:
        """Return first frames, last frames and costs of the spans of a clip, each (n_spans,).

        The cost is infinite where constraints or faults exclude a span.
        """
        motion = self.problem.library.clips[clip]
        longest, stretch = motion.n_frames - 1, self.problem.config.max_stretch
        wanted = np.round(self.n * np.linspace(1.0 - stretch, 1.0 + stretch, _N_LENGTHS))
        lengths = np.unique(wanted[(wanted >= 1) & (wanted <= longest)].astype(np.int64))
        if not len(lengths) and longest >= max(self.n / MAX_RATIO, 1):
            lengths = np.array([longest])
        spans = [
            np.stack([own := np.arange(longest - n + 1), own + n], axis=1) for n in lengths.tolist()
        ]
        starts, stops = np.concatenate([np.zeros((0, 2), np.int64), *spans]).T
        if not len(starts):
            return starts, stops, np.zeros(0)
        costs = self._costs(motion, starts, stops, accept_same=accept_same)
        costs[self._is_excluded(clip, starts, stops)] = np.inf
        if not accept_same and motion.name == self.problem.base.name:
            shared = np.minimum(stops, self.frames[1]) - np.maximum(starts, self.frames[0])
            costs[shared * 2 > self.n] = np.inf
        return starts, stops, costs

    def _costs(
        self, motion: Motion, starts: IntArray, stops: IntArray, *, accept_same: bool
    ) -> FloatArray:
        model = self.problem.cost_models[self.group]
        poses = motion.rotations[:, self.joints]
        gaps, captured_gaps = (pose_gaps(own, poses) for own in self.parts)
        speeds = _speeds(motion, self.joints)
        shares = np.linspace(0.0, 1.0, _N_SAMPLES)
        # (n_samples, n_spans): the frames of the clip that are compared with those of the range.
        frames = np.round(starts + shares[:, None] * (stops - starts)).astype(np.int64)
        rows = np.arange(_N_SAMPLES)[:, None]
        differences = gaps[rows, frames].mean(axis=0)
        distances = np.zeros(len(starts))
        base_joints = self.problem.base_joints
        if len(base_joints):
            base_gaps = pose_gaps(self.base_part, motion.rotations[:, base_joints])
            distances = base_gaps[rows, frames].mean(axis=0) / model.scales.angle
        n, is_same = np.full(len(starts), self.n), np.zeros(len(starts), bool)
        costs = model.unary(n, stops - starts, distances, is_same) + model.similarity(differences)
        for side, seams, steps in ((0, starts, starts), (-1, stops, stops - 1)):
            velocities = velocity_gaps(self.speeds[[side]], speeds)[0]
            costs += model.pairwise(gaps[side, seams], velocities[steps])
        if not accept_same:
            is_known = captured_gaps[rows, frames].mean(axis=0) < COPY_ANGLE
            is_known |= differences < COPY_ANGLE
            costs[is_known | (costs >= INFEASIBLE_PENALTY)] = np.inf
            costs[differences < DISTINCT_ANGLE] += 2.0 * _PENALTY
        return costs

    def _is_excluded(self, clip: int, starts: IntArray, stops: IntArray) -> BoolArray:
        """Return which spans contain a recording fault, or violate a constraint on donors."""
        library, problem = self.problem.library, self.problem
        own = library.segments.of_clip(clip)
        is_faulty = np.zeros(library.clips[clip].n_frames + 1, bool)
        for segment in own[~problem.pools[self.group].is_donor[own]].tolist():
            is_faulty[library.segments.start[segment] : library.segments.stop[segment] + 1] = True
        count = np.concatenate([[0], np.cumsum(is_faulty)])
        excluded = count[stops + 1] > count[starts]
        spans = Segments(starts, stops, np.full(len(starts), clip))
        base = Segments(*(np.full(len(starts), value) for value in (*self.frames, -1)))
        for constraint in problem.constraints:
            is_rule = isinstance(constraint, OnlyFrom | NotFrom | MaxStretch | Ban)
            if is_rule and constraint.is_hard and constraint.applies_to_group(self.group):
                errors = constraint.donor_errors(base, spans, library.entries)
                excluded |= (errors > 1.0) & overlaps(base, constraint.frames)
        return excluded


def _speeds(motion: Motion, joints: IntArray) -> FloatArray:
    """Return angular velocities from each frame to the next, (n_frames - 1, n_joints, 3)."""
    quats = motion.rotations[:, joints]
    steps = rotations.multiply(rotations.inverse(quats[:-1]), quats[1:])
    return rotations.log(steps) * motion.rate


def insert_span(
    problem: SearchProblem, motion: Motion, part: ChangedPart, frames: Span, span: DonorSpan
) -> Motion:
    """Return a motion in which a part moves as in a donor span in a range of frames.

    The span is stretched to the length of the range. The seams at both ends are closed within the
    range: in `Config.seam_blend` seconds, or a quarter of the range if that is shorter. An eighth
    is enough if the captured part is put back. At the ends of the motion there is no seam; in a
    loop, only if the span holds to them or the range is the whole loop, which is then closed. All
    other frames are those of `motion`, bit for bit, except for a root that the part contains; see
    `splice`.
    """
    library, last, rate = problem.library, motion.n_frames - 1, motion.rate
    (first, stop), n = frames, frames[1] - frames[0]
    is_captured = (
        library.names[span.clip] == problem.base.name and (span.start, span.stop) == frames
    )
    blend = min(problem.config.seam_blend, n / (8.0 if is_captured else 4.0) / rate)
    config = replace(problem.config, seam_blend=blend)
    # The seam is as far inside as it changes frames.
    inset = min(int(np.ceil(blend * rate)), (n - 1) // 2)
    is_whole = frames == (0, last)
    is_closed = problem.is_loop and (not span.is_held or problem.config.loop == "on")
    has_seams = is_closed and not is_whole
    begin = first if first == 0 and not has_seams else first + inset
    end = stop if stop == last and not has_seams else stop - inset
    ratio = (span.stop - span.start) / n
    taken = [span.start + round((frame - first) * ratio) for frame in (begin, end)]
    bounds = sorted({0, begin, end, last})
    cut = Segments(*np.array(list(pairwise(bounds))).T)
    is_new = cut.start == begin
    donors = Segments(
        np.where(is_new, taken[0], cut.start),
        np.where(is_new, max(taken[1], taken[0] + 1), cut.stop),
        is_new.astype(np.int64),
    )
    clip = library.clips[span.clip]
    made = transplant(motion, cut, donors, [motion, clip], part.spec, config)
    made = close_join(made, rate, blend) if is_closed and is_whole else made
    new = recombine(motion, [made], motion.name)
    at = np.arange(motion.n_frames)
    is_inside = (at >= first) & (at <= stop)
    # Corrections of the feet fade outside of their contacts.
    new = _plant_feet(problem, new, part, frames, span, (at >= begin) & (at <= end))
    moving = [library.root] if library.root in part.spec.whole_joints else []
    return splice(motion, new, is_inside, problem.base_poses.height, moving)


def _plant_feet(
    problem: SearchProblem,
    motion: Motion,
    part: ChangedPart,
    frames: Span,
    span: DonorSpan,
    near: BoolArray,
) -> Motion:
    """Plant the feet that a part drives in their contacts of the new motion and of the span.

    Only contacts in the frames `near`, a mask of shape (n_frames,), count.
    """
    library, joints = problem.library, set(part.spec.whole_joints.tolist())
    if not plants_feet(library, joints):
        return motion
    contacts = detect_contacts(motion)
    at = np.linspace(span.start, span.stop, frames[1] - frames[0] + 1).round().astype(np.int64)
    captured = detect_contacts(library.clips[span.clip])[at]
    for index, leg in enumerate(find_legs(motion.skeleton)):
        if leg.ankle in joints:
            contacts[frames[0] : frames[1] + 1, index] |= captured[:, index]
    return plant_feet(
        motion,
        contacts & near[:, None, None],
        movable_legs=problem.movable_legs,
        move_root=library.root in joints,
        floor_reference=problem.base,
    )[0]
