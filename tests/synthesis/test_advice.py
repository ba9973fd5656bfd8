"""Remarks about grafts: what was not exchanged, why, and which option helps."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config, Library, advise, graft, graft_many, graft_record
from mograft.constraints import KeepOriginal, NotFrom
from mograft.dancer import dance
from mograft.search.constraints import overlaps
from mograft.solve.self_repair import RepairedWindow
from tests.strategies import few_examples


@pytest.fixture(scope="module")
def library():
    return Library.build(dance(seed=1, strides=1).motion[:600])


def advice(grafts):
    return advise(grafts[-1], [own.substitutions for own in grafts])


def test_advice_kept_seconds_are_those_of_frames_that_never_differ(library):
    grafts = list(graft_many(library, count=3, seed=1))
    exchanged = np.zeros(grafts[0].base.n_frames - 1, bool)
    for own in (s for new in grafts for s in new.substitutions if not s.is_own):
        exchanged[np.arange(own.start, own.stop)] = True
    seconds = (~exchanged).sum() / library.rate
    assert 0 < seconds < grafts[0].base.duration
    total = grafts[0].base.duration
    expected = f"in {seconds:.1f} of {total:.1f} s no segment was exchanged in any of the 3 motions"
    assert expected in advice(grafts)


def test_advice_counts_segments_without_candidate_by_cause(library):
    new = graft(library, seed=1)
    counts = new.alternatives["upper"]
    (line,) = [line for line in advice([new]) if line.startswith("upper: ")]
    n_without, n = map(int, re.match(r"upper: (\d+) of (\d+) segments", line).groups())
    assert (n_without, n) == ((counts == 0).sum(), len(counts))
    causes = re.search(r"\((.*?)\):", line).group(1)
    assert sum(int(number) for number in re.findall(r"\d+", causes)) == n_without
    assert "raise `variety`" in line
    assert "raise `max_stretch` (now 0.15)" in line


@pytest.mark.parametrize(
    ("config", "constraints", "cause", "remedy"),
    [
        ({"sigma_scale": 1e-9}, [], "no similar segment", "raise `variety` or add clips"),
        ({"max_stretch": 1e-6, "sigma_scale": 2.0, "length_slack": 0.0}, [], "similar len", "max_"),
        ({"sigma_scale": 2.0}, [NotFrom("*")], "within the constraints", "relax the constraints"),
    ],
)  # fmt: skip
def test_advice_names_cause_and_remedy(library, config, constraints, cause, remedy):
    own = Library.build(library.clips[0], config=Config(**config))
    lines = advice([graft(own, constraints=constraints)])
    assert cause in lines[-1]
    assert remedy in lines[-1]


@few_examples(10)
@given(st.integers(0, 599), st.integers(0, 599))
def test_advice_counts_no_kept_segment_as_without_candidate(library, first, last):
    span = min(first, last), max(first, last)
    free, kept = graft(library), graft(library, constraints=[KeepOriginal(frames=span)])
    segments = library.segments
    is_kept = overlaps(segments, span)
    expected = int(((free.alternatives["upper"] == 0) & ~is_kept).sum())
    (line,) = [line for line in advise(kept) if line.startswith("upper: ")] or ["upper: 0 of"]
    assert int(line.split()[1]) == expected
    assert graft_record(kept)["kept_without_candidate"] == {"upper": expected}
    assert (f"{expected} had no candidate" in kept.report()) == (expected > 0)


def test_advice_names_self_repair_if_it_restored_all_segments(library):
    kept = graft(library, seed=1)
    own = tuple(s._replace(donor=s.segment) for s in kept.substitutions)
    span = {"group": "upper", "start": 0, "stop": 20}
    window = RepairedWindow(**span, measure="world jerk", before=4.0, after=0.0)
    lines = advice([replace(kept, substitutions=own, self_repairs=(window,))])
    (line,) = [line for line in lines if line.startswith("warning")]
    assert "no segment was exchanged: self-repair restored the captured parts" in line
    assert "`self_repair=False` keeps the exchanges" in line
