"""The root's part of a transplant: alignment of donors, root motion, and local coordinates."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.blend.donor_timeline import DonorLayout, DonorTimeline, RootAlignment
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms
from mograft.blend.root_motion import blend_root_velocity, integrate_root, yaw_rates
from mograft.blend.value_spaces import ROTATIONS, TRANSLATIONS
from mograft.motion.motion import Motion


@dataclass(frozen=True, eq=False)
class GraftedRoot:
    """A root joint whose motion is replaced by that of donors.

    The columns are its indices among the joints of the rotation and translation tracks of a layout.
    """

    joint: int
    up: int
    rotation_column: int
    position_column: int

    @classmethod
    def from_columns(
        cls, joint: int, up: int, joints: IntArray, moving: BoolArray
    ) -> "GraftedRoot":
        """Find the columns of the root; `moving` marks the joints with translation tracks."""
        is_root = joints == joint
        return cls(joint, up, int(np.argmax(is_root)), int(np.argmax(is_root[moving])))

    def close(
        self, layout: DonorLayout, base: Motion, clips: Sequence[Motion]
    ) -> tuple[DonorLayout, FloatArray, FloatArray]:
        """Align donors and close seams; return the layout, local rotations and translations."""
        layout = self.align(layout, base, clips)
        quats, positions = layout.smooth(*layout.close())
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
        positions = [track[:, self.position_column, None] for track in layout.positions]
        seams = layout.seams | timeline.find_seams(positions)
        first, last = (self._donor_roots(layout, frames) for frames in (donors.start, donors.stop))
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
        timeline = layout.timeline
        times = timeline.frame_times()
        source = self._source(layout)
        inside = np.diff(times.segment) == 0
        steps = np.diff(source.positions, axis=0)
        steps = np.where(np.arange(3) == self.up, 0.0, steps)[inside]
        rates = yaw_rates(source.rotations, self.up)[inside]
        captured = np.concatenate([steps, rates[:, None]], axis=1)
        velocities = blend_root_velocity(
            captured, timeline.cut, layout.seams, layout.config, timeline.rate
        )
        source = RootTransforms(
            timeline.merge_frames(source.rotations), timeline.merge_frames(source.positions)
        )
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
        local = root.relative_to(RootTransforms(*base.world_track(int(parent))))
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
            world = RootTransforms(*clip.world_track(self.joint))
            self._set_root(rotation, position, world)
        return replace(layout, rotations=quats, positions=places)

    def _donor_roots(self, layout: DonorLayout, frames: IntArray) -> RootTransforms:
        """Return the root's transform in one frame of each donor's clip, shape (n_donors,)."""
        rows = list(zip(layout.timeline.donors.clip.tolist(), frames.tolist(), strict=True))
        return RootTransforms(
            np.array([layout.rotations[clip][row, self.rotation_column] for clip, row in rows]),
            np.array([layout.positions[clip][row, self.position_column] for clip, row in rows]),
        )

    def _source(self, layout: DonorLayout) -> RootTransforms:
        """Return the aligned root at the times of `frame_times`, before seams are closed."""
        alignment = layout.timeline.alignment
        assert alignment is not None
        timeline: DonorTimeline = replace(
            layout.timeline, alignment=RootAlignment(alignment.transforms, 0, 0)
        )
        times = timeline.frame_times()
        quats = [track[:, self.rotation_column, None] for track in layout.rotations]
        places = [track[:, self.position_column, None] for track in layout.positions]
        return RootTransforms(
            timeline.sample(ROTATIONS, quats, times)[:, 0],
            timeline.sample(TRANSLATIONS, places, times)[:, 0],
        )
