"""`StreamServer`: streams for clients on a TCP or Unix socket, one thread per connection."""

import errno
import ipaddress
import os
import socket
import socketserver
import sys
import threading
import time
import traceback
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self

from mograft._util.signals import clean_up_by
from mograft.library.library import Library
from mograft.stream.session import FrameError, Message, RequestError, StreamSession, read_request
from mograft.stream.stream import check_stream_config


@dataclass(frozen=True, kw_only=True)
class ServerLimits:
    """The limits of a stream server."""

    idle_seconds: float = 600.0  # largest pause between two messages of a client
    message_seconds: float = 10.0  # to receive a message after its first byte, and to send a reply
    # To discard input before a connection is closed: some systems discard the last reply if a
    # socket is closed while it holds input.
    drain_seconds: float = 1.0
    max_connections: int = 16


class StreamServer(socketserver.ThreadingTCPServer):
    """A server of the protocol ``mograft.stream/1``; docs/howto/stream.md describes it.

    Every connection has its own stream. An invalid request receives an error as its reply; no
    request ends the server.

    Parameters
    ----------
    library : Library
        The library whose segments are the donors of all streams.
    address : tuple of str and int, or path
        Host and port of a TCP socket, where port 0 selects a free port; or, as a `pathlib.Path`,
        the path of a Unix socket, which only the current user may open.
    limits : ServerLimits
        Timeouts and the largest number of connections.

    Raises
    ------
    FileExistsError
        If the path exists and is not the socket of a server that has ended.
    OSError
        If the address cannot be used.
    ValueError
        If a stream does not support the library's `Config.segmentation`.
    """

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = os.name != "nt"  # Windows would share the port with another server
    request_queue_size = 64

    def __init__(
        self,
        library: Library,
        address: tuple[str, int] | Path = ("127.0.0.1", 0),
        limits: ServerLimits | None = None,
    ) -> None:
        check_stream_config(library.config)
        self.library = library
        self.limits = limits or ServerLimits()
        self.free_connections = threading.Semaphore(self.limits.max_connections)
        target: Any = address
        with ExitStack() as stack:
            if not isinstance(address, Path):
                self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
            elif hasattr(socket, "AF_UNIX"):
                self.address_family, target = socket.AF_UNIX, str(address)
                _remove_dead_socket(address)
                # Before the socket is made: a signal may end the process at any time.
                stack.enter_context(clean_up_by(partial(address.unlink, missing_ok=True)))
            else:
                raise OSError("this system has no Unix sockets; use a port")
            mask = os.umask(0o177)  # only the current user may open the Unix socket
            try:
                super().__init__(target, _Connection)
            finally:
                os.umask(mask)
            stack.callback(self.server_close)
            self._cleanup = stack.pop_all()  # closes the server first

    @property
    def address(self) -> str:
        """The path of the Unix socket, or host and port as ``HOST:PORT``."""
        if isinstance(self.server_address, str):
            return self.server_address
        host = str(self.server_address[0])
        return f"[{host}]:{self.port}" if ":" in host else f"{host}:{self.port}"

    @property
    def port(self) -> int:
        """The port of a TCP socket; 0 for a Unix socket."""
        return 0 if isinstance(self.server_address, str) else int(self.server_address[1])

    def serve_forever(self, poll_interval: float = 0.1) -> None:
        """Serve clients until `shutdown` is called in another thread, or an exception is raised.

        `poll_interval` is the time in seconds after which `shutdown` is noticed.
        """
        with self._cleanup:
            super().serve_forever(poll_interval)

    def __enter__(self) -> Self:
        """Serve clients in a thread until the block ends."""
        self._thread = threading.Thread(target=self.serve_forever, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.shutdown()
        self._thread.join()


class _Connection(socketserver.BaseRequestHandler):
    """The socket of one client."""

    server: StreamServer
    _deadline = 0.0

    def handle(self) -> None:
        """Reply to the requests of a client until it disconnects or a limit is exceeded."""
        self._socket, self._limits = self.request, self.server.limits
        if self._socket.family in (socket.AF_INET, socket.AF_INET6):
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if not self.server.free_connections.acquire(blocking=False):
            self.refuse("busy", f"{self._limits.max_connections} connections are open")
            return
        try:
            self.serve(StreamSession(self.server.library))
        finally:
            self.server.free_connections.release()

    def serve(self, session: StreamSession) -> None:
        """Reply until the client disconnects, is silent too long or sends an invalid message."""
        try:
            while self._wait_for_message():
                try:
                    reply = session.reply(read_request(self._receive))
                except RequestError as error:
                    reply = _error("request", str(error))
                self._send(reply, session.dtype)
        except FrameError as error:
            self.refuse("frame", str(error))
        except TimeoutError:
            self.refuse("timeout", "no complete message arrived in time")
        except ConnectionError:
            pass  # the client has disconnected
        except Exception as error:  # one client must not end the others
            traceback.print_exc(file=sys.stderr)
            self.refuse("internal", f"{type(error).__name__}: {error}")

    def refuse(self, code: str, message: str) -> None:
        """Send an error and end the connection; discard input so that the error arrives."""
        try:
            self._send(_error(code, message, is_open=False), "float32")
            self._socket.shutdown(socket.SHUT_WR)
            self._deadline = time.monotonic() + self._limits.drain_seconds
            while self._receive_some(65_536):
                pass
        except OSError:
            pass  # the client has disconnected, or does not read

    def _wait_for_message(self) -> bool:
        """Wait for the first byte of a message; return False if the client disconnects instead."""
        self._deadline = time.monotonic() + self._limits.idle_seconds
        is_open = bool(self._receive_some(1, socket.MSG_PEEK))
        self._deadline = time.monotonic() + self._limits.message_seconds
        return is_open

    def _receive(self, n_bytes: int) -> bytes:
        """Return the next `n_bytes`; raise ConnectionError if the client disconnects first."""
        data = bytearray()
        while len(data) < n_bytes:
            part = self._receive_some(min(n_bytes - len(data), 1 << 20))
            if not part:
                raise ConnectionResetError("the client disconnected within a message")
            data += part
        return bytes(data)

    def _receive_some(self, n_bytes: int, flags: int = 0) -> bytes:
        remaining = self._deadline - time.monotonic()
        if remaining <= 0:
            raise TimeoutError
        self._socket.settimeout(remaining)
        return self._socket.recv(n_bytes, flags)

    def _send(self, reply: Message, dtype: str) -> None:
        self._socket.settimeout(self._limits.message_seconds)
        self._socket.sendall(reply.encode(dtype))


def _error(code: str, message: str, *, is_open: bool = True) -> Message:
    return Message({"type": "error", "code": code, "message": message, "is_open": is_open})


def _remove_dead_socket(path: Path) -> None:
    """Remove the socket of a server that has ended; raise FileExistsError for anything else."""
    if not path.exists() and not path.is_symlink():
        return
    if path.is_socket():
        with socket.socket(socket.AF_UNIX) as probe:
            probe.settimeout(1.0)
            # Other errors, such as a full queue, do not mean that the server has ended.
            if probe.connect_ex(str(path)) == errno.ECONNREFUSED:
                path.unlink()
                return
    raise FileExistsError(17, "exists; the socket needs a new path", str(path))


def is_loopback(host: str) -> bool:
    """Return whether only programs on this computer can connect to a host."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
