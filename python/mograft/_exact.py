"""Matrix products whose bits depend on the numbers alone.

A BLAS sums products in an order that follows its number of threads, so that the last bits of
what it returns do, too. Here numbers are first cut into two halves of so few bits that every
sum of products of halves is exact, whatever the order (Ozaki, Ogita, Oishi and Rump 2012).
What is left out of the numbers is less than 2^-40 of the largest beside them.
"""

import numpy as np

from mograft._arrays import FloatArray

__all__ = ["gram", "product"]

_MANTISSA = 53


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Multiply two matrices.

    Parameters
    ----------
    a : ndarray, shape (m, k)
        Rows; what a row becomes does not depend on the others.
    b : ndarray, shape (k, n)
        Columns.

    Returns
    -------
    ndarray, shape (m, n)
        The product. Each number is off by no more than 2^-40 k times the largest number of
        the row times that of the column, for k up to 2048.
    """
    a_high, a_low = _halves(a, 1)
    b_high, b_low = _halves(b, 0)
    found: FloatArray = a_high @ b_high + (a_high @ b_low + a_low @ b_high)
    return found


def gram(a: FloatArray) -> FloatArray:
    """Multiply the transpose of a matrix by the matrix.

    Parameters
    ----------
    a : ndarray, shape (k, n)
        The matrix.

    Returns
    -------
    ndarray, shape (n, n)
        As `product` of `a.T` and `a`; symmetric.
    """
    high, low = _halves(a, 0)
    across = high.T @ low
    found: FloatArray = high.T @ high + (across + across.T)
    return found


def _halves(values: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    """Cut numbers that are summed along an axis into two halves of the same few bits."""
    # k products of two halves of b bits stay below 2^53, so that they are whole numbers of
    # grains that a double holds.
    bits = (_MANTISSA - (values.shape[axis] - 1).bit_length()) // 2
    above = np.frexp(np.abs(values).max(axis=axis, keepdims=True, initial=0.0))[1]
    high = _rounded(values, above - bits)
    return high, _rounded(values - high, above - 2 * bits)


def _rounded(values: FloatArray, grain: np.typing.NDArray[np.int32]) -> FloatArray:
    """Round numbers to multiples of 2^grain."""
    # What is added has its last bit there, and pushes all below it out.
    push = np.ldexp(1.5, grain + _MANTISSA - 1)
    rounded = values + push
    rounded -= push
    return rounded
