"""Grafts in a glTF file: their provenance, and the content that the file had without them.

``extras`` of the animation of a graft have the provenance as text, because other programs keep a
text better than objects. They also have the SHA-256 that the file had before its first graft, and
the number of accessors, buffer views and bytes in it: a graft can be added or replaced without a
change of the other content, and without changing the file's identity.
"""

import hashlib
import json
from contextlib import suppress
from typing import NamedTuple

from mograft.errors import DAMAGE
from mograft.io.glb import GltfBuffer, Json
from mograft.io.gltf.container import Container

_PROVENANCE = "mograft"
_ORIGINAL = "mograft_original"


class Original(NamedTuple):
    """A file without its grafts."""

    sha256: str  # of the file before its first graft; "" if its animations have changed since
    accessors: int
    views: int
    n_bytes: int  # of the first buffer

    def hash_content(self, document: Json, data: bytes | bytearray | memoryview) -> str:
        """Return the SHA-256 of the content of a document and its first buffer without grafts."""
        kept = {name: value for name, value in document.items() if name != "buffers"}
        kept["animations"] = [own for own in kept.get("animations", []) if not provenance(own)]
        for name, count in (("accessors", self.accessors), ("bufferViews", self.views)):
            kept[name] = kept.get(name, [])[:count]
        digest = hashlib.sha256(json.dumps(kept, sort_keys=True).encode())
        digest.update(data[: self.n_bytes])
        return digest.hexdigest()


def _extras(animation: Json) -> Json:
    extras = animation.get("extras")
    return extras if isinstance(extras, dict) else {}


def provenance(animation: Json) -> str | None:
    """Return the text of the provenance of an animation; None if it is not a graft."""
    text = _extras(animation).get(_PROVENANCE)
    return text if isinstance(text, str) else None


def with_provenance(animation: Json, text: str) -> Json:
    """Return an animation as that of a graft with the provenance `text`."""
    return {**animation, "extras": {**_extras(animation), _PROVENANCE: text}}


def find_original(container: Container, copy: GltfBuffer | None = None) -> Original:
    """Return what a file is without its grafts.

    If another program has changed the file, or it has no grafts, that is the whole file, or `copy`,
    the buffer of a copy, which may also have images of other files.
    """
    has_data = bool(container.items("buffers")) and container.binary is not None
    data = container.buffer(0, "buffers[0]") if has_data else memoryview(b"")
    sizes = *(len(container.items(name)) for name in ("accessors", "bufferViews")), len(data)
    copied = sizes if copy is None else (len(copy.accessors), len(copy.views), len(copy.data))
    sha256 = ""
    for animation in container.items("animations"):
        with suppress(*DAMAGE):
            record = _extras(animation)[_ORIGINAL]
            original = Original(*(record[name] for name in Original._fields))
            if original.hash_content(container.document, data) == record["content_sha256"]:
                if copied == sizes:
                    return original
                sha256 = original.sha256
    return Original(sha256 or hashlib.sha256(container.data).hexdigest(), *copied)


def complete(document: Json, buffer: GltfBuffer, original: Original) -> Json:
    """Return a document with new animations, without the arrays of former grafts.

    Behind the `original` content, the buffer then has the arrays of new animations that are not
    grafts, which become part of that content, and last those of grafts. ``extras`` of grafts
    describe the content. `document` and `buffer` are those of a copy of the file.
    """
    first, animations = original.accessors, list(document["animations"])
    accessors, views, data = buffer.accessors[first:], list(buffer.views), bytes(buffer.data)
    del buffer.accessors[first:], buffer.views[original.views :], buffer.data[original.n_bytes :]
    moved: dict[int, int] = {}
    sizes: tuple[int, int, int] | None = None

    def move(index: int) -> int:
        if index >= first and index not in moved:
            accessor = accessors[index - first]
            view = views[accessor["bufferView"]]
            content = data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
            moved[index] = len(buffer.accessors)
            buffer.accessors.append({**accessor, "bufferView": buffer.add_bytes(content)})
        return moved.get(index, index)

    def renumber(sampler: Json) -> Json:
        used = {key: sampler[key] for key in ("input", "output") if key in sampler}
        return {**sampler, **{key: move(index) for key, index in used.items()}}

    is_graft = [provenance(own) is not None for own in animations]
    for index in sorted(range(len(animations)), key=is_graft.__getitem__):
        if not is_graft[index]:
            sizes = None
        elif sizes is None:
            sizes = len(buffer.accessors), len(buffer.views), len(buffer.data)
        own = animations[index]
        animations[index] = {**own, "samplers": [*map(renumber, own["samplers"])]}
    document = {**document, "animations": animations}
    if not animations:
        del document["animations"]  # glTF forbids empty lists
    if sizes is not None:
        original = Original(original.sha256, *sizes)
        lists = {"accessors": buffer.accessors, "bufferViews": buffer.views}
        content = original.hash_content(document | lists, buffer.data)
        hashes = {"sha256": original.sha256 or content, "content_sha256": content}
        for own in filter(provenance, animations):
            own["extras"] = {**_extras(own), _ORIGINAL: original._asdict() | hashes}
    return document
