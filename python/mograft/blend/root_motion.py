"""The root of a transplant: alignment of donors, motion over the floor, local coordinates.

Other joints return to their captured rotations after a seam. A root does not: its donor is aligned
to the root's position and heading at the seam, and decaying an offset would cause a velocity spike.
The velocities over the floor are blended at seams, and the path is their integral.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.blend.donor_timeline import DonorLayout, RootAlignment
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.seams import ROTATIONS, TRANSLATIONS
from mograft.config import Config
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments


@dataclass(frozen=True, eq=False)
class GraftedRoot:
    """A root joint whose motion is replaced by that of donors.

    The columns are its indices among the joints of the rotation and translation tracks of a layout.
    """

    joint: int
    up: int
    rotation_column: int
    position_column: int

    def close(
        self, layout: DonorLayout, base: Motion, clips: Sequence[Motion]
    ) -> tuple[DonorLayout, FloatArray, FloatArray]:
        """Align donors and close seams; return the layout, local rotations and translations."""
        layout = self.align(layout, base, clips)
        quats, positions = layout.close()
        self.integrate(layout, quats, positions)
        self.to_local(base, quats, positions)
        return layout, quats, positions

    def align(self, layout: DonorLayout, base: Motion, clips: Sequence[Motion]) -> DonorLayout:
        """Align each donor to the previous one; return the layout with the root in world axes.

        At a seam the next donor is rotated about the up axis and moved over the floor: its
        root then starts at the position and heading at which the previous donor ends. The first
        donor starts at those of the base.
        """
        layout = self._with_world_tracks(layout, clips)
        timeline, donors = layout.timeline, layout.timeline.donors
        tracks = self._own_tracks(layout)
        seams = layout.seams | timeline.find_seams(tracks[1])

        def donor_roots(frames: IntArray) -> RootTransforms:
            rows = list(zip(donors.clip.tolist(), frames.tolist(), strict=True))
            return RootTransforms(
                *(np.array([own[clip][row, 0] for clip, row in rows]) for own in tracks)
            )

        first, last = donor_roots(donors.start), donor_roots(donors.stop)
        quats, places = base[:1].world_transforms()
        target = RootTransforms(quats[:, self.joint], places[:, self.joint])
        moves = AlignmentTransform(np.empty((len(donors), 4)), np.empty((len(donors), 3)))
        for index in range(len(donors)):
            row = np.array([index])
            if not index or seams[index - 1]:
                move = AlignmentTransform.from_roots(first[row], target, self.up)
            moves.yaws[row], moves.translations[row] = move.yaws, move.translations
            target = move.apply(last[row])
        alignment = RootAlignment(moves, self.rotation_column, self.position_column)
        return replace(layout, timeline=replace(timeline, alignment=alignment), seams=seams)

    def integrate(self, layout: DonorLayout, quats: FloatArray, positions: FloatArray) -> None:
        """Blend root velocities at seams and set the root, in place, to the integrated path."""
        timeline, source = layout.timeline, self._source(layout)
        inside = np.diff(timeline.frame_times().segment) == 0
        steps = np.diff(source.positions, axis=0)
        steps = np.where(np.arange(3) == self.up, 0.0, steps)[inside]
        rates = yaw_rates(source.rotations, self.up)[inside]
        captured = np.concatenate([steps, rates[:, None]], axis=1)
        velocities = blend_root_velocity(
            captured, timeline.cut, layout.seams, layout.config, timeline.rate
        )
        source = source[timeline.kept_rows]
        root = integrate_root(velocities, captured, source, self._root(quats, positions), self.up)
        self._set_root(quats, positions, root)

    def to_local(self, base: Motion, quats: FloatArray, positions: FloatArray) -> None:
        """Convert the root's world rotations and positions to local ones, in place.

        Where they equal the world values of the base, the base's local values are used.
        """
        if base.skeleton.parents[self.joint] < 0:
            return
        root, parent = self._root(quats, positions), base.skeleton.parents[self.joint]
        base_rotations, base_positions = base.world_track(self.joint)
        has_base_rotation = (root.rotations == base_rotations).all(axis=1)
        has_base_position = (root.positions == base_positions).all(axis=1)
        local = root.relative_to(RootTransforms.from_motion(base, int(parent)))
        local.rotations[has_base_rotation] = base.rotations[has_base_rotation, self.joint]
        local.positions[has_base_position] = base.positions[has_base_position, self.joint]
        self._set_root(quats, positions, local)

    def _root(self, quats: FloatArray, positions: FloatArray) -> RootTransforms:
        """Return the rotations and positions of the root."""
        return RootTransforms(quats[:, self.rotation_column], positions[:, self.position_column])

    def _set_root(self, quats: FloatArray, positions: FloatArray, root: RootTransforms) -> None:
        quats[:, self.rotation_column] = root.rotations
        positions[:, self.position_column] = root.positions

    def _with_world_tracks(self, layout: DonorLayout, clips: Sequence[Motion]) -> DonorLayout:
        """Return the layout with the root's tracks in world coordinates."""
        if clips[0].skeleton.parents[self.joint] < 0:
            return layout
        quats = [track.copy() for track in layout.rotations]
        places = [track.copy() for track in layout.positions]
        for clip, rotation, position in zip(clips, quats, places, strict=True):
            self._set_root(rotation, position, RootTransforms.from_motion(clip, self.joint))
        return replace(layout, rotations=quats, positions=places)

    def _source(self, layout: DonorLayout) -> RootTransforms:
        """Return the aligned root at the times of `frame_times`, before seams are closed."""
        assert layout.timeline.alignment is not None
        alignment = replace(layout.timeline.alignment, rotation_column=0, position_column=0)
        timeline = replace(layout.timeline, alignment=alignment)
        times, own = timeline.frame_times(), self._own_tracks(layout)
        quats, places = map(timeline.sample, (ROTATIONS, TRANSLATIONS), own, (times, times))
        return RootTransforms(quats[:, 0], places[:, 0])

    def _own_tracks(self, layout: DonorLayout) -> tuple[list[FloatArray], list[FloatArray]]:
        """Return the rotations and translations of the root alone in each clip."""
        quats = [track[:, self.rotation_column, None] for track in layout.rotations]
        return quats, [track[:, self.position_column, None] for track in layout.positions]


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
