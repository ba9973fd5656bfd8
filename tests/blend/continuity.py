"""Random donors, and the jumps at their closed seams, measured between frames."""

from dataclasses import replace

import numpy as np

from mograft import Config
from mograft.blend.donor_timeline import DonorTimeline
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.seams import ROTATIONS, TRANSLATIONS
from mograft.motion import rotations
from tests.strategies import smooth_rotations, tile_segments

RATE = 30.0
STEP = 1e-5  # of a frame


def random_donors(lengths, seed, speed=0.3, **config):
    """Segments of a track of two moving joints and one at rest, replaced at random.

    Returns the donors, and the tracks of rotations and of translations.
    """
    rng = np.random.default_rng(seed)
    cut = tile_segments(lengths)
    track = smooth_rotations(rng, int(cut.stop[-1]) + 1, 3, speed)
    track[:, 2] = track[0, 2]
    donors = cut[rng.integers(0, len(cut), len(cut))]
    timeline = DonorTimeline(cut, donors, RATE, Config(**config))
    tracks = {ROTATIONS: [track], TRANSLATIONS: [np.ascontiguousarray(rotations.log(track))]}
    return replace(timeline, seams=timeline.find_seams([track])), tracks


def close_at(timeline, space, track, times):
    """Values of donors at any times, with the gaps at seams closed."""
    values = timeline.sample(space, track, *times)
    seams = timeline.piece_times(*times), timeline.boundaries(space, track)
    return SEAM_TREATMENTS[timeline.config.seam].close(values, *seams)


def one_sided_velocities(space, curve, frames, side):
    """Velocities per frame on one side, exact to the second order."""
    here, near, far = (curve(frames + side * step) for step in (0.0, STEP, 2 * STEP))
    return side * (4.0 * space.delta(here, near) - space.delta(here, far)) / (2.0 * STEP)


def jumps(timeline, space, track):
    """Largest jump in value, and in velocity relative to 1 + velocity.

    Measured at segment boundaries, at inner frames and where blend windows end.
    """

    def on(segment):
        return lambda frames: close_at(timeline, space, track, (segment, frames))

    n = timeline.cut.lengths
    left = np.arange(len(n) - 1)
    before, after = on(left), on(left + 1)
    ends, starts = n[:-1].astype(float), np.zeros(len(n) - 1)
    value = space.delta(before(ends), after(starts))
    pairs = [
        (
            one_sided_velocities(space, before, ends, -1),
            one_sided_velocities(space, after, starts, 1),
        )
    ]
    reach = timeline.config.seam_blend * timeline.rate
    inner = np.concatenate([np.arange(1.0, m) for m in n])
    segment = np.repeat(np.arange(len(n)), n - 1)
    places = [(segment, inner), (np.arange(len(n)), np.full(len(n), reach)), (left, ends - reach)]
    for index, frames in places:
        inside = (frames > 2 * STEP) & (frames < n[index] - 2 * STEP)
        curve = on(index[inside])
        pairs.append(
            tuple(one_sided_velocities(space, curve, frames[inside], side) for side in (-1, 1))
        )
    velocity = [np.abs(a - b).max(axis=-1) / (1 + np.abs(a).max(axis=-1)) for a, b in pairs]
    return np.abs(value).max(initial=0), max(v.max(initial=0) for v in velocity)
