"""`StudioServer`: the studio on a port of this computer, in a thread."""

import asyncio
import errno
import socket
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from mograft.studio.app import create_app
from mograft.studio.security import Places, Token
from mograft.studio.session import Session

MAX_CONNECTIONS = 64
_REQUEST_SECONDS = 10.0
"""Time for the first line and the headers of the first request of a connection."""

_KEPT_SECONDS = 30
_MAX_HEADER_BYTES = 65_536


class StudioServer:
    """A server of one session, on 127.0.0.1 only.

    Parameters
    ----------
    session : Session
        The session that pages show and change.
    folder : Path
        The folder of the session, the only one in which files are written.
    given : sequence of Path
        Files and folders that pages may open, too.
    port : int
        The port; 0 selects a free port.
    report : callable
        Called with a line for each refused request.

    Raises
    ------
    OSError
        If the port is in use.
    """

    def __init__(
        self,
        session: Session,
        folder: Path,
        given: Sequence[Path] = (),
        port: int = 0,
        *,
        report: Callable[[str], None],
    ) -> None:
        self._socket = _listen(port)
        self.token = Token(self._socket.getsockname()[1])
        self.url = self.token.url  # the address that opens the page
        app = create_app(session, self.token, Places(folder, given), report)
        config = uvicorn.Config(
            app,
            http=_limited_protocol(report),
            ws="none",
            loop="asyncio",
            lifespan="off",
            log_config=None,
            log_level="critical",
            access_log=False,
            server_header=False,
            h11_max_incomplete_event_size=_MAX_HEADER_BYTES,
            timeout_keep_alive=_KEPT_SECONDS,
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)
        # Not the main thread: uvicorn would set handlers of signals there.
        self._thread = threading.Thread(target=self._run, name="studio server", daemon=True)

    def _run(self) -> None:
        asyncio.run(self._server.serve(sockets=[self._socket]))

    def __enter__(self) -> Self:
        """Serve pages until the block ends."""
        self._thread.start()
        return self

    def wait(self) -> None:
        """Wait until the server ends."""
        self._thread.join()

    def __exit__(self, *_: object) -> None:
        self._server.should_exit = True
        self._thread.join()


def _listen(port: int) -> socket.socket:
    try:
        return socket.create_server(("127.0.0.1", port), backlog=128)
    except OSError as error:
        if error.errno not in (errno.EADDRINUSE, errno.EACCES):
            raise
        raise OSError(f"port {port} is not free; choose another one, or 0 for any") from error


def _limited_protocol(report: Callable[[str], None]) -> type[H11Protocol]:
    """Return the protocol of uvicorn with a limit of connections, and of time for a request."""

    class LimitedProtocol(H11Protocol):
        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            if len(self.connections) > MAX_CONNECTIONS:
                report(f"connection refused: {MAX_CONNECTIONS} are open")
                transport.close()
            else:
                self.loop.call_later(_REQUEST_SECONDS, self.close_if_silent)

        def close_if_silent(self) -> None:
            """Close the connection if its first request has not arrived."""
            if self.conn.their_state is h11.IDLE and self.cycle is None:
                self.transport.close()

    return LimitedProtocol
