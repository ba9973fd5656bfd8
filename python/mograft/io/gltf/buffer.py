"""The binary buffer of a GLB file, the packing of the file, and copies of glTF content."""

import json
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from mograft.errors import FormatError
from mograft.io.gltf.container import COMPRESSION, Container

# Constants of the glTF specification: component types by NumPy type, and the target of vertex
# buffers.
_COMPONENT_TYPES = {"f4": 5126, "u1": 5121, "u2": 5123}
_ARRAY_BUFFER = 34962

_IMAGE_TYPES = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}
"""Media types of images by their first bytes."""

_MAX_IMAGE_BYTES = 1 << 30

Json = dict[str, Any]
_Place = tuple[int, int]  # of a buffer's bytes in the copy: the index of the buffer, and the offset


@dataclass
class GltfBuffer:
    """The binary buffer of a GLB file, and the buffer views and accessors of its arrays.

    The views and accessors may begin with those of a file to which arrays are added.
    """

    data: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)

    def add(
        self,
        array: npt.NDArray[Any],
        element_type: str,
        *,
        has_bounds: bool = False,
        is_vertex_data: bool = False,
    ) -> int:
        """Append an array and return the index of its accessor.

        `element_type` is the glTF type of a row, such as ``"VEC3"``. `has_bounds` adds the minimum
        and maximum; `is_vertex_data` marks vertex attributes.
        """
        array = np.ascontiguousarray(array)
        view = self.add_bytes(array.tobytes())
        if is_vertex_data:
            self.views[view]["target"] = _ARRAY_BUFFER
        accessor = {
            "bufferView": view,
            "componentType": _COMPONENT_TYPES[array.dtype.str[1:]],
            "count": len(array),
            "type": element_type,
        }
        if has_bounds:
            rows = array.reshape(len(array), -1)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def add_bytes(self, content: bytes | memoryview) -> int:
        """Append bytes and return the index of their buffer view."""
        offset = self.append(content)
        self.views.append({"buffer": 0, "byteOffset": offset, "byteLength": len(content)})
        return len(self.views) - 1

    def append(self, content: bytes | memoryview) -> int:
        """Append bytes at a multiple of 4, as glTF requires, and return their offset."""
        self.data += bytes(-len(self.data) % 4)
        offset = len(self.data)
        self.data += content
        return offset

    def pack(self, document: dict[str, Any]) -> bytes:
        """Return the bytes of the GLB file: header, JSON chunk of `document`, binary chunk.

        ``bufferViews`` and ``accessors`` of the document become those of this buffer. Its first
        entry of ``buffers`` describes the binary chunk: the length is set, and other fields are
        kept, as are the other entries. Raises ValueError if the file would have 4 GiB or more.
        """
        self.data += bytes(-len(self.data) % 4)
        buffers = document.get("buffers") or [{}]
        document = document | {
            "buffers": [{**buffers[0], "byteLength": len(self.data)}, *buffers[1:]],
            "bufferViews": self.views,
            "accessors": self.accessors,
        }
        text = json.dumps(document, separators=(",", ":"), ensure_ascii=False)
        chunk = text.encode("utf-8", "replace")
        chunk += b" " * (-len(chunk) % 4)
        n_bytes = 28 + len(chunk) + len(self.data)
        if n_bytes >= 2**32:
            raise ValueError(f"a GLB file must be smaller than 4 GiB, got {n_bytes} bytes")
        header = struct.pack("<4sIII4s", b"glTF", 2, n_bytes, len(chunk), b"JSON")
        return b"".join([header, chunk, struct.pack("<I4s", len(self.data), b"BIN\0"), self.data])


def copy_content(container: Container) -> tuple[Json, GltfBuffer]:
    """Return the JSON document of a copy, and a binary buffer with all data of the file.

    The binary buffer begins with the file's binary chunk, if there is one. The bytes of the other
    buffers and of images in other files follow. Buffers without data, which extensions use, are
    kept as they are. The document shares the objects of the file that do not change.
    """
    buffer = GltfBuffer(accessors=list(container.items("accessors")))
    places, buffers = _merge_buffers(container, buffer)
    is_moved = any(place != (index, 0) for index, place in enumerate(places))
    views = container.items("bufferViews")
    buffer.views += [_move_view(container, view, places) for view in views] if is_moved else views
    document = {**container.document, "buffers": buffers}
    images = document.get("images")
    if isinstance(images, list):
        document["images"] = [_copy_image(container, image, buffer) for image in images]
    return document, buffer


def _merge_buffers(container: Container, buffer: GltfBuffer) -> tuple[list[_Place], list[Json]]:
    """Append the data of all buffers to `buffer`.

    Return the place of each buffer, and the entries of ``buffers`` in the copy: that of the binary
    chunk, then the buffers without data.
    """
    items = container.items("buffers")
    places: list[_Place] = []
    entries: list[Json] = [{}]
    for index, item in enumerate(items):
        has_data = "uri" in item or (index == 0 and container.binary is not None)
        if has_data:
            data = container.buffer(index, f"buffers[{index}]")
            places.append((0, buffer.append(data)))
            if index == 0:
                entries[0] = {name: value for name, value in item.items() if name != "uri"}
        else:
            places.append((len(entries), 0))
            entries.append(item)
    return places, entries


def _move_view(container: Container, view: Json, places: list[_Place]) -> Json:
    """Return a buffer view that refers to the buffers of the copy."""
    view = _move(container, view, places)
    extensions = view.get("extensions")
    if isinstance(extensions, dict):
        view["extensions"] = extensions | {
            name: _move(container, extensions[name], places)
            for name in COMPRESSION
            if type(extensions.get(name)) is dict
        }
    return view


def _move(container: Container, reference: Json, places: list[_Place]) -> Json:
    """Return an object with its ``buffer`` and ``byteOffset`` changed to those in the copy."""
    index = container.integer(reference.get("buffer"), "bufferViews.buffer")
    container.item("buffers", index, "bufferViews.buffer")
    offset = container.integer(reference.get("byteOffset", 0), "bufferViews.byteOffset")
    place, start = places[index]
    return {**reference, "buffer": place, "byteOffset": offset + start}


def _copy_image(container: Container, image: object, buffer: GltfBuffer) -> object:
    """Append the bytes of an image in another file to `buffer`; return the changed image.

    An image stays a reference to its file if the file is missing or not in the folder of the glTF
    file, or if its type is unknown: neither PNG nor JPEG, and no media type is given.
    """
    uri = image.get("uri") if isinstance(image, dict) else None
    if not isinstance(image, dict) or not isinstance(uri, str) or uri.startswith("data:"):
        return image
    try:
        data = container.read_file(uri, _MAX_IMAGE_BYTES, "images")
    except FormatError:
        return image
    found = [name for start, name in _IMAGE_TYPES.items() if data[: len(start)] == start]
    kind = found[0] if found else image.get("mimeType")
    if not isinstance(kind, str):
        return image
    rest = {name: value for name, value in image.items() if name != "uri"}
    return {**rest, "mimeType": kind, "bufferView": buffer.add_bytes(data)}
