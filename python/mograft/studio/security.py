"""Which requests and paths the studio's server accepts: host, origin, token, sizes, folders."""

import asyncio
import hmac
import secrets
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from mograft.io.formats import join_address, split_address

MAX_JSON_BYTES = 4 << 20
MAX_UPLOAD_BYTES = 2 << 30
MAX_REPORTS = 50
"""Greatest number of refusals that are reported in a second."""

_BODY_SECONDS = 30.0  # to receive the next part of a body
_MAX_SHOWN_CHARACTERS = 120

_HEADERS = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
        "img-src 'self' blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


class Refusal(Exception):
    """A request that is refused, with the status and the kind of the reply."""

    def __init__(self, status: int, kind: str, text: str) -> None:
        super().__init__(text)
        self.status, self.kind = status, kind

    def response(self) -> Response:
        """Return the reply."""
        return JSONResponse({"error": str(self), "kind": self.kind}, self.status)


class Token:
    """The secret of a server; a browser that opened its URL has it as a cookie."""

    def __init__(self, port: int) -> None:
        self.text = secrets.token_urlsafe(32)
        self.port = port
        self.cookie = f"mograft-studio-{port}"  # cookies do not depend on the port

    @property
    def url(self) -> str:
        """The address that opens the page."""
        return f"http://127.0.0.1:{self.port}/?token={self.text}"

    def is_in(self, values: Mapping[str, str], name: str) -> bool:
        """Return whether a query or the cookies of a request have the token under a name."""
        return hmac.compare_digest(values.get(name, "").encode(), self.text.encode())

    def redirect(self) -> Response:
        """Return the reply that sets the cookie, and opens the page without the token."""
        response = RedirectResponse("/", 303)
        response.set_cookie(self.cookie, self.text, httponly=True, samesite="strict")
        return response


class Guard:
    """Middleware that refuses requests of other pages, without the token, or that are too large.

    It adds the headers of safety to every reply. `report` is called with a line about each refusal,
    and in a second with more than `MAX_REPORTS`, later with the number of the others.
    """

    def __init__(self, app: ASGIApp, token: Token, report: Callable[[str], None]) -> None:
        self.app, self.token, self.report = app, token, report
        self._second = self._n_refused = 0
        self._hosts = [f"{name}:{token.port}" for name in ("127.0.0.1", "localhost")]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request."""

        async def send_safely(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_HEADERS)
                if message["status"] >= 400:
                    self._log(scope, message["status"])
            await send(message)

        try:
            response = self._check(scope)
        except Refusal as error:
            scope["mograft.reason"] = str(error)
            response = error.response()
        if response is not None:
            await response(scope, receive, send_safely)
        else:
            with suppress(Exception):  # which has a reply
                await self.app(scope, _limit(scope, receive), send_safely)

    def _check(self, scope: Scope) -> Response | None:
        """Return a reply if the check alone answers, otherwise None; raise Refusal."""
        request = HTTPConnection(scope)
        headers = request.headers
        host, site = headers.get("host", ""), headers.get("sec-fetch-site", "none")
        if host not in self._hosts:
            raise Refusal(403, "host", f"the host must be {self._hosts[0]}, got {_short(host)}")
        is_reading = scope["method"] in ("GET", "HEAD")
        # Only navigations and programs other than browsers send no origin.
        origin = headers.get("origin", "" if is_reading else "none")
        if origin not in ("", f"http://{host}") or site not in ("none", "same-origin"):
            raise Refusal(403, "origin", f"requests of other pages are refused: {_short(origin)}")
        if scope["path"] == "/" and is_reading and self.token.is_in(request.query_params, "token"):
            return self.token.redirect()
        if not self.token.is_in(request.cookies, self.token.cookie):
            raise Refusal(403, "token", "open the URL that mograft studio printed, with its token")
        return None

    def _log(self, scope: Scope, status: int) -> None:
        second = int(time.monotonic())
        if second != self._second:
            if self._n_refused > MAX_REPORTS:
                self.report(f"{self._n_refused - MAX_REPORTS} more requests were refused")
            self._second, self._n_refused = second, 0
        self._n_refused += 1
        if self._n_refused > MAX_REPORTS:
            return
        place = f"{scope['method']} {_short(scope['path'])}"
        self.report(f"{status} {place}: {_short(scope.get('mograft.reason', ''))}")


def _limit(scope: Scope, receive: Receive) -> Receive:
    """Return a function that receives a body, and raises Refusal if it is too large or too slow."""
    most = MAX_UPLOAD_BYTES if scope["method"] == "PUT" else MAX_JSON_BYTES
    too_large = Refusal(413, "size", f"a request may have at most {most} bytes")
    length = Headers(scope=scope).get("content-length", "0")
    is_whole, n_bytes = False, 0

    async def receive_part() -> Message:
        nonlocal is_whole, n_bytes
        if is_whole:
            return await receive()
        if int(length) > most:  # h11 refuses other texts than numbers
            raise too_large
        try:
            async with asyncio.timeout(_BODY_SECONDS):
                message = await receive()
        except TimeoutError:
            raise Refusal(408, "timeout", "the request did not arrive in time") from None
        n_bytes += len(message.get("body", b""))
        is_whole = not message.get("more_body", False)
        if n_bytes > most:
            raise too_large
        return message

    return receive_part


def _short(text: str) -> str:
    """Return the start of a text from a request on one line, for messages."""
    shown = text[:_MAX_SHOWN_CHARACTERS].encode("unicode_escape").decode("ascii")
    return shown + "..." * (len(text) > _MAX_SHOWN_CHARACTERS)


@dataclass(frozen=True)
class Places:
    """The folder of a session, and the files and folders that the user gave."""

    folder: Path
    given: Sequence[Path] = ()

    def find(self, text: str) -> Path:
        """Return the path of a file or clip, ``PATH`` or ``PATH#CLIP``, that may be read.

        A relative path starts at the folder of the session. Raises Refusal if the path, with
        symbolic links resolved, is neither below this folder nor given.
        """
        name, clip = split_address(str(self.folder / text.replace("\0", "\ufffd")))
        path = _resolve(Path(name))
        # A clip whose name has a separator would change the path.
        if clip is not None and ("/" in clip or "\\" in clip or not path.is_file()):
            raise Refusal(403, "path", f"{_short(text)} is not a clip of a file")
        if not any(path.is_relative_to(_resolve(root)) for root in (self.folder, *self.given)):
            shown = _short(text)
            raise Refusal(403, "path", f"{shown} is outside of the folders of this studio")
        if not path.exists():
            raise Refusal(404, "path", f"{_short(text)} does not exist")
        return Path(join_address(str(path), clip))

    def find_output(self, text: str) -> Path:
        """Return the path of a file in the folder of the session; raise Refusal for others."""
        path = _resolve(self.folder / text)
        if not self.has_output(path) or not path.is_file():
            raise Refusal(404, "path", f"{_short(text)} is not a file of this studio")
        return path

    def has_output(self, path: Path) -> bool:
        """Return whether a path without symbolic links is below the folder of the session."""
        return path.is_relative_to(_resolve(self.folder))


def _resolve(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, or a zero character
        raise Refusal(403, "path", f"{_short(str(path))} is not a path") from error
