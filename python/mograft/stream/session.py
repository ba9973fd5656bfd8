"""`StreamSession`: the requests of one client of a stream server, and their replies.

Messages of the protocol ``mograft.stream/1`` are a JSON header and arrays, with their lengths.
docs/howto/stream.md describes the protocol. Everything is little-endian.
"""

import json
import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.provenance.document import substitution_record, violation_record
from mograft.search.constraint_records import Record, decode_constraint
from mograft.search.constraints import Constraint
from mograft.stream.stream import Stream, StreamPiece

PROTOCOL = "mograft.stream/1"
MAGIC = b"MGS1"
LENGTHS = struct.Struct("<II")
"""The lengths of header and body in bytes, which follow the magic number."""

MAX_HEADER_BYTES = 65_536
MAX_BODY_BYTES = 64 * 1024 * 1024
MAX_NUMBER = 1e15
"""Largest magnitude of numbers in the header of a request."""
MAX_NORM_ERROR = 1e-3
"""Largest difference from 1 of the norm of a float32 quaternion, which is then normalised."""

_MAX_DIMENSIONS = 3
Dtype: TypeAlias = "np.dtype[np.floating[Any]]"
DTYPES: Mapping[str, Dtype] = {"float32": np.dtype("<f4"), "float64": np.dtype("<f8")}
_DTYPES = ", ".join(DTYPES)

Array = npt.NDArray[np.floating[Any]]


class FrameError(ValueError):
    """The received bytes are not a message; the start of the next message is unknown."""


class RequestError(ValueError):
    """A complete message whose content is invalid; the next message can be read."""


@dataclass(frozen=True, eq=False)
class Message:
    """A header, without its entry ``arrays``, and arrays by name."""

    header: Mapping[str, Any]
    arrays: Mapping[str, Array] = field(default_factory=dict)

    def encode(self, dtype: str = "float64") -> bytes:
        """Return the bytes of the message; arrays are converted to `dtype`."""
        arrays = {
            name: np.ascontiguousarray(array, DTYPES[dtype]) for name, array in self.arrays.items()
        }
        about = [{"name": name, "dtype": dtype, "shape": own.shape} for name, own in arrays.items()]
        text = json.dumps({**self.header, "arrays": about}, allow_nan=False).encode()
        body = b"".join(array.tobytes() for array in arrays.values())
        return MAGIC + LENGTHS.pack(len(text), len(body)) + text + body


def read_request(receive: Callable[[int], bytes]) -> Message:
    """Return the next request; `receive` returns exactly the given number of bytes.

    Raise FrameError if the magic number differs or a length exceeds its limit, and RequestError if
    header or arrays are invalid. In the second case the whole message has been received.
    """
    magic = receive(len(MAGIC))
    if magic != MAGIC:
        raise FrameError(f"a message must begin with {MAGIC!r}, got {magic!r}")
    n_header, n_body = LENGTHS.unpack(receive(LENGTHS.size))
    limits = (("header", n_header, MAX_HEADER_BYTES), ("body", n_body, MAX_BODY_BYTES))
    for name, length, limit in limits:
        if length > limit:
            raise FrameError(f"the {name} must have at most {limit} bytes, got {length}")
    header, body = receive(n_header), receive(n_body)
    document = _read_header(header)
    return Message(document, _read_arrays(document.pop("arrays", []), body))


def _read_header(data: bytes) -> dict[str, Any]:
    try:
        document = json.loads(
            data.decode("utf-8"),
            parse_float=lambda text: _check_number(float(text), text),
            parse_int=lambda text: _check_number(int(text), text),
            parse_constant=lambda text: _check_number(math.inf, text),
        )
    except RequestError:
        raise
    except (ValueError, RecursionError) as error:
        raise RequestError(f"the header must be JSON in UTF-8: {error}") from error
    if not isinstance(document, dict):
        raise RequestError("the header must be a JSON object")
    return document


def _check_number(value: float, text: str) -> float:
    """Return a number of a header; raise RequestError if it is not finite or is too large."""
    if abs(value) > MAX_NUMBER:
        raise RequestError(f"numbers must be finite and at most {MAX_NUMBER:g}, got {text[:20]}")
    return value


def _read_arrays(records: object, body: bytes) -> dict[str, Array]:
    """Return the arrays of a body; `records` is the entry ``arrays`` of the header."""
    if not isinstance(records, list):
        raise RequestError("`arrays` must be a list")
    arrays, start = dict[str, Array](), 0
    for record in records:
        name, dtype, shape = _read_description(record)
        if name in arrays:
            raise RequestError(f"`arrays` must have different names, got {name!r} twice")
        stop = start + math.prod(shape) * dtype.itemsize
        if stop > len(body):
            raise RequestError(f"array {name!r} ends at byte {stop} of a body of {len(body)} bytes")
        arrays[name] = np.frombuffer(body[start:stop], dtype).reshape(shape)
        start = stop
    if start != len(body):
        raise RequestError(f"the body must have {start} bytes, as its arrays, got {len(body)}")
    return arrays


def _read_description(record: object) -> tuple[str, Dtype, list[int]]:
    """Return name, dtype and shape of an array from its description in the header."""
    if not isinstance(record, dict) or set(record) != {"name", "dtype", "shape"}:
        raise RequestError("each of `arrays` must be an object with name, dtype and shape")
    name, dtype, shape = record["name"], record["dtype"], record["shape"]
    if not isinstance(name, str):
        raise RequestError(f"the name of an array must be a string, got {name!r}")
    if not isinstance(dtype, str) or dtype not in DTYPES:
        raise RequestError(f"the dtype of {name!r} must be one of {_DTYPES}, got {dtype!r}")
    is_shape = isinstance(shape, list) and len(shape) <= _MAX_DIMENSIONS
    if not is_shape or not all(type(size) is int and 0 <= size <= MAX_BODY_BYTES for size in shape):
        raise RequestError(
            f"the shape of {name!r} must be at most {_MAX_DIMENSIONS} sizes, got {shape!r}"
        )
    return name, DTYPES[dtype], shape


_ENTRIES: Mapping[str, Sequence[str]] = {
    "hello": ("protocol", "dtype", "seed", "horizon", "delay", "swap"),
    "push": (),
    "constraints": ("constraints",),
    "close": (),
}
"""The other entries of the header by the type of a request."""


class StreamSession:
    """One client's stream on a library, and the dtype of the replies to the client."""

    def __init__(self, library: Library) -> None:
        self._library = library
        self._stream: Stream | None = None
        self.dtype = "float32"

    def reply(self, request: Message) -> Message:
        """Return the reply to a request.

        Raise RequestError if the request is invalid; the stream is then unchanged.
        """
        options = dict(request.header)
        kind = options.pop("type", None)
        if not isinstance(kind, str) or kind not in _ENTRIES:
            raise RequestError(f"`type` must be one of {', '.join(_ENTRIES)}, got {kind!r}")
        for name in options.keys() - {*_ENTRIES[kind]}:
            allowed = ", ".join(["type", *_ENTRIES[kind]])
            raise RequestError(f"the entries of {kind!r} must be among {allowed}, got {name!r}")
        stream = self._stream
        if stream is None and kind != "hello":
            raise RequestError("`type` must be 'hello' in the first request and after 'close'")
        # Constraints with extreme numbers have infinite costs.
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            try:
                if stream is None or kind == "hello":
                    return self._hello(options)
                if kind == "constraints":
                    return _set_constraints(stream, options)
                if kind == "push":
                    _push(stream, request.arrays)
                else:
                    stream.close()
            except (ArithmeticError, LookupError, RecursionError, TypeError, ValueError) as error:
                raise RequestError(str(error) or type(error).__name__) from error
            if kind == "close":
                self._stream = None
            return self._pieces(stream)

    def _hello(self, options: dict[str, Any]) -> Message:
        """Start a new stream; describe the skeleton that its frames must have."""
        protocol, dtype = options.pop("protocol", None), options.pop("dtype", "float32")
        if protocol != PROTOCOL:
            raise RequestError(f"`protocol` must be {PROTOCOL!r}, got {protocol!r}")
        if not isinstance(dtype, str) or dtype not in DTYPES:
            raise RequestError(f"`dtype` must be one of {_DTYPES}, got {dtype!r}")
        if not isinstance(options.get("swap", []), list):
            raise RequestError(f"`swap` must be a list of groups, got {options['swap']!r}")
        library = self._library
        self._stream, self.dtype = Stream(library, **options), dtype
        skeleton = library.skeleton
        header = {
            "type": "welcome",
            "protocol": PROTOCOL,
            "mograft": VERSION,
            "rate": library.rate,
            "n_joints": skeleton.n_joints,
            "joints": list(skeleton.names),
            "parents": np.asarray(skeleton.parents).tolist(),
            "root": library.root,
            "up": library.up,
            "swap": {group: library.joints(group).tolist() for group in self._stream.groups},
        }
        return Message(header, {"offsets": skeleton.offsets})

    def _pieces(self, stream: Stream) -> Message:
        """Commit all pieces that can be committed, and return them as one message."""
        pieces, n_joints = stream.pieces(), self._library.skeleton.n_joints
        empty = np.zeros((0, n_joints, 4))
        header = {
            "type": "pieces",
            "n_frames": sum(piece.motion.n_frames for piece in pieces),
            "n_known": stream.n_known,
            "first_free_frame": stream.first_free_frame,
            "is_closed": self._stream is None,
            "pieces": [_piece_record(piece, stream.constraints) for piece in pieces],
        }
        rotations = np.concatenate([empty, *(piece.motion.rotations for piece in pieces)])
        positions = [empty[..., :3], *(piece.motion.positions for piece in pieces)]
        return Message(header, {"rotations": rotations, "positions": np.concatenate(positions)})


def _push(stream: Stream, arrays: Mapping[str, Array]) -> None:
    """Append frames."""
    if set(arrays) != {"rotations", "positions"}:
        given = ", ".join(arrays) or "none"
        raise RequestError(f"`arrays` must be rotations and positions, got {given}")
    stream.push(_unit_quaternions(arrays["rotations"]), arrays["positions"])


def _set_constraints(stream: Stream, options: Mapping[str, Any]) -> Message:
    """Replace the constraints of the frames that are not committed."""
    records = options.get("constraints")
    if not isinstance(records, list):
        raise RequestError(f"`constraints` must be a list, got {records!r}")
    stream.constraints = [_constraint(record) for record in records]
    count, free = len(stream.constraints), stream.first_free_frame
    return Message({"type": "constraints", "n_constraints": count, "first_free_frame": free})


def _unit_quaternions(rotations: Array) -> Array:
    """Return rotations as float64; normalise float32 ones unless a norm is far from 1."""
    if rotations.dtype.itemsize == 8:
        return rotations
    quats = rotations.astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        norms = np.linalg.norm(quats, axis=-1, keepdims=True) if quats.ndim else np.ones(())
        is_near = bool((np.abs(norms - 1.0) <= MAX_NORM_ERROR).all())
    # Other values raise the error of `Stream.push`, which names the first of them.
    return quats / norms if is_near else quats


def _constraint(record: object) -> Constraint:
    if not isinstance(record, dict) or record.get("is_restored") is False:
        raise RequestError(f"each of `constraints` must be an object with `kind`, got {record!r}")
    return decode_constraint(record, _refuse_motion)


def _refuse_motion(record: Record) -> Motion:
    raise RequestError(
        f"constraints and obstacles must have a `kind` other than Character, got {record!r}"
    )


def _piece_record(piece: StreamPiece, constraints: tuple[Constraint, ...]) -> dict[str, Any]:
    """Return a piece as JSON; NaN and infinity become null, because JSON has neither."""
    substitutions = [substitution_record(own) for own in piece.substitutions]
    for record in substitutions:
        record["gaps_degrees"][1] = None  # the gap at the end of a piece is not known yet
    violations = [violation_record(own, constraints) for own in piece.violations]
    for record in violations:
        if not math.isfinite(record["tolerances"]):
            record["tolerances"] = None
    span = {"start": piece.start, "stop": piece.stop}
    return {**span, "substitutions": substitutions, "violations": violations}
