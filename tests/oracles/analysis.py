"""Kinetic energy, segmentation, features and clusters, one segment at a time."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from tests.oracles.rotations import inverse, log, multiply, resample, resample_positions

REFERENCE_FRAME_TIME = 1 / 30


def kinetic_energy(parents, rotations, inertia, frame_time):
    """Return the energy of every frame from angular velocities relative to the world."""
    n_frames, n_joints = rotations.shape[:2]
    world = [Rotation.from_quat(rotations[:, joint]) for joint in range(n_joints)]
    for joint in range(n_joints):
        if parents[joint] >= 0:
            world[joint] = world[parents[joint]] * world[joint]
    energy = np.zeros(n_frames)
    for joint in range(n_joints):
        step = (world[joint][1:] * world[joint][:-1].inv()).as_rotvec() / frame_time
        velocity = np.empty((n_frames, 3))
        velocity[0], velocity[-1] = step[0], step[-1]
        velocity[1:-1] = (step[1:] + step[:-1]) / 2
        energy += inertia[joint] * (velocity**2).sum(axis=1) / 2
    return energy


def segment_bounds(energy, rate, config):
    """Return the frames where segments meet, both ends of the motion included."""
    curve = gaussian_filter1d(energy, config.smoothing * rate) if config.smoothing else energy
    bounds = [0, *turning_points(curve), len(curve) - 1]
    bounds = merge_short_segments(bounds, curve, max(round(config.min_length * rate), 1))
    return np.array(split_long_segments(bounds, config.max_length * rate))


def turning_points(curve):
    """Return the middle frame of every level stretch at which a curve turns.

    A step of at most 1e-12 of the greatest absolute value counts as level.
    """
    tolerance = 1e-12 * max(abs(curve))
    frames = []
    first = 0
    while first < len(curve):
        last = first
        while last + 1 < len(curve) and abs(curve[last + 1] - curve[last]) <= tolerance:
            last += 1
        if first > 0 and last < len(curve) - 1:
            rises_before = curve[first] > curve[first - 1]
            rises_after = curve[last + 1] > curve[last]
            if rises_before != rises_after:
                frames.append((first + last) // 2)
        first = last + 1
    return frames


def merge_short_segments(bounds, curve, min_length):
    """Remove bounds until all segments have `min_length` intervals or one segment is left.

    The shortest segment is merged first, the first one if several are equally short. Of its two
    bounds the one goes at which the curve is nearer to the mean of its values at the two
    neighbouring bounds; the ends of the motion stay.
    """
    bounds = list(bounds)
    while True:
        segments = list(pairwise(bounds))
        start, stop = min(segments, key=lambda segment: segment[1] - segment[0])
        if stop - start >= min_length or len(segments) == 1:
            return bounds
        prominence = {
            bound: abs(curve[bound] - (curve[previous] + curve[following]) / 2)
            for previous, bound, following in zip(bounds, bounds[1:], bounds[2:], strict=False)
        }
        inner = [bound for bound in (start, stop) if bound in prominence]
        bounds.remove(min(inner, key=prominence.get))


def split_long_segments(bounds, max_length):
    """Divide each segment of more than `max_length` intervals into the fewest equal parts."""
    split = [bounds[0]]
    for start, stop in pairwise(bounds):
        n_parts = 1
        while (stop - start) / n_parts > max_length:
            n_parts += 1
        split += [round(start + Fraction(stop - start, n_parts) * k) for k in range(1, n_parts + 1)]
    return split


def features(rotations, root_positions, bounds, joints, root, up, height, frame_time, config):
    """Return the feature matrix of one group, from one clip with its root at joint 0."""
    m = config.samples
    sampled, root_displacements, lengths = [], [], []
    heading = np.array([0.0, 0.0, 0.0, 1.0])
    for start, stop in pairwise(bounds):
        frames = resample(rotations[start : stop + 1][:, joints], m)
        displacements = np.zeros((m, 3))
        places = resample_positions(root_positions[start : stop + 1] / height, m)
        displacements[1:] = np.diff(places, axis=0)
        if root is not None and not config.keep_heading:
            yaw = np.zeros(4)
            yaw[[up, 3]] = frames[0, root, [up, 3]]
            if np.linalg.norm(yaw) >= 1e-6:
                heading = yaw / np.linalg.norm(yaw)
            frames[:, root] = multiply(inverse(heading), frames[:, root])
            displacements = Rotation.from_quat(inverse(heading)).apply(displacements)
        sampled.append(frames)
        root_displacements.append(displacements.ravel())
        lengths.append((stop - start) * frame_time / REFERENCE_FRAME_TIME)
    sampled = np.array(sampled)
    vectors = []
    for column in range(len(joints)):
        samples = sampled[:, :, column].reshape(-1, 4)
        mean = np.linalg.eigh(samples.T @ samples)[1][:, -1]
        if column == root and not config.keep_heading:
            mean = np.array([0.0, 0.0, 0.0, 1.0])
        vectors.append(log(multiply(inverse(mean), samples)).reshape(len(sampled), -1))
    parts = vectors + ([np.array(root_displacements)] if root is not None else [])
    return np.concatenate([*parts, np.array(lengths)[:, None]], axis=1)


def embed(matrix, n_rotations, config):
    """Return principal component scores of standardised features."""
    floors = np.full(matrix.shape[1], config.rotation_floor)
    floors[n_rotations:-1] = config.position_floor
    floors[-1] = config.length_floor
    std = matrix.std(axis=0, ddof=1)
    is_varying = std >= 1e-9
    varying = matrix[:, is_varying]
    standard = (varying - varying.mean(axis=0)) / np.maximum(std, floors)[is_varying]
    rows = np.linalg.svd(standard, full_matrices=False)[2][: config.components].T
    largest = rows[np.abs(rows).argmax(axis=0), np.arange(rows.shape[1])]
    return standard @ (rows * np.sign(largest))


def max_cluster_diameter(points, config):
    """Return the greatest diameter that a cluster may have."""
    distances = np.linalg.norm(points - points.mean(axis=0), axis=1)
    mean = distances.mean() if config.sigma == "literal" else (distances**2).mean()
    return np.sqrt(mean) * config.sigma_scale


def cluster(points, diameter):
    """Return the flat complete-linkage clusters."""
    return fcluster(linkage(points, "complete"), diameter, "distance")
