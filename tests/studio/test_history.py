"""Random actions with undo and redo: the state is that of a replay of the actions."""

import json
import shutil
import tempfile
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

import mograft as mg
from mograft.dancer import dance
from mograft.library.origin import hash_poses
from mograft.studio import sources
from mograft.studio.actions.editing import is_locked
from mograft.studio.session import Session
from tests.studio.conftest import build_once
from tests.studio.test_app import running
from tests.studio.test_session import AVOID, REACH

N_FRAMES = 150
frames = st.tuples(st.integers(0, N_FRAMES - 1), st.integers(0, N_FRAMES - 1)).map(sorted)
groups = st.sampled_from([None, "upper"])
number = st.integers(0, 3)
constraints = st.sampled_from([AVOID, {**AVOID, "frames": [0, 40]}, REACH])


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """Return a motion file; its library is that of all sessions of this module."""
    path = tmp_path_factory.mktemp("clip") / "clip.bvh"
    mg.write(replace(dance(seed=0, strides=1).motion[:N_FRAMES], name="clip"), path)
    return path


@pytest.fixture(scope="module", autouse=True)
def _machine(clip):
    Actions.clip = clip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sources, "build", build_once({}))
        yield


def open_session(folder, name):
    session = Session(folder, folder / name)
    session.open([Actions.clip])
    session.flush()
    return session


class ServedSession:
    """A session whose actions are requests to a server of it."""

    def __init__(self, session):
        self._session, self._stack = session, ExitStack()
        self._client, *_ = self._stack.enter_context(running(session.folder, session=session))

    def __getattr__(self, name):
        return getattr(self._session, name)

    def do(self, action, revision=None):
        reply = self._client.post("/api/do", json={**action, "revision": revision})
        if reply.status_code != 200:
            assert reply.status_code == 400, reply.text
            raise ValueError(reply.json()["error"])
        shown = self._client.get("/api/state").json()
        assert shown == json.loads(json.dumps(self._session.state()))
        assert reply.json()["revision"] == shown["revision"]

    def close(self):
        self._stack.close()
        self._session.close()


class Actions(RuleBasedStateMachine):
    """Actions on a session by requests, and the log of those that were done."""

    clip: Path

    def __init__(self):
        super().__init__()
        self.folder = Path(tempfile.mkdtemp())
        self.session = ServedSession(open_session(self.folder, "a.json"))
        self.log, self.past, self.future, self.locked = [], [], [], {}
        self.do(action="make", count=2)

    def do(self, **action):
        """Do an action; one that is refused must change nothing."""
        before = self.session.project, self.session.history
        try:
            self.session.do(action, self.session.revision)
        except ValueError:
            assert (self.session.project, self.session.history) == before
        else:
            self.log.append(action)
            self.compare(action["action"], before[0])

    def compare(self, action, old):
        """Compare the project after a step with those that the steps before it left."""
        present = self.session.project
        if action == "undo":
            assert present == self.past.pop()
            self.future.append(old)
        elif action == "redo":
            assert present == self.future.pop()
            self.past.append(old)
        elif present != old:
            self.past.append(old)
            self.future.clear()

    def motion(self, index):
        motions = self.session.project.motions
        return motions[index % len(motions)].id

    has_motion = precondition(lambda self: self.session.project.motions)

    @precondition(lambda self: len(self.session.project.motions) < 6)
    @rule(count=st.integers(1, 2), variety=st.none() | st.floats(0, 1))
    def make(self, count, variety):
        self.do(action="make", count=count, variety=variety)

    @precondition(lambda self: 0 < len(self.session.project.motions) < 6)
    @rule(index=number)
    def more_like(self, index):
        self.do(action="more_like", id=self.motion(index), count=1)

    @has_motion
    @rule(
        index=number,
        name=st.sampled_from(["ban", "restore", "regenerate", "lock", "unlock", "change"]),
        group=groups,
        span=frames,
    )
    def edit(self, index, name, group, span):
        group = group or ("upper" if name in ("lock", "change") else None)
        place = {"group": group, "first": span[0], "last": span[1]}
        self.do(action=name, id=self.motion(index), **place)

    @has_motion
    @rule(index=number, position=st.integers(0, 9), rank=st.integers(0, 9))
    def take(self, index, position, rank):
        motion = self.motion(index)
        graft = self.session.workshop.graft(self.session.project.motion(motion).record)
        own = graft.substitutions[position % len(graft.substitutions)]
        place = {"id": motion, "group": own.group, "first": own.start, "last": own.stop}
        listed = self.session.donors(place)["donors"]
        donor = listed[rank % len(listed)]
        span = {"clip": donor["clip"], "from": donor["first"], "to": donor["last"]}
        self.do(action="take", **place, **span)

    @has_motion
    @rule(index=number, constraint=constraints)
    def add_constraint(self, index, constraint):
        self.do(action="add_constraint", id=self.motion(index), constraint=constraint)

    @has_motion
    @rule(index=number, at=st.integers(0, 1), constraint=constraints, preview=st.booleans())
    def set_constraint(self, index, at, constraint, preview):
        fields = {"id": self.motion(index), "number": at, "constraint": constraint}
        self.do(action="set_constraint", preview=preview, **fields)

    @has_motion
    @rule(index=number, at=st.integers(0, 1))
    def drop_constraint(self, index, at):
        self.do(action="drop_constraint", id=self.motion(index), number=at)

    @has_motion
    @rule(index=number, mark=st.sampled_from([None, "star", "reject"]), is_kept=st.booleans())
    def mark(self, index, mark, is_kept):
        self.do(action="mark", id=self.motion(index), mark=mark)
        self.do(action="keep", id=self.motion(index), isKept=is_kept)

    @has_motion
    @rule(index=number, name=st.sampled_from(["a", "b", "ä/ö"]))
    def rename(self, index, name):
        self.do(action="rename", id=self.motion(index), name=name)

    @has_motion
    @rule(index=number)
    def remove(self, index):
        self.do(action="remove", ids=[self.motion(index)])

    @rule(name=st.sampled_from(["undo", "redo"]), count=st.integers(1, 3))
    def step(self, name, count):
        for _ in range(count):
            self.do(action=name)

    @precondition(lambda self: self.session.history.past)
    @rule()
    def undo_then_redo(self):
        before = self.session.project, self.session.history
        self.do(action="undo")
        self.do(action="redo")
        assert (self.session.project, self.session.history) == before

    @invariant()
    def locks_keep_donors(self):
        """Locked segments keep their donors until they are unlocked."""
        locked = {}
        for own in self.session.project.motions:
            graft = self.session.workshop.graft(own.record)
            for group, donors in graft.donors.items():
                for at in is_locked(graft, group, own.locks).nonzero()[0].tolist():
                    locked[own.id, group, at] = donors[at]
        if self.log and self.log[-1]["action"] not in ("undo", "redo"):
            assert all(locked[key] == old for key, old in self.locked.items() if key in locked)
        self.locked = locked

    def teardown(self):
        """Compare the session with one that does the same actions, and with its file."""
        session = self.session
        try:
            for own in session.project.motions:
                record = session.workshop.record(own.record)
                graft = session.workshop.graft(own.record)
                assert hash_poses(mg.replay(record).motion) == hash_poses(graft.motion)
            other = open_session(self.folder, "b.json")
            for action in self.log:
                other.do(action)
            assert (other.project, other.history) == (session.project, session.history)
            other.close()
            session.close()
            again = Session(self.folder, self.folder / "a.json")
            assert (again.project, again.history) == (session.project, session.history)
            again.close()
        finally:
            session.close()
            shutil.rmtree(self.folder)


FEW = settings(max_examples=8, stateful_step_count=15, deadline=None, phases=[Phase.generate])


class TestActions(Actions.TestCase):
    settings = FEW


@pytest.mark.thorough
class TestManyActions(Actions.TestCase):
    settings = settings(FEW, max_examples=40, stateful_step_count=50)
