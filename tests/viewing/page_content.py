"""The content of pages, read as a browser reads it."""

import base64
import json
import re
import zlib
from html.parser import HTMLParser

import numpy as np


class Tags(HTMLParser):
    """The tags of HTML with their attributes."""

    def __init__(self, text):
        super().__init__()
        self.found = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))


def page_data(page):
    """Return the JSON data of a page, with the positions of each clip."""
    data = _element(page, "mograft-data")
    for clip in data["clips"]:
        clip |= _element(page, clip["data"])
    return data


def _element(page, name):
    text = re.search(rf'id="{name}">(.*?)</script>', page.html, re.DOTALL)[1]
    # Browsers end a script at "</script " as well, which Python's parser does not.
    assert not set("<>&") & set(text)
    return json.loads(text)


def clip_positions(clip):
    """Return the node positions of a clip of the data, shape (n_frames, n_nodes, 3)."""
    path = zlib.decompress(base64.b64decode(clip["path"]))
    pose = zlib.decompress(base64.b64decode(clip["pose"]))
    root = np.frombuffer(path, "<f4").astype(float).reshape(-1, 3)
    return dequantize(clip["unit"], root, pose)


def dequantize(unit, path, pose):
    """Return the positions that `mograft.viewing.encoding.quantize` was given."""
    planes = np.frombuffer(pose, np.uint8).reshape(2, -1, len(path)).astype(np.uint16)
    folded = planes[0] | (planes[1] << 8)
    change = ((folded >> 1) ^ -(folded & 1).astype(np.int16)).astype(np.int16)
    integers = change.cumsum(axis=1, dtype=np.int16).cumsum(axis=1, dtype=np.int16)
    return path[:, None] + integers.T.reshape(len(path), -1, 3) * unit
