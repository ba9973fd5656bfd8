"""Sessions: laws of actions, locks, previews, export and files."""

import filecmp
import json
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import mograft as mg
from mograft._util.containers import SizedCache
from mograft.errors import FormatError, MograftError
from mograft.library.origin import hash_poses
from mograft.studio.export import replay_project
from mograft.studio.project import read_project
from mograft.studio.session import Session, StaleRevision
from tests.io.recorded_files import DATA
from tests.viewing.page_content import decode_tracks

SPHERE = {"kind": "Sphere", "center": [10.0, 110.0, 20.0], "radius": 15.0}
AVOID = {"kind": "Avoid", "obstacle": SPHERE, "frames": [20, 90]}
REACH = {"kind": "Reach", "joint": "LeftHand", "target": [30.0, 130.0, 40.0], "frames": [120, 125]}


def do(session, action, **fields):
    return session.do({"action": action, **fields}, session.revision)


def graft_of(session, motion):
    return session.workshop.graft(session.project.motion(motion).record)


def segment_of(session, motion, number, group="upper"):
    own = [each for each in graft_of(session, motion).substitutions if each.group == group][number]
    return {"id": motion, "group": group, "first": own.start, "last": own.stop}


def other_donor(session, segment):
    listed = session.donors(segment)["donors"]
    return next(own for own in listed if not (own["refused"] or own["isUsed"] or own["isCaptured"]))


def span_of(donor):
    return {"clip": donor["clip"], "from": donor["first"], "to": donor["last"]}


def assert_same_turns(quats, expected):
    np.testing.assert_allclose(np.abs((quats * expected).sum(axis=-1)), 1.0, atol=1e-4)


def donors_at(graft, segment):
    return [
        own.donor
        for own in graft.substitutions
        if own.group == segment["group"]
        and own.start < segment["last"]
        and own.stop > segment["first"]
    ]


def test_motions_of_a_session_are_those_of_graft_many(session, dances):
    library = mg.Library.build([str(dances / "one.bvh"), str(dances / "two.bvh")])
    grafts = mg.graft_many(library, "one", 3)
    found = [graft_of(session, own.id) for own in session.project.motions]
    assert [hash_poses(own.motion) for own in found] == [hash_poses(own.motion) for own in grafts]
    assert session.state()["undo"] == "make 3 on one"


def test_failure_between_two_motions_leaves_none_and_ends_the_job(session, monkeypatch):
    before, add, shown = (session.project, session.history), session.workshop.add, []
    calls = iter([add, None])
    monkeypatch.setattr(session.workshop, "add", lambda *given: next(calls)(*given))
    session.subscribe(lambda _: shown.append([own["text"] for own in session.jobs]))
    with pytest.raises(TypeError):
        do(session, "make", base="two", count=2)
    assert (session.project, session.history) == before
    assert (shown[0], shown[-1]) == (["make 2 on two"], [])


def test_taken_donor_has_the_seams_of_the_list_and_the_others_stay(session):
    segment, before = segment_of(session, "m1", 4), graft_of(session, "m1")
    donor = other_donor(session, segment)
    assert do(session, "take", **segment, **span_of(donor))["motions"] == ["m1"]
    pairs = zip(before.substitutions, graft_of(session, "m1").substitutions, strict=True)
    (new,) = [new for old, new in pairs if old.donor != new.donor]
    assert (new.start, new.clip, new.donor_start, new.donor_stop) == (
        segment["first"],
        *span_of(donor).values(),
    )
    seams = np.degrees([new.gap_before, new.gap_after])
    np.testing.assert_allclose(seams, [donor["seamBefore"], donor["seamAfter"]], atol=0.006)


def test_donors_between_any_frames_have_about_their_length_and_are_taken_as_a_change(session):
    place = {"id": "m1", "group": "larm", "first": 31, "last": 67}
    listed = session.donors({**place, "limit": 7})["donors"]
    assert len(listed) == 7
    assert all(abs(own["stretch"]) < 0.2 for own in listed)
    do(session, "take", **place, **span_of(listed[3]))
    (change,) = graft_of(session, "m1").changes
    given = listed[3]["first"], listed[3]["last"]
    assert (change.part, change.frames, change.clip_frames) == ("larm", (31, 67), given)


def test_donors_are_ranked_with_the_allowed_ones_first(session):
    listed = session.donors({**segment_of(session, "m1", 4), "limit": 500})
    others = [own for own in listed["donors"] if not own["isUsed"]]
    keys = [(bool(own["refused"]), own["cost"]) for own in others]
    assert keys == sorted(keys)
    assert listed["total"] == len(listed["donors"])
    few = session.donors({**segment_of(session, "m1", 4), "variety": 0.0})["total"]
    assert few < listed["total"]


def test_locked_segment_keeps_its_donor_until_it_is_unlocked(session):
    segment = segment_of(session, "m1", 4)
    place = {**segment, **span_of(other_donor(session, segment))}
    do(session, "lock", **segment)
    before, project = graft_of(session, "m1"), session.project
    for action in ("take", "restore", "change"):
        with pytest.raises(ValueError, match="unlock first"):
            do(session, action, **place)
        assert session.project == project
    with pytest.raises(ValueError, match=r"upper, frames .* is locked"):
        do(session, "restore", **{**segment, "group": None})
    with pytest.raises(ValueError, match="`group` must be"):
        do(session, "restore", **{**segment, "group": "uper"})
    for action in ("ban", "regenerate"):
        do(session, action, **{**segment, "first": 0, "last": before.motion.n_frames - 1})
        after = graft_of(session, "m1")
        assert donors_at(after, segment) == donors_at(before, segment)
        pairs = list(zip(before.substitutions, after.substitutions, strict=True))
        assert sum(old.donor != new.donor for old, new in pairs) > len(pairs) / 2
        do(session, "undo")
    for motion in do(session, "more_like", id="m1", count=4)["motions"]:
        assert donors_at(graft_of(session, motion), segment) == donors_at(before, segment)
    do(session, "undo")
    do(session, "unlock", **segment)
    for action in ("take", "restore", "change"):
        do(session, action, **place)
        assert session.project.motion("m1").record != project.motion("m1").record
        do(session, "undo")


def test_constraints_leave_locked_segments(session):
    last = graft_of(session, "m1").motion.n_frames - 1
    do(session, "lock", id="m1", group="upper", first=0, last=last)
    before = graft_of(session, "m1").donors["upper"].tolist()
    do(session, "add_constraint", id="m1", constraint=AVOID)
    assert graft_of(session, "m1").donors["upper"].tolist() == before
    motion = session.state()["motions"][0]
    assert {own["group"] for own in motion["violations"]} == {"upper"}
    assert any("unlock" in own for own in motion["remarks"])


def test_dropped_target_leaves_no_trace_in_the_motion(session):
    before = graft_of(session, "m1")
    hand = before.motion.skeleton.index("LeftHand")
    near = before.motion.world_positions()[120, hand] + [0.0, 2.0, 1.0]
    do(session, "add_constraint", id="m1", constraint={**REACH, "target": near.tolist()})
    moved = graft_of(session, "m1")
    assert any(own.is_moved for own in moved.reach_completions)
    assert moved.donors["upper"].tolist() == before.donors["upper"].tolist()
    assert np.abs(moved.motion.rotations - before.motion.rotations).max() > 1e-3
    do(session, "drop_constraint", id="m1", number=0)
    after = graft_of(session, "m1")
    np.testing.assert_allclose(after.motion.rotations, before.motion.rotations, atol=2e-4)
    assert session.state()["motions"][0]["constraints"] == []
    record = session.workshop.record(session.project.motion("m1").record)
    assert hash_poses(mg.replay(record).motion) == hash_poses(after.motion)


def test_preview_of_a_large_motion_leaves_it_in_memory(session):
    session.workshop._grafts.limit = 1
    do(session, "add_constraint", id="m1", constraint=AVOID)
    graft = graft_of(session, "m1")
    fields = {"action": "set_constraint", "id": "m1", "number": 0, "constraint": AVOID}
    session.do({**fields, "preview": True})
    assert graft_of(session, "m1") is graft


def test_set_constraint_keeps_its_number_and_as_a_preview_is_no_step(session):
    do(session, "add_constraint", id="m1", constraint=AVOID)
    do(session, "add_constraint", id="m1", constraint={**REACH, "tolerance": 0.3})
    project, revision = session.project, session.revision
    moved = {**AVOID, "obstacle": {**SPHERE, "center": [12.0, 110.0, 20.0]}}
    fields = {"action": "set_constraint", "id": "m1", "number": 0, "constraint": moved}
    reply = session.do({**fields, "preview": True}, -1)
    assert (session.project, session.revision) == (project, revision)
    assert session.figure("motion", "m1")["hash"] == reply["hash"]
    do(session, "mark", id="m1", mark="star")
    assert session.figure("motion", "m1")["hash"] == project.motion("m1").record
    session.do(fields)
    own = session.state()["motions"][0]["constraints"]
    assert [each["record"]["kind"] for each in own] == ["Avoid", "Reach"]
    assert own[0]["record"]["obstacle"] == moved["obstacle"]


def test_waiting_previews_are_replaced_by_the_last(session):
    do(session, "add_constraint", id="m1", constraint=AVOID)
    replies, pool, before = [], ThreadPoolExecutor(3), session.n_requested

    def move(x):
        moved = {**AVOID, "obstacle": {**SPHERE, "center": [x, 110.0, 20.0]}}
        action = {"action": "set_constraint", "id": "m1", "number": 0, "constraint": moved}
        return session.do({**action, "preview": True})["message"]

    with session.action_lock:
        for x in (10.0, 20.0, 30.0):
            replies.append(pool.submit(move, x))
            while session.n_requested < before + len(replies):
                pass
    assert [own.result(30) for own in replies] == ["superseded", "superseded", ""]


def test_only_previews_are_cut_short_by_later_requests(session, monkeypatch):
    monkeypatch.setattr(type(session), "is_superseded", lambda _: True)
    action = {"action": "add_constraint", "id": "m1", "constraint": AVOID}
    assert session.do({**action, "preview": True})["message"] == "superseded"
    assert session.do(action)["motions"] == ["m1"]
    assert [own["number"] for own in session.state()["motions"][0]["constraints"]] == [0]


def test_renamed_motion_that_is_not_in_memory_keeps_its_measures(session):
    before = session.state()["motions"][0]
    session.workshop._grafts = SizedCache(0)
    do(session, "rename", id="m1", name="other")
    after = session.state()["motions"][0]
    assert after == {**before, "name": "other", "hash": after["hash"]}


def test_action_on_another_revision_is_refused(session):
    before = session.project
    revision = session.revision
    for other in (revision - 1, revision + 1):
        with pytest.raises(StaleRevision):
            session.do({"action": "mark", "id": "m1", "mark": "star"}, other)
    assert session.project == before
    session.notify()  # as a thread does when it has found the faults of clips
    session.do({"action": "mark", "id": "m1", "mark": "star"}, revision)
    with pytest.raises(StaleRevision):
        session.do({"action": "mark", "id": "m1", "mark": None}, revision)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ({"action": "mkae"}, "did you mean 'make'"),
        ({}, "unknown `action`"),
        ({"action": "make", "base": "three"}, "`base`"),
        ({"action": "make", "base": ""}, "`base`"),
        ({"action": "change", "id": "m1", "group": "upper", "first": 0, "last": 900}, "did you"),
        ({"action": "make", "count": 1000}, "`count`"),
        ({"action": "mark", "id": "m9", "mark": "star"}, "`id`"),
        ({"action": "mark", "id": "m1", "mark": "good"}, "`mark`"),
        ({"action": "rename", "id": "m1", "name": ""}, "`name`"),
        ({"action": "rename", "id": "m1", "name": "one_graft2"}, "`name`"),
        ({"action": "lock", "id": "m1", "group": "lower", "first": 0, "last": 9}, "`group`"),
        ({"action": "ban", "id": "m1", "group": "upper", "first": 9000, "last": 9001}, "within"),
        ({"action": "ban", "id": "m1", "group": "upper", "first": 9, "last": 2}, "first, last"),
        ({"action": "add_constraint", "id": "m1", "constraint": {"kind": "Fly"}}, "Fly"),
        ({"action": "drop_constraint", "id": "m1", "number": 0}, "no constraints"),
        ({"action": "set_groups", "preset": "upper"}, "`preset`"),
        ({"action": "set_groups", "toml": "[groups]\na = [0]"}, "groups"),
        ({"action": "set_character", "path": "/etc/passwd"}, "`path`"),
        ({"action": "scenario", "points": [[0, 0]]}, "`points`"),
        ({"action": "remove", "ids": []}, "`ids`"),
        ({"action": "redo"}, "nothing to redo"),
    ],
)
def test_impossible_action_names_the_field_and_changes_nothing(session, action, message):
    before = session.project, session.history
    with pytest.raises(ValueError, match=message):
        session.do(action)
    assert (session.project, session.history) == before


def test_patch_of_a_figure_gives_the_whole_figure(session):
    segment = segment_of(session, "m1", 4)
    old = session.figure("motion", "m1")
    do(session, "take", **segment, **span_of(other_donor(session, segment)))
    new, change = session.figure("motion", "m1"), session.figure("motion", "m1", old["hash"])
    patch = change["patch"]
    assert "parents" not in change
    assert patch["last"] - patch["first"] < new["frames"] / 2
    values, expected = (decode_tracks(own)[0] for own in (old, new))
    values[patch["first"] : patch["last"] + 1] = decode_tracks(patch)[0]
    assert_same_turns(values, expected)
    for key in ("rows", "donors", "hash"):
        assert change[key] == new[key]


def test_window_has_the_poses_of_the_clip(session):
    window = session.window("two", 40, 60)
    full = session.figure("clip", "two")
    columns = [full["turning"].index(joint) for joint in window["turning"]]
    assert_same_turns(decode_tracks(window)[0], decode_tracks(full)[0][40:61, columns])
    with pytest.raises(ValueError, match="within 0 to"):
        session.window("two", 40, 9000)


def test_export_equals_the_command_byte_for_byte(session, tmp_path, succeed):
    do(session, "add_constraint", id="m1", constraint={**REACH, "tolerance": 0.3})
    do(session, "change", id="m1", group="larm", first=31, last=67)
    do(session, "drop_constraint", id="m1", number=0)
    do(session, "regenerate", id="m1", group=None, first=150, last=250, variety=0.8)
    do(session, "rename", id="m3", name="new: one")
    do(session, "scenario", points=[], duration=4, count=1)
    for motion in ("m1", "m3", "m4"):
        do(session, "keep", id=motion, isKept=True)
    written = session.export({"format": "bvh", "folder": "page"})["files"]
    assert written == ["page/one_graft1.bvh", "page/new_ one.bvh", "page/scenario_graft4.bvh"]
    session.export({"format": "glb", "folder": "page", "into": True})
    session.flush()
    for target in ("command", "command/one.glb"):
        succeed("graft", "--project", session.file.path, "--quiet", "-o", tmp_path / target)
    names = sorted(own.name for own in (tmp_path / "page").iterdir())
    assert len(names) == 7
    same = filecmp.cmpfiles(tmp_path / "page", tmp_path / "command", names, shallow=False)
    assert same == (names, [], [])
    (read,) = mg.read(tmp_path / "page" / "new_ one.bvh")
    assert read.n_frames == graft_of(session, "m3").motion.n_frames


def test_export_is_below_the_folder_and_never_replaces_files_silently(session, tmp_path):
    session.flush()
    with pytest.raises(ValueError, match="no motion is kept"):
        replay_project(session.file.path)
    do(session, "keep", id="m1", isKept=True)
    for folder in ("..", "/tmp", "a/../..", ".hidden"):
        with pytest.raises(ValueError, match="`folder` must be below"):
            session.export({"format": "bvh", "folder": folder})
    (tmp_path / "one_graft1.json").write_text("mine")
    with pytest.raises(FileExistsError, match=r"one_graft1\.json"):
        session.export({"format": "bvh"})
    assert not (tmp_path / "one_graft1.bvh").exists()
    session.export({"format": "bvh", "force": True})
    assert (tmp_path / "one_graft1.bvh").exists()


@pytest.mark.parametrize("names_file", [True, False])
def test_restart_with_the_file_or_the_same_inputs_loses_nothing(session, make_session, names_file):
    do(session, "regenerate", id="m1", group=None, first=0, last=90)
    do(session, "remove", ids=["m2"])
    do(session, "undo")
    project, history, path = session.project, session.history, session.file.path
    figures = [session.figure("motion", own.id) for own in project.motions]
    with pytest.raises(MograftError, match="open in another session"):
        Session(session.folder, path)
    session.close()
    other = make_session((), path) if names_file else make_session()
    assert (other.project, other.history, other.file.path) == (project, history, path)
    assert [other.figure("motion", own.id) for own in project.motions] == figures
    do(other, "redo")
    while other.history.past:
        do(other, "undo")
    assert other.project.motions == ()


def test_other_inputs_get_a_project_of_their_own(session, make_session):
    first = session.file.path
    session.close()
    content = first.read_bytes()
    other = make_session(("one.bvh",))
    assert other.file.path != first
    assert first.read_bytes() == content


def test_change_of_the_file_by_another_program_is_not_overwritten(session):
    session.flush()
    path, events = session.file.path, []
    session.subscribe(events.append)
    path.write_text("mine")
    do(session, "mark", id="m1", mark="star")
    closing = threading.Thread(target=session.close, daemon=True)
    with session.lock:  # as if the thread of the file reported first
        closing.start()
    closing.join(30)
    assert not closing.is_alive()
    assert path.read_text() == "mine"
    assert read_project(path.with_name("one.project (2).json"))[0].motion("m1").mark == "star"
    assert any("another program" in own.get("text", "") for own in events)


def test_broken_files_get_messages_and_the_others_are_used(make_session, tmp_path):
    bad = {"bad.bvh": "bad.bvh:2", "bad.glb": "bad.glb"}
    for name in bad:
        (tmp_path / name).write_text("HIERARCHY\nnonsense")
    state = make_session(("one.bvh", *(tmp_path / name for name in bad))).state()
    assert state["library"]["status"] == "ready"
    assert [own["status"] for own in state["sources"]] == ["ok", "broken", "broken"]
    for own, place in zip(state["sources"][1:], bad.values(), strict=True):
        assert place in own["message"]
    alone = make_session((tmp_path / "bad.bvh",))
    with pytest.raises(ValueError, match=r"library is not ready: .*bad\.bvh:2"):
        do(alone, "make")


@pytest.mark.parametrize("format_", ["bvh", "glb"])
def test_session_opens_from_the_provenance_of_a_graft(make_session, dances, tmp_path, format_):
    library = mg.Library.build([str(dances / "one.bvh"), str(dances / "two.bvh")])
    graft = mg.graft(library, seed=3)
    mg.write(graft, tmp_path / f"new.{format_}")
    address = "new.json" if format_ == "bvh" else f"new.glb#{graft.motion.name}"
    session = make_session((tmp_path / address,))
    assert hash_poses(graft_of(session, "m1").motion) == hash_poses(graft.motion)
    segment = segment_of(session, "m1", 4)
    do(session, "ban", **segment)
    assert donors_at(graft_of(session, "m1"), segment) != donors_at(graft, segment)


def test_motions_get_donors_of_files_that_are_added(make_session, dances):
    session = make_session(("one.bvh",))
    do(session, "make", count=1)
    before = hash_poses(graft_of(session, "m1").motion)
    session.open([dances / "two.bvh"])
    session.flush()
    assert hash_poses(graft_of(session, "m1").motion) == before
    segment = segment_of(session, "m1", 4)
    assert {own["clip"] for own in session.donors(segment)["donors"]} == {"one", "two"}
    do(session, "regenerate", id="m1", group=None, first=0, last=290)
    assert "two" in {own.clip for own in graft_of(session, "m1").substitutions}
    do(session, "undo")
    do(session, "undo")
    session.flush()
    assert [own["name"] for own in session.state()["clips"]] == ["one"]


def test_motions_remain_with_the_groups_with_which_they_were_made(session):
    before = hash_poses(graft_of(session, "m1").motion)
    clip = session.figure("clip", "one")
    do(session, "set_groups", preset="lower_torso_arms")
    session.flush()
    assert session.state()["groups"]["names"] == ["lower", "torso", "arms"]
    assert hash_poses(graft_of(session, "m1").motion) == before
    assert session.figure("base", "m1")["groups"] == ["lower", "upper"]
    assert session.figure("clip", "one")["groups"] == ["lower", "torso", "arms"]
    assert session.figure("clip", "one")["hash"] != clip["hash"]
    do(session, "ban", **segment_of(session, "m1", 4))
    do(session, "make", base="two", count=1)
    assert set(graft_of(session, "m4").alternatives) == {"torso", "arms"}


def test_more_motions_like_one_share_most_donors(session):
    do(session, "more_like", id="m2", count=2)
    parent = graft_of(session, "m2")
    for motion in ("m4", "m5"):
        pairs = zip(parent.substitutions, graft_of(session, motion).substitutions, strict=True)
        same = [old.donor == new.donor for old, new in pairs]
        assert 0.3 < np.mean(same) < 1.0


def test_scenario_follows_the_drawn_path(session):
    do(session, "scenario", points=[[0, 0], [150, 0], [150, 150]], count=1)
    motion = graft_of(session, "m4").motion
    path = motion.world_positions()[:, 0]
    assert np.linalg.norm(path[0, [0, 2]]) < 20
    assert np.linalg.norm(path[-1, [0, 2]] - [150, 150]) < 60
    assert np.linalg.norm(path[:, [0, 2]] - [150, 0], axis=1).min() < 60
    assert np.linalg.norm(path[:, [0, 2]] - [0, 150], axis=1).min() > 60
    assert session.figure("base", "m4")["frames"] == motion.n_frames


def test_state_has_only_json_numbers(session):
    do(session, "add_constraint", id="m1", constraint=AVOID)
    do(session, "keep", id="m2", isKept=True)
    state = json.loads(json.dumps(session.state(), allow_nan=False))
    assert state["motions"][0]["apart"] > 0
    assert state["motions"][0]["constraints"][0]["shape"]["kind"] == "sphere"
    assert state["undo"] == "keep one_graft2 for export"


def test_threads_get_answers_while_motions_and_libraries_are_made(make_session, dances):
    session = make_session(("one.bvh",))
    do(session, "make", count=2)
    is_over = threading.Event()
    questions = (
        session.state,
        lambda: session.figure("motion", "m1"),
        lambda: session.figure("base", "m2"),
        lambda: session.donors({"id": "m1", "group": "larm", "first": 20, "last": 50}),
        lambda: session.window("one", 0, 20),
        lambda: session.do({"action": "mark", "id": "m2", "mark": "star"}),
    )

    def ask(question):
        while not is_over.is_set():
            try:
                question()
            except ValueError as error:
                if "not ready" not in str(error):
                    raise

    pool = ThreadPoolExecutor(len(questions))
    asked = [pool.submit(ask, own) for own in questions]
    pool.shutdown(wait=False)
    try:
        session.open([dances / "two.bvh"])
        session.do({"action": "set_groups", "preset": "lower_torso_arms"})
        session.do({"action": "regenerate", "id": "m1", "group": None, "first": 0, "last": 100})
        session.do({"action": "undo"})
        session.flush()
        session.do({"action": "make", "base": "two", "count": 2})
    finally:
        is_over.set()
    for own in asked:
        own.result(30)


@pytest.mark.parametrize("format_", ["csv", "npz", "glb"])
def test_export_writes_a_file_of_each_motion(session, tmp_path, format_):
    for motion in ("m1", "m2"):
        do(session, "keep", id=motion, isKept=True)
    files = session.export({"format": format_, "folder": "each"})["files"]
    assert files == [f"each/one_graft1.{format_}", f"each/one_graft2.{format_}"]
    if format_ != "csv":
        (read,) = mg.read(f"{tmp_path / files[0]}#one_graft1")
        assert read.n_frames == graft_of(session, "m1").motion.n_frames


def test_export_into_another_character_can_be_replayed(session, dances, tmp_path):
    mg.write(mg.read(dances / "two.bvh")[0], tmp_path / "character.glb")
    do(session, "set_character", path="character.glb")
    assert session.character() is None  # it has bones and no mesh
    do(session, "keep", id="m1", isKept=True)
    (file,) = session.export({"format": "glb", "into": True})["files"]
    assert [own.name for own in mg.read(tmp_path / file)] == ["two", "one_graft1"]
    again = mg.replay(f"{tmp_path / file}#one_graft1")
    assert hash_poses(again.motion) == hash_poses(graft_of(session, "m1").motion)


def test_stored_library_opens_alone_and_makes_the_same_motions(session, make_session, dances):
    known = [hash_poses(graft_of(session, own).motion) for own in ("m1", "m2", "m3")]
    session.close()
    path = session.folder / "dances.mograft"
    mg.Library.index([str(dances)], path)
    stored = make_session((path,))
    do(stored, "make", base="one", count=3)
    assert [hash_poses(graft_of(stored, own).motion) for own in ("m1", "m2", "m3")] == known
    with pytest.raises(ValueError, match="groups of a stored library"):
        do(stored, "set_groups", preset="lower_torso_arms")
    do(stored, "ban", **segment_of(stored, "m1", 4))
    stored.open([dances / "one.bvh"])
    stored.flush()
    assert "open it alone" in stored.state()["library"]["message"]


@pytest.mark.parametrize("name", ["glb/kaykit_Knight.glb", "fbx/quaternius_Male_Casual.fbx"])
def test_figures_have_the_mesh_of_their_file(make_session, name):
    path = DATA / name
    if not path.exists():
        pytest.skip("no recordings")
    if path.suffix == ".fbx":
        pytest.importorskip("mograft_fbx")
    session = make_session((path,))
    clips = session.state()["clips"]
    assert session.state()["sources"][0]["clips"] == len(clips) > 5
    mesh = session.character()
    figure = session.figure("clip", clips[0]["name"])
    assert figure["character"] == 0
    assert len(mesh["inverses"]) == len(session.state()["skeleton"]["joints"])
    assert mesh["parts"]


def test_project_with_a_damaged_record_is_refused_and_kept(session, tmp_path):
    session.flush()
    document = json.loads(session.file.path.read_text())
    key = session.project.motion("m2").record
    del document["records"][key]["config"]
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(document))
    for _ in range(2):  # the first refusal leaves no lock
        with pytest.raises(FormatError, match="'config' is missing") as error:
            Session(tmp_path, path)
    assert error.value.place == f"records.{key}"
    assert json.loads(path.read_text()) == document


def test_records_that_no_step_needs_are_forgotten(session, monkeypatch):
    monkeypatch.setattr("mograft.studio.workshop._MAX_UNUSED", 0)
    monkeypatch.setattr("mograft.studio.project.MAX_STEPS", 3)
    for number in range(12):
        do(session, "rename", id="m1", name=f"name {number}")
    assert len(session.workshop.texts) <= 2 * 6  # of m1 at four steps, of m2 and of m3
    for number in (10, 9, 8):
        do(session, "undo")
        assert session.figure("motion", "m1")["name"] == f"name {number}"


def test_locks_are_those_of_whole_segments(session):
    cut = [segment_of(session, "m1", number) for number in range(8)]
    middle = (cut[2]["first"] + cut[2]["last"]) // 2
    do(session, "lock", id="m1", group="upper", first=middle, last=cut[5]["last"])
    do(session, "lock", **cut[6])
    locks = session.project.motion("m1").locks
    assert locks == (("upper", cut[2]["first"], cut[6]["last"]),)
    do(session, "unlock", id="m1", group=None, first=cut[4]["first"] + 1, last=cut[4]["last"] - 1)
    assert session.project.motion("m1").locks == (
        ("upper", cut[2]["first"], cut[3]["last"]),
        ("upper", cut[5]["first"], cut[6]["last"]),
    )
