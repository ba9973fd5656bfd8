"""`CompleteLinkage` with scikit-learn: its checks, its own estimator, and its tools."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.distance import pdist
from sklearn.cluster import AgglomerativeClustering
from sklearn.utils.estimator_checks import check_estimator

from mograft import clustering
from tests.analysis.test_clustering import by_first_appearance, clouds
from tests.linkage.test_adversarial import METRICS


@pytest.mark.filterwarnings("ignore:Estimator CompleteLinkage does not inherit:UserWarning")
@pytest.mark.parametrize("parameters", [{}, {"metric": "sqeuclidean"}])
def test_complete_linkage_passes_check_estimator(parameters):
    results = check_estimator(clustering.CompleteLinkage(**parameters), on_skip=None)
    found = {result["status"] for result in results}
    # scikit-learn before 1.9 skips no check.
    assert found in ({"passed"}, {"passed", "skipped"})


@given(
    st.integers(0, 2**32),
    st.tuples(st.integers(2, 60), st.integers(3, 9)),
    st.sampled_from(METRICS),
    st.data(),
)
def test_complete_linkage_equals_agglomerative_clustering(seed, shape, metric, data):
    points = np.random.default_rng(seed).standard_normal(shape)
    tree = clustering.linkage(points, metric=metric)
    heights = tree[:, 2]
    if data.draw(st.booleans()):
        parameters = {"n_clusters": data.draw(st.integers(1, len(points)))}
    else:
        # Between two heights, because scikit-learn's heights differ in the last bits.
        gap = data.draw(st.integers(0, len(heights) - 1))
        below = heights[gap - 1] if gap else 0.0
        parameters = {"n_clusters": None, "distance_threshold": (below + heights[gap]) / 2}
    model = clustering.CompleteLinkage(metric=metric, **parameters).fit(points)
    distances = np.sort(pdist(points, metric))
    assume(np.diff(distances).min(initial=np.inf) > 1e-12)  # else rounding changes the order
    options = {"linkage": "complete", "metric": metric, "compute_distances": True}
    peer = AgglomerativeClustering(**options, **parameters).fit(points)
    np.testing.assert_array_equal(model.labels_, by_first_appearance(peer.labels_))
    np.testing.assert_array_equal(np.sort(model.children_), np.sort(peer.children_))
    np.testing.assert_allclose(model.distances_, peer.distances_, rtol=1e-9, atol=1e-14)
    for name in ("n_clusters_", "n_leaves_", "n_connected_components_", "n_features_in_"):
        assert getattr(model, name) == getattr(peer, name), name


@given(clouds(kinds=["lattice", "single precision"]), st.floats(0, 1))
def test_complete_linkage_threshold_is_exclusive(points, quantile):
    threshold = float(np.quantile(clustering.linkage(points)[:, 2], quantile, method="nearest"))
    model = clustering.CompleteLinkage(None, distance_threshold=threshold).fit(points)
    assert model.n_clusters_ == 1 + np.count_nonzero(model.distances_ >= threshold)
    assert model.n_clusters_ == len(np.unique(model.labels_))
    inclusive = clustering.CompleteLinkage(None, distance_threshold=np.nextafter(threshold, np.inf))
    np.testing.assert_array_equal(inclusive.fit_predict(points), clustering.cut(points, threshold))


def test_complete_linkage_unknown_parameter_raises_value_error():
    with pytest.raises(ValueError, match=r"`params` must be among n_clusters, .*, got 'linkage'"):
        clustering.CompleteLinkage().set_params(linkage="complete")


def test_complete_linkage_column_names_that_are_not_all_strings_raise_type_error():
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    frame = pandas.DataFrame(np.eye(6, 3), columns=["a", 1, "c"])
    with pytest.raises(TypeError, match="X must have column names that are all strings"):
        clustering.CompleteLinkage(4).fit(frame)
