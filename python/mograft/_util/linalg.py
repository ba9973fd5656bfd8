"""Linear algebra whose bits depend on the numbers alone.

A BLAS sums in an order that follows its number of threads, so that the last bits of what it
returns do, too, and such bits decide ties between clusters. For products numbers are cut into
two halves of so few bits that every sum of products of halves is exact, whatever the order
(Ozaki, Ogita, Oishi and Rump 2012). Eigenvectors are found by one thread.
"""

import numpy as np
import numpy.typing as npt

from mograft import _core
from mograft._util.arrays import FloatArray

__all__ = ["eigen", "gram", "product"]

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


def eigen(matrix: FloatArray, wanted: int) -> tuple[FloatArray, FloatArray]:
    """Find eigenvalues and eigenvectors of a symmetric matrix.

    Parameters
    ----------
    matrix : ndarray, shape (n, n)
        The matrix.
    wanted : int
        How many eigenvectors; n at most are returned.

    Returns
    -------
    values : ndarray, shape (n,)
        All eigenvalues, descending.
    vectors : ndarray, shape (n, wanted)
        As columns those of the greatest, orthonormal; of two opposite ones either.

    Raises
    ------
    ValueError
        If the matrix is not square or not finite.

    Notes
    -----
    Householder's reduction and QL iterations with implicit shifts, as LAPACK's ``steqr``.
    """
    return _core.eigen(np.ascontiguousarray(matrix), wanted)


def _halves(values: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    """Cut numbers that are summed along an axis into two halves of the same few bits."""
    # k products of two halves of b bits stay below 2^53, so that they are whole numbers of
    # grains that a double holds.
    bits = (_MANTISSA - (values.shape[axis] - 1).bit_length()) // 2
    above = np.frexp(np.abs(values).max(axis=axis, keepdims=True, initial=0.0))[1]
    high = _rounded(values, above - bits)
    return high, _rounded(values - high, above - 2 * bits)


def _rounded(values: FloatArray, grain: npt.NDArray[np.int32]) -> FloatArray:
    """Round numbers to multiples of 2^grain."""
    # What is added has its last bit there, and pushes all below it out.
    push = np.ldexp(1.5, grain + _MANTISSA - 1)
    rounded = values + push
    rounded -= push
    return rounded
