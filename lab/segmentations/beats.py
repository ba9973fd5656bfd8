"""Cuts at the motion beats of rhythmic motions (after Kim, Park and Shin 2003)."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from mograft import rotations

_GRID_RATE = 60.0  # samples per second of the curves in which beats are searched
_PADDING = 16  # length of the Fourier transform as a multiple of that of the motion
_CANDIDATE_WIDTH = 0.04  # standard deviation of a candidate beat in the dynamic fit, in seconds


@dataclass(frozen=True)
class BeatParameters:
    """Parameters of the segmentation "beats".

    Parameters
    ----------
    shortest, longest : float
        Shortest and longest interval between beats, in seconds: 0.3 and 1.5 are 200 and 40 beats
        per minute. `shortest` is at least 0.1, `longest` at least twice `shortest`.
    smoothing : float
        Standard deviation, in seconds, of the Gaussian that smooths angular velocities.
    min_speed : float
        Smallest change of the angular velocity, in radians per second, from one zero of the angular
        acceleration to the next. Smaller changes are noise.
    fundamental : float
        Smallest power of the tempo, as a share of the largest power, up to 1. The tempo is the
        lowest frequency of at least this power, because its multiples have about the same power.
    tightness : float
        Weight of deviations from a regular interval, relative to that of candidate beats, when the
        beats are fitted. Large values give beats at regular times.
    """

    shortest: float = 0.3
    longest: float = 1.5
    smoothing: float = 0.05
    min_speed: float = 0.1
    fundamental: float = 0.3
    tightness: float = 100.0


def cut_frames(motion, parameters):
    """Return the frames of the beats of a motion.

    Parameters
    ----------
    motion : Motion
        The motion.
    parameters : BeatParameters
        The range of tempos and thresholds.

    Returns
    -------
    ndarray of int, shape (n_cuts,)
        The inner cut frames, ascending. There are none if the motion is shorter than twice
        `longest`, has no joints below the root, or no change of angular velocity reaches
        `min_speed`. Beats are found in every other motion, even if it has no rhythm.

    Notes
    -----
    After Kim, Park and Shin 2003, "Rhythmic-motion synthesis based on motion-beat analysis".
    Candidate beats are the zeros of the components of the angular acceleration of every joint
    below the root. The weight of a candidate is the change of the angular velocity between it and
    its neighbours. The tempo is the lowest peak in the power spectrum of the candidates, tapered by
    a Hann window, that has at least the share `fundamental` of the largest power. The beats t_i
    maximize Σ c(t_i) - `tightness` · Σ ln²((t_i - t_{i-1}) / interval), where c is the density of
    candidates divided by its standard deviation. The last formula is that of Ellis 2007, "Beat
    tracking by dynamic programming". The cost is O(n log n) for n frames.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> motion = dance(strides=1).motion
    >>> beats = cut_frames(motion, BeatParameters())
    >>> bool(0.25 < np.median(np.diff(beats)) * motion.frame_time < 1.6)
    True
    """
    found = _find_tempo(motion, parameters)
    if found is None:
        return np.zeros(0, np.int64)
    times, train, interval = found
    density = gaussian_filter1d(train, _CANDIDATE_WIDTH * _GRID_RATE)
    beats = fit_beats(density / density.std(), interval * _GRID_RATE, parameters.tightness)
    seconds = beats / _GRID_RATE
    margin = 0.5 * interval
    is_near = (seconds > times.min() - margin) & (seconds < times.max() + margin)
    frames = np.unique(np.rint(seconds[is_near] * motion.rate).astype(np.int64))
    return frames[(frames > 0) & (frames < motion.n_frames - 1)]


def beat_interval(motion, parameters):
    """Return the period of the tempo in seconds, or NaN without beats; see `cut_frames`."""
    found = _find_tempo(motion, parameters)
    return float("nan") if found is None else found[2]


def _find_tempo(motion, parameters):
    """Return the times of candidate beats, their pulse train, and the period of the tempo.

    Times and period are in seconds. The result is None if the motion has no beats.
    """
    times, weights = candidate_beats(motion, parameters)
    if motion.duration < 2 * parameters.longest or not len(times):
        return None
    train = _pulse_train(times, weights, motion.duration)
    return times, train, _strongest_interval(train, parameters)


def candidate_beats(motion, parameters):
    """Return the seconds at which angular accelerations are zero, and the weights, both (n,).

    The times are not in order. The weight of a zero is the difference between the angular velocity
    there and its mean at the zeros before and after, in radians per second.
    """
    root = motion.locomotion_root()
    kept = np.setdiff1d(np.arange(motion.n_joints), [root, *motion.skeleton.ancestors(root)])
    quats = motion.rotations[:, kept]
    if not quats.shape[1] or len(quats) < 4:
        return np.zeros(0), np.zeros(0)
    turns = rotations.log(rotations.multiply(rotations.inverse(quats[:-1]), quats[1:]))
    tracks = (turns * motion.rate).reshape(len(turns), -1).T
    sigma = parameters.smoothing * motion.rate
    tracks = np.stack([gaussian_filter1d(track, sigma) for track in tracks])
    accelerations = np.diff(tracks, axis=1)
    is_zero = (accelerations[:, :-1] > 0) != (accelerations[:, 1:] > 0)
    # Both ends count as neighbours of the first and of the last zero of each track.
    is_node = np.pad(is_zero, ((0, 0), (1, 1)), constant_values=True)
    track, node = np.nonzero(is_node)
    speeds = tracks[track, node]
    is_inner = (node > 0) & (node < is_node.shape[1] - 1)
    at = np.flatnonzero(is_inner)
    weights = np.abs(speeds[at] - 0.5 * (speeds[at - 1] + speeds[at + 1]))
    before = accelerations[track[at], node[at] - 1]
    after = accelerations[track[at], node[at]]
    # Acceleration i is that at frame i + 1; it is taken as linear between two frames.
    change = np.where(before == after, 1.0, before - after)
    fractions = np.clip(before / change, 0.0, 1.0)
    seconds = (node[at].astype(np.float64) + fractions) * motion.frame_time
    is_strong = weights >= parameters.min_speed
    return seconds[is_strong], weights[is_strong]


def _pulse_train(times, weights, duration):
    """Return the sums of the weights of candidate beats in bins of 1/60 s.

    Each weight is divided between the two bins nearest to its time.
    """
    positions = times * _GRID_RATE
    bins = np.floor(positions).astype(np.int64)
    share = positions - bins
    n = int(np.ceil(duration * _GRID_RATE)) + 2
    train = np.bincount(bins, weights * (1 - share), n).astype(np.float64)
    return train + np.bincount(bins + 1, weights * share, n)


def _strongest_interval(train, parameters):
    """Return the seconds between beats: the period of the tempo; see `cut_frames`."""
    n = 1 << int(_PADDING * len(train) - 1).bit_length()
    tapered = (train - train.mean()) * np.hanning(len(train) + 2)[1:-1]
    power = np.abs(np.fft.rfft(tapered, n)) ** 2
    first = int(np.ceil(n / (_GRID_RATE * parameters.longest)))
    last = int(np.floor(n / (_GRID_RATE * parameters.shortest)))
    inner = power[first : last + 1]
    is_peak = (inner >= power[first - 1 : last]) & (inner > power[first + 1 : last + 2])
    peaks = first + np.flatnonzero(is_peak)
    if not len(peaks):
        return n / (_GRID_RATE * (first + int(np.argmax(inner))))
    strong = peaks[power[peaks] >= parameters.fundamental * power[peaks].max()]
    return n / (_GRID_RATE * float(strong[0]))


def fit_beats(strength, interval, tightness):
    """Return the samples of a curve at which the sum of strengths minus penalties is largest.

    Successive beats are half to twice an `interval` apart, in samples; see `cut_frames` for the
    penalty. The first beat is within one interval of the start, and the last one within one
    interval of the end. Of equal sums, the one with the earliest beats is selected.
    """
    shortest, longest = max(round(interval / 2), 1), max(round(2 * interval), 1)
    gaps = np.arange(longest, shortest - 1, -1)
    penalties = tightness * np.log(gaps / interval) ** 2
    totals = strength.copy()
    previous = np.full(len(strength), -1)
    for sample in range(shortest, len(strength)):
        reach = min(sample, longest)
        candidates = totals[sample - reach : sample - shortest + 1] - penalties[longest - reach :]
        best = int(np.argmax(candidates))
        if sample >= interval or candidates[best] > 0:
            totals[sample] += candidates[best]
            previous[sample] = sample - reach + best
    tail = max(len(strength) - int(np.ceil(interval)), 0)
    beat = tail + int(np.argmax(totals[tail:]))
    beats = []
    while beat >= 0:
        beats.append(beat)
        beat = int(previous[beat])
    return np.array(beats[::-1], np.int64)
