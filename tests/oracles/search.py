"""Candidate donors and the choice of a donor sequence."""

import numpy as np

from tests.oracles.rotations import inverse, log, multiply


def candidates(labels, lengths, rate, config, is_donor=None):
    """Return for each base segment its donors: itself and those of its cluster that fit."""
    is_donor = np.ones(len(labels), bool) if is_donor is None else is_donor
    donors = []
    for i, length in enumerate(lengths):
        fitting = []
        for k in np.flatnonzero(labels == labels[i]):
            difference = abs(length - lengths[k])
            if config.length_slack:
                tolerance = max(config.max_stretch * length, config.length_slack * rate)
                fits = difference <= tolerance + 1e-9
            else:
                fits = difference < config.max_stretch * length - 1e-9
            if (fits and is_donor[k]) or k == i:
                fitting.append(int(k))
        donors.append(fitting)
    return donors


def seam_angle(end, start):
    """Return the mean joint angle between two poses."""
    return np.linalg.norm(log(multiply(inverse(end), start)), axis=-1).mean()


def random_sequence(rotations, bounds, donors, config, rng):
    """Choose a donor for every segment at random under the limit of the seam angle.

    From the last segment to the first, donors without a next donor under the limit are removed,
    unless this would remove all.
    """
    starts, stops = bounds[:-1], bounds[1:]
    remaining, angles_after = [np.array(donors[-1])], []
    for position_donors in donors[-2::-1]:
        position_donors = np.array(position_donors)
        angles = np.array(
            [
                [
                    seam_angle(rotations[stops[left]], rotations[starts[right]])
                    for right in remaining[-1]
                ]
                for left in position_donors
            ]
        )
        has_next = (angles <= config.max_angle).any(axis=1)
        if not has_next.any():
            has_next[:] = True
        remaining.append(position_donors[has_next])
        angles_after.append(angles[has_next])
    remaining, angles_after = remaining[::-1], angles_after[::-1]
    choice = int(rng.integers(len(remaining[0])))
    sequence = [remaining[0][choice]]
    for position_donors, angles in zip(remaining[1:], angles_after, strict=True):
        allowed = np.flatnonzero(angles[choice] <= config.max_angle)
        choice = int(rng.choice(allowed)) if len(allowed) else int(np.argmin(angles[choice]))
        sequence.append(position_donors[choice])
    return np.array(sequence)


def cheapest_sequence(unary, pairwise):
    """Return the choices of the least total cost by dynamic programming.

    `unary` holds the costs of the choices of each position, `pairwise` those of each pair of
    choices at neighbouring positions.
    """
    costs, predecessors = list(unary[0]), []
    for choice_costs, pair_costs in zip(unary[1:], pairwise, strict=True):
        new_costs, best_left = [], []
        for right in range(len(choice_costs)):
            totals = [costs[left] + pair_costs[left, right] for left in range(len(costs))]
            best_left.append(totals.index(min(totals)))
            new_costs.append(min(totals) + choice_costs[right])
        costs = new_costs
        predecessors.append(best_left)
    choice = costs.index(min(costs))
    sequence = [choice]
    for best_left in reversed(predecessors):
        choice = best_left[choice]
        sequence.append(choice)
    return np.array(sequence[::-1])


def sampled_sequence(unary, pairwise, temperature, draws):
    """Return the choices drawn with probability exp(-cost / temperature), from uniform numbers.

    Each choice is drawn given the one before, in proportion to the summed weights of all ways to
    continue. The arguments are those of `cheapest_sequence`, with one draw per position.
    """
    onward = [np.ones(len(unary[-1]))]
    for own, pairs in zip(unary[:0:-1], pairwise[::-1], strict=True):
        onward.append((np.exp(-pairs / temperature) * np.exp(-own / temperature)) @ onward[-1])
    onward.reverse()
    sequence = []
    for position, draw in enumerate(draws):
        weights = np.exp(-unary[position] / temperature) * onward[position]
        if position:
            weights = weights * np.exp(-pairwise[position - 1][sequence[-1]] / temperature)
        shares = np.cumsum(weights)
        sequence.append(int((shares <= draw * shares[-1]).sum()))
    return np.array(sequence)


def zero_moment_shift(base, donor, seconds, steps=40):
    """Return d - (z/g) d̈ at the samples, shape (n_samples, 2), by quadrature and differences.

    d is the difference of two tracks, shape (n_samples, 2): a line and a sine polynomial. It is
    continued by point reflection and convolved with a Gaussian of 1/15 s.
    """
    difference = donor - base
    n = len(difference)
    u = np.arange(n) / (n - 1)
    line = np.outer(1 - u, difference[0]) + np.outer(u, difference[-1])
    modes = np.arange(1, n - 1)
    weights = 2 / (n - 1) * np.sin(np.pi * np.outer(modes, u)) @ (difference - line)
    offsets = np.linspace(-8, 8, 16 * steps + 1) / 15  # seconds
    kernel = np.exp(-0.5 * (15 * offsets) ** 2)
    kernel /= kernel.sum()

    def smooth(time):
        v = (time - offsets) / seconds
        values = np.outer(1 - v, difference[0]) + np.outer(v, difference[-1])
        return kernel @ (values + np.sin(np.pi * np.outer(v, modes)) @ weights)

    h = 0.01 * seconds / n
    moved = []
    for time in u * seconds:
        before, here, after = smooth(time - h), smooth(time), smooth(time + h)
        moved.append(here - 0.56 * 1.75 / 9.81 * (before - 2 * here + after) / h**2)
    return np.array(moved)
