"""Errors for invalid input."""

import sys

import numpy as np
import pytest
from scipy.sparse import csr_array

from mograft import clustering
from mograft.clustering import cut, linkage, linkage_condensed, threshold
from tests.running import run_python

NAN = np.array([[0.0, 1.0], [2.0, 3.0], [4.0, np.nan]])
INF = np.array([[0.0, 1.0], [-np.inf, 3.0], [4.0, 5.0]])
POINTS = np.array([[0.0, 1.0], [2.0, 3.0], [4.0, 6.0]])
TEXTS = [["a", "b"], ["c", "d"]]
NEGATIVE = {"distance_threshold": -1.0}


def fit(points, **parameters):
    return clustering.CompleteLinkage(**parameters).fit(points)


COSINE, CORRELATION, SQUARED = ({"metric": own} for own in ("cosine", "correlation", "sqeuclidean"))


@pytest.mark.parametrize(
    ("call", "data", "options", "error", "message"),
    [
        (linkage, NAN, {}, ValueError, r"finite, got NaN at \[2, 1\]"),
        (linkage, INF, {}, ValueError, r"finite, got -inf at \[1, 0\]"),
        (linkage, NAN, {"metric": "cosine"}, ValueError, r"got NaN at \[2, 1\]"),
        (linkage, POINTS[:1], {}, ValueError, r"shape \(n >= 2, .*, got \(1, 2\)"),
        (linkage, POINTS[:0], {}, ValueError, r"got \(0, 2\)"),
        (linkage, POINTS, {"metric": "near"}, ValueError, "`metric` must .*'near'"),
        (linkage, TEXTS, {}, (TypeError, ValueError), "must be real numbers, got <U1"),
        (linkage_condensed, [], {}, ValueError, "`distances` must have shape"),
        (linkage_condensed, np.ones(4), {}, ValueError, "have n.* elements .*got 4"),
        (linkage_condensed, [1.0, np.nan, 2.0], {}, ValueError, r"got NaN at \[1\]"),
        (fit, NAN, {}, ValueError, r"nan at \[2, 1\]"),
        (fit, INF, {}, ValueError, r"-inf at \[1, 0\]"),
        (fit, POINTS[:1], {}, ValueError, "n_samples = 1"),
        (fit, TEXTS, {}, ValueError, "could not convert string to float"),
        (fit, POINTS + 1j, {}, ValueError, "Complex data not supported"),
        (fit, csr_array(POINTS), {}, TypeError, "Sparse data was passed for X, but dense"),
        (fit, POINTS, {"n_clusters": 0}, ValueError, "`n_clusters` must be 1 or more, got 0"),
        (fit, POINTS, {"n_clusters": 4}, ValueError, "at most n_samples = 3, got 4"),
        (fit, POINTS, {"n_clusters": 1.5}, TypeError, r"must be a whole number, got 1\.5"),
        (fit, POINTS, {"metric": "near"}, ValueError, "`metric` must be one of .*, got 'near'"),
        (fit, POINTS, {"n_clusters": None}, ValueError, "Exactly one of n_clusters and dist"),
        (fit, POINTS, {"distance_threshold": 1.0}, ValueError, "Exactly one of n_clusters"),
        (fit, POINTS, {"n_clusters": None} | NEGATIVE, ValueError, "_threshold` must be 0 or more"),
        (cut, POINTS, {"max_diameter": "2"}, TypeError, "`max_diameter` must be a number, got '2'"),
        (
            threshold,
            POINTS,
            {"kind": 2.0},
            ValueError,
            "`kind` must be 'rms' or 'literal', got 2.0",
        ),
        (threshold, POINTS, {"scale": 1j}, TypeError, "`scale` must be a number, got 1j"),
        (fit, POINTS, {"n_clusters": None, "distance_threshold": [1.0]}, TypeError, "be a number"),
        (cut, POINTS, {"max_diameter": -1.0}, ValueError, "must be 0 or more, got -1"),
        (cut, POINTS, {"max_diameter": np.nan}, ValueError, "0 or more, got nan"),
        (linkage_condensed, [1.0, -1.0, 2.0], {}, ValueError, r"got -1 at \[1\]"),
        (linkage, POINTS * [[1], [0], [0]], COSINE, ValueError, "no zero rows .*, got row 1"),
        (linkage, [[0.1, 0.2], [0.1, 0.1]], CORRELATION, ValueError, "no constant .*, got row 1"),
        (linkage, POINTS * 1e200, SQUARED, ValueError, r"squared distances below 1\.8e308"),
        (linkage, POINTS + 1j, {}, TypeError, "must be real numbers, got complex128"),
        (linkage, csr_array(POINTS), {}, TypeError, "must be dense, got a sparse"),
        (linkage, POINTS, {"n_threads": 0}, ValueError, "must be 1 or more, got 0"),
        (linkage, POINTS, {"n_threads": 1.5}, TypeError, "must be a whole number"),
        (linkage, POINTS, {"memory_limit": -1}, ValueError, "must be 0 or more"),
        (linkage, POINTS, {"max_memory": -1}, ValueError, "must be 0 or more"),
        (linkage, POINTS, {"max_memory": 10}, MemoryError, r"\d+ bytes, the limit is"),
        (linkage_condensed, np.ones(3), {"max_memory": 9}, MemoryError, "about 24 bytes, .* is 9"),
    ],
)
def test_invalid_input_raises_error(call, data, options, error, message):
    with pytest.raises(error, match=message):
        call(data, **options)


def test_linkage_excessive_limits_have_no_effect():
    tree = linkage(POINTS)
    for name in ("n_threads", "memory_limit", "max_memory"):
        np.testing.assert_array_equal(linkage(POINTS, **{name: 10**30}), tree)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the limit is that of Linux")
@pytest.mark.parametrize("megabytes", [1, 4, 12, 40])
def test_limited_address_space_raises_memory_error_or_succeeds(megabytes):
    """The process is never aborted, whatever thread needs memory first."""
    code = f"""
import resource
import numpy as np
from mograft import clustering
points = np.random.default_rng(0).normal(size=(3000, 10))
clustering.linkage(points[:9])
size = [line for line in open("/proc/self/status") if line.startswith("VmSize")][0]
limit = (int(size.split()[1]) << 10) + ({megabytes} << 20)
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
try:
    print(len(clustering.linkage(points, n_threads=4)))
except MemoryError as error:
    print("MemoryError", error)
"""
    words = run_python(code).split()
    assert words[0] == "MemoryError" if megabytes == 1 else words[0] in ("2999", "MemoryError")
