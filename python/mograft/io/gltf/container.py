"""The parts of a glTF file: its JSON document, its buffers, and the arrays in them.

All sizes that a file declares are compared with the bytes that it has. Buffers in other files are
read only from the folder of the file and its subfolders.
"""

import base64
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn, TypeVar
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray
from mograft._util.documents import parse_document
from mograft.errors import FormatError

MAGIC = b"glTF"
COMPRESSION = ("EXT_meshopt_compression", "KHR_meshopt_compression")
"""Extensions of buffer views whose data are compressed."""

_HEADER = struct.Struct("<4sII")  # magic, version, length of the file
_CHUNK = struct.Struct("<I4s")  # length of the data, type
_COLLECTIONS = (
    *("accessors", "animations", "bufferViews", "buffers", "meshes", "nodes", "scenes", "skins"),
)
_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_INDEX_TYPES = (5121, 5123, 5125)

Array = npt.NDArray[Any]
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Container:
    """The JSON document of a glTF file, and its buffers, which are read at their first use."""

    path: Path
    document: dict[str, Any]  # the values of `_COLLECTIONS`, if present, are lists of objects
    binary: memoryview | None  # the binary chunk of a GLB file
    data: memoryview = field(repr=False)  # the whole file
    _buffers: dict[int, memoryview] = field(default_factory=dict, repr=False)

    @property
    def n_bytes(self) -> int:
        """Bytes of the file and of the buffers that have been read."""
        return len(self.data) + sum(map(len, self._buffers.values()))

    def fail(self, place: str, message: str) -> NoReturn:
        """Raise a `FormatError` for a place in the document."""
        raise FormatError(message, self.path, place)

    def items(self, collection: str) -> list[dict[str, Any]]:
        """Return the objects of a collection such as ``"nodes"``; empty if it is absent."""
        return self.document.get(collection, [])

    def item(self, collection: str, index: object, place: str) -> dict[str, Any]:
        """Return the object with this index in a collection; errors name `place`."""
        return self.choose(self.items(collection), index, place, collection)

    def choose(self, items: Sequence[T], index: object, place: str, kind: str) -> T:
        """Return the item with this index; errors name `place` and the kind of the items."""
        if type(index) is not int or not 0 <= index < len(items):
            self.fail(place, f"expected an index of {len(items)} {kind}, got {index!r}")
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
        given = value if isinstance(value, list) else []
        if len(given) != count or not all(type(v) in (int, float) and abs(v) < 1e30 for v in given):
            self.fail(place, f"expected {count} numbers, got {_shorten(value)}")
        return [float(v) for v in given]

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
        except ValueError as error:
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


def read_container(path: Path, content: bytes | None = None) -> Container:
    """Read a glTF file; raise `FormatError` unless it has a JSON document of glTF 2.0.

    Every collection of the document, if present, must be a list of objects. `content` has the bytes
    of a file that does not exist; `path` then names it in messages.
    """
    data = memoryview(path.read_bytes() if content is None else content)
    is_binary = data[:4] == MAGIC
    text, binary = _split_chunks(path, data) if is_binary else (data, None)
    try:
        document = parse_document(bytes(text).decode("utf-8-sig"))
    except ValueError as error:
        place = "JSON chunk" if is_binary else "JSON"
        raise FormatError(f"expected JSON: {error}", path, place) from error
    if not isinstance(document, dict) or not isinstance(document.get("asset"), dict):
        raise FormatError("expected an object with `asset`", path, "JSON")
    container = Container(path, document, binary, data)
    for name in _COLLECTIONS:
        items = document.get(name, [])
        if not isinstance(items, list):
            container.fail(name, f"expected a list, got {_shorten(items)}")
        for index, item in enumerate(items):
            if type(item) is not dict:
                container.fail(f"{name}[{index}]", f"expected an object, got {_shorten(item)}")
    version = document["asset"].get("version")
    if not isinstance(version, str) or version.split(".")[0] != "2":
        container.fail("asset.version", f"expected glTF 2.0, got {_shorten(version)}")
    return container


def _split_chunks(path: Path, data: memoryview) -> tuple[memoryview, memoryview | None]:
    """Return the JSON chunk of a GLB file, and the binary chunk, if any."""

    def check(is_valid: bool, message: str, byte: int) -> None:  # noqa: FBT001 - a condition
        if not is_valid:
            raise FormatError(f"expected {message}", path, f"byte {byte}")

    check(len(data) >= _HEADER.size, f"a header of {_HEADER.size} bytes, got {len(data)}", 0)
    _, version, length = _HEADER.unpack_from(data)
    check(version == 2, f"version 2 of GLB, got {version}", 4)
    check(length <= len(data), f"{length} bytes, as the header states, got {len(data)}", 8)
    chunks: list[tuple[bytes, memoryview]] = []
    start = _HEADER.size
    while start + _CHUNK.size <= length and len(chunks) < 2:
        size, kind = _CHUNK.unpack_from(data, start)
        first = start + _CHUNK.size
        end = first + size
        check(end <= length, f"a chunk of at most {length - first} bytes, got {size}", start)
        chunks.append((kind, data[first:end]))
        start = end + -end % 4
    check(bool(chunks) and chunks[0][0] == b"JSON", "a JSON chunk", _HEADER.size)
    has_binary = len(chunks) > 1 and chunks[1][0] == b"BIN\0"
    return chunks[0][1], chunks[1][1] if has_binary else None


def _shorten(value: object) -> str:
    """Return the text of a value for a message, of at most 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def read_accessors(
    container: Container, indices: Sequence[object], place: str, counts: Sequence[int], width: int
) -> FloatArray:
    """Return the elements of several accessors one after another, shape (sum of counts, width).

    Accessor i must have `counts[i]` elements. `place` names, in messages, the part of the document
    that refers to the accessors.
    """
    arrays = [to_floats(read_accessor(container, index, place, width)) for index in indices]
    for index, array, count in zip(indices, arrays, counts, strict=True):
        if len(array) != count:
            own = f"accessors[{index}]"
            container.fail(place, f"expected {count} elements in {own}, got {len(array)}")
    return np.concatenate(arrays)


def to_floats(array: Array) -> FloatArray:
    """Return an array as float64, without a warning if it holds a signalling NaN."""
    with np.errstate(invalid="ignore"):
        return array.astype(np.float64)


def read_accessor(container: Container, index: object, place: str, width: int) -> Array:
    """Return the elements of an accessor, shape (count, width).

    The type is that of the file, except that normalized integers become float64. The array is a
    view of the file's bytes if possible. `place` names, in messages, the part of the document that
    refers to the accessor.
    """
    accessor = container.item("accessors", index, place)
    own = f"accessors[{index}]"
    count = container.integer(accessor.get("count"), f"{own}.count", 1)
    kind, component = accessor.get("type"), accessor.get("componentType")
    if not isinstance(kind, str) or _WIDTHS.get(kind) != width:
        container.fail(f"{own}.type", f"expected {width} components, got {kind!r}")
    if type(component) is not int or component not in _TYPES:
        container.fail(f"{own}.componentType", f"expected a component type, got {component!r}")
    dtype = np.dtype(_TYPES[component])
    if accessor.get("bufferView") is None:
        # Zeros, of which the file stores none; their number is limited by the size of the file.
        if count > len(container.data):
            container.fail(f"{own}.count", f"expected elements in the file, got {count} zeros")
        values = np.zeros((count, width), dtype)
    else:
        values = _read_view(container, accessor, (count, width), dtype, own)
    if "sparse" in accessor:
        values = _with_sparse_values(container, accessor["sparse"], values, f"{own}.sparse")
    if accessor.get("normalized") is True and dtype.kind != "f":
        largest = np.iinfo(dtype.str).max
        values = np.maximum(values / largest, -1.0)
    return values


def _read_view(
    container: Container,
    part: dict[str, Any],
    shape: tuple[int, int],
    dtype: np.dtype[Any],
    place: str,
) -> Array:
    """Return the array of an accessor, or of a part of a sparse one, from its buffer view."""
    start, index = part.get("byteOffset", 0), part.get("bufferView")
    start = container.integer(start, f"{place}.byteOffset")
    view = container.item("bufferViews", index, f"{place}.bufferView")
    own = f"bufferViews[{index}]"
    extensions = view.get("extensions")
    if isinstance(extensions, dict) and not extensions.keys().isdisjoint(COMPRESSION):
        container.fail(own, "expected uncompressed data, got meshopt compression")
    buffer = container.buffer(view.get("buffer", -1), f"{own}.buffer")
    offset = container.integer(view.get("byteOffset", 0), f"{own}.byteOffset")
    length = container.integer(view.get("byteLength"), f"{own}.byteLength", 1)
    if offset + length > len(buffer):
        container.fail(own, f"expected an end within {len(buffer)} bytes, got {offset + length}")
    count, width = shape
    element = dtype.itemsize * width
    stride = view.get("byteStride")
    step = element if stride is None else container.integer(stride, f"{own}.byteStride", 1)
    if step < element:
        container.fail(f"{own}.byteStride", f"expected at least {element} bytes, got {step}")
    end = start + step * (count - 1) + element
    if end > length:
        container.fail(place, f"expected elements within {length} bytes, got an end of {end}")
    strides = (step if count > 1 else element, dtype.itemsize)  # a file may state any step of one
    return np.ndarray(shape, dtype, buffer, offset + start, strides)


def _with_sparse_values(container: Container, sparse: object, values: Array, place: str) -> Array:
    """Return a copy of `values` in which the elements of a sparse accessor are replaced."""
    if not isinstance(sparse, dict):
        container.fail(place, "expected an object")
    count = container.integer(sparse.get("count"), f"{place}.count", 1)
    if count > len(values):
        container.fail(f"{place}.count", f"expected at most {len(values)}, got {count}")

    indices, elements = sparse.get("indices"), sparse.get("values")
    if not isinstance(indices, dict) or not isinstance(elements, dict):
        container.fail(place, "expected `indices` and `values`")
    component, own = indices.get("componentType"), f"{place}.indices"
    if component not in _INDEX_TYPES:
        container.fail(f"{own}.componentType", f"expected unsigned, got {component!r}")
    rows = _read_view(container, indices, (count, 1), np.dtype(_TYPES[component]), own)[:, 0]
    rows = rows.astype(np.int64)
    if rows[-1] >= len(values) or (np.diff(rows) <= 0).any():
        container.fail(own, f"expected increasing indices below {len(values)}")
    changed, shape = values.copy(), (count, values.shape[1])
    changed[rows] = _read_view(container, elements, shape, values.dtype, f"{place}.values")
    return changed
