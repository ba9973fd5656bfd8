"""Grafting while the base is still growing: segment by segment, and nothing is taken back."""

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.validate import as_integer, check_type
from mograft.analysis.embedding import features, normalise
from mograft.analysis.online_segmentation import OnlineSegmenter
from mograft.analysis.segmentation import Segments, kinetic_energy
from mograft.blend.recombine import Part, recombine
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.seams import PieceTimes, SeamBoundaries
from mograft.blend.value_spaces import ROTATIONS
from mograft.body.anatomy import feature_joints
from mograft.body.capsules import capsules
from mograft.body.contacts import find_legs
from mograft.body.mass import mass_model
from mograft.body.world_poses import Poses
from mograft.config import Config
from mograft.library.clusters import ClusterMembers
from mograft.library.ingest import boundary_states
from mograft.library.library import Library
from mograft.library.spec import rates_match
from mograft.motion import rotations
from mograft.motion.motion import Motion, world_transforms
from mograft.motion.resample import cubic
from mograft.motion.skeleton import Skeleton
from mograft.search.boundary_states import BoundaryStates
from mograft.search.constraints import Clip, Constraint, Violation, find_violations
from mograft.search.costs import (
    ConstraintViolations,
    CostModel,
    length_fits,
    limit_config,
    origin_violations,
    pose_violations,
)
from mograft.search.donor_choice import DONOR_CHOICES, cost_model
from mograft.search.donor_constraints import find_seam_violations
from mograft.search.pose_constraints import AvoidSelf, with_captured_depth
from mograft.search.viterbi import Trellis
from mograft.synthesis.graft_plan import grafted_groups
from mograft.synthesis.graft_result import Substitution
from mograft.synthesis.search_problem import check_constraints, driven_joints

__all__ = ["Piece", "Stream", "joined"]

_BESIDE = 2
"""Frames beside a segment that are kept: velocities at its ends depend on them."""
_MOMENT = 0.01
"""In frames: so long before a segment's end its speed there is measured."""
_DONORS_IN_HAND = 4096


@dataclass(frozen=True, eq=False)
class Piece:
    """What a stream has committed: a segment of the base with other parts.

    Attributes
    ----------
    motion : Motion
        Its frames: those after the last frame of the piece before, up to the segment's last.
    start, stop : int
        The segment's first and last frame in the base; the first is in the piece before,
        if there is one.
    substitutions : tuple of Substitution
        For every grafted group what took the segment's place, itself perhaps. The base counts
        as one more clip of the library, and its segments as further ones. What comes after is
        not known yet: `gap_after` is NaN.
    violations : tuple of Violation
        Hard constraints that these frames do not meet.
    """

    motion: Motion
    start: int
    stop: int
    substitutions: tuple[Substitution, ...]
    violations: tuple[Violation, ...]


def joined(pieces: Sequence[Piece], name: str = "stream") -> Motion:
    """Return successive pieces as one motion.

    Parameters
    ----------
    pieces : sequence of Piece
        At least one.
    name : str
        What to call it.

    Returns
    -------
    Motion
        All their frames.
    """
    motions = [piece.motion for piece in pieces]
    values = [m.channel_values for m in motions]
    return replace(
        motions[0],
        rotations=np.concatenate([m.rotations for m in motions]),
        positions=np.concatenate([m.positions for m in motions]),
        channel_values=np.concatenate([v for v in values if v is not None])
        if all(v is not None for v in values)
        else None,
        name=name,
    )


class Stream:
    """New motion on a base that is still growing.

    Frames of the base are pushed as they come. They are cut where that is certain, and what
    is to be done in a segment is decided, once `horizon` segments are known, by the cheapest
    row of donors for all of these; then only the first is committed. Of what is committed
    nothing is taken back: a seam changes only the frames after it.

    Parameters
    ----------
    library : Library
        Where the donors come from. Of one in a folder, clips are read as they are needed.
    swap : sequence of str, optional
        The groups to graft, as for `graft`. Legs and root must stay the base's own.
    constraints : sequence of Constraint, optional
        What the motion must do from here on, or should. Frames count from the first that is
        pushed. May be set anew at any time, for all that is not committed yet.
    seed : int
        Of what is left to chance, with ``Config(choice="sample")`` and "random".
    horizon : int
        Segments that are known before the first of them is committed: the more, the better
        the choice and the longer the wait. With 1 every donor is the best beside the one
        before.

    Raises
    ------
    TypeError
        If something is no constraint.
    ValueError
        If a group is none, is the base group or holds legs, root or single channels, the
        horizon is below 1, the library's `Config.torso` or `Config.alignment` is not the
        default, or a constraint names what is not there.

    Notes
    -----
    `Config.seam` is "inertial" or "dead"; in place of others, which change what is before a
    seam, it is "inertial". Of translations the base's own are kept. "random" draws rows of
    donors within the limits alike, of the `max_candidates` cheapest.

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
    >>> joined(pieces).n_frames == base.n_frames
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
    ) -> None:
        horizon, seed = as_integer("horizon", horizon, 1), as_integer("seed", seed)
        check_type("library", library, Library)
        groups = sorted(
            grafted_groups(library, swap), key=lambda own: int(library.joints(own).min())
        )
        _check_config(library.config)
        _check_whole(library, groups)
        self._library, self._horizon = library, horizon
        self._members = {group: library.joints(group) for group in groups}
        _check_upper(library, self._members)
        self._rng = np.random.default_rng(seed)
        self._columns = {
            group: feature_joints(library.skeleton, joints)
            for group, joints in self._members.items()
        }
        self._pools = {group: library.pool(group) for group in groups}
        self._lengths = library.segments.lengths
        self._donors = _Donors(library)
        self._clips: tuple[Clip, ...] = (*library.entries, _BaseClip())
        self._base: _Base | None = None
        self._clusters: _Clusters | None = None
        self._cutter = OnlineSegmenter(library.rate, library.config)
        self._places: list[_Place] = []
        self._past: dict[str, _Past] = {}
        self._signs: FloatArray | None = None
        self._count = 0
        self._is_closed = False
        self.constraints = constraints

    def __repr__(self) -> str:
        return f"Stream({self._library}, {self._count} segments committed)"

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """What the motion must do, or should, in all that is not committed yet."""
        return self._constraints

    @constraints.setter
    def constraints(self, wanted: Sequence[Constraint]) -> None:
        none = Segments(np.zeros(0, np.int64), np.zeros(0, np.int64))
        skeleton = self._library.skeleton if self._base is None else self._base.like.skeleton
        still = np.tile(rotations.IDENTITY, (1, skeleton.n_joints, 1))
        rest = Motion(skeleton, 1.0, still, skeleton.offsets[None])
        check_constraints(wanted, Poses.from_motion(rest))
        for constraint in wanted:
            constraint.donor_errors(none, none, self._clips)
        self._constraints = tuple(wanted)
        self._config = limit_config(self._library.config, wanted)
        self._models = {
            group: cost_model(self._config, pool) for group, pool in self._pools.items()
        }
        self._places = []

    @property
    def n_known(self) -> int:
        """Frames of the base that have been pushed."""
        return 0 if self._base is None else self._base.n_frames

    def push(self, frames: Motion) -> None:
        """Take in the next frames of the base.

        Parameters
        ----------
        frames : Motion
            One or more, of the library's hierarchy and frame rate.

        Raises
        ------
        SkeletonMismatchError
            If the hierarchy differs.
        ValueError
            If the rate differs, the skeleton is not that of the frames before, or the stream
            is closed.
        """
        if self._is_closed:
            raise ValueError("frames must be pushed before the stream is closed")
        name = frames.name or "the base"
        if self._base is None:
            self._library.skeleton.check_same_hierarchy(frames.skeleton, name)
        elif not _same_skeleton(frames.skeleton, self._base.like.skeleton):
            raise ValueError("frames must all be of one skeleton, got another than before")
        if not rates_match(frames.rate, self._library.rate):
            raise ValueError(
                f"frames must come at the library's {self._library.rate:.6g} per second, "
                f"got {frames.rate:.6g}: resample the base first"
            )
        if self._base is None:
            self._base = _Base(frames)
            self._clusters = _Clusters.of(self._library, mass_model(frames.skeleton).height)
        else:
            self._base.push(frames)
        known, energy_of = self._cutter.n_frames, self._base.n_frames - 1
        if energy_of > known:
            self._cutter.push(self._base.energies(self._config)[: energy_of - known])

    def close(self) -> None:
        """Say that the base has ended: all that is left can be committed.

        Raises
        ------
        ValueError
            If fewer than two frames have been pushed.
        """
        if self._is_closed:
            return
        if self._base is None or self._base.n_frames < 2:
            raise ValueError(f"a stream needs at least 2 frames, got {self.n_known}")
        self._cutter.push(self._base.energies(self._config))
        self._cutter.close()
        self._is_closed = True

    def pieces(self) -> "list[Piece]":
        """Commit all segments that can be, and return them."""
        found = []
        while (piece := self.advance()) is not None:
            found.append(piece)
        return found

    def advance(self) -> Piece | None:
        """Commit the next segment.

        Returns
        -------
        Piece or None
            None where too little of the base is known, or all of it is committed.
        """
        bounds = self._cutter.bounds
        n_known = min(len(bounds) - 1, self._horizon)
        if self._base is None or n_known < 1 or (n_known < self._horizon and not self._is_closed):
            return None
        for start, stop in pairwise(bounds[len(self._places) : n_known + 1]):
            self._prepare(start, stop)
        piece = self._committed(*self._decided())
        del bounds[0]
        del self._places[0]
        self._count += 1
        self._base.forget(bounds[0] - _BESIDE)
        return piece

    def _prepare(self, start: int, stop: int) -> None:
        """Find what may be in a segment's place, and what it costs."""
        assert self._base is not None
        assert self._clusters is not None
        library, config = self._library, self._config
        base, at = self._base.around(start, stop)
        cut = _one(at, at + stop - start)
        mates, apart = self._clusters.mates(base, cut)
        lengths = self._lengths
        fits = length_fits(cut.lengths, lengths[mates], library.rate, config)
        fits &= library.is_donor[mates]
        mates, apart = mates[fits], apart[fits]
        own = _one(start, stop, len(self._clips) - 1)
        origin = self._origins(own, mates)
        prices, passes = origin.soft, origin.is_feasible
        mates, apart, prices = mates[passes], np.append(apart[passes], 0.0), prices[passes]
        is_own = np.arange(len(mates) + 1) == len(mates)
        # The base's own part is the last donor, of no number in the library.
        taken = np.append(lengths[mates], cut.lengths)
        # Unary costs do not depend on the scales of seams, by which the groups' models differ.
        model = next(iter(self._models.values()))
        costs = model.unary(cut.lengths, taken, apart, is_own)
        few = model.keep_cheapest(costs + np.append(prices, 0.0), is_own)
        donors = np.append(mates, -1)[few]
        ends, flat = boundary_states(base, cut), np.append(prices, 0.0)[few]
        place = _Place(start, base, at, own, donors, costs[few], costs[few] + flat, ())
        place = replace(place, posed=tuple(self._here(place)))
        for group in self._members:
            known = self._pools[group].boundary[donors[:-1]]
            columns = {key: states[:, self._columns[group]] for key, states in ends.items()}
            place.ends[group] = BoundaryStates.concatenate([known, BoundaryStates(**columns)])
            place.alone[group] = place.flat
            if place.posed:
                place.sampled[group] = sampled = self._sampled(place, group, donors)
                missed = self._misses(place, group, sampled.frames, place.local)
                place.alone[group] = place.flat + missed
        self._places.append(place)

    def _origins(self, own: Segments, mates: IntArray) -> ConstraintViolations:
        """Return how far donors violate constraints on their origin."""
        every = own[np.zeros(len(mates), np.int64)]
        donors = self._library.segments[mates]
        amounts = origin_violations(self._constraints, every, donors, every, self._clips)
        return ConstraintViolations.from_amounts(self._constraints, amounts, len(mates))

    def _misses(
        self, place: "_Place", group: str, values: FloatArray, context: FloatArray
    ) -> FloatArray:
        """Return the costs of the constraints on poses for donors in their place."""
        n, first = len(values), 1 if self._count else 0
        local = np.tile(context, (n, 1, 1))
        local[:, self._members[group]] = values.reshape(-1, *values.shape[2:])
        amounts = pose_violations(
            place.posed,
            self._posed(place, local),
            self._owner[group],
            lambda errors: errors.reshape(n, -1)[:, first:].max(axis=1),
        )
        return ConstraintViolations.from_amounts(place.posed, amounts, n).costs()

    @property
    def _owner(self) -> dict[str, BoolArray]:
        assert self._base is not None
        return self._base.owner(self._members)

    def _here(self, place: "_Place") -> list[Constraint]:
        """Return what poses in a place must do: the body may touch itself as captured there."""
        posed = [
            c
            for c in self._constraints
            if type(c).errors is not Constraint.errors and c.applies(place.frames).any()
        ]
        if not any(isinstance(c, AvoidSelf) for c in posed):
            return posed
        return with_captured_depth(posed, self._posed(place, place.local))

    def _posed(self, place: "_Place", local: FloatArray) -> Poses:
        """Return the body in a place, in one row of poses or several one behind the other."""
        assert self._base is not None
        turns = len(local) // (place.length + 1)
        spots = np.tile(place.base.positions[place.rows], (turns, 1, 1))
        body = self._base.body(self._library.up)
        return body.with_poses(
            np.tile(place.frames, turns), *world_transforms(body.skeleton, local, spots)
        )

    def _decided(self) -> "tuple[dict[str, int], dict[str, _Laid], Poses | None]":
        """Choose what is committed in the first place: what the plan of all places has there.

        There constraints are looked at with the seams, group by group; further on without.
        """
        place = self._places[0]
        chosen: dict[str, int] = {}
        laid: dict[str, _Laid] = {}
        local = place.local.copy()
        for group, joints in self._members.items():
            past, alone, every = self._past.get(group), place.flat, None
            if place.posed:
                every = self._lay(place, place.sampled[group], past)
                alone = place.flat + self._misses(place, group, every.frames, local)
            chosen[group] = at = self._first(self._trellis(group, alone))
            if every is None:
                taken = self._sampled(place, group, place.donors[at : at + 1])
                laid[group] = self._lay(place, taken, past)
            else:
                laid[group] = every.only(at)
            local[:, joints] = laid[group].frames[0]
        return chosen, laid, self._posed(place, local) if place.posed else None

    def _trellis(self, group: str, first: FloatArray) -> Trellis:
        """Return the costs of all donors within the horizon, those of the first place given."""
        model = self._models[group]
        unary = [place.alone[group] for place in self._places]
        seams = [
            place.after(following, group, model) for place, following in pairwise(self._places)
        ]
        if group in self._past:
            first = first + self._past[group].costs(self._places[0].ends[group], model)[0]
        unary[0] = first
        return Trellis(tuple(unary), tuple(seams))

    def _first(self, trellis: Trellis) -> int:
        choice = DONOR_CHOICES.get(self._config.choice)
        return int(choice.choose_path(trellis, self._config, self._rng)[0])

    def _sampled(self, place: "_Place", group: str, donors: IntArray) -> "_Sampled":
        """Return donors stretched to a place, as they are."""
        joints, n = self._members[group], place.length
        tracks = [
            place.track if donor < 0 else self._donors.track(donor) for donor in donors.tolist()
        ]
        frames = np.array([len(track) for track in tracks])
        starts, lengths = np.cumsum(frames) - frames + 1, frames - 3
        track = np.concatenate(tracks).take(joints, axis=1)
        steps = np.append(np.arange(n + 1), [n - _MOMENT, n - 2 * _MOMENT])
        # In this order whole results of the division are exact.
        times = starts[:, None] + steps * lengths[:, None] / n
        values = cubic(np.arange(len(track)), track, times.ravel())
        pace = (self._library.rate * lengths / n)[:, None, None]
        ends = np.stack([starts, starts + lengths])
        before, after = ROTATIONS.delta(track[[ends - 1, ends]], track[[ends, ends + 1]])
        arriving, leaving = 0.5 * (before + after) * pace
        return _Sampled(values.reshape(len(donors), n + 3, -1, 4), arriving, leaving)

    def _lay(self, place: "_Place", given: "_Sampled", past: "_Past | None") -> "_Laid":
        """Put donors into their place, each going on from where the one before has ended."""
        rate, n = self._library.rate, place.length
        raw, arriving = given.values, given.arriving
        if past is None:
            return _Laid(given, raw, rate)
        treatment = SEAM_TREATMENTS.get(self._config.seam)
        if not treatment.is_causal:
            treatment = SEAM_TREATMENTS.get("inertial")
        steps = np.append(np.arange(n + 1), [n - _MOMENT, n - 2 * _MOMENT])
        piece = np.repeat(np.arange(1, len(raw) + 1), n + 3)
        # What a short segment has no time for goes on in the next: it meets what was laid.
        longest = np.full(len(raw) + 1, np.inf)
        moments = PieceTimes(piece, np.tile(steps / rate, len(raw)), longest)
        before = np.broadcast_to(past.pose, (len(raw), *past.pose.shape))
        speed = np.broadcast_to(past.speed, arriving.shape)
        met = SeamBoundaries(before, raw[:, 0], speed, arriving)
        flat = raw.reshape(-1, *raw.shape[2:])
        values = treatment.close(ROTATIONS, flat, moments, met, self._config.seam_blend)
        return _Laid(given, values.reshape(raw.shape), rate)

    def _committed(
        self, chosen: Mapping[str, int], laid: "Mapping[str, _Laid]", poses: Poses | None
    ) -> Piece:
        """Return the piece of a choice, and remember how it ends."""
        place, library = self._places[0], self._library
        new = slice(1 if self._count else 0, None)
        base = place.base[place.rows.start + new.start : place.rows.stop]
        substitutions, missed, parts = [], [], []
        segment = len(library.segments) + self._count
        for group, at in chosen.items():
            donor, ends = int(place.donors[at]), place.ends[group]
            past = self._past.get(group)
            gap = 0.0 if past is None else float(past.gaps(ends)[0, at])
            given = place.own if donor < 0 else library.segments[np.array([donor])]
            substitutions.append(
                Substitution.build(
                    group,
                    (place.start, place.start + place.length),
                    segment=segment,
                    donor=segment if donor < 0 else donor,
                    clip=(base.name or "the base")
                    if donor < 0
                    else self._clips[given.clip[0]].name,
                    donor_frames=(int(given.start[0]), int(given.stop[0])),
                    cost=float(place.costs[at]),
                    gaps=(gap, float("nan")),
                )
            )
            missed += find_seam_violations(self._constraints, group, [place.start], [gap])
            joints = self._members[group]
            values, spots = laid[group].frames[0, new], base.positions[:, joints]
            parts.append(Part(joints, values, spots))
            self._past[group] = _Past(laid[group].pose[0], laid[group].speed[0], ends[at : at + 1])
        motion = recombine(base, parts, base.name)
        quats = motion.rotations.copy()
        if self._signs is not None:
            quats[:, np.einsum("ji,ji->j", quats[0], self._signs) < 0] *= -1.0
        self._signs = quats[-1]
        if poses is not None:
            fresh = poses.with_poses(poses.frames[new], poses.rotations[new], poses.positions[new])
            missed += find_violations(place.posed, fresh)
        return Piece(
            replace(motion, rotations=quats),
            place.start,
            place.start + place.length,
            tuple(substitutions),
            tuple(missed),
        )


@dataclass(frozen=True)
class _BaseClip:
    """What constraints know of the base, which counts as one more clip."""

    name: str = "the base"
    tags: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Sampled:
    """Donors stretched to a place, one each row, and their speeds per second at both ends.

    `values` are their frames and, behind these, two moments just before the last.
    """

    values: FloatArray
    arriving: FloatArray
    leaving: FloatArray

    @property
    def frames(self) -> FloatArray:
        return self.values[:, :-2]

    def only(self, at: int) -> "_Sampled":
        row = slice(at, at + 1)
        return _Sampled(self.values[row], self.arriving[row], self.leaving[row])


@dataclass(frozen=True, eq=False)
class _Laid:
    """Donors in a place: as they are given, and their values when the seam is closed."""

    given: _Sampled
    values: FloatArray
    rate: float

    @property
    def frames(self) -> FloatArray:
        return self.values[:, :-2]

    @property
    def pose(self) -> FloatArray:
        return self.values[:, -3]

    @property
    def speed(self) -> FloatArray:
        """Per second, at the end."""
        last, raw = self.values[:, -3:], self.given.values[:, -3:]
        back, further = ROTATIONS.delta(last[:, 0], np.moveaxis(last[:, 1:], 1, 0))
        moved = (0.5 * further - 2.0 * back) * (self.rate / _MOMENT)
        settled = (last == raw).all(axis=(1, 3))
        return np.where(settled[..., None], self.given.leaving, moved)

    def only(self, at: int) -> "_Laid":
        return _Laid(self.given.only(at), self.values[at : at + 1], self.rate)


@dataclass(frozen=True, eq=False)
class _Past:
    """How what was committed last ends: all of the group's joints, and those that count."""

    pose: FloatArray
    speed: FloatArray
    boundary: BoundaryStates

    def gaps(self, following: BoundaryStates) -> FloatArray:
        return self.boundary.pose_gaps_to(following)

    def costs(self, following: BoundaryStates, model: CostModel) -> FloatArray:
        return model.seam_costs(self.boundary, following)


@dataclass(frozen=True, eq=False)
class _Place:
    """A segment of the base that is not committed yet, and what may be in its place.

    `base` holds its frames and a few beside them; the first of its own is number `at`. The
    last of the donors is the base's own part, -1. `costs` are theirs by themselves, `flat`
    with constraints on where they come from, `alone` with those on poses too, which are
    `posed`: for these all donors are `sampled`. `ends` are as the library's edges, and `seams`
    the costs beside the next place's donors, once they are known.
    """

    start: int
    base: Motion
    at: int
    own: Segments
    donors: IntArray
    costs: FloatArray
    flat: FloatArray
    posed: tuple[Constraint, ...]
    ends: dict[str, BoundaryStates] = field(default_factory=dict)
    alone: dict[str, FloatArray] = field(default_factory=dict)
    seams: dict[str, FloatArray] = field(default_factory=dict)
    sampled: dict[str, _Sampled] = field(default_factory=dict)

    @property
    def length(self) -> int:
        return int(self.own.lengths[0])

    @property
    def rows(self) -> slice:
        return slice(self.at, self.at + self.length + 1)

    @property
    def frames(self) -> IntArray:
        return np.arange(self.start, self.start + self.length + 1)

    @property
    def local(self) -> FloatArray:
        return self.base.rotations[self.rows]

    @property
    def track(self) -> FloatArray:
        return _with_neighbours(self.base.rotations, self.at, self.at + self.length)

    def after(self, following: "_Place", group: str, model: CostModel) -> FloatArray:
        """Return what seams with the donors of the next place cost."""
        if group not in self.seams:
            self.seams[group] = model.seam_costs(self.ends[group], following.ends[group])
        return self.seams[group]


class _Base:
    """The frames of the base that are still needed, and what never changes about it."""

    def __init__(self, frames: Motion) -> None:
        self.like = frames[:1]
        self._gone = 0
        self._tracks = self._of(frames)
        self._keep = 0
        self._energies_of = 0
        self._body: Poses | None = None
        self._owned: dict[str, BoolArray] | None = None

    @staticmethod
    def _of(frames: Motion) -> dict[str, FloatArray]:
        tracks = {"rotations": frames.rotations, "positions": frames.positions}
        if frames.channel_values is not None:
            tracks["channel_values"] = frames.channel_values
        return tracks

    @property
    def n_frames(self) -> int:
        return self._gone + len(self._tracks["rotations"])

    def push(self, frames: Motion) -> None:
        spare, new = self._keep - self._gone, self._of(frames)
        # Numbers of the file are kept only where all have them.
        both = [key for key in self._tracks if key in new]
        self._tracks = {key: np.concatenate([self._tracks[key][spare:], new[key]]) for key in both}
        self._gone += spare

    def forget(self, frame: int) -> None:
        """Say that frames before one are not needed any more."""
        self._keep = max(self._keep, min(frame, self._energies_of - 1))

    def motion(self, start: int, stop: int) -> Motion:
        rows = slice(start - self._gone, stop - self._gone)
        values = self._tracks.get("channel_values")
        return replace(
            self.like,
            rotations=self._tracks["rotations"][rows],
            positions=self._tracks["positions"][rows],
            channel_values=None if values is None else values[rows],
        )

    def around(self, start: int, stop: int) -> tuple[Motion, int]:
        """Return a segment's frames and some beside them, and where it starts there."""
        first = max(start - _BESIDE, self._gone)
        return self.motion(first, min(stop + _BESIDE + 1, self.n_frames)), start - first

    def energies(self, config: Config) -> FloatArray:
        """Return the kinetic energies from the first that was not returned to the last frame's.

        The last one's is only right if no frame comes any more.
        """
        first = max(self._energies_of - 1, 0)
        window = self.motion(first, self.n_frames)
        energy = kinetic_energy(window, omega=config.omega, inertia=config.inertia)
        fresh = energy[self._energies_of - first :]
        self._energies_of = self.n_frames - 1
        return fresh

    def body(self, up: int) -> Poses:
        if self._body is None:
            self._body = replace(Poses.from_motion(self.like, capsules(self.like.skeleton)), up=up)
        return self._body

    def owner(self, members: Mapping[str, IntArray]) -> dict[str, BoolArray]:
        if self._owned is None:
            self._owned = driven_joints(self.like.skeleton, members)
        return self._owned


@dataclass(frozen=True, eq=False)
class _Clusters:
    """The library's clusters of base parts, and where a new segment belongs among them."""

    library: Library
    height: float
    members: ClusterMembers | None

    @classmethod
    def of(cls, library: Library, height: float) -> "_Clusters":
        base = library.groups.base
        labels, known = library.labels[base], library.embedding[base]
        return cls(
            library,
            height,
            None if known is None else ClusterMembers.from_labels(labels, known.points),
        )

    def mates(self, motion: Motion, cut: Segments) -> tuple[IntArray, FloatArray]:
        """Return the members of a segment's cluster, the one that `Library.extended` finds.

        Ascending; and how far they are, in greatest distances within a cluster.
        """
        library = self.library
        base, config = library.groups.base, library.config
        known, sigma = library.embedding[base], library.sigma[base]
        if known is None or self.members is None:
            return np.zeros(0, np.int64), np.zeros(0)
        samples = normalise(
            [motion], cut, config, root=library.root, up=library.up, heights=[self.height]
        )
        samples = replace(samples, rows=samples.packed())
        point = known.project(
            features(samples, known.joints, known.reference, has_root=known.has_root)
        )
        mates, apart = self.members.find_nearest_cluster(point[0], sigma)
        return mates, apart / sigma if sigma > 0 else apart


class _Donors:
    """Frames of donors, each read when it is first needed."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self._in_hand: OrderedDict[int, FloatArray] = OrderedDict()

    def track(self, segment: int) -> FloatArray:
        """Return a segment's rotations with those of the frames next to it."""
        known = self._in_hand.get(segment)
        if known is None:
            segments = self._library.segments
            clip = self._library.clips[segments.clip[segment]]
            start, stop = int(segments.start[segment]), int(segments.stop[segment])
            known = self._in_hand[segment] = _with_neighbours(clip.rotations, start, stop)
            if len(self._in_hand) > _DONORS_IN_HAND:
                self._in_hand.popitem(last=False)
        return known


def _with_neighbours(track: FloatArray, start: int, stop: int) -> FloatArray:
    """Return frames and their neighbours; at an end the clip goes on as its last three frames do.

    So velocities, and the curve through the frames, are at all ends what they are within.
    """
    rows = [track[start : stop + 1]]
    steps = max(len(track) - 1, 1)
    if start > 0:
        rows.insert(0, track[start - 1 : start])
    else:
        ways = ROTATIONS.delta(track[: min(2, steps)], track[1 : min(2, steps) + 1])
        rows.insert(0, ROTATIONS.add(track[:1], -(2.0 * ways[:1] - ways[-1:])))
    if stop + 1 < len(track):
        rows.append(track[stop + 1 : stop + 2])
    else:
        ways = ROTATIONS.delta(track[-1 - min(2, steps) : -1], track[-min(2, steps) :])
        rows.append(ROTATIONS.add(track[-1:], 2.0 * ways[-1:] - ways[:1]))
    return np.concatenate(rows)


def _one(start: int, stop: int, clip: int = 0) -> Segments:
    return Segments(np.array([start]), np.array([stop]), np.array([clip]))


def _same_skeleton(a: Skeleton, b: Skeleton) -> bool:
    return a is b or (a.names == b.names and np.array_equal(a.offsets, b.offsets))


def _check_upper(library: Library, members: Mapping[str, IntArray]) -> None:
    """Refuse groups that hold the root or legs: what stands where is known only afterwards."""
    limbs = find_legs(library.skeleton)
    held = {library.root, *(j for limb in limbs for j in (limb.hip, limb.knee, limb.ankle))}
    for group, joints in members.items():
        if not held.isdisjoint(joints.tolist()):
            raise ValueError(
                f"swap must name groups without root and legs, which a stream keeps; got {group!r}"
            )


def _check_whole(library: Library, groups: Sequence[str]) -> None:
    """Refuse groups that hold single channels: a stream exchanges whole joints."""
    held = library.groups.divided_channels(library.skeleton)
    for group in groups:
        if held[group]:
            joints = ", ".join(library.skeleton.names[joint] for joint in held[group])
            raise ValueError(
                "swap must name groups of whole joints, which a stream exchanges; "
                f"got {group!r}, which holds single channels of {joints}"
            )


def _check_config(config: Config) -> None:
    for name, only in (("torso", "pelvis"), ("alignment", "uniform")):
        if getattr(config, name) != only:
            raise ValueError(
                f"config.{name} must be {only!r} in a stream, got {getattr(config, name)!r}"
            )
