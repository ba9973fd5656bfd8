"""`Stream`: grafts on a base motion that is still growing, committed segment by segment."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray
from mograft._util.validate import as_integer, check_type
from mograft.analysis.segmentation import OnlineSegmenter
from mograft.blend.recombine import Part, recombine
from mograft.body.capsules import Poses
from mograft.body.contacts import find_legs
from mograft.config import Config
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.motion.skeleton import Skeleton
from mograft.search.constraints import Clip, Constraint, Violation, find_violations
from mograft.search.donor_constraints import Ban, Use, find_seam_violations
from mograft.solve.plan import grafted_groups
from mograft.solve.search_problem import check_constraints
from mograft.stream.base_buffer import BaseBuffer, check_frames, join_motions, motion_from_arrays
from mograft.stream.search import ChosenDonor, PendingSegment, StreamSearch
from mograft.synthesis.graft_result import Substitution

DELAY = 1.2
"""Default of `Stream`'s `delay`, in seconds; docs/howto/live.md has the delays of other values."""


@dataclass(frozen=True, eq=False)
class StreamPiece:
    """A committed segment of a stream, as `Stream.advance` and `Stream.pieces` return it.

    All frames are numbered from the first pushed frame. Successive pieces have successive frames:
    the first piece starts at frame 0, every other one at the `stop` of the previous piece plus 1.

    Attributes
    ----------
    motion : Motion
        The new motion in the frames `start` to `stop`.
    start, stop : int
        First and last frame of `motion`, both included.
    substitutions : tuple of Substitution
        The donor of each grafted group. Their `start` and `stop` are those of the base segment:
        neighbouring segments share a frame, so that a segment starts at the last frame of the
        previous piece. The numbers of base segments continue those of the library's segments.
        `gap_after` is NaN, because the next donor is not known yet.
    violations : tuple of Violation
        Violations of hard constraints in these frames and at the seam before them.
    """

    motion: Motion
    start: int
    stop: int
    substitutions: tuple[Substitution, ...]
    violations: tuple[Violation, ...]


def join_pieces(pieces: Sequence[StreamPiece], name: str = "stream") -> Motion:
    """Join one or more successive pieces to one motion."""
    return join_motions([piece.motion for piece in pieces], name)


class Stream:
    """Graft a base motion that is still growing.

    Push frames of the base as they arrive. The stream cuts the base into segments. As soon as
    `horizon` segments are known, or the first frame has waited for `delay` seconds, it chooses a
    donor sequence for the segments that are known and commits the first donor. Committed frames
    never change: a seam changes only the frames after it.

    Parameters
    ----------
    library : Library
        The library whose segments are the donors. Clips of a stored library are read on demand.
    swap : sequence of str, optional
        The joint groups to replace, as for `graft`. They must not contain the root or legs.
    constraints : sequence of Constraint, optional
        Constraints on the segments that are not committed yet; can be changed at any time.
        Frames count from the first pushed frame.
    seed : int
        Seed of the random choices of ``Config(choice="sample")`` and "random".
    horizon : int
        Greatest number of segments that are planned ahead. A larger horizon gives cheaper donor
        sequences and a longer delay. With 1, only the cost of each donor and of its seam with the
        previous one counts.
    delay : float
        Time in seconds that the first frame of a segment waits for later segments, at most. A
        segment that is longer is committed as soon as its end is known. ``math.inf`` always waits
        for `horizon` segments.

    Raises
    ------
    TypeError
        If an item of `constraints` is not a constraint.
    ValueError
        If `swap` names an unknown group, the base group, or a group that contains legs, the root or
        single channels; if `horizon` is below 1; if the library's `Config.segmentation` needs later
        frames; or if a constraint names an unknown joint or clip.

    Notes
    -----
    With `Config.seam` "gradient" and a `horizon` of at least 2, the donor of the next segment is
    chosen together with that of the committed one, and the committed frames are fitted to both.
    This does not apply to segments with constraints on poses, because these are evaluated before
    the next donor is known, nor to the last one; they have the treatment "inertial", which changes
    only frames after a seam. A stream replaces the other treatments by "inertial", and
    `Config.torso` by "pelvis": the other value smooths the motion of the base over later frames.
    Translations are those of the base.

    ``Config(choice="random")`` draws uniformly from the donor sequences within the limits, among
    the `max_candidates` cheapest candidates of each segment.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library, base = Library.build(dance(strides=1).motion), dance(seed=1, strides=1).motion
    >>> stream = Stream(library, seed=7)
    >>> pieces = []
    >>> for first in range(0, base.n_frames, 10):
    ...     stream.push(base[first : first + 10])
    ...     pieces += stream.pieces()
    >>> stream.close()
    >>> pieces += stream.pieces()
    >>> join_pieces(pieces).n_frames == base.n_frames
    True
    """

    def __init__(
        self,
        library: Library,
        *,
        swap: Sequence[str] | None = None,
        constraints: Sequence[Constraint] = (),
        seed: int = 0,
        horizon: int = 8,
        delay: float = DELAY,
    ) -> None:
        horizon, seed = as_integer("horizon", horizon, 1), as_integer("seed", seed)
        if isinstance(delay, bool) or not isinstance(delay, int | float) or not delay >= 0:
            raise ValueError(f"`delay` must be at least 0 seconds, got {delay!r}")
        check_type("library", library, Library)
        groups = grafted_groups(library, swap)
        check_stream_config(library.config)
        check_stream_groups(library, groups)
        self._library, self._horizon, self._delay = library, horizon, float(delay)
        self._rng = np.random.default_rng(seed)
        self._search = StreamSearch(library, groups)
        self._segmenter = OnlineSegmenter(library.rate, library.config)
        self._base: BaseBuffer | None = None
        self._last_rotations: FloatArray | None = None
        self._n_committed = 0
        self._is_closed = False
        self.constraints = constraints

    def __repr__(self) -> str:
        return f"Stream({self._library}, {self._n_committed} segments committed)"

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """The constraints on all segments that are not committed yet.

        Setting a constraint whose `frames` are all before `first_free_frame` raises ValueError,
        unless it was set before.
        """
        return self._search.constraints

    @constraints.setter
    def constraints(self, constraints: Sequence[Constraint]) -> None:
        check_stream_constraints(constraints, self._skeleton, self._search.clips)
        free = self.first_free_frame
        for own in constraints:
            if own.frames is not None and own.frames[1] < free and own not in self.constraints:
                found = f"{type(own).__name__} up to frame {own.frames[1]}"
                expected = f"the first free frame, {free}, or later"
                raise ValueError(f"`constraints` must apply to {expected}, got {found}")
        self._search.set_constraints(constraints)

    @property
    def groups(self) -> tuple[str, ...]:
        """The joint groups that are replaced, in the order in which donors are chosen."""
        return tuple(self._search.joints)

    @property
    def first_free_frame(self) -> int:
        """The first frame that no piece contains yet, counted from the first pushed frame.

        Constraints and donors of the frames before it cannot change any more.
        """
        return self._segmenter.bounds[0] + 1 if self._n_committed else 0

    @property
    def n_known(self) -> int:
        """Number of frames of the base that have been pushed."""
        return 0 if self._base is None else self._base.n_frames

    def push(self, frames: Motion | npt.ArrayLike, positions: npt.ArrayLike | None = None) -> None:
        """Append the next frames of the base.

        Parameters
        ----------
        frames : Motion, or array_like of shape (n_frames, n_joints, 4)
            One or more frames, as a motion with the library's hierarchy and frame rate, or as
            local rotations of all joints: unit quaternions, xyzw, in the order of
            ``library.skeleton.names``, at the library's frame rate. An array of shape
            (n_joints, 4) is one frame.
        positions : array_like, shape (n_frames, n_joints, 3) or (n_frames, 3)
            With an array of rotations, the local translations of all joints in the unit of the
            library, or only those of the joint ``library.root``. The other joints then have the
            offsets of the skeleton. If `frames` is an array of one frame, the first axis is missing
            here, too.

        Raises
        ------
        SkeletonMismatchError
            If the hierarchy differs from the library's.
        TypeError
            If `positions` are missing beside an array, or given beside a motion.
        ValueError
            If the rate differs from the library's, the skeleton differs from that of the frames
            before, an array has another shape, is not finite or holds quaternions whose norm is
            not 1, or the stream is closed. The frames before stay valid.

        Examples
        --------
        >>> from mograft.dancer import dance
        >>> library, base = Library.build(dance(strides=1).motion), dance(seed=1, strides=1).motion
        >>> stream = Stream(library)
        >>> stream.push(base.rotations[:2], base.positions[:2])
        >>> stream.push(base.rotations[2], base.positions[2, library.root])
        >>> stream.n_known
        3
        """
        if self._is_closed:
            raise ValueError("`frames` must be pushed before the stream is closed")
        if not isinstance(frames, Motion):
            frames = motion_from_arrays(frames, positions, self._library, self._skeleton)
        elif positions is not None:
            raise TypeError("`positions` must be None if `frames` is a motion")
        check_frames(frames, self._library, None if self._base is None else self._base.skeleton)
        if self._base is None:
            self._base = BaseBuffer(frames, self._library.up)
        else:
            self._base.push(frames)
        # The energy of the last frame is not final before the next frame.
        n_known, n_final = self._segmenter.n_frames, self._base.n_frames - 1
        if n_final > n_known:
            energies = self._base.next_energies(self._library.config)
            self._segmenter.push(energies[: n_final - n_known])

    @property
    def _skeleton(self) -> Skeleton:
        """The skeleton of the base, or that of the library before frames are pushed."""
        return (self._library if self._base is None else self._base).skeleton

    def close(self) -> None:
        """Declare the base motion complete, so that all remaining segments can be committed.

        Raises
        ------
        ValueError
            If fewer than 2 frames have been pushed.
        """
        if self._is_closed:
            return
        if self._base is None or self._base.n_frames < 2:
            raise ValueError(f"a stream needs at least 2 frames, got {self.n_known}")
        self._segmenter.push(self._base.next_energies(self._library.config))
        self._segmenter.close()
        self._is_closed = True

    def pieces(self) -> list[StreamPiece]:
        """Commit segments with `advance` until it returns None; return their pieces."""
        return list(iter(self.advance, None))

    def advance(self) -> StreamPiece | None:
        """Commit the next segment.

        Returns
        -------
        StreamPiece or None
            The segment; None if fewer than `horizon` segments are known, the first frame has
            waited for less than `delay` seconds, and the stream is not closed; also None if all
            segments are committed.
        """
        bounds, known_at = self._segmenter.bounds, self._segmenter.known_at
        if len(bounds) < 2:
            return None
        # Segments that become known later do not count, so that pushes of any size give the same.
        latest = max(bounds[0] + self._delay * self._library.rate, known_at[1])
        n_known = min(bisect_right(known_at, latest) - 1, self._horizon)
        is_due = n_known == self._horizon or self._segmenter.n_frames >= latest
        if not is_due and not self._is_closed:
            return None
        assert self._base is not None
        for start, stop in pairwise(bounds[len(self._search.pending) : n_known + 1]):
            self._search.add_segment(self._base, start, stop)
        piece = self._commit(self._search.pending[0])
        del bounds[0], known_at[0]
        self._n_committed += 1
        self._base.discard_before(bounds[0])
        return piece

    def _commit(self, segment: PendingSegment) -> StreamPiece:
        """Choose donors for the first pending segment, and return its piece."""
        chosen, poses = self._search.commit_first(self._rng)
        # The first frame belongs to the previous piece.
        new = slice(1 if self._n_committed else 0, None)
        base = segment.base[segment.offset + new.start : segment.rows.stop]
        substitutions, violations, parts = [], [], []
        for group, own in chosen.items():
            substitutions.append(self._substitution(segment, group, own))
            violations += find_seam_violations(self.constraints, group, [segment.start], [own.gap])
            joints = self._search.joints[group]
            parts.append(Part(joints, own.placed.frames[new], base.positions[:, joints]))
        motion = self._with_continuous_signs(recombine(base, parts, base.name))
        if poses is not None:
            violations += find_violations(segment.pose_constraints, poses[new])
        return StreamPiece(
            motion=motion,
            start=segment.start + new.start,
            stop=segment.stop,
            substitutions=tuple(substitutions),
            violations=tuple(violations),
        )

    def _substitution(
        self, segment: PendingSegment, group: str, chosen: ChosenDonor
    ) -> Substitution:
        segments, donor = self._library.segments, int(segment.donors[chosen.index])
        base_segment = len(segments) + self._n_committed
        if donor < 0:
            donor, donor_start, donor_stop = base_segment, segment.start, segment.stop
            clip = segment.base.name or "the base"
        else:
            donor_start, donor_stop = int(segments.start[donor]), int(segments.stop[donor])
            clip = self._search.clips[segments.clip[donor]].name
        return Substitution(
            group=group,
            start=segment.start,
            stop=segment.stop,
            segment=base_segment,
            donor=donor,
            clip=clip,
            donor_start=donor_start,
            donor_stop=donor_stop,
            stretch=segment.length / (donor_stop - donor_start) - 1.0,
            cost=float(segment.groups[group].unary_costs[chosen.index]),
            gap_before=chosen.gap,
            gap_after=float("nan"),
        )

    def _with_continuous_signs(self, motion: Motion) -> Motion:
        """Choose the signs of quaternions so that they continue the previous piece."""
        quaternions = motion.rotations.copy()
        if self._last_rotations is not None:
            is_opposite = np.einsum("ji,ji->j", quaternions[0], self._last_rotations) < 0
            quaternions[:, is_opposite] *= -1.0
        self._last_rotations = quaternions[-1]
        return replace(motion, rotations=quaternions)


def check_stream_config(config: Config) -> None:
    """Raise ValueError for settings that a stream does not support."""
    if config.segmentation != "energy":
        got = repr(config.segmentation)
        raise ValueError(f"`Config.segmentation` must be 'energy' in a stream, got {got}")


def check_stream_groups(library: Library, groups: Sequence[str]) -> None:
    """Raise ValueError for groups that contain single channels, the root or joints of legs."""
    divided = library.groups.divided_channels(library.skeleton)
    legs = find_legs(library.skeleton)
    kept = {library.root, *(joint for leg in legs for joint in (leg.hip, leg.knee, leg.ankle))}
    for group in groups:
        if divided[group]:
            joints = ", ".join(library.skeleton.names[joint] for joint in divided[group])
            found = f"{group!r} with single channels of {joints}"
            raise ValueError(f"`swap` must name groups of whole joints in a stream, got {found}")
        if not kept.isdisjoint(library.joints(group).tolist()):
            raise ValueError(f"`swap` must not name the root or legs in a stream, got {group!r}")


def check_stream_constraints(
    constraints: Sequence[Constraint], skeleton: Skeleton, clips: Sequence[Clip]
) -> None:
    """Check the types of constraints, and the joints and clips that they name.

    Raise TypeError for an item that is not a constraint, ValueError for an unknown joint or clip.
    """
    identity = np.tile(rotations.IDENTITY, (1, skeleton.n_joints, 1))
    rest = Motion(skeleton, 1.0, identity, skeleton.offsets[None])
    check_constraints(constraints, Poses.from_motion(rest))
    no_segments = Segments(np.zeros(0, np.int64), np.zeros(0, np.int64))
    for constraint in constraints:
        name = type(constraint).__name__
        if isinstance(constraint, Use | Ban):
            raise ValueError(f"`constraints` of a stream must not contain {name}: use NotFrom")
        if not constraint.applies_to_group(""):
            raise ValueError(f"`constraints` of a stream must have no group, got {name} with one")
        constraint.donor_errors(no_segments, no_segments, clips)
