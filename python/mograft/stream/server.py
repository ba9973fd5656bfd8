"""`StreamServer`: streams for clients on a TCP port, one thread per connection."""

import ipaddress
import os
import socket
import socketserver
import sys
import threading
import time
import traceback
from typing import Self

from mograft.library.library import Library
from mograft.stream.session import FrameError, Message, RequestError, StreamSession, read_request
from mograft.stream.stream import check_stream_config


class StreamServer(socketserver.ThreadingTCPServer):
    """A server of the protocol ``mograft.stream/1``; docs/howto/stream.md describes it.

    Every connection has its own stream. An invalid request receives an error as its reply; no
    request ends the server.

    Parameters
    ----------
    library : Library
        The library whose segments are the donors of all streams.
    address : tuple of str and int
        Host and port, where port 0 selects a free port.
    timeout : float
        Largest pause between two messages of a client, in seconds.

    Raises
    ------
    OSError
        If the address cannot be used.
    ValueError
        If a stream does not support the library's `Config.segmentation`.
    """

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = os.name != "nt"  # Windows would share the port with another server
    request_queue_size = 64
    max_connections = 16
    message_seconds = 10.0  # to receive a message after its first byte, and to send a reply
    # To discard input before a connection is closed: some systems discard the last reply if a
    # socket is closed while it holds input.
    drain_seconds = 1.0

    def __init__(
        self, library: Library, address: tuple[str, int] = ("127.0.0.1", 0), timeout: float = 600.0
    ) -> None:
        check_stream_config(library.config)
        self.library, self.idle_seconds = library, timeout
        self.free_connections = threading.Semaphore(self.max_connections)
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        super().__init__(address, _Connection)

    @property
    def address(self) -> str:
        """Host and port as ``HOST:PORT``."""
        host = str(self.server_address[0])
        return f"[{host}]:{self.port}" if ":" in host else f"{host}:{self.port}"

    @property
    def port(self) -> int:
        """The port."""
        return int(self.server_address[1])

    def serve_forever(self, poll_interval: float = 0.1) -> None:
        """Serve clients until `shutdown` is called in another thread, or an exception is raised.

        `poll_interval` is the time in seconds after which `shutdown` is noticed.
        """
        try:
            super().serve_forever(poll_interval)
        finally:
            self.server_close()

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
        self._socket, self._message_seconds = self.request, self.server.message_seconds
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if not self.server.free_connections.acquire(blocking=False):
            self.refuse("busy", f"{self.server.max_connections} connections are open")
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
            self._deadline = time.monotonic() + self.server.drain_seconds
            while self._receive_some(65_536):
                pass
        except OSError:
            pass  # the client has disconnected, or does not read

    def _wait_for_message(self) -> bool:
        """Wait for the first byte of a message; return False if the client disconnects instead."""
        self._deadline = time.monotonic() + self.server.idle_seconds
        is_open = bool(self._receive_some(1, socket.MSG_PEEK))
        self._deadline = time.monotonic() + self._message_seconds
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
        self._socket.settimeout(self._message_seconds)
        self._socket.sendall(reply.encode(dtype))


def _error(code: str, message: str, *, is_open: bool = True) -> Message:
    return Message({"type": "error", "code": code, "message": message, "is_open": is_open})


def is_loopback(host: str) -> bool:
    """Return whether only programs on this computer can connect to a host."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
