"""Matrix products and eigenvectors with the same bits for any number of BLAS threads.

The order of additions in a BLAS, and so the last bits of a result, depend on the number of its
threads; such bits decide ties between clusters. Rounding to a grid removes the difference.
"""

import numpy as np

from mograft._util.arrays import FloatArray

GRID = 2.0**-20
"""Spacing of the grid, about 1e-6."""

_EIGENVALUE_GRID = 2.0**-32
"""Spacing of eigenvalues, as a share of the power of two above the trace."""


def round_to_grid(values: FloatArray, spacing: float | FloatArray = GRID) -> FloatArray:
    """Round numbers to multiples of `spacing`, a power of two; halves go to the even multiple.

    The result contains no negative zeros.
    """
    rounded: FloatArray = np.rint(values / spacing)
    rounded *= spacing
    rounded += 0.0  # -0.0 becomes 0.0
    return rounded


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the product of two matrices after rounding their entries to multiples of 2^-20.

    The product of the rounded matrices is exact if the norm of each row of `a` times the norm of
    each column of `b` is at most 8192. A row of an exact product depends neither on the number of
    threads nor on the other rows.
    """
    # By Cauchy and Schwarz every partial sum is at most 2^13, and a multiple of 2^-40: the 53
    # bits of a float64 hold it.
    found: FloatArray = round_to_grid(a) @ round_to_grid(b)
    found += 0.0
    return found


def eigenvectors(matrix: FloatArray, n_vectors: int) -> tuple[FloatArray, FloatArray]:
    """Return the eigenvalues and leading eigenvectors of a positive semidefinite matrix.

    The eigenvalues, shape (n,), are descending and rounded to multiples of 2^-32 · p, where p is
    the smallest power of two above the trace. The eigenvectors, shape (n, min(n, n_vectors)), are
    columns of norm 1, rounded to multiples of 2^-20. The sign of an eigenvector is such that its
    entry of largest absolute value is positive; ties go to the first entry.

    The last bits of `numpy.linalg.eigh` depend on the number of BLAS threads. The rounded results
    depend on that number only if a value is almost halfway between two multiples, or if two
    eigenvalues are nearly equal: see "Principal components" on the contributing page. Signs are
    chosen after rounding, because before it entries of equal size can differ in the last bits.
    """
    values, vectors = np.linalg.eigh(matrix)
    spacing = np.ldexp(_EIGENVALUE_GRID, np.frexp(np.trace(matrix))[1])
    leading = round_to_grid(vectors[:, ::-1])[:, :n_vectors]
    largest = np.take_along_axis(leading, np.abs(leading).argmax(axis=0)[None], axis=0)
    return round_to_grid(values[::-1], spacing), leading * np.where(largest < 0, -1.0, 1.0) + 0.0
