"""Matrix products and eigenvectors with the same bits for any number of BLAS threads.

The order in which a BLAS adds depends on its number of threads, and so do the last bits of its
results. Such bits decide ties between clusters. Two rules remove them: factors are rounded to a
grid on which sums of products are exact in any order, and eigenvectors are rounded to the same
grid, which is much coarser than the bits that differ.
"""

import numpy as np

from mograft._util.arrays import FloatArray

__all__ = ["GRID", "eigenvectors", "product", "round_to_grid"]

GRID = 2.0**-20
"""Spacing of the grid, about 1e-6."""

_EIGENVALUE_GRID = 2.0**-32
"""Spacing of eigenvalues, as a share of the power of two above the trace."""


def round_to_grid(values: FloatArray, spacing: float = GRID) -> FloatArray:
    """Round numbers to multiples of a power of two; halves go to the even multiple.

    Parameters
    ----------
    values : ndarray
        The numbers.
    spacing : float
        A power of two.

    Returns
    -------
    ndarray, shape of `values`
        The rounded numbers; zeros are positive.
    """
    rounded: FloatArray = values / spacing
    np.rint(rounded, out=rounded)
    rounded *= spacing
    rounded += 0.0  # -0.0 becomes 0.0
    return rounded


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Multiply two matrices after rounding both to `GRID`.

    Parameters
    ----------
    a : ndarray, shape (m, k)
        Rows.
    b : ndarray, shape (k, n)
        Columns.

    Returns
    -------
    ndarray, shape (m, n)
        The product of the rounded matrices. It is exact, and hence independent of the number
        of threads and of the other rows, if the norm of each row times the norm of each column
        is at most 8192.
    """
    # By Cauchy and Schwarz every partial sum is at most 2^13, and a multiple of 2^-40: the 53
    # bits of a float64 hold it.
    found: FloatArray = round_to_grid(a) @ round_to_grid(b)
    found += 0.0
    return found


def eigenvectors(matrix: FloatArray, n_vectors: int) -> tuple[FloatArray, FloatArray]:
    """Return the eigenvalues of a symmetric matrix and its leading eigenvectors.

    Parameters
    ----------
    matrix : ndarray, shape (n, n)
        A symmetric, positive semidefinite matrix.
    n_vectors : int
        Number of eigenvectors; at most n are returned.

    Returns
    -------
    values : ndarray, shape (n,)
        All eigenvalues, descending, rounded to 2^-32 of the power of two above the trace.
    vectors : ndarray, shape (n, n_vectors)
        Columns of norm 1, rounded to `GRID`, by descending eigenvalue. In each the entry of
        largest absolute value is positive; ties go to the first.

    Notes
    -----
    `numpy.linalg.eigh`, whose results differ in the last bits between numbers of BLAS threads.
    The rounded results differ if a number lies next to the middle between two multiples, or if
    two eigenvalues are nearly equal: see "Principal components" in the contributing page.

    The sign is chosen after rounding: in eigenvectors of mirrored motions several entries have
    the same absolute value but for the last bits.
    """
    values, vectors = np.linalg.eigh(matrix)
    leading = round_to_grid(vectors[:, ::-1][:, :n_vectors])
    largest = np.take_along_axis(leading, np.abs(leading).argmax(axis=0)[None], axis=0)
    size = 2.0 ** float(np.frexp(np.trace(matrix))[1])
    return (
        round_to_grid(values[::-1], _EIGENVALUE_GRID * size),
        leading * np.where(largest < 0, -1.0, 1.0) + 0.0,
    )
