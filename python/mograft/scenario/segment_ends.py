"""Pose, velocity and contacts of the base group at the ends of segments, and costs between them."""

from dataclasses import dataclass, fields

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.gaussian import gaussian_filter
from mograft.analysis.segmentation import kinetic_energy
from mograft.blend.root_motion import root_velocity_weights, yaw_rates
from mograft.body.anatomy import feature_joints
from mograft.body.contacts import detect_contacts
from mograft.body.mass import mass_model
from mograft.body.size import resize
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.resample import clip_states

_TILT_WEIGHT, _HEIGHT_WEIGHT = 1.0, 2.0  # per radian of root tilt; per skeleton height of the root
_VELOCITY_SECONDS = 0.1  # cost of a velocity difference, relative to the cost of a pose difference
_ACCELERATION_SECONDS = 0.15
_MAX_CHUNK = 1 << 22  # approximate number of values that are compared at a time


@dataclass(frozen=True, eq=False)
class SegmentEnds:
    """Pose, velocity and foot contacts at the starts, or at the ends, of n segments.

    The joints are the feature joints of the base group without the root. If the base group does not
    contain the root, all quantities of the root except `root_rotations` and `root_positions` are 0
    or the identity.
    """

    poses: FloatArray  # (n, n_joints, 4): local rotations
    joint_velocities: FloatArray  # (n, n_joints, 3): in radians per second
    root_rotations: FloatArray  # (n, 4): in the world
    root_positions: FloatArray  # (n, 3): in the world, in the file's unit
    tilts: FloatArray  # (n, 4): world rotation of the root without its heading
    heights: FloatArray  # (n,): of the root, in skeleton heights
    root_velocities: FloatArray  # (n, 3): seen from its heading, in heights per second
    root_angular_velocities: FloatArray  # (n, 3): in radians per second
    root_accelerations: FloatArray  # (n,): maximum over the floor within 0.15 s, heights/s²
    contacts: BoolArray  # (n, n_feet): which feet are on the floor
    is_at_rest: BoolArray  # (n,): whether the segment ends at a minimum of kinetic energy
    steps: FloatArray  # (n, 4): floor displacement and yaw between the two frames at this end
    # A seam blends the root velocities of both sides: near this end, each step of this segment is
    # replaced in part by a step of the segment on the other side of the seam.
    weight_sums: FloatArray  # (n,): sum over the steps of the weight of the other segment
    faded_steps: FloatArray  # (n, 4): sum over the steps of the weight times this segment's step

    def feature_points(self) -> FloatArray:
        """Return one point per segment, shape (n, n_features), to find transitions of low cost.

        The transition cost is a sum of terms. The squared distance between the points of an end and
        a start is the sum of the squared terms, with the mean of squares over the joints. For large
        angles the distance is smaller.
        """
        n, n_joints = self.poses.shape[:2]
        share = max(n_joints, 1) ** -0.5
        # The distance of two rotation matrices is √8 sin(angle / 2): the same for q and -q.
        poses = rotations.rotate(self.poses[..., None, :], np.eye(3)) * (share / np.sqrt(2.0))
        tilts = rotations.rotate(self.tilts[:, None], np.eye(3)) * (_TILT_WEIGHT / np.sqrt(2.0))
        return np.concatenate(
            [
                poses.reshape(n, -1),
                tilts.reshape(n, -1),
                self.joint_velocities.reshape(n, -1) * (share * _VELOCITY_SECONDS),
                _HEIGHT_WEIGHT * self.heights[:, None],
                _HEIGHT_WEIGHT * _VELOCITY_SECONDS * self.root_velocities,
                _TILT_WEIGHT * _VELOCITY_SECONDS * self.root_angular_velocities,
            ],
            axis=1,
        )


def segment_ends(library: Library, segments: IntArray) -> tuple[SegmentEnds, SegmentEnds]:
    """Read the starts and the ends of segments from the library; each clip is read once."""
    clip_of = library.segments.clip[segments]
    pairs = [
        _clip_ends(library, clip, segments[clip_of == clip]) for clip in np.unique(clip_of).tolist()
    ]
    names = [field.name for field in fields(SegmentEnds)]
    starts, ends = (
        SegmentEnds(*(np.concatenate([getattr(part, name) for part in side]) for name in names))
        for side in zip(*pairs, strict=True)
    )
    return starts, ends


def _clip_ends(library: Library, index: int, segments: IntArray) -> tuple[SegmentEnds, SegmentEnds]:
    """Return the starts and the ends of some segments of one clip."""
    cut, config, rate = library.segments, library.config, library.rate
    clip = resize(library.clips[index], library.skeleton)
    root, up = library.root, library.up
    members = library.joints(library.groups.base)
    joints = clip.rotations[:, np.setdiff1d(feature_joints(library.skeleton, members), [root])]
    has_root = bool((members == root).any())
    scale, height = float(has_root), mass_model(clip.skeleton).height
    quats, positions = (values[:, root] for values in clip.world_transforms())
    is_level = np.arange(3) != up
    root_velocity = np.gradient(positions, axis=0) * clip.rate
    acceleration = np.gradient(root_velocity, axis=0)[:, is_level]
    accelerations = np.linalg.norm(acceleration, axis=1) * (clip.rate / height)
    floor_steps = np.where(is_level, np.diff(positions, axis=0), 0.0)
    clip_steps = np.concatenate([floor_steps, yaw_rates(quats, up)[:, None]], axis=1)
    contacts = np.logical_or(*np.moveaxis(detect_contacts(clip), 2, 0))
    is_at_rest = _is_at_rest(library, index, clip, segments)
    # Weights of the root velocity of the segment on the other side of a seam, for each step inward.
    distances = np.arange(0.5, np.ceil(config.seam_blend * rate))
    weights = root_velocity_weights(distances, cut.lengths[segments][:, None], config, rate)
    count, near = np.arange(len(distances)), np.arange(round(_ACCELERATION_SECONDS * rate) + 1)

    def read(frames: IntArray, direction: int, weights: FloatArray) -> SegmentEnds:
        """Return the ends at some frames; `direction` leads inward: 1 for starts, -1 for ends."""
        first = 0 * segments
        poses, velocities, _ = clip_states([joints], first, frames)
        _, angular, _ = clip_states([quats[:, None]], first, frames)
        inverse_yaws = rotations.inverse(rotations.twist(quats[frames], up))
        tilts = rotations.multiply(inverse_yaws, quats[frames])
        if not has_root:
            tilts[:] = rotations.IDENTITY
        velocity = rotations.rotate(inverse_yaws, root_velocity[frames])
        inside = (frames[:, None] + direction * near).clip(0, len(accelerations) - 1)
        inward = frames[:, None] + direction * count - (direction < 0)
        steps = clip_steps[inward.clip(0, len(clip_steps) - 1)]
        return SegmentEnds(
            poses=poses,
            joint_velocities=velocities * rate,
            root_rotations=quats[frames],
            root_positions=positions[frames],
            tilts=tilts,
            heights=scale * positions[frames, up] / height,
            root_velocities=scale * velocity / height,
            root_angular_velocities=scale * angular[:, 0] * rate,
            root_accelerations=scale * accelerations[inside].max(axis=1),
            contacts=contacts[frames],
            is_at_rest=is_at_rest,
            steps=scale * steps[:, 0],
            weight_sums=weights.sum(axis=1),
            faded_steps=scale * (weights[..., None] * steps).sum(axis=1),
        )

    before, after = weights
    return read(cut.start[segments], 1, after), read(cut.stop[segments], -1, before)


def _is_at_rest(library: Library, index: int, clip: Motion, segments: IntArray) -> BoolArray:
    """Return whether each segment ends at a minimum of the smoothed kinetic energy."""
    cut, config = library.segments, library.config
    energy = kinetic_energy(clip, omega=config.omega, inertia=config.inertia)
    energy = gaussian_filter(energy, config.smoothing * clip.rate)
    bounds = np.append(cut.start[cut.clip == index], clip.n_frames - 1)
    stop = cut.stop[segments]
    following = bounds[np.minimum(np.searchsorted(bounds, stop) + 1, len(bounds) - 1)]
    at_next = np.where(following > stop, energy[following], np.inf)
    return energy[stop] < np.minimum(energy[cut.start[segments]], at_next)


def transition_costs(
    ends: SegmentEnds, starts: SegmentEnds, source: IntArray, target: IntArray
) -> FloatArray:
    """Return the cost in radians of each transition from an end to a start; see `transitions`.

    `source` are indices into `ends`, `target` into `starts`, both of shape (n,).
    """
    costs = np.zeros(len(source))
    n_joints = ends.poses.shape[1]
    step = max(_MAX_CHUNK // (8 * max(n_joints, 1)), 1)
    for first in range(0, len(source), step):
        i, j = source[first : first + step], target[first : first + step]
        chunk = _TILT_WEIGHT * rotations.angle(ends.tilts[i], starts.tilts[j])
        chunk += _HEIGHT_WEIGHT * np.abs(ends.heights[i] - starts.heights[j])
        if n_joints:
            chunk += rotations.angle(ends.poses[i], starts.poses[j]).mean(axis=1)
            difference = ends.joint_velocities[i] - starts.joint_velocities[j]
            chunk += _VELOCITY_SECONDS * np.linalg.norm(difference, axis=-1).mean(axis=1)
        for weight, before, after in (
            (_HEIGHT_WEIGHT, ends.root_velocities, starts.root_velocities),
            (_TILT_WEIGHT, ends.root_angular_velocities, starts.root_angular_velocities),
        ):
            difference = before[i] - after[j]
            chunk += weight * _VELOCITY_SECONDS * np.linalg.norm(difference, axis=-1)
        costs[first : first + step] = chunk
    return costs
