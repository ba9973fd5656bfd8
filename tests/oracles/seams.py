"""The gradient solution and the decaying offsets of seams with NumPy, over whole arrays."""

import numpy as np

from mograft.blend.seams import add_deltas, at_piece_ends


def smooth_gradient(closed, weights):
    """Return the values of `ClosedFrames` after one Gauss-Newton step."""
    values, is_free, rows = closed.values, _free_frames(closed), closed.donor_rows
    moves = (np.abs(rows - rows[0]) > 1e-12).any(axis=(0, 2))
    is_step = _donor_steps(closed.cut)
    slopes = _slopes(closed, values, is_step, weights) * moves[:, None]
    slopes[~is_free] = 0.0
    matrix = _normal_matrix(is_step, weights, is_free)
    change = np.linalg.solve(matrix, -slopes.reshape(len(values), -1))
    return add_deltas(closed.space, values, change.reshape(slopes.shape))


def add_offsets(space, values, times, before, after):
    """Return values plus offsets; `before` and `after` are offsets and rates at seams."""
    start, start_rate = (at_piece_ends(own, times.piece)[0] for own in after)
    end, end_rate = (at_piece_ends(own, times.piece)[1] for own in before)
    window = times.windows[times.piece]
    offsets = _decay(start, start_rate, times.seconds, window)
    offsets += _decay(end, end_rate, times.seconds_left, window)
    return add_deltas(space, values, offsets)


def _decay(value, velocity, seconds, window):
    """Return the cubic from a value and velocity at the seam to 0 and 0 at the window's end."""
    u = np.minimum(seconds / window, 1.0)[:, None, None]
    return (velocity * window[:, None, None] * u + value * (1.0 + 2.0 * u)) * (1.0 - u) ** 2


def _donor_steps(cut):
    """Return whether each frame and the next belong to one donor, shape (n_frames - 1,).

    They do not if one segment ends and the next starts without a shared frame, as in concatenated
    motions.
    """
    is_step = np.ones(cut.stop[-1], bool)
    is_step[cut.stop[:-1][cut.stop[:-1] < cut.start[1:]]] = False
    return is_step


def _slopes(closed, values, is_step, weights):
    """Return half of the gradient of the minimised sum at `values`, (n_frames, n_joints, 3)."""
    space, rows, cut = closed.space, closed.donor_rows, closed.cut
    last_rows = np.cumsum(cut.lengths + 1) - 1
    shares = cut.stop[:-1] == cut.start[1:]
    is_kept = np.ones(len(rows), bool)  # of a shared frame, the row of the later donor
    is_kept[last_rows[:-1][shares]] = False
    slopes = space.delta(rows[is_kept], values)
    seams = closed.seams[shares[closed.seams]]
    at_seams = cut.stop[seams]
    earlier = space.delta(rows[last_rows[seams]], values[at_seams])
    slopes[at_seams] = 0.5 * (slopes[at_seams] + earlier)
    is_inside = np.ones(len(rows) - 1, bool)
    is_inside[last_rows[:-1]] = False
    targets = np.zeros((len(is_step), *values.shape[1:-1], 3))
    targets[is_step] = space.delta(rows[:-1], rows[1:])[is_inside]
    steps = space.delta(values[:-1], values[1:])
    errors = weights[1] * (steps - targets) * is_step[:, None, None]
    slopes[:-1] -= errors
    slopes[1:] += errors
    targets = np.diff(targets, axis=0)
    before, after = closed.seam_accelerations[:, shares[closed.seams]]
    targets[at_seams - 1] = 0.5 * (before + after)
    _spread(targets, cut, seams, 0.5 * (after - before), np.sqrt(weights[1]))
    has_acceleration = (is_step[:-1] & is_step[1:])[:, None, None]
    errors = weights[2] * (np.diff(steps, axis=0) - targets) * has_acceleration
    slopes[:-2] += errors
    slopes[1:-1] -= 2.0 * errors
    slopes[2:] += errors
    return slopes


def _spread(targets, cut, seams, halves, spread):
    """Add half of each seam's difference of accelerations before it, and subtract it after it.

    `targets` are the accelerations in all frames but the first and the last. The share falls
    linearly to 0 within `spread` frames, and within the segment.
    """
    for seam, half in zip(seams, halves, strict=True):
        for segment, sign in ((seam, 1), (seam + 1, -1)):
            inner = np.arange(cut.start[segment] + 1, cut.stop[segment])
            distance = np.abs(inner - cut.stop[seam])
            share = np.maximum(1.0 - distance / min(spread, cut.lengths[segment]), 0.0)
            targets[inner - 1] += sign * share[:, None, None] * half


def _free_frames(closed):
    """Return which frames may change, shape (n_frames,)."""
    frames = np.arange(len(closed.values))
    seams = closed.cut.stop[closed.seams]
    if not len(seams):
        return np.zeros(len(frames), bool)
    after = np.searchsorted(seams, frames).clip(max=len(seams) - 1)
    distance = np.minimum(np.abs(seams[after] - frames), np.abs(frames - seams[after - 1]))
    is_free = distance <= closed.blend
    is_free[[0, -1]] = False
    return is_free


def _normal_matrix(is_step, weights, is_free):
    """Return the matrix of the normal equations, (n_frames, n_frames).

    `is_step` is that of `_donor_steps`. Rows and columns of fixed frames are those of the identity.
    """
    matrix = weights[0] * np.eye(len(is_free))
    accelerations = weights[2] * (is_step[:-1] & is_step[1:])
    terms = ((-1.0, 1.0), weights[1] * is_step), ((1.0, -2.0, 1.0), accelerations)
    for stencil, weight in terms:
        derivative = np.zeros((len(weight), len(is_free)))
        for offset, factor in enumerate(stencil):
            derivative += factor * np.eye(len(weight), len(is_free), offset)
        matrix += derivative.T @ (weight[:, None] * derivative)
    matrix[~is_free] = 0.0
    matrix[:, ~is_free] = 0.0
    matrix[~is_free, ~is_free] = 1.0
    return matrix
