"""Hostile requests: they are refused and reported, change nothing, and the server goes on."""

import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import quote

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mograft.studio import security, server, uploads
from mograft.studio.security import Places, Refusal
from tests.running import running as running_command
from tests.studio.test_app import running


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("attack") / "session"


@pytest.fixture(scope="module")
def served(folder):
    folder.mkdir()
    (folder.parent / "secret.bvh").write_text("secret")
    given_folder = folder.parent / "given"
    given_folder.mkdir()
    (given_folder / "a.project.json").write_text("{}")
    (folder / "link").symlink_to(folder.parent)
    (folder / "loop").symlink_to(folder / "loop")
    with running(folder, [given_folder]) as found:
        yield found


@pytest.fixture
def client(served):
    """A client; at the end of the test the server has reported a refusal, and still replies."""
    client, session, reports = served
    session.reset_mock()
    reports.clear()
    yield client
    assert session.method_calls == []
    assert reports
    assert client.get("/").status_code == 200


REQUESTS = [
    ("GET", "/"),
    ("GET", "/api/state"),
    ("GET", "/api/events"),
    ("POST", "/api/do"),
    ("PUT", "/api/files/a.bvh"),
    ("OPTIONS", "/api/do"),
]


FOREIGN = [
    ("host", {"host": "evil.example"}),
    ("host", {"host": "127.0.0.1:1"}),
    ("origin", {"origin": "http://evil.example"}),
    ("origin", {"origin": "null"}),
    ("origin", {"origin": "http://127.0.0.1:1"}),
    ("origin", {"sec-fetch-site": "cross-site"}),
    ("origin", {"sec-fetch-site": "same-site"}),
    ("token", {"cookie": ""}),
    ("token", {"cookie": "mograft-studio-{port}=wrong"}),
]


def cookies_of(client):
    return "; ".join(f"{name}={value}" for name, value in client.cookies.items())


def refused(client, method, path, kind, **changes):
    """Send a request with other headers, without those that are None, and check the refusal."""
    origin = client.headers["origin"]
    headers = {"origin": origin, "cookie": cookies_of(client)} | changes
    headers = {name: value for name, value in headers.items() if value is not None}
    reply = httpx.request(method, f"{origin}{path}", headers=headers)
    assert (reply.status_code, reply.json()["kind"]) == (403, kind)
    assert "frame-ancestors 'none'" in reply.headers["content-security-policy"]
    assert "access-control-allow-origin" not in reply.headers


@pytest.mark.parametrize("request_line", REQUESTS, ids="-".join)
@pytest.mark.parametrize(("kind", "changes"), FOREIGN)
def test_request_of_another_page_or_without_the_token_is_refused(
    client, request_line, kind, changes
):
    port = client.server.token.port
    changes = {name: value.format(port=port) for name, value in changes.items()}
    refused(client, *request_line, kind, **changes)


@pytest.mark.parametrize("method", ["POST", "PUT"])
def test_writing_without_origin_is_refused(client, method):
    refused(client, method, "/api/files/a.bvh", "origin", origin=None)


def test_token_in_the_address_is_refused_unless_it_is_right_and_of_no_other_site(client):
    for token in ("wrong", "%00%ff&token"):
        refused(client, "GET", f"/?token={token}", "token", cookie=None)
    site = {"sec-fetch-site": "cross-site"}
    refused(client, "GET", f"/?token={client.server.token.text}", "origin", **site)


def test_token_becomes_strict_cookie(served):
    client, _, _ = served
    reply = httpx.get(client.server.url)
    assert reply.status_code == 303
    assert reply.headers["location"] == "/"
    cookie = reply.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert client.server.token.text not in reply.headers["location"]


OUTSIDE = [
    "../secret.bvh",
    "dropped/../../secret.bvh",
    "/etc/passwd",
    "link/secret.bvh",
    "a\0b",
    "loop",
    "~/x.bvh",
    "walk.bvh#/../../secret.bvh",
]


@pytest.mark.parametrize("name", OUTSIDE)
def test_paths_outside_of_the_folders_are_refused(client, name):
    action = {"action": "set_character", "path": name}
    replies = [client.post("/api/open", json={"paths": [name]})]
    replies += [client.post("/api/do", json=action)]
    replies += [client.get(f"/api/files/{quote(own, safe='')}") for own in (name, f"{name}/x")]
    for reply in replies:
        assert reply.status_code in (403, 404)
        assert "secret" not in reply.text.replace("secret.bvh", "")


def test_given_folder_is_neither_served_nor_changed(client):
    path = "../given/a.project.json"
    assert client.post("/api/open", json={"paths": [path]}).status_code == 403
    assert client.get(f"/api/files/{quote(path, safe='')}").status_code == 404


UPLOAD_NAMES = [
    "..%2Fa.bvh",
    "x/../../a.bvh",
    "/etc/a.bvh",
    "..\\a.bvh",
    ".git/hooks/a.bvh",
    "a.html",
    "1/2/3/4/5/6/7/8/9.bvh",
]


@pytest.mark.parametrize("name", UPLOAD_NAMES)
def test_upload_with_refused_name_writes_nothing(client, folder, name):
    before = sorted(folder.parent.rglob("*"))
    reply = client.put(f"/api/files/{quote(name, safe='%')}", content=b"x")
    assert reply.status_code in (400, 403, 404)
    assert sorted(folder.parent.rglob("*")) == before


@given(name=st.text(min_size=1), suffix=st.sampled_from([".bvh", ".glb", "", ".bvh/x.bvh"]))
def test_upload_path_stays_in_its_folder(name, suffix):
    try:
        path = uploads.upload_path(name + suffix)
    except Refusal:
        return
    assert Path("/session", path).resolve().is_relative_to(Path("/session", uploads.FOLDER))


@given(text=st.text(alphabet="./\\a#\0~", min_size=1))
def test_found_path_is_below_a_folder(tmp_path_factory, text):
    folder = tmp_path_factory.getbasetemp()
    try:
        path = Places(folder).find(text)
    except Refusal:
        return
    assert path.resolve().is_relative_to(folder.resolve())


def test_upload_keeps_markup_in_names_as_text(served, folder):
    client, _, _ = served
    name = "<script>alert(1)</script>.bvh"
    reply = client.put(f"/api/files/{quote(name, safe='')}", content=b"HIERARCHY")
    assert reply.status_code == 200
    assert reply.headers["content-type"] == "application/json"
    stored = folder / reply.json()["path"]
    assert stored.read_bytes() == b"HIERARCHY"
    assert stored.is_relative_to(folder / "dropped")


def test_upload_never_replaces_another_file(served, folder):
    client, _, _ = served
    replies = [client.put("/api/files/take.bvh", content=own) for own in (b"a", b"b", b"a")]
    paths = [reply.json()["path"] for reply in replies]
    assert paths == ["dropped/take.bvh", "dropped/take (2).bvh", "dropped/take.bvh"]
    assert [(folder / own).read_bytes() for own in paths] == [b"a", b"b", b"a"]
    assert client.put("/api/files/mesh/take.bin", content=b"a").status_code == 200
    assert client.put("/api/files/mesh/take.bin", content=b"b").status_code == 409
    assert (folder / "dropped/mesh/take.bin").read_bytes() == b"a"


def test_upload_to_a_full_disk_is_refused(served, folder, monkeypatch):
    client, _, _ = served
    free = SimpleNamespace(free=(256 << 20) + 9)
    monkeypatch.setattr(uploads, "shutil", SimpleNamespace(disk_usage=lambda _: free))
    assert client.put("/api/files/full.bvh", content=b"x" * 10).status_code == 413
    assert client.put("/api/files/fits.bvh", content=b"x" * 9).status_code == 200
    assert not (folder / "dropped/full.bvh").exists()


def raw(client, text):
    """Send bytes with the cookie; return the first bytes of the reply."""
    port, origin = client.server.token.port, client.headers["origin"]
    head = f"Host: 127.0.0.1:{port}\r\nOrigin: {origin}\r\nCookie: {cookies_of(client)}\r\n"
    with socket.create_connection(("127.0.0.1", port), timeout=10) as link:
        link.sendall(text.replace("HEAD", head).encode("latin-1"))
        return link.recv(4096).decode("latin-1")


@pytest.mark.parametrize("n_bytes", ["10000000000", "99999999999999999999", "-1", "1e3"])
def test_claim_of_10_gigabytes_is_refused_before_its_bytes(client, folder, n_bytes):
    text = f"PUT /api/files/big.bvh HTTP/1.1\r\nHEADContent-Length: {n_bytes}\r\n\r\nx"
    reply = raw(client, text)
    assert reply.startswith(("HTTP/1.1 413", "HTTP/1.1 400"))
    assert not (folder / "dropped" / "big.bvh").exists()
    client.get("/api/files/none.bvh")  # uvicorn itself replies to numbers that are no length


def test_body_without_length_is_refused_at_the_limit(client, folder, monkeypatch):
    monkeypatch.setattr(security, "MAX_UPLOAD_BYTES", 100_000)
    parts = (b"x" * 10_000 for _ in range(30))
    assert client.put("/api/files/long.bvh", content=parts).status_code == 413
    assert not list(folder.rglob("long.bvh"))


def test_body_that_stops_is_refused(client, folder, monkeypatch):
    monkeypatch.setattr(security, "_BODY_SECONDS", 0.2)
    text = "PUT /api/files/slow.bvh HTTP/1.1\r\nHEADContent-Length: 5\r\n\r\nx"
    assert raw(client, text).startswith("HTTP/1.1 408")
    assert not list(folder.rglob("*slow*"))


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[]",
        b"\xff",
        b"[" * 100_000,
        b'{"a":' * 5000 + b"1" + b"}" * 5000,
        b'{"paths": "x"}',
        b'{"paths": [1]}',
    ],
)
def test_malformed_message_is_refused(client, body):
    reply = client.post("/api/open", content=body)
    assert (reply.status_code, reply.json()["kind"]) == (400, "invalid")


@pytest.mark.parametrize("revision", ["1", 1.5, True, [1], {}])
def test_revision_of_wrong_type_is_refused(client, revision):
    assert client.post("/api/do", json={"action": "undo", "revision": revision}).status_code == 400


def test_message_above_the_limit_is_refused(client):
    reply = client.post("/api/do", json={"action": "x" * security.MAX_JSON_BYTES})
    assert (reply.status_code, reply.json()["kind"]) == (413, "size")


@pytest.mark.parametrize(
    "name",
    ["..%2Fviewing%2Fpage.py", "session.py", "three.js.map", "%00", "main.js%00", "", "MAIN.JS"],
)
def test_only_files_of_the_page_are_served(client, name):
    for folder in ("studio", "viewer"):
        assert client.get(f"/{folder}/{name}").status_code in (404, 400)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.binary(min_size=1, max_size=300))
def test_bytes_that_are_no_request_end_nothing(served, data):
    client, _, _ = served
    with socket.create_connection(("127.0.0.1", client.server.token.port), timeout=10) as link:
        link.sendall(data + b"\r\n\r\n")
        link.shutdown(socket.SHUT_WR)
        while link.recv(4096):
            pass
    assert client.get("/").status_code == 200


def test_200_connections_do_not_stop_an_open_page(served):
    client, _, reports = served
    address = ("127.0.0.1", client.server.token.port)
    client.get("/")
    reports.clear()
    with ExitStack() as stack:
        for _ in range(200):
            stack.enter_context(socket.create_connection(address, timeout=10))
        for _ in range(20):
            assert client.get("/").status_code == 200
        until = time.monotonic() + 30
        while len(reports) < 200 - server.MAX_CONNECTIONS and time.monotonic() < until:
            time.sleep(0.05)
    assert sum("refused" in own for own in reports) >= 200 - server.MAX_CONNECTIONS


def test_reports_of_a_second_are_few_and_the_others_are_counted(monkeypatch):
    monkeypatch.setattr(security, "MAX_REPORTS", 5)
    clock, shown = iter([5.0, 5.9, *[6.5] * 8, 7.0, 7.1]), []
    monkeypatch.setattr(security, "time", SimpleNamespace(monotonic=clock.__next__))
    guard = security.Guard(None, security.Token(1), shown.append)
    for _ in range(12):
        guard._log({"method": "GET", "path": "/"}, 403)
    line = "403 GET /: "
    assert shown == [*[line] * 7, "3 more requests were refused", *[line] * 2]


def test_silent_connection_is_closed(served, monkeypatch):
    client, _, _ = served
    monkeypatch.setattr(server, "_REQUEST_SECONDS", 0.2)
    for start in (b"", b"GET / HT"):
        with socket.create_connection(("127.0.0.1", client.server.token.port), timeout=10) as link:
            link.sendall(start)
            assert link.recv(100) == b""


def test_too_many_listeners_are_refused(served, monkeypatch):
    client, _, _ = served
    monkeypatch.setattr("mograft.studio.events.MAX_LISTENERS", 1)
    with client.stream("GET", "/api/events") as first:
        lines = first.iter_lines()
        next(lines)
        with client.stream("GET", "/api/events") as second:
            assert second.status_code == 503
    for _ in range(200):  # the place of the first is free again
        with client.stream("GET", "/api/events") as reply:
            if reply.status_code == 200:
                break
        time.sleep(0.05)
    else:
        raise AssertionError("the place of a listener was not released")


def test_reports_have_one_line_and_no_control_characters(served):
    client, _, reports = served
    reports.clear()
    client.get("/api/files/%0a%1b%5b31mred%0d.bvh")
    assert len(reports) == 1
    assert reports[0].isprintable()


def end(process, folder):
    process.terminate()
    assert process.wait(timeout=30) == 143
    assert process.stderr.read().endswith("terminated\n")
    assert not list(folder.rglob("*.part"))


def test_command_prints_address_and_refuses_a_port_in_use(tmp_path):
    with running_command("studio", "-o", "out", cwd=tmp_path) as (process, document):
        assert httpx.get(document["url"]).status_code == 303
        words = [sys.executable, "-m", "mograft", "studio", "-o", "other", "--port"]
        words.append(str(httpx.URL(document["url"]).port))
        again = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
        end(process, tmp_path)
    assert (again.returncode, again.stdout) == (1, "")
    assert "is not free" in again.stderr
