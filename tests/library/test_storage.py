"""Laws of libraries in folders: what is written is what is read, whatever happens meanwhile."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mograft import (
    BvhError,
    Config,
    JointGroups,
    Library,
    LibraryError,
    Motion,
    NotFrom,
    OnlyFrom,
    Segments,
    Skeleton,
    SkeletonMismatchError,
    graft,
    graft_many,
    write_bvh,
)
from mograft.cli import main
from mograft.cli.files import select_clips
from mograft.dancer import dance
from mograft.library import generation, stored_clips
from mograft.library import storage as store
from mograft.library.discover import read_tags, relative_path
from mograft.library.export import export_tables, library_tables
from mograft.library.packing import pack, unpack
from mograft.library.stored_clips import RowRange
from tests.strategies import motions

WHOLE = dance(seed=5, strides=1).motion


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    """A folder of clips, some of them in folders of their own."""
    folder = tmp_path_factory.mktemp("clips")
    for number, name in enumerate(("walk/b", "walk/a", "jump/a", "c", "d")):
        (folder / name).parent.mkdir(exist_ok=True)
        write_bvh(WHOLE[number * 90 : number * 90 + 160], folder / f"{name}.bvh")
    return folder


@pytest.fixture(scope="module")
def stored(clips, tmp_path_factory):
    return Library.index(clips, tmp_path_factory.mktemp("libraries") / "dance.mograft")


def same(a, b, *, places=True):
    """Assert that two libraries have the same numbers, bit for bit."""
    assert [entry.name for entry in a.entries] == [entry.name for entry in b.entries]
    assert (a.rate, a.root, a.up, a.sigma, a.config) == (b.rate, b.root, b.up, b.sigma, b.config)
    pairs = [(a.is_donor, b.is_donor)]
    pairs += [(getattr(a.segments, n), getattr(b.segments, n)) for n in ("start", "stop", "clip")]
    for group in a.labels:
        pairs.append((a.labels[group], b.labels[group]))
        pairs += [
            (own, b.boundary_states[group][key]) for key, own in a.boundary_states[group].items()
        ]
        one, other = a.embedding[group], b.embedding[group]
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            names = ("points", "joints", "reference", "mean", "scale", "components", "variances")
            pairs += [(getattr(one, name), getattr(other, name)) for name in names]
    chunks = zip(a.samples.chunks(), b.samples.chunks(), strict=True)
    pairs += [(one.rows, other.rows) for one, other in chunks]
    for ours, theirs in zip(a.clips, b.clips, strict=True):
        assert ours.frame_time == theirs.frame_time
        pairs += [(ours.rotations, theirs.rotations), (ours.positions, theirs.positions)]
        if places:
            assert (ours.channel_values is None) == (theirs.channel_values is None)
    for one, other in pairs:
        assert one.dtype == other.dtype
        assert one.shape == other.shape
        assert one.tobytes() == other.tobytes()


def test_what_is_indexed_is_what_is_built(clips, stored):
    files = [clips / f"{name}.bvh" for name in ("c", "d", "jump/a", "walk/a", "walk/b")]
    built = Library.build(files)
    same(stored, built)
    assert [entry.name for entry in stored.entries] == ["c", "d", "a", "a~2", "b"]
    ours, theirs = graft(stored, seed=3), graft(built, seed=3)
    assert ours.as_dict() == theirs.as_dict()
    np.testing.assert_array_equal(ours.motion.rotations, theirs.motion.rotations)
    np.testing.assert_array_equal(ours.motion.channel_values, theirs.motion.channel_values)
    assert len(graft_many(stored, "a", 2, seed=1)) == 2
    for segment in range(0, len(built.segments), 7):
        assert stored.candidates(segment, "upper") == built.candidates(segment, "upper")


def test_a_base_is_a_clip_of_the_library_or_a_file(stored, tmp_path, capsys):
    """Mirrored too, when the library is in memory."""
    options = ["graft", str(stored.folder), "-o", str(tmp_path / "new.bvh")]
    name = stored.entries[1].name
    assert main([*options, "--base", name, "--mirror"]) == 0
    capsys.readouterr()
    options[-1] = str(tmp_path / "other.bvh")
    for more in ([], ["--mirror"]):
        assert main([*options, "--base", "waltz", *more]) == 1
        told = capsys.readouterr().err
        assert f"--base must be a clip of {stored.folder}, one of" in told
        assert name in told
        assert "or a file; got 'waltz'" in told
    assert not (tmp_path / "other.bvh").exists()


def test_a_motion_from_elsewhere_is_grafted_on_a_stored_library(clips, stored):
    built = Library.build([entry.source_file.path for entry in stored.entries])
    base = WHOLE[700:900]
    ours, theirs = graft(stored, base, seed=3), graft(built, base, seed=3)
    np.testing.assert_array_equal(ours.motion.rotations, theirs.motion.rotations)
    with pytest.raises(ValueError, match="extended by a base"):
        stored.resolve_base(base)[0].save(clips.parent / "longer")


@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(motions(min_frames=60, min_joints=3), st.sampled_from((1.0, 2.0, 0.37)), st.booleans())
def test_what_is_saved_is_what_is_opened(tmp_path, motion, speed, paper):
    """Of any skeleton, at any mixture of rates, with and without channels of a file."""
    names = list(motion.skeleton.names)
    groups = JointGroups({"base": names[:2], "rest": names[2:]}, base="base")
    other = replace(motion, frame_time=motion.frame_time * speed)
    numbers = motion.channel_numbers()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        built = Library.build(
            [motion, other, replace(motion, channel_values=numbers)],
            groups,
            Config.paper() if paper else Config(),
        )
    built.save(tmp_path / "l", force=True)
    same(Library.open(tmp_path / "l"), built)
    assert store.verify(tmp_path / "l") == []
    again = Library.open(tmp_path / "l")
    again.save(tmp_path / "copy", force=True)
    same(Library.open(tmp_path / "copy"), built)


@given(motions(max_frames=20), st.integers(0, 2))
def test_a_motion_comes_back_from_its_numbers(motion, holes):
    numbers = motion.channel_numbers()
    numbers[:holes] = np.nan
    for values in (None, numbers):
        one = replace(motion, channel_values=values)
        back = unpack(pack(one))
        assert back.rotations.tobytes() == one.rotations.tobytes()
        assert back.positions.tobytes() == one.positions.tobytes()
        np.testing.assert_array_equal(back.channel_numbers(), one.channel_numbers())


def moved(clips, folder, names):
    """Copy some clips to a folder, at the times at which they were written."""
    for name in names:
        target = folder / f"{name}.bvh"
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(clips / f"{name}.bvh", target)
    return folder


NAMES = ["c", "d", "jump/a", "walk/a", "walk/b"]


@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.sampled_from(NAMES), min_size=1, max_size=4, unique=True))
def test_adding_equals_building_afresh(clips, stored, tmp_path, first):
    shutil.rmtree(tmp_path / "part", ignore_errors=True)
    shutil.rmtree(tmp_path / "l", ignore_errors=True)
    folder = moved(clips, tmp_path / "part", first)
    part = Library.index(folder, tmp_path / "l")
    before = [entry.name for entry in part.entries]
    whole = part.add(moved(clips, folder, NAMES))
    same(whole, stored)
    # Whoever had the library open still has it as it was, and can still read it.
    assert [entry.name for entry in part.entries] == before
    assert len(part.clips[0].rotations) > 0
    assert store.verify(tmp_path / "l") == []
    assert store.list_leftovers(tmp_path / "l") == []


def test_only_what_is_new_or_changed_is_read(clips, tmp_path, monkeypatch):
    from mograft.library import ingest

    folder = moved(clips, tmp_path / "part", NAMES[:3])
    library = Library.index(folder, tmp_path / "l")
    read = []
    plain = ingest.read_bvh
    monkeypatch.setattr(ingest, "read_bvh", lambda path: read.append(path) or plain(path))
    library = library.add(moved(clips, folder, NAMES[:4]))
    assert [os.path.basename(path) for path in read] == ["a.bvh"]
    (folder / "c.bvh").write_bytes((clips / "d.bvh").read_bytes())
    os.utime(folder / "d.bvh", (1, 1))
    read.clear()
    library = library.add(folder)
    assert [os.path.basename(path) for path in read] == ["c.bvh"]
    np.testing.assert_array_equal(library.clips[0].rotations, library.clips[1].rotations)
    same(library, Library.index(folder, tmp_path / "fresh"))
    assert library.add(folder).entries == library.entries


def test_what_clips_have_in_common_may_change_when_some_are_added(clips, tmp_path):
    """The rate of most frames, with the clips that were resampled for another's sake."""
    folder = moved(clips, tmp_path / "part", ["c", "walk/a"])
    fast = replace(WHOLE[:500].resample(60.0), channel_values=None)
    write_bvh(fast[:120], folder / "fast.bvh")
    with pytest.warns(UserWarning, match="resampled to 30 fps"):
        library = Library.index(folder, tmp_path / "l")
    assert library.rate == pytest.approx(30)
    write_bvh(fast, folder / "faster.bvh")
    with pytest.warns(UserWarning, match="resampled to 60 fps"):
        library = library.add(folder)
    with pytest.warns(UserWarning, match="resampled"):
        same(library, Library.index(folder, tmp_path / "fresh"))
    assert library.rate == pytest.approx(60)
    with pytest.warns(UserWarning, match="resampled"):
        fixed = Library.index(folder, tmp_path / "fixed", rate=30)
    assert [clip.rate for clip in fixed.clips] == pytest.approx([30.0] * 4, rel=1e-2)


def test_a_few_clips_that_a_dummy_carries_do_not_move_the_others():
    """Some files move by the joint above the hips, most by the hips."""
    names = ["Dummy", *WHOLE.skeleton.names]
    parents = [-1, *(WHOLE.skeleton.parents + 1)]
    offsets = np.concatenate([np.zeros((1, 3)), WHOLE.skeleton.offsets])
    skeleton = Skeleton(names, parents, offsets)
    still = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (WHOLE.n_frames, 1, 4))
    by_hips = np.concatenate([np.zeros((WHOLE.n_frames, 1, 3)), WHOLE.positions], axis=1)
    by_dummy = by_hips.copy()
    by_dummy[:, 0], by_dummy[:, 1] = by_hips[:, 1], 0.0
    turned = np.concatenate([still, WHOLE.rotations], axis=1)
    own, other = (Motion(skeleton, 1 / 30, turned, places) for places in (by_hips, by_dummy))
    groups = JointGroups({"low": names[:8], "high": names[8:]}, base="low")
    library = Library.build([other[:160], own[160:320], own[320:480]], groups)
    assert library.root == 1
    alike = Library.build([own[:160], own[160:320], own[320:480]], groups)
    for ours, theirs in zip(library.samples.chunks(), alike.samples.chunks(), strict=True):
        np.testing.assert_allclose(ours.rows, theirs.rows, atol=1e-5)


def test_a_wrong_rate_can_be_corrected(clips, tmp_path):
    folder = moved(clips, tmp_path / "part", ["c", "d"])
    with pytest.warns(UserWarning, match="resampled to 30 fps"):
        library = Library.index(folder, tmp_path / "l", frame_rates={"d": 15.0}, rate=30)
    plain = Library.index(folder, tmp_path / "plain")
    assert library.entries[1].rate_override == 15
    assert library.clips[1].duration == 2 * plain.clips[1].duration
    assert library.clips[1].rate == pytest.approx(30)
    with pytest.raises(ValueError, match="frame_rates must be above 0"):
        Library.index(folder, tmp_path / "no", frame_rates={"*": 0})
    assert not (tmp_path / "no").exists()


def test_clips_that_do_not_fit_are_left_out_or_refused(clips, tmp_path):
    folder = moved(clips, tmp_path / "part", ["c", "d"])
    names = ["Tail" if name == "Head" else name for name in WHOLE.skeleton.names]
    other = replace(WHOLE[:60], skeleton=replace(WHOLE.skeleton, names=names))
    write_bvh(other, folder / "a_goat.bvh")
    (folder / "broken.bvh").write_text("HIERARCHY\nROOT")
    write_bvh(WHOLE[:1], folder / "still.bvh")
    library = Library.index(folder, tmp_path / "l")
    assert [entry.name for entry in library.entries] == ["c", "d"]
    reasons = [library.refused[str(folder / f"{n}.bvh")] for n in ("a_goat", "broken", "still")]
    assert "lacks Head and has also Tail" in reasons[0]
    assert "broken.bvh:2" in reasons[1]
    assert "at least 2 frames" in reasons[2]
    with pytest.raises(BvhError):
        Library.index(folder, tmp_path / "strict", strict=True)
    (folder / "broken.bvh").unlink()
    (folder / "still.bvh").unlink()
    with pytest.raises(SkeletonMismatchError, match="a_goat"):
        Library.index(folder, tmp_path / "strict", strict=True)
    with pytest.raises(SkeletonMismatchError, match="a_goat"):
        library.add(folder, strict=True)
    assert not (tmp_path / "strict").exists()
    assert list(tmp_path.glob(".*partial*")) == []
    same(Library.open(tmp_path / "l"), library)
    shutil.rmtree(folder)
    folder.mkdir()
    (folder / "broken.bvh").write_text("HIERARCHY\nROOT")
    with pytest.raises(ValueError, match="no clip can be used"):
        Library.index(folder, tmp_path / "none")


def test_tags_come_from_folders_and_tables(clips, stored, tmp_path):
    assert [set(tags) for tags in stored.tags] == [set(), set(), {"jump"}, {"walk"}, {"walk"}]
    table = tmp_path / "tags.csv"
    table.write_text("clip,tags\nc,calm,slow\n*/a.bvh,short\nd.bvh,calm\n")
    tagged = Library.index(clips, tmp_path / "l", tags=read_tags(table))
    wanted = [{"calm", "slow"}, {"calm"}, {"jump", "short"}, {"walk", "short"}, {"walk"}]
    assert [set(tags) for tags in tagged.tags] == wanted
    stages = []
    later = tagged.add(clips, tags={"b": ["late"]}, progress=lambda *told: stages.append(told[0]))
    assert set(later.tags[4]) == {"walk", "late"}
    same(later, stored)
    assert set(stages) == {"writing"}  # of what was compared nothing is compared again
    same(Library.open(later.folder), stored)
    assert store.verify(later.folder) == []
    table.write_text("c\n")
    with pytest.raises(ValueError, match=r"tags.csv:1: must be a clip and its tags"):
        read_tags(table)


@pytest.mark.parametrize("kind", ["threads", "processes", "dask"])
def test_the_executor_does_not_matter(clips, stored, tmp_path, monkeypatch, kind):
    from mograft.library import ingest

    monkeypatch.setattr(ingest, "_BATCH_CLIPS", 1)  # so that five clips are several batches
    if kind == "threads":
        with ThreadPoolExecutor(2) as pool:
            same(Library.index(clips, tmp_path / "l", executor=pool), stored)
    elif kind == "processes":
        with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
            same(Library.index(clips, tmp_path / "l", executor=pool), stored)
            files = [entry.source_file.path for entry in stored.entries]
            same(Library.build(files, executor=pool), stored)
    else:
        distributed = pytest.importorskip("distributed", reason="needs the extra dask")
        with (
            distributed.LocalCluster(
                n_workers=2, threads_per_worker=1, dashboard_address=None
            ) as cluster,
            distributed.Client(cluster) as client,
        ):
            same(Library.index(clips, tmp_path / "l", executor=client.get_executor()), stored)


INDEXING = """
import sys
from mograft import Library
from mograft.dancer import dance
Library.build([dance(seed=seed, strides=2).motion for seed in range(3)]).save(sys.argv[1])
"""


def test_the_threads_of_the_blas_do_not_matter(tmp_path):
    """Nor does it matter which of its kernels they take; there are enough numbers to share."""
    files = []
    for threads in ("1", "2", "3"):
        place = tmp_path / threads
        names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
        environment = {**os.environ, **dict.fromkeys(names, threads)}
        command = [sys.executable, "-c", INDEXING, str(place)]
        subprocess.run(command, env=environment, check=True)
        files.append(store.read_manifest(place)["files"])
    assert files[1] == files[0]
    assert files[2] == files[0]


def test_the_command_settles_the_threads_of_the_blas_before_numpy_is_loaded(tmp_path):
    script = """
import os, sys
from mograft.cli import main
class Seen:
    def find_spec(self, name, path=None, target=None):
        if name == "numpy":
            print(os.environ.get("OPENBLAS_NUM_THREADS"))
sys.meta_path.insert(0, Seen())
main(["index", "nothing.bvh", "-o", "l"])
"""
    environment = {key: own for key, own in os.environ.items() if not key.endswith("_THREADS")}
    for extra, expected in (({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")):
        done = subprocess.run(
            [sys.executable, "-c", script],
            cwd=tmp_path,
            env=environment | extra,
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        )
        assert done.stdout.split() == [expected]


def test_chunks_are_cut_alike_wherever_samples_are(stored, monkeypatch):
    """However the rows lie in files, the same chunks come out."""
    from mograft.analysis import embedding

    monkeypatch.setattr(stored_clips, "CHUNK", 7)
    assert embedding.CHUNK > 7
    rows = [chunk.rows for chunk in stored.samples.chunks()]
    assert [len(own) for own in rows[:-1]] == [7] * (len(rows) - 1)
    whole = np.concatenate(rows)
    split = replace(
        stored.samples, ranges=tuple(RowRange(0, *rows) for rows in ((5, 20), (0, 3), (40, 9)))
    )
    got = np.concatenate([chunk.rows for chunk in split.chunks()])
    np.testing.assert_array_equal(got, np.concatenate([whole[5:25], whole[:3], whole[40:49]]))


@pytest.mark.parametrize("is_stored", [True, False])
def test_donors_come_from_clips_of_a_tag(clips, stored, is_stored):
    library = stored if is_stored else Library.build(clips)
    made = graft(library, "c", constraints=[OnlyFrom(tags={"walk"})])
    names = {part.clip for part in made.substitutions if not part.is_own}
    walking = {e.name for e in library.entries if "walk" in e.tags}
    assert names
    assert names <= walking
    made = graft(library, "c", constraints=[NotFrom("d", tags=["walk"])])
    assert {part.clip for part in made.substitutions if not part.is_own} <= {"a", "c"}
    with pytest.raises(ValueError, match="tags must be of jump, walk; got 'happy'"):
        graft(library, "c", constraints=[OnlyFrom(tags="happy")])
    segment = int(library.segments.of_clip(0)[2])
    judged = library.candidates(segment, "upper", [NotFrom(tags="walk")])
    for candidate in (*judged.allowed, *judged.refused):
        is_walking = library.entries[candidate.clip].name in walking
        assert ("NotFrom: from clips tagged walk" in candidate.refused) == is_walking


# Damage.


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("small")
    write_bvh(WHOLE[:70], folder / "a.bvh")
    Library.index(folder, folder / "l")
    return folder / "l"


def files_of(library):
    return sorted(path for path in library.rglob("*") if path.is_file() and path.stat().st_size)


@settings(max_examples=150)
@given(st.data())
def test_any_flipped_byte_is_harmless_or_reported(small, data):
    path = data.draw(st.sampled_from(files_of(small)), label="file")
    if path.suffix == ".npy" and data.draw(st.booleans(), label="in the header"):
        at = data.draw(st.integers(0, 127))
    else:
        at = data.draw(st.integers(0, path.stat().st_size - 1), label="byte")
    flip = data.draw(st.integers(1, 255), label="flip")
    whole = path.read_bytes()
    plain = Library.open(small)
    try:
        path.write_bytes(whole[:at] + bytes([whole[at] ^ flip]) + whole[at + 1 :])
        try:
            wrong = store.verify(small)
        except LibraryError:
            return
        if not wrong:
            same(Library.open(small), plain)
    finally:
        path.write_bytes(whole)


@settings(max_examples=300)
@given(st.data())
def test_an_array_whose_header_differs_is_read_or_refused(small, data):
    """Opening compares sizes alone; what a header says must not lead beyond the file."""
    paths = [path for path in files_of(small) if path.suffix == ".npy"]
    path = data.draw(st.sampled_from(paths), label="file")
    whole = path.read_bytes()
    at = data.draw(st.integers(0, 127))
    header = bytearray(whole[:128])
    header[at] = data.draw(st.one_of(st.integers(0, 255), st.sampled_from(b"0123456789(),'")))
    try:
        path.write_bytes(bytes(header) + whole[128:])
        arrays = store.read(small).arrays
    except LibraryError:
        return
    finally:
        path.write_bytes(whole)
    for name, array in arrays.items():
        assert array.nbytes == (small / "0001" / f"{name}.npy").stat().st_size - 128


@settings(max_examples=40)
@given(st.data())
def test_a_file_that_is_cut_or_gone_is_refused(small, data):
    path = data.draw(st.sampled_from(files_of(small)), label="file")
    whole = path.read_bytes()
    try:
        if data.draw(st.booleans(), label="gone"):
            path.unlink()
        else:
            path.write_bytes(whole[: data.draw(st.integers(0, len(whole) - 1))])
        with pytest.raises(LibraryError, match=r"damaged|not a mograft library"):
            Library.open(small)
    finally:
        path.write_bytes(whole)


def test_what_is_no_library_of_ours_is_refused_with_what_to_do(small, tmp_path):
    with pytest.raises(FileNotFoundError):
        Library.open(tmp_path / "nothing")
    with pytest.raises(LibraryError, match=r"not a mograft library: .* mograft index CLIPS -o"):
        Library.open(tmp_path)
    (tmp_path / "a.bvh").write_text("HIERARCHY")
    with pytest.raises(LibraryError, match=r"a\.bvh is not a mograft library: it is a file"):
        Library.open(tmp_path / "a.bvh")
    shutil.copytree(small, tmp_path / "l")
    manifest = tmp_path / "l" / "manifest.json"
    document = json.loads(manifest.read_text())
    for change, message in (
        ({"version": 99, "mograft": "7.0"}, "written by mograft 7.0.*upgrade"),
        ({"format": "other"}, "another format"),
        ({"rate": 31.0}, "damaged: .*checksum.*--force"),
    ):
        manifest.write_text(json.dumps({**document, **change}))
        with pytest.raises(LibraryError, match=message):
            Library.open(tmp_path / "l")
    manifest.write_text("{")
    with pytest.raises(LibraryError, match="not valid JSON"):
        store.verify(tmp_path / "l")


def test_what_is_there_is_not_overwritten(clips, stored, tmp_path):
    library = Library.index(clips / "c.bvh", tmp_path / "l")
    with pytest.raises(FileExistsError, match="force"):
        Library.index(clips, tmp_path / "l")
    same(Library.open(tmp_path / "l"), library)
    same(Library.index(clips, tmp_path / "l", force=True), stored)
    other = tmp_path / "mine"
    other.mkdir()
    (other / "thesis.txt").write_text("dear")
    with pytest.raises(LibraryError, match="not overwritten"):
        Library.index(clips, other, force=True)
    (tmp_path / "empty").mkdir()
    same(Library.index(clips, tmp_path / "empty"), stored)
    with pytest.raises(ValueError, match="in memory: save it first"):
        Library.build(WHOLE[:200]).add(clips)
    with pytest.raises(TypeError, match="sources must be files"):
        Library.index(WHOLE, tmp_path / "no")


def test_one_writes_at_a_time_and_many_read(clips, tmp_path):
    library = Library.index(clips / "c.bvh", tmp_path / "l")
    with generation.write_generation(tmp_path / "l", add=True):
        with pytest.raises(LibraryError, match="another process is writing"):
            library.add(clips)
        same(Library.open(tmp_path / "l"), library)
    assert store.list_leftovers(tmp_path / "l") == []


ADDING = """
import sys, warnings
from mograft import Library
warnings.simplefilter("ignore")
print("ready", flush=True)
if sys.argv[1] == "add":
    Library.open(sys.argv[2]).add(sys.argv[3])
else:
    Library.index(sys.argv[3], sys.argv[2], force=sys.argv[1] == "force")
"""


@pytest.mark.parametrize("way", ["index", "add", "force"])
def test_a_kill_leaves_the_old_library_or_the_new_one(clips, stored, tmp_path, way):
    old = Library.index(clips / "c.bvh", tmp_path / "old")
    rng = np.random.default_rng(len(way))
    for trial in range(3):
        place = tmp_path / f"l{trial}"
        if way != "index":
            shutil.copytree(tmp_path / "old", place)
        command = [sys.executable, "-c", ADDING, way, str(place), str(clips)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE)
        process.stdout.readline()
        time.sleep(rng.uniform(0, 0.6))
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
        if way == "index" and not place.exists():
            continue
        found = Library.open(place)
        assert store.verify(place) == []
        same(found, stored if len(found.entries) == len(stored.entries) else old)
        # What is left lying about is in nobody's way.
        again = found.add(clips)
        same(again, stored)
        assert store.list_leftovers(place) == []


@pytest.mark.parametrize("stage", ["write_array", "write_clip_table", "commit"])
def test_an_error_at_any_stage_leaves_what_was_there(clips, tmp_path, monkeypatch, stage):
    library = Library.index(clips / "c.bvh", tmp_path / "l")

    def fail(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(generation.GenerationWriter, stage, fail)
    with pytest.raises(KeyboardInterrupt):
        library.add(clips)
    with pytest.raises(KeyboardInterrupt):
        Library.index(clips, tmp_path / "new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["l"]
    assert store.list_leftovers(tmp_path / "l") == []
    same(Library.open(tmp_path / "l"), library)


def test_a_full_disk_leaves_what_was_there_and_is_told_by_file(clips, tmp_path):
    """Files that may not grow stand for a disk that is full."""
    resource = pytest.importorskip("resource", reason="needs limits on the size of files")
    library = Library.index(clips / "c.bvh", tmp_path / "l")
    largest = max(path.stat().st_size for path in files_of(tmp_path / "l"))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest + 4096, before[1]))
    try:
        with pytest.raises(OSError, match="File too large") as told:
            library.add(clips)
        with pytest.raises(OSError, match="File too large"):
            Library.index(clips, tmp_path / "new")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert told.value.filename.startswith(str(tmp_path / "l"))
    draft = generation.GenerationWriter(tmp_path, tmp_path / "x", None, 9)
    (tmp_path / "0009" / "catalog.sqlite").mkdir()
    with pytest.raises(LibraryError, match=r"catalog\.sqlite cannot be written"):
        draft.write_clip_table([], [], {}, Segments([], []), np.zeros(0, bool), {})
    shutil.rmtree(tmp_path / "0009")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["l"]
    assert store.list_leftovers(tmp_path / "l") == []
    same(Library.open(tmp_path / "l"), library)


WAYS = st.lists(st.sampled_from(["a", "b", "..", ".", "a b"]), max_size=5).map("/".join)


@given(WAYS, WAYS, st.booleans())
def test_the_way_to_a_file_is_that_of_the_standard_library(folders, folder, is_absolute):
    path = f"{folders}/take.bvh".lstrip("/")
    path = os.path.abspath(path) if is_absolute else path
    expected = Path(os.path.relpath(path, folder or "."))
    assert relative_path(path, Path(folder)) == expected


def test_a_library_can_be_moved_with_its_clips(clips, tmp_path):
    folder = moved(clips, tmp_path / "here" / "clips", NAMES)
    Library.index(folder, tmp_path / "here" / "l")
    (tmp_path / "here").rename(tmp_path / "there")
    library = Library.open(tmp_path / "there" / "l")
    assert all(os.path.exists(entry.source_file.path) for entry in library.entries)
    assert library.add(tmp_path / "there" / "clips").entries == library.entries


# Tables.


@pytest.mark.parametrize("kind", ["csv", "npz", "parquet"])
def test_tables_hold_what_the_library_holds(stored, tmp_path, kind):
    if kind == "parquet":
        pytest.importorskip("pyarrow", reason="needs the extra parquet")
    found = library_tables(stored)
    files = export_tables(stored, tmp_path / "out", kind)
    if kind == "npz":
        read = np.load(files[0], allow_pickle=False)
        got = {table: {c: read[f"{table}/{c}"] for c in found[table]} for table in found}
    elif kind == "csv":
        import csv

        got = {}
        for path in files:
            with path.open(newline="") as stream:
                names, *rows = csv.reader(stream)
            columns = zip(*rows, strict=True)
            got[path.stem] = dict(zip(names, map(list, columns), strict=True))
    else:
        import pyarrow.parquet

        got = {path.stem: pyarrow.parquet.read_table(path).to_pydict() for path in files}
    for table, columns in found.items():
        for name, column in columns.items():
            wanted = np.asarray(column)
            own = np.asarray(got[table][name])
            if own.dtype.kind == "U" and wanted.dtype.kind == "b":
                own = own == "True"
            np.testing.assert_array_equal(own.astype(wanted.dtype), wanted)
    assert isinstance(stored.clips[0], Motion)
    with pytest.raises(ValueError, match="kind must be"):
        export_tables(stored, tmp_path / "x", "xlsx")


# The command line.


def told(capsys, *words):
    code = main([str(word) for word in words])
    return code, *capsys.readouterr()


def test_commands_that_take_files_take_a_library(stored, tmp_path, capsys):
    place = stored.folder
    code, out, _ = told(capsys, "candidates", place, "--clip", "b", "--segment", 2, "--json")
    assert code == 0
    index = [entry.name for entry in stored.entries].index("b")
    found = stored.candidates(int(stored.segments.of_clip(index)[2]), "upper")
    assert len(json.loads(out)["allowed"]) == len(found.allowed)
    code, out, _ = told(
        capsys, "candidates", place, "--segment", 2, "--json", "--not-tagged", "walk,jump"
    )
    assert {donor["clip"] for donor in json.loads(out)["allowed"]} <= {"c", "d"}
    code, _, err = told(capsys, "candidates", place, "--segment", 2, "--only-tagged", "glad")
    assert (code, "tags must be of jump, walk; got 'glad'" in err) == (1, True)

    page = tmp_path / "page.html"
    assert told(capsys, "view", place, "--clip", "a*", "--clip", "c", "-o", page)[0] == 0
    assert [name in page.read_text() for name in ('"a"', '"a~2"', '"c"', '"b"')] == [1, 1, 1, 0]
    code, _, err = told(capsys, "view", place, "--clip", "e", "-o", tmp_path / "no.html")
    assert (code, "--clip must match a clip of c, d, a, a~2, b; got 'e'" in err) == (1, True)
    code, _, err = told(capsys, "graft", place, "--only-tagged", "walk", "-o", tmp_path / "g.bvh")
    assert code == 0
    document = json.loads((tmp_path / "g.json").read_text())
    assert {s["clip"] for s in document["substitutions"] if s["exchanged"]} <= {"a~2", "b"}


@pytest.mark.parametrize("kind", ["pca", "dendrogram", "clusters", "timeline", "strip", "energy"])
def test_a_library_is_drawn(stored, tmp_path, capsys, kind):
    pytest.importorskip("matplotlib", reason="needs the extra plot")
    picture = tmp_path / "it.svg"
    code, _, err = told(capsys, "plot", kind, stored.folder, "-o", picture)
    if kind in ("strip", "energy"):
        assert (code, "shows one motion, got 5" in err) == (1, True)
        assert told(capsys, "plot", kind, stored.folder, "--clip", "b", "-o", picture)[0] == 0
    assert picture.exists()
    with pytest.raises(SystemExit):
        told(
            capsys,
            "plot",
            kind,
            stored.folder,
            "--groups",
            "lower_upper",
            "-o",
            tmp_path / "no.svg",
        )


def test_of_many_clips_some_must_be_chosen(stored):
    many = replace(stored, entries=stored.entries * 3)
    with pytest.raises(ValueError, match="at most 12 clips can be shown at once, got 15"):
        select_clips(many, [])
    assert select_clips(many, ["a~*", "c"]) == [0, 3, 5, 8, 10, 13]
