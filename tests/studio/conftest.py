"""Sessions on two short dances, whose library is built once."""

from dataclasses import replace

import pytest

import mograft as mg
from mograft.dancer import dance
from mograft.studio import sources
from mograft.studio.session import Session
from tests.browser import chromium

N_FRAMES = 300


@pytest.fixture(scope="session")
def dances(tmp_path_factory):
    """Return a folder with two motion files, ``one.bvh`` and ``two.bvh``."""
    folder = tmp_path_factory.mktemp("dances")
    for name, seed in (("one", 0), ("two", 1)):
        motion = replace(dance(seed=seed, strides=2).motion[:N_FRAMES], name=name)
        mg.write(motion, folder / f"{name}.bvh")
    return folder


@pytest.fixture(scope="session")
def known_libraries():
    """Return libraries of inputs, so that sessions need not build the same one again."""
    return {}


@pytest.fixture(scope="module")
def browser():
    """A headless Chromium."""
    with chromium() as found:
        yield found


def build_once(known):
    """Return a function that builds the library of a project, or takes it from a dict."""
    build = sources.build

    def build_unknown(project, progress):
        key = sources.library_key(project)
        if key not in known:
            known[key] = build(project, progress)
        return known[key]

    return build_unknown


@pytest.fixture
def make_session(dances, known_libraries, tmp_path, monkeypatch):
    """Return a function that opens a session on the dances, or on a project."""
    opened = []
    monkeypatch.setattr(sources, "build", build_once(known_libraries))

    def make(paths=("one.bvh", "two.bvh"), project=None, folder=tmp_path):
        session = Session(folder, project)
        opened.append(session)
        if paths:
            session.open([dances / own for own in paths])
        session.flush()
        return session

    yield make
    for session in opened:
        session.close()


@pytest.fixture
def session(make_session):
    """Return a session with three motions, m1 to m3."""
    session = make_session()
    session.do({"action": "make", "base": "one", "count": 3})
    return session
