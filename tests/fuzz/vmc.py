"""Hostile VMC packets: changed ones of a dancer, and messages of any type.

A receiver counts and drops them; its frames have finite numbers.
"""

import random
import struct
from functools import cache

import numpy as np

from mograft.dancer import dance
from mograft.stream.live import Receiver
from mograft.stream.vmc import Figure
from tests.fuzz import change_bytes, limits

_WORDS = (b"\0" * 4, b"\xff" * 4, b"\x7f\xc0\0\0", b"#bundle\0", b"/VMC/Ext/T\0\0", b",", b"Hips\0")


@cache
def valid_packets():
    motion = dance(strides=1).motion[:4]
    return list(Figure(motion).packets(motion, 0.0, 1 / 30))


def mutate(seed):
    """Return a packet."""
    rng = random.Random(seed)
    data = rng.choice(valid_packets())
    kind = rng.randrange(8)
    if kind == 0:
        return rng.randbytes(rng.choice([0, 1, 4, 16, 1000, 65_507]))
    if kind == 1:  # bundles in bundles
        data = data[:400]
        for _ in range(rng.randrange(60)):
            data = b"#bundle\0" + bytes(8) + struct.pack(">i", len(data)) + data
        return data
    for _ in range(rng.randint(1, 8)):
        data = change_bytes(data, rng, _WORDS)
    return data


def check(seed, _folder):
    """Read a packet after a valid one; return the number of frames."""
    receiver = Receiver(("127.0.0.1", 0))
    try:
        figure, n = Figure(dance(strides=1).motion[:4]) if seed % 50 == 0 else None, 0
        with limits(5.0):
            for packet in (valid_packets()[0], mutate(seed)):
                frame = receiver._read(packet, "sender", 100.0)
                if frame is None:
                    continue
                n += 1
                at, bones = frame
                assert np.isfinite([at, *(x for own in bones.values() for x in own)]).all()
                if figure is not None and "Hips" in bones:
                    quats, place = figure.pose(bones, 0.8, 0)
                    assert np.isfinite(quats).all()
                    assert np.isfinite(place).all()
        return n
    finally:
        receiver.close()
