"""`mograft stream`: the socket gives the pieces of `Stream`, and no input ends the server."""

import json
import re
import signal
import socket
import struct
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
import mograft.constraints as mc
from mograft.stream.server import StreamServer, is_loopback
from mograft.stream.session import MAX_BODY_BYTES, MAX_HEADER_BYTES, StreamSession
from tests.running import running
from tests.stream_examples import StreamClient, StreamError

HELLO = {"type": "hello", "protocol": "mograft.stream/1"}
FEW_EXAMPLES = settings(max_examples=6)


class PatientServer(StreamServer):
    """A server with limits that no client of the tests exceeds, also on a busy machine."""

    message_seconds = drain_seconds = 600.0


@pytest.fixture(scope="module")
def server(two_dances):
    with PatientServer(two_dances) as running:
        yield running


def connect(server):
    return StreamClient(("127.0.0.1", server.port))


def arrays_of(motion, rows=slice(None)):
    """Return frames of a motion as the arrays of a push."""
    return {"rotations": motion.rotations[rows], "positions": motion.positions[rows]}


def push_rows(client, motion, rows=slice(None)):
    """Push frames of a motion; return the reply."""
    return client.request({"type": "push"}, **arrays_of(motion, rows))


def pieces_by_socket(client, rotations, positions, chunks, **options):
    """Stream a base; return the frames of all pieces, and the records of the pieces."""
    client.request({**HELLO, **options})
    records, received, first, n_pushes = [], [], 0, 0
    while first < len(rotations):
        rows = slice(first, first + chunks[n_pushes % len(chunks)])
        arrays = {"rotations": rotations[rows], "positions": positions[rows]}
        received.append(client.request({"type": "push"}, **arrays))
        first, n_pushes = rows.stop, n_pushes + 1
    received.append(client.request({"type": "close"}))
    for header, arrays in received:
        assert header["type"] == "pieces"
        assert len(arrays["rotations"]) == len(arrays["positions"]) == header["n_frames"]
        records += header["pieces"]
    names = "rotations", "positions"
    frames = [np.concatenate([arrays[name] for _, arrays in received]) for name in names]
    assert received[-1][0]["is_closed"]
    assert received[-1][0]["first_free_frame"] == len(rotations)
    return *frames, records


def pieces_in_process(library, base, constraints=(), **options):
    stream = mg.Stream(library, constraints=constraints, **options)
    stream.push(base)
    stream.close()
    return stream.pieces()


@FEW_EXAMPLES
@given(
    st.lists(st.integers(1, 90), min_size=1, max_size=5),
    st.booleans(),
    st.sampled_from(["float32", "float64"]),
    st.integers(1, 9),
    st.integers(0, 5),
)
def test_socket_any_chunks_give_the_pieces_of_a_stream(
    server, two_dances, short_base, chunks, has_root_only, dtype, horizon, seed
):
    """A stream of arrays is compared with one of a motion."""
    arrays = short_base.rotations, short_base.positions
    rotations, positions = (own.astype(dtype) for own in arrays)
    quats, places = rotations.astype(float), positions.astype(float)
    if has_root_only:
        positions = positions[:, two_dances.root]
        places = np.tile(two_dances.skeleton.offsets, (len(positions), 1, 1))
        places[:, two_dances.root] = positions
    if dtype == "float32":
        quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    options = {"seed": seed, "horizon": horizon}
    with connect(server) as client:
        found = pieces_by_socket(client, rotations, positions, chunks, dtype=dtype, **options)
    base = replace(short_base, rotations=quats, positions=places, channel_values=None)
    pieces = pieces_in_process(two_dances, base, **options)
    motion = mg.join_pieces(pieces)
    np.testing.assert_array_equal(found[0], motion.rotations.astype(dtype))
    np.testing.assert_array_equal(found[1], motion.positions.astype(dtype))
    for record, piece in zip(found[2], pieces, strict=True):
        assert (record["start"], record["stop"]) == (piece.start, piece.stop)
        assert [(s["group"], *s["frames"], *s["clip_frames"]) for s in record["substitutions"]] == [
            (s.group, s.start, s.stop, s.donor_start, s.donor_stop) for s in piece.substitutions
        ]


def test_socket_welcome_describes_the_skeleton(server, two_dances):
    skeleton = two_dances.skeleton
    with connect(server) as client:
        header, arrays = client.request({**HELLO, "dtype": "float64", "swap": ["upper"]})
    assert header["joints"] == list(skeleton.names)
    assert header["parents"] == list(skeleton.parents)
    assert (header["n_joints"], header["rate"]) == (skeleton.n_joints, two_dances.rate)
    assert header["swap"] == {"upper": two_dances.joints("upper").tolist()}
    np.testing.assert_array_equal(arrays["offsets"], skeleton.offsets)


def test_socket_requests_sent_together_get_their_replies_in_order(server, short_base):
    with connect(server) as client:
        client.send(HELLO)
        for first in range(0, 260, 20):
            client.send({"type": "push"}, **arrays_of(short_base, slice(first, first + 20)))
        client.send({"type": "close"})
        assert client.receive()[0]["type"] == "welcome"
        assert [client.receive()[0]["n_known"] for _ in range(13)] == list(range(20, 261, 20))
        assert client.receive()[0]["is_closed"]


def test_socket_constraints_apply_as_in_a_stream(server, two_dances, short_base):
    hand = short_base.world_positions()[100, short_base.skeleton.index("LeftHand")]
    center = (hand + np.array([0.0, 6.0, 0.0])).tolist()
    ball = {"kind": "Sphere", "center": center, "radius": 8.0}
    records = [{"kind": "Avoid", "obstacle": ball}, {"kind": "OnlyFrom", "clips": ["clip1"]}]
    constraints = [mc.Avoid(mc.Sphere(tuple(center), 8.0)), mc.OnlyFrom("clip1")]
    with connect(server) as client:
        client.request({**HELLO, "dtype": "float64"})
        header, _ = client.request({"type": "constraints", "constraints": records})
        assert (header["n_constraints"], header["first_free_frame"]) == (2, 0)
        header, arrays = push_rows(client, short_base)
        free = header["first_free_frame"]
        assert free == header["n_frames"] > 0
        reach = {"kind": "Reach", "joint": "LeftHand", "target": center, "frame": free - 1}
        with pytest.raises(StreamError, match=f"frame, {free}, .* frame {free - 1}"):
            client.request({"type": "constraints", "constraints": [*records, reach]})
        client.request({"type": "constraints", "constraints": [*records, {**reach, "frame": free}]})
        client.request({"type": "constraints", "constraints": records})
        last, end = client.request({"type": "close"})
    pieces = pieces_in_process(two_dances, short_base, constraints)
    found = np.concatenate([arrays["rotations"], end["rotations"]])
    np.testing.assert_array_equal(found, mg.join_pieces(pieces).rotations)
    records = header["pieces"] + last["pieces"]
    messages = [violation["message"] for record in records for violation in record["violations"]]
    assert messages == [violation.message for piece in pieces for violation in piece.violations]


# Invalid input


def frame(header, body=b"", magic=b"MGS1"):
    """Return the bytes of a message; `header` may be bytes that are no JSON."""
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return lengths(len(text), len(body), magic) + text + body


def lengths(n_header, n_body, magic=b"MGS1"):
    """Return the first bytes of a message."""
    return magic + struct.pack("<II", n_header, n_body)


def push(shapes, values=b"", **changes):
    names = zip(("rotations", "positions"), shapes, strict=False)
    listed = [{"name": n, "dtype": "float32", "shape": s, **changes} for n, s in names]
    return frame({"type": "push", "arrays": listed}, values)


def constrain(record):
    return frame({"type": "constraints", "constraints": [record]})


def hello(**changes):
    return frame({**HELLO, **changes})


REACH = {"kind": "Reach", "target": [0, 0, 0], "frame": 9}
INVALID_FRAMES = {
    "http": (b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", "must begin with b'MGS1'"),
    "other version": (frame(HELLO, magic=b"MGS2"), "must begin with b'MGS1', got b'MGS2'"),
    "long header": (lengths(MAX_HEADER_BYTES + 1, 0), "header .* most 65536 bytes, got 65537"),
    "long body": (lengths(2, MAX_BODY_BYTES + 1), "body must have at most 67108864 bytes"),
}
INVALID_REQUESTS = {
    "empty header": (frame(b""), "the header must be JSON"),
    "latin header": (frame(b'{"type": "\xe9"}'), "the header must be JSON in UTF-8"),
    "deep": (frame(b"[" * 60_000), "the header must be JSON"),
    "nan header": (frame(b'{"type": NaN}'), "numbers must be finite and at most 1e.15, got NaN"),
    "large number": (frame(b'{"type": 1e999}'), "numbers must be .*, got 1e999"),
    "no type": (frame({}), "`type` must be one of hello, push, constraints, close, got None"),
    "protocol": (hello(protocol="x/2"), "must be 'mograft.stream/1', got 'x/"),
    "dtype": (hello(dtype="int8"), "`dtype` must be one of float32, float64"),
    "seed": (hello(seed=-1), "`seed` must be a whole number"),
    "unknown entry": (hello(sead=1), "the entries of 'hello' must be among .*, got 'sead'"),
    "no arrays": (push([]), "`arrays` must be rotations and positions, got none"),
    "arrays": (frame({"type": "push", "arrays": 3}), "`arrays` must be a list"),
    "item": (frame({"type": "push", "arrays": [3]}), "each of `arrays` must be an object"),
    "short body": (push([[1, 18, 4], [1, 3]], b"123"), "ends at byte 288 of a body of 3 bytes"),
    "long arrays": (push([[1, 18, 4], [1, 3]], bytes(301)), "body must have 300 bytes"),
    "dtype of array": (push([[1], [1]], b"", dtype="int8"), "must be one of float32, float64"),
    "overflow": (push([[10**15, 10**15, 10**15]]), "the shape of 'rotations' must be"),
    "float shape": (push([[1.0, 18, 4]]), "the shape of 'rotations' must be"),
    "zeros": (push([[1, 18, 4], [1, 3]], bytes(300)), "must be unit quaternions, got norm 0"),
    "constraints": (frame({"type": "constraints"}), "`constraints` must be a list, got None"),
    "no kind": (constrain({}), "Character, got {}"),
    "obstacle": (constrain({"kind": "Avoid", "obstacle": 5}), "`obstacle` must be an obstacle"),
    "joint": (constrain({**REACH, "joint": "Wing"}), "no joint is named 'Wing'"),
    "close": (frame({"type": "close"}), "at least 2 frames"),
}


@pytest.mark.parametrize("kind", INVALID_FRAMES)
def test_bytes_that_are_no_message_get_an_error_and_end_the_connection(server, kind):
    data, message = INVALID_FRAMES[kind]
    with connect(server) as client:
        client.socket.sendall(data + bytes(100_000))
        with pytest.raises(StreamError, match=message) as caught:
            client.receive()
        assert (caught.value.header["code"], caught.value.header["is_open"]) == ("frame", False)
        assert client.socket.recv(1) == b""
    with connect(server) as client:
        assert client.request(HELLO)[0]["type"] == "welcome"


@pytest.fixture(scope="module")
def short_base_frames(server, short_base):
    """Return the rotations of the stream of `short_base` without invalid requests."""
    with connect(server) as client:
        return pieces_by_socket(client, short_base.rotations, short_base.positions, [10_000])[0]


@pytest.mark.parametrize("kind", INVALID_REQUESTS)
def test_invalid_request_gets_an_error_and_leaves_the_stream_unchanged(
    server, short_base, short_base_frames, kind
):
    data, message = INVALID_REQUESTS[kind]
    with connect(server) as client:
        client.request(HELLO)
        first = 0 if kind == "close" else 50
        if first:
            push_rows(client, short_base, slice(50))
        client.socket.sendall(data)
        with pytest.raises(StreamError, match=message) as caught:
            client.receive()
        assert (caught.value.header["code"], caught.value.header["is_open"]) == ("request", True)
        header, _ = push_rows(client, short_base, slice(first, None))
        assert header["n_known"] == short_base.n_frames
        frames = client.request({"type": "close"})[1]["rotations"]
    np.testing.assert_array_equal(frames, short_base_frames[-len(frames) :])


@pytest.mark.parametrize("kind", ["push", "close", "constraints"])
def test_request_without_hello_or_after_close_gets_an_error(server, short_base, kind):
    header = {"type": kind} | ({"constraints": []} if kind == "constraints" else {})
    with connect(server) as client:
        for _ in range(2):
            with pytest.raises(StreamError, match="must be 'hello' in the first request"):
                client.request(header)
            client.request(HELLO)
            push_rows(client, short_base, slice(9))
            client.request({"type": "close"})


ENTRIES = ["type", "kind", "arrays", "protocol", "constraints", "obstacle", "center", "radius"]
ENTRIES += ["joint", "target", "frame", "frames", "weight", "tolerance", "clips", "tags", "name"]
ENTRIES += ["dtype", "shape", "seed", "horizon", "swap"]


def test_bug_in_the_server_ends_only_its_connection(two_dances, monkeypatch, capfd):
    def fail(*_):
        raise RuntimeError("a bug")

    with StreamServer(two_dances) as server, connect(server) as other:
        assert other.request(HELLO)[0]["type"] == "welcome"
        with connect(server) as client, monkeypatch.context() as patch:
            patch.setattr(StreamSession, "reply", fail)
            with pytest.raises(StreamError, match="RuntimeError: a bug") as caught:
                client.request(HELLO)
            header = caught.value.header
            assert (header["code"], header["is_open"]) == ("internal", False)
        assert other.request(HELLO)[0]["type"] == "welcome"
    assert "RuntimeError: a bug" in capfd.readouterr().err


JSON_VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=True)
    | st.text(max_size=5)
    | st.sampled_from(["hello", "push", "Avoid", "Sphere", "Reach", "LeftHand", HELLO["protocol"]]),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(ENTRIES), inner, max_size=5)
    ),
    max_leaves=12,
)
HEADERS = st.dictionaries(
    st.sampled_from(["type", "arrays", "constraints", "protocol", "seed"]), JSON_VALUES, max_size=4
) | st.lists(JSON_VALUES, max_size=3).map(lambda own: {"type": "constraints", "constraints": own})


@settings(max_examples=60)
@given(st.lists(st.tuples(HEADERS, st.binary(max_size=400)), min_size=1, max_size=4))
def test_random_requests_get_one_reply_each(server, requests):
    with connect(server) as client:
        client.request(HELLO)
        for header, body in requests:
            client.socket.sendall(frame(header, body))
            try:
                client.receive()
            except StreamError as error:
                assert error.header["code"] == "request"  # noqa: PT017 - others are valid
        assert client.request(HELLO)[0]["type"] == "welcome"


@settings(max_examples=30)
@given(st.binary(max_size=300), st.binary(max_size=60))
def test_random_bytes_get_at_most_errors(server, start, end):
    with connect(server) as client:
        client.socket.sendall(start + frame(HELLO) + end)
        client.socket.shutdown(socket.SHUT_WR)
        types = []
        while True:
            try:
                types.append(client.receive()[0]["type"])
            except StreamError:
                types.append("error")
            except ConnectionError:
                break
        assert set(types) <= {"error", "welcome"}
        assert types.count("error") == len(types) or not start
    with connect(server) as client:
        assert client.request(HELLO)[0]["type"] == "welcome"


SIZES = st.floats(-1e15, 1e15) | st.sampled_from([1e-300, 1e15, -1e15, 0.0])
POINTS = st.lists(SIZES, min_size=3, max_size=3)
TOLERANCES = {"weight": SIZES, "tolerance": SIZES}
SPHERES = st.fixed_dictionaries({"kind": st.just("Sphere"), "center": POINTS, "radius": SIZES})
AVOID = {"kind": st.just("Avoid"), "obstacle": SPHERES}
REACHES = {"kind": st.just("Reach"), "joint": st.just("LeftHand"), "target": POINTS}
CONSTRAINTS = st.fixed_dictionaries(
    AVOID, optional={**TOLERANCES, "frames": st.just([0, 10**15])}
) | st.fixed_dictionaries({**REACHES, "frame": st.integers(0, 10**15)}, optional=TOLERANCES)


@settings(max_examples=15)
@given(st.lists(CONSTRAINTS, min_size=1, max_size=2))
def test_extreme_constraints_get_pieces_or_errors(server, short_base, constraints):
    with connect(server) as client:
        client.request({**HELLO, "horizon": 2})
        try:
            client.request({"type": "constraints", "constraints": constraints})
        except StreamError as error:
            assert error.header["code"] == "request"  # noqa: PT017 - others are valid
        push_rows(client, short_base, slice(120))
        assert client.request({"type": "close"})[0]["is_closed"]


# Limits


@pytest.mark.parametrize("data", [b"M", b"MGS1\x05", frame(HELLO)[:-1]])
def test_incomplete_message_ends_the_connection_after_the_timeout(two_dances, data):
    with PatientServer(two_dances) as server, connect(server) as other:
        assert other.request(HELLO)[0]["type"] == "welcome"
        server.message_seconds = 0.3  # of connections from now on
        with connect(server) as client:
            client.socket.sendall(data)
            assert other.request(HELLO)[0]["type"] == "welcome"
            with pytest.raises(StreamError, match="no complete message") as caught:
                client.receive()
            assert caught.value.header["code"] == "timeout"
        assert other.request(HELLO)[0]["type"] == "welcome"


def test_silent_client_is_disconnected_after_the_idle_timeout(two_dances):
    start = time.monotonic()
    with StreamServer(two_dances, timeout=0.3) as server, connect(server) as client:
        # The first of the calls may fail, if this process is not scheduled in time.
        with pytest.raises(StreamError, match="no complete") as caught:  # noqa: PT012
            client.request(HELLO)
            client.receive()
        assert caught.value.header["code"] == "timeout"
        assert time.monotonic() - start >= 0.3


def test_client_that_does_not_read_replies_is_disconnected(two_dances, monkeypatch):
    monkeypatch.setattr(StreamServer, "message_seconds", 0.5)
    with StreamServer(two_dances) as server:
        with connect(server) as client:
            client.socket.settimeout(120.0)
            # More requests than the buffers of the sockets hold: the client waits for the server,
            # which ends the connection.
            with pytest.raises(ConnectionError):  # noqa: PT012 - the call that fails is random
                for _ in range(10_000):
                    client.socket.sendall(frame(HELLO) * 10_000)
        with connect(server) as client:
            assert client.request(HELLO)[0]["type"] == "welcome"


def test_connection_beyond_the_maximum_gets_an_error(two_dances, monkeypatch):
    monkeypatch.setattr(StreamServer, "max_connections", 1)
    with StreamServer(two_dances) as server:
        with connect(server) as client:
            client.request(HELLO)
            with (
                connect(server) as other,
                pytest.raises(StreamError, match="1 connections") as caught,
            ):
                other.receive()
            assert caught.value.header["code"] == "busy"
        for _ in range(3000):
            with connect(server) as client:
                try:
                    header, _ = client.request(HELLO)
                    break
                except (StreamError, OSError):
                    time.sleep(0.02)
        else:
            raise AssertionError("the connection that has ended is still counted")
        assert header["type"] == "welcome"


# The command


def test_is_loopback_only_for_addresses_of_this_computer():
    assert all(map(is_loopback, ("127.0.0.1", "127.8.0.1", "::1", "localhost")))
    assert not any(map(is_loopback, ("0.0.0.0", "::", "192.168.1.2", "example.org", "")))


@pytest.mark.parametrize(
    ("words", "host", "remark"),
    [
        ([], "127.0.0.1", "^interrupted\n$"),
        (["--host", "0.0.0.0"], "0.0.0.0", "0.0.0.0 accepts connections from other computers"),
    ],
)
def test_command_serves_a_library_until_it_is_interrupted(
    two_dances, tmp_path, words, host, remark
):
    two_dances.save(tmp_path / "l")
    with running("stream", tmp_path / "l", "--port", 0, *words) as (process, document):
        assert document["schema"] == "mograft.stream-server/1"
        assert document["address"].startswith(f"{host}:")
        with StreamClient(("127.0.0.1", int(document["address"].partition(":")[2]))) as client:
            assert client.request(HELLO)[0]["joints"] == list(two_dances.skeleton.names)
        process.send_signal(signal.SIGINT)
        assert process.wait(120) == 130
        assert re.search(remark, process.stderr.read())
