"""A client of ``mograft stream`` in Python, with NumPy as its only dependency.

docs/howto/stream.md describes the protocol.
"""

import json
import math
import socket
import struct

import numpy as np

DTYPES = {"float32": "<f4", "float64": "<f8"}


class StreamError(Exception):
    """An error reply of the server; `header` is its header."""

    def __init__(self, header):
        super().__init__(header["message"])
        self.header = header


class StreamClient:
    """A connection to a server; `address` is a pair of host and port."""

    def __init__(self, address, timeout=60.0):
        self.socket = socket.create_connection(address, timeout)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def request(self, header, **arrays):
        """Send a message, and return header and arrays of its reply."""
        self.send(header, **arrays)
        return self.receive()

    def send(self, header, **arrays):
        """Send a message; arrays of type float32 are sent as such, others as float64."""
        listed, body = [], b""
        for name, array in arrays.items():
            dtype = "float32" if array.dtype == np.float32 else "float64"
            listed.append({"name": name, "dtype": dtype, "shape": list(array.shape)})
            body += np.ascontiguousarray(array, DTYPES[dtype]).tobytes()
        text = json.dumps({**header, "arrays": listed}).encode()
        self.socket.sendall(b"MGS1" + struct.pack("<II", len(text), len(body)) + text + body)

    def receive(self):
        """Return header and arrays of the next reply; raise StreamError for an error."""
        prefix = self._read(12)
        if prefix[:4] != b"MGS1":
            raise ConnectionError(f"no reply of mograft.stream/1: {prefix!r}")
        n_header, n_body = struct.unpack("<II", prefix[4:])
        header, body = json.loads(self._read(n_header)), self._read(n_body)
        arrays, start = {}, 0
        for item in header.pop("arrays"):
            dtype = np.dtype(DTYPES[item["dtype"]])
            stop = start + math.prod(item["shape"]) * dtype.itemsize
            arrays[item["name"]] = np.frombuffer(body[start:stop], dtype).reshape(item["shape"])
            start = stop
        if header["type"] == "error":
            raise StreamError(header)
        return header, arrays

    def _read(self, n_bytes):
        data = b""
        while len(data) < n_bytes:
            part = self.socket.recv(n_bytes - len(data))
            if not part:
                raise ConnectionError("the server has closed the connection")
            data += part
        return data
