"""Damaged BVH texts.

Each text is a small valid file with one to five random changes. Within 5 seconds, reading must
return a motion of finite numbers that can be written and read again, or raise a `BvhError` with a
position. The result must not depend on the chunk size.
"""

import io

import numpy as np

import mograft as mg
from tests.fuzz import damage, limits, outcome
from tests.io import bvh_helpers

TEXT = bvh_helpers.TEXT.replace("JOINT Spine", "JOINT Spine 1").replace("Site", "Site tip").encode()
HEAD = b"\t\tJOINT Head\n\t\t{\n\t\t\tOFFSET 0.0 20.0 1e-7\n\t\t\tCHANNELS 0\n\t\t}\n"
TEXT = TEXT.replace(b"5.0 0.0\n\t\t}\n", b"5.0 0.0\n\t\t}\n" + HEAD)
TOKENS = [
    *b"HIERARCHY ROOT JOINT End Site { } OFFSET CHANNELS MOTION Frames: Frame Time: Frames".split(),
    *b"0 3 -3 6 1e5 1e308 1e309 -0 .5 5. nan inf 1,5 1_0 0x1 1.5-2 + - . e # // 9999999999".split(),
    *b"Xposition Zrotation zROTATION Wrotation 1000000000000000000000 1.#IND \xe9 \xff\xfe".split(),
    b"\0", b"\x1a", b"\r", b"\n", b"\r\n", b"\t", b" ", b"\v", b"\xef\xbb\xbf", b"\xc2\xa0", b""
]  # fmt: skip


FILES = {end: TEXT.replace(b"\n", end) for end in (b"\n", b"\r\n", b"\r", b" \n\n")}
FILES[b"UTF-16"] = TEXT.decode().encode("utf-16")


def mutate(seed):
    """Return a damaged text."""
    return damage(seed, FILES, TOKENS)[1]


def check(seed, folder=None):  # noqa: ARG001 - the other formats need a folder
    """Read a damaged text; return whether it was read."""
    text = mutate(seed)
    with limits(5.0):
        whole = outcome(mg.read_bvh, io.BytesIO(text))
    if isinstance(whole, mg.BvhError):
        assert str(whole).startswith(f"<stream>:{whole.line}:{whole.column}: "), whole
        return False
    assert np.isfinite(whole.channel_values).all()
    file = io.BytesIO()
    mg.write_bvh(whole, file)
    file.seek(0)
    again = mg.read_bvh(file)
    assert again.skeleton.names == whole.skeleton.names
    assert again.channel_values.tobytes() == whole.channel_values.tobytes()
    return True
