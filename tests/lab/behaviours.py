"""Synthetic motions of behaviours that follow one another, with known changes."""

import numpy as np

from mograft import Motion
from mograft.motion import rotations
from tests.strategies import star_skeleton

RATE = 30.0


def behaviours(seed, seconds, rate=RATE, n_joints=6, blend=0.3):
    """A motion of periodic behaviours and the frames in the middle of their changes.

    `seconds` are the durations of the behaviours. In each, every joint below the root oscillates
    about a mean orientation, with its own axis, amplitude and phase and one period for all.
    Neighbouring behaviours are cross-faded over `blend` seconds.
    """
    rng = np.random.default_rng(seed)
    changes = np.cumsum(seconds)
    times = np.arange(round(changes[-1] * rate)) / rate
    angles = np.zeros((len(times), n_joints, 3))
    starts = [-np.inf, *changes[:-1]]
    for start, stop in zip(starts, [*changes[:-1], np.inf], strict=True):
        weight = ramp((times - start) / blend) * (1 - ramp((times - stop) / blend))
        period = rng.uniform(0.6, 1.4)
        mean, first, second = rng.uniform(-0.5, 0.5, size=(3, n_joints, 3))
        phase = 2 * np.pi * times[:, None, None] / period
        wave = mean + first * np.sin(phase) + second * np.cos(phase)
        angles += weight[:, None, None] * wave
    quats = rotations.exp(angles)
    quats[:, 0] = rotations.IDENTITY
    skeleton = star_skeleton(n_joints)
    positions = np.tile(skeleton.offsets, (len(times), 1, 1))
    motion = Motion(skeleton, 1 / rate, quats, positions)
    return motion, (changes[:-1] * rate).round().astype(int)


def ramp(values):
    """A smooth step from 0 to 1 whose middle is at 0 and whose width is 1."""
    x = (values + 0.5).clip(0, 1)
    return x * x * (3 - 2 * x)
