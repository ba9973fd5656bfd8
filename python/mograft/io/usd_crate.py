"""The table of contents of binary USD files, checked before usd-core allocates memory for it.

The layout is that of ``pxr/usd/sdf/crateFile.h``: a header of 88 bytes, and sections that begin
with the number of their elements.
"""

import struct
from pathlib import Path
from typing import Any

from mograft.errors import FormatError

_MAGIC = b"PXR-USDC"
_HEADER = struct.Struct("<8s8sq64x")  # magic, version, offset of the table of contents
_SECTION = struct.Struct("<16sqq")  # name, first byte, size
_COUNT = struct.Struct("<Q")

_MIN_COUNT_LIMIT, _COUNTS_PER_BYTE = 1 << 16, 256
"""Limits of the elements of a section: the first constant, or the second one per byte of the file
if that is more. Elements are compressed by LZ4, whose largest ratio is 255."""

_N_COUNTS = {b"TOKENS": 2, b"PATHS": 2}
"""How many counts stand at the start of a section; 1 for all others."""


def check_crate(path: Path) -> None:
    """Raise `FormatError` if a binary USD file states sections or elements that it cannot hold.

    Files of other formats are not checked.
    """
    if not path.is_file():
        return
    size = path.stat().st_size
    with path.open("rb") as file:

        def read(start: int, layout: struct.Struct, place: str) -> tuple[Any, ...]:
            if not 0 <= start <= size - layout.size:
                raise FormatError(
                    f"expected {layout.size} bytes from byte {start} on, got {size} in the file",
                    path,
                    place,
                )
            file.seek(start)
            return layout.unpack(file.read(layout.size))

        if file.read(len(_MAGIC)) != _MAGIC:
            return
        *_, contents = read(0, _HEADER, "header")
        (n_sections,) = read(contents, _COUNT, "table of contents")
        if n_sections > size // _SECTION.size:
            raise FormatError(
                f"expected at most {size // _SECTION.size} sections in {size} bytes, "
                f"got {n_sections}",
                path,
                "table of contents",
            )
        limit = max(_MIN_COUNT_LIMIT, _COUNTS_PER_BYTE * size)
        for section in range(n_sections):
            start = contents + _COUNT.size + section * _SECTION.size
            name, first, length = read(start, _SECTION, f"section {section}")
            word = name.rstrip(b"\0")
            place = f"section {word.decode('latin-1')}"
            if length < 0 or first + length > size:
                raise FormatError(
                    f"expected an end within {size} bytes, got {length} bytes from byte {first} on",
                    path,
                    place,
                )
            for number in range(_N_COUNTS.get(word, 1)):
                (count,) = read(first + number * _COUNT.size, _COUNT, place)
                if count > limit:
                    raise FormatError(
                        f"expected at most {limit} elements, got {count}", path, place
                    )
