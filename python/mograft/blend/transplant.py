"""Transplant: the motion of a joint group, taken from donor segments (paper, 4.5)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.channel_groups import ChannelKey, merge_axes, split_axes
from mograft.analysis.segmentation import Segments
from mograft.blend.donor_timeline import DonorLayout, DonorTimeline
from mograft.blend.recombine import Part
from mograft.blend.root_transplant import GraftedRoot
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.time_warp import ALIGNMENTS
from mograft.blend.trunk_lean import TrunkLean
from mograft.config import Config
from mograft.motion.motion import Motion


@dataclass(frozen=True, eq=False)
class GraftedGroup:
    """A joint group whose motion is replaced by that of donors.

    If `root` is one of `joints`, every donor is aligned so that the root starts at the floor
    position and heading at which the previous donor ends. The first donor starts at those of the
    base.
    """

    joints: IntArray  # including joints of which the group holds only single channels
    root: int | None = None  # the joint whose translation moves the body through the world
    up: int = 1  # the axis that points up: 0, 1 or 2
    base_joints: IntArray | None = None  # joints that ``alignment="dtw"`` compares
    held: Mapping[int, str] = field(default_factory=dict)  # axes of single channels, by joint

    @property
    def whole_joints(self) -> IntArray:
        """The joints of which all channels belong to the group, ascending."""
        return np.setdiff1d(self.joints, list(self.held)).astype(np.int64)


def transplant(
    base: Motion,
    cut: Segments,
    donors: Segments,
    clips: Sequence[Motion],
    group: GraftedGroup,
    config: Config,
    lean: TrunkLean | None = None,
) -> Part:
    """Return the motion of a joint group in which donor segments replace base segments.

    `cut` contains the segments of the base in order of time, `donors` the donor of each, which may
    be the segment itself. `donors.clip` are indices into `clips`, which have the hierarchy of the
    base.

    Every donor is resampled to the length of its base segment, by a curve that also depends on the
    neighbouring frames of its clip. There is a seam between two successive donors if either is
    stretched or they are not consecutive in a clip; there the treatment of `Config.seam` closes the
    gap. Unstretched donors that are consecutive in a clip give that clip bit for bit, except for an
    aligned root and for the joints of `TrunkLean`. A joint's translation is replaced only if it
    varies in the clip of a donor; otherwise the base's bone length is kept.

    `lean` is the `TrunkLean` of the group on the base; by default it is computed.
    """
    # Clips of a stored library are read on access, so only those of the donors are accessed.
    used, clip = np.unique(donors.clip, return_inverse=True)
    donors, clips = replace(donors, clip=clip), [clips[index] for index in used]
    joints = group.whole_joints
    timeline = DonorTimeline(cut, donors, base.rate)
    align = ALIGNMENTS.get(config.alignment)
    if align is not None and group.base_joints is not None:
        warp = align(base, cut, donors, clips, group.base_joints)
        timeline = replace(timeline, warp=warp)
    lean = lean or TrunkLean.from_config(base, joints, group.up, config)
    moving: BoolArray = np.any([clip.is_translated[joints] for clip in clips], axis=0)
    if group.root is not None and (joints == group.root).any():
        moving |= joints == group.root
        root = GraftedRoot.from_columns(group.root, group.up, joints, moving)
        layout = _lay_out(timeline, clips, group, lean, moving, config)
        layout, quats, moved = root.close(layout, base, clips)
    else:
        layout = _lay_out(timeline, clips, group, lean, moving, config)
        quats, moved = layout.smooth(*layout.close())
    positions = None
    if moving.any():
        positions = base.positions.take(joints, axis=1)
        positions[:, moving] = moved
    channel_quats = quats[:, len(joints) :]
    quats = np.ascontiguousarray(quats[:, : len(joints)])
    lean.restore(base, quats)
    return Part(
        joints,
        quats,
        positions,
        cut.stop[:-1][layout.seams],
        _channel_angles(base, group.held, channel_quats),
    )


def seam_reach(config: Config) -> float:
    """Return the distance in seconds from a segment within which its donor affects the motion.

    Frames farther away change by at most 1/10,000 of a gap if the donor changes.
    """
    return config.seam_blend + SEAM_TREATMENTS.get(config.seam).coupling


def _lay_out(
    timeline: DonorTimeline,
    clips: Sequence[Motion],
    group: GraftedGroup,
    lean: TrunkLean,
    moving: BoolArray,
    config: Config,
) -> DonorLayout:
    """Return the layout of a group; in its arrays, single channels come after whole joints."""
    joints = group.whole_joints
    quats = [lean.upright_tracks(clip) for clip in clips]
    seams = timeline.find_seams([clip.rotations for clip in clips], joints)
    if group.held:
        channels = [split_axes(clip, group.held) for clip in clips]
        quats = [np.concatenate(pair, axis=1) for pair in zip(quats, channels, strict=True)]
        seams |= timeline.find_seams(channels)
    positions = [clip.positions.take(joints[moving], axis=1) for clip in clips]
    return DonorLayout(timeline, quats, positions, seams, config)


def _channel_angles(
    base: Motion, held: Mapping[int, str], quats: FloatArray
) -> dict[ChannelKey, FloatArray]:
    """Return the angle of each single channel in radians; NaN in frames that keep the base's."""
    is_changed = (quats != split_axes(base, held)).any(axis=2)
    return {
        key: np.where(is_changed[:, column], angle, np.nan)
        for column, (key, angle) in enumerate(merge_axes(quats, held).items())
    }
