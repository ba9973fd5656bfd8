"""Messages and bundles of Open Sound Control 1.0 in UDP packets, as VMC uses them.

python-osc would do the same in a dependency of 3,000 lines; VMC needs texts and numbers only.
"""

import struct
from collections.abc import Iterable, Iterator
from typing import TypeAlias

Argument: TypeAlias = str | float
Message: TypeAlias = tuple[str, tuple[Argument, ...]]
"""An address such as ``/VMC/Ext/T``, and its arguments."""

_BUNDLE = b"#bundle\0"
_IMMEDIATELY = struct.pack(">Q", 1)
_NUMBERS = {"i": ">i", "f": ">f", "h": ">q", "d": ">d"}
_CONSTANTS = {"T": 1, "F": 0, "N": 0}
_MAX_DEPTH = 4  # of bundles in bundles


def encode_bundle(messages: Iterable[Message]) -> bytes:
    """Return one packet with messages whose arguments are int, float or str."""
    parts = [_BUNDLE, _IMMEDIATELY]
    for message in messages:
        content = _encode(*message)
        parts += [struct.pack(">i", len(content)), content]
    return b"".join(parts)


def _encode(address: str, arguments: Iterable[Argument]) -> bytes:
    tags, parts = ",", list[bytes]()
    for value in arguments:
        tag = "s" if isinstance(value, str) else "i" if isinstance(value, int) else "f"
        tags += tag
        parts.append(_pad(value) if isinstance(value, str) else struct.pack(f">{tag}", value))
    return b"".join([_pad(address), _pad(tags), *parts])


def _pad(text: str) -> bytes:
    """Return a text with 1 to 4 zeros at its end, which make its length a multiple of 4."""
    data = text.encode()
    return data + bytes(4 - len(data) % 4)


def decode(packet: bytes) -> list[Message]:
    """Return the messages of a packet; raise ValueError if it is not valid."""
    try:
        return list(_decode(packet, _MAX_DEPTH))
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise ValueError(f"expected an OSC packet: {error}") from error


def _decode(packet: bytes, depth: int) -> Iterator[Message]:
    if not packet.startswith(_BUNDLE):
        yield _decode_message(packet)
        return
    if not depth:
        raise ValueError(f"expected at most {_MAX_DEPTH} bundles in each other")
    start = len(_BUNDLE) + len(_IMMEDIATELY)
    if len(packet) < start:
        raise ValueError("expected the time of a bundle")
    while start < len(packet):
        (size,) = struct.unpack_from(">I", packet, start)
        stop = start + 4 + size
        if stop > len(packet):
            raise ValueError(f"expected {size} bytes, got {len(packet) - start - 4}")
        yield from _decode(packet[start + 4 : stop], depth - 1)
        start = stop


def _decode_message(packet: bytes) -> Message:
    address, start = _read_text(packet, 0)
    tags, start = _read_text(packet, start)
    if address[:1] != "/" or tags[:1] != ",":
        raise ValueError("expected an address and the types of its arguments")
    arguments = list[Argument]()
    for tag in tags[1:]:
        if tag in "sS":
            value, start = _read_text(packet, start)
            arguments.append(value)
        elif tag in _NUMBERS:
            arguments += struct.unpack_from(_NUMBERS[tag], packet, start)
            start += struct.calcsize(_NUMBERS[tag])
        elif tag in _CONSTANTS:
            arguments.append(_CONSTANTS[tag])
        else:
            raise ValueError(f"expected texts and numbers, got the type {tag!r}")
    return address, tuple(arguments)


def _read_text(packet: bytes, start: int) -> tuple[str, int]:
    """Return the text at a place of a packet, and where the next value begins."""
    stop = packet.index(b"\0", start)
    return packet[start:stop].decode(), start + 4 * ((stop - start) // 4 + 1)
