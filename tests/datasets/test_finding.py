"""Spans that move like a query are found exactly; words find their clips."""

import itertools
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import datasets
from mograft.datasets.finding import _Query, _sample
from mograft.motion.resample import resample_segments
from tests.strategies import assert_same_rotations, few_examples, transform_motion


@pytest.fixture(scope="module")
def with_copies(takes):
    """The takes, and a piece of the fourth that is turned, shifted and slower."""
    piece = transform_motion(takes[3][30:150], yaw=2.0)
    slow = replace(piece.resample(27.0), frame_time=takes[0].frame_time, name="slow", path=None)
    return mg.Library.build([*takes, replace(piece, name="piece", path=None), slow])


@few_examples(30)
@given(
    clip=st.integers(0, 5),
    first=st.integers(0, 20),
    n=st.integers(1, 6),
    count=st.integers(1, 12),
    groups=st.sampled_from([("lower",), ("upper",), ("lower", "upper")]),
    seed=st.integers(0, 100),
)
def test_nearest_runs_match_exhaustive_search(stored, clip, first, n, count, groups, seed):
    cut = stored.segments
    own = cut.of_clip(clip)[first : first + n]
    is_wanted = np.random.default_rng(seed).random(len(cut)) < 0.97
    query = _Query(stored, own, groups, np.zeros(0, int), is_wanted, count)
    found, distances = query.nearest_runs(np.arange(len(cut))).T
    spaces = [stored.embedding[group].points / stored.sigma[group] for group in groups]
    points, totals = np.concatenate(spaces, axis=1), {}
    for run in range(len(cut) - len(own) + 1):
        members = np.arange(run, run + len(own))
        if len(set(cut.clip[members].tolist())) == 1 and is_wanted[members].all():
            totals[run] = ((points[members] - points[own]) ** 2).sum()
    expected = []
    for run in sorted(totals, key=totals.get):
        if all(abs(run - other) >= len(own) for other in expected):
            expected.append(run)
    expected = expected[:count]
    wanted = np.sqrt(np.array([totals[run] for run in expected]) / max(len(own), 1))
    assert np.allclose(distances, wanted, atol=1e-7)
    assert len(found) == len(expected)


@few_examples(12)
@given(clip=st.integers(-1, 5), first=st.integers(0, 80), top=st.integers(1, 9))
def test_executor_does_not_change_the_hits(stored, takes, clip, first, top):
    """The angles decide among as many of the nearest spans as without workers."""
    query = transform_motion(takes[1][20:140], yaw=0.5) if clip < 0 else stored.names[clip]
    given = {"frames": (first, first + 15), "top": top}
    with ThreadPoolExecutor(2) as pool:
        found = datasets.find(stored, query, **given, executor=pool)
        with pytest.raises(ValueError, match="`executor` needs"):
            datasets.find(replace(stored), query, executor=pool)
    assert found == datasets.find(stored, query, **given)


@few_examples(20)
@given(seed=st.integers(0, 100), count=st.integers(2, 80), n=st.integers(1, 4))
def test_samples_of_several_spans_are_those_of_each(takes, seed, count, n):
    rng, joints = np.random.default_rng(seed), np.array([1, 4, 5])
    clips = [takes[index] for index in rng.integers(0, len(takes), n)]
    spans = [tuple(np.sort(rng.choice(240, 2, replace=False)).tolist()) for _ in clips]
    found = _sample(clips, spans, count, joints)
    for own, clip, (start, stop) in zip(found, clips, spans, strict=True):
        quats = clip.rotations[:, joints]
        expected = resample_segments(quats, [start], [stop], [count])
        assert_same_rotations(own, expected)


def test_copies_are_the_first_hits(with_copies):
    source = with_copies.names[3]
    hits = datasets.find(with_copies, source, frames=(60, 120), top=4)
    assert {hit.clip for hit in hits[:2]} == {"piece", "slow"}
    assert hits[0].clip == "piece"
    assert hits[1].angle < np.radians(0.5) < hits[2].angle
    assert abs(hits[0].start + 30 - 60) < 20
    assert [hit.angle for hit in hits] == sorted(hit.angle for hit in hits)


@pytest.mark.parametrize("part", ["lower", "upper", None])
def test_hits_overlap_neither_each_other_nor_the_query(with_copies, part):
    name = with_copies.names[0]
    hits = datasets.find(with_copies, name, frames=(50, 110), part=part, top=30)
    spans = {}
    for hit in hits:
        spans.setdefault(hit.clip, []).append((hit.start, hit.stop))
    assert all(stop <= 60 or start >= 100 for start, stop in spans.get(name, []))
    for own in spans.values():
        ordered = sorted(own)
        assert all(one[1] <= two[0] for one, two in itertools.pairwise(ordered))


def test_motion_outside_the_library_finds_its_copy(with_copies, takes):
    query = transform_motion(takes[3][40:140], yaw=-1.0)
    hits = datasets.find(with_copies, replace(query, name="query"), frames=(20, 70), top=3)
    assert {hits[0].clip, hits[1].clip} == {takes[3].name, "piece"}
    assert hits[1].angle < np.radians(1.0)


def test_words_find_names_tags_and_descriptions(takes):
    tags = {
        "p0_100": ["calm"],
        "p1_100": ["text:a person waves to a friend"],
        "p1_700": ["text:wave"],
    }
    library = mg.Library.build(takes, tags=tags)
    find = datasets.find
    assert [hit.clip for hit in find(library, text="calm")] == ["p0_100"]
    assert {hit.clip for hit in find(library, text="p2")} == {"p2_100", "p2_700"}
    assert [hit.clip for hit in find(library, text="wave*")] == ["p1_700", "p1_100"]
    assert find(library, text="jump") == []
    hits = find(library, "p0_100", frames=(30, 60), text="wave*", top=5)
    assert hits
    assert {hit.clip for hit in hits} <= {"p1_100", "p1_700"}


def test_command_prints_the_hits_and_writes_a_page(stored, clip_folder, tmp_path, succeed):
    page = tmp_path / "new" / "hits.html"
    words = f"find p0_100 {stored.folder} --frames 1s-3s --top 5 -o {page}".split()
    lines = succeed(*words)[0].splitlines()
    hits = datasets.find(stored, "p0_100", frames=(30, 90), top=5)
    assert [line.split(" (")[0] for line in lines[:-1]] == [
        f"{h.clip} {h.start}-{h.stop}" for h in hits
    ]
    assert lines[-1] == str(page)
    assert "p0_100 30-90" in page.read_text()
    file = str(next(clip_folder.glob("p0/p0_100.bvh")))
    words_of_file = f"find {file} {stored.folder} --frames 30-90 --top 5 --json".split()
    found = json.loads(succeed(*words_of_file)[0])["hits"]
    assert [hit["clip"] for hit in found] == [hit.clip for hit in hits]
    assert succeed(*words[:-2], "-j", 2)[0].splitlines() == lines[:-1]
    printed, _ = succeed("find", stored.folder, "--text", "p2")
    assert printed.splitlines() == ["p2_100: 240 frames", "p2_700: 240 frames"]
