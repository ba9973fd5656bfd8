"""Counts of what can be combined: by brute force, by the laws of moments, of any size."""

import math
from collections import Counter
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config, Library
from mograft.dancer import dance
from mograft.evaluation.enrichment import (
    PAPER_TABLES,
    cluster_numbers,
    enrichment,
    moment_laws,
    sweep,
)
from mograft.search.candidates import count_combinations

LABELS = st.lists(st.integers(0, 4), min_size=1, max_size=40)


@pytest.fixture(scope="module")
def library():
    return Library.build(dance(seed=2, strides=1).motion)


@given(LABELS)
def test_counts_of_any_clustering_obey_the_laws_of_moments(labels):
    counts = {k: count_combinations(np.array(labels), k) for k in (2, 3, 4, 5)}
    assert all(law.holds for law in moment_laws(len(labels), counts))


@given(LABELS, st.integers(2, 4), st.integers(2, 10**30))
def test_a_count_that_is_too_small_between_its_neighbours_is_found_out(labels, k, times):
    counts = {own: count_combinations(np.array(labels), own) for own in (2, 3, 4, 5)}
    counts[k] *= times * max(Counter(labels).values()) ** 2
    laws = moment_laws(len(labels), counts)
    assert not all(law.holds for law in laws)
    assert all(law.holds == (law.margin >= 1 - 1e-9) for law in laws)


def test_no_one_clustering_gives_the_papers_counts_for_five_groups():
    for _, segments, counts in PAPER_TABLES.values():
        failed = {law.name for law in moment_laws(segments, counts) if not law.holds}
        assert "Cauchy-Schwarz: B_3 B_5 >= B_4^2" in failed
    _, segments, counts = PAPER_TABLES["table 2"]
    assert all(law.holds for law in moment_laws(segments, {k: counts[k] for k in (2, 3, 4)}))


def test_counts_are_those_of_enumeration(library):
    pool = library.pool("upper")
    some = np.arange(6)
    few = pool.candidate_lists(some, library.config)
    own = enrichment(library)
    everyone = pool.candidate_lists(np.arange(len(library.segments)), library.config)
    for count in own.counts:
        k = count.groups
        brute = sum(sum(1 for _ in product(lent, repeat=k - 1)) for lent in few if len(lent) < 12)
        by_power = sum(len(lent) ** (k - 1) for lent in few if len(lent) < 12)
        assert brute == by_power
        assert count.filtered == sum(len(lent) ** (k - 1) for lent in everyone)
        assert count.unfiltered == count_combinations(library.labels["lower"], k)
        assert count.new == count.filtered - own.segments


def test_without_limits_on_length_the_two_counts_are_one(library):
    free = replace(library, config=replace(library.config, max_stretch=1e9))
    free = replace(free, is_donor=np.ones(len(free.segments), bool))
    assert all(own.filtered == own.unfiltered for own in enrichment(free).counts)


def test_numbers_of_any_size_are_exact(library):
    one = replace(library, labels=dict.fromkeys(library.labels, np.zeros(len(library.segments))))
    one = replace(one, labels={g: v.astype(np.int64) for g, v in one.labels.items()})
    n = len(library.segments)
    assert enrichment(one, [60]).counts[0].unfiltered == n**60
    assert str(n**60) == enrichment(one, [60]).as_dict()["counts"][0]["unfiltered"]
    assert all(math.isfinite(law.margin) for law in moment_laws(n, {2: n**600, 3: 1}))


def test_larger_scales_make_fewer_clusters_and_more_combinations(library):
    for reading in ("rms", "literal"):
        rows = sweep(library, [reading])
        clusters = [row.clusters for row in rows]
        assert clusters == sorted(clusters, reverse=True)
        # Of one tree the coarser cut holds every cluster of the finer one.
        unfiltered = [row.counts[-1].unfiltered for row in rows]
        assert unfiltered == sorted(unfiltered)
    rows = {(row.sigma, row.sigma_scale): row for row in sweep(library)}
    config: Config = library.config
    here = rows[config.sigma, config.sigma_scale]
    assert here.counts == enrichment(library).counts


def test_every_number_of_groups_is_clustered_on_the_same_base(library):
    found = cluster_numbers(library)
    assert sorted(found) == [2, 3, 4, 5]
    assert len({own["lower"] for own in found.values()}) == 1
    assert found[2]["lower"] == enrichment(library).clusters


@pytest.mark.parametrize("wrong", [{2: 0}, {3: -1}])
def test_counts_below_one_are_refused(wrong):
    with pytest.raises(ValueError, match="1 or more"):
        moment_laws(3, wrong)


def test_one_group_is_no_choice(library):
    with pytest.raises(ValueError, match="from 2"):
        enrichment(library, [1])
