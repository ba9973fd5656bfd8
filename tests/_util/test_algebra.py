"""Laws of linear algebra whose bits depend on the numbers alone."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft._util.linalg import eigen, gram, product
from tests.strategies import SEEDS

SIZES = st.integers(1, 40)


def numbers(seed, *shape):
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape) * np.exp(rng.uniform(-12, 12, shape))


@given(SEEDS, SIZES, st.integers(1, 300), SIZES)
def test_the_order_of_sums_changes_no_bit(seed, m, k, n):
    a, b = numbers(seed, m, k), numbers(seed + 1, k, n)
    order = np.random.default_rng(seed).permutation(k)
    assert product(a[:, order], b[order]).tobytes() == product(a, b).tobytes()
    assert gram(b[order]).tobytes() == gram(b).tobytes()


@given(SEEDS, SIZES, st.integers(1, 300), SIZES)
def test_a_row_of_a_product_does_not_depend_on_the_others(seed, m, k, n):
    a, b = numbers(seed, m, k), numbers(seed + 1, k, n)
    alone = np.concatenate([product(row[None], b) for row in a])
    assert alone.tobytes() == product(a, b).tobytes()


@given(SEEDS, st.integers(1, 5), st.integers(1, 20), st.integers(1, 5))
def test_a_product_is_as_near_to_the_true_one_as_it_says(seed, m, k, n):
    a, b = numbers(seed, m, k), numbers(seed + 1, k, n)
    found = product(a, b)
    bound = 2.0**-40 * k * np.abs(a).max(axis=1)[:, None] * np.abs(b).max(axis=0)
    for i in range(m):
        for j in range(n):
            true = sum(Fraction(x) * Fraction(y) for x, y in zip(a[i], b[:, j], strict=True))
            assert abs(Fraction(found[i, j]) - true) <= bound[i, j]
    np.testing.assert_array_less(np.abs(gram(a.T) - product(a, a.T)), bound_of(a))


def bound_of(a):
    most = np.abs(a).max(axis=1)
    return 2.0**-39 * a.shape[1] * np.outer(most, most)


def test_nothing_is_nothing():
    assert not product(np.zeros((2, 3)), np.ones((3, 4))).any()
    assert gram(np.zeros((5, 3))).shape == (3, 3)
    assert product(np.ones((2, 0)), np.ones((0, 4))).tolist() == [[0.0] * 4] * 2


@given(SEEDS, st.integers(1, 60), st.integers(1, 60), st.integers(0, 70))
def test_eigenvectors_are_numpys(seed, n, rank, wanted):
    rows = np.random.default_rng(seed).normal(size=(rank, n))
    matrix = rows.T @ rows
    values, vectors = eigen(matrix, wanted)
    theirs = np.linalg.eigvalsh(matrix)[::-1]
    size = np.abs(matrix).sum()
    np.testing.assert_allclose(values, theirs, rtol=0, atol=1e-14 * size)
    wanted = min(wanted, n)
    assert vectors.shape == (n, wanted)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(wanted), atol=1e-13 * n)
    np.testing.assert_allclose(
        matrix @ vectors, vectors * values[:wanted], rtol=0, atol=1e-14 * size
    )


def test_what_has_no_eigenvectors_is_refused():
    with pytest.raises(ValueError, match="square"):
        eigen(np.ones((2, 3)), 1)
    with pytest.raises(ValueError, match="finite"):
        eigen(np.full((2, 2), np.nan), 1)
