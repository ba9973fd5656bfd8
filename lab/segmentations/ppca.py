"""Cuts where the distribution of poses changes (Barbič et al. 2004, PPCA)."""

from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from lab.segmentations.growing_scatter import GrowingScatter
from lab.segmentations.poses import (
    MIN_VARIANCE,
    dimensions_of_each,
    frames_of,
    pose_features,
    principal_axes,
    principal_scores,
)

_KEPT_ENERGY = 0.999
"""Share of the variance of the whole motion that the features keep, which speeds up the rest."""
_CHUNK = 8
"""Number of distances that are computed together. More would be faster for each of them, but all
distances after a cut in the chunk are computed in vain."""


@dataclass(frozen=True)
class PpcaParameters:
    """Parameters of the segmentation "ppca".

    Parameters
    ----------
    window : float
        Duration in seconds of the window of poses that is compared with all poses before it in
        the segment; these last at least as long (T = 150 frames at 120 fps in the source).
    step : float
        Seconds by which the window moves (Δ = 10 frames).
    energy : float
        Share of the variance of the poses before the window that their principal axes preserve
        (τ), between 0 and 1.
    rise : float
        Rise of the mean Mahalanobis distance from a valley to a peak that makes a cut, as a share
        of the range (greatest minus smallest) of the distances in the whole motion (0.1 in the
        source). These distances are computed once, without starting again at cuts.
    min_rise : float
        Smallest rise that makes a cut, as a multiple of the mean distance of the poses before the
        window from their own model, which is D. The source has no such limit, and would also cut a
        motion without a change of behaviour.
    directions : {"both", "forward"}
        "both" also reads the motion backwards, and unites the cuts of both directions. "forward"
        does not find a behaviour whose poses all occur in the behaviour before it.
    """

    window: float = 1.25
    step: float = 1 / 12
    energy: float = 0.95
    rise: float = 0.1
    min_rise: float = 1.0
    directions: str = "both"


def cut_frames(motion, parameters):
    """Return the frames at which the distribution of poses changes.

    Parameters
    ----------
    motion : Motion
        The motion.
    parameters : PpcaParameters
        Durations and thresholds.

    Returns
    -------
    ndarray of int, shape (n_cuts,)
        The inner cut frames, ascending. There are none if the motion is shorter than two windows,
        constant, or without joints below the root.

    Notes
    -----
    Barbič et al. 2004, "Segmenting Motion Capture Data into Distinct Behaviors", PPCA approach. A
    pose is the vector x of the quaternions of all joints below the root, here projected onto the
    D principal axes that hold 99.9 % of the variance of the whole motion. The first K poses of a
    segment have mean m and covariance C = Σ_{j≤r} λ_j v_j v_jᵀ + σ² Σ_{j>r} v_j v_jᵀ; the first r
    eigenvalues hold `energy` of their sum, and σ² is the mean of the others. The mean distance of
    the next T poses is H(K) = mean (x - m)ᵀ C⁻¹ (x - m). As K grows by `step`, H falls while the
    behaviour continues, rises when the T poses reach the next one, and has its peak when they
    start with it. A cut is placed at the highest H within one window after H has risen by
    more than max(`rise` · (max H - min H), `min_rise` · D). The method is restarted there.

    Backward cuts that are closer than half a window to forward ones are united with them: the cut
    is placed at their mean. The cost is O(n D² + n D³ / step) for n frames.
    """
    scores = principal_scores(pose_features(motion), _KEPT_ENERGY)
    window = frames_of(parameters.window, motion.rate)
    step = frames_of(parameters.step, motion.rate)
    cuts = _cuts_of_direction(scores, window, step, parameters)
    if parameters.directions == "both":
        backward = _cuts_of_direction(scores[::-1], window, step, parameters)
        cuts += [len(scores) - 1 - cut for cut in backward]
    return unite_near_cuts(np.array(cuts, np.int64), window / 2)


def _cuts_of_direction(scores, window, step, parameters):
    """Return the cuts that are found by reading the poses in the given order, ascending."""
    cuts = []
    coarse = max(window // 4, step)
    distances = np.array([*_window_distances(scores, window, coarse, parameters.energy)])
    if not len(distances):
        return cuts
    least = parameters.min_rise * scores.shape[1]
    rise = max(parameters.rise * float(np.ptp(distances)), least)
    start = 0
    while True:
        following = _window_distances(scores[start:], window, step, parameters.energy)
        peak = _first_peak(following, rise, -(-window // step))
        if peak is None:
            return cuts
        start += window + step * peak
        cuts.append(start)


def _window_distances(scores, window, step, energy):
    """Yield H(K) for K = window, window + step, ... while a whole window follows, in frames."""
    counts = np.arange(window, len(scores) - window + 1, step)
    if not (len(counts) and scores.shape[1]):
        return
    before = GrowingScatter(scores)
    windows = sliding_window_view(scores, window, axis=0).transpose(0, 2, 1)
    for chunk in np.array_split(counts, -(-len(counts) // _CHUNK)):
        means, scatters = before.grow_through(chunk)
        covariances = scatters / (chunk[:, None, None] - 1)
        yield from _mean_distances(covariances, windows[chunk] - means[:, None], energy).tolist()


def _mean_distances(covariances, offsets, energy):
    """Return the mean Mahalanobis distance of poses from each of several models, shape (n,).

    `covariances`, shape (n, D, D), are those of the poses from which each model is made. `offsets`,
    shape (n, window, D), are the differences of the compared poses from the mean of the model.
    """
    variances, axes = principal_axes(covariances)
    n_dimensions = dimensions_of_each(variances, energy)[:, None]
    is_noise = np.arange(variances.shape[1]) >= n_dimensions
    sums = np.where(is_noise, variances, 0.0).sum(axis=1, keepdims=True)
    noise = np.maximum(sums / np.maximum(is_noise.sum(axis=1, keepdims=True), 1), MIN_VARIANCE)
    projected = offsets @ axes
    squares = np.einsum("kij,kij->kj", projected, projected) / offsets.shape[1]
    model = np.maximum(np.where(is_noise, noise, variances), noise)
    return (squares / model).sum(axis=1)


def _first_peak(distances, rise, n_following):
    """Return the index of the first peak that is `rise` above a valley before it, or None.

    The peak is the greatest one of the first distance above this limit and of the `n_following`
    distances after it. The result is None if the peak is the last distance, because the behaviour
    after it would last less than a window.
    """
    least = np.inf
    for index, distance in enumerate(distances):
        least = min(least, distance)
        if distance > least + rise:
            near = np.array([distance, *islice(distances, n_following)])
            peak = int(np.argmax(near))
            is_last = peak == len(near) - 1 and next(distances, None) is None
            return None if is_last else index + peak
    return None


def unite_near_cuts(cuts, min_gap):
    """Replace each run of cuts, each closer than `min_gap` to the previous one, by its mean."""
    cuts = np.sort(cuts)
    if not len(cuts):
        return cuts
    runs = np.split(cuts, np.flatnonzero(np.diff(cuts) >= min_gap) + 1)
    return np.array([int(np.mean(run)) for run in runs], np.int64)
