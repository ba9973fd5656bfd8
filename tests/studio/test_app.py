"""Requests of the page: what reaches the session, and which errors come back."""

import asyncio
import contextlib
import json
import threading

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft.errors import FormatError
from mograft.studio.events import Events
from mograft.studio.server import StudioServer
from mograft.studio.session import StaleRevision
from tests.studio.fake_session import FakeSession


@contextlib.contextmanager
def running(folder, given=(), session=None):
    """Serve a session; yield a client with the cookie, the session and the reports."""
    session, reports = session or FakeSession(), []
    with StudioServer(session, folder, given, report=reports.append) as server:
        origin = server.url.partition("/?")[0]
        with httpx.Client(base_url=origin, headers={"origin": origin}, timeout=60) as client:
            assert client.get(server.url).status_code == 303
            client.server = server
            yield client, session, reports


@pytest.fixture
def served(tmp_path):
    with running(tmp_path) as found:
        yield found


def test_page_and_scripts_are_served_with_safe_headers(served):
    client, _, _ = served
    places = {"/": "html", "/viewer/poses.js": "javascript", "/viewer/viewer.css": "css"}
    for path, kind in places.items():
        reply = client.get(path)
        assert reply.status_code == 200
        assert kind in reply.headers["content-type"]
        assert reply.headers["x-content-type-options"] == "nosniff"
        assert "default-src 'none'" in reply.headers["content-security-policy"]


@pytest.mark.parametrize(
    ("path", "document", "call"),
    [
        ("state", None, ("state",)),
        ("figure/motion/m1", None, ("figure", "motion", "m1", None)),
        ("figure/clip/a%20b%2Fc%23d?since=12", None, ("figure", "clip", "a b/c#d", "12")),
        ("character", None, ("character",)),
        ("window?clip=a%26b&first=3&last=9", None, ("window", "a&b", 3, 9)),
        ("donors", {"id": "m1"}, ("donors", {"id": "m1"})),
        ("export", {"format": "bvh"}, ("export", {"format": "bvh"})),
        ("do", {"action": "undo", "revision": 3}, ("do", {"action": "undo"}, 3)),
        ("do", {"action": "undo"}, ("do", {"action": "undo"}, None)),
    ],
)
def test_request_becomes_call_of_session(served, path, document, call):
    client, session, _ = served
    reply = client.request("POST" if document else "GET", f"/api/{path}", json=document)
    assert reply.status_code == 200, reply.text
    assert session.calls == [call]


@pytest.mark.parametrize(
    ("error", "status", "kind"),
    [
        (StaleRevision("the state has changed"), 409, "stale"),
        (FileExistsError("a.bvh exists"), 409, "exists"),
        (ValueError("`count` must be at least 1, got 0"), 400, "invalid"),
        (FormatError("expected HIERARCHY", "a.bvh"), 400, "invalid"),
        (OSError(28, "No space left on device", "x"), 400, "file"),
        (RuntimeError("damaged"), 500, "internal"),
    ],
)
def test_error_of_session_becomes_reply_and_server_goes_on(served, capsys, error, status, kind):
    client, session, reports = served
    session.error = error
    for path in ("/api/do", "/api/export"):
        reply = client.post(path, json={"action": "make"})
        assert (reply.status_code, reply.json()["kind"]) == (status, kind)
        assert str(error) in reply.json()["error"]
    assert len(reports) == 2
    session.error = None
    assert client.get("/api/state").json() == {"call": "state"}
    assert ("Traceback" in capsys.readouterr().err) == (status == 500)


def test_events_start_with_revision_and_reach_every_listener(served):
    client, session, _ = served
    session.revision = 7
    with (
        client.stream("GET", "/api/events") as first,
        client.stream("GET", "/api/events") as second,
    ):
        lines = [reply.iter_lines() for reply in (first, second)]
        heads = [json.loads(next(own).removeprefix("data: ")) for own in lines]
        assert heads == [{"kind": "state", "revision": 7}] * 2
        session.tell({"kind": "note", "text": "<b>"})
        for own in lines:
            assert next(own) == ""
            assert json.loads(next(own)[6:]) == {"kind": "note", "text": "<b>"}


@given(n_events=st.integers(0, 300))
def test_listener_that_does_not_read_gets_few_events_and_the_last_state(n_events):
    session = FakeSession()

    async def listen():
        events = Events(session)
        events.start()
        stream = events.stream()
        found = [await anext(stream)]
        session.revision = n_events
        for number in range(n_events):
            session.tell({"kind": "note", "text": str(number)})
        session.tell({"kind": "state", "revision": n_events})
        last = f'"revision": {n_events}'
        while last not in found[-1] or "state" not in found[-1]:
            found.append(await anext(stream))
            await asyncio.sleep(0.0001 * (len(found) % 3))
        await stream.aclose()
        return found

    found = asyncio.run(asyncio.wait_for(listen(), 10))
    assert all(own.startswith("data: ") and own.endswith("\n\n") for own in found)
    assert len(found) <= n_events + 2


def test_slow_call_does_not_block_other_requests(served):
    client, session, _ = served
    session.gate.clear()
    thread = threading.Thread(target=lambda: client.get("/api/state"))
    thread.start()
    try:
        assert client.get("/").status_code == 200
    finally:
        session.gate.set()
        thread.join()
