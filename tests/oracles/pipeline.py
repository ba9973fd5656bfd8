"""The pipeline once more, written plainly with NumPy and SciPy.

One step after the other, segment by segment, no kernels: the oracle of the fast pipeline
in the tests and the yardstick of its speed in ``benches/pipeline.py``. Written from the same
formulas; it shares no code with the package.
"""

from itertools import pairwise

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

FRAME = 1 / 30


def read_bvh(path):
    """Return names, parents, offsets, channels per joint, frame time and channel values."""
    names, parents, offsets, channels, stack = [], [], [], [], []
    with open(path) as file:
        for line in file:
            words = line.split()
            if not words:
                continue
            if words[0] in ("ROOT", "JOINT"):
                parents.append(stack[-1] if stack else -1)
                names.append(" ".join(words[1:]))
                stack.append(len(names) - 1)
            elif words[0] == "End":
                stack.append(None)
            elif words[0] == "OFFSET" and stack[-1] is not None:
                offsets.append([float(word) for word in words[1:]])
            elif words[0] == "CHANNELS":
                channels.append(words[2:])
            elif words[0] == "}":
                stack.pop()
            elif words[0] == "Frames:":
                n_frames = int(words[1])
            elif words[:2] == ["Frame", "Time:"]:
                frame_time = float(words[2])
                break
        values = np.loadtxt(file, ndmin=2)
    assert len(values) == n_frames
    return names, np.array(parents), np.array(offsets), channels, frame_time, values


def write_bvh(path, header, values):
    """Write values below the text of a header."""
    with open(path, "w") as file:
        file.write(header)
        for row in values:
            file.write(" ".join(repr(float(value)) for value in row) + "\n")


def quaternions(channels, offsets, values):
    """Return local rotations (F, J, 4) and translations (F, J, 3) of channel values."""
    rotations, positions = [], []
    column = 0
    for own, offset in zip(channels, offsets, strict=True):
        block = dict(zip(own, values[:, column : column + len(own)].T, strict=True))
        column += len(own)
        order = "".join(name[0] for name in own if name.endswith("rotation"))
        angles = np.stack([block[axis + "rotation"] for axis in order], axis=1)
        rotations.append(Rotation.from_euler(order, angles, degrees=True).as_quat())
        place = np.tile(offset, (len(values), 1))
        for axis, letter in enumerate("XYZ"):
            if letter + "position" in block:
                place[:, axis] = block[letter + "position"]
        positions.append(place)
    return np.stack(rotations, axis=1), np.stack(positions, axis=1)


def kinetic_energy(parents, rotations, inertia, frame_time):
    """Return the energy of every frame, with angular velocities in the world."""
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


def boundaries(energy, rate, config):
    """Return the frames where segments meet, ends included."""
    smooth = gaussian_filter1d(energy, config.smoothing * rate) if config.smoothing else energy
    bounds, last_sign, last_move = [0], 0, 0
    for frame in range(len(smooth) - 1):
        step = smooth[frame + 1] - smooth[frame]
        if abs(step) <= 1e-12 * np.abs(smooth).max():
            continue
        sign = 1 if step > 0 else -1
        if last_sign and sign != last_sign:
            bounds.append((last_move + 1 + frame) // 2)
        last_sign, last_move = sign, frame
    bounds.append(len(smooth) - 1)

    least = max(round(config.min_length * rate), 1)
    while len(bounds) > 2:
        lengths = [b - a for a, b in pairwise(bounds)]
        shortest = lengths.index(min(lengths))
        if lengths[shortest] >= least:
            break
        inner = [at for at in (shortest, shortest + 1) if 0 < at < len(bounds) - 1]

        def stands_out(at):
            before, own, after = (smooth[bounds[at + step]] for step in (-1, 0, 1))
            return abs(own - (before + after) / 2)

        bounds.pop(min(inner, key=stands_out))
    most = config.max_length * rate
    split = []
    for a, b in pairwise(bounds):
        parts = max(int(np.ceil((b - a) / most)), 1)
        split += [round(a + (b - a) * part / parts) for part in range(parts)]
    return np.array([*split, bounds[-1]])


def exp(vectors):
    """Return quaternions of rotation vectors."""
    shape = vectors.shape[:-1]
    return Rotation.from_rotvec(vectors.reshape(-1, 3)).as_quat().reshape(*shape, 4)


def log(quats):
    """Return shortest rotation vectors of quaternions."""
    shape = quats.shape[:-1]
    return Rotation.from_quat(quats.reshape(-1, 4)).as_rotvec().reshape(*shape, 3)


def multiply(a, b):
    """Return the Hamilton product."""
    u, s, v, w = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    real = s * w - (u * v).sum(axis=-1, keepdims=True)
    return np.concatenate([s * v + w * u + np.cross(u, v), real], axis=-1)


def inverse(q):
    """Return the conjugate."""
    return q * [-1, -1, -1, 1]


def hermite(q0, q1, v0, v1, t):
    """Evaluate the cubic on the sphere of Kim, Kim and Shin."""
    middle = log(multiply(exp(-v0 / 3), multiply(inverse(q0), multiply(q1, exp(-v1 / 3)))))
    curve = multiply(q0, exp(v0 / 3 * (1 - (1 - t) ** 3)))
    curve = multiply(curve, exp(middle * (3 * t**2 - 2 * t**3)))
    return multiply(curve, exp(v1 / 3 * t**3))


def tangents(steps):
    """Return the velocity at each frame from the ways between frames."""
    if len(steps) == 1:
        return np.concatenate([steps, steps])
    inner = (steps[:-1] + steps[1:]) / 2
    return np.concatenate(
        [[(3 * steps[0] - steps[1]) / 2], inner, [(3 * steps[-1] - steps[-2]) / 2]]
    )


def resample(frames, count):
    """Return `count` frames spread evenly over a segment's rotations (n + 1, J, 4)."""
    n = len(frames) - 1
    velocity = tangents(log(multiply(inverse(frames[:-1]), frames[1:])))
    result = np.empty((count, *frames.shape[1:]))
    for sample in range(count):
        whole, rest = divmod(sample * n, count - 1)
        result[sample] = frames[whole]
        if rest:
            result[sample] = hermite(
                frames[whole],
                frames[whole + 1],
                velocity[whole],
                velocity[whole + 1],
                rest / (count - 1),
            )
    return result


def resample_positions(frames, count):
    """Return `count` frames spread evenly over a segment's positions (n + 1, 3)."""
    n = len(frames) - 1
    velocity = tangents(np.diff(frames, axis=0))
    result = np.empty((count, 3))
    for sample in range(count):
        whole, rest = divmod(sample * n, count - 1)
        t = rest / (count - 1)
        result[sample] = frames[whole]
        if rest:
            result[sample] = (
                frames[whole] * (1 + 2 * t) * (1 - t) ** 2
                + velocity[whole] * t * (1 - t) ** 2
                + frames[whole + 1] * t**2 * (3 - 2 * t)
                + velocity[whole + 1] * t**2 * (t - 1)
            )
    return result


def features(rotations, place, bounds, joints, root, up, height, frame_time, config):
    """Return the feature matrix of one group, from one clip with its root at joint 0."""
    m = config.samples
    sampled, steps, lengths = [], [], []
    heading = np.array([0.0, 0.0, 0.0, 1.0])
    for start, stop in pairwise(bounds):
        frames = resample(rotations[start : stop + 1][:, joints], m)
        way = np.zeros((m, 3))
        way[1:] = np.diff(resample_positions(place[start : stop + 1] / height, m), axis=0)
        if root is not None and not config.keep_heading:
            part = np.zeros(4)
            part[[up, 3]] = frames[0, root, [up, 3]]
            if np.linalg.norm(part) >= 1e-6:
                heading = part / np.linalg.norm(part)
            frames[:, root] = multiply(inverse(heading), frames[:, root])
            way = Rotation.from_quat(inverse(heading)).apply(way)
        sampled.append(frames)
        steps.append(way.ravel())
        lengths.append((stop - start) * frame_time / FRAME)
    sampled = np.array(sampled)
    vectors = []
    for column in range(len(joints)):
        own = sampled[:, :, column].reshape(-1, 4)
        mean = np.linalg.eigh(own.T @ own)[1][:, -1]
        if column == root and not config.keep_heading:
            mean = np.array([0.0, 0.0, 0.0, 1.0])
        vectors.append(log(multiply(inverse(mean), own)).reshape(len(sampled), -1))
    parts = vectors + ([np.array(steps)] if root is not None else [])
    return np.concatenate([*parts, np.array(lengths)[:, None]], axis=1)


def embed(matrix, n_rotations, config):
    """Return principal component scores of standardised features."""
    floors = np.full(matrix.shape[1], config.rotation_floor)
    floors[n_rotations:-1] = config.position_floor
    floors[-1] = config.length_floor
    std = matrix.std(axis=0, ddof=1)
    kept = std >= 1e-9
    standard = (matrix[:, kept] - matrix[:, kept].mean(axis=0)) / np.maximum(std, floors)[kept]
    rows = np.linalg.svd(standard, full_matrices=False)[2][: config.components].T
    largest = rows[np.abs(rows).argmax(axis=0), np.arange(rows.shape[1])]
    return standard @ (rows * np.sign(largest))


def sigma(points, config):
    """Return the greatest diameter of a cluster."""
    distances = np.linalg.norm(points - points.mean(axis=0), axis=1)
    mean = distances.mean() if config.sigma == "literal" else (distances**2).mean()
    return np.sqrt(mean) * config.sigma_scale


def cluster(points, diameter):
    """Return complete-linkage clusters."""
    return fcluster(linkage(points, "complete"), diameter, "distance")


def candidates(labels, lengths, rate, config, is_donor=None):
    """Return for each segment those that may take its place."""
    is_donor = np.ones(len(labels), bool) if is_donor is None else is_donor
    found = []
    for i, length in enumerate(lengths):
        own = []
        for k in np.flatnonzero(labels == labels[i]):
            gap = abs(length - lengths[k])
            if config.length_slack:
                fits = gap <= max(config.max_stretch * length, config.length_slack * rate) + 1e-9
            else:
                fits = gap < config.max_stretch * length - 1e-9
            if (fits and is_donor[k]) or k == i:
                own.append(int(k))
        found.append(own)
    return found


def gap(end, start):
    """Return the mean joint angle between two poses."""
    return np.linalg.norm(log(multiply(inverse(end), start)), axis=-1).mean()


def choose(rotations, bounds, found, config, rng):
    """Choose a donor for every segment at random under the transition limit."""
    starts, stops = bounds[:-1], bounds[1:]
    alive, gaps = [np.array(found[-1])], []
    for own in found[-2::-1]:
        own = np.array(own)
        angles = np.array(
            [
                [gap(rotations[stops[left]], rotations[starts[right]]) for right in alive[-1]]
                for left in own
            ]
        )
        passes = (angles <= config.max_angle).any(axis=1)
        if not passes.any():
            passes[:] = True
        alive.append(own[passes])
        gaps.append(angles[passes])
    alive, gaps = alive[::-1], gaps[::-1]
    at = int(rng.integers(len(alive[0])))
    chosen = [alive[0][at]]
    for own, angles in zip(alive[1:], gaps, strict=True):
        passing = np.flatnonzero(angles[at] <= config.max_angle)
        at = int(rng.choice(passing)) if len(passing) else int(np.argmin(angles[at]))
        chosen.append(own[at])
    return np.array(chosen)


def stretched(rotations, start, stop, count):
    """Return `count` frames spread evenly over a segment, by a curve through the whole clip."""
    velocity = tangents(log(multiply(inverse(rotations[:-1]), rotations[1:])))
    result = np.empty((count, *rotations.shape[1:]))
    for sample in range(count):
        whole, rest = divmod(sample * (stop - start), count - 1)
        at = start + whole
        result[sample] = rotations[at]
        if rest:
            ends = (rotations[at], rotations[at + 1], velocity[at], velocity[at + 1])
            result[sample] = hermite(*ends, rest / (count - 1))
    return result


def cheapest(alone, after):
    """Return the row of choices of least cost, choice by choice."""
    ways = [(list(alone[0]), None)]
    for own, pairs in zip(alone[1:], after, strict=True):
        before = ways[-1][0]
        costs, froms = [], []
        for right in range(len(own)):
            through = [before[left] + pairs[left, right] for left in range(len(before))]
            froms.append(through.index(min(through)))
            costs.append(min(through) + own[right])
        ways.append((costs, froms))
    at = ways[-1][0].index(min(ways[-1][0]))
    chosen = [at]
    for _, froms in reversed(ways[1:]):
        at = froms[at]
        chosen.append(at)
    return np.array(chosen[::-1])


def capsule_distances(ends, radii, others, other_radii):
    """Return signed distances (F, n, m) of all capsules in every frame, without a loop."""
    a, b = ends[:, :, None, 0], ends[:, :, None, 1]
    c, d = others[:, None, :, 0], others[:, None, :, 1]
    along, other, between = b - a, d - c, a - c

    def dot(u, v):
        return (u * v).sum(axis=-1)

    aa, ee, f, g = dot(along, along), dot(other, other), dot(other, between), dot(along, between)
    both = dot(along, other)
    tiny = 1e-300
    spread = aa * ee - both**2
    s = np.where(spread > 0, ((both * f - g * ee) / np.maximum(spread, tiny)).clip(0, 1), 0.0)
    # Of a point there is nothing to slide along: the nearest place on the other is free.
    s = np.where(ee > 0, s, (-g / np.maximum(aa, tiny)).clip(0, 1))
    t = (both * s + f) / np.maximum(ee, tiny)
    s = np.where(t < 0, (-g / np.maximum(aa, tiny)).clip(0, 1), s)
    s = np.where(t > 1, ((both - g) / np.maximum(aa, tiny)).clip(0, 1), s)
    t = t.clip(0, 1)
    apart = np.linalg.norm(a + along * s[..., None] - c - other * t[..., None], axis=-1)
    return apart - radii[:, None] - other_radii


def transplant(rotations, bounds, chosen, rate, config):
    """Return rotations (F, J, 4) with every segment replaced, displaced and smoothed."""
    n = np.diff(bounds)
    pieces = []
    for i, k in enumerate(chosen):
        pieces.append(stretched(rotations, bounds[k], bounds[k + 1], n[i] + 1))
    seams = [
        i
        for i in range(len(n) - 1)
        if chosen[i + 1] != chosen[i] + 1 or n[chosen[i]] != n[i] or n[chosen[i + 1]] != n[i + 1]
    ]
    if config.seam == "offset":
        return offset(rotations, bounds, chosen, pieces, seams, rate, config.seam_blend)
    starts = [np.zeros((rotations.shape[1], 3)) for _ in n]
    ends = [np.zeros((rotations.shape[1], 3)) for _ in n]
    for i in seams:
        way = log(multiply(inverse(pieces[i][-1]), pieces[i + 1][0]))
        middle = multiply(pieces[i][-1], exp(way / 2))
        ends[i] = log(multiply(inverse(pieces[i][-1]), middle))
        starts[i + 1] = log(multiply(inverse(pieces[i + 1][0]), middle))
    moved = rotations.copy()
    for i, piece in enumerate(pieces):
        if not starts[i].any() and not ends[i].any():
            moved[bounds[i] : bounds[i + 1] + 1] = piece
            continue
        for step in range(n[i] + 1):
            share = step / n[i]
            way = (1 - share) * starts[i] + share * ends[i]
            moved[bounds[i] + step] = multiply(piece[step], exp(way))
    if config.seam != "paper":
        return moved
    smooth = moved.copy()
    for i in seams:
        reach = min(round(config.seam_window * rate), n[i] // 2 - 1, n[i + 1] // 2 - 1)
        if reach < 0:
            continue
        left, right = bounds[i + 1] - reach - 1, bounds[i + 1] + reach + 1
        width = right - left
        leaving = log(multiply(inverse(moved[left - 1]), moved[left + 1])) / 2 * width
        reaching = log(multiply(inverse(moved[right - 1]), moved[right + 1])) / 2 * width
        for frame in range(left + 1, right):
            t = (frame - left) / width
            smooth[frame] = hermite(moved[left], moved[right], leaving, reaching, t)
    return smooth


def offset(rotations, bounds, chosen, pieces, seams, rate, blend):
    """Return rotations (F, J, 4) whose sides of a seam meet half way in pose and velocity."""
    n = np.diff(bounds)
    velocity = tangents(log(multiply(inverse(rotations[:-1]), rotations[1:]))) * rate
    starts, ends = [0, *[i + 1 for i in seams]], [*seams, len(n) - 1]  # of pieces, as segments
    ways = np.zeros((bounds[-1] + 1, rotations.shape[1], 3))
    joined = np.empty_like(ways[..., :1].repeat(4, axis=-1))
    for i, piece in enumerate(pieces):
        joined[bounds[i] : bounds[i + 1] + 1] = piece
    sides = {}
    for i in seams:
        a, b = pieces[i][-1], pieces[i + 1][0]
        middle = multiply(a, exp(log(multiply(inverse(a), b)) / 2))
        way = {-1: log(multiply(inverse(a), middle)), 1: log(multiply(inverse(b), middle))}
        speed = {
            -1: velocity[bounds[chosen[i] + 1]] * (n[chosen[i]] / n[i]),
            1: velocity[bounds[chosen[i + 1]]] * (n[chosen[i + 1]] / n[i + 1]),
        }
        seen = {
            s: Rotation.from_rotvec(-way[s].reshape(-1, 3)).apply(speed[s].reshape(-1, 3))
            for s in (-1, 1)
        }
        mean = (seen[-1] + seen[1]) / 2
        for s in (-1, 1):
            # How the way changes, by differences: exp(way + h·change) = exp(way)·exp(h·lack).
            lack, h = mean - seen[s], 1e-5
            steps = [log(multiply(exp(way[s]), exp(h * sign * lack))) for sign in (1, -1)]
            sides[i, s] = way[s], (steps[0] - steps[1]) / (2 * h)
    for first, last in zip(starts, ends, strict=True):
        duration = (bounds[last + 1] - bounds[first]) / rate
        window = min(blend, duration)
        for frame in range(bounds[first], bounds[last + 1] + 1):
            for seam, s in ((first - 1, 1), (last, -1)):
                if (seam, s) not in sides:
                    continue
                u = abs(frame - bounds[seam + 1]) / rate / window
                if u < 1:
                    d, c = sides[seam, s]
                    c = c * s * window
                    fallen = (2 * d + c) * u**3 - (3 * d + 2 * c) * u**2 + c * u + d
                    # At the seam itself both sides give the same pose: take the later.
                    if s == 1 and frame == bounds[first]:
                        ways[frame] = 0
                    ways[frame] += fallen
    return multiply(joined, exp(ways))


def euler_degrees(rotations, order, before):
    """Return Euler angles in degrees, whole turns taken out from frame to frame."""
    angles = Rotation.from_quat(rotations).as_euler(order, degrees=True)
    return np.unwrap(np.concatenate([before[None], angles]), axis=0, period=360)[1:]


def blended(steps, lengths, seams, seam, window):
    """Velocities that fade over from one segment's to the next one's, frame by frame."""
    bounds = [0, *np.cumsum(lengths).tolist()]
    faded = steps.copy()
    for index, meets in enumerate(seams):
        start, middle, stop = bounds[index : index + 3]
        if not meets or seam in ("paper", "displacement"):
            continue
        for frame in range(middle, stop):
            x = max(1 - (frame + 0.5 - middle) / min(window, stop - middle), 0)
            x = x / 2 if seam == "offset" else x
            faded[frame] += (3 * x**2 - 2 * x**3) * (steps[middle - 1] - steps[frame])
        for frame in range(start, middle if seam == "offset" else start):
            x = max(1 - (middle - frame - 0.5) / min(window, middle - start), 0) / 2
            faded[frame] += (3 * x**2 - 2 * x**3) * (steps[middle] - steps[frame])
    return faded
