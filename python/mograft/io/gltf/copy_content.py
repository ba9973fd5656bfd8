"""Copies of glTF files: the document, and one buffer with the data of all buffers and images."""

from mograft.errors import FormatError
from mograft.io.glb import GltfBuffer, Json
from mograft.io.gltf.container import COMPRESSION, Container

IMAGE_TYPES = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}
"""Media types of images by their first bytes."""

MAX_IMAGE_BYTES = 1 << 30

_Place = tuple[int, int]  # of a buffer's bytes in the copy: the index of the buffer, and the offset


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
        data = container.read_file(uri, MAX_IMAGE_BYTES, "images")
    except FormatError:
        return image
    found = [name for start, name in IMAGE_TYPES.items() if data[: len(start)] == start]
    kind = found[0] if found else image.get("mimeType")
    if not isinstance(kind, str):
        return image
    rest = {name: value for name, value in image.items() if name != "uri"}
    return {**rest, "mimeType": kind, "bufferView": buffer.add_bytes(data)}
