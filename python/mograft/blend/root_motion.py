"""The root of a transplant: alignment of donors, motion over the floor, local coordinates.

Other joints return to their captured rotations after a seam. A root does not: its donor is aligned
to the root's position and heading at the seam, and decaying an offset would cause a velocity spike.
The velocities over the floor are blended at seams, and the path is their integral.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.blend.donor_timeline import DonorTimeline
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.seams import ROTATIONS, TRANSLATIONS, ValueSpace
from mograft.config import Config
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.resample import clip_states
from mograft.motion.segments import Segments


def graft_root(
    base: Motion, clips: Sequence[Motion], timeline: DonorTimeline, joint: int, up: int
) -> tuple[BoolArray, RootTransforms]:
    """Replace the motion of a root `joint` by that of donors, aligned and with closed seams.

    Returns the seams, those of `timeline` and those of the path, and the local rotations and
    translations in all frames. `up` is the axis that points up.
    """
    pairs = [clip.world_track(joint) for clip in clips]
    quats, places = ([own[:, None] for own in kind] for kind in zip(*pairs, strict=True))
    tracks = {ROTATIONS: quats, TRANSLATIONS: places}
    timeline = replace(timeline, seams=timeline.seams | timeline.find_seams(places))
    timeline = replace(timeline, alignment=_align_donors(base, timeline, tracks, joint, up))
    times = timeline.frame_times()
    source = RootTransforms(*(timeline.sample(*own, *times)[:, 0] for own in tracks.items()))
    closed = RootTransforms(*(timeline.close(*own)[:, 0] for own in tracks.items()))
    root = _integrate(timeline, source, closed, up)
    return timeline.seams, _to_local(base, joint, root)


def _align_donors(
    base: Motion,
    timeline: DonorTimeline,
    tracks: Mapping[ValueSpace, Sequence[FloatArray]],
    joint: int,
    up: int,
) -> AlignmentTransform:
    """Return the transform that aligns each donor to the previous one.

    At a seam the next donor is rotated about the up axis and moved over the floor: its
    root then starts at the position and heading at which the previous donor ends. The first
    donor starts at those of the base. `tracks` are the rotations and positions of the root in each
    clip, in the world.
    """
    donors = timeline.donors
    first, last = (
        RootTransforms(*(clip_states(own, donors.clip, frames)[0][:, 0] for own in tracks.values()))
        for frames in (donors.start, donors.stop)
    )
    target = RootTransforms.from_motion(base[:1], joint)
    moves = AlignmentTransform(np.empty((len(donors), 4)), np.empty((len(donors), 3)))
    for index in range(len(donors)):
        row = np.array([index])
        if not index or timeline.seams[index - 1]:
            move = AlignmentTransform.from_roots(first[row], target, up)
        moves.yaws[row], moves.translations[row] = move.yaws, move.translations
        target = move.apply(last[row])
    return moves


def _integrate(
    timeline: DonorTimeline, source: RootTransforms, closed: RootTransforms, up: int
) -> RootTransforms:
    """Blend root velocities at seams and return the integrated path; see `integrate_root`.

    `source` is the aligned root at the times of `frame_times`, before seams are closed.
    """
    inside = np.diff(timeline.frame_times()[0]) == 0
    steps = np.diff(source.positions, axis=0)
    steps = np.where(np.arange(3) == up, 0.0, steps)[inside]
    captured = np.concatenate([steps, yaw_rates(source.rotations, up)[inside, None]], axis=1)
    velocities = blend_root_velocity(
        captured, timeline.cut, timeline.seams, timeline.config, timeline.rate
    )
    return integrate_root(velocities, captured, source[timeline.kept_rows], closed, up)


def _to_local(base: Motion, joint: int, root: RootTransforms) -> RootTransforms:
    """Convert the root's world rotations and positions to local ones.

    Where they equal the world values of the base, the base's local values are used.
    """
    known = RootTransforms.from_motion(base, joint)
    local = root.relative_to_parent(base, np.arange(base.n_frames), joint)
    is_same = (root.rotations == known.rotations).all(axis=1, keepdims=True)
    quats = np.where(is_same, base.rotations[:, joint], local.rotations)
    is_same = (root.positions == known.positions).all(axis=1, keepdims=True)
    return RootTransforms(quats, np.where(is_same, base.positions[:, joint], local.positions))


def root_velocity_weights(
    frames: FloatArray, lengths: IntArray, config: Config, rate: float
) -> tuple[FloatArray, FloatArray]:
    """Return the weights of `SeamTreatment.root_velocity_weights`, before and after a seam.

    `frames` are distances of points in time from the seam, `lengths` the lengths of the segments
    that contain these points, both in frames; the shapes broadcast. `rate` is in frames per second.
    """
    remaining = np.maximum(1.0 - frames / np.minimum(config.seam_blend * rate, lengths), 0.0)
    return SEAM_TREATMENTS[config.seam].root_velocity_weights(remaining)


def blend_root_velocity(
    velocities: FloatArray, cut: Segments, seams: BoolArray, config: Config, rate: float
) -> FloatArray:
    """Cross-fade the velocities of the root at seams.

    `velocities`, shape (n, k), are the changes from each frame to the next. The segments `cut` are
    in order of time and cover all frames; `seams`, shape (len(cut) - 1,), marks those that end with
    a seam. Each result is a weighted mean of given velocities, so that none exceeds their maximum.
    A velocity that is not blended is kept bit for bit. A seam changes only the two segments that
    meet there.
    """
    segment = np.repeat(np.arange(len(cut)), cut.lengths)
    frames = np.arange(len(velocities), dtype=np.float64) + 0.5
    lengths = cut.lengths[segment]
    is_seam = np.concatenate([[False], seams, [False]])
    after = root_velocity_weights(frames - cut.start[segment], lengths, config, rate)[1]
    before = root_velocity_weights(cut.stop[segment] - frames, lengths, config, rate)[0]
    after, before = after * is_seam[segment], before * is_seam[segment + 1]
    previous = velocities[cut.start[segment] - 1]
    following = velocities[cut.stop[segment] % len(velocities)]
    blended: FloatArray = velocities + after[:, None] * (previous - velocities)
    blended += before[:, None] * (following - velocities)
    return blended


def yaw_rates(quats: FloatArray, up: int) -> FloatArray:
    """Return the angles in radians by which a joint turns about the up axis from frame to frame."""
    steps = rotations.multiply(quats[1:], rotations.inverse(quats[:-1]))
    return rotations.log(rotations.twist(steps, up))[:, up]


def integrate_root(
    velocities: FloatArray,
    captured: FloatArray,
    source: RootTransforms,
    closed: RootTransforms,
    up: int,
) -> RootTransforms:
    """Integrate root velocities and yaw rates into a path over the floor.

    `source` is the root in n frames before seams are closed, `closed` after that. `captured`, shape
    (n - 1, 4), has the displacement of `source` over the floor from each frame to the next, in
    world axes, and the rotation of `source` about the up axis in radians; `velocities` is
    `captured` with blended seams. The displacements are rotated by the difference between the new
    heading and that of `source`. The result has the lean and height of `closed`, and its yaw rate
    never exceeds the largest one in `captured`. Its floor positions equal those of `source`, bit
    for bit, up to the first frame in which `velocities` and `captured` differ.
    """
    leaning = closed.rotations
    change = rotations.multiply(leaning, rotations.inverse(source.rotations))
    facing = rotations.multiply(rotations.inverse(rotations.twist(change, up)), leaning)
    is_same = (leaning == source.rotations).all(axis=1, keepdims=True)
    facing = np.where(is_same, leaning, facing)
    extra = velocities[:, 3] - captured[:, 3]
    # A change of lean alters the yaw rate slightly, possibly at its maximum.
    rate = yaw_rates(facing, up)
    limit = np.abs(captured[:, 3]).max(initial=0.0)
    is_too_fast = np.abs(rate + extra) > limit
    extra = np.where(is_too_fast, np.clip(rate + extra, -limit, limit) - rate, extra)
    yaws = np.concatenate([[0.0], np.cumsum(extra)])
    heading = rotations.from_axis_angle(np.eye(3)[up], yaws)
    heading[yaws == 0.0] = rotations.IDENTITY
    quats = np.where(yaws[:, None] == 0.0, facing, rotations.multiply(heading, facing))
    steps = rotations.rotate(heading[:-1], velocities[:, :3]) - captured[:, :3]
    moved = source.positions + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return RootTransforms(quats, np.where(np.arange(3) == up, closed.positions, moved))
