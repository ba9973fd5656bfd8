"""The binary buffer of a GLB file, and the packing of the file."""

import json
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

# Constants of the glTF specification: component types by NumPy type, and the target of vertex
# buffers.
_COMPONENT_TYPES = {"f4": 5126, "u1": 5121, "u2": 5123}
_ARRAY_BUFFER = 34962


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
        return b"".join(
            [
                struct.pack("<4sII", b"glTF", 2, n_bytes),
                struct.pack("<I4s", len(chunk), b"JSON"),
                chunk,
                struct.pack("<I4s", len(self.data), b"BIN\0"),
                self.data,
            ]
        )
