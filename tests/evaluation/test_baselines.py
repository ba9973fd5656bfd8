"""Ways to choose donors: each by its rule written plainly, all alike in the rest."""

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest

from mograft import (
    Config,
    InsufficientDataError,
    JointGroups,
    Library,
    Motion,
    Skeleton,
    graft_many,
)
from mograft.body.contacts import detect_contacts
from mograft.dancer import dance
from mograft.evaluation.baselines import (
    Analogy,
    ByCost,
    Captured,
    ContactPattern,
    Method,
    Nearest,
    Random,
    RandomLength,
    contact_patterns,
    contact_words,
    donors_by,
    grafts_by,
    methods,
)
from mograft.motion import rotations
from mograft.search.costs import length_fits
from tests.strategies import wander

WAYS = (
    Random(),
    RandomLength(),
    ContactPattern(),
    ContactPattern(exact=True),
    Nearest(),
    Analogy(),
    ByCost(),
)


@pytest.fixture(scope="module")
def library():
    whole = dance(seed=5, strides=1)
    built = Library.build([take.motion for take in whole.takes(2)])
    good = built.is_donor.copy()
    good[::17] = False  # as if faults had been found
    return replace(built, is_donor=good)


@pytest.mark.parametrize("way", WAYS, ids=repr)
def test_each_may_keep_its_own_part_and_takes_none_with_faults(library, way):
    scenario = np.arange(len(library.segments))[::-3]
    lists = way.candidates(library, scenario)
    assert len(lists) == len(scenario)
    for own, mates in zip(scenario.tolist(), lists, strict=True):
        assert own in mates
        assert (np.diff(mates) > 0).all()
        assert library.is_donor[mates[mates != own]].all()


def fitting(library, own):
    lengths = library.segments.lengths
    fits = length_fits(lengths[[own]], lengths, library.rate, library.config) & library.is_donor
    fits[own] = True
    return fits


def test_rules_are_those_of_the_plain_versions(library):
    n = len(library.segments)
    everyone = np.arange(n)
    states = contact_patterns(library)
    words = np.array(contact_words(library))
    points = library.embedding["lower"].points
    labels = library.labels["lower"]
    found = {
        type(w).__name__ + str(getattr(w, "exact", "")): w.candidates(library, everyone)
        for w in WAYS
    }
    for own in range(0, n, 7):
        fits = fitting(library, own)
        any_donor = library.is_donor.copy()
        any_donor[own] = True
        hamming = [int((states[k] != states[own]).sum()) <= 2 for k in range(n)]
        want = {
            "Random": any_donor,
            "RandomLength": fits,
            "ContactPatternFalse": fits & hamming,
            "ContactPatternTrue": fits & (words == words[own]),
            "Analogy": fits & (labels == labels[own]),
            "ByCost": fits & (labels == labels[own]),
        }
        for name, passes in want.items():
            passes = np.asarray(passes)
            passes[own] = True
            np.testing.assert_array_equal(found[name][own], np.flatnonzero(passes), err_msg=name)
        nearest = found["Nearest"][own]
        others = np.flatnonzero(fits & (everyone != own))
        apart = np.linalg.norm(points - points[own], axis=1)
        assert len(nearest) == 1 + min(6, len(others))
        left_out = np.setdiff1d(others, nearest)
        taken = nearest[nearest != own]
        if len(left_out) and len(taken):
            assert apart[taken].max() <= apart[left_out].min()


def test_contacts_are_those_of_the_feet_at_ten_times(library):
    states, words = contact_patterns(library), contact_words(library)
    cut = library.segments
    touching = [detect_contacts(clip).any(axis=2) for clip in library.clips]
    for own in range(0, len(cut), 5):
        rows = touching[cut.clip[own]][cut.start[own] : cut.stop[own] + 1]
        np.testing.assert_array_equal(states[own][0], rows[0])
        np.testing.assert_array_equal(states[own][-1], rows[-1])
        codes = ["".join(map(str, row.astype(int))) for row in rows]
        runs = [(code, len(list(run))) for code, run in groupby(codes)]
        lasting = [code for code, length in runs if length > 1]
        if lasting:
            assert words[own] == ">".join(code for code, _ in groupby(lasting))


@pytest.mark.parametrize("way", WAYS[:-1], ids=repr)
def test_draws_keep_to_the_rule_and_are_the_same_again(library, way):
    scenario, draws = donors_by(way, library, library.clips[1].name, 3, seed=9)
    allowed = way.candidates(library, scenario)
    again = grafts_by(way, library, library.clips[1].name, 3, seed=9)
    for chosen, graft in zip(draws, again, strict=True):
        for mates, donor in zip(allowed, chosen["upper"].tolist(), strict=True):
            assert donor in mates
        assert [s.donor for s in graft.substitutions] == chosen["upper"].tolist()


def test_a_draw_is_uniform_and_seams_are_kept_within_the_limit(library):
    way = RandomLength()
    tight = replace(library, config=replace(library.config, max_angle=np.radians(15)))
    scenario, draws = donors_by(way, tight, None, 40, seed=1)
    allowed = way.candidates(tight, scenario)
    pool = tight.pool("upper")
    firsts = np.array([chosen["upper"][0] for chosen in draws])
    assert len(np.unique(firsts)) > min(len(allowed[0]), 40) / 4
    for chosen in draws[:10]:
        donors = chosen["upper"]
        for at, gap in enumerate(pool.seam_angles_along(donors).tolist()):
            if gap > np.radians(15):  # then none would have been nearer
                gaps = pool.seam_angles(donors[at : at + 1], allowed[at + 1])
                assert gap == pytest.approx(gaps.min())


def test_by_cost_is_what_grafting_does(library):
    ours = grafts_by(ByCost(), library, None, 2, seed=3)
    theirs = graft_many(library, None, 2, seed=3)
    for one, two in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(one.motion.rotations, two.motion.rotations)


def test_the_recording_once_more_is_the_recording(library):
    same = grafts_by(Captured(), library, None, 1, seed=0)[0]
    np.testing.assert_array_equal(same.motion.rotations, same.base.rotations)
    np.testing.assert_array_equal(same.motion.positions, same.base.positions)
    with pytest.raises(NotImplementedError):
        Method().candidates(library, np.array([0]))


def test_without_legs_there_are_no_contact_patterns():
    skeleton = Skeleton(["a", "b", "c"], [-1, 0, 1], [[0, 0, 0], [0, 1, 0], [0, 1, 0]])
    quats = wander(np.random.default_rng(0), 90, 3)
    motion = Motion(skeleton, 1 / 30, quats, np.tile(skeleton.offsets, (90, 1, 1)))
    groups = JointGroups({"lower": ["a"], "upper": ["b", "c"]})
    library = Library.build(motion, groups, Config())
    assert ContactPattern() not in methods(library)
    with pytest.raises(InsufficientDataError, match="legs"):
        ContactPattern().candidates(library, np.array([0]))
    still = replace(motion, rotations=np.tile(rotations.IDENTITY, (90, 3, 1)))
    with pytest.warns(UserWarning, match="to compare"):
        frozen = Library.build(still, groups, Config())
    assert Nearest() not in methods(frozen)
    with pytest.raises(InsufficientDataError, match="differ"):
        Nearest().candidates(frozen, np.array([0]))


def test_ways_may_differ_in_how_motions_are_made(library):
    plain, other = (
        grafts_by(ByCost(changes=changes), library, None, 1, seed=2)[0]
        for changes in ((), (("seam", "displacement"),))
    )
    assert [s.donor for s in plain.substitutions] == [s.donor for s in other.substitutions]
    assert (plain.motion.rotations != other.motion.rotations).any()
    assert other.library.config.seam == "displacement"
    with pytest.raises(ValueError, match="samples must be"):
        grafts_by(ByCost(changes=(("samples", 5),)), library)
