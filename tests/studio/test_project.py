"""The project file: it is read as it was written, and damage is named by file and key."""

import json
from dataclasses import replace

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
    mark=st.sampled_from(MARKS),
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
    distinct=st.floats(0, 180),
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
    own, read_history, records = read_project(path)
    assert (own, read_history) == (project, history)
    assert {key: RECORDS[KEYS.index(key)] for key in records} == records


@given(edits=st.lists(st.tuples(names, projects), min_size=1, max_size=4), n=st.integers(1, 4))
def test_undo_then_redo_is_identity(edits, n):
    present, history = Project(), History()
    for text, project in edits:
        history, present = history.push(text, present), project
    before = history, present
    n = min(n, len(edits))
    for _ in range(n):
        history, present, _ = history.undo(present)
    assert present == [Project(), *(own for _, own in edits)][len(edits) - n]
    for _ in range(n):
        history, present, _ = history.redo(present)
    assert (history, present) == before


def test_history_without_steps_refuses_undo_and_redo():
    for move in (History().undo, History().redo):
        with pytest.raises(ValueError, match="nothing to"):
            move(Project())


def test_history_keeps_the_last_steps():
    history = History()
    for number in range(MAX_STEPS + 5):
        history = history.push(str(number), Project(n_made=number))
    assert [own.n_made for own in history.projects] == list(range(5, MAX_STEPS + 5))


FULL = Project(
    inputs=(ProjectInput(path="/a.bvh", sha256="0"),),
    motions=(ProjectMotion(id="m1", record=KEYS[0], locks=(Lock("upper", 0, 9),)),),
)


def delete(document, *path):
    *above, last = path
    for key in above:
        document = document[key]
    del document[last]


def put(document, value, *path):
    *above, last = path
    for key in above:
        document = document[key]
    document[last] = value


@pytest.mark.parametrize(
    ("damage", "key"),
    [
        (lambda own: put(own, "mograft.project/9", "format"), "format"),
        (lambda own: delete(own, "records"), "records"),
        (lambda own: put(own, {}, "records", KEYS[0]), f"records.{KEYS[0]}"),
        (lambda own: delete(own, "folder"), "folder"),
        (lambda own: put(own, [], "project"), "project"),
        (lambda own: put(own, 3, "project", "inputs", 0, "path"), "project.inputs[0].path"),
        (lambda own: put(own, {"novelty": -1}, "project", "config"), "project.config"),
        (lambda own: put(own, "nonsense", "project", "groups"), "project.groups"),
        (lambda own: put(own, "x", "project", "distinct"), "project.distinct"),
        (lambda own: put(own, "1", "project", "n_made"), "project.n_made"),
        (lambda own: put(own, "no", "project", "motions", 0, "record"), "motions[0].record"),
        (lambda own: put(own, "good", "project", "motions", 0, "mark"), "motions[0].mark"),
        (lambda own: put(own, [["a", 5, 2]], "project", "motions", 0, "locks"), "locks[0]"),
        (lambda own: put(own, ["x"], "past"), "past[0]"),
        (lambda own: put(own, [["x", {}]], "future"), "future[0].inputs"),
    ],
)
def test_damaged_project_raises_error_with_file_and_key(tmp_path, damage, key):
    path = write(tmp_path / "project.json", FULL)
    document = json.loads(path.read_text())
    damage(document)
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
    found = None
    try:
        read_project(path)
    except FormatError as error:
        found = error
    assert found is None or (found.place and str(path) in str(found))


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
