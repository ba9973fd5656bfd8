"""Counts of combinations: by enumeration, by the laws of moments, of any size."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.donors.enrichment import PAPER_TABLES, cluster_numbers, enrichment, moment_laws, sweep
from mograft.search.candidates import count_combinations

LABELS = st.lists(st.integers(0, 4), min_size=1, max_size=40)


@pytest.fixture
def library(single_clip_library):
    return single_clip_library


@given(LABELS)
def test_moment_laws_counts_of_clustering_hold(labels):
    counts = {k: count_combinations(np.array(labels), k) for k in (2, 3, 4, 5)}
    assert all(law.holds for law in moment_laws(len(labels), counts))


@given(LABELS, st.integers(2, 4), st.integers(2, 10**30))
def test_moment_laws_one_count_too_large_fail(labels, k, factor):
    counts = {n: count_combinations(np.array(labels), n) for n in (2, 3, 4, 5)}
    counts[k] *= factor * max(Counter(labels).values()) ** 2
    laws = moment_laws(len(labels), counts)
    assert not all(law.holds for law in laws)
    assert all(law.holds == (law.margin >= 1 - 1e-9) for law in laws)


def test_counts_do_not_depend_on_neighbourhood(library):
    ball = library.relabelled(replace(library.config, neighbourhood="ball"))
    assert enrichment(ball) == enrichment(library)
    assert sweep(ball, ("rms",), (0.25, 1.0)) == sweep(library, ("rms",), (0.25, 1.0))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda own: sweep(own, groups=(2, 1)), "`groups` must contain numbers of at least 2"),
        (
            lambda own: sweep(own, ("rms", "mean")),
            "`readings` must be among literal, rms, got 'mean'",
        ),
        (lambda own: enrichment(own, [1]), "at least 2"),
        (lambda _: moment_laws(3, {2: 0}), "at least 1"),
    ],
)
def test_invalid_arguments_raise_value_error(library, call, message):
    with pytest.raises(ValueError, match=message):
        call(library)


def test_moment_laws_paper_tables_fail_for_five_groups():
    for _, segments, counts in PAPER_TABLES.values():
        failed = {law.name for law in moment_laws(segments, counts) if not law.holds}
        assert "Cauchy-Schwarz: B_3 B_5 >= B_4^2" in failed
    _, segments, counts = PAPER_TABLES["table 2"]
    assert all(law.holds for law in moment_laws(segments, {k: counts[k] for k in (2, 3, 4)}))


def test_enrichment_counts_equal_sizes_of_candidate_lists(library):
    pool = library.pool("upper")
    config = replace(library.config, neighbourhood="cluster")
    candidates = pool.candidate_lists(np.arange(len(library.segments)), config)
    found = enrichment(library)
    for count in found.counts:
        k = count.groups
        assert count.filtered == sum(len(own) ** (k - 1) for own in candidates)
        assert count.unfiltered == count_combinations(library.labels["lower"], k)
        assert count.new == count.filtered - found.segments


def test_enrichment_sixty_groups_is_exact(library):
    n = len(library.segments)
    one_cluster = replace(library, labels=dict.fromkeys(library.labels, np.zeros(n, np.int64)))
    found = enrichment(one_cluster, [60])
    assert found.as_dict()["counts"][0]["unfiltered"] == str(n**60)
    # The margins of huge counts are finite.
    assert all(math.isfinite(law.margin) for law in moment_laws(n, {2: n**600, 3: 1}))


def test_sweep_larger_scale_has_fewer_clusters_and_more_combinations(library):
    for reading in ("rms", "literal"):
        rows = sweep(library, [reading])
        clusters = [row.clusters for row in rows]
        assert clusters == sorted(clusters, reverse=True)
        unfiltered = [row.counts[-1].unfiltered for row in rows]
        assert unfiltered == sorted(unfiltered)


def test_sweep_configured_threshold_equals_enrichment(library):
    rows = {(row.sigma, row.sigma_scale): row for row in sweep(library)}
    row = rows[library.config.sigma, library.config.sigma_scale]
    assert row.counts == enrichment(library).counts


def test_cluster_numbers_all_presets_share_base_clusters(library):
    found = cluster_numbers(library)
    assert sorted(found) == [2, 3, 4, 5]
    assert len({numbers["lower"] for numbers in found.values()}) == 1
    assert found[2]["lower"] == enrichment(library).clusters
