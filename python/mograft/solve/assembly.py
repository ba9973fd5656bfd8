"""Motions assembled from donor sequences, and how far they violate hard constraints."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.blend.loop_join import close_join
from mograft.blend.recombine import Part, recombine
from mograft.blend.transplant import seam_reach, transplant
from mograft.body.capsules import Poses
from mograft.motion.motion import Motion, select_frames
from mograft.motion.segments import Segments
from mograft.search.costs import excess
from mograft.search.trellis import DonorSequences
from mograft.solve.search_problem import SearchProblem


def transplant_group(
    problem: SearchProblem,
    group: str,
    base: Motion,
    base_segments: Segments,
    donors: IntArray,
    frames: IntArray | None = None,
) -> Part:
    """Return the motion of a group in which donors replace the segments of a base motion.

    `base_segments` are the segments of `base`; `donors` has one donor for each. Seams are treated.
    `base` consists of the frames `frames` of the problem's base, by default of all frames.
    """
    library, lean = problem.library, problem.trunk_leans[group]
    return transplant(
        base,
        base_segments,
        library.segments[donors],
        library.clips,
        problem.group_specs[group],
        library.config,
        lean if frames is None else lean.at(frames),
    )


@dataclass(frozen=True, eq=False)
class Excerpt:
    """The positions `first` to `stop` - 1 of donor sequences."""

    donors: DonorSequences
    first: int
    stop: int

    def donors_of(self, group: str) -> IntArray:
        """Return the donors of a group at these positions."""
        return self.donors[group][self.first : self.stop]


@dataclass(frozen=True, eq=False)
class Assembly:
    """The motion that results from donor sequences, before feet are planted."""

    problem: SearchProblem
    donors: DonorSequences
    motion: Motion
    parts: Mapping[str, Part]  # of each grafted group

    @classmethod
    def build(
        cls,
        problem: SearchProblem,
        donors: DonorSequences,
        name: str,
        known: Mapping[str, Part] | None = None,
    ) -> "Assembly":
        """Assemble donor sequences; `known` has the parts of groups that are known already."""
        parts = dict(known or {})
        base, segments = problem.base, problem.base_segments
        for group, sequence in donors.items():
            if group not in parts:
                part = transplant_group(problem, group, base, segments, sequence)
                if problem.is_loop and (sequence != problem.scenario)[[0, -1]].any():
                    part = close_join(part, base.rate, problem.config.seam_blend)
                parts[group] = part
        motion = recombine(problem.base, [parts[group] for group in donors], name)
        return cls(problem, donors, motion, parts)

    @property
    def seams(self) -> dict[str, IntArray]:
        """The frames of the seams of each grafted group."""
        return {group: self.parts[group].seams for group in self.donors}

    def replace_donors(self, group: str, donors: IntArray) -> "Assembly":
        """Return a new assembly in which one group has the donor sequence `donors`."""
        known = {name: part for name, part in self.parts.items() if name != group}
        chosen = {**self.donors, group: donors}
        return Assembly.build(self.problem, chosen, self.motion.name, known)


def assemble(problem: SearchProblem, donors: DonorSequences) -> Motion:
    """Return the motion of donor sequences; groups without one keep the motion of the base."""
    return assemble_excerpts(problem, [Excerpt(donors, 0, len(problem.base_segments))])


def pose_excess(problem: SearchProblem, poses: Poses) -> FloatArray:
    """Return by how many tolerances each pose violates hard constraints, shape (n,).

    It is the sum over the grafted groups of max(0, greatest violation amount - 1).
    """
    each = (_joint_excess(problem, poses, own) for own in problem.driven_joints.values())
    return sum(each, np.zeros(len(poses)))


def donor_excess(problem: SearchProblem, donors: DonorSequences) -> dict[str, FloatArray]:
    """Return by how many tolerances the motion of donor sequences violates hard constraints.

    The result has an array of shape (n_frames,) for each group: max(0, greatest violation amount
    - 1) in each frame.
    """
    excesses = donor_excesses(problem, [donors], 0, len(problem.base_segments))
    return {group: own[0] for group, own in excesses.items()}


def donor_excesses(
    problem: SearchProblem, alternatives: Sequence[DonorSequences], first: int, stop: int
) -> dict[str, FloatArray]:
    """Evaluate `donor_excess` for several alternatives, in the positions `first` to `stop` - 1.

    For every group the result has an array of shape (n_alternatives, n_frames). The frames are
    those from the first frame of position `first` to the last frame of position `stop` - 1.
    """
    segments = problem.base_segments
    if not any(own.is_hard for own in problem.pose_constraints):
        n_frames = int(segments.stop[stop - 1] - segments.start[first]) + 1
        return {g: np.zeros((len(alternatives), n_frames)) for g in problem.driven_joints}
    if problem.root_group is not None and len(alternatives) > 1:
        each = [donor_excesses(problem, [donors], first, stop) for donors in alternatives]
        return {group: np.concatenate([own[group] for own in each]) for group in problem.pools}
    low, high = _seam_range(problem, first, stop)
    motion = assemble_excerpts(problem, [Excerpt(donors, low, high) for donors in alternatives])
    begin, end = int(segments.start[low]), int(segments.stop[high - 1])
    frames = np.tile(np.arange(begin, end + 1), len(alternatives))
    poses = problem.base_poses.with_poses(frames, *motion.world_transforms())
    wanted = slice(int(segments.start[first]) - begin, int(segments.stop[stop - 1]) - begin + 1)
    return {
        group: _joint_excess(problem, poses, joints).reshape(len(alternatives), -1)[:, wanted]
        for group, joints in problem.driven_joints.items()
    }


def _joint_excess(problem: SearchProblem, poses: Poses, joints: BoolArray) -> FloatArray:
    greatest = np.zeros(len(poses))
    for constraint in problem.constraints:
        if constraint.is_hard:
            greatest = np.maximum(greatest, constraint.errors(poses, joints)[0])
    return excess(greatest)


def assemble_excerpts(problem: SearchProblem, excerpts: Sequence[Excerpt]) -> Motion:
    """Assemble excerpts of donor sequences, and return their motions one after the other."""
    segments, base = problem.base_segments, problem.base
    cuts = [segments[own.first : own.stop] for own in excerpts]
    frames = [np.arange(own.start[0], own.stop[-1] + 1) for own in cuts]
    kept, begins = np.concatenate(frames), np.cumsum([0, *map(len, frames[:-1])])
    pairs = [(own, begin - own.start[0]) for own, begin in zip(cuts, begins, strict=True)]
    joined = Segments(
        np.concatenate([own.start + shift for own, shift in pairs]),
        np.concatenate([own.stop + shift for own, shift in pairs]),
    )
    motion = select_frames(base, kept, base.frame_time, has_channels=False)
    parts = []
    for group in problem.pools:
        chosen = [own.donors_of(group) for own in excerpts if group in own.donors]
        if chosen:
            donors = np.concatenate(chosen)
            parts.append(transplant_group(problem, group, motion, joined, donors, kept))
    return recombine(motion, parts, "")


def _seam_range(problem: SearchProblem, first: int, stop: int) -> tuple[int, int]:
    """Extend a range of positions by all positions whose donors can change frames in the range.

    If a grafted group contains the root, the result has all positions: the root transform depends
    on all earlier donors.
    """
    segments = problem.base_segments
    if problem.root_group is not None:
        return 0, len(segments)
    reach = int(np.ceil(seam_reach(problem.config) * problem.base.rate))
    start, end = segments.start[first], segments.stop[stop - 1]
    low = int(np.searchsorted(segments.start, start - reach, side="right")) - 1
    high = int(np.searchsorted(segments.stop, end + reach)) + 1
    return max(min(low, first - 2), 0), min(max(high, stop + 2), len(segments))
