"""Requests of the page: what reaches the session, and which errors come back."""

import asyncio
import contextlib
import json
import threading
from unittest.mock import Mock, call

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft.errors import FormatError
from mograft.studio.events import Events
from mograft.studio.server import StudioServer
from mograft.studio.session import Session, StaleRevision


def fake_session():
    """Return a session without motions, which records calls."""
    session = Mock(spec=Session, revision=0)
    for name in ("state", "figure", "character", "donors", "window", "export", "do"):
        getattr(session, name).return_value = {"call": name}
    return session


def tell(session, event):
    """Report an event, as the session does."""
    session.subscribe.call_args.args[0](event)


@contextlib.contextmanager
def running(folder, given=(), session=None):
    """Serve a session; yield a client with the cookie, the session and the reports."""
    session, reports = session or fake_session(), []
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
    ("path", "document", "expected"),
    [
        ("state", None, call.state()),
        ("figure/motion/m1", None, call.figure("motion", "m1", None)),
        ("figure/clip/a%20b%2Fc%23d?since=12", None, call.figure("clip", "a b/c#d", "12")),
        ("character", None, call.character()),
        ("window/3/9/a%26b", None, call.window(clip="a&b", first=3, last=9)),
        ("donors", {"id": "m1"}, call.donors({"id": "m1"})),
        ("export", {"format": "bvh"}, call.export({"format": "bvh"})),
        ("do", {"action": "undo", "revision": 3}, call.do({"action": "undo"}, 3)),
        ("do", {"action": "undo"}, call.do({"action": "undo"}, None)),
    ],
)
def test_request_becomes_call_of_session(served, path, document, expected):
    client, session, _ = served
    reply = client.request("POST" if document else "GET", f"/api/{path}", json=document)
    assert reply.status_code == 200, reply.text
    assert session.method_calls[1:] == [expected]  # after that of `subscribe`


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
    session.do.side_effect = session.export.side_effect = error
    for path in ("/api/do", "/api/export"):
        reply = client.post(path, json={"action": "make"})
        assert (reply.status_code, reply.json()["kind"]) == (status, kind)
        assert str(error) in reply.json()["error"]
    assert len(reports) == 2
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
        tell(session, {"kind": "note", "text": "<b>"})
        for own in lines:
            assert next(own) == ""
            assert json.loads(next(own)[6:]) == {"kind": "note", "text": "<b>"}


@given(n_events=st.integers(0, 300))
def test_listener_that_does_not_read_gets_few_events_and_the_last_state(n_events):
    session = fake_session()

    async def listen():
        events = Events(session)
        stream = events.stream()
        found = [await anext(stream)]
        session.revision = n_events
        for number in range(n_events):
            tell(session, {"kind": "note", "text": str(number)})
        tell(session, {"kind": "state", "revision": n_events})
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
    gate = threading.Event()
    session.state.side_effect = gate.wait
    thread = threading.Thread(target=lambda: client.get("/api/state"))
    thread.start()
    try:
        assert client.get("/").status_code == 200
    finally:
        gate.set()
        thread.join()
