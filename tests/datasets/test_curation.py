"""Kept clips cover the others within the radius, and copies add nothing."""

import csv
import json
import re
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import datasets
from tests.strategies import few_examples


@pytest.fixture(scope="module")
def with_copies(takes):
    """The takes in two parts each, and copies of three parts."""
    parts = [
        replace(take[start : start + 120], name=f"{take.name}_{start}")
        for take in takes
        for start in (0, 119)
    ]
    copies = [replace(parts[i], name=f"copy{i}") for i in (0, 5, 7)]
    return mg.Library.build([*parts, *copies])


def spread(library, part):
    groups = library.groups.names if part is None else (part,)
    return np.concatenate([library.embedding[g].points / library.sigma[g] for g in groups], axis=1)


@few_examples(30)
@given(
    radius=st.floats(0.05, 5.0),
    part=st.sampled_from([None, "lower", "upper"]),
    shards=st.just(1) | st.integers(2, 20),
)
def test_dropped_segments_are_within_the_radius(with_copies, radius, part, shards):
    library = with_copies
    found = datasets.curate(library, radius=radius, part=part, shards=shards)
    assert found.radius == radius
    points, clips = spread(library, part), library.segments.clip
    is_kept = np.array([own.is_kept for own in found.choices])[clips]
    gaps = np.linalg.norm(points[:, None] - points[is_kept][None], axis=2).min(axis=1)
    assert gaps.max() <= radius * (1 + 1e-9)
    for clip, own in enumerate(found.choices):
        nearest = gaps[clips == clip].max()
        # The nearest segment of the cluster is not nearer than the nearest of all.
        assert nearest <= own.nearest + 1e-9 <= radius + 2e-9
        assert shards == 1 or own.nearest == pytest.approx(nearest, abs=1e-9)
        assert own.clip == library.names[clip]
    assert [share for _, share in found.curve] == sorted(share for _, share in found.curve)
    assert found.curve[-1] == (sum(own.frames for own in found.choices if own.is_kept), 1.0)
    assert len(found.curve) == len(found.kept)


def test_executor_chooses_the_same_clips(stored, takes):
    expected = datasets.curate(stored, keep=0.8, shards=3).choices
    with ThreadPoolExecutor(2) as pool:
        found = datasets.curate(stored, keep=0.8, shards=3, executor=pool)
        assert found.choices == expected
        with pytest.raises(ValueError, match="`executor` needs"):
            datasets.curate(mg.Library.build(takes[0][:120]), executor=pool)


def test_copies_are_dropped(with_copies):
    found = datasets.curate(with_copies, radius=0.3)
    for source, copy in ((0, 12), (5, 13), (7, 14)):
        pair = found.choices[source], found.choices[copy]
        assert sum(own.is_kept for own in pair) == 1
        (dropped,) = (own for own in pair if not own.is_kept)
        assert dropped.reason == "all segments are copies of kept ones"


@few_examples(8)
@given(share=st.floats(0.3, 1.0))
def test_share_is_not_exceeded(with_copies, share):
    found = datasets.curate(with_copies, keep=share)
    assert found.kept_share <= share
    wider = datasets.curate(with_copies, radius=found.radius)
    assert wider.kept == found.kept


def test_too_few_segments_are_an_error(takes):
    with pytest.warns(UserWarning, match="too few"):
        library = mg.Library.build(takes[0][:8])
    with pytest.raises(mg.InsufficientDataError, match="too few segments"):
        datasets.curate(library)


def test_command_prints_the_kept_files_and_writes_a_table(stored, tmp_path, succeed):
    found = datasets.curate(stored, radius=3.0)
    assert 0 < len(found.kept) < len(stored.names)
    table = tmp_path / "kept.csv"
    words = ["curate", stored.folder, "--radius", 3]
    out, err = succeed(*words, "-o", table)
    kept = [own for own in stored.entries if own.name in found.kept]
    assert out.splitlines() == [own.source_file.path for own in kept]
    assert "every other segment is within 3.000" in err
    with table.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["clip"] for row in rows if row["kept"] == "1"] == found.kept
    assert all(row["reason"] for row in rows)
    in_shards = datasets.curate(stored, radius=3.0, shards=2)
    for options, expected in ((), found), (("--shards", 2, "-j", 2), in_shards):
        document = json.loads(succeed(*words, *options, "--json")[0])
        assert [own["clip"] for own in document["clips"] if own["is_kept"]] == expected.kept


@pytest.mark.parametrize("files", ["link", "copy", None])
def test_command_writes_a_folder_with_page_and_files(stored, tmp_path, succeed, files):
    found = datasets.curate(stored, radius=3.0)
    target = tmp_path / "choice"
    words = ["curate", stored.folder, "--radius", 3, "-o", target]
    succeed(*words, *([] if files is None else ["--files", files]))
    assert [own.name for own in tmp_path.iterdir()] == ["choice"]
    with (target / "clips.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["clip"] for row in rows if row["kept"] == "1"] == found.kept
    page = (target / "index.html").read_text()
    assert all(f"kept: {name}" in page for name in found.kept[:5])
    clips = sorted((target / "clips").rglob("*.bvh"))
    paths = [Path(own.source_file.path) for own in stored.entries if own.name in found.kept]
    assert len(clips) == (0 if files is None else len(paths))
    for clip in clips:
        (source,) = (own for own in paths if own.name == clip.name)
        assert clip.is_symlink() == (files == "link")
        assert clip.read_bytes() == source.read_bytes()


def test_page_lists_kept_and_dropped_clips_and_its_curve_fills_the_frame(takes):
    takes = [*(take[:120] for take in takes), takes[0][120:]]
    names = [f"<i>{k}</i>" for k in range(len(takes))]
    takes = [replace(take, name=name) for take, name in zip(takes, names, strict=True)]
    library = mg.Library.build(takes)
    found = datasets.curate(library, radius=2.5)
    page = datasets.curation_page(library, found).html
    assert "<td><i>" not in page
    assert 1 < len(found.kept) < len(names) - 1
    tables = page.split("<h2>Kept clips</h2>")[1].split("<h2>Dropped clips")
    rows = [
        re.findall(r"<td>&lt;i&gt;(\d)&lt;/i&gt;</td><td>\d+</td><td>([\d.]+)<", table)
        for table in tables
    ]
    kept = [f"<i>{name}</i>" for name, _ in rows[0]]
    assert kept == found.kept
    assert sorted([*kept, *(f"<i>{name}</i>" for name, _ in rows[1])]) == names
    distances = [float(value) for _, value in rows[1]]
    assert distances == sorted(distances, reverse=True)
    assert distances[0] > distances[-1]
    points = re.search(r'polyline points="([^"]+)"', page)[1].split()
    places = [tuple(map(float, own.split(","))) for own in points]
    assert len(places) == len(found.curve) + 1
    assert (places[0][0], places[-1]) == (44.0, (436.0, 44.0))
    heights = [height for _, height in places]
    assert heights == sorted(heights, reverse=True)


def test_choice_that_cannot_be_complete_is_not_written(takes, clip_folder, tmp_path):
    library = mg.Library.build(takes[:2])
    found = datasets.curate(library)
    with pytest.raises(ValueError, match="`files` needs clips of files, 2 kept clips are from no"):
        datasets.write_choice(library, found, tmp_path / "set", files="copy")
    shutil.copytree(clip_folder, tmp_path / "clips")
    library = mg.Library.index(tmp_path / "clips", tmp_path / "lib")
    found = datasets.curate(library, radius=0.1)
    Path(library.entries[-1].source_file.path).unlink()
    for files in ("link", "copy"):
        with pytest.raises(FileNotFoundError, match=library.names[-1]):
            datasets.write_choice(library, found, tmp_path / "set", files=files)
    assert sorted(own.name for own in tmp_path.iterdir()) == ["clips", "lib"]
