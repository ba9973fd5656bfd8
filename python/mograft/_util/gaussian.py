"""Gaussian smoothing of sampled curves."""

import numpy as np

from mograft._util.arrays import FloatArray, as_floats


def gaussian_filter(values: FloatArray, sigma: float) -> FloatArray:
    """Smooth a curve, shape (n,), with a Gaussian of a standard deviation of `sigma` samples.

    The curve is reflected at its ends, so its sum does not change. If `sigma` is below 0.125, a
    copy of the curve is returned. The result is that of
    ``scipy.ndimage.gaussian_filter1d(values, sigma, mode="reflect", truncate=4)``.
    """
    curve, kernel = as_floats("values", values, ("n",)), gaussian_kernel(sigma)
    if len(kernel) == 1:
        return curve.copy()
    return np.convolve(np.pad(curve, len(kernel) // 2, mode="symmetric"), kernel, mode="valid")


def gaussian_filter_columns(curves: FloatArray, sigma: float) -> FloatArray:
    """Smooth each column of `curves`, shape (n, n_curves), by `gaussian_filter`."""
    columns = [gaussian_filter(np.ascontiguousarray(column), sigma) for column in curves.T]
    return np.stack(columns, axis=1)


def gaussian_kernel(sigma: float) -> FloatArray:
    """Return the weights of a Gaussian filter, shape (2 * r + 1,); their sum is 1.

    The standard deviation is `sigma` samples; the radius r is 4 sigma, rounded to an integer.
    """
    radius = int(4.0 * sigma + 0.5)
    if radius == 0:
        return np.ones(1)
    kernel: FloatArray = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    return kernel
