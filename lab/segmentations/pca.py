"""Cuts where the poses leave the hyperplane of the poses before (Barbič et al. 2004, PCA)."""

from dataclasses import dataclass

import numpy as np

from lab.segmentations.growing_scatter import GrowingScatter
from lab.segmentations.poses import MIN_VARIANCE, dimensions_of, frames_of, pose_features


@dataclass(frozen=True)
class PcaParameters:
    """Parameters of the segmentation "pca".

    Parameters
    ----------
    window : float
        Seconds at the start of a segment from which the number of dimensions is chosen
        (k = 240 frames at 120 fps in the source).
    energy : float
        Share of the variance in these frames that the dimensions preserve, between 0 and 1 (τ).
    lag : float
        Seconds over which the increase of the projection error is measured (l = 60 frames).
    deviations : float
        Number of standard deviations by which the increase has to exceed its mean (3 in the
        source).
    settling : float
        Seconds of increases from which mean and standard deviation are taken before the first cut
        is possible, about one cycle of a gait. The source delays the first cut, too.
    step : float
        Seconds between two frames at which the error is computed. The source computes it at
        every frame.
    """

    window: float = 2.0
    energy: float = 0.9
    lag: float = 0.5
    deviations: float = 3.0
    settling: float = 1.0
    step: float = 0.1


def cut_frames(motion, parameters):
    """Return the frames at which new poses leave the hyperplane of the segment's first poses.

    Parameters
    ----------
    motion : Motion
        The motion.
    parameters : PcaParameters
        Durations and thresholds.

    Returns
    -------
    ndarray of int, shape (n_cuts,)
        The inner cut frames, ascending. There are none if the motion is shorter than `window` plus
        `lag` plus `settling`, constant, or without joints below the root.

    Notes
    -----
    Barbič et al. 2004, "Segmenting Motion Capture Data into Distinct Behaviors", PCA approach. A
    pose is the vector x of the quaternions of all joints below the root. From the poses of the
    first `window` seconds of a segment, the number of dimensions r is the smallest one with
    Σ_{j≤r} λ_j ≥ `energy` · Σ_j λ_j, where λ_j are the eigenvalues of the scatter matrix,
    descending. The projection error of the first i frames is e_i = Σ_{j>r} λ_j of their scatter
    matrix; while a behaviour continues, it rises at a constant rate. A cut is placed at the first
    frame i with d_i > mean + `deviations` · deviation of all d_j, j < i, where
    d_i = e_i - e_{i-lag}, unless d_i is below the noise of recordings. The method is restarted at
    the cut.

    The cuts of the first frames do not depend on the frames that follow: the method is causal.
    A cut follows the change of behaviour by at most about `lag`. For n frames of D features the
    cost is O(n D² + n D³ / step).
    """
    features = pose_features(motion)
    cuts = []
    while True:
        start = cuts[-1] if cuts else 0
        length = _length_of_first_segment(features[start:], parameters, motion.rate)
        if length is None:
            return np.array(cuts, np.int64)
        cuts.append(start + length)


def _length_of_first_segment(features, parameters, rate):
    """Return the number of frame intervals up to the first cut, or None if there is no cut."""
    step = frames_of(parameters.step, rate)
    lag = max(round(parameters.lag * rate / step), 1)
    n_settling = max(round(parameters.settling * rate / step), 2)
    window = frames_of(parameters.window, rate)
    poses = GrowingScatter(features)
    errors = []
    increases = []
    n_dimensions = 0
    for end in range(window, len(features) + 1, step):
        _, scatters = poses.grow_through(np.array([end]))
        values = np.maximum(np.linalg.eigvalsh(scatters[0])[::-1], 0.0)
        if not errors:
            n_dimensions = dimensions_of(values, parameters.energy)
        errors.append(float(values[n_dimensions:].sum()))
        if len(errors) <= lag:
            continue
        increase = errors[-1] - errors[-1 - lag]
        if len(increases) >= n_settling and increase > MIN_VARIANCE * lag * step:
            limit = np.mean(increases) + parameters.deviations * np.std(increases)
            if increase > limit:
                return end - 1
        increases.append(increase)
    return None
