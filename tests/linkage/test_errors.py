"""Errors for invalid input, beside those of SciPy and scikit-learn."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.cluster import hierarchy
from scipy.sparse import csr_array
from sklearn.cluster import AgglomerativeClustering

from mograft import clustering

NAN = np.array([[0.0, 1.0], [2.0, 3.0], [4.0, np.nan]])
INF = np.array([[0.0, 1.0], [-np.inf, 3.0], [4.0, 5.0]])
POINTS = np.array([[0.0, 1.0], [2.0, 3.0], [4.0, 6.0]])
PEER = AgglomerativeClustering(linkage="complete")


def scipy_tree(points, metric="euclidean"):
    return hierarchy.linkage(points, "complete", metric)


def fit(points, **parameters):
    return clustering.CompleteLinkage(**parameters).fit(points)


def peer_fit(points, **parameters):
    return AgglomerativeClustering(linkage="complete", **parameters).fit(points)


TABLE = [
    # our call, the peer's call, error, message
    (
        lambda: clustering.linkage(NAN),
        lambda: scipy_tree(NAN),
        ValueError,
        r"finite, got NaN at \[2, 1\]",
    ),
    (
        lambda: clustering.linkage(INF),
        lambda: scipy_tree(INF),
        ValueError,
        r"finite, got -inf at \[1, 0\]",
    ),
    (lambda: fit(NAN), lambda: peer_fit(NAN), ValueError, r"nan at \[2, 1\]"),
    (lambda: fit(INF), lambda: peer_fit(INF), ValueError, r"-inf at \[1, 0\]"),
    (
        lambda: clustering.linkage(NAN, metric="cosine"),
        lambda: scipy_tree(NAN, "cosine"),
        ValueError,
        r"finite, got NaN at \[2, 1\]",
    ),
    (
        lambda: clustering.linkage(POINTS[:1]),
        lambda: scipy_tree(POINTS[:1]),
        ValueError,
        r"`points` must have shape \(n >= 2, n_axes >= 1\), got \(1, 2\)",
    ),
    (
        lambda: clustering.linkage(POINTS[:0]),
        lambda: scipy_tree(POINTS[:0]),
        ValueError,
        r"got \(0, 2\)",
    ),
    (lambda: fit(POINTS[:1]), lambda: peer_fit(POINTS[:1]), ValueError, "n_samples = 1"),
    (
        lambda: clustering.linkage_condensed([]),
        lambda: hierarchy.complete(np.array([])),
        ValueError,
        "`distances` must have shape",
    ),
    (
        lambda: clustering.linkage_condensed(np.ones(4)),
        lambda: hierarchy.complete(np.ones(4)),
        ValueError,
        "`distances` must have n.* elements .*got 4",
    ),
    (
        lambda: clustering.linkage_condensed([1.0, np.nan, 2.0]),
        lambda: hierarchy.complete(np.array([1.0, np.nan, 2.0])),
        ValueError,
        r"`distances` must be finite and not negative, got NaN at \[1\]",
    ),
    (
        lambda: clustering.linkage(POINTS, metric="nearest"),
        lambda: scipy_tree(POINTS, "nearest"),
        ValueError,
        "`metric` must be one of euclidean, sqeuclidean, cosine, correlation, got 'nearest'",
    ),
    (
        lambda: clustering.linkage([["a", "b"], ["c", "d"]]),
        lambda: scipy_tree([["a", "b"], ["c", "d"]]),
        (TypeError, ValueError),
        "`points` must be real numbers, got <U1",
    ),
    (
        lambda: fit([["a", "b"], ["c", "d"]]),
        lambda: peer_fit([["a", "b"], ["c", "d"]]),
        ValueError,
        "could not convert string to float",
    ),
    (
        lambda: fit(POINTS + 1j),
        lambda: peer_fit(POINTS + 1j),
        ValueError,
        "Complex data not supported",
    ),
    (
        lambda: fit(csr_array(POINTS)),
        lambda: peer_fit(csr_array(POINTS)),
        TypeError,
        "Sparse data was passed for X, but dense data is required",
    ),
    (
        lambda: fit(POINTS, n_clusters=0),
        lambda: peer_fit(POINTS, n_clusters=0),
        ValueError,
        "`n_clusters` must be between 1 and n_samples = 3, got 0",
    ),
    (
        lambda: fit(POINTS, n_clusters=4),
        lambda: peer_fit(POINTS, n_clusters=4),
        ValueError,
        "`n_clusters` must be between 1 and n_samples = 3, got 4",
    ),
    (
        lambda: fit(POINTS, n_clusters=1.5),
        lambda: peer_fit(POINTS, n_clusters=1.5),
        TypeError,
        r"`n_clusters` must be a whole number, got 1\.5",
    ),
    (
        lambda: fit(POINTS, n_clusters=None, distance_threshold=-1.0),
        lambda: peer_fit(POINTS, n_clusters=None, distance_threshold=-1.0),
        ValueError,
        "`distance_threshold` must be 0 or more, got -1",
    ),
    (
        lambda: fit(POINTS, n_clusters=2, distance_threshold=1.0),
        lambda: peer_fit(POINTS, n_clusters=2, distance_threshold=1.0),
        ValueError,
        "Exactly one of n_clusters and distance_threshold",
    ),
    (
        lambda: fit(POINTS, n_clusters=None),
        lambda: peer_fit(POINTS, n_clusters=None),
        ValueError,
        "Exactly one of n_clusters and distance_threshold",
    ),
    (
        lambda: fit(POINTS, n_clusters=None, distance_threshold=1.0, compute_full_tree=False),
        lambda: peer_fit(POINTS, n_clusters=None, distance_threshold=1.0, compute_full_tree=False),
        ValueError,
        "compute_full_tree must be True if distance_threshold is set",
    ),
]


def test_linkage_excessive_limits_have_no_effect():
    tree = clustering.linkage(POINTS)
    for name in ("n_threads", "memory_limit", "max_memory"):
        np.testing.assert_array_equal(clustering.linkage(POINTS, **{name: 10**30}), tree)


@pytest.mark.parametrize("given", ["2", [1.0, 2.0], 1j], ids=str)
@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("max_diameter", lambda given: clustering.cut(POINTS, given)),
        ("kind", lambda given: clustering.threshold(POINTS, [given])),
        ("scale", lambda given: clustering.threshold(POINTS, scale=given)),
        (
            "distance_threshold",
            lambda given: fit(POINTS, n_clusters=None, distance_threshold=given),
        ),
    ],
)
def test_number_arguments_of_other_type_raise_type_error(name, call, given):
    with pytest.raises(TypeError, match=f"`{name}` must be a number, got"):
        call(given)


@pytest.mark.parametrize(("call", "peer", "error", "message"), TABLE, ids=range(len(TABLE)))
def test_invalid_input_raises_error_of_peer(call, peer, error, message):
    with pytest.raises(error, match=message):
        call()
    with pytest.raises(error):
        peer()


OWN = [
    # errors that the peers do not raise, or not by index
    (lambda: clustering.cut(POINTS, -1.0), ValueError, "`max_diameter` must be 0 or more, got -1"),
    (
        lambda: clustering.cut(POINTS, np.nan),
        ValueError,
        "`max_diameter` must be 0 or more, got nan",
    ),
    (
        lambda: clustering.linkage_condensed([1.0, -1.0, 2.0]),
        ValueError,
        r"`distances` must be finite and not negative, got -1 at \[1\]",
    ),
    (
        lambda: clustering.linkage(POINTS * [[1], [0], [0]], metric="cosine"),
        ValueError,
        "`points` must have no zero rows for metric 'cosine', got row 1",
    ),
    (
        lambda: clustering.cut([[0.1, 0.2], [0.1, 0.1]], 1.0, metric="correlation"),
        ValueError,
        "`points` must have no constant rows for metric 'correlation', got row 1",
    ),
    (
        lambda: clustering.linkage(POINTS * 1e200, metric="sqeuclidean"),
        ValueError,
        r"`points` must have squared distances below 1\.8e308",
    ),
    (
        lambda: clustering.linkage(POINTS + 1j),
        TypeError,
        "`points` must be real numbers, got complex128",
    ),
    (
        lambda: clustering.linkage(csr_array(POINTS)),
        TypeError,
        "`points` must be dense, got a sparse",
    ),
    (
        lambda: clustering.linkage(POINTS, n_threads=0),
        ValueError,
        "`n_threads` must be 1 or more, got 0",
    ),
    (
        lambda: clustering.linkage(POINTS, n_threads=1.5),
        TypeError,
        "`n_threads` must be a whole number",
    ),
    (
        lambda: clustering.linkage(POINTS, max_memory=10),
        MemoryError,
        r"the call needs about \d+ bytes, the limit is 10",
    ),
    (
        lambda: clustering.linkage_condensed(np.ones(3), max_memory=10),
        MemoryError,
        "the call needs about 24 bytes, the limit is 10",
    ),
    (
        lambda: clustering.cut(POINTS, 1.0, max_memory=-1),
        ValueError,
        "`max_memory` must be 0 or more",
    ),
    (
        lambda: clustering.linkage(POINTS, memory_limit=-1),
        ValueError,
        "`memory_limit` must be 0 or more",
    ),
]


@pytest.mark.parametrize(("call", "error", "message"), OWN, ids=range(len(OWN)))
def test_invalid_input_raises_error(call, error, message):
    with pytest.raises(error, match=message):
        call()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the limit is that of Linux")
def test_cophenet_too_many_pairs_raises_memory_error():
    """A terabyte, also where the system promises more memory than it has."""
    code = """
import resource
import numpy as np
from mograft import clustering
merges = np.arange(2.0**19 - 1)
tree = np.column_stack([np.r_[0, merges[:-1] + 2], 2.0**19 + merges - 1, merges, merges + 2])
tree[0, 1] = 1
resource.setrlimit(resource.RLIMIT_AS, (1 << 36, 1 << 36))
try:
    clustering.dendrogram.cophenet(tree)
except MemoryError:
    print("MemoryError")
"""
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert child.stdout == "MemoryError\n"


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
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    words = child.stdout.split()
    assert words[0] == "MemoryError" if megabytes == 1 else words[0] in ("2999", "MemoryError")
