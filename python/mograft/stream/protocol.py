"""Messages of the protocol ``mograft.stream/1``: a JSON header and arrays, with their lengths.

docs/howto/stream.md describes the protocol. Everything is little-endian.
"""

import json
import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

PROTOCOL = "mograft.stream/1"
MAGIC = b"MGS1"
LENGTHS = struct.Struct("<II")
"""The lengths of header and body in bytes, which follow the magic number."""

MAX_HEADER_BYTES = 65_536
MAX_BODY_BYTES = 64 * 1024 * 1024
MAX_NUMBER = 1e15
"""Largest magnitude of numbers in the header of a request."""

_MAX_DIMENSIONS = 3
DTYPES: Mapping[str, "np.dtype[np.floating[Any]]"] = {
    "float32": np.dtype("<f4"),
    "float64": np.dtype("<f8"),
}

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
        listed = [
            {"name": name, "dtype": dtype, "shape": list(array.shape)}
            for name, array in arrays.items()
        ]
        text = json.dumps({**self.header, "arrays": listed}, allow_nan=False).encode()
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
    for name, length, limit in (
        ("header", n_header, MAX_HEADER_BYTES),
        ("body", n_body, MAX_BODY_BYTES),
    ):
        if length > limit:
            raise FrameError(f"the {name} must have at most {limit} bytes, got {length}")
    header, body = receive(n_header), receive(n_body)
    document = _read_header(header)
    arrays = document.pop("arrays", [])
    return Message(document, _read_arrays(arrays, body))


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
    arrays: dict[str, Array] = {}
    start = 0
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
        raise RequestError(
            f"the body must have {start} bytes, the size of its arrays, got {len(body)}"
        )
    return arrays


def _read_description(record: object) -> tuple[str, "np.dtype[np.floating[Any]]", list[int]]:
    """Return name, dtype and shape of an array from its description in the header."""
    if not isinstance(record, dict) or set(record) != {"name", "dtype", "shape"}:
        raise RequestError("each of `arrays` must be an object with name, dtype and shape")
    name, dtype, shape = record["name"], record["dtype"], record["shape"]
    if not isinstance(name, str):
        raise RequestError(f"the name of an array must be a string, got {name!r}")
    if not isinstance(dtype, str) or dtype not in DTYPES:
        raise RequestError(
            f"the dtype of {name!r} must be one of {', '.join(DTYPES)}, got {dtype!r}"
        )
    is_shape = isinstance(shape, list) and len(shape) <= _MAX_DIMENSIONS
    if not is_shape or not all(type(size) is int and 0 <= size <= MAX_BODY_BYTES for size in shape):
        raise RequestError(
            f"the shape of {name!r} must be a list of at most {_MAX_DIMENSIONS} integers from 0 to "
            f"{MAX_BODY_BYTES}, got {shape!r}"
        )
    return name, DTYPES[dtype], shape
