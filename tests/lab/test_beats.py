"""Beats of motions whose tempo is known."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from lab.segmentations import beats
from lab.studies.behaviour_pieces import metronome
from mograft.dancer import dance
from tests.strategies import SEEDS, few_examples

DEFAULT = beats.BeatParameters()


@few_examples(25)
@given(SEEDS, st.floats(0.35, 1.3), st.sampled_from([30.0, 60.0, 120.0]))
def test_beats_known_tempo_is_found_within_two_percent(seed, interval, rate):
    motion = metronome(seed, interval, rate)
    assert beats.beat_interval(motion, DEFAULT) == pytest.approx(interval, rel=0.02)
    # The acceleration is zero in the middle between two poses.
    seconds = beats.cut_frames(motion, DEFAULT) / rate
    offsets = (seconds / interval) % 1.0 - 0.5
    assert np.abs(offsets).max() <= 0.2
    assert abs(len(seconds) - 16.0 / interval) <= 2


@pytest.mark.parametrize("seed", range(3))
def test_beats_of_the_dancer_are_its_steps(seed):
    sample = dance(seed, strides=4)
    is_walk = sample.legs == "walk"
    first = int(np.argmax(is_walk))
    stop = first + int(np.argmin(is_walk[first:]))
    stride = np.mean(np.diff(np.flatnonzero(np.diff(sample.phase[first:stop]) < -0.5))) / 30.0
    found = beats.beat_interval(sample.motion[first:stop], DEFAULT)
    assert stride / found == pytest.approx(2.0, rel=0.05)


@few_examples(60)
@given(
    npst.arrays(np.float64, st.integers(8, 13), elements=st.floats(0, 5)),
    st.floats(2.0, 4.0),
    st.floats(0.1, 20.0),
)
def test_fit_beats_equals_search_of_all_sequences(strength, interval, tightness):
    def total(chosen):
        gaps = np.diff(chosen)
        return strength[list(chosen)].sum() - tightness * (np.log(gaps / interval) ** 2).sum()

    shortest, longest = max(round(interval / 2), 1), round(2 * interval)
    n = len(strength)
    best = max(
        total(chosen)
        for count in range(1, n + 1)
        for chosen in itertools.combinations(range(n), count)
        if all(shortest <= gap <= longest for gap in np.diff(chosen))
        and chosen[0] < interval
        and chosen[-1] >= n - int(np.ceil(interval))
    )
    found = beats.fit_beats(strength, interval, tightness)
    assert total(found) == pytest.approx(best, abs=1e-9)
