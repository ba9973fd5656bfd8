"""Splits: every clip is in its part, and no motion of another part is used."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.datasets import copies, splits
from mograft.datasets.copies import find_shared_clips
from mograft.datasets.splits import assign_parts, select_part
from mograft.library.discover import SourceFile
from mograft.motion import rotations
from tests.strategies import few_examples, transform_motion


def copy_of(motion, kind, start):
    """A copy that other parts must not use."""
    made = {
        "same": motion,
        "mirrored": mg.mirror(motion),
        "piece": motion[start : start + 90],
        "turned": transform_motion(motion, yaw=1.0),
        "resampled": motion.resample(50.0),
    }[kind]
    return replace(made, name="copy", path=None)


KINDS = ("same", "mirrored", "piece", "turned", "resampled")


def has_passage(first, second, joints):
    """Whether five frames of two motions have all joints within 2 degrees, by comparing all."""
    one, two = first.rotations[:, joints], second.rotations[:, joints]
    cosines = np.abs(np.einsum("aji,bji->abj", one, two)).min(axis=2)
    near = cosines >= np.cos(np.radians(1.0))
    runs = near[:-4, :-4]
    for step in range(1, 5):
        runs = runs & near[step : len(near) - 4 + step, step : near.shape[1] - 4 + step]
    return bool(runs.any())


@pytest.mark.filterwarnings("ignore:.*resampled.*")
@pytest.mark.parametrize(
    "kinds", [*((kind,) for kind in KINDS), ("mirrored", "piece"), ("resampled", "turned")]
)
@pytest.mark.parametrize("source", [0, 3])
def test_copies_are_found_and_other_clips_are_not(takes, source, kinds):
    motion = takes[source]
    for kind in kinds:
        motion = copy_of(motion, kind, 57)
    library = mg.Library.build([*takes, motion], rate=takes[0].rate)
    ours = np.arange(7) < 6
    found = find_shared_clips(library, ours, ~ours).tolist()
    assert source in found
    joints = np.delete(np.arange(library.skeleton.n_joints), library.root)
    for clip in found:
        images = library.clips[6], mg.mirror(library.clips[6])
        assert any(has_passage(library.clips[clip], image, joints) for image in images)
    # The copy is found by its source, too.
    assert find_shared_clips(library, ~ours, ours).tolist() == [6]


@pytest.mark.filterwarnings("ignore:.*excluded as donors.*")
def test_held_poses_are_not_in_common(takes):
    def after_held_pose(take):
        held, more = takes[0], {"channel_values": None, "computed_values": None}
        for name in ("rotations", "positions"):
            more[name] = np.concatenate([getattr(held, name)[:1]] * 60 + [getattr(take, name)])
        return replace(take, **more)

    library = mg.Library.build([after_held_pose(takes[0]), after_held_pose(takes[3])])
    ours = np.array([True, False])
    assert not len(find_shared_clips(library, ours, ~ours))
    assert not len(find_shared_clips(library, ~ours, ours))


@few_examples(20)
@given(seed=st.integers(0, 1000), key=st.sampled_from(["auto:clip", "auto:file", "auto:tag:p*"]))
def test_automatic_parts_divide_no_unit(stored, seed, key):
    parts = assign_parts(stored, key, seed)
    assert set(parts) == {"train", "val", "test"}
    assert parts == assign_parts(stored, key, seed)
    if "tag" in key:
        for tag in ("p0", "p1", "p2"):
            clips = [i for i, entry in enumerate(stored.entries) if tag in entry.tags]
            assert len({parts[clip] for clip in clips}) == 1


def test_copies_of_a_clip_that_is_fast_throughout_are_found(takes, monkeypatch):
    """Also in a library of which only the slower segments are compared."""
    monkeypatch.setattr(copies, "_FEWEST_SEGMENTS", 1)
    turns = np.zeros((takes[0].n_frames, 1, 3))
    turns[:, 0, 0] = 0.3 * np.arange(len(turns))
    quats = rotations.multiply(rotations.exp(turns), takes[0].rotations)
    fast = replace(takes[0], rotations=quats, channel_values=None, name="fast")
    library = mg.Library.build([*takes, fast, replace(fast, name="copy")])
    is_copy = np.array([name == "copy" for name in library.names])
    assert library.names.index("fast") in find_shared_clips(library, ~is_copy, is_copy)
    assert library.names.index("copy") in find_shared_clips(library, is_copy, ~is_copy)


def tagged(takes, tags, files=None):
    """A library whose clips have other tags, and files of the given contents."""
    library = mg.Library.build(takes)
    entries = [own._replace(tags=tag) for own, tag in zip(library.entries, tags, strict=True)]
    if files is not None:
        known = [SourceFile(f"{own}.bvh", 1, 1, own, "BVH") for own in files]
        entries = [own._replace(source_file=f) for own, f in zip(entries, known, strict=True)]
    return replace(library, entries=tuple(entries))


def test_descriptions_are_no_tags(takes):
    library = tagged(takes, [(f"text:take {n}",) for n in range(len(takes))])
    with pytest.raises(ValueError, match="`split` needs tags"):
        assign_parts(library, "auto:tag")
    words = ["walk", "jump"] * 3
    library = tagged(takes, [(f"p{n}", f"text:{word}") for n, word in enumerate(words)])
    assert len(set(splits._units(library, "tag", "").tolist())) == len(takes)


def test_automatic_parts_of_files_divide_no_file(takes):
    library = tagged(takes, [()] * len(takes), ["a", "a", "b", "b", "c", "c"])
    for seed in range(20):
        parts = assign_parts(library, "auto:file", seed)
        assert parts[::2] == parts[1::2]
        assert set(parts) == {"train", "val", "test"}


def test_table_selects_by_name_glob_and_tag(stored, tmp_path):
    table = tmp_path / "parts.csv"
    table.write_text("clip,part\ntag:p0,test\np1_*,val\np2_700,train\n")
    parts = dict(zip(stored.names, assign_parts(stored, table), strict=True))
    assert parts["p0_100"] == parts["p0_700"] == "test"
    assert parts["p1_700"] == "val"
    assert (parts["p2_700"], parts["p2_100"]) == ("train", "")
    chosen = select_part(stored, table, "train", 0)
    assert (chosen.n_others, chosen.shared, chosen.clips.sum()) == (4, (), 1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("p0_100,a\nnone,b\n", "no clip of the library matches 'none'"),
        ("p0_100\n", ":1: expected a clip and its part"),
        ("p0_100,a\np0_*,b\n", "p0_100 is in a and in b"),
        ("p0_100,a\np0_100,b\n", ":2: p0_100 is in a and in b"),
        (f"{'x' * 200_000},a\n", ":1: expected CSV"),
        ("p0_100,a\n", "`part` must be one of a; got 'train'"),
    ],
)
def test_wrong_table_is_refused(stored, tmp_path, text, message):
    (tmp_path / "parts.csv").write_text(text)
    with pytest.raises(ValueError, match=message.replace("*", r"\*")):
        select_part(stored, tmp_path / "parts.csv", "train", 0)
