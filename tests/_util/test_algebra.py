"""Sums, eigenvectors and runs equal their definitions, whatever the threads."""

from fractions import Fraction
from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft._util.linalg import GRID, eigenvectors, product, round_to_grid
from mograft._util.runs import dilate, find_runs
from tests.strategies import SEEDS

SIZES = st.integers(1, 40)


def random_rows(seed, *shape):
    """Return numbers whose products with `directions` are exact: norms stay below 8192."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape) * np.exp(rng.uniform(-12, 4, shape))


def directions(seed, *shape):
    vectors = np.random.default_rng(seed).normal(size=shape)
    return vectors / np.linalg.norm(vectors, axis=0)


@given(SEEDS, st.integers(0, 60))
def test_round_to_grid_returns_nearest_multiple(seed, exponent):
    values = np.random.default_rng(seed).normal(size=50) * 2.0**exponent
    rounded = round_to_grid(values)
    assert (np.abs(rounded - values) <= GRID / 2).all()
    multiples = rounded / GRID
    np.testing.assert_array_equal(multiples, np.rint(multiples))
    np.testing.assert_array_equal(round_to_grid(rounded), rounded)
    assert not np.signbit(round_to_grid(np.array([-0.0, -GRID / 2, -1e-300]))).any()


@given(SEEDS, st.integers(0, 5), st.integers(0, 20), st.integers(0, 5))
def test_product_of_rounded_matrices_is_exact(seed, m, k, n):
    a, b = random_rows(seed, m, k), directions(seed + 1, k, n)
    found, on_grid = product(a, b), (round_to_grid(a), round_to_grid(b))
    for i in range(m):
        for j in range(n):
            pairs = zip(on_grid[0][i], on_grid[1][:, j], strict=True)
            assert Fraction(found[i, j]) == sum(Fraction(x) * Fraction(y) for x, y in pairs)
    bound = 0.5 * GRID * (np.abs(a).sum(axis=1)[:, None] + np.abs(b).sum(axis=0) + k * GRID)
    assert (np.abs(found - a @ b) <= bound + 1e-12).all()


@pytest.mark.parametrize("n", [1, 64, 1024])
def test_product_at_largest_norm_is_exact(n):
    """A row of norm 8192 along a column of norm 1 gives the largest sum that is covered."""
    row, column = np.full((1, n), 8192 / np.sqrt(n)), np.full((n, 1), 1 / np.sqrt(n))
    expected = n * Fraction(row[0, 0]) * Fraction(column[0, 0])
    assert product(row, column).item() == expected == 8192


@given(SEEDS, st.integers(1, 60), st.integers(1, 60), st.integers(0, 70))
def test_eigenvectors_satisfy_definition_on_grid(seed, n, rank, n_vectors):
    rows = np.random.default_rng(seed).normal(size=(rank, n))
    matrix = rows.T @ rows
    values, vectors = eigenvectors(matrix, n_vectors)
    trace = np.trace(matrix)
    expected, atol = np.linalg.eigvalsh(matrix)[::-1], 2.0**-32 * trace + 1e-14 * trace
    np.testing.assert_allclose(values, expected, rtol=0, atol=atol)
    n_vectors = min(n_vectors, n)
    assert vectors.shape == (n, n_vectors)
    # Each entry moves by half the grid, each vector of n entries by √n times that.
    moved = 0.5 * GRID * np.sqrt(n)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(n_vectors), atol=2.1 * moved)
    residual = np.linalg.norm(matrix @ vectors - vectors * values[:n_vectors], axis=0)
    assert (residual <= 2.1 * moved * trace).all()
    np.testing.assert_array_equal(round_to_grid(vectors), vectors)
    assert not np.signbit(vectors[vectors == 0.0]).any()
    largest = np.abs(vectors).argmax(axis=0)
    assert (vectors[largest, np.arange(n_vectors)] > 0).all()


@given(SEEDS, st.integers(2, 15))
def test_eigenvectors_entries_of_equal_size_take_sign_from_first(seed, n):
    """Mirrored data have eigenvectors (v, -v), whose halves differ in the last bits only."""
    rows = np.random.default_rng(seed).normal(size=(3 * n, n))
    same, cross = rows.T @ rows + 9 * n * np.eye(n), np.diag(np.linspace(1.0, 2.0, n)) * n
    matrix = np.block([[same, -cross], [-cross, same]])
    first = eigenvectors(matrix, 1)[1][:, 0]
    np.testing.assert_array_equal(np.abs(first[:n]), np.abs(first[n:]))
    jitter = 1e-14 * np.random.default_rng(seed).normal(size=matrix.shape)
    again = eigenvectors(matrix * (1.0 + (jitter + jitter.T)), 1)[1][:, 0]
    assert again.tobytes() == first.tobytes()


MASKS = st.lists(st.booleans(), max_size=30).map(lambda marks: np.array(marks, bool))


@given(MASKS)
def test_find_runs_matches_itertools_groupby(mask):
    groups = [(value, len(list(run))) for value, run in groupby(mask.tolist())]
    stops = np.cumsum([length for _, length in groups], dtype=int)
    pairs = zip(groups, stops.tolist(), strict=True)
    expected = [[stop - length, stop] for (value, length), stop in pairs if value]
    assert find_runs(mask).tolist() == expected


@given(MASKS, st.integers(0, 4) | st.just(1 << 40))
def test_dilate_marks_positions_within_the_distance(mask, steps):
    marked = np.flatnonzero(mask)
    expected = [bool((np.abs(marked - i) <= steps).any()) for i in range(len(mask))]
    before = mask.copy()
    assert dilate(mask, steps).tolist() == expected
    np.testing.assert_array_equal(mask, before)
