"""Replacement of segments by donors, and the treatments of seams."""

import numpy as np
from scipy.spatial.transform import Rotation

from tests.oracles.rotations import exp, hermite, inverse, log, multiply, tangents


def stretch(rotations, start, stop, count):
    """Return `count` evenly spaced frames of a segment, on a curve through the whole clip."""
    velocity = tangents(log(multiply(inverse(rotations[:-1]), rotations[1:])))
    result = np.empty((count, *rotations.shape[1:]))
    for sample in range(count):
        whole, rest = divmod(sample * (stop - start), count - 1)
        frame = start + whole
        result[sample] = rotations[frame]
        if rest:
            ends = (*rotations[frame : frame + 2], *velocity[frame : frame + 2])
            result[sample] = hermite(*ends, rest / (count - 1))
    return result


def transplant(rotations, bounds, sequence, rate, config):
    """Return rotations (F, J, 4) with every segment replaced by its donor and seams treated."""
    n = np.diff(bounds)
    pieces = []
    for i, k in enumerate(sequence):
        pieces.append(stretch(rotations, bounds[k], bounds[k + 1], n[i] + 1))
    stretched = n[np.asarray(sequence)] != n
    is_seam = (np.diff(sequence) != 1) | stretched[:-1] | stretched[1:]
    seams = np.flatnonzero(is_seam).tolist()
    if config.seam == "offset":
        return _offset(rotations, bounds, sequence, pieces, seams, rate, config.seam_blend)
    displaced = _displace(rotations, bounds, pieces, seams)
    if config.seam != "paper":
        return displaced
    return _smooth(displaced, bounds, seams, round(config.seam_window * rate))


def _displace(rotations, bounds, pieces, seams):
    """Spread each pose gap linearly over both segments, so that they meet half way."""
    n = np.diff(bounds)
    starts = [np.zeros((rotations.shape[1], 3)) for _ in n]
    ends = [np.zeros((rotations.shape[1], 3)) for _ in n]
    for i in seams:
        gap = log(multiply(inverse(pieces[i][-1]), pieces[i + 1][0]))
        middle = multiply(pieces[i][-1], exp(gap / 2))
        ends[i] = log(multiply(inverse(pieces[i][-1]), middle))
        starts[i + 1] = log(multiply(inverse(pieces[i + 1][0]), middle))
    displaced = rotations.copy()
    for i, piece in enumerate(pieces):
        if not starts[i].any() and not ends[i].any():
            displaced[bounds[i] : bounds[i + 1] + 1] = piece
            continue
        for step in range(n[i] + 1):
            weight = step / n[i]
            displacement = (1 - weight) * starts[i] + weight * ends[i]
            displaced[bounds[i] + step] = multiply(piece[step], exp(displacement))
    return displaced


def _smooth(displaced, bounds, seams, window):
    """Replace the frames around each seam by a cubic."""
    n = np.diff(bounds)
    smooth = displaced.copy()
    for i in seams:
        reach = min(window, n[i] // 2 - 1, n[i + 1] // 2 - 1)
        if reach < 0:
            continue
        left, right = bounds[i + 1] - reach - 1, bounds[i + 1] + reach + 1
        width = right - left
        start, stop = (
            log(multiply(inverse(displaced[frame - 1]), displaced[frame + 1])) / 2 * width
            for frame in (left, right)
        )
        for frame in range(left + 1, right):
            t = (frame - left) / width
            smooth[frame] = hermite(displaced[left], displaced[right], start, stop, t)
    return smooth


def _offset(rotations, bounds, sequence, pieces, seams, rate, blend):
    """Add decaying offsets so that both sides of a seam meet half way in pose and velocity."""
    starts, ends = [0, *[i + 1 for i in seams]], [*seams, len(pieces) - 1]  # between seams
    joined = np.empty((bounds[-1] + 1, *rotations.shape[1:]))
    offsets = np.zeros((*joined.shape[:2], 3))
    for i, piece in enumerate(pieces):
        joined[bounds[i] : bounds[i + 1] + 1] = piece
    sides = _offsets_at_seams(rotations, bounds, sequence, pieces, seams, rate)
    for first, last in zip(starts, ends, strict=True):
        duration = (bounds[last + 1] - bounds[first]) / rate
        window = min(blend, duration)
        for frame in range(bounds[first], bounds[last + 1] + 1):
            for seam, side in ((first - 1, 1), (last, -1)):
                if (seam, side) not in sides:
                    continue
                u = abs(frame - bounds[seam + 1]) / rate / window
                if u < 1:
                    d, c = sides[seam, side]
                    c = c * side * window
                    decayed = (2 * d + c) * u**3 - (3 * d + 2 * c) * u**2 + c * u + d
                    # At the seam itself both sides give the same pose; the later one is used.
                    if side == 1 and frame == bounds[first]:
                        offsets[frame] = 0
                    offsets[frame] += decayed
    return multiply(joined, exp(offsets))


def _offsets_at_seams(rotations, bounds, sequence, pieces, seams, rate):
    """Return for each seam and side (-1, 1) the offset and its rate of change at the seam."""
    n = np.diff(bounds)
    velocity = tangents(log(multiply(inverse(rotations[:-1]), rotations[1:]))) * rate
    sides = {}
    for i in seams:
        a, b = pieces[i][-1], pieces[i + 1][0]
        middle = multiply(a, exp(log(multiply(inverse(a), b)) / 2))
        offset = {-1: log(multiply(inverse(a), middle)), 1: log(multiply(inverse(b), middle))}
        speed = {
            -1: velocity[bounds[sequence[i] + 1]] * (n[sequence[i]] / n[i]),
            1: velocity[bounds[sequence[i + 1]]] * (n[sequence[i + 1]] / n[i + 1]),
        }
        rotated = {}
        for side in (-1, 1):
            turn = Rotation.from_rotvec(-offset[side].reshape(-1, 3))
            rotated[side] = turn.apply(speed[side].reshape(-1, 3))
        mean = (rotated[-1] + rotated[1]) / 2
        for side in (-1, 1):
            # The rate of change is a central difference: exp(offset + h rate) is
            # exp(offset) exp(h missing).
            missing, h = mean - rotated[side], 1e-5
            turn = exp(offset[side])
            after, before = (log(multiply(turn, exp(h * sign * missing))) for sign in (1, -1))
            sides[i, side] = offset[side], (after - before) / (2 * h)
    return sides


def fade_velocities(velocities, lengths, seams, seam, window):
    """Fade each segment's velocities over to those of the next one, frame by frame."""
    bounds = [0, *np.cumsum(lengths).tolist()]
    faded = velocities.copy()
    for index, is_seam in enumerate(seams):
        start, middle, stop = bounds[index : index + 3]
        if not is_seam or seam in ("paper", "displacement"):
            continue
        for frame in range(middle, stop):
            x = max(1 - (frame + 0.5 - middle) / min(window, stop - middle), 0)
            x = x if seam == "inertial" else x / 2
            faded[frame] += (3 * x**2 - 2 * x**3) * (velocities[middle - 1] - velocities[frame])
        for frame in range(start, start if seam == "inertial" else middle):
            x = max(1 - (middle - frame - 0.5) / min(window, middle - start), 0) / 2
            faded[frame] += (3 * x**2 - 2 * x**3) * (velocities[middle] - velocities[frame])
    return faded
