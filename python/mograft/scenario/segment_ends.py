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
    starts: list[SegmentEnds] = []
    ends: list[SegmentEnds] = []
    for clip in np.unique(clip_of):
        reader = _ClipEnds(library, int(clip), library.clips[int(clip)])
        indices = segments[clip_of == clip]
        starts.append(reader.read(indices, is_start=True))
        ends.append(reader.read(indices, is_start=False))
    return _concatenate(starts), _concatenate(ends)


def _concatenate(parts: list[SegmentEnds]) -> SegmentEnds:
    return SegmentEnds(
        **{
            field.name: np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(SegmentEnds)
        }
    )


class _ClipEnds:
    """One clip of a library, from which starts and ends of its segments are read."""

    def __init__(self, library: Library, index: int, clip: Motion) -> None:
        self._library, self._index, self._clip = library, index, clip
        members = library.joints(library.groups.base)
        self._joints = np.setdiff1d(feature_joints(library.skeleton, members), [library.root])
        self._has_root = bool((members == library.root).any())
        self._height = mass_model(clip.skeleton).height
        self._quats, self._positions = (
            values[:, library.root] for values in clip.world_transforms()
        )
        self._velocity = np.gradient(self._positions, axis=0) * clip.rate
        acceleration = np.gradient(self._velocity, axis=0)[:, np.arange(3) != library.up]
        self._accelerations = np.linalg.norm(acceleration, axis=1) * (clip.rate / self._height)
        self._contacts = np.logical_or(*np.moveaxis(detect_contacts(clip), 2, 0))
        is_level = np.arange(3) != library.up
        steps = np.where(is_level, np.diff(self._positions, axis=0), 0.0)
        yaws = yaw_rates(self._quats, library.up)
        self._steps = np.concatenate([steps, yaws[:, None]], axis=1)

    def read(self, segments: IntArray, *, is_start: bool) -> SegmentEnds:
        """Return the starts or the ends of some segments of this clip."""
        library, cut = self._library, self._library.segments
        frames = (cut.start if is_start else cut.stop)[segments]
        first = 0 * segments
        joints = self._clip.rotations[:, self._joints]
        poses, velocities, _ = clip_states([joints], first, frames)
        _, angular, _ = clip_states([self._quats[:, None]], first, frames)
        inverse_yaws = rotations.inverse(rotations.twist(self._quats[frames], library.up))
        tilts = rotations.multiply(inverse_yaws, self._quats[frames])
        if not self._has_root:
            tilts[:] = rotations.IDENTITY
        velocity = rotations.rotate(inverse_yaws, self._velocity[frames])
        scale = float(self._has_root)
        inward = np.arange(round(_ACCELERATION_SECONDS * library.rate) + 1)
        near = frames[:, None] + (inward if is_start else -inward)
        near = near.clip(0, len(self._accelerations) - 1)
        steps, weights = self._steps_inward(segments, frames, is_start=is_start)
        return SegmentEnds(
            poses=poses,
            joint_velocities=velocities * library.rate,
            root_rotations=self._quats[frames],
            root_positions=self._positions[frames],
            tilts=tilts,
            heights=scale * self._positions[frames, library.up] / self._height,
            root_velocities=scale * velocity / self._height,
            root_angular_velocities=scale * angular[:, 0] * library.rate,
            root_accelerations=scale * self._accelerations[near].max(axis=1),
            contacts=self._contacts[frames],
            is_at_rest=self._is_at_rest(segments),
            steps=scale * steps[:, 0],
            weight_sums=weights.sum(axis=1),
            faded_steps=scale * (weights[..., None] * steps).sum(axis=1),
        )

    def _steps_inward(
        self, segments: IntArray, frames: IntArray, *, is_start: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return the root's steps per frame near segment ends, ordered from the end inward.

        The second result has, for each step, the weight of the root velocity of the segment on the
        other side of the seam.
        """
        library = self._library
        distances = np.arange(0.5, np.ceil(library.config.seam_blend * library.rate))
        count = np.arange(len(distances))
        inward = frames[:, None] + count if is_start else frames[:, None] - count - 1
        steps = self._steps[inward.clip(0, len(self._steps) - 1)]
        lengths = library.segments.lengths[segments][:, None]
        before, after = root_velocity_weights(distances, lengths, library.config, library.rate)
        return steps, after if is_start else before

    def _is_at_rest(self, segments: IntArray) -> BoolArray:
        """Return whether each segment ends at a minimum of the smoothed kinetic energy."""
        cut, config, clip = self._library.segments, self._library.config, self._clip
        energy = kinetic_energy(clip, omega=config.omega, inertia=config.inertia)
        energy = gaussian_filter(energy, config.smoothing * clip.rate)
        bounds = np.append(cut.start[cut.clip == self._index], clip.n_frames - 1)
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
