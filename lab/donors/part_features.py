"""Features of the parts of segments, independent of the features that the clusters use."""

import numpy as np

from mograft import rotations
from mograft.body.anatomy import feature_joints
from mograft.body.mass import mass_model

N_INSTANTS = 10  # equidistant instants of a segment at which features are sampled


def part_features(library, group):
    """Return features of the motion of a joint group in every segment, (n_segments, n_features).

    The features are the positions of the ends of the bones at ten equidistant instants in skeleton
    heights, then their velocities in skeleton heights/s. For the base group they are relative to
    the root and to its heading at the start of the segment, and include the path of the root. For
    other groups they are relative to the joint that the group is attached to, so that only the
    features of the base group contain the position and rotation of the root.
    """
    skeleton, cut = library.skeleton, library.segments
    joints = library.joints(group)
    ends = feature_joints(skeleton, joints)
    is_base = group == library.groups.base
    members = set(joints.tolist())
    top = next(int(j) for j in joints if int(skeleton.parents[j]) not in members)
    reference = library.root if is_base else max(int(skeleton.parents[top]), 0)
    rows = []
    for index, clip in enumerate(library.clips):
        model = mass_model(clip.skeleton)
        world_rotations, world_positions = clip.world_transforms()
        bones = rotations.rotate(world_rotations[:, ends], model.bone[ends])
        origin = world_positions[:, reference, None]
        local = (world_positions[:, ends] + bones - origin) / model.height
        if is_base:
            local = np.concatenate([local, origin / model.height], axis=1)
        else:
            local = rotations.rotate(rotations.inverse(world_rotations[:, reference, None]), local)
        velocity = np.gradient(local, axis=0) * clip.rate
        segments = cut.of_clip(index)
        frames = equidistant_instants(cut[segments])
        parts = [_interpolate(track, frames) for track in (local, velocity)]
        if is_base:
            parts[0][:, :, -1] -= parts[0][:, :1, -1]
            start_rotations = world_rotations[cut.start[segments], reference]
            to_heading = rotations.inverse(rotations.twist(start_rotations, library.up))
            parts = [rotations.rotate(to_heading[:, None, None], part) for part in parts]
        rows.append(np.concatenate([part.reshape(len(segments), -1) for part in parts], axis=1))
    return np.concatenate(rows)


def equidistant_instants(cut):
    """Return ten equidistant instants of each segment, as fractional frames, (n_segments, 10).

    The first is the start of the segment, the last its stop.
    """
    return cut.start[:, None] + np.linspace(0.0, 1.0, N_INSTANTS) * cut.lengths[:, None]


def _interpolate(track, frames):
    """Interpolate a track, shape (n_frames, ..., 3), linearly at fractional frames."""
    before = np.minimum(frames.astype(np.int64), len(track) - 2)
    weights = (frames - before)[..., None, None]
    return track[before] * (1.0 - weights) + track[before + 1] * weights
