"""Windows of grafts: no motion of other parts, the features of the grafts, the same everywhere."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft import datasets
from mograft.datasets import augmentation
from mograft.datasets.augmentation import PROVENANCE
from mograft.motion import rotations
from tests.strategies import SEEDS, few_examples


def smallest_angles(frames, poses):
    """For each frame the smallest, over all poses, of the greatest joint angle."""
    return np.array(
        [
            (2 * np.arccos(np.minimum(np.abs((poses * own).sum(axis=2)), 1))).max(axis=1).min()
            for own in frames
        ]
    )


@few_examples(6)
@given(
    seed=st.integers(0, 100),
    kind=st.sampled_from(["same", "mirrored", "piece"]),
    source=st.sampled_from([1, 3, 5]),  # the other two share a segment with each other
)
def test_no_frame_of_other_parts_occurs(takes, seed, kind, source):
    test = takes[0]
    copies = {
        "same": takes[source],
        "mirrored": mg.mirror(takes[source]),
        "piece": takes[source][50:150],
    }
    copy = replace(copies[kind], name="copy", path=None)
    library = mg.Library.build([*takes, copy], rate=test.rate)
    parts = dict.fromkeys(library.names, "train")
    parts |= {test.name: "test", "copy": "test"}
    windows = datasets.augment(library, seconds=2.0, split=parts, seed=seed, min_new=0.0)
    windows = replace(windows, variants=1)
    assert windows.part.shared == (takes[source].name,)
    originals = [test, takes[source]]
    held_out = np.concatenate([own.rotations for own in [*originals, *map(mg.mirror, originals)]])
    joints = np.delete(np.arange(library.skeleton.n_joints), library.root)
    used = set()
    for job in range(len(windows.bases)):
        for window in windows.run_job(job)[0]:
            frames = window.features["rotations"].astype(float)[::10, joints]
            assert smallest_angles(frames, held_out[:, joints]).min() > np.radians(0.5)
            used |= {row[PROVENANCE.index("clip") - 1] for row in window.provenance}
    assert not used & {"copy", test.name, takes[source].name}


def test_frames_of_a_leak_would_be_found(takes):
    test = takes[0].rotations[:, 1:]
    assert smallest_angles(test[:3], test).max() < 1e-6


def places_of(windows):
    """The base and the first frame of each window."""
    pairs = zip(windows.bases.tolist(), windows.starts, strict=True)
    return [(base, start) for base, own in pairs for start in own.tolist()]


@few_examples(8)
@given(
    seconds=st.sampled_from([0.5, 1.0, 2.0]),
    stride=st.integers(1, 40),
    epoch=st.integers(0, 1),
    size=st.sampled_from([0, 200_000, 1 << 27]),
    seed=SEEDS,
)
def test_windows_depend_on_base_and_start_alone(stored, seconds, stride, epoch, size, seed):
    names = ["rotations", "root", "contacts"]
    whole, other = (
        datasets.augment(stored, seconds=seconds, stride=own, features=names).with_epoch(epoch)
        for own in (None, stride / stored.rate)
    )
    assert all(np.diff(own).min(initial=stride) == stride for own in other.starts)
    rows = {place: k for k, place in enumerate(places_of(other))}
    both = [(k, rows[place]) for k, place in enumerate(places_of(whole)) if place in rows]
    assert len(both) >= len(whole.bases)
    other._draws.limit = size
    for row in np.random.default_rng(seed).integers(0, len(both), 4).tolist():
        one, two = both[row]
        found, expected = other[two], whole[one]
        assert found.pop("index") == two
        assert expected.pop("index") == one
        assert all(np.array_equal(found[name], own) for name, own in expected.items())
        found["rotations"][:] = 0.0  # rows are the caller's
    kept = [own for _, own in other._draws._items.values()]
    assert sum(kept) <= size or len(kept) == 1


@pytest.mark.parametrize("has_few", [False, True])
def test_grafts_are_made_once_in_any_order(stored, takes, monkeypatch, has_few):
    built, build = [], augmentation.build_graft

    def count(*arguments):
        built.append((arguments[0].problem.base.name, arguments[3]))
        return build(*arguments)

    monkeypatch.setattr(augmentation, "build_graft", count)
    library, min_new = stored, 0.5
    if has_few:
        config, min_new = mg.Config(max_stretch=0.02, length_slack=0.0), 1.0
        library = mg.Library.build(takes[0][:130], config=config)
    windows = datasets.augment(library, seconds=1.0, stride=0.5, min_new=min_new)
    joints, n = library.joints("upper"), windows.n_frames
    places = places_of(windows)
    for index in np.random.default_rng(0).permutation(len(windows)):
        base, start = places[index]
        quats = library.clips[base].rotations[start : start + n, joints]
        cosines = np.abs((windows[index]["rotations"][:, joints] * quats).sum(axis=2))
        is_new = (2 * np.arccos(np.minimum(cosines, 1.0)) > np.radians(5.0)).any(axis=1)
        assert float(windows[index]["new"]) == pytest.approx(is_new.mean(), abs=0.5 / n)
    assert len(built) == len(set(built))
    assert {name for name, _ in built} == set(library.names)


def test_windows_are_parts_of_grafts(stored):
    windows = datasets.augment(stored, seconds=2.0, features=list(datasets.FEATURES)[:-1])
    windows = replace(windows, variants=2)
    n_parts = 0
    for job in range(3):
        for window in windows.run_job(job)[0]:
            rows = [dict(zip(PROVENANCE[1:], row, strict=True)) for row in window.provenance]
            base = stored.clips[stored.names.index(rows[0]["base"])]
            start = rows[0]["base_start"]
            assert (
                rows[0]["base_stop"] - start + 1 == windows.n_frames == len(window.features["root"])
            )
            frames = slice(start, start + windows.n_frames)
            kept = stored.joints("lower")
            quats = window.features["rotations"]
            assert np.array_equal(quats[:, kept], base.rotations[frames, kept].astype(np.float32))
            assert rows[0]["new"] >= windows.min_new
            for row in rows:
                n_parts += 1
                assert stored.names.index(row["clip"]) >= 0
                is_own = (row["clip"], row["clip_start"]) == (row["base"], row["start"])
                assert row["is_captured"] == is_own
    assert n_parts > 20


def test_features_describe_the_same_motion(stored):
    names = ["rotations", "rotations_6d", "matrices", "root", "positions", "contacts"]
    row = datasets.augment(stored, seconds=2.0, features=names)[1]
    assert set(row) == {*names, "new", "index"}
    quats = row["rotations"].astype(float)
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    back = rotations.from_matrices(row["matrices"].astype(float))
    assert np.abs((back * quats).sum(axis=-1)) == pytest.approx(1.0, abs=1e-5)
    columns = row["rotations_6d"].reshape(*quats.shape[:2], 2, 3)
    assert np.array_equal(columns, np.swapaxes(row["matrices"][..., :2], 2, 3))
    assert np.array_equal(row["positions"][:, stored.root], row["root"])
    assert row["contacts"].dtype == np.bool_
    assert row["contacts"].shape == (60, 4)


def get(windows, index):
    return windows[index]["rotations"]


def test_items_are_the_same_in_threads_and_processes(stored):
    windows = datasets.augment(stored, seconds=2.0, split="auto:clip", seed=3)
    order = [3, 0, len(windows) - 1, 3]
    expected = [get(windows, index) for index in order]
    copy = pickle.loads(pickle.dumps(windows))
    with ThreadPoolExecutor(3) as pool:
        assert all(map(np.array_equal, expected, pool.map(lambda i: get(copy, i), order)))
    for method in ("fork", "spawn"):
        with get_context(method).Pool(2) as pool:
            found = pool.starmap(get, [(windows, index) for index in order])
        assert all(map(np.array_equal, expected, found))


def test_epochs_differ_and_repeat(stored):
    windows = datasets.augment(stored, seconds=2.0)
    other = windows.with_epoch(1)
    assert not np.array_equal(get(windows, 2), get(other, 2))
    assert np.array_equal(get(windows.with_epoch(0), 2), get(windows, 2))
    assert len(list(windows[:2])) == 2


def test_windows_exclude_faults(takes):
    quats = takes[1].rotations.copy()
    quats[120, 3:9] = rotations.multiply(quats[120, 3:9], rotations.exp(np.array([2.5, 0.0, 0.0])))
    faulty = replace(takes[1], rotations=quats, channel_values=None)
    with pytest.warns(UserWarning, match="excluded as donors"):
        library = mg.Library.build([takes[0], faulty])
    windows = datasets.augment(library, seconds=1.0)
    own = windows.starts[windows.bases.tolist().index(1)]
    assert len(own)
    assert not ((own <= 120) & (own + windows.n_frames > 120)).any()


def test_refused_duration_names_the_longest_one_that_is_accepted(stored):
    with pytest.raises(ValueError, match="longest span") as caught:
        datasets.augment(stored, seconds=60.0)
    longest = float(str(caught.value).split("at most ")[1].split(",")[0])
    assert len(datasets.augment(stored, seconds=longest).bases)
    with pytest.raises(ValueError, match="longest span"):
        datasets.augment(stored, seconds=longest + 1 / stored.rate)
