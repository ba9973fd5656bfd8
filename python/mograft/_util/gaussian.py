"""Gaussian smoothing of sampled curves."""

import numpy as np

from mograft._util.arrays import FloatArray, as_floats


def gaussian_filter(values: FloatArray, sigma: float) -> FloatArray:
    """Smooth a curve, shape (n,), with a Gaussian filter of `sigma` samples; keep its sum.

    The curve is reflected at its ends. Below a sigma of 0.125 it is returned unchanged. Equivalent
    to ``scipy.ndimage.gaussian_filter1d(mode="reflect", truncate=4)``.
    """
    kernel = gaussian_kernel(sigma)
    if len(kernel) == 1:
        return as_floats("values", values, ("n",)).copy()
    padded = np.pad(as_floats("values", values, ("n",)), len(kernel) // 2, mode="symmetric")
    return np.convolve(padded, kernel, mode="valid")


def gaussian_kernel(sigma: float) -> FloatArray:
    """Return the weights of a Gaussian filter of `sigma` samples, shape (2 * r + 1,), of sum 1.

    The radius r is 4 sigma, rounded.
    """
    radius = int(4.0 * sigma + 0.5)
    if radius == 0:
        return np.ones(1)
    kernel: FloatArray = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    return kernel
