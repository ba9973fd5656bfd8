"""The content of pages, read as a browser reads it."""

import base64
import json
import re
import zlib
from html.parser import HTMLParser

import numpy as np

from mograft import view
from mograft.motion import rotations
from mograft.motion.motion import forward_kinematics


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
    for own in (*data["clips"], *data["characters"], *data["windows"].values()):
        own |= _element(page, own["data"])
    return data


def shown(*items, **options):
    """Return the data of the page that `view` makes."""
    return page_data(view(*items, show=False, **options))


def _element(page, name):
    text = re.search(rf'id="{name}">(.*?)</script>', page.html, re.DOTALL)[1]
    # Browsers end a script at "</script " as well, which Python's parser does not.
    assert not set("<>&") & set(text)
    return json.loads(text)


def decode_tracks(clip):
    """Return the rotations of the joints that turn, (n_frames, n, 4), and the positions."""
    pose = zlib.decompress(base64.b64decode(clip["pose"]))
    n_turns, n_moving = 4 * len(clip["turning"]), 3 * len(clip["moving"])
    tracks = dequantize(np.repeat(clip["units"], [n_turns, n_moving]), pose)
    turns, places = np.split(tracks, [n_turns], axis=1)
    return turns.reshape(len(tracks), -1, 4), places.reshape(len(tracks), -1, 3)


def clip_positions(clip):
    """Return the node positions of a clip of the data, shape (n_frames, n_nodes, 3)."""
    turning, moving = decode_tracks(clip)
    kept, n = len(turning), len(clip["parents"])
    turns = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (kept, n, 4)).copy()
    turns[:, clip["turning"]] = turning
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    places = np.broadcast_to(np.reshape(clip["offsets"], (n, 3)), (kept, n, 3)).copy()
    places[:, clip["moving"]] = moving
    world, positions = forward_kinematics(np.array(clip["parents"]), turns, places)
    nodes = _with_sites(world, positions, clip["ends"])
    turn = np.broadcast_to(clip["turn"], (*nodes.shape[:-1], 4))
    return rotations.rotate(turn, nodes) + clip["place"]


def node_positions(motion):
    """Return the world positions of joints and end sites, shape (n_frames, n_nodes, 3)."""
    sites = [(site.parent, *site.offset) for site in motion.skeleton.end_sites]
    return _with_sites(*motion.world_transforms(), sites)


def _with_sites(turns, joints, ends):
    """Return positions of joints, then of end sites: each a joint and an offset in `ends`."""
    sites = [joints[:, j] + rotations.rotate(turns[:, j], np.array(own)) for j, *own in ends]
    return np.concatenate([joints, *(site[:, None] for site in sites)], axis=1)


def dequantize(units, pose):
    """Return the tracks that `mograft.viewing.encoding.quantize` was given."""
    planes = np.frombuffer(pose, np.uint8).reshape(3, len(units), -1).astype(np.int32)
    folded = planes[0] | (planes[1] << 8) | (planes[2] << 16)
    change = (folded >> 1) ^ -(folded & 1)
    sums = change.astype(np.int64).cumsum(axis=1).cumsum(axis=1)
    return ((sums + 2**23) % 2**24 - 2**23).T * units
