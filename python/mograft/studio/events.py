"""Server-sent events: what a session reports, to every page that listens."""

import asyncio
import json
from collections.abc import AsyncIterator, Mapping
from contextlib import suppress
from typing import Any

from mograft.studio.security import Refusal
from mograft.studio.session import Session

HEARTBEAT_SECONDS = 5.0
MAX_LISTENERS = 16
_MAX_WAITING = 64


class Events:
    """The listeners of a session's events."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._listeners: set[asyncio.Queue[Mapping[str, Any]]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None  # that of the listeners
        session.subscribe(self._pass_on)

    def _pass_on(self, event: Mapping[str, Any]) -> None:
        if self._loop is not None:
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._publish, event)

    def _publish(self, event: Mapping[str, Any]) -> None:
        for queue in self._listeners:
            if queue.full():  # a page that does not read; it reads the state again later
                while not queue.empty():
                    queue.get_nowait()
                event = self._state()
            queue.put_nowait(event)

    def _state(self) -> dict[str, Any]:
        return {"kind": "state", "revision": self._session.revision}

    def check_capacity(self) -> None:
        """Raise Refusal if too many pages listen."""
        if len(self._listeners) >= MAX_LISTENERS:
            raise Refusal(503, "busy", f"{MAX_LISTENERS} pages are connected already")

    async def stream(self) -> AsyncIterator[str]:
        """Yield events in the syntax of ``text/event-stream``, and a heartbeat in pauses."""
        self._loop = asyncio.get_running_loop()
        queue: asyncio.Queue[Mapping[str, Any]] = asyncio.Queue(_MAX_WAITING)
        self._listeners.add(queue)
        try:
            event: Mapping[str, Any] = self._state()
            while True:
                yield f"data: {json.dumps(event)}\n\n"
                try:
                    event = await asyncio.wait_for(queue.get(), HEARTBEAT_SECONDS)
                except TimeoutError:
                    event = {"kind": "ping", "revision": self._session.revision}
        finally:
            self._listeners.discard(queue)
