"""Gaussian smoothing of sampled curves."""

import numpy as np

from mograft._util.arrays import FloatArray, as_floats

__all__ = ["gaussian_filter", "gaussian_kernel"]


def gaussian_filter(values: FloatArray, sigma: float) -> FloatArray:
    """Smooth a curve with a Gaussian filter.

    Parameters
    ----------
    values : ndarray, shape (n,)
        The curve; it is reflected at its ends.
    sigma : float
        Standard deviation in samples; below 0.125 the curve is returned unchanged.

    Returns
    -------
    ndarray, shape (n,)
        The smoothed curve, with the same sum.

    Notes
    -----
    Equivalent to ``scipy.ndimage.gaussian_filter1d(mode="reflect", truncate=4)``.
    """
    kernel = gaussian_kernel(sigma)
    if len(kernel) == 1:
        return as_floats("values", values, ("n",)).copy()
    padded = np.pad(as_floats("values", values, ("n",)), len(kernel) // 2, mode="symmetric")
    return np.convolve(padded, kernel, mode="valid")


def gaussian_kernel(sigma: float) -> FloatArray:
    """Return the weights of a Gaussian filter, which sum to 1.

    Parameters
    ----------
    sigma : float
        Standard deviation in samples.

    Returns
    -------
    ndarray, shape (2 * r + 1,)
        The weights; the radius r is 4 sigma, rounded.
    """
    radius = int(4.0 * sigma + 0.5)
    if radius == 0:
        return np.ones(1)
    kernel: FloatArray = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    return kernel
