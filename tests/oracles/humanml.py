"""The features of HumanML3D, computed joint by joint with SciPy."""

import itertools

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

CHAINS = [[0, 2, 5, 8, 11], [0, 1, 4, 7, 10], [0, 3, 6, 9, 12, 15], [9, 14, 17, 19, 21]]
CHAINS.append([9, 13, 16, 18, 20])
OFFSETS = [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, -1, 0], [0, 1, 0]]
OFFSETS += [[0, -1, 0], [0, -1, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1], [0, 1, 0], [1, 0, 0]]
OFFSETS += [[-1, 0, 0], [0, 0, 1], *[[0, -1, 0]] * 6]
UP, FORWARD = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def unit(vector):
    return vector / np.linalg.norm(vector)


def between(a, b):
    """The rotation from one direction to another, as `qbetween` of the script."""
    return Rotation.from_quat([*np.cross(a, b), np.linalg.norm(a) * np.linalg.norm(b) + a @ b])


def humanml3d(joints):
    """The rows of the features, by the steps of `process_file`, without `uniform_skeleton`."""
    points = np.array(joints, float)
    points[:, :, 1] -= points.min(axis=0).min(axis=0)[1]
    points = points - points[0][0] * np.array([1, 0, 1])
    first = points[0]
    across = unit(first[2] - first[1] + first[17] - first[16])
    turn = between(unit(np.cross(UP, across)), FORWARD)
    points = np.array([turn.apply(frame) for frame in points])
    # inverse_kinematics_np unpacks the hips the other way round.
    across = [unit(frame[1] - frame[2] + frame[17] - frame[16]) for frame in points]
    smooth = gaussian_filter1d(np.cross(UP, across), 20, axis=0, mode="nearest")
    heading = [between(unit(row), FORWARD) for row in smooth]
    rows = []
    for t in range(len(points) - 1):
        now, then = points[t], points[t + 1]
        spin = heading[t + 1] * heading[t].inv()
        velocity = heading[t + 1].apply(then[0] - now[0])
        row = [np.arcsin(spin.as_quat()[1]), velocity[0], velocity[2], now[0][1]]
        row += heading[t].apply(now[1:] - now[0] * [1, 0, 1]).ravel().tolist()
        turns = {}
        for chain in CHAINS:
            above = heading[t]
            for joint, child in itertools.pairwise(chain):
                world = between(np.array(OFFSETS[child]), unit(now[child] - now[joint]))
                turns[child] = above.inv() * world
                above = above * turns[child]
        for joint in range(1, 22):
            row += turns[joint].as_matrix()[:, :2].T.ravel().tolist()
        row += heading[t].apply(then - now).ravel().tolist()
        row += [float(((then[j] - now[j]) ** 2).sum() < 0.002) for j in (7, 10, 8, 11)]
        rows.append(row)
    return np.array(rows)
