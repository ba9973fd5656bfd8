"""Recombination and seams: from chosen segments to one motion (paper, 4.5)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.channel_groups import Key, angles, apart, told
from mograft.analysis.segmentation import Segments
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms
from mograft.blend.root_motion import blend_root_velocity, integrate_root, yaw_rates
from mograft.blend.seams import PieceTimes, SeamBoundaries, dead, displacement, inertial, offset
from mograft.blend.time_warp import TimeWarp
from mograft.blend.value_spaces import ROTATIONS, TRANSLATIONS, ValueSpace
from mograft.body.anatomy import anatomy
from mograft.config import Config
from mograft.motion import rotations
from mograft.motion.motion import Motion

__all__ = ["Part", "recombine", "sample_states", "transplant"]


@dataclass(frozen=True, eq=False)
class Part:
    """What one joint group does in the new motion.

    Attributes
    ----------
    joints : ndarray of int
        The group's joints.
    rotations : ndarray, shape (n_frames, len(joints), 4)
        Their local rotations.
    positions : ndarray, shape (n_frames, len(joints), 3)
        Their local translations.
    seams : ndarray of int
        Frames where segments meet that did not meet in a clip.
    gaps : ndarray, shape (len(seams), len(joints) + len(angles))
        By what angle each joint, or channel, had to be brought together there, in radians.
    angles : dict of (int, str) to ndarray, shape (n_frames,)
        Of divided joints the angle of each channel that the group holds, in radians; NaN
        where it is the base's own.
    """

    joints: IntArray
    rotations: FloatArray
    positions: FloatArray
    seams: IntArray
    gaps: FloatArray
    angles: Mapping[Key, FloatArray] = field(default_factory=dict)


def transplant(
    base: Motion,
    cut: Segments,
    donors: Segments,
    clips: Sequence[Motion],
    joints: IntArray,
    config: Config,
    *,
    root: int | None = None,
    up: int = 1,
    guides: IntArray | None = None,
    held: Mapping[int, str] | None = None,
) -> Part:
    """Let a joint group do what it does in other segments, and join these smoothly.

    Parameters
    ----------
    base : Motion
        The motion whose other joints stay as they are.
    cut : Segments
        Its segments, in order of time, covering it.
    donors : Segments
        For each segment of `cut` the one to take its place, itself perhaps.
    clips : sequence of Motion
        What `donors.clip` counts; of the base's hierarchy.
    joints : ndarray of int
        The joints of the group, those that are divided too.
    config : Config
        Gives `seam`, `seam_window`, `seam_blend`, `alignment` and `torso`.
    root : int, optional
        The joint that carries the body through the world. Where it is one of `joints`, every
        donor goes on from the place and heading that the one before has come to, the first
        from the base's own. Default: none does.
    up : int
        The axis that points up: 0, 1 or 2.
    guides : ndarray of int, optional
        The base group's joints, by which donors are aligned with ``alignment="dtw"``. Without
        them they are stretched evenly.
    held : dict of int to str, optional
        Of divided joints the axes of the channels that the group holds; see
        `JointGroups.held`. Only those are exchanged.

    Returns
    -------
    Part
        The group's motion, as long as the base. Where segments follow one another as they
        do in their clip, unstretched, it is that clip bit for bit.

    Notes
    -----
    Every donor is resampled to the length of the segment whose place it takes, by a curve
    that knows its neighbours in its clip. Where pieces meet that never met, or were stretched
    differently, `mograft.blend.seams` closes the seam; with ``seam="paper"`` poses are displaced
    and the frames about the seam then laid anew on a cubic that meets the velocities at its ends.
    A joint's translation goes with it only where it moves in some donor's clip: else the base
    keeps its own bones.

    With ``torso="world"`` a trunk that hangs on a joint of another group leans in the world as
    it does in its clip, under the base's heading: R_i⁻¹ Y_i Y_k⁻¹ R_k q_k in place of q_k, R and
    Y being that joint's rotation in the world and its turn about up, in the base (i) and in the
    donor's clip (k).
    """
    # Of a stored library each clip has to be read: only those that lend something are.
    used, clip = np.unique(donors.clip, return_inverse=True)
    donors, clips = replace(donors, clip=clip), [clips[index] for index in used]
    held = {} if held is None else held
    joints = np.setdiff1d(joints, list(held)).astype(np.int64)
    tracks = [np.concatenate([c.rotations[:, joints], apart(c, held)], axis=1) for c in clips]
    places = np.ascontiguousarray(base.positions[:, joints])
    travels = _travels(clips, joints)
    shifts = [clip.positions[:, joints[travels]] for clip in clips]
    laid = DonorTimeline(cut, donors, base.rate)
    if config.alignment == "dtw" and guides is not None:
        laid = replace(laid, warp=TimeWarp.of(base, cut, donors, clips, guides))
    seams = laid.true_seams(tracks)
    carries = root is not None and bool((joints == root).any())
    if root is not None and carries:
        travels |= joints == root
        shifts = [clip.positions[:, joints[travels]] for clip in clips]
        columns = int(np.argmax(joints == root)), int(np.argmax(joints[travels] == root))
        tracks, shifts = _in_the_world(clips, root, tracks, shifts, columns)
        seams |= laid.true_seams([own[:, columns[1], None] for own in shifts])
        laid = laid.placed(base, root, up, tracks, shifts, columns, seams)
    segment, step = laid.frames()
    leaning = _trunks(base, joints) if config.torso == "world" else []
    tracks = [
        _upright(clip, joints, leaning, own, up) for clip, own in zip(clips, tracks, strict=True)
    ]
    quats = laid.unpack(
        segment, step, _joined(laid, seams, ROTATIONS, tracks, segment, step, config)
    )
    if travels.any():
        moved = _joined(laid, seams, TRANSLATIONS, shifts, segment, step, config)
        places[:, travels] = laid.unpack(segment, step, moved)
    if root is not None and carries:
        column = columns[0]
        quats[:, column], places[:, column] = _led(
            laid, seams, tracks, shifts, (quats[:, column], places[:, column]), up, config
        )

    if config.seam == "paper":
        window = round(config.seam_window * base.rate)
        left, right = _windows(cut, np.flatnonzero(seams), window)
        quats = _smooth_rotations(quats, left, right)
        places[:, travels] = _smooth_positions(places[:, travels], left, right)
    if root is not None and carries:
        column = int(np.argmax(joints == root))
        quats[:, column], places[:, column] = _as_local(
            base, root, quats[:, column], places[:, column]
        )
    turns, quats = quats[:, len(joints) :], np.ascontiguousarray(quats[:, : len(joints)])
    quats = _on_its_pelvis(base, joints, leaning, quats, up)
    changed = (turns != apart(base, held)).any(axis=2)
    single = {
        key: np.where(changed[:, column], own, np.nan)
        for column, (key, own) in enumerate(told(turns, held).items())
    }
    gaps = np.linalg.norm(
        laid.ends(ROTATIONS, tracks, np.flatnonzero(seams)).gaps(ROTATIONS), axis=-1
    )
    return Part(joints, quats, places, cut.stop[:-1][seams], gaps, single)


def recombine(base: Motion, parts: Sequence[Part], name: str) -> Motion:
    """Put new parts into a motion; all else stays as it is, number for number (eq. 20).

    Parameters
    ----------
    base : Motion
        The motion to change.
    parts : sequence of Part
        Parts of different joints.
    name : str
        The new motion's name.

    Returns
    -------
    Motion
        With the base's channel values wherever neither rotation nor translation has changed.
    """
    skeleton = base.skeleton
    quats, places = base.rotations.copy(), base.positions.copy()
    values = None if base.channel_values is None else base.channel_values.copy()
    for part in parts:
        turned = (part.rotations != base.rotations[:, part.joints]).any(axis=-1)
        moved = (part.positions != base.positions[:, part.joints]).any(axis=-1)
        turns, moves = turned.any(axis=0), moved.any(axis=0)
        quats[:, part.joints[turns]] = rotations.continuous_signs(part.rotations[:, turns])
        places[:, part.joints[moves]] = part.positions[:, moves]
        if values is None:
            continue
        for column in np.flatnonzero(turns | moves).tolist():
            joint = part.joints[column]
            changed = {"rotation": turned[:, column], "position": moved[:, column]}
            for at, channel in zip(
                skeleton.channel_columns[joint], skeleton.channels[joint], strict=True
            ):
                values[changed[channel[1:]], at] = np.nan
    single = {key: own for part in parts for key, own in part.angles.items()}
    for joint in dict.fromkeys(joint for joint, _ in single):
        order = skeleton.rotation_order(joint)
        own = angles(base, joint)
        new = own.copy()
        for column, axis in enumerate(order):
            wanted = single.get((joint, axis), np.full(base.n_frames, np.nan))
            # Whole turns from the base's own angle are no difference.
            off = np.angle(np.exp(1j * (wanted - own[:, column])))
            new[:, column] = np.where(np.isnan(wanted), own[:, column], own[:, column] + off)
        moves = (new != own).any(axis=1)
        if not moves.any():
            continue
        turns = np.where(moves[:, None], rotations.from_euler(new, order), base.rotations[:, joint])
        quats[:, joint] = rotations.continuous_signs(turns)
        if values is not None:
            columns = skeleton.channel_columns[joint]
            names = skeleton.channels[joint]
            for at, name in zip(columns, names, strict=True):
                if name.endswith("rotation"):
                    angle = new[:, order.index(name[0])]
                    kept = angle == own[:, order.index(name[0])]
                    values[:, at] = np.where(kept, values[:, at], np.degrees(angle))
    return replace(
        base,
        rotations=quats,
        positions=places,
        channel_values=values,
        name=name,
        path=None,
        repairs=(),
    )


@dataclass(frozen=True, eq=False)
class DonorTimeline:
    """Donors laid one after the other in the places of segments, each stretched to its place.

    A moment is a segment and how many frames, perhaps a fraction, have passed since its start.
    Where the root is among the joints, `place` says how each donor is turned and shifted.
    """

    cut: Segments
    donors: Segments
    rate: float
    place: "_Place | None" = None
    warp: TimeWarp | None = None

    def frames(self) -> tuple[IntArray, FloatArray]:
        """Return the moments of all frames; where segments meet, of both."""
        counts = self.cut.lengths + 1
        segment = np.repeat(np.arange(len(counts)), counts)
        step = np.arange(len(segment)) - (np.cumsum(counts) - counts)[segment]
        return segment, step.astype(np.float64)

    def unpack(self, segment: IntArray, step: FloatArray, rows: FloatArray) -> FloatArray:
        """Return one row per frame; where segments meet, the later one's."""
        frames = np.empty((self.cut.stop[-1] + 1, *rows.shape[1:]))
        frames[self.cut.start[segment] + step.astype(np.int64)] = rows
        return frames

    def sample(
        self, algebra: ValueSpace, tracks: Sequence[FloatArray], segment: IntArray, step: FloatArray
    ) -> FloatArray:
        """Return what the donors do at moments; on a frame, that frame bit for bit."""
        interpolate = algebra.interpolate
        donors = self.donors
        # In this order whole results of the division are exact.
        passed = step * donors.lengths[segment] / self.cut.lengths[segment]
        if self.warp is not None:
            bent = self.warp.at(segment, step / self.cut.lengths[segment])
            passed = np.where(self.warp.is_bent[segment], bent * donors.lengths[segment], passed)
        clip = donors.clip[segment]
        values = np.empty((len(segment), *tracks[0].shape[1:]))
        for index in np.unique(clip):
            own = np.flatnonzero(clip == index)
            track = np.ascontiguousarray(tracks[index])
            times = donors.start[segment[own]] + passed[own]
            values[own] = interpolate(track, times)
        if self.place is not None:
            self.place.put(algebra, values, segment)
        return values

    def ends(
        self, algebra: ValueSpace, tracks: Sequence[FloatArray], seams: IntArray
    ) -> SeamBoundaries:
        """Return what meets where the segments `seams` end and those after them start."""
        donors = self.donors
        pace = np.tile((self.rate * donors.lengths / self.cut.lengths)[:, None], (1, 2))
        if self.warp is not None:
            pace *= np.where(self.warp.is_bent[:, None], self.warp.paces[:, [0, -1]], 1.0)
        pace = pace[..., None, None]
        before, leaving = sample_states(algebra, tracks, donors.clip[seams], donors.stop[seams])
        after, arriving = sample_states(
            algebra, tracks, donors.clip[seams + 1], donors.start[seams + 1]
        )
        if self.place is not None:
            self.place.put(algebra, before, seams, leaving)
            self.place.put(algebra, after, seams + 1, arriving)
        return SeamBoundaries(
            before, after, leaving * pace[seams, 1], arriving * pace[seams + 1, 0]
        )

    def pieces(self, seams: IntArray, segment: IntArray, step: FloatArray) -> PieceTimes:
        """Return moments as times in the pieces between segments `seams` and those after them."""
        first = np.concatenate([[0], seams + 1])
        last = np.append(seams, len(self.cut) - 1)
        piece = np.searchsorted(seams, segment)
        frames = self.cut.start[segment] - self.cut.start[first[piece]] + step
        durations = (self.cut.stop[last] - self.cut.start[first]) / self.rate
        return PieceTimes(piece, frames / self.rate, durations)

    def true_seams(self, tracks: Sequence[FloatArray]) -> BoolArray:
        """Tell where neighbours did not meet in a clip, or were stretched.

        They did meet where the one's clip goes on as the other's does, to the bit, in the
        frames before, at and after the seam: so a clip's copy is as good as the clip.
        """

        def around(clips: IntArray, frames: IntArray) -> FloatArray:
            near = np.full((len(frames), 3, *tracks[0].shape[1:]), np.nan)
            for clip in np.unique(clips):
                own = np.flatnonzero(clips == clip)
                at = frames[own][:, None] + [-1, 0, 1]
                inside = (at >= 0) & (at < len(tracks[clip]))
                near[own[:, None], [0, 1, 2]] = np.where(
                    inside[..., None, None], tracks[clip][at.clip(0, len(tracks[clip]) - 1)], np.nan
                )
            return near

        donors = self.donors
        as_long = donors.lengths == self.cut.lengths
        if self.warp is not None:
            as_long &= ~self.warp.is_bent
        ends = around(donors.clip[:-1], donors.stop[:-1])
        starts = around(donors.clip[1:], donors.start[1:])
        same = (ends == starts).all(axis=tuple(range(1, ends.ndim)))
        follows: BoolArray = same & as_long[1:] & as_long[:-1]
        return ~follows

    def placed(
        self,
        base: Motion,
        root: int,
        up: int,
        tracks: Sequence[FloatArray],
        shifts: Sequence[FloatArray],
        columns: tuple[int, int],
        seams: BoolArray,
    ) -> "DonorTimeline":
        """Return the donors turned about up and shifted over the floor to follow one another."""
        donors = self.donors
        ends = []
        for frames in (donors.start, donors.stop):
            quats, _ = sample_states(ROTATIONS, tracks, donors.clip, frames)
            places, _ = sample_states(TRANSLATIONS, shifts, donors.clip, frames)
            ends.append(RootTransforms(quats[:, columns[0]], places[:, columns[1]]))
        first, last = ends
        turned, placed = base.world_transforms()
        come = RootTransforms(turned[:1, root], placed[:1, root])
        follows: list[AlignmentTransform] = []
        for index in range(len(donors)):
            own = np.array([index])
            if index and not seams[index - 1]:
                follows.append(follows[-1])
            else:
                follows.append(AlignmentTransform.from_roots(first[own], come, up))
            come = follows[-1].apply(last[own])
        yaws = np.concatenate([own.yaws for own in follows])
        offsets = np.concatenate([own.translations for own in follows])
        return replace(self, place=_Place(AlignmentTransform(yaws, offsets), columns))


@dataclass(frozen=True, eq=False)
class _Place:
    """Where donors that hold the root go, each.

    `columns` are the root's among the turning and among the travelling joints.
    """

    placement: AlignmentTransform
    columns: tuple[int, int]

    def put(
        self,
        algebra: ValueSpace,
        values: FloatArray,
        segment: IntArray,
        velocities: FloatArray | None = None,
    ) -> None:
        """Move the root's values and velocities in segments, in place; those that stay, not."""
        yaws, offsets = self.placement.yaws[segment], self.placement.translations[segment]
        goes = (yaws != rotations.IDENTITY).any(axis=1) | (offsets != 0.0).any(axis=1)
        yaws, offsets = yaws[goes], offsets[goes]
        if algebra is ROTATIONS:  # an angular velocity in the body's frame stays as it is
            own = values[goes, self.columns[0]]
            values[goes, self.columns[0]] = rotations.multiply(yaws, own)
        else:
            column = self.columns[1]
            values[goes, column] = rotations.rotate(yaws, values[goes, column]) + offsets
            if velocities is not None:
                velocities[goes, column] = rotations.rotate(yaws, velocities[goes, column])


def _joined(
    laid: DonorTimeline,
    seams: BoolArray,
    algebra: ValueSpace,
    tracks: Sequence[FloatArray],
    segment: IntArray,
    step: FloatArray,
    config: Config,
) -> FloatArray:
    """Return what the donors do at moments once their seams are closed.

    The paper moves whole segments; else a piece is all that goes on without a true seam, and
    lends its length to what must be changed.
    """
    values = laid.sample(algebra, tracks, segment, step)
    if config.seam in ("paper", "displacement"):
        at = np.arange(len(seams))
        moments = laid.pieces(at, segment, step)
        return displacement(algebra, values, moments, laid.ends(algebra, tracks, at))
    treatment = {"offset": offset, "inertial": inertial, "dead": dead}[config.seam]
    at = np.flatnonzero(seams)
    ends, moments = laid.ends(algebra, tracks, at), laid.pieces(at, segment, step)
    return treatment(algebra, values, moments, ends, config.seam_blend)


def _led(
    laid: DonorTimeline,
    seams: BoolArray,
    tracks: Sequence[FloatArray],
    shifts: Sequence[FloatArray],
    joined: tuple[FloatArray, FloatArray],
    up: int,
    config: Config,
) -> tuple[FloatArray, FloatArray]:
    """Return the root's rotations and places, as fast over the floor as donors go."""
    segment, step = laid.frames()
    assert laid.place is not None
    columns = laid.place.columns
    own = replace(laid, place=replace(laid.place, columns=(0, 0)))
    tracks = [track[:, columns[0], None] for track in tracks]
    shifts = [shift[:, columns[1], None] for shift in shifts]
    turned = own.sample(ROTATIONS, tracks, segment, step)[:, 0]
    placed = own.sample(TRANSLATIONS, shifts, segment, step)[:, 0]
    inside = np.diff(segment) == 0
    ways = np.where(np.arange(3) == up, 0.0, np.diff(placed, axis=0))[inside]
    yaws = yaw_rates(turned, up)[inside]
    captured = np.concatenate([ways, yaws[:, None]], axis=1)
    velocities = blend_root_velocity(captured, laid.cut, seams, config, laid.rate)
    rows = laid.unpack(segment, step, turned), laid.unpack(segment, step, placed)
    return integrate_root(velocities, captured, rows, joined, up)


def sample_states(
    algebra: ValueSpace, tracks: Sequence[FloatArray], clips: IntArray, frames: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return values and velocities per frame at frames of clips.

    Parameters
    ----------
    algebra : Algebra
        `ROTATIONS` for rotations, `TRANSLATIONS` for translations.
    tracks : sequence of ndarray, shape (n_frames, n_joints, 4 or 3)
        The values of each clip.
    clips, frames : ndarray of int, shape (n,)
        Where to look.

    Returns
    -------
    values : ndarray, shape (n, n_joints, 4 or 3)
        The values there.
    velocities : ndarray, shape (n, n_joints, 3)
        Their velocities; of rotations in the body's own frame.

    Notes
    -----
    The velocity is that of the curve that frames are sampled from: of the parabola through
    the frame and its neighbours, at a clip's end through the three nearest.
    """
    values = np.empty((len(frames), *tracks[0].shape[1:]))
    velocities = np.empty((*values.shape[:-1], 3))
    for clip in np.unique(clips):
        own = np.flatnonzero(clips == clip)
        track, at = tracks[clip], frames[own]
        values[own] = track[at]
        last = len(track) - 2
        before, after = (at - 1).clip(0), at.clip(max=last)
        before, after = _steps(algebra, track, before), _steps(algebra, track, after)
        mean = 0.5 * (before + after)
        if last > 0:
            ends = _steps(algebra, track, np.array([0, 1, last - 1, last]))
            mean[at == 0] = 1.5 * ends[0] - 0.5 * ends[1]
            mean[at > last] = 1.5 * ends[3] - 0.5 * ends[2]
        velocities[own] = mean
    return values, velocities


def _steps(algebra: ValueSpace, track: FloatArray, frames: IntArray) -> FloatArray:
    """Return the way from each frame to the next."""
    return algebra.delta(track[frames], track[frames + 1])


def _in_the_world(
    clips: Sequence[Motion],
    root: int,
    tracks: Sequence[FloatArray],
    shifts: Sequence[FloatArray],
    columns: tuple[int, int],
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return tracks with the root's rotation and place in the world."""
    if clips[0].skeleton.parents[root] < 0:
        return list(tracks), list(shifts)
    turns, places = [], []
    for clip, track, shift in zip(clips, tracks, shifts, strict=True):
        turned, placed = clip.world_transforms()
        turns.append(track.copy())
        places.append(shift.copy())
        turns[-1][:, columns[0]] = turned[:, root]
        places[-1][:, columns[1]] = placed[:, root]
    return turns, places


def _as_local(
    base: Motion, root: int, quats: FloatArray, places: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the root's rotation and place seen from its parent, which is the base's own."""
    parent = int(base.skeleton.parents[root])
    if parent < 0:
        return quats, places
    turned, placed = base.world_transforms()
    back = rotations.inverse(turned[:, parent])
    local = rotations.multiply(back, quats)
    spot = rotations.rotate(back, places - placed[:, parent])
    same = (quats == turned[:, root]).all(axis=1), (places == placed[:, root]).all(axis=1)
    return (
        np.where(same[0][:, None], base.rotations[:, root], local),
        np.where(same[1][:, None], base.positions[:, root], spot),
    )


def _trunks(base: Motion, joints: IntArray) -> list[int]:
    """Return the columns of those joints with which a trunk hangs on another group."""
    parts, parents = anatomy(base.skeleton).parts, base.skeleton.parents
    return [
        column
        for column, joint in enumerate(joints.tolist())
        if parts[joint] == "trunk" and parents[joint] >= 0 and parents[joint] not in joints
    ]


def _leans(clip: Motion, joints: IntArray, columns: Sequence[int], up: int) -> FloatArray:
    """Return how the joints that some joints hang on lean, whatever they face."""
    turned = clip.world_transforms()[0][:, clip.skeleton.parents[joints[list(columns)]]]
    return rotations.multiply(rotations.inverse(rotations.twist(turned, up)), turned)


def _upright(
    clip: Motion, joints: IntArray, columns: Sequence[int], track: FloatArray, up: int
) -> FloatArray:
    """Return rotations, those of some columns seen from a parent that does not lean."""
    if not columns:
        return track
    upright = track.copy()
    upright[:, columns] = rotations.multiply(_leans(clip, joints, columns, up), track[:, columns])
    return upright


def _on_its_pelvis(
    base: Motion, joints: IntArray, columns: Sequence[int], quats: FloatArray, up: int
) -> FloatArray:
    """Undo `_upright` by how the base leans; what is the base's own stays so to the bit."""
    if not columns:
        return quats
    local = quats.copy()
    own = base.rotations[:, joints]
    same = (quats == _upright(base, joints, columns, own, up)).all(axis=2)[:, columns]
    back = rotations.inverse(_leans(base, joints, columns, up))
    turned = rotations.multiply(back, quats[:, columns])
    turned /= np.linalg.norm(turned, axis=-1, keepdims=True)
    local[:, columns] = np.where(same[..., None], own[:, columns], turned)
    return local


def _travels(clips: Sequence[Motion], joints: IntArray) -> BoolArray:
    """Tell which joints' translations move in one of the clips."""
    travels: BoolArray = np.any([clip.travels[joints] for clip in clips], axis=0)
    return travels


def _windows(cut: Segments, seams: IntArray, most: int) -> tuple[IntArray, IntArray]:
    """Return the knots left and right of each seam between which the curve is laid anew.

    No window leaves the nearer half of a segment, so that two never overlap; segments of a
    single interval have none.
    """
    reach = np.minimum(np.minimum(cut.lengths[seams], cut.lengths[seams + 1]) // 2 - 1, most)
    at = cut.stop[seams][reach >= 0]
    reach = reach[reach >= 0]
    return at - (reach + 1), at + (reach + 1)


def _between(left: IntArray, right: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the frames inside windows, each one's window and how far through it it is."""
    inside = right - left - 1
    window = np.repeat(np.arange(len(left)), inside)
    step = np.arange(len(window)) - np.repeat(np.cumsum(inside) - inside, inside) + 1
    return left[window] + step, window, step / (right - left)[window]


def _smooth_rotations(quats: FloatArray, left: IntArray, right: IntArray) -> FloatArray:
    """Lay rotations anew between knots, meeting poses and velocities there."""
    if not len(left):
        return quats
    frames, window, t = _between(left, right)

    def velocity(knots: IntArray) -> FloatArray:
        across = rotations.multiply(rotations.inverse(quats[knots - 1]), quats[knots + 1])
        per_window: FloatArray = 0.5 * rotations.log(across) * (right - left)[:, None, None]
        return per_window

    n_joints = quats.shape[1]
    ends = (quats[left], quats[right], velocity(left), velocity(right))
    start, end, leaving, reaching = (v[window].reshape(-1, v.shape[-1]) for v in ends)
    curve = rotations.hermite(start, end, leaving, reaching, np.repeat(t, n_joints))
    smooth = quats.copy()
    smooth[frames] = curve.reshape(-1, n_joints, 4)
    return smooth


def _smooth_positions(places: FloatArray, left: IntArray, right: IntArray) -> FloatArray:
    """Lay positions anew between knots, as `_smooth_rotations` does rotations."""
    if not len(left) or not places.shape[1]:
        return places
    frames, window, t = _between(left, right)
    t = t[:, None, None]
    s = 1.0 - t
    width = (right - left)[window, None, None]
    a, b = left[window], right[window]
    leaving = 0.5 * (places[a + 1] - places[a - 1]) * width
    reaching = 0.5 * (places[b + 1] - places[b - 1]) * width
    smooth = places.copy()
    smooth[frames] = (
        places[a] * (s * s * (1.0 + 2.0 * t))
        + places[b] * (t * t * (1.0 + 2.0 * s))
        + leaving * (t * s * s)
        - reaching * (t * t * s)
    )
    return smooth
