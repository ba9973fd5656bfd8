"""The project file: it is read as it was written, and damage is named by file and key."""

import json
from dataclasses import replace
from functools import reduce
from operator import getitem

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft.errors import FormatError
from mograft.provenance.document import SCHEMA
from mograft.studio.project import (
    MARKS,
    MAX_STEPS,
    History,
    Lock,
    Project,
    ProjectInput,
    ProjectMotion,
    project_text,
    read_project,
    record_key,
)
from mograft.studio.project_file import ProjectFile

RECORDS = [{"schema": SCHEMA, "name": f"new {number}", "clips": []} for number in range(3)]
KEYS = [record_key(own)[0] for own in RECORDS]
TEXTS = dict(zip(KEYS, map(json.dumps, RECORDS), strict=True))

names = st.text(max_size=8)
frames = st.tuples(st.integers(0, 99), st.integers(0, 99)).map(sorted)
locks = st.builds(lambda group, span: Lock(group, *span), names, frames)
motions = st.builds(
    ProjectMotion,
    id=st.integers(0, 30).map("m{}".format),
    record=st.sampled_from(KEYS),
    mark=st.sampled_from([None, *MARKS]),
    is_kept=st.booleans(),
    locks=st.lists(locks, max_size=2).map(tuple),
)
projects = st.builds(
    Project,
    inputs=st.lists(st.builds(ProjectInput, path=names, sha256=st.none() | names), max_size=2).map(
        tuple
    ),
    groups=st.sampled_from(["lower_upper", 'base = "a"\n[groups]\na = [0]\nb = [1]\n']),
    config=st.sampled_from([{}, {"novelty": 2.0, "loop": "on"}]),
    character=st.none() | names,
    motions=st.lists(motions, max_size=3, unique_by=lambda own: own.id).map(tuple),
    n_made=st.integers(0, 1000),
)
steps = st.lists(st.tuples(names, projects), max_size=3).map(tuple)


def write(path, project, history=None):
    text = project_text(project, history or History(), TEXTS, path.parent.resolve())
    path.write_text(text, encoding="utf-8")
    return path


@given(project=projects, past=steps, future=steps)
def test_project_file_is_read_as_it_was_written(tmp_path_factory, project, past, future):
    history = History(past, future)
    path = write(tmp_path_factory.getbasetemp() / "project.json", project, history)
    found = read_project(path)
    assert found == (project, history, {key: RECORDS[KEYS.index(key)] for key in found[2]})


def test_only_the_last_steps_of_a_file_are_read(tmp_path):
    past = tuple((f"step {number}", Project(n_made=number)) for number in range(MAX_STEPS + 3))
    path = write(tmp_path / "a.json", Project(), History(past, past[:1]))
    assert read_project(path)[1] == History(past[3:], past[:1])


def test_save_after_close_is_left_out(tmp_path):
    reports = []
    file = ProjectFile(tmp_path / "a.json", reports.append)
    for text in ("first", "last"):
        file.save(lambda text=text: text)
    file.close()
    file.save(lambda: "late")
    assert (file.path.read_text(), reports) == ("last", [])


def test_history_undoes_the_last_steps_and_no_more():
    history, present = History(), Project()
    for number in range(1, MAX_STEPS + 5):
        history, present = history.push(str(number), present), Project(n_made=number)
    with pytest.raises(ValueError, match="nothing to redo"):
        history.move("redo", present)
    for number in reversed(range(4, MAX_STEPS + 4)):
        history, present, _ = history.move("undo", present)
        assert present.n_made == number
    with pytest.raises(ValueError, match="nothing to undo"):
        history.move("undo", present)


FULL = Project(
    inputs=(ProjectInput(path="/a.bvh", sha256="0"),),
    motions=(ProjectMotion(id="m1", record=KEYS[0], locks=(Lock("upper", 0, 9),)),),
)


MISSING = object()


@pytest.mark.parametrize(
    ("place", "value", "key"),
    [
        (["format"], "mograft.project/9", "format"),
        (["records"], MISSING, "records"),
        (["records", KEYS[0]], {}, f"records.{KEYS[0]}"),
        (["project"], [], "project"),
        (["project", "inputs", 0, "path"], 3, "project.inputs[0].path"),
        (["project", "config"], {"novelty": -1}, "project.config"),
        (["project", "groups"], "nonsense", "project.groups"),
        (["project", "motions", 0, "record"], "no", "motions[0].record"),
        (["project", "motions", 0, "mark"], "good", "motions[0].mark"),
        (["project", "motions", 0, "locks"], [["a", 5, 2]], "locks[0]"),
        (["future"], [["x", {}]], "future[0][1].inputs"),
    ],
)
def test_damaged_project_raises_error_with_file_and_key(tmp_path, place, value, key):
    path = write(tmp_path / "project.json", FULL)
    document = json.loads(path.read_text())
    parent = reduce(getitem, place[:-1], document)
    if value is MISSING:
        del parent[place[-1]]
    else:
        parent[place[-1]] = value
    path.write_text(json.dumps(document))
    with pytest.raises(FormatError) as error:
        read_project(path)
    assert str(path) in str(error.value)
    assert key in error.value.place


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | names,
    lambda own: st.lists(own, max_size=2) | st.dictionaries(names, own, max_size=2),
    max_leaves=4,
)


@given(data=st.data(), value=json_values)
def test_any_value_anywhere_is_read_or_named(tmp_path_factory, data, value):
    path = write(tmp_path_factory.getbasetemp() / "damaged.json", FULL, History((("x", FULL),)))
    document = own = json.loads(path.read_text())
    while True:
        keys = list(own) if isinstance(own, dict) else list(range(len(own)))
        key = data.draw(st.sampled_from(keys))
        if not (isinstance(own[key], dict | list) and own[key] and data.draw(st.booleans())):
            break
        own = own[key]
    own[key] = value
    path.write_text(json.dumps(document))
    try:
        read_project(path)
    except FormatError as error:
        assert error.place and str(path) in str(error)  # noqa: PT017, PT018 - others are valid


def test_truncated_project_raises_error_with_file(tmp_path):
    path = write(tmp_path / "project.json", FULL)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(FormatError, match=r"project\.json: expected JSON"):
        read_project(path)


def test_moved_project_finds_the_files_that_moved_with_it(tmp_path):
    old, new = tmp_path / "old", tmp_path / "new"
    old.mkdir()
    (old / "a.bvh").touch()
    record = {**RECORDS[0], "clips": [{"file": "a.bvh"}]}
    key, text = record_key(record)
    project = replace(
        FULL,
        inputs=(ProjectInput(path=str(old / "a.bvh")),),
        motions=(ProjectMotion(id="m1", record=key),),
    )
    path = old / "project.json"
    path.write_text(project_text(project, History(), {key: text}, old))
    old.rename(new)
    moved, _, records = read_project(new / "project.json")
    assert moved.inputs[0].path == str(new / "a.bvh")
    assert records[key] == record
