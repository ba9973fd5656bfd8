"""The requests of the page of the studio, as calls of a `Session`."""

import json
import sys
import traceback
from collections.abc import Awaitable, Callable
from importlib.resources import files
from pathlib import PurePosixPath
from typing import Any

from anyio import to_thread
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from mograft._util.documents import parse_document
from mograft.errors import MograftError
from mograft.studio.events import Events
from mograft.studio.security import Guard, Places, Refusal, Token
from mograft.studio.session import Session, StaleRevision
from mograft.studio.uploads import store_upload

_VIEWING = files("mograft.viewing")
_ASSETS = {"studio": [files("mograft.studio") / "page"], "viewer": [_VIEWING / "script", _VIEWING]}
_TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}

_REFUSALS: tuple[tuple[type[Exception] | tuple[type[Exception], ...], int, str], ...] = (
    (StaleRevision, 409, "stale"),
    (FileExistsError, 409, "exists"),
    (OSError, 400, "file"),
    ((ValueError, TypeError, LookupError, MograftError), 400, "invalid"),
)
"""The status and kind of the reply to an error: those of the first line that fits."""

_Handler = Callable[[Request], Awaitable[Response]]


def create_app(
    session: Session, token: Token, places: Places, report: Callable[[str], None]
) -> Guard:
    """Return the application that serves a session to the page.

    `places` are the folders that may be read and written. `report` is called with a line for each
    refused request.
    """
    app = Starlette(
        routes=_Requests(session, places).routes(),
        exception_handlers=dict.fromkeys((HTTPException, Exception), _reply_to_error),
    )
    return Guard(app, token, report)


class _Requests:
    """The handlers of requests. Computations run in threads, one at a time by the session."""

    def __init__(self, session: Session, places: Places) -> None:
        self.session, self.places = session, places
        self.events = Events(session)

    def routes(self) -> list[Route]:
        """Return the addresses with their handlers."""
        session = self.session
        table: list[tuple[str, str, _Handler]] = [
            ("GET", "/", self.get_page),
            ("GET", "/studio/{name}", self.get_asset),
            ("GET", "/viewer/{name}", self.get_asset),
            ("GET", "/api/state", _answer(lambda _: session.state())),
            ("GET", "/api/events", self.get_events),
            ("GET", "/api/figure/{kind}/{name:path}", _answer(self.figure)),
            ("GET", "/api/character", _answer(lambda _: session.character())),
            ("GET", "/api/window/{first:int}/{last:int}/{clip:path}", _answer(self.window)),
            ("GET", "/api/files/{name:path}", self.get_file),
            ("PUT", "/api/files/{name:path}", self.put_file),
            ("POST", "/api/do", _answer(self.do)),
            ("POST", "/api/donors", _answer(session.donors)),
            ("POST", "/api/open", _answer(self.open)),
            ("POST", "/api/export", _answer(session.export)),
        ]
        return [Route(path, call, methods=[method]) for method, path, call in table]

    async def get_page(self, _: Request) -> Response:
        """Return the page."""
        return _asset("studio", "index.html")

    async def get_asset(self, request: Request) -> Response:
        """Return a script or style that the package contains."""
        return _asset(request.url.path.split("/")[1], request.path_params["name"])

    async def get_events(self, _: Request) -> Response:
        """Return the stream of events."""
        self.events.check_capacity()
        return StreamingResponse(self.events.stream(), media_type="text/event-stream")

    def figure(self, request: Request) -> dict[str, Any]:
        """Return a motion or clip, or what changed since a version of it."""
        kind, name = request.path_params["kind"], request.path_params["name"]
        return self.session.figure(kind, name, request.query_params.get("since"))

    def window(self, request: Request) -> dict[str, Any]:
        """Return frames of a captured clip."""
        return self.session.window(**request.path_params)

    def do(self, action: dict[str, Any]) -> dict[str, Any]:
        """Perform an action: ``{"action": ..., "revision": ...}`` with the fields of the action."""
        revision = action.pop("revision", None)
        if revision is not None and type(revision) is not int:
            raise ValueError(f"`revision` must be an integer or null, got {revision!r}")
        if isinstance(action.get("path"), str):
            action["path"] = str(self.places.find(action["path"]))
        return self.session.do(action, revision)

    def open(self, document: dict[str, Any]) -> dict[str, Any]:
        """Open files, folders, a library or a project: ``{"paths": [...]}``."""
        texts = document.get("paths")
        if not isinstance(texts, list) or not all(isinstance(own, str) for own in texts):
            raise ValueError("`paths` must be a list of texts")
        paths = [self.places.find(text) for text in texts]
        for path in paths:
            if path.suffix.lower() == ".json" and not self.places.has_output(path):
                raise Refusal(403, "path", f"{path} would be changed: open it by mograft studio")
        self.session.open(paths)
        return {"revision": self.session.revision}

    async def get_file(self, request: Request) -> Response:
        """Return a file below the folder of the session, to be saved."""
        path = self.places.find_output(request.path_params["name"])
        return FileResponse(path, media_type="application/octet-stream", filename=path.name)

    async def put_file(self, request: Request) -> Response:
        """Store a file of the browser, which `open` can open then."""
        name = request.path_params["name"]
        n_bytes = int(request.headers.get("content-length", "0"))
        path = await store_upload(request.stream(), n_bytes, self.places.folder, name)
        return JSONResponse({"path": path.as_posix()})


def _asset(folder: str, name: str) -> Response:
    """Return the file of exactly this name among those of the page."""
    found = (own for place in _ASSETS[folder] for own in place.iterdir() if own.name == name)
    file, media_type = next(found, None), _TYPES.get(PurePosixPath(name).suffix)
    if file is None or media_type is None:
        raise Refusal(404, "path", f"there is no page {name}")
    return Response(file.read_bytes(), media_type=media_type)


async def _document(request: Request) -> dict[str, Any]:
    """Return the JSON object in the body of a request."""
    document = parse_document(await request.body())
    if not isinstance(document, dict):
        raise ValueError(f"expected a JSON object, got {type(document).__name__}")
    return document


def _answer(call: Callable[[Any], Any]) -> _Handler:
    """Return a handler that replies with the JSON of a call, which runs in a thread.

    The argument of the call is the request, or of a POST request the JSON object in its body.
    """

    async def handle(request: Request) -> Response:
        given = await _document(request) if request.method == "POST" else request

        def encode() -> bytes:
            return json.dumps(call(given), allow_nan=False, separators=(",", ":")).encode()

        return Response(await to_thread.run_sync(encode), media_type="application/json")

    return handle


async def _reply_to_error(request: Request, error: Exception) -> Response:
    refusal = _as_refusal(error)
    request.scope["mograft.reason"] = str(refusal)
    return refusal.response()


def _as_refusal(error: Exception) -> Refusal:
    if isinstance(error, Refusal):
        return error
    if isinstance(error, HTTPException):
        return Refusal(error.status_code, "path", error.detail)
    for kinds, status, kind in _REFUSALS:
        if isinstance(error, kinds):
            return Refusal(status, kind, str(error))
    traceback.print_exception(error, file=sys.stderr)
    return Refusal(500, "internal", f"{type(error).__name__}: {error}")
