"""Counts of combinations: by enumeration, by the laws of moments, of any size."""

import math
from collections import Counter
from dataclasses import replace
from itertools import product

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


def test_sweep_invalid_arguments_raise_value_error(library):
    with pytest.raises(ValueError, match="`groups` must contain numbers of at least 2, got 1"):
        sweep(library, groups=(2, 1))
    with pytest.raises(ValueError, match="`readings` must be among literal, rms, got 'mean'"):
        sweep(library, ("rms", "mean"))


def test_moment_laws_paper_tables_fail_for_five_groups():
    for _, segments, counts in PAPER_TABLES.values():
        failed = {law.name for law in moment_laws(segments, counts) if not law.holds}
        assert "Cauchy-Schwarz: B_3 B_5 >= B_4^2" in failed
    _, segments, counts = PAPER_TABLES["table 2"]
    assert all(law.holds for law in moment_laws(segments, {k: counts[k] for k in (2, 3, 4)}))


def test_enrichment_counts_equal_enumeration(library):
    pool = library.pool("upper")
    config = replace(library.config, neighbourhood="cluster")
    candidates = pool.candidate_lists(np.arange(len(library.segments)), config)
    few = [segments for segments in candidates[:6] if len(segments) < 12]
    found = enrichment(library)
    for count in found.counts:
        k = count.groups
        enumerated = sum(sum(1 for _ in product(s, repeat=k - 1)) for s in few)
        assert enumerated == sum(len(s) ** (k - 1) for s in few)
        assert count.filtered == sum(len(s) ** (k - 1) for s in candidates)
        assert count.unfiltered == count_combinations(library.labels["lower"], k)
        assert count.new == count.filtered - found.segments


def test_enrichment_without_length_limit_equals_unfiltered(library):
    free = replace(library, config=replace(library.config, max_stretch=1e9))
    free = replace(free, is_donor=np.ones(len(free.segments), bool))
    assert all(count.filtered == count.unfiltered for count in enrichment(free).counts)


def test_enrichment_sixty_groups_is_exact(library):
    n = len(library.segments)
    one_cluster = replace(library, labels=dict.fromkeys(library.labels, np.zeros(n, np.int64)))
    found = enrichment(one_cluster, [60])
    assert found.counts[0].unfiltered == n**60
    assert found.as_dict()["counts"][0]["unfiltered"] == str(n**60)


def test_moment_laws_huge_counts_have_finite_margin(library):
    n = len(library.segments)
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


@pytest.mark.parametrize("counts", [{2: 0}, {3: -1}])
def test_moment_laws_count_below_one_raises_value_error(counts):
    with pytest.raises(ValueError, match="at least 1"):
        moment_laws(3, counts)


def test_enrichment_one_group_raises_value_error(library):
    with pytest.raises(ValueError, match="at least 2"):
        enrichment(library, [1])
