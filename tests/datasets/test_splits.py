"""Splits: every clip is in its part, and no motion of another part is used."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft.datasets import copies
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


@pytest.mark.parametrize("n_clips", [0, 1])
def test_clips_without_movement_have_nothing_in_common(takes, n_clips):
    """No segment is compared: none of them moves, or there is none."""
    rest = {
        name: getattr(takes[1], name)[:1].repeat(90, axis=0) for name in ("rotations", "positions")
    }
    held = replace(takes[1], **rest, channel_values=None, name="held")
    library = mg.Library.build([held, takes[0], takes[3]])
    ours = np.arange(3) < n_clips
    assert not len(find_shared_clips(library, ours, ~ours))
    assert not len(find_shared_clips(library, ~ours, ours))


UNITS = {
    "auto:clip": range(6),
    "auto:file": [0, 0, 1, 1, 2, 2],
    "auto:tag": [0, 1, 2, 0, 1, 2],
    "auto:tag:p[01]": [0, 1, 2, 0, 1, 3],
}
"""The clips that stay together, by the kind of an automatic split."""


@pytest.fixture(scope="module")
def tagged(takes):
    """A library whose clips have files, tags and a description as in `UNITS`."""
    library, entries = mg.Library.build(takes), []
    units = zip(UNITS["auto:file"], UNITS["auto:tag"], strict=True)
    for entry, (name, tag) in zip(library.entries, units, strict=True):
        file = SourceFile(f"{name}.bvh", 1, 1, str(name), "BVH")
        entries.append(entry._replace(source_file=file, tags=(f"p{tag}", "text:a walk")))
    return replace(library, entries=tuple(entries))


@few_examples(20)
@given(seed=st.integers(0, 1000), key=st.sampled_from(list(UNITS)))
def test_automatic_parts_divide_no_unit(tagged, seed, key):
    parts = assign_parts(tagged, key, seed)
    assert set(parts) == {"train", "val", "test"}
    assert parts == assign_parts(tagged, key, seed)
    assert len({*zip(UNITS[key], parts, strict=True)}) == len(set(UNITS[key]))


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


def test_descriptions_are_no_tags(tagged):
    entries = (own._replace(tags=("text:a walk",)) for own in tagged.entries)
    with pytest.raises(ValueError, match="`split` needs tags"):
        assign_parts(replace(tagged, entries=tuple(entries)), "auto:tag")


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
