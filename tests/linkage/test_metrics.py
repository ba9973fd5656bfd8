"""Metrics against SciPy, and points of every memory layout and precision."""

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.cluster import hierarchy

from mograft import clustering
from tests.analysis.test_clustering import by_first_appearance, clouds
from tests.linkage.test_adversarial import METRICS
from tests.memory import PEAK_BYTES
from tests.running import run_python


def with_other_columns(points):
    """Return points with two more axes, so that no row is zero or constant."""
    return np.c_[points, np.full(len(points), 7.0), np.full(len(points), 9.0)]


SMALL_CLOUDS = clouds(max_points=20, kinds=["lattice", "single precision"])


@given(SMALL_CLOUDS, st.sampled_from(METRICS), st.floats(0, 1))
@example(np.array([[1e-170], [0.0], [1.0]]), "sqeuclidean", 0.0)
def test_cut_any_metric_at_and_next_to_height_equals_fcluster(points, metric, quantile):
    points = with_other_columns(points)
    tree = clustering.linkage(points, metric=metric)
    height = np.quantile(tree[:, 2], quantile, method="nearest")
    for limit in (height, np.nextafter(height, -1), np.nextafter(height, np.inf), np.inf):
        if limit >= 0:
            expected = by_first_appearance(hierarchy.fcluster(tree, limit, "distance"))
            np.testing.assert_array_equal(clustering.cut(points, limit, metric=metric), expected)


@given(SMALL_CLOUDS, st.sampled_from(METRICS))
def test_linkage_any_layout_and_precision_gives_one_tree(points, metric):
    points = with_other_columns(points)
    tree = clustering.linkage(points, metric=metric)
    limit = float(np.median(tree[:, 2]))
    labels = clustering.cut(points, limit, metric=metric)
    single = points.astype(np.float32)  # these coordinates are exact in single precision
    padded = np.zeros((len(points), 2 * points.shape[1]))
    padded[:, ::2] = points
    layouts = [np.asfortranarray(points), single, np.asfortranarray(single), padded[:, ::2]]
    is_whole = (points == points.round()).all() and np.abs(points).max() < 100
    layouts += [points.astype(own) for own in (np.int8, np.float16)] if is_whole else []
    for same in layouts:
        np.testing.assert_array_equal(clustering.linkage(same, metric=metric), tree)
        np.testing.assert_array_equal(clustering.cut(same, limit, metric=metric), labels)


@given(st.integers(0, 2**32), st.integers(2, 40))
def test_linkage_condensed_single_precision_equals_double(seed, n):
    distances = np.random.default_rng(seed).random(n * (n - 1) // 2).astype(np.float32)
    expected = clustering.linkage_condensed(distances.astype(np.float64))
    np.testing.assert_array_equal(clustering.linkage_condensed(distances), expected)
    np.testing.assert_array_equal(clustering.linkage_condensed(distances, memory_limit=0), expected)


def test_angular_metrics_extreme_lengths_do_not_overflow():
    points = np.random.default_rng(1).standard_normal((20, 8))
    lengths = 2.0 ** np.random.default_rng(2).integers(-1000, 1000, (20, 1))
    for metric in METRICS[2:]:
        expected = clustering.linkage(points, metric=metric)
        np.testing.assert_array_equal(clustering.linkage(points * lengths, metric=metric), expected)


MEMORY = """
import numpy as np
from mograft import clustering
rng = np.random.default_rng(0)
points = np.empty((40_000, 100), np.{dtype}, "{order}")
for axis in range(100):
    points[:, axis] = rng.random(40_000)
clustering.cut(points[:3].copy(), 0.5)
before = peak_bytes()
clustering.cut(points, 1e-9, memory_limit=0, n_threads=1)
print(peak_bytes() - before)
"""


def test_cut_single_precision_columns_are_not_copied():
    def extra_bytes(dtype, order):
        return int(run_python(PEAK_BYTES + MEMORY.format(dtype=dtype, order=order)))

    in_double = 40_000 * 100 * 8
    usual = extra_bytes("float64", "C")
    assert extra_bytes("float64", "F") < usual + in_double / 2
    assert extra_bytes("float32", "F") < usual + in_double / 2
