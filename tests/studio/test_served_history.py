"""Random actions by requests to the server: the state is that of a replay of the actions."""

import json

import httpx
import pytest
from hypothesis import Phase, settings
from hypothesis.stateful import run_state_machine_as_test

from mograft.studio.server import StudioServer
from tests.studio.test_history import Actions, _machine, clip  # noqa: F401 - fixtures


class ServedSession:
    """A session whose actions are requests to a server of it."""

    def __init__(self, session):
        self._session = session
        self._server = StudioServer(session, session.folder, report=lambda _: None).__enter__()
        origin = self._server.url.partition("/?")[0]
        self._client = httpx.Client(base_url=origin, headers={"origin": origin}, timeout=60)
        self._client.get(self._server.url)

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
        return reply.json()

    def close(self):
        self._client.close()
        self._server.__exit__()
        self._session.close()


class ServedActions(Actions):
    """The actions of `test_history`, by requests."""

    def __init__(self):
        super().__init__()
        self.session = ServedSession(self.session)


TestServedActions = ServedActions.TestCase
TestServedActions.settings = settings(
    max_examples=3, stateful_step_count=15, deadline=None, phases=[Phase.generate]
)


@pytest.mark.thorough
def test_2000_random_requests_equal_their_replay():
    run_state_machine_as_test(
        ServedActions,
        settings=settings(
            max_examples=20, stateful_step_count=100, deadline=None, phases=[Phase.generate]
        ),
    )
