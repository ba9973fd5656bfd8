"""The parts of a glTF file: its JSON document and its buffers.

All sizes that a file declares are compared with the bytes that it has. Buffers in other files are
read only from the folder of the file and its subfolders.
"""

import base64
import binascii
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote

from mograft.errors import FormatError

MAGIC = b"glTF"
COMPRESSION = ("EXT_meshopt_compression", "KHR_meshopt_compression")
"""Extensions of buffer views whose data are compressed."""

_HEADER = struct.Struct("<4sII")  # magic, version, length of the file
_CHUNK = struct.Struct("<I4s")  # length of the data, type
_COLLECTIONS = (
    *("accessors", "animations", "bufferViews", "buffers", "meshes", "nodes", "scenes", "skins"),
)


@dataclass(frozen=True, eq=False)
class Container:
    """The JSON document of a glTF file, and its buffers, which are read at their first use."""

    path: Path
    document: dict[
        str, Any
    ]  # the values of the keys in `_COLLECTIONS`, if present, are lists of objects
    binary: memoryview | None  # the binary chunk of a GLB file
    file_bytes: int
    _buffers: dict[int, memoryview] = field(default_factory=dict, repr=False)

    @property
    def n_bytes(self) -> int:
        """Bytes of the file and of the buffers that have been read."""
        return self.file_bytes + sum(map(len, self._buffers.values()))

    def fail(self, place: str, message: str) -> NoReturn:
        """Raise a `FormatError` for a place in the document."""
        raise FormatError(message, self.path, place)

    def items(self, collection: str) -> list[dict[str, Any]]:
        """Return the objects of a collection such as ``"nodes"``; empty if it is absent."""
        return self.document.get(collection, [])

    def item(self, collection: str, index: object, place: str) -> dict[str, Any]:
        """Return the object with this index in a collection; errors name `place`."""
        items = self.document.get(collection, ())
        if type(index) is not int or not 0 <= index < len(items):
            self.fail(place, f"expected an index of {len(items)} {collection}, got {index!r}")
        return items[index]

    def integer(self, value: object, place: str, minimum: int = 0) -> int:
        """Return a value that must be an integer of at least `minimum`; errors name `place`."""
        if type(value) is float and value.is_integer():
            value = int(value)
        if type(value) is not int or value < minimum:
            self.fail(place, f"expected an integer of at least {minimum}, got {value!r}")
        return value

    def floats(self, value: object, place: str, count: int) -> list[float]:
        """Return a value that must be a list of `count` numbers below 1e30; errors name `place`."""
        if (
            not isinstance(value, list)
            or len(value) != count
            or not all(type(v) in (int, float) and abs(v) < 1e30 for v in value)
        ):
            self.fail(place, f"expected {count} numbers, got {_shorten(value)}")
        return [float(v) for v in value]

    def buffer(self, index: int, place: str) -> memoryview:
        """Return the bytes of the buffer with this index; errors name `place`."""
        buffer = self.item("buffers", index, place)
        if index not in self._buffers:
            self._buffers[index] = self._read_buffer(index, buffer)
        return self._buffers[index]

    def _read_buffer(self, index: int, buffer: dict[str, Any]) -> memoryview:
        own = f"buffers[{index}]"
        length = self.integer(buffer.get("byteLength"), f"{own}.byteLength", 1)
        uri = buffer.get("uri")
        if uri is None:
            if index != 0 or self.binary is None:
                self.fail(own, "expected a uri, got none")
            data = self.binary
        elif not isinstance(uri, str):
            self.fail(f"{own}.uri", f"expected a string, got {_shorten(uri)}")
        elif uri.startswith("data:"):
            data = self._decode(uri, f"{own}.uri")
        else:
            data = self.read_file(uri, length, f"{own}.uri")
        if len(data) < length:
            self.fail(own, f"expected {length} bytes, got {len(data)}")
        return data[:length]

    def _decode(self, uri: str, place: str) -> memoryview:
        header, comma, text = uri.partition(",")
        if not comma or not header.endswith(";base64"):
            self.fail(place, f"expected base64 data, got {_shorten(header)}")
        try:
            return memoryview(base64.b64decode(text, validate=True))
        except (binascii.Error, ValueError) as error:
            self.fail(place, f"expected base64 data: {error}")

    def read_file(self, uri: str, length: int, place: str) -> memoryview:
        """Read the first `length` bytes of a file in the folder of this file; errors name `place`.

        If the file is shorter, return all of it.
        """
        name = unquote(uri)
        folder = self.path.parent.resolve()
        if "\0" in name or ":" in name or "\\" in name or name.startswith("/"):
            self.fail(place, f"expected a relative path, got {_shorten(uri)}")
        try:
            path = (folder / name).resolve()
            if not path.is_relative_to(folder):
                self.fail(place, f"expected a file in the folder of the glTF file, got {uri!r}")
            if not path.is_file():
                self.fail(place, f"expected a file, found none at {uri!r}")
            with path.open("rb") as file:
                return memoryview(file.read(min(length, path.stat().st_size)))
        except (OSError, RuntimeError) as error:
            self.fail(place, f"{uri!r} cannot be read: {error}")


def read_container(path: Path) -> Container:
    """Read a glTF file; raise `FormatError` unless it has a JSON document of glTF 2.0."""
    data = memoryview(path.read_bytes())
    if data[:4] == MAGIC:
        text, text_place, binary = _split_chunks(path, data)
    else:
        text, text_place, binary = data, "JSON", None
    try:
        document = json.loads(bytes(text).decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"expected JSON: {error}", path, text_place) from error
    container = Container(path, _check_document(document, path), binary, len(data))
    version = container.document["asset"].get("version")
    if not isinstance(version, str) or version.split(".")[0] != "2":
        container.fail("asset.version", f"expected glTF 2.0, got {_shorten(version)}")
    return container


def _split_chunks(path: Path, data: memoryview) -> tuple[memoryview, str, memoryview | None]:
    """Return the JSON chunk of a GLB file, its name in messages, and the binary chunk, if any."""
    if len(data) < _HEADER.size:
        raise FormatError(
            f"expected a header of {_HEADER.size} bytes, got {len(data)}", path, "byte 0"
        )
    _, version, length = _HEADER.unpack_from(data)
    if version != 2:
        raise FormatError(f"expected version 2 of GLB, got {version}", path, "byte 4")
    if length > len(data):
        raise FormatError(
            f"expected {length} bytes, as the header states, got {len(data)}", path, "byte 8"
        )
    chunks: list[tuple[bytes, memoryview]] = []
    start = _HEADER.size
    while start + _CHUNK.size <= length and len(chunks) < 2:
        size, kind = _CHUNK.unpack_from(data, start)
        end = start + _CHUNK.size + size
        if end > length:
            raise FormatError(
                f"expected a chunk of at most {length - start - _CHUNK.size} bytes, got {size}",
                path,
                f"byte {start}",
            )
        chunks.append((kind, data[start + _CHUNK.size : end]))
        start = end + -end % 4
    if not chunks or chunks[0][0] != b"JSON":
        raise FormatError("expected a JSON chunk", path, f"byte {_HEADER.size}")
    has_binary = len(chunks) > 1 and chunks[1][0] == b"BIN\0"
    return chunks[0][1], "JSON chunk", chunks[1][1] if has_binary else None


def _check_document(document: object, path: Path) -> dict[str, Any]:
    """Return the document; raise `FormatError` unless `asset` and all collections are valid.

    `asset` must be an object, and a collection, if present, a list of objects.
    """
    if not isinstance(document, dict) or not isinstance(document.get("asset"), dict):
        raise FormatError("expected an object with `asset`", path, "JSON")
    for name in _COLLECTIONS:
        items = document.get(name, [])
        if not isinstance(items, list):
            raise FormatError(f"expected a list, got {_shorten(items)}", path, name)
        for index, item in enumerate(items):
            if type(item) is not dict:
                raise FormatError(
                    f"expected an object, got {_shorten(item)}", path, f"{name}[{index}]"
                )
    return document


def _shorten(value: object) -> str:
    """Return the text of a value for a message, of at most 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
