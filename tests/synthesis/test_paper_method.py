"""`Config.paper()` against a second implementation, which was written from its description."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import mograft as mg
from mograft.dancer import dance
from tests.hierarchies import DATA
from tests.oracles import paper_method as oracle

pytestmark = pytest.mark.filterwarnings("ignore:paper_shape_.* excluded as donors")

SOURCES = [(name, rate) for name in ("dancer", "A", "B") for rate in (30.0, 120.0)]


def motion_of(name, rate):
    if name == "dancer":
        return dance(seed=1, rate=rate, strides=1).motion
    path = DATA / "paper_shape_57dof" / f"paper_shape_{name}.bvh"
    if not path.exists():
        pytest.skip(f"{path.name} is not at hand below {DATA}")
    motion = mg.read_bvh(path)
    return motion if round(motion.rate) == rate else motion.resample(rate)


def clip_of(motion):
    skeleton = motion.skeleton
    tips = np.zeros_like(skeleton.offsets)
    for site in skeleton.end_sites:
        tips[site.parent] = site.offset
    return oracle.Clip(
        names=list(skeleton.names),
        parents=list(skeleton.parents),
        offsets=skeleton.offsets,
        tips=tips,
        rotations=motion.rotations,
        positions=motion.positions[:, 0],
        rate=motion.rate,
    )


@pytest.fixture(scope="module", params=SOURCES, ids=lambda source: f"{source[0]}-{source[1]:g}")
def both(request):
    """Return a library of the paper's configuration, and the clip of the oracle."""
    motion = motion_of(*request.param)
    return mg.Library.build(motion, config=mg.Config.paper()), clip_of(motion)


def spans(library):
    stretches = zip(library.segments.start.tolist(), library.segments.stop.tolist(), strict=True)
    return [(0, start, stop) for start, stop in stretches]


def test_paper_segments_equal_oracle(both):
    library, clip = both
    bounds = oracle.boundaries(clip)
    assert_array_equal([*library.segments.start, library.segments.stop[-1]], bounds)


def test_paper_clusters_equal_oracle(both):
    library, clip = both
    groups = oracle.groups(clip)
    resolved = library.groups.resolve(library.skeleton)
    assert {name: own.tolist() for name, own in resolved.items()} == groups
    for name, joints in groups.items():
        points = oracle.scores(oracle.features([clip], spans(library), joints))
        assert_allclose(library.sigma[name], oracle.threshold(points), rtol=1e-6)
        clusters, labels = oracle.clusters(points), library.labels[name]
        assert_array_equal(labels == labels[:, None], clusters == clusters[:, None])
        assert 1 < len(set(clusters)) < len(clusters)


def test_paper_candidates_equal_oracle_but_for_faults_and_copies(both):
    library, clip = both
    segments, joints = spans(library), oracle.groups(clip)["upper"]
    expected = oracle.candidates(library.labels["lower"], library.segments.lengths)
    last = len(segments) - 1
    for i in range(len(segments)):
        listed = mg.candidates(library, i, "upper")
        within = {own.segment for own in listed.allowed}
        assert expected[i] <= within | {own.segment for own in listed.refused}
        for own in (*listed.allowed, *listed.refused):
            donor, gaps = segments[own.segment], np.degrees([own.gap_before, own.gap_after])
            if i > 0 and own.segment != i:
                gap = oracle.gap([clip], segments[i - 1], donor, joints)
                assert_allclose(gaps[0], gap, atol=1e-4)
            if i < last and own.segment != i:
                gap = oracle.gap([clip], donor, segments[i + 1], joints)
                assert_allclose(gaps[1], gap, atol=1e-4)
            is_excluded = not library.is_donor[own.segment] or "copy" in own.refused
            is_candidate = own.segment in expected[i] and max(gaps) <= 45
            assert own.segment == i or is_excluded or (own.segment in within) == is_candidate


def test_paper_donors_are_candidates_of_oracle_within_its_transition_limit(both):
    library, clip = both
    segments, joints = spans(library), oracle.groups(clip)["upper"]
    expected = oracle.candidates(library.labels["lower"], library.segments.lengths)
    graft = mg.graft(library, seed=3)
    donors = [own.donor for own in graft.substitutions]
    assert len(donors) == len(segments)
    assert donors != list(range(len(segments)))
    assert all(donor in expected[i] for i, donor in enumerate(donors))
    for i, (donor, following) in enumerate(pairwise(donors)):
        is_recorded = donor == i and following == i + 1
        gap = oracle.gap([clip], segments[donor], segments[following], joints)
        assert gap <= 45 or is_recorded
