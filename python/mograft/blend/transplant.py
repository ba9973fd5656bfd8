"""Transplant: the motion of a joint group, taken from donor segments (paper, 4.5)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.analysis.channel_groups import ChannelKey, merge_axes, split_axes
from mograft.blend.donor_timeline import DonorTimeline
from mograft.blend.recombine import Part
from mograft.blend.root_motion import graft_root
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.seams import ROTATIONS, TRANSLATIONS
from mograft.blend.trunk_lean import TrunkLean
from mograft.body.size import resize
from mograft.config import Config
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments

_MAX_BLOCK_VALUES = 1 << 21
"""Maximum number of joint rotations (joints times frames) of a group that is transplanted at once:
several arrays of 64 MiB. A larger group is divided into ranges of joints of a quarter of this size,
which need less memory beside the array of the whole group."""


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
    base. Their lengths are scaled to the size of the base by `resize`.

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
    timeline = DonorTimeline(cut, donors, base.rate, config)
    lean = lean or TrunkLean.from_config(base, joints, group.up, config)
    moving: BoolArray = np.any([clip.is_translated[joints] for clip in clips], axis=0)
    is_root = joints == group.root
    seams = timeline.find_seams([clip.rotations for clip in clips], joints)
    channels = [split_axes(clip, group.held) for clip in clips] if group.held else []
    if channels:
        seams |= timeline.find_seams(channels)
    timeline = replace(timeline, seams=seams)
    has_places = bool((moving | is_root).any())
    positions = base.positions.take(joints, axis=1) if has_places else None
    resized = [resize(clip, base.skeleton) for clip in clips] if has_places else clips
    if is_root.any():
        root = int(joints[is_root][0])
        seams, grafted = graft_root(base, resized, timeline, root, group.up)
        timeline, moving = replace(timeline, seams=seams), moving & ~is_root
    quats = np.empty((base.n_frames, len(joints), 4))
    for block in _joint_blocks(cut, len(joints), max(clip.n_frames for clip in clips)):
        own, is_moving = joints[block], moving[block]
        tracks = [lean.upright_tracks(clip, block) for clip in clips]
        places = [clip.positions.take(own[is_moving], axis=1) for clip in resized]
        quats[:, block] = timeline.close(ROTATIONS, tracks)
        if positions is not None:
            positions[:, block][:, is_moving] = timeline.close(TRANSLATIONS, places)
    if positions is not None and is_root.any():
        column = int(is_root.argmax())
        quats[:, column], positions[:, column] = grafted.rotations, grafted.positions
    lean.restore(base, quats)
    angles = {}
    if channels:
        angles = _channel_angles(base, group.held, timeline.close(ROTATIONS, channels))
    return Part(joints, quats, positions, cut.stop[:-1][seams], angles)


def seam_reach(config: Config) -> float:
    """Return the distance in seconds from a segment within which its donor affects the motion.

    Frames farther away change by at most 1/10,000 of a gap if the donor changes.
    """
    return config.seam_blend + SEAM_TREATMENTS[config.seam].coupling


def _joint_blocks(cut: Segments, n_joints: int, n_clip_frames: int) -> list[slice]:
    """Return ranges of joints that are transplanted together.

    In a long motion, or if the longest clip of a donor has many frames, `n_clip_frames`, a range
    has few joints, so that its arrays take little memory.
    """
    n_rows, width = max(int(cut.lengths.sum()) + len(cut), n_clip_frames), n_joints
    if n_rows * width > _MAX_BLOCK_VALUES:
        width = max(_MAX_BLOCK_VALUES // 4 // n_rows, 1)
    return [slice(start, start + width) for start in range(0, n_joints, max(width, 1))]


def _channel_angles(
    base: Motion, held: Mapping[int, str], quats: FloatArray
) -> dict[ChannelKey, FloatArray]:
    """Return the angle of each single channel in radians; NaN in frames that keep the base's."""
    is_changed = (quats != split_axes(base, held)).any(axis=2)
    return {
        key: np.where(is_changed[:, column], angle, np.nan)
        for column, (key, angle) in enumerate(merge_axes(quats, held).items())
    }
