"""The features of HumanML3D, computed joint by joint with quaternions wxyz in plain Python."""

import itertools
import math

import numpy as np

CHAINS = [[0, 2, 5, 8, 11], [0, 1, 4, 7, 10], [0, 3, 6, 9, 12, 15], [9, 14, 17, 19, 21]]
CHAINS.append([9, 13, 16, 18, 20])
OFFSETS = [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, -1, 0], [0, 1, 0]]
OFFSETS += [[0, -1, 0], [0, -1, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1], [0, 1, 0], [1, 0, 0]]
OFFSETS += [[-1, 0, 0], [0, 0, 1], *[[0, -1, 0]] * 6]


def multiply(q, r):
    (a, b, c, d), (e, f, g, h) = q, r
    return [
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    ]


def conjugate(q):
    return [q[0], -q[1], -q[2], -q[3]]


def rotate(q, v):
    return multiply(multiply(q, [0.0, *v]), conjugate(q))[1:]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def unit(v):
    length = math.sqrt(sum(x * x for x in v))
    return [x / length for x in v]


def between(a, b):
    """The rotation from one direction to another, as `qbetween` of the script."""
    lengths = math.sqrt(sum(x * x for x in a) * sum(x * x for x in b))
    return unit([lengths + sum(x * y for x, y in zip(a, b, strict=True)), *cross(a, b)])


def smooth(rows, sigma):
    """``gaussian_filter1d(rows, sigma, axis=0, mode="nearest")`` of SciPy."""
    radius, n = int(4 * sigma + 0.5), len(rows)
    weights = [math.exp(-0.5 * (k / sigma) ** 2) for k in range(-radius, radius + 1)]
    total = sum(weights)
    return [
        [
            sum(
                w * rows[min(max(i + k, 0), n - 1)][axis]
                for k, w in zip(range(-radius, radius + 1), weights, strict=True)
            )
            / total
            for axis in range(3)
        ]
        for i in range(n)
    ]


def matrix(q):
    return np.array([rotate(q, axis) for axis in np.eye(3).tolist()]).T


def humanml3d(joints):
    """The rows of the features, by the steps of `process_file`, without `uniform_skeleton`."""
    points = np.array(joints, float)
    points[:, :, 1] -= points.min(axis=0).min(axis=0)[1]
    points = points - points[0][0] * np.array([1, 0, 1])
    first = points[0]
    across = unit((first[2] - first[1] + first[17] - first[16]).tolist())
    turn = between(unit(cross([0, 1, 0], across)), [0, 0, 1])
    points = np.array([[rotate(turn, p) for p in frame] for frame in points.tolist()])
    # inverse_kinematics_np unpacks the hips the other way round.
    forward = []
    for frame in points:
        across = unit((frame[1] - frame[2] + frame[17] - frame[16]).tolist())
        forward.append(cross([0, 1, 0], across))
    heading = [between(unit(row), [0, 0, 1]) for row in smooth(forward, 20)]
    rows = []
    for t in range(len(points) - 1):
        now, then = points[t], points[t + 1]
        spin = multiply(heading[t + 1], conjugate(heading[t]))
        velocity = rotate(heading[t + 1], (then[0] - now[0]).tolist())
        row = [math.asin(spin[2]), velocity[0], velocity[2], now[0][1]]
        for joint in range(1, 22):
            row += rotate(
                heading[t], [now[joint][0] - now[0][0], now[joint][1], now[joint][2] - now[0][2]]
            )
        turns = {}
        for chain in CHAINS:
            above = heading[t]
            for joint, child in itertools.pairwise(chain):
                world = between(OFFSETS[child], unit((now[child] - now[joint]).tolist()))
                turns[child] = multiply(conjugate(above), world)
                above = multiply(above, turns[child])
        for joint in range(1, 22):
            row += [*matrix(turns[joint])[:, 0], *matrix(turns[joint])[:, 1]]
        for joint in range(22):
            row += rotate(heading[t], (then[joint] - now[joint]).tolist())
        for joint in (7, 10, 8, 11):
            row.append(float(((then[joint] - now[joint]) ** 2).sum() < 0.002))
        rows.append(row)
    return np.array(rows)
