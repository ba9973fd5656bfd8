"""Tracks of a body in the world, and the frames of the library that a graft was made from."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.body.anatomy import anatomy, feature_joints
from mograft.body.contacts import Ground
from mograft.body.joint_names import ARM
from mograft.body.mass import mass_model
from mograft.body.support_polygon import facing_directions, horizontal_axes
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton
from mograft.synthesis.graft_result import Graft

SAMPLE_RATE = 30.0  # samples per second that derivatives compare
BLOCK_SECONDS = 5.0  # duration of the blocks of frames that the bootstrap resamples


def landmarks(skeleton: Skeleton) -> dict[str, list[int]]:
    """Return the joints of each of the landmarks "head", "chest" and "hands".

    The position of a landmark is the end of its joint's bone. The chest is the nearest common
    ancestor of the joints of both arms. A landmark is absent if its joints are unknown.
    """
    known = anatomy(skeleton)
    head = mass_model(skeleton).head
    found = {"head": [] if head is None else [head], "chest": [], "hands": []}
    sides = {side: known.joints(*ARM, side=side) for side in ("left", "right")}
    if all(sides.values()):
        found["chest"] = [skeleton.common_ancestor([*sides["left"], *sides["right"]])]
    for side in sides:
        hands = known.joints("hand", side=side) or known.joints("forearm", side=side)[-1:]
        found["hands"] += hands[:1]
    return {name: joints for name, joints in found.items() if joints}


def bone_ends(motion: Motion, joints: Sequence[int] | IntArray) -> FloatArray:
    """Return the world positions of bone ends in skeleton heights, (n_frames, n_joints, 3)."""
    model = mass_model(motion.skeleton)
    indices = np.asarray(joints, np.int64)
    world_rotations, positions = motion.world_transforms()
    bones = rotations.rotate(world_rotations[:, indices], model.bone[indices])
    return (positions[:, indices] + bones) / model.height


def sample_stride(rate: float) -> int:
    """Return the interval, in frames, between samples at about 30 samples per second.

    `rate` is in frames per second.
    """
    return max(round(rate / SAMPLE_RATE), 1)


def jerk(points: FloatArray, rate: float) -> FloatArray:
    """Return the magnitude of the third derivative of points, shape (n_frames, ...).

    `points` has shape (n_frames, ..., 3) at `rate` frames per second; the result has its unit per
    s³. It is computed from differences of samples at about 30 per second, so that noise of single
    frames at higher rates has little effect. With s = ``sample_stride(rate)``, it is 0 in the first
    s and the last 2 s frames.
    """
    return np.linalg.norm(derivative(points, rate, 3), axis=-1)


def derivative(points: FloatArray, rate: float, order: int) -> FloatArray:
    """Return the derivative of order 1, 2 or 3 by differences of samples; 0 near both ends.

    The first and second derivatives are central differences. The third is the derivative halfway
    between a sample and the next one.
    """
    s = sample_stride(rate)
    found = np.zeros_like(points)
    before, after = ((s, s), (s, s), (s, 2 * s))[order - 1]
    n = len(points) - before - after
    if n < 1:
        return found
    weights = ((-0.5, 0.0, 0.5), (1.0, -2.0, 1.0), (-1.0, 3.0, -3.0, 1.0))[order - 1]
    for k, weight in enumerate(weights):
        found[before : before + n] += weight * points[k * s : k * s + n]
    found[before : before + n] *= (rate / s) ** order
    return found


@dataclass(frozen=True, eq=False)
class BodyTracks:
    """Hips and heading of a motion, and its bone ends relative to the hips, in every frame.

    Lengths are in skeleton heights. The first two axes are horizontal, the third points up.
    """

    hips: FloatArray  # world position, (n_frames, 3)
    heading: FloatArray  # radians about up, continuous, (n_frames,)
    points: FloatArray  # relative to the hips, not to the heading, (n_frames, n_points, 3)
    rate: float

    @classmethod
    def of(cls, motion: Motion) -> "BodyTracks":
        """Return the tracks of a motion; the heading is 0 without a known pair of legs."""
        ground = Ground.of(motion)
        # By name and not by length: bones of length 0 in some clips are points in all of them.
        above_hips = anatomy(motion.skeleton).joints("other")
        joints = feature_joints(motion.skeleton, np.arange(motion.n_joints))
        points = bone_ends(motion, joints[~np.isin(joints, above_hips)])
        horizontal = np.eye(3)[list(horizontal_axes(ground.up))]
        frame = np.column_stack([*horizontal, ground.up])
        facing = facing_directions(motion, ground) @ frame
        model = mass_model(motion.skeleton)
        hips = motion.world_positions()[:, model.hips] / model.height
        return cls(
            hips=hips @ frame,
            heading=np.unwrap(np.arctan2(facing[:, 1], facing[:, 0])),
            points=(points - hips[:, None]) @ frame,
            rate=motion.rate,
        )

    def __len__(self) -> int:
        return len(self.hips)

    @property
    def stride(self) -> int:
        """Interval, in frames, between samples at about 30 samples per second."""
        return sample_stride(self.rate)

    @cached_property
    def root_velocity(self) -> FloatArray:
        """Velocity of the hips in skeleton heights/s, and yaw rate in radians/s, (n_frames, 4)."""
        track = np.concatenate([self.hips, self.heading[:, None]], axis=1)
        return derivative(track, self.rate, 1)

    def facing_forward(self, vectors: FloatArray, frames: IntArray) -> FloatArray:
        """Rotate vectors about the vertical axis so that the heading at `frames` becomes 0.

        `vectors` has shape (n, ..., 3), `frames` has shape (n,).
        """
        angle = self.heading[frames].reshape(-1, *[1] * (vectors.ndim - 2))
        cos, sin = np.cos(angle), np.sin(angle)
        x, y, up = np.moveaxis(vectors, -1, 0)
        return np.stack([cos * x + sin * y, cos * y - sin * x, up], axis=-1)


@dataclass(frozen=True, eq=False)
class FrameBlocks:
    """Blocks of about five seconds into which clips are divided; a short clip is one block."""

    offsets: IntArray  # number of frames in the clips before each clip
    block: IntArray  # block of each frame, over the frames of all clips in order

    @classmethod
    def of(cls, library: Library) -> "FrameBlocks":
        """Divide each clip of a library into blocks of equal length, about five seconds."""
        lengths = np.array([entry.n_frames for entry in library.entries])
        counts = np.maximum(np.rint(lengths / (BLOCK_SECONDS * library.rate)), 1).astype(np.int64)
        firsts = np.cumsum(counts) - counts
        blocks = [
            first + np.arange(n) * count // n
            for first, n, count in zip(firsts, lengths, counts, strict=True)
        ]
        return cls(np.cumsum(lengths) - lengths, np.concatenate(blocks))

    def clip_of(self, frames: IntArray) -> tuple[IntArray, IntArray]:
        """Convert frame numbers over all clips to clip indices and frame numbers in these clips."""
        clip = np.searchsorted(self.offsets, frames, side="right") - 1
        return clip, frames - self.offsets[clip]


@dataclass(frozen=True, eq=False)
class Origin:
    """The captured frames from which the frames of a graft take the motion of one joint group.

    Captured frames are numbered over all clips. Donors are assumed to be stretched uniformly.
    """

    frames: IntArray  # captured frames, numbered over all clips, (n_frames,)
    is_exchanged: BoolArray  # (n_frames,)

    @classmethod
    def of(cls, graft: Graft, group: str, blocks: FrameBlocks) -> "Origin":
        """Return the origin of a grafted group; frames without a segment come from the base."""
        clips = clip_indices(graft.library)
        n = graft.motion.n_frames
        # The segments of a scenario have no frames between them, so its base need not be a clip.
        frames = blocks.offsets[clips.get(graft.base.name, 0)] + np.arange(n)
        is_exchanged = np.zeros(n, bool)
        for s in graft.substitutions:
            if s.group != group:
                continue
            own = np.arange(s.start, s.stop + 1)
            share = (own - s.start) / (s.stop - s.start)
            donor = s.donor_start + share * (s.donor_stop - s.donor_start)
            frames[own] = blocks.offsets[clips[s.clip]] + np.rint(donor).astype(np.int64)
            is_exchanged[own] = not s.is_own
        return cls(frames, is_exchanged)


def clip_indices(library: Library) -> dict[str, int]:
    """Return the index of each clip by its name."""
    return {entry.name: index for index, entry in enumerate(library.entries)}


def driving_group(graft: Graft, joints: Iterable[int]) -> str | None:
    """Return the grafted group that moves `joints`, or None if no grafted group moves any of them.

    A grafted group moves its own joints, and their descendants in groups that are not grafted. If
    several groups move `joints`, the one that moves the first such joint is returned.
    """
    library = graft.library
    group_of = {int(j): name for name in graft.alternatives for j in library.joints(name)}
    chains = ((joint, *library.skeleton.ancestors(joint)) for joint in joints)
    return next((group_of[above] for chain in chains for above in chain if above in group_of), None)
