"""Segmentations after Barbič et al. 2004, in the obvious way: everything anew for every frame."""

import numpy as np


def pca_cuts(features, window, energy, lag, n_settling, deviations, step):
    """Cut frames of "pca"; `window` and `step` are in frames, `lag` and `n_settling` in steps."""
    start, cuts = 0, []
    while True:
        errors, increases, cut = [], [], None
        for end in range(start + window, len(features) + 1, step):
            rows = features[start:end]
            values = np.linalg.svd(rows - rows.mean(axis=0), compute_uv=False) ** 2
            if not errors:
                shares = np.cumsum(values) / values.sum()
                n_dimensions = int(np.argmax(shares >= energy - 1e-12)) + 1
            errors.append(values[n_dimensions:].sum())
            if len(errors) <= lag:
                continue
            increase = errors[-1] - errors[-1 - lag]
            is_high = len(increases) >= n_settling and increase > 1e-6 * lag * step
            if is_high and increase > np.mean(increases) + deviations * np.std(increases):
                cut = end - 1
                break
            increases.append(increase)
        if cut is None:
            return cuts
        cuts.append(cut)
        start = cut


def mean_mahalanobis(before, after, energy, min_variance):
    """Mean squared distance of the rows of `after` from the PPCA model of the rows of `before`."""
    mean = before.mean(axis=0)
    values, axes = np.linalg.eigh(np.cov(before, rowvar=False))
    values, axes = values[::-1], axes[:, ::-1]
    n = int(np.argmax(np.cumsum(values) >= energy * values.sum() - 1e-12)) + 1
    noise = max(values[n:].mean() if n < len(values) else 0.0, min_variance)
    model = np.maximum(np.where(np.arange(len(values)) < n, values, noise), noise)
    inverse = np.linalg.inv(axes @ np.diag(model) @ axes.T)
    return float(np.mean([(row - mean) @ inverse @ (row - mean) for row in after]))


def ppca_cuts(scores, window, step, parameters):
    """Cut frames of "ppca" in one direction; `window` and `step` are in frames."""

    def distances(first, stride):
        rows = scores[first:]
        return [
            mean_mahalanobis(rows[:n], rows[n : n + window], parameters.energy, 1e-6)
            for n in range(window, len(rows) - window + 1, stride)
        ]

    start, cuts = 0, []
    overall = distances(0, max(window // 4, step))
    if not overall:
        return cuts
    share = parameters.rise * (max(overall) - min(overall))
    rise = max(share, parameters.min_rise * scores.shape[1])
    n_following = int(np.ceil(window / step))
    while True:
        found = distances(start, step)
        lowest = np.minimum.accumulate(found) if found else []
        risen = [k for k in range(len(found)) if found[k] > lowest[k] + rise]
        if not risen:
            return cuts
        near = found[risen[0] : risen[0] + n_following + 1]
        peak = risen[0] + int(np.argmax(near))
        if peak == len(found) - 1:
            return cuts
        start += window + step * peak
        cuts.append(start)
